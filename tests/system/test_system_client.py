"""The client of a running system, as programs have it, against a whole system."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path

import pytest

import somrs
from somrs import Client
from somrs.access.store import local_token
from somrs.client.addresses import Addresses
from somrs.errors import UsageError
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.task_views import Phase
from tests.support.paths import ROOT, SCENARIO_1
from tests.system.test_system import running


def test_a_task_is_submitted_watched_and_seen_on_the_map(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with running(tmp_path, SCENARIO_1), Client(tmp_path) as system:
            assert (await system.plan("Jar002 isOn Platform001")).steps[0].service_type == "TransferObject"
            news = system.follow("map", "tasks")
            await anext(news)  # from now on nothing is missed
            task = await system.submit("Jar002 isOn Platform001", idempotency_key="once")
            assert await system.submit("Jar002 isOn Platform001", idempotency_key="once") == task
            async for item in news:
                if item.topic == "tasks":
                    break
            views = [view async for view in system.watch(task)]
            assert [view.phase for view in views][-1] is Phase.ENDED
            assert views[-1].outcome is Outcome.ACCOMPLISHED
            assert {Phase.ARRANGING, Phase.EXECUTING} & {view.phase for view in views}
            assert [view.outcome async for view in system.watch(task)] == [Outcome.ACCOMPLISHED], "one that is over is seen once"
            assert await system.query("?Thing isOn Platform001") == [{"Thing": "Jar002"}]
            assert await system.query("Jar002 isOn Platform001") == [{}]
            assert await system.query("Jar003 isOn Platform001") == []
            assert [row.task for row in await system.tasks()] == [task]
            assert await system.tasks(running=True) == ()
            with pytest.raises(UsageError, match="there is no topic tusks; the topics are map, "):
                await anext(system.follow("tusks"))
            with pytest.raises(somrs.errors.InputError, match="there is no relation isOm"):
                await system.submit("Jar002 isOm Platform001")
            other = await system.submit("Jar003 isOn Table001")
            await system.cancel(other)
            assert [view.outcome async for view in system.watch(other)][-1] is Outcome.CANCELLED

            url = Addresses.read(tmp_path).api
            assert url is not None
            async with Client(url, token=local_token(tmp_path)) as by_url:
                assert len(await by_url.tasks()) == 2

    asyncio.run(scenario())


def test_the_example_of_ten_lines(tmp_path: Path) -> None:
    async def scenario() -> str:
        async with running(tmp_path / ".somrs", SCENARIO_1):
            program = await asyncio.create_subprocess_exec(
                sys.executable, str(ROOT / "examples" / "ten_line_client.py"), cwd=tmp_path, stdout=subprocess.PIPE
            )
            output, _ = await program.communicate()
            assert program.returncode == 0
            return output.decode()

    lines = asyncio.run(scenario()).splitlines()
    assert any("executing" in line and "TransferObject: Executing" in line for line in lines)
    assert lines[-1].startswith("accomplished")
    assert "{'Thing': 'Jar002'}" in lines[-1]


def test_without_a_system_it_is_said_how_to_start_one(tmp_path: Path) -> None:
    async def connect() -> None:
        async with Client(tmp_path):
            pass

    with pytest.raises(UsageError, match="Start one with `somrs up SITE`"):
        asyncio.run(connect())


def test_the_public_names_are_there_and_no_others() -> None:
    assert all(getattr(somrs, name) is not None for name in somrs.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'Clyent'"):
        somrs.Clyent  # noqa: B018


def test_the_documentation_shows_the_example_as_it_is() -> None:
    example = (ROOT / "examples" / "ten_line_client.py").read_text().partition('"""\n\n')[2]
    for page in ("README.md", "docs/tutorials/ten-line-client.md"):
        assert f"```python\n{example}```" in (ROOT / page).read_text(), page
