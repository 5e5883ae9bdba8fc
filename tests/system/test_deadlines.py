"""Deadlines in a whole system, which are in the world's time: that of the simulator, however fast it is."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from tests.system.test_modes import hall, set_mode
from tests.system.test_system import running

pytestmark = pytest.mark.long


@pytest.mark.parametrize(("speed", "deadline"), [("8", 80.0), ("0.25", 2.0), ("max", 5.0)])
def test_a_task_that_waits_fails_when_its_deadline_is_over_in_the_simulated_world(tmp_path: Path, speed: str, deadline: float) -> None:
    site = tmp_path / "hall.yaml"
    site.write_text(hall(), "utf-8")

    async def test() -> None:
        async with running(tmp_path / "data", site, world=WorldKind.KINEMATIC, speed=speed) as (_, client, operator):
            await set_mode(client, "Fire")  # so that nobody moves
            submitted_at = (await operator.clock()).time
            task = await client.submit(Submit(effect="Robot4 isAt East4", deadline=deadline))
            views = [news.view async for news in client.news(task)]
            if speed != "max":  # it says when that is by the wall's clock, as it was reckoned on a machine that may be busy
                expected_seconds = deadline / float(speed)
                announced_seconds = [view.due_at - view.submitted_at for view in views if view.due_at is not None]
                assert any(expected_seconds / 2 < seconds < 2 * expected_seconds for seconds in announced_seconds)
            last = views[-1]
            assert last.outcome is Outcome.FAILED
            assert f"the deadline of {deadline:g} s is over" in last.reasons
            if speed != "max":  # then the simulated time stands still, as nothing moves
                passed = (await operator.clock()).time - submitted_at
                assert 0.9 * deadline < passed < 3 * deadline

    asyncio.run(test())
