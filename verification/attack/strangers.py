"""Attacks of people and programs without access, or with less than they use."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping

from somrs.access.rights import Right
from somrs.access.store import FILE, LOCAL_FILE, AccessStore
from verification.attack.target import JSON, Target, expect

READS = ("/api/tasks", "/api/map", "/api/openapi.json", "/api/access", "/api/live", "/api/poses", "/api/", "/map", "/access", "/nothing")
UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": base64.b64encode(b"x" * 16).decode(),
}
GUESSES = ("", "x", "null", "None", "0" * 64, "A" * 10_000, "\x00", "é", "' OR 1=1 --", "../local.token")


def secrets_of_nobody(target: Target) -> list[Mapping[str, str]]:
    """Headers that prove nothing: guesses, hashes out of the stolen file, ended tokens, and the form of other schemes."""
    data = target.system.data
    store = AccessStore(data)
    expired_token = store.add_token("expired", frozenset(Right), -1.0)
    revoked_token = store.add_token("revoked", frozenset(Right), 600.0)
    hashes = list(json.loads((data / FILE).read_text())["tokens"])
    store.remove_token("revoked")
    secrets = [*GUESSES, *hashes, expired_token, revoked_token]
    cookie = store.read().cookie
    local = (data / LOCAL_FILE).read_text()
    return [
        *({"Authorization": f"Bearer {secret}"} for secret in secrets),
        *({"Cookie": f"{cookie}={secret}"} for secret in secrets),
        {"Authorization": f"Basic {base64.b64encode(f'x:{local}'.encode()).decode()}"},
        {"Authorization": f"Bearer {local[:-1]}"},
        {"Authorization": "Bearer"},
        {"X-Forwarded-For": "127.0.0.1", "X-Forwarded-User": "admin", "Forwarded": "for=127.0.0.1"},
    ]


async def strangers_see_nothing(target: Target) -> None:
    for server, url in target.web.items():
        for headers in secrets_of_nobody(target):
            kind = str(dict(headers))[:60]
            for path in READS:
                upgrade = UPGRADE if path in ("/api/live", "/api/poses") else {}
                answer = await target.send_as({**headers, **upgrade}, url, path=path)
                # The API's server has no pages: outside /api there is nothing, for anybody.
                refusals = {400, 401, 431, 303 if server == "windows" else 404 if not path.startswith("/api") else 401}
                expect(answer.status in refusals, f"{server}: {kind} gets {path}: {answer.status}")
            body = json.dumps({"effect": "Jar002 isOn Platform001"}).encode()
            answer = await target.send_as({**JSON, **headers}, url, "POST", body, path="/api/tasks")
            expect(answer.status in (400, 401), f"{server}: {kind} submits a task: {answer.status}")
    expect(not (await target.client.rows()).items, "a stranger has submitted a task")


async def viewers_change_nothing(target: Target) -> None:
    store = AccessStore(target.system.data)
    token = {"Authorization": f"Bearer {store.add_token('viewer', frozenset({Right.SEE}), 600.0)}"}
    openapi = json.loads((await target.request(target.api, path="/api/openapi.json")).content)
    for path, methods in openapi["paths"].items():
        for method, described in methods.items():
            needs_more = "Needs the right `see`" not in described["description"]
            real_path = f"/api{path}".replace("{", "").replace("}", "")
            answer = await target.send_as({**JSON, **token}, target.api, method.upper(), b"{}", path=real_path)
            expect(answer.status == 403 or not needs_more, f"a viewer may {method} {path}: {answer.status}")
    store.remove_token("viewer")


async def no_file_tells_a_secret(target: Target) -> None:
    data = target.system.data
    expect(data.stat().st_mode & 0o077 == 0, "others may enter the data folder")
    for name in (FILE, LOCAL_FILE):
        expect((data / name).stat().st_mode & 0o077 == 0, f"others may read {name}")
    store = AccessStore(data)
    secret = store.add_token("told", frozenset({Right.SEE}), 600.0)
    await target.send_as({"Authorization": f"Bearer {secret}"}, target.api, path="/api/access/me")
    for file in data.rglob("*"):
        if file.is_file():
            expect(secret.encode() not in file.read_bytes(), f"{file.name} has the secret of a token")
    store.remove_token("told")
