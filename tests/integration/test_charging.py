"""Robots that mind their batteries: what they refuse, what they report, and how they share chargers."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import msgspec
import pytest
from msgspec import structs

from somrs.devices.simulator.drivers.charging import CHARGE_STEP
from somrs.devices.simulator.drivers.manipulator import Manipulator
from somrs.entish.parse import parse
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.observations import Observation, observed_at
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.orders import Quote, Quoted, Refusal, ServiceFailed
from tests.support.building import building
from tests.support.robot_lab import run, run_work
from tests.support.simulated_device_harness import SimulatedDeviceHarness, simulated
from tests.support.virtual_devices import make_ask


def site(charge: float, *, facts: str = "", robot2: str = "at: [6, 3, 0]") -> str:
    return (
        building("Lab", 8, 6)
        + f"""
  Entrance: {{type: Place, at: [6, 4]}}
  Charger1: {{type: Charger, at: [1.5, 1.5]}}
  Robot1: {{type: PioneerP3DX, at: [3, 3, 0], Price: 10 EUR, Charge: {charge}}}
  Robot2: {{type: PioneerP3DX, {robot2}, Price: 10 EUR, Charge: 80}}
{facts}
"""
    )


RESERVED = "facts:\n  - Charger1 isBookedFor Robot2"


@asynccontextmanager
async def charging_robot(text: str) -> AsyncIterator[tuple[SimulatedDeviceHarness, Manipulator, list[str]]]:
    """Robot1 of the site, and what it reports outside of its services."""
    async with simulated(Manipulator, "Robot1", text) as harness:
        reports: list[str] = []

        def observe(situation: str | None, observation: Observation) -> None:
            reports.append(situation or "")

        harness.device.observer = observe
        assert isinstance(harness.device, Manipulator)
        yield harness, harness.device, reports


def test_a_robot_that_could_not_get_to_a_charger_after_the_work_says_what_charge_it_needs() -> None:
    async def test() -> None:
        async with charging_robot(site(12)) as (harness, _, _):
            with pytest.raises(
                Refusal, match=r"Robot1 needs 13 % of charge for this, and for the way to Charger1 after it, and has 12 %"
            ) as caught:
                await harness.quote("MoveTo", Place="Entrance")
            assert caught.value.not_now
            assert caught.value.condition == "Robot1.Charge >= 16"
            charged = msgspec.structs.replace(harness.order("MoveTo", Place="Entrance"), situation="Robot1.Charge = 100")
            quote = await run_work(harness.device, Quote(charged), harness.repository, [])
            assert isinstance(quote, Quoted), "an earlier step of the plan charges it"
            assert isinstance(await harness.quote("ChargeBattery"), Quoted)

    run(test())


def test_a_robot_with_enough_charge_works() -> None:
    async def test() -> None:
        async with charging_robot(site(20)) as (harness, _, _):
            assert isinstance(await harness.quote("MoveTo", Place="Entrance"), Quoted)

    run(test())


def test_work_that_was_quoted_long_ago_is_not_begun_without_the_charge_for_it() -> None:
    async def test() -> None:
        async with charging_robot(site(2)) as (harness, _, _):
            order = msgspec.structs.replace(harness.order("MoveTo", Place="Entrance"), situation="Robot1.Charge = 100")
            await run_work(harness.device, Quote(order), harness.repository, [])
            with pytest.raises(ServiceFailed, match=r"Robot1 needs 13 % of charge"):
                await harness.perform("MoveTo", Place="Entrance")
            state = (await harness.operator.robots())["Robot1"]
            assert (state.x, state.y) == pytest.approx((3, 3), abs=0.05), "it has not set off"

    run(test())


@pytest.mark.parametrize(
    ("text", "is_free"),
    [
        (site(50), True),
        (site(50, facts=RESERVED), False),
        (site(50, facts=RESERVED, robot2="at: [6, 3, 0], Working: false"), True),
        (site(50, robot2="at: [1.5, 1.5, 0]"), True),
        (site(50, robot2="at: [1.5, 1.5, 0], Working: false"), False),
    ],
    ids=["nobody", "reserved", "reserved for a broken robot", "an idle robot stands there", "a broken robot stands there"],
)
def test_a_charger_is_free_if_nobody_has_reserved_it_and_no_broken_robot_stands_there(text: str, is_free: bool) -> None:
    async def test() -> None:
        async with charging_robot(text) as (harness, _, _):
            if is_free:
                assert isinstance(await harness.quote("ChargeBattery"), Quoted)
                return
            with pytest.raises(Refusal, match="all chargers are in use") as caught:
                await harness.quote("ChargeBattery")
            assert caught.value.not_now

    run(test())


def test_a_robot_reserves_its_charger_and_releases_it_and_drives_an_idle_robot_away() -> None:
    async def test() -> None:
        async with charging_robot(site(98, robot2="at: [1.5, 1.5, 0]")) as (harness, robot, reports):
            map = await harness.perform("ChargeBattery")
            assert map.has_fact("isAt", ("Robot1", "Charger1"))
            assert map.objects["Robot1"].values["Charge"] == 100
            assert await robot.map.holds("Charger1 isBookedFor Robot1"), "the Repository got the reservation first"
            assert reports[-1] == str(parse("NOT Charger1 isBookedFor Robot1"))

    run(test())


def test_of_two_robots_that_see_a_free_charger_one_gets_it() -> None:
    async def test() -> None:
        async with charging_robot(site(50)) as (_, robot, _):
            version = (await robot.map.rows("?It: Charger isBookedFor ?Robot")).version
            assert await robot.reserve_charger("Charger1", version)
            robot.name = "Robot2"
            assert not await robot.reserve_charger("Charger1", version)
            assert await robot.map.holds("Charger1 isBookedFor Robot1")

    run(test())


@pytest.mark.parametrize("decided_at", [99.0, 100.0, 101.0])
def test_of_two_robots_that_reserve_a_charger_at_once_the_one_whose_request_comes_first_gets_it(decided_at: float) -> None:
    """Requests overtake each other: one that arrives later may have been sent earlier."""

    async def test() -> None:
        async with charging_robot(site(50)) as (harness, robot, _):
            clock = 100.0
            ask = make_ask(harness.repository, lambda: 200.0)

            async def ask_with_time(body: Body) -> Body:
                if isinstance(body, UpdateMap):
                    body = structs.replace(body, observation=observed_at(body.observation, clock))
                return await ask(body)

            robot.map = MapReader(ask_with_time)
            version = (await robot.map.rows("?It: Charger isBookedFor ?Robot")).version
            assert await robot.reserve_charger("Charger1", version)
            clock, robot.name = decided_at, "Robot2"
            assert not await robot.reserve_charger("Charger1", version)
            assert await robot.map.holds("Charger1 isBookedFor Robot1")

    run(test())


def test_the_charge_goes_to_the_map_in_steps() -> None:
    async def test() -> None:
        async with charging_robot(site(90)) as (harness, _, reports):
            await harness.perform("ChargeBattery")
            charges = [float(report.rpartition(" ")[2]) for report in reports if ".Charge = " in report]
            assert 3 <= len(charges) <= 10 / CHARGE_STEP + 1
            assert charges == sorted(charges)

    run(test())


def test_a_robot_whose_battery_runs_empty_on_the_way_says_so_and_has_to_be_brought_to_a_charger() -> None:
    table = "  Table1: {type: Platform, at: [6, 1, 0], Shape: {Form: Box, Width: 0.5, Depth: 0.5, Height: 0.3}}"
    jar = f"{table}\n  Jar1: {{type: Jar, at: [6, 1, 0.3]}}\n"

    async def test() -> None:
        text = site(0.02, facts=f"{jar}facts:\n  - Jar1 isOn Table1")
        async with charging_robot(text) as (harness, _, reports):
            with pytest.raises(ServiceFailed, match="the battery of Robot1 is empty") as caught:
                await harness.perform("TransferObject", Object="Jar1", Destination="Table1")
            assert "Robot1.Charge = 0" in str(caught.value.situation)
            assert "isHeldBy" not in str(caught.value.situation), "another robot can take the jar"
            assert reports in ([], [str(parse("Robot1.Charge = 0"))])
            with pytest.raises(Refusal, match="it has to be charged first") as refused:
                await harness.quote("MoveTo", Place="Entrance")
            assert refused.value.not_now
            with pytest.raises(Refusal, match="somebody has to bring it to a charger") as stuck:
                await harness.quote("ChargeBattery")
            assert stuck.value.not_now

    run(test())
