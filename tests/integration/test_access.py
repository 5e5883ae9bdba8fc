"""Who may do what at the API: every operation by everybody, and what ends at once when access ends."""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import get_type_hints

import httpx
import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from somrs.access.rights import PersonRole, Right
from somrs.access.state import AccessState
from somrs.access.store import AccessStore, local_token
from somrs.api.remote import Api
from somrs.api.rest import AUTHOR_NAMES
from somrs.client.operations import Operation, operations
from somrs.trust.authority import Authority
from tests.support.hang import HANG_TIME
from tests.support.small_system import running

OPERATIONS: list[Operation] = [operation for group, declared in get_type_hints(Api).items() for operation in operations(group, declared)]
DAY = 86400.0
"""[s] The life of a token that is not to end while the slowest of machines asks for everything."""


@asynccontextmanager
async def guarded(data: Path) -> AsyncIterator[tuple[AccessStore, str]]:
    store = AccessStore(data)
    async with running(data, access=store) as (_, api):
        yield store, api.client.url


def bearer(secret: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {secret}"} if secret else {}


async def attempt(client: httpx.AsyncClient, operation: Operation, secret: str) -> int:
    """The status of a request that does nothing if it is let in: its parameters are wrong."""
    path = re.sub(r"{\w+}", "7", operation.path)
    headers = bearer(secret)
    response = await client.request(operation.method, path, params={"no-such-parameter": "1"}, headers=headers)
    if response.status_code in (401, 403):
        assert response.json()["problem"]
    return response.status_code


def test_every_operation_by_everybody(tmp_path: Path) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url), httpx.AsyncClient(base_url=url) as client:
            rights: dict[str, frozenset[Right]] = {"": frozenset(), "a guess": frozenset()}
            for role in PersonRole:
                store.add_account(f"a person who is {role}", role)
                rights[store.open_session(f"a person who is {role}")] = role.rights
            for right in Right:
                rights[store.add_token(f"only {right}", frozenset({right}), DAY)] = frozenset({right})
            rights[store.add_token("expired", frozenset(Right), -1.0)] = frozenset()
            store.add_account("Removed", PersonRole.ADMINISTRATOR)
            rights[store.open_session("Removed")] = frozenset()
            store.remove_account("Removed")
            store.add_account("Demoted", PersonRole.ADMINISTRATOR)
            rights[store.open_session("Demoted")] = PersonRole.VIEWER.rights
            store.set_role("Demoted", PersonRole.VIEWER)
            store.renew_local_token()
            rights[local_token(tmp_path) or ""] = frozenset()
            store.renew_local_token()
            rights[local_token(tmp_path) or ""] = frozenset(Right)
            rights[local_token(tmp_path, only_sees=True) or ""] = frozenset({Right.SEE})
            for secret, allowed in rights.items():
                statuses = await asyncio.gather(*(attempt(client, operation, secret) for operation in OPERATIONS))
                for operation, status in zip(OPERATIONS, statuses, strict=True):
                    expected = 400 if operation.required_right in allowed else 403 if allowed else 401
                    assert status == expected, f"{operation.name} by {store.identity(secret)}"
                for document in ("/openapi.json", "/"):
                    status = (await client.get(document, headers=bearer(secret))).status_code
                    assert status == (200 if Right.SEE in allowed else 403 if allowed else 401)

    asyncio.run(run())


def test_engineers_invite_devices_and_administrators_all_and_revoke(tmp_path: Path) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url), httpx.AsyncClient(base_url=url) as client:
            store.add_account("Ada", PersonRole.ENGINEER)
            store.add_account("Root", PersonRole.ADMINISTRATOR)
            engineer, administrator = bearer(store.open_session("Ada")), bearer(store.open_session("Root"))
            assert (await client.get("/trust", headers=engineer)).json() == {"has_authority": False, "holders": [], "invitations": []}
            refused = await client.post("/trust/invitations", json={"name": "Robot7"}, headers=engineer)
            assert (refused.status_code, "has no certificate authority" in refused.json()["problem"]) == (400, True), refused.text
            Authority.of_data(tmp_path).create("site", datetime.now(UTC))
            assert (await client.post("/trust/invitations", json={"name": "Robot7"}, headers=engineer)).status_code == 200
            registry = {"name": "registry-2", "roles": ["registry"]}
            refused = await client.post("/trust/invitations", json=registry, headers=engineer)
            assert (refused.status_code, refused.json()["problem"]) == (
                403,
                "only who is administrator invites others than devices and things",
            )
            assert (await client.post("/trust/invitations", json=registry, headers=administrator)).json()["secret"]
            names = [invited["name"] for invited in (await client.get("/trust", headers=engineer)).json()["invitations"]]
            assert names == ["Robot7", "registry-2"]
            for name in names:
                assert (await client.delete(f"/trust/holders/{name}", headers=administrator)).status_code == 200
            assert not (await client.get("/trust", headers=engineer)).json()["invitations"]

    asyncio.run(run())


