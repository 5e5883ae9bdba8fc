"""Messages and requests that are almost right, drawn by a seed."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable

from somrs.protocol.messages import directory, frp, knowledge, previews, records, submission, task_news
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.soap import soap
from verification.attack.target import JSON, SOAP, Target, expect

TEXTS = (
    "",
    " ",
    "x" * 70_000,
    "\u202e",
    "ąę日本\U0001f916",
    "../../etc/passwd",
    "<a>&amp;</a>",
    "]]>",
    "${jndi:ldap://x}",
    "%s%n",
    "'; DROP TABLE objects; --",
    "urn:uuid:0",
    "http://127.0.0.1:1/x",
    "file:///etc/passwd",
    "Jar002",
    "Jar002 isOn Platform001",
    "?x",
    "null",
    "true",
    "-0",
)
NUMBERS = (
    "-1",
    "0",
    "1e308",
    "-1e308",
    "1e999",
    "INF",
    "-INF",
    "NaN",
    "9" * 17,
    "9" * 18,
    "9" * 400,
    "0.1",
    "-0.0",
    "1_000",
    "٣",
    "0x10",
    "",
)

BODIES: dict[str, tuple[Body, ...]] = {
    "Repository": (
        knowledge.QueryMap(formula="Jar002 isOn ?Where", limit=10),
        knowledge.ReadMap(after=""),
        knowledge.ReadOntology(),
        knowledge.ReadHistory(object="Jar002"),
        knowledge.ReadEvents(limit=10),
        knowledge.Consider(change=knowledge.UpdateMap()),
    ),
    "Registry": (directory.Discover(service_type="TransferObject"), directory.Renew(provider="Nobody", lease=10), directory.ReadPresence()),
    "Task Manager": (
        task_news.ReadTasks(),
        task_news.WatchTasks(wait=0),
        task_news.WatchTask(task="urn:uuid:1", wait=0),
        records.ReadRecords(),
        previews.Preview(effect="Jar002 isOn Nowhere"),
        submission.CancelTask(task="urn:uuid:1"),
        frp.Completed(situation="Jar002 isOn Platform001"),
        frp.Progress(fraction=0.5),
    ),
}

PATHS = (
    "/api/tasks",
    "/api/tasks?limit={n}",
    "/api/tasks?behind={t}",
    "/api/tasks/{t}",
    "/api/tasks/{t}/messages?after={n}",
    "/api/tasks/{t}/chart",
    "/api/records?limit={n}",
    "/api/records?since={n}",
    "/api/map?version={n}",
    "/api/map/objects/{t}",
    "/api/map/objects/{t}/history?limit={n}",
    "/api/map/events?limit={n}&before={n}",
    "/api/map/query?formula={t}&limit={n}",
    "/api/scene?version={n}",
    "/api/scene?names={t}",
    "/api/ontology",
    "/api/things?typed={t}&place={n}&limit={n}",
    "/api/fleet/{t}",
    "/api/orders/{t}/runs?limit={n}",
    "/api/templates/{t}",
    "/api/{t}",
    "/{t}",
)
"""Paths with a number `n` and a text `t`."""

WRITES: tuple[tuple[str, dict[str, object]], ...] = (
    ("/api/tasks/preview", {"effect": "Jar002 isOn Platform001", "deadline": 10, "time_value": 1, "priority": 1, "policy": "time"}),
    ("/api/formulas/check", {"text": "Jar002 isOn Platform001"}),
    ("/api/formulas/complete", {"text": "Jar002 is", "place": 3}),
    ("/api/map/consider", {"changes": [], "expected_version": 1}),
    ("/api/tasks/{t}/cancel", {}),
)


class Fuzz:
    """Draws messages and requests. `seed` and the number of one say which it is."""

    def __init__(self, target: Target, seed: int) -> None:
        self._target, self._random = target, random.Random(seed)

    async def message(self) -> None:
        """Send a message that has been changed a little."""
        server = self._random.choice([*BODIES])
        address = self._target.soap[server]
        header = Header(sender=ANONYMOUS, recipient=address, message_id=f"urn:uuid:{self._random.getrandbits(64)}")
        body = self._random.choice(BODIES[server])
        if isinstance(body, frp.Completed | frp.Progress):
            header = Header(
                sender=ANONYMOUS, recipient=address, message_id=header.message_id, transaction="urn:uuid:1", participant="Robot1#1"
            )
        document = soap.encode(Message(header=header, body=body))
        for _ in range(self._random.randint(1, 3)):
            document = self._random.choice(_MUTATIONS)(self._random, document)
        answer = await self._target.request(address, "POST", SOAP, document)
        expect(answer.status in (200, 202, 400, 413, 500), f"{server}: {document[-600:]!r} gets {answer.status}")
        expect("internal error" not in answer.text, f"{server}: {document[-1500:]!r} is an internal error")

    async def request(self) -> None:
        """Send a request to the API with numbers and texts that hardly make sense."""
        if self._random.random() < 0.5:
            path, value = self._random.choice(PATHS), None
        else:
            path, pattern = self._random.choice(WRITES)
            value = {name: self._value() if self._random.random() < 0.5 else usual for name, usual in pattern.items()}
        while "{n}" in path or "{t}" in path:
            path = path.replace("{n}", self._random.choice(NUMBERS), 1).replace("{t}", self._quoted(), 1)
        method, body = ("GET", b"") if value is None else ("POST", _written(value))
        answer = await self._target.request(self._target.api, method, JSON, body, path=path.encode().decode("latin-1"))
        expect(
            200 <= answer.status < 500 or answer.status == 503,
            f"{method} {path[:200]} {body[:300]!r} gets {answer.status} {answer.text[:300]}",
        )

    def _quoted(self) -> str:
        text = self._random.choice(TEXTS)
        return "".join(f"%{byte:02x}" for byte in text.encode()) if len(text) < 1000 else text

    def _value(self) -> object:
        kind = self._random.randrange(6)
        if kind == 0:
            return _Literal(self._random.choice([number for number in NUMBERS if re.fullmatch(r"-?\d+(\.\d+)?(e\d+)?", number, re.ASCII)]))
        if kind == 1:
            return self._random.choice(TEXTS)
        return self._random.choice((None, True, [], {}, [[]], {"a": 1}, [None] * 1000))


class _Literal(str):
    """A number in JSON, as it is written."""


def _written(value: dict[str, object]) -> bytes:
    fields = (f"{json.dumps(name)}: {entry if isinstance(entry, _Literal) else json.dumps(entry)}" for name, entry in value.items())
    return f"{{{', '.join(fields)}}}".encode()


def _flip(draw: random.Random, document: bytes) -> bytes:
    place = draw.randrange(len(document) or 1)
    return document[:place] + bytes([draw.randrange(256)]) + document[place + 1 :]


def _cut(draw: random.Random, document: bytes) -> bytes:
    return document[: draw.randrange(len(document) or 1)]


def _repeat_element(draw: random.Random, document: bytes) -> bytes:
    elements = re.findall(rb"<m:\w+>[^<]*</m:\w+>", document) or [b"<m:X/>"]
    element = draw.choice(elements)
    return document.replace(element, element * draw.randint(2, 50), 1)


def _drop_element(draw: random.Random, document: bytes) -> bytes:
    elements = re.findall(rb"<(?:m|wsa):\w+>[^<]*</(?:m|wsa):\w+>", document)
    return document.replace(draw.choice(elements), b"", 1) if elements else document


def _new_text(draw: random.Random, document: bytes) -> bytes:
    places = [*re.finditer(rb">([^<]+)<", document)]
    if not places:
        return document
    place, text = draw.choice(places), draw.choice((*TEXTS, *NUMBERS)).replace("&", "&amp;").replace("<", "&lt;")
    return document[: place.start(1)] + text.encode() + document[place.end(1) :]


def _rename(draw: random.Random, document: bytes) -> bytes:
    names = sorted(set(re.findall(rb"m:(\w+)", document)))
    return document.replace(b"m:" + draw.choice(names), b"m:" + draw.choice(names)) if names else document


_MUTATIONS: tuple[Callable[[random.Random, bytes], bytes], ...] = (
    _flip,
    _cut,
    _repeat_element,
    _drop_element,
    _new_text,
    _new_text,
    _rename,
)
