"""When a program of a system is ready, and what is said of one that is not."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.access.rights import PersonRole
from somrs.access.store import AccessStore
from somrs.deployment import program as programs
from somrs.deployment.launcher import Process
from somrs.deployment.program import Program
from somrs.deployment.system import System
from somrs.errors import UsageError
from somrs.storage.audit_log import AuditLog


def program(folder: Path) -> Program:
    log = folder / "repository.log"
    log.write_text("of the run before\n", encoding="utf-8")
    return Program("repository", [], Process(1, asyncio.StreamReader()), log, folder / "repository.beat")


def test_a_program_that_takes_long_is_waited_for_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def run() -> None:
        slow = program(tmp_path)
        waiting = asyncio.create_task(slow.ready())
        while len(caplog.messages) < 2:
            await asyncio.sleep(0)
        with slow.log.open("a", encoding="utf-8") as log:
            log.write("the bus cannot be reached\n")
        while "the bus cannot" not in caplog.messages[-1]:
            await asyncio.sleep(0)
        slow.process.stdout.feed_data(b'{"ready": "repository", "at": "http://127.0.0.1:8000"}\n')
        await waiting
        assert slow.address == "http://127.0.0.1:8000"

    monkeypatch.setattr(programs, "PATIENCE", 0.001)
    asyncio.run(run())
    place = f"its log is {tmp_path / 'repository.log'}"
    assert [*dict.fromkeys(caplog.messages)] == [
        f"repository is not ready yet; {place}",
        f"repository is not ready yet: the bus cannot be reached; {place}",
    ]


@pytest.mark.parametrize(("output", "expected_text"), [("no disk\n", "no disk"), ("", "repository ended at once; see {log}")])
def test_a_program_that_ends_before_it_is_ready_says_why(tmp_path: Path, output: str, expected_text: str) -> None:
    async def run() -> None:
        ends = program(tmp_path)
        waiting = asyncio.create_task(ends.ready())
        await asyncio.sleep(0)
        with ends.log.open("a", encoding="utf-8") as log:
            log.write(output)
        ends.process.stdout.feed_eof()
        ends.process.ended(2)
        with pytest.raises(UsageError) as refused:
            await waiting
        assert str(refused.value) == expected_text.format(log=ends.log)

    asyncio.run(run())


def test_what_begins_anew_keeps_who_has_access_and_who_did_what(tmp_path: Path) -> None:
    store = AccessStore(tmp_path)
    store.add_account("Ada", PersonRole.ADMINISTRATOR)
    entries = [*AuditLog(tmp_path).entries()]
    (tmp_path / "repository.sqlite").touch()
    (tmp_path / "logs").mkdir()
    asyncio.run(System([tmp_path / "site.yaml"], tmp_path).discard())
    assert not (tmp_path / "repository.sqlite").exists()
    assert not (tmp_path / "logs").exists()
    assert [*AuditLog(tmp_path).entries()] == entries
    assert AuditLog(tmp_path).verify().entries == len(entries)
    assert "Ada" in AccessStore(tmp_path).read().accounts