def test_a_refusal_says_how_to_go_on(tmp_path: Path) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url), httpx.AsyncClient(base_url=url) as client:
            unknown = await client.get("/map")
            assert "Authorization: Bearer TOKEN" in unknown.json()["problem"]
            assert unknown.headers["www-authenticate"] == "Bearer"
            store.add_account("Ada", PersonRole.VIEWER)
            refused = await client.post("/tasks", headers=bearer(store.open_session("Ada")), json={"effect": "Jar1 isOn Table1"})
            assert refused.status_code == 403
            assert "Ada does not have the right to operate, which an operator has" in refused.json()["problem"]

    asyncio.run(run())


def test_a_websocket_ends_when_access_ends(tmp_path: Path) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url):
            news = url.replace("http", "ws", 1) + "/live"
            with pytest.raises(InvalidStatus) as refused:
                async with connect(news):
                    pass
            assert refused.value.response.status_code == 401
            store.add_account("Ada", PersonRole.VIEWER)
            only_operates = store.add_token("Program", frozenset({Right.OPERATE}), DAY)
            with pytest.raises(InvalidStatus) as refused:
                async with connect(news, additional_headers=bearer(only_operates)):
                    pass
            assert refused.value.response.status_code == 403
            store.add_account("Root", PersonRole.ADMINISTRATOR)
            cookie = {"Cookie": f"{store.read().cookie}={store.open_session('Ada')}"}
            async with connect(news, additional_headers=cookie) as socket:
                await socket.send('{"follow": [], "confirm": 1}')
                assert await socket.recv() == '{"confirmed":1}'
                AccessStore(tmp_path).remove_account("Ada")  # as another program does
                with pytest.raises(ConnectionClosed) as ended:
                    await asyncio.wait_for(socket.recv(), HANG_TIME)
                assert ended.value.rcvd is not None
                assert ended.value.rcvd.code == 1008

    asyncio.run(run())


def test_the_author_is_who_has_proven_it(tmp_path: Path) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url), httpx.AsyncClient(base_url=url) as client:
            store.add_account("Ada", PersonRole.ENGINEER)
            session = bearer(store.open_session("Ada"))
            change = {"situation": "Jar001.Weight = 0.7", "author": "Mallory"}
            assert (await client.post("/map/changes", json=change, headers=session)).status_code == 200
            store.renew_local_token()
            change = {"situation": "Jar001.Weight = 0.8", "author": "user@host"}
            assert (await client.post("/map/changes", json=change, headers=bearer(local_token(tmp_path) or ""))).status_code == 200
            events = (await client.get("/map/events", headers=session)).json()["events"]
            assert [event["author"] for event in events[:2]] == ["user@host", "Ada"]

    asyncio.run(run())


def test_each_operation_that_changes_something_says_by_whom() -> None:
    """Of the others, only the audit log says by whom."""
    anonymous = {
        operation.name
        for operation in OPERATIONS
        if operation.required_right is not Right.SEE
        and not any(
            parameter.name in AUTHOR_NAMES or any(name in getattr(parameter.type, "__struct_fields__", ()) for name in AUTHOR_NAMES)
            for parameter in operation.parameters
        )
    }
    assert {name for name in anonymous if not name.startswith(("access.", "trust."))} == {
        "fleet.fault",
        "orders.remove_order",
        "orders.remove_template",
        "people.reply",
        "people.set_availability",
        "questions.answer",
        "tasks.preview",
    }


def test_times_end(tmp_path: Path) -> None:
    store = AccessStore(tmp_path)
    store.add_account("Ada", PersonRole.ADMINISTRATOR)
    session, token = store.open_session("Ada"), store.add_token("Program", frozenset({Right.SEE}), 60.0)
    state: AccessState = store.read()
    later = time.time() + 61.0
    assert state.identity(token, later) is None
    assert state.identity(session, later) is not None
    assert state.identity(session, later + 31 * 86400) is None
