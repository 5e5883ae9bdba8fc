"""What is recorded of people and programs that use the API and the windows: what they change, and what is denied to them."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path

import httpx
import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from somrs.access.auditor import Auditor
from somrs.access.passwords import hashed_password
from somrs.access.rights import PersonRole
from somrs.access.store import AccessStore, local_token
from somrs.storage import denial_counts
from somrs.storage.audit_log import FILE, Actor, AuditEntry, AuditLog
from tests.integration.test_access import bearer, guarded
from tests.integration.test_sign_in import PASSWORD, browser

LOOPBACK = "127.0.0.1"
MOST_DENIALS = 50


def acts(data: Path) -> list[tuple[str, str, Actor | None]]:
    return [(entry.act, entry.outcome, entry.actor) for entry in AuditLog(data).entries() if not entry.act.startswith("access.")]


def only(entries: Sequence[AuditEntry], act: str) -> AuditEntry:
    (entry,) = (entry for entry in entries if entry.act == act)
    return entry


def test_what_changes_something_is_recorded_with_who_and_what(tmp_path: Path) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url), httpx.AsyncClient(base_url=url) as client:
            store.add_account("Ada", PersonRole.ENGINEER)
            session = bearer(store.open_session("Ada", "10.0.0.7"))
            changed = await client.post("/map/changes", json={"situation": "Jar001.Weight = 0.7"}, headers=session)
            assert (await client.get("/map", headers=session)).status_code == 200
            assert (await client.post("/map/changes", json={"situation": "Jar001 is heavy"}, headers=session)).status_code == 409
            store.renew_local_token()
            local = bearer(local_token(tmp_path) or "")
            await client.post("/map/changes", json={"situation": "Jar001.Weight = 0.8", "author": "user@host"}, headers=local)
        entries = [entry for entry in AuditLog(tmp_path).entries() if entry.act == "map.change"]
        assert [entry.actor for entry in entries] == [Actor(name="Ada", address="10.0.0.7"), Actor(name="this computer", address=LOOPBACK)]
        assert [entry.outcome for entry in entries] == ["done", "done"]
        assert entries[0].details["body"]["situation"] == "Jar001.Weight = 0.7"
        assert entries[0].details["body"]["author"] == "Ada"
        assert entries[0].details["result"]["version"] == changed.json()["version"], "before and after are in the map's history there"
        assert entries[1].details["body"]["author"] == "user@host"

    asyncio.run(run())


def test_what_is_denied_is_recorded(tmp_path: Path) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url), httpx.AsyncClient(base_url=url) as client:
            store.add_account("Eve", PersonRole.VIEWER)
            session = bearer(store.open_session("Eve"))
            assert (await client.post("/tasks", json={"effect": "Jar1 isOn Table1"}, headers=session)).status_code == 403
            assert (await client.get("/access", headers=session)).status_code == 403
            assert (await client.get("/map", headers=bearer("a guess"))).status_code == 401
            assert (await client.get("/map", headers={"Host": "evil.example"})).status_code == 403
            with pytest.raises(InvalidStatus):
                async with connect(url.replace("http", "ws", 1) + "/live"):
                    pass
        eve, stranger = Actor(name="Eve", address=LOOPBACK), Actor(name="", address=LOOPBACK)
        entries = [entry for entry in AuditLog(tmp_path).entries() if entry.outcome == "denied"]
        assert [(entry.act, entry.actor) for entry in entries] == [
            ("tasks.submit", eve),
            ("access.read", eve),
            ("enter", stranger),
            ("enter from another site", stranger),
        ], "the second time that the stranger tries is not the tenth yet"
        assert "does not have the right to operate" in entries[0].details["why"]
        assert entries[2].details["request"] == "GET /api/map"
        assert "this server is not evil.example" in entries[3].details["why"]

    asyncio.run(run())


def test_signing_in_and_who_has_access_are_recorded(tmp_path: Path) -> None:
    async def run() -> None:
        store = AccessStore(tmp_path)
        store.add_account("Ada", PersonRole.ADMINISTRATOR, hashed_password(PASSWORD))
        async with browser(store) as client:
            await client.post("/sign-in", data={"name": "Ada", "password": "wrong"})
            await client.post("/sign-in", data={"name": "Ada", "password": PASSWORD})
            await client.post("/sign-out")
        link = store.add_link("Ada")
        async with browser(store, address="10.0.0.2") as client:
            await client.get(f"/sign-in?link={link}")
            await client.get(f"/sign-in?link={link}")
        entries = [*AuditLog(tmp_path).entries()]
        signed_in = [entry for entry in entries if entry.act == "access.sign_in"]
        assert [(entry.outcome, entry.actor) for entry in signed_in] == [
            ("denied", Actor(name="", address="10.0.0.1")),
            ("done", Actor(name="Ada", address="10.0.0.1")),
            ("done", Actor(name="Ada", address="10.0.0.2")),
        ]
        assert signed_in[0].details == {"name": "Ada", "why": "a wrong name or password"}
        assert only(entries, "access.end_session").actor == Actor(name="Ada", address="10.0.0.1")
        document = b"".join(file.read_bytes() for file in tmp_path.glob(f"{FILE}*"))
        assert PASSWORD.encode() not in document
        assert link.encode() not in document

    asyncio.run(run())


def test_a_role_is_recorded_as_it_was_and_as_it_is(tmp_path: Path) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url), httpx.AsyncClient(base_url=url) as client:
            store.add_account("Root", PersonRole.ADMINISTRATOR)
            root = bearer(store.open_session("Root", "10.0.0.9"))
            store.add_account("Ada", PersonRole.VIEWER)
            assert (await client.post("/access/people/Ada/role", params={"role": "engineer"}, headers=root)).status_code == 200
            token = await client.post("/access/tokens", json={"name": "Keeper", "rights": ["see"]}, headers=root)
            entries = (await client.get("/access/audit", headers=root)).json()["entries"]
        by_act = {entry["act"]: entry for entry in entries}
        change = by_act["access.set_role"]
        assert change["actor"] == {"name": "Root", "address": "10.0.0.9"}
        assert change["details"] == {"name": "Ada", "before": "viewer", "after": "engineer"}
        assert by_act["access.add_token"]["details"]["name"] == "Keeper"
        assert token.json()["secret"] not in str(entries)
        assert [entry["number"] for entry in entries] == sorted((entry["number"] for entry in entries), reverse=True)

    asyncio.run(run())


def test_passwords_are_not_recorded(tmp_path: Path) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url), httpx.AsyncClient(base_url=url) as client:
            store.add_account("Ada", PersonRole.VIEWER)
            session = bearer(store.open_session("Ada"))
            for current in ("", "not the current one"):
                await client.post("/access/me/password", json={"password": PASSWORD, "current": current}, headers=session)
        entries = [*AuditLog(tmp_path).entries()]
        assert only(entries, "access.set_password").outcome == "done"
        assert only(entries, "access.set_own_password").outcome == "denied"
        assert PASSWORD.encode() not in (tmp_path / FILE).read_bytes()

    asyncio.run(run())


def test_a_task_and_a_stop_are_recorded(tmp_path: Path) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url), httpx.AsyncClient(base_url=url) as client:
            store.add_account("Ada", PersonRole.OPERATOR)
            session = bearer(store.open_session("Ada"))
            submitted = await client.post("/tasks", json={"effect": "Jar001 isOn Platform001"}, headers=session)
            task = submitted.json()["task"]
            await client.post(f"/tasks/{task}/cancel", headers=session)
        ada = Actor(name="Ada", address=LOOPBACK)
        assert [act for act in acts(tmp_path) if act[0].startswith("tasks.")] == [
            ("tasks.submit", "done", ada),
            ("tasks.cancel", "done", ada),
        ]
        entry = only([*AuditLog(tmp_path).entries()], "tasks.submit")
        assert entry.details["result"]["task"] == task

    asyncio.run(run())


def test_who_tries_in_vain_does_not_fill_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(denial_counts, "MOST_DENIALS", MOST_DENIALS)
    auditor = Auditor(tmp_path)
    for _ in range(1500):
        auditor.denied("tasks.submit", Actor(name="Eve", address="10.0.0.1"), "no right")
    assert [entry.details.get("times", 1) for entry in auditor.log.entries()] == [1, 10, 100, 1000]
    for number in range(MOST_DENIALS + 10):
        auditor.denied("enter", Actor(name="", address=f"10.0.{number}.1"), "no valid secret")
    assert auditor.log.verify().entries == 4 + MOST_DENIALS + 10


def test_long_details_are_cut(tmp_path: Path) -> None:
    auditor = Auditor(tmp_path)
    auditor.done("map.change", Actor(name="Ada"), {"body": {"changes": ["x" * 100] * 1000}})
    (entry,) = auditor.log.entries()
    assert entry.details["bytes"] > 100_000
    assert len(entry.details["begins"]) == 4000


def test_a_log_that_cannot_be_written_keeps_nobody_from_working(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def run() -> None:
        async with guarded(tmp_path) as (store, url), httpx.AsyncClient(base_url=url) as client:
            store.add_account("Ada", PersonRole.ENGINEER)
            session = bearer(store.open_session("Ada"))
            for file in tmp_path.glob(f"{FILE}*"):
                file.unlink()
            (tmp_path / FILE).mkdir()
            changed = await client.post("/map/changes", json={"situation": "Jar001.Weight = 0.7"}, headers=session)
            assert changed.status_code == 200
        assert "not in the audit log: map.change, done, by Ada" in caplog.text

    asyncio.run(run())
