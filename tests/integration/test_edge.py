"""What the page of another site has a browser send is refused, and what programs and own pages send is served."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from starlette.responses import PlainTextResponse

from somrs.api.edge import Edge
from somrs.api.remote import LiveApi
from tests.integration.test_api_remote import Program, run_scenario
from tests.support.small_system import SmallSystem

TASK = '{"effect": "Jar002 isOn Platform001"}'
JSON = {"Content-Type": "application/json"}
ELSEWHERE = "http://evil.example"


def test_no_other_site_changes_or_follows_anything(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        host, port = urlsplit(api.client.url).hostname, urlsplit(api.client.url).port
        attacks: list[tuple[str, Mapping[str, str], int]] = [
            ("a page elsewhere", {**JSON, "Origin": ELSEWHERE}, 403),
            ("a page without an origin", {**JSON, "Origin": "null"}, 403),
            ("a page of another server of this computer", {**JSON, "Origin": f"http://{host}:{(port or 0) + 1}"}, 403),
            ("a page of this computer's usual server", {**JSON, "Origin": f"http://{host}"}, 403),
            ("a page whose address begins with this one", {**JSON, "Origin": f"http://{host}:{port}.evil.example"}, 403),
            ("a broken origin", {**JSON, "Origin": "http://[::1"}, 403),
            ("a browser that does not say which page", {**JSON, "Sec-Fetch-Site": "cross-site"}, 403),
            ("a page of another port", {**JSON, "Sec-Fetch-Site": "same-site"}, 403),
            ("another name for this address", {**JSON, "Host": f"evil.example:{port}"}, 403),
            (
                "the same, with the origin that belongs to it",
                {**JSON, "Host": f"evil.example:{port}", "Origin": f"{ELSEWHERE}:{port}"},
                403,
            ),
            ("a name that begins like an address", {**JSON, "Host": f"127.0.0.1.evil.example:{port}"}, 403),
            ("a form", {"Content-Type": "application/x-www-form-urlencoded"}, 415),
            ("text", {"Content-Type": "text/plain"}, 415),
            ("nothing said", {}, 415),
        ]
        async with httpx.AsyncClient(base_url=api.client.url) as client:
            for attacker, headers, code in attacks:
                answer = await client.post("/tasks", content=TASK, headers=headers)
                assert (answer.status_code, answer.headers["content-type"]) == (code, "application/json"), attacker
                assert answer.json()["problem"], attacker
            for attacker, headers, code in attacks:
                if code == 403:
                    assert await socket_status(api.client.url, headers) == 403, attacker
            rebound_answer = await client.get("/map", headers={"Host": f"evil.example:{port}"})
            assert rebound_answer.status_code == 403
            assert "Jar002" not in rebound_answer.text
            assert (await client.get("/tasks")).json()["rows"] == [], "nothing was obeyed"

    run_scenario(tmp_path / "data", scenario)


async def socket_status(url: str, headers: Mapping[str, str]) -> int:
    """The status with which the server answers who wants to follow the news; 101 if it is let in."""
    parts = urlsplit(url)
    reader, writer = await asyncio.open_connection(parts.hostname, parts.port)
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "c2l4dGVlbiBieXRlcyBoZQ==",
    }
    lines = [f"{name}: {value}" for name, value in {"Host": parts.netloc, **upgrade, **headers}.items()]
    writer.write("\r\n".join([f"GET {parts.path}/live HTTP/1.1", *lines, "", ""]).encode())
    try:
        return int((await reader.readline()).split()[1])
    finally:
        writer.close()


def test_programs_and_own_pages_are_served_under_all_names_of_the_server(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, program: Program, api: LiveApi) -> None:
        port = urlsplit(api.client.url).port
        async with httpx.AsyncClient(base_url=api.client.url) as client:
            for name in ("127.0.0.1", "localhost", "LOCALHOST.", "[::1]", "192.0.2.7", socket.gethostname()):
                own_host = {"Host": f"{name}:{port}"}
                for headers in (own_host, {**own_host, "Origin": f"http://{name}:{port}", "Sec-Fetch-Site": "same-origin"}):
                    answer = await client.post(
                        "/formulas/check", content='{"text": "Jar002 isOn Platform001"}', headers={**JSON, **headers}
                    )
                    assert answer.status_code == 200, (headers, answer.text)
                    assert await socket_status(api.client.url, headers) == 101, headers
            checked = await client.post(
                "/formulas/check", content='{"text": ""}', headers={"Content-Type": "Application/JSON; charset=utf-8"}
            )
            assert checked.status_code == 200
            assert "frame-ancestors 'none'" in checked.headers["content-security-policy"]
            assert "access-control-allow-origin" not in checked.headers
            broken_answer = await client.post("/tasks", content=b'{"effect": "\xff\xfe"}', headers=JSON)
            assert broken_answer.status_code == 400
            assert broken_answer.json()["problem"].startswith("the body: ")

    run_scenario(tmp_path / "data", scenario)


@pytest.mark.parametrize(
    ("host", "origin", "status"),
    [
        ("robots.example", "https://robots.example", 200),
        ("robots.example:8443", "https://robots.example:8443", 200),
        ("robots.example", "https://robots.example:8443", 403),
        ("other.example", "https://other.example", 403),
    ],
)
def test_a_name_that_is_allowed_is_one_of_the_server(host: str, origin: str, status: int) -> None:
    edge = Edge(PlainTextResponse("served"), ["Robots.Example"])

    async def post() -> int:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(edge), base_url="http://127.0.0.1") as client:
            return (await client.post("/", headers={"Host": host, "Origin": origin})).status_code

    assert asyncio.run(post()) == status
