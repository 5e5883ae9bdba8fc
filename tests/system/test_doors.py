"""A whole system with the simulator, on the site of scenario 3: a door that is shut, and a cupboard with doors. Where somebody shuts one in
front of a robot, the world has physics, in which robots take their time."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from tests.support.accomplishing import accomplish
from tests.support.paths import ROOT
from tests.system.test_system import running

pytestmark = pytest.mark.long

SCENARIO_3 = ROOT / "src" / "somrs" / "demo" / "data" / "scenario-3.yaml"


def _powered(folder: Path) -> Path:
    """The site with a door that has a drive."""
    site = folder / "powered.yaml"
    site.write_text(SCENARIO_3.read_text("utf-8").replace("Door001: {type: Door,", "Door001: {type: PoweredDoor, Price: 1 EUR,"), "utf-8")
    return site


@pytest.mark.parametrize(("powered", "opener"), [(False, "Robot1"), (True, "Door001")], ids=["by hand", "by its drive"])
def test_what_is_behind_a_shut_door_is_reached(tmp_path: Path, powered: bool, opener: str) -> None:
    async def test() -> None:
        async with running(tmp_path / "data", _powered(tmp_path) if powered else SCENARIO_3, world=WorldKind.KINEMATIC) as (
            _,
            client,
            operator,
        ):
            view = await accomplish(client, "Carton001 isOn Shelf001")
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert [step.service for step in view.steps] == [f"{opener}.OpenDoor", "Robot1.TransferObject"]
            assert (await operator.observe("Carton001")).support == "Shelf001"

    asyncio.run(test())


def test_a_jar_is_put_into_a_shut_cupboard_and_another_taken_out(tmp_path: Path) -> None:
    async def test() -> None:
        async with running(tmp_path / "data", SCENARIO_3, world=WorldKind.KINEMATIC) as (_, client, operator):
            view = await accomplish(client, "Jar002 isIn Cupboard002 AND Cupboard002.Open = FALSE")
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert (await operator.observe("Jar002")).container == "Cupboard002"
            assert (await operator.observe("Cupboard002")).open is False
            view = await accomplish(client, "Jar005 isOn Table001")
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert (await operator.observe("Jar005")).support == "Table001"

    asyncio.run(test())


async def _ended(client: Client, task: str) -> tuple[TaskView, list[str]]:
    """The view of a task when it has ended, and the sentences about its events."""
    news = [news async for news in client.news(task)]
    return news[-1].view, [event.text for entry in news for event in entry.events]


def test_a_cupboard_that_somebody_shuts_stops_the_robot_that_puts_something_in(tmp_path: Path) -> None:
    async def test() -> None:
        async with running(tmp_path / "data", SCENARIO_3) as (_, client, operator):
            await client.report(UpdateMap(situation="Cupboard002.Open = TRUE"))
            submitted = await client.submit(Submit(effect="Jar002 isIn Cupboard002"))
            while (await operator.robots())["Robot1"].holding is None:
                await asyncio.sleep(0.01)
            await client.report(UpdateMap(situation="Cupboard002.Open = FALSE"))
            view, sentences = await _ended(client, submitted)
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert any("Cupboard002.Open = TRUE does not hold any more" in sentence for sentence in sentences)
            assert (await operator.observe("Jar002")).container == "Cupboard002"

    asyncio.run(test())


@pytest.mark.parametrize("carrying", [False, True], ids=["on the way to the carton", "on the way to the door"])
def test_a_door_that_somebody_shuts_stops_the_robot_that_needs_it_at_once(tmp_path: Path, carrying: bool) -> None:
    async def test() -> None:
        site = tmp_path / "open.yaml"
        site.write_text(
            SCENARIO_3.read_text("utf-8").replace("Depth: 1.4, Height: 2.1}, Open: false", "Depth: 1.4, Height: 2.1}, Open: true")
        )
        async with running(tmp_path / "data", site) as (_, client, operator):
            submitted = await client.submit(Submit(effect="Carton001 isOn Shelf001"))
            while not (robot := (await operator.robots())["Robot1"]).activity or (carrying and robot.holding is None):
                await asyncio.sleep(0.01)
            await client.report(UpdateMap(situation="Door001.Open = FALSE"))
            view, sentences = await _ended(client, submitted)
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert any("Door001.Open = TRUE does not hold any more" in sentence for sentence in sentences)
            assert view.work[0].service == "Robot1.TransferObject"
            assert {work.service_type: work.state for work in view.work[1:]} == {"OpenDoor": "Completed", "TransferObject": "Completed"}
            assert (await operator.observe("Carton001")).support == "Shelf001"

    asyncio.run(test())
