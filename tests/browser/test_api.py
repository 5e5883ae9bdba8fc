"""The API as programs meet it: what is described is there, and mistakes are answered in words."""

from __future__ import annotations

import json
import urllib.error
import urllib.parse
import urllib.request
from typing import Any

import msgspec
import pytest
from websockets.sync.client import connect

from tests.support.signed_in import authorization

from .conftest import PATIENCE, RunningSystem


def call(system: RunningSystem, method: str, path: str, body: object = None, **query: object) -> tuple[int, Any]:
    """The HTTP status, and the JSON that was answered."""
    query_string = urllib.parse.urlencode({name: value for name, value in query.items() if value is not None})
    content = body if isinstance(body, bytes) else json.dumps(body).encode() if body is not None else None
    url = f"{system.url}/api{path}{f'?{query_string}' if query_string else ''}"
    request = urllib.request.Request(url, content, {"Content-Type": "application/json"}, method=method)
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
            return answer.status, json.loads(answer.read() or b"null")
    except urllib.error.HTTPError as error:
        return error.code, json.loads(error.read())


def api_description(system: RunningSystem) -> dict[str, Any]:
    description: dict[str, Any] = call(system, "GET", "/openapi.json")[1]
    return description


def test_wrong_bodies_and_parameters_are_answered_in_words(system: RunningSystem) -> None:
    """Whatever the operation, nothing that is sent to it ends in an error of the server's own."""
    request_count = 0
    for path, methods in api_description(system)["paths"].items():
        for method, operation in methods.items():
            if "requestBody" not in operation and not any(parameter["required"] for parameter in operation.get("parameters", ())):
                continue
            place = path.replace("{", "").replace("}", "") if "requestBody" in operation else path.replace("{", "no-such-").replace("}", "")
            status, answer = call(system, method.upper(), place, b'{"no": [' if "requestBody" in operation else None)
            assert status in (200, 400, 404, 409), f"{method} {place}: {status} {answer}"
            if "requestBody" in operation and operation["requestBody"]["required"]:
                assert status == 400, f"{method} {place} took what is no JSON"
                assert answer["problem"]
            request_count += 1
    assert request_count > 3


def test_a_wrong_formula_is_told_with_what_was_meant(system: RunningSystem) -> None:
    status, answer = call(system, "GET", "/map/query", formula="Jar002 isO ?Where")
    assert status in (400, 409)
    assert "did you mean isOn?" in answer["problem"] + answer["hint"]


def test_what_is_missing_is_named(system: RunningSystem) -> None:
    status, answer = call(system, "GET", "/map/query")
    assert status == 400
    assert "formula is missing" in answer["problem"]


def test_a_parameter_that_is_none_is_not_passed_over(system: RunningSystem) -> None:
    status, answer = call(system, "GET", "/map/query", formula="Jar002 isOn ?Where", limits=3)
    assert status == 400
    assert "did you mean limit?" in answer["problem"]


def test_a_change_of_the_map_is_news_to_whoever_follows_it(system: RunningSystem) -> None:
    with connect(system.url.replace("http", "ws") + "/api/live", additional_headers=authorization(system.data)) as socket:
        socket.send(json.dumps({"follow": ["map"]}))
        status, _ = call(system, "POST", "/map/changes", {"situation": 'Table002.Label = "By the window"', "author": "test"})
        assert status == 200
        while True:
            news = msgspec.json.decode(socket.recv(timeout=PATIENCE))
            if any(change.get("object") == "Table002" for change in news["value"]["changes"]):
                break
    assert news["topic"] == "map"


@pytest.mark.parametrize("message", ["", "{}", '{"follow": "map"}', "[1"])
def test_whoever_follows_nothing_is_told_how(system: RunningSystem, message: str) -> None:
    with connect(system.url.replace("http", "ws") + "/api/live", additional_headers=authorization(system.data)) as socket:
        socket.send(message)
        with pytest.raises(Exception, match="follow"):
            socket.recv(timeout=PATIENCE)
