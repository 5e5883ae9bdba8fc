"""What pages of other sites have browsers send, and what crafted paths ask for."""

from __future__ import annotations

from verification.attack.target import JSON, Target, expect

TASK = b'{"effect": "Jar002 isOn Platform001"}'
ELSEWHERE = "http://evil.example"

UPGRADE = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "c2l4dGVlbiBieXRlcyBoZQ=="}

PATHS = (
    "/../../../../etc/passwd",
    "/api/page/../../../../etc/passwd",
    "/api/page/..%2f..%2f..%2f..%2fetc%2fpasswd",
    "/api/page/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
    "/api/page//etc/passwd",
    "/api/page/%00",
    "/api/page/..\\..\\etc\\passwd",
    "//etc/passwd",
    "/%2e%2e/%2e%2e/etc/passwd",
    "/_nicegui/3.0.0/static/../../../../../../etc/passwd",
    "/static/..%2f..%2fgui.secret",
    "/api/../gui.secret",
    "http://evil.example/",
    "*",
    "evil.example:80",
)
"""What a server must not open, or follow, or stumble over."""


def origins(netloc: str) -> dict[str, dict[str, str]]:
    """Headers of requests that pages elsewhere have browsers send."""
    port = netloc.rpartition(":")[2]
    return {
        "another origin": {"Origin": ELSEWHERE},
        "no origin": {"Origin": "null"},
        "another port": {"Origin": "http://127.0.0.1:1"},
        "a longer name": {"Origin": f"http://{netloc}.evil.example"},
        "user and name": {"Origin": f"http://{netloc}@evil.example"},
        "a broken origin": {"Origin": "http://[::1"},
        "cross-site": {"Sec-Fetch-Site": "cross-site"},
        "same-site": {"Sec-Fetch-Site": "same-site"},
        "a rebound name": {"Host": f"evil.example:{port}"},
        "a rebound name and its origin": {"Host": f"evil.example:{port}", "Origin": f"{ELSEWHERE}:{port}"},
        "a name like an address": {"Host": f"127.0.0.1.evil.example:{port}"},
        "an empty name": {"Host": ""},
    }


async def other_sites_change_nothing(target: Target) -> None:
    for server, url in target.web.items():
        netloc = url.split("//")[1].split("/")[0]
        for kind, headers in origins(netloc).items():
            answer = await target.request(url, "POST", {**JSON, **headers}, TASK, path="/api/tasks")
            expect(answer.status in (400, 403), f"{server}: {kind} gets {answer.status} {answer.text[:100]}")
            for path in ("/api/live", "/api/poses", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"):
                answer = await target.request(url, "GET", {**UPGRADE, **headers}, path=path)
                expect(answer.status in (0, 400, 403), f"{server}: {kind} may follow {path}: {answer.status}")
    expect(not (await target.client.rows()).items, "a page elsewhere has submitted a task")


async def forms_change_nothing(target: Target) -> None:
    kinds = (
        "application/x-www-form-urlencoded",
        "text/plain",
        "multipart/form-data; boundary=x",
        "application/xml",
        "",
        "application/jsonx",
    )
    for server, url in target.web.items():
        for kind in kinds:
            answer = await target.request(url, "POST", {"Content-Type": kind}, TASK, path="/api/tasks")
            expect(answer.status == 415, f"{server}: a body of type {kind!r} gets {answer.status}")


async def pages_stay_in_their_frames(target: Target) -> None:
    for server, url in target.web.items():
        for path in ("/", "/api/", "/api/tasks", "/nothing", "/api/nothing"):
            headers = (await target.request(url, path=path)).headers
            expect("frame-ancestors 'none'" in headers.get("content-security-policy", ""), f"{server}: {path} may be framed")
            expect(headers.get("x-content-type-options") == "nosniff", f"{server}: {path} may be sniffed")
            expect("access-control-allow-origin" not in headers, f"{server}: {path} may be read by other sites")


async def paths_lead_nowhere(target: Target) -> None:
    for server, url in {**target.web, **target.soap}.items():
        for path in PATHS:
            for method in ("GET", "HEAD", "OPTIONS", "TRACE", "PUT", "DELETE"):
                async with target.connection(url) as line:
                    host = url.split("//")[1].split("/")[0]
                    await line.send(f"{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
                    content = await line.end()
                expect(b"root:" not in content, f"{server}: {method} {path} gets a file")
                expect(b" 500 " not in content.split(b"\r\n")[0], f"{server}: {method} {path} gets {content[:200]!r}")
                expect(b"evil.example" not in content.split(b"\r\n\r\n")[0], f"{server}: {method} {path} leads elsewhere")
