"""A running system is backed up, and goes on from the backup in another folder."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.deployment.backup import back_up, restore
from somrs.deployment.supervision import keep_running
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from tests.support import warm
from tests.support.hang import HANG_TIME
from tests.support.paths import SCENARIO_1

pytestmark = pytest.mark.long


def system(data: Path) -> System:
    return System([SCENARIO_1], data, speed="8", world=WorldKind.KINEMATIC, launcher=warm.launcher())


async def is_accomplished(client: Client, task: str) -> bool:
    views = [news.view async for news in client.news(task)]
    return views[-1].outcome is Outcome.ACCOMPLISHED


def test_a_system_goes_on_from_a_backup_that_was_made_while_it_ran(tmp_path: Path) -> None:
    backup = tmp_path / "backup.tar.gz"

    async def run() -> None:
        async with asyncio.timeout(HANG_TIME):
            async with system(tmp_path / "data") as running, Client(running.addresses) as client:
                supervisor = asyncio.create_task(keep_running(running, lambda text: None))
                before = await client.submit(Submit(effect="Jar002 isOn Platform001"))
                assert await is_accomplished(client, before)
                map_before = await client.map()
                task = await client.submit(Submit(effect="Jar003 isOn Platform001"))
                await back_up(tmp_path / "data", backup)
                assert await is_accomplished(client, task), "the system goes on"
                supervisor.cancel()
            manifest = restore(backup, tmp_path / "restored")
            assert "task-manager.sqlite" in manifest.files
            async with system(tmp_path / "restored") as restored, Client(restored.addresses) as client:
                assert await is_accomplished(client, before)
                place = next(fact for fact in map_before.facts("isOn") if fact.arguments[0] == "Jar002")
                assert place in [*(await client.map()).facts("isOn")]
                assert [news.view.outcome async for news in client.news(task)][-1] is not None, "a task that was under way ends"

    asyncio.run(run())


def test_what_is_no_backup_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no system"):
        asyncio.run(back_up(tmp_path / "data", tmp_path / "backup"))
    data = tmp_path / "data"
    data.mkdir()
    (data / "repository.sqlite").write_bytes(bytes(5000))
    (data / "devices").mkdir()
    (data / "devices" / "Robot1.sqlite").write_bytes(b"Robot1" * 5000)
    backup = tmp_path / "backup"
    asyncio.run(back_up(data, backup))
    with pytest.raises(UsageError, match="is there already"):
        asyncio.run(back_up(data, backup))
    with pytest.raises(UsageError, match="is not empty"):
        restore(backup, data)
    restore(backup, tmp_path / "new")
    assert (tmp_path / "new" / "devices" / "Robot1.sqlite").read_bytes() == b"Robot1" * 5000
    assert (tmp_path / "new").stat().st_mode & 0o77 == 0
    content = backup.read_bytes()
    for damaged in (content[: len(content) // 2], content[:200] + bytes([content[200] ^ 1]) + content[201:], b"nonsense"):
        (tmp_path / "damaged").write_bytes(damaged)
        with pytest.raises(UsageError, match="is no backup, or is damaged"):
            restore(tmp_path / "damaged", tmp_path / "another")
        assert not (tmp_path / "another").exists()
