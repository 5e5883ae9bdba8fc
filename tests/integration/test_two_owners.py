"""Two systems of two owners, whose Registries are neighbours: a goal of one is reached by a device of the other."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from somrs.api.fleet import Presence
from somrs.api.remote import LiveApi
from somrs.cli import commands, status
from somrs.kernel import following, service_replica
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import Phase, TaskView
from somrs.registry import neighbours
from somrs.registry.neighbours import Neighbour
from somrs.registry.selection import Selection
from tests.support.hang import HANG_TIME
from tests.support.small_system import Porter, SmallSystem, live_api_at
from tests.support.virtual_system import SITE

GOAL = "Jar002 isOn Platform001"

Scenario = Callable[[SmallSystem, LiveApi, SmallSystem], Awaitable[None]]


def run_scenario(data: Path, scenario: Scenario, *types: str, device: str = "Robot1") -> None:
    """`Here` has no device. `There` has one, and gives Here services of these types; without any, all."""

    async def run() -> None:
        here, there = SmallSystem(data / "here", []), SmallSystem(data / "there", [Porter(device)])
        there.site = SITE.replace("Robot1:", f"{device}:")
        here.neighbours = [Neighbour(name="There", address=there.addresses.registry, takes=Selection())]
        there.neighbours = [Neighbour(name="Here", address=here.addresses.registry, gives=Selection(types=types))]
        async with asyncio.timeout(HANG_TIME), AsyncExitStack() as stack:
            for system in (there, here):
                stack.push_async_callback(system.stop)
                await system.start()
            api = await stack.enter_async_context(live_api_at(here))
            here.addresses.write(here.data)
            await scenario(here, api, there)

    asyncio.run(run())


async def wait_until(condition: Callable[[], Awaitable[bool]]) -> None:
    while not await condition():
        await asyncio.sleep(0.05)


async def end_of(api: LiveApi, task: str) -> TaskView:
    while (view := (await api.tasks.read(task)).view).phase is not Phase.ENDED:
        await asyncio.sleep(0.05)
    return view


JSON_FOLLOWS = "as JSON:"


async def is_listed(api: LiveApi) -> bool:
    return bool((await api.fleet.services()).offers)


@pytest.mark.parametrize("name", ["Robot1", "Carrier9"])
def test_a_goal_is_reached_by_a_device_of_a_neighbour(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    """The map of Here has a Robot1, and no Carrier9."""

    async def scenario(here: SmallSystem, api: LiveApi, there: SmallSystem) -> None:
        await wait_until(lambda: is_listed(api))
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        view = await end_of(api, task)
        assert view.outcome is Outcome.ACCOMPLISHED, view
        assert [work.service for work in view.work] == [f"{name}.TransferObject"]
        assert there.porters[0].delivered == ["Jar002"]
        assert (await api.map.query(GOAL)).rows, "the map of Here has the effect"
        [device] = [device for device in (await api.fleet.devices()).devices if device.name == name]
        assert (device.registry, device.presence) == ("There", Presence.OFFERS)
        await commands.services(None, None, (), here.data, json=False)
        await status.status(here.addresses, here.data, json=False)
        print(JSON_FOLLOWS)
        await status.status(here.addresses, here.data, json=True)

    run_scenario(tmp_path, scenario, device=name)
    output, _, document = capsys.readouterr().out.partition(JSON_FOLLOWS)
    assert [neighbour["name"] for neighbour in json.loads(document)["neighbours"]] == ["There"]
    assert "from There" in output
    assert "1 of its services is listed" in output


def test_a_neighbour_that_is_away_is_left_out_and_a_task_goes_on_when_it_is_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in (following, service_replica, neighbours):
        monkeypatch.setattr(module, "LEASE", 3.0)

    async def scenario(here: SmallSystem, api: LiveApi, there: SmallSystem) -> None:
        async def is_away() -> bool:
            return any(neighbour.away_since is not None for neighbour in (await api.system.read()).neighbours)

        await wait_until(lambda: is_listed(api))
        await there.stop_registry()
        await wait_until(is_away)
        assert not await is_listed(api)
        await commands.services(None, None, (), here.data, json=False)
        task = (await api.tasks.submit(Submit(effect=GOAL))).task
        there.start_registry()
        view = await end_of(api, task)
        assert view.outcome is Outcome.ACCOMPLISHED, view
        assert not await is_away()

    run_scenario(tmp_path, scenario)
    assert "no answer since" in capsys.readouterr().out


def test_what_is_not_given_is_not_seen_and_the_reason_is_that_no_service_is_on_offer(tmp_path: Path) -> None:
    async def scenario(here: SmallSystem, api: LiveApi, there: SmallSystem) -> None:
        async def is_followed() -> bool:
            return all(neighbour.away_since is None for neighbour in (await api.system.read()).neighbours)

        await wait_until(is_followed)
        services = await api.fleet.services()
        assert (services.offers, services.withheld) == ((), ())
        task = (await api.tasks.submit(Submit(effect=GOAL, waits=False))).task
        view = await end_of(api, task)
        assert view.outcome is Outcome.FAILED
        assert view.explanation == f"no plan: {GOAL} could be brought about by TransferObject, which no device offers now"

    run_scenario(tmp_path, scenario, "MoveTo")
