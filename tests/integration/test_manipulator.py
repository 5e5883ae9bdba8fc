"""A simulated robot as a device that carries things: what it quotes, what it reports, and what it says when it fails."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import pytest
from msgspec import structs

from somrs.devices.simulator.drivers.manipulator import Manipulator, Spot, read_spot
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.link import OperatorLink
from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.errors import DeviceError
from somrs.ontology.map import Map
from somrs.ontology.values import value_of
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.repository.component import Repository
from somrs.service_manager.sdk.map_reader import Ask, MapReader
from somrs.service_manager.sdk.orders import Advance, Halt, Order, Perform, Quote, Quoted, Refusal, ServiceFailed, Undo, WorkDone
from tests.support.hang import HANG_TIME
from tests.support.robot_lab import SITE, map_after, repository, run, run_work, simulator, site
from tests.support.virtual_devices import make_ask


@dataclass
class DeviceHarness:
    """A robot's device, and what stands in for its Service Manager."""

    device: Manipulator
    operator: OperatorLink
    repository: Repository
    advances: list[Advance] = field(default_factory=list)

    async def run_work(self, work: Quote | Perform | Halt | Undo) -> object:
        return await run_work(self.device, work, self.repository, self.advances)

    async def perform(self, order: Order) -> Map:
        """The map after the service, by what it says that holds then."""
        result = await self.run_work(Perform(order))
        assert isinstance(result, WorkDone)
        return map_after(result.situation)


def order(object: str = "Jar1", destination: str = "Platform1", precondition: str | None = None) -> Order:
    effect = f"{object} isOn {destination}"
    inputs = {"Object": object, "Destination": destination}
    return Order(participant="p", method="transfer", inputs=inputs, effect=effect, precondition=precondition)


@asynccontextmanager
async def device_harness(
    name: str = "Robot1", speed: float | None = None, kind: type[Manipulator] = Manipulator, reconnect_time: float = 0.3, text: str = SITE
) -> AsyncIterator[DeviceHarness]:
    async with simulator(speed, text) as server, OperatorLink(server.host, server.port) as operator:
        rooms = repository(text)
        device = kind(name, f"{server.host}:{server.port}")
        device.reconnect_timeout = reconnect_time
        ask = make_ask(rooms, lambda: 0.0)
        device.map = MapReader(ask)
        observed: list[asyncio.Task[Body]] = []
        device.observer = lambda situation, observation: observed.append(asyncio.create_task(_report_situation(ask, situation)))
        await device.open()
        try:
            yield DeviceHarness(device, operator, rooms)
        finally:
            await device.close()


async def _report_situation(ask: Ask, situation: str | None) -> Body:
    return await ask(UpdateMap(situation=situation))


async def _wait_for_working(harness: DeviceHarness, working: bool) -> None:
    async with asyncio.timeout(HANG_TIME):
        while harness.repository.contents.map.objects["Robot1"].values.get("Working") is not working:
            await asyncio.sleep(0.02)


@pytest.mark.parametrize("fault", [Fault.DRIVE, Fault.GRIPPER])
def test_a_robot_that_has_nothing_to_do_says_that_it_broke_and_that_it_was_mended(fault: Fault) -> None:
    async def test() -> None:
        async with device_harness(speed=1.0) as harness:
            await harness.operator.fault("Robot1", fault)
            await _wait_for_working(harness, False)
            await harness.operator.repair("Robot1", fault)
            await _wait_for_working(harness, True)

    run(test())


def test_its_services_are_offered_with_what_the_map_says_of_it() -> None:
    async def test() -> None:
        async with device_harness() as harness:
            capability = next(c for c in harness.device.profile().capabilities if c.type_name == "TransferObject")
            loaded, map = site()
            for feature in ("Payload", "Speed", "OperationRange"):
                assert capability.attributes[feature] == value_of("Robot1", feature, map, loaded.ontology), feature

    run(test())


def test_a_jar_is_carried_and_it_says_where_it_is_to_the_millimetre() -> None:
    async def test() -> None:
        async with device_harness() as harness:
            map = await harness.perform(order())
            truth = await harness.operator.observe("Jar1")
            assert truth.support == "Platform1"
            assert map.has_fact("isOn", ("Jar1", "Platform1"))
            values = map.objects["Jar1"].values
            assert [values[f"Position{axis}"] for axis in "XYZ"] == [round(v, 3) for v in (truth.x, truth.y, truth.z)]
            robot = (await harness.operator.robots())["Robot1"]
            assert map.objects["Robot1"].values["PositionX"] == round(robot.x, 3)
            situations = [advance.situation for advance in harness.advances if advance.situation]
            assert situations == ["Jar1 isHeldBy Robot1"]
            fractions = [advance.fraction for advance in harness.advances]
            assert fractions == sorted(fractions)

    run(test())


def test_price_and_duration_come_from_the_map_and_the_way() -> None:
    class Taxi(Manipulator):
        price_per_metre = 2.0

    async def test() -> None:
        async with device_harness() as harness:
            quote = await harness.run_work(Quote(order()))
            assert isinstance(quote, Quoted)
            assert (quote.price, quote.currency) == (10, "EUR")
            start_time = (await harness.operator.clock()).time
            await harness.perform(order())
            duration = (await harness.operator.clock()).time - start_time
            assert duration == pytest.approx(quote.duration, rel=0.4)
        async with device_harness(kind=Taxi) as harness:
            taxi = await harness.run_work(Quote(order()))
            assert isinstance(taxi, Quoted)
            way = sum(length or 0 for length in await harness.operator.ways("Robot1", "Jar1", "Platform1"))
            assert taxi.price == pytest.approx(10 + 2 * way, abs=0.01)

    run(test())


def test_a_quote_counts_with_where_the_thing_is_going_to_be() -> None:
    async def test() -> None:
        async with device_harness() as harness:

            async def quoted(precondition: str) -> float:
                quote = await harness.run_work(Quote(order(precondition=precondition)))
                assert isinstance(quote, Quoted)
                return quote.duration

            now = await quoted("Jar1 isOn Table1")
            moved_duration = await quoted("Jar1.PositionX = 3 AND Jar1.PositionY = 2 AND Jar1.PositionZ = 0")
            assert moved_duration < now - 2
            assert await quoted("Jar1 isOn Platform1") == pytest.approx(now, abs=6)

    run(test())


WITH_DOOR = SITE.replace(
    "facts:",
    """  Door1: {type: Door, at: [4, 2.3, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.4, Height: 2.1}, Open: false}
  Wall2: {type: Wall, at: [4, 4.5, 0], Shape: {Form: Box, Width: 0.1, Depth: 3, Height: 2.5}}
facts:""",
)
"""The jar and the platform are in two rooms, with a shut door between them."""


def test_a_robot_that_finds_a_shut_door_on_its_only_way_offers_to_go_if_it_is_open() -> None:
    async def test() -> None:
        async with device_harness(text=WITH_DOOR) as harness:
            shut = await harness.run_work(Quote(order()))
            assert isinstance(shut, Quoted)
            assert shut.condition == "Door1.Open = TRUE"
            promised = await harness.run_work(Quote(structs.replace(order(), situation="Door1.Open = TRUE")))
            assert promised == shut, "the way is the same, and the door has to stay open"
            beside = await harness.run_work(Quote(structs.replace(order(), situation="Jar1 isOn Platform1")))
            assert isinstance(beside, Quoted)
            assert beside.condition == "Door1.Open = TRUE", "the jar will have been carried to the other room"
            near = await harness.run_work(Quote(order(destination="Floor1")))
            assert isinstance(near, Quoted)
            assert near.condition is None

    run(test())


@pytest.mark.parametrize(
    ("refused_order", "fault", "reason"),
    [
        (order("Anvil1"), None, "too heavy for Robot1: it weighs 4 kg, the payload is 2 kg"),
        (order(), Fault.DRIVE, "its drive is dead"),
        (order(), Fault.GRIPPER, "its gripper is stuck"),
        (order(), Fault.SILENT, "does not answer"),
        (order(), Fault.LINK, "does not answer"),
        (order(destination="Robot9"), None, "Robot9 is not in the simulated world"),
        (
            order(destination="Wall1", precondition="Jar1.PositionX = 30 AND Jar1.PositionY = 1"),
            None,
            "can stand nowhere from where it could reach Jar1",
        ),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_reason(refused_order: Order, fault: Fault | None, reason: str) -> None:
    async def test() -> None:
        async with device_harness() as harness:
            if fault is not None:
                await harness.operator.fault("Robot1", fault)
            with pytest.raises(Refusal, match=reason):
                await harness.run_work(Quote(refused_order))

    run(test())


def test_a_drive_that_dies_in_mid_transport_is_told_exactly_and_another_robot_goes_on() -> None:
    async def test() -> None:
        async with device_harness() as harness:
            await harness.operator.schedule("Robot1", Fault.DRIVE, carried=2.5)
            with pytest.raises(ServiceFailed, match="drive of Robot1 is dead") as failed:
                await harness.run_work(Perform(order()))
            truth = await harness.operator.observe("Jar1")
            situation = failed.value.situation
            assert situation is not None
            first = [str(part) for part in conjuncts(parse(situation))][:4]
            assert [text.partition(" = ")[0] for text in first] == [
                "Jar1.PositionX",
                "Jar1.PositionY",
                "Jar1.PositionZ",
                "Jar1 isOn Floor1",
            ]
            map = map_after(situation)
            values = map.objects["Jar1"].values
            for axis, real in zip("XYZ", (truth.x, truth.y, truth.z), strict=True):
                assert values[f"Position{axis}"] == pytest.approx(real, abs=0.002)
            assert values["PositionZ"] == 0
            assert map.has_fact("isOn", ("Jar1", "Floor1"))
            robot = map.objects["Robot1"].values
            assert robot["Working"] is False
            assert math.dist((float(robot["PositionX"]), float(robot["PositionY"])), (truth.x, truth.y)) < 0.8

            second = Manipulator("Robot2", harness.device.simulator)
            second.map = harness.device.map
            await second.open()
            second_harness = DeviceHarness(second, harness.operator, harness.repository)
            at_floor = " AND ".join(first[:3])
            assert isinstance(await second_harness.run_work(Quote(order(precondition=at_floor))), Quoted)
            assert (await second_harness.perform(order(precondition=at_floor))).has_fact("isOn", ("Jar1", "Platform1"))
            assert (await harness.operator.observe("Jar1")).support == "Platform1"
            await second.close()

    run(test())


def test_a_gripper_that_sticks_keeps_hold_of_the_jar_and_says_so() -> None:
    async def test() -> None:
        async with device_harness() as harness:
            await harness.operator.schedule("Robot1", Fault.GRIPPER, carried=1.0)
            with pytest.raises(ServiceFailed) as failed:
                await harness.run_work(Perform(order()))
            map = map_after(failed.value.situation)
            assert map.has_fact("isHeldBy", ("Jar1", "Robot1"))
            assert not map.has_fact("isOn", ("Jar1", "Table1"))
            assert map.objects["Robot1"].values["Working"] is False

    run(test())


def test_what_a_mended_gripper_still_holds_is_put_down_and_can_be_taken_again() -> None:
    async def test() -> None:
        async with device_harness() as harness:
            await harness.operator.schedule("Robot1", Fault.GRIPPER, carried=1.0)
            with pytest.raises(ServiceFailed) as failed:
                await harness.run_work(Perform(order()))
            harness.device.observed(str(failed.value.situation))
            map_of = harness.repository.contents
            async with asyncio.timeout(HANG_TIME):
                while not map_of.map.has_fact("isHeldBy", ("Jar1", "Robot1")):
                    await asyncio.sleep(0.02)
                await harness.operator.repair("Robot1", Fault.GRIPPER)
                while map_of.map.has_fact("isHeldBy", ("Jar1", "Robot1")):
                    await asyncio.sleep(0.02)
            truth = await harness.operator.observe("Jar1")
            assert truth.held_by is None
            assert map_of.map.has_fact("isOn", ("Jar1", str(truth.support)))
            assert (await harness.perform(order())).has_fact("isOn", ("Jar1", "Platform1"))

    run(test())


def test_a_link_that_is_lost_fails_with_what_was_known_last() -> None:
    async def test() -> None:
        async with device_harness() as harness:
            await harness.operator.schedule("Robot1", Fault.LINK, carried=1.0)
            with pytest.raises(ServiceFailed, match="lost") as failed:
                await harness.run_work(Perform(order()))
            map = map_after(failed.value.situation)
            assert map.has_fact("isHeldBy", ("Jar1", "Robot1"))
            assert map.objects["Robot1"].values["Working"] is False

    run(test())


@pytest.mark.parametrize(("fault_delay", "carried"), [(1.0, None), (None, 1.0)])
def test_a_link_that_is_lost_for_a_moment_does_not_end_the_work(fault_delay: float | None, carried: float | None) -> None:
    async def test() -> None:
        async with device_harness(reconnect_time=HANG_TIME) as harness:
            await harness.operator.schedule("Robot1", Fault.LINK, delay=fault_delay, carried=carried)
            working = asyncio.create_task(harness.perform(order()))
            while not (await harness.operator.robots())["Robot1"].faults:
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.3)
            assert not working.done()
            await harness.operator.repair("Robot1", Fault.LINK)
            map = await working
            assert map.has_fact("isOn", ("Jar1", "Platform1"))
            assert (await harness.operator.observe("Jar1")).support == "Platform1"

    run(test())


def test_a_quote_waits_for_a_link_that_was_lost_just_now() -> None:
    async def test() -> None:
        async with device_harness(reconnect_time=HANG_TIME) as harness:
            await harness.operator.fault("Robot1", Fault.LINK)
            quoting = asyncio.create_task(harness.run_work(Quote(order())))
            await asyncio.sleep(0.3)
            assert not quoting.done()
            await harness.operator.repair("Robot1", Fault.LINK)
            assert isinstance(await quoting, Quoted)

    run(test())


AT_PARK = SITE.replace("facts:", "  Park1: {type: Place, at: [2, 1.5]}\nfacts:\n  - Robot1 isAt Park1")


def test_a_robot_that_another_one_has_sent_away_is_no_longer_at_its_place() -> None:
    async def test() -> None:
        async with device_harness(text=AT_PARK) as harness:
            await harness.device._link.drive_to(3, 2)
            async with asyncio.timeout(HANG_TIME):
                while harness.repository.contents.map.has_fact("isAt", ("Robot1", "Park1")):
                    await asyncio.sleep(0.1)

    run(test())


def test_a_robot_that_was_stopped_on_the_way_is_no_longer_at_its_place() -> None:
    async def test() -> None:
        async with device_harness(text=AT_PARK) as harness:
            await harness.device._link.drive_to(3, 2)
            result = await harness.run_work(Halt(order()))
            assert isinstance(result, WorkDone)
            assert not map_after(result.situation, AT_PARK).has_fact("isAt", ("Robot1", "Park1"))

    run(test())


def test_a_robot_that_broke_on_the_way_is_no_longer_at_its_place() -> None:
    async def test() -> None:
        async with device_harness(text=AT_PARK) as harness:
            await harness.operator.schedule("Robot1", Fault.DRIVE, carried=2.5)
            with pytest.raises(ServiceFailed) as failed:
                await harness.run_work(Perform(order()))
            assert not map_after(failed.value.situation, AT_PARK).has_fact("isAt", ("Robot1", "Park1"))

    run(test())


def test_where_it_went_without_work_is_told_too() -> None:
    async def test() -> None:
        async with device_harness() as harness:
            await harness.device._link.drive_to(3, 2)  # as if another robot wanted to pass
            robot = (await harness.operator.robots())["Robot1"]
            async with asyncio.timeout(HANG_TIME):
                while harness.repository.contents.map.objects["Robot1"].values["PositionX"] != pytest.approx(robot.x, abs=0.001):
                    await asyncio.sleep(0.1)
            version = harness.repository.contents.version
            await asyncio.sleep(2.5)
            assert harness.repository.contents.version == version, "what was told is not told again"

    run(test())


def test_stopped_in_the_middle_it_puts_the_jar_down_and_says_where() -> None:
    async def test() -> None:
        async with device_harness(speed=20) as harness:
            working = asyncio.create_task(harness.run_work(Perform(order())))
            while not any(advance.situation for advance in harness.advances):
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.1)
            working.cancel()
            await asyncio.gather(working, return_exceptions=True)
            result = await harness.run_work(Halt(order()))
            assert isinstance(result, WorkDone)
            truth = await harness.operator.observe("Jar1")
            assert truth.support == "Floor1"
            map = map_after(result.situation)
            assert map.has_fact("isOn", ("Jar1", "Floor1"))
            assert map.objects["Jar1"].values["PositionX"] == pytest.approx(truth.x, abs=0.002)
            assert (await harness.operator.robots())["Robot1"].holding is None

    run(test())


def test_stopped_before_it_gripped_it_leaves_the_jar_alone() -> None:
    async def test() -> None:
        async with device_harness() as harness:
            result = await harness.run_work(Halt(order()))
            assert isinstance(result, WorkDone)
            assert (await harness.operator.observe("Jar1")).support == "Table1"
            assert map_after(result.situation).has_fact("isOn", ("Jar1", "Table1"))

    run(test())


def test_what_was_done_is_undone() -> None:
    async def test() -> None:
        async with device_harness() as harness:
            await harness.perform(order())
            old_situation = "Jar1 isOn Table1 AND Jar1.PositionX = 1.15 AND Jar1.PositionY = 4"
            result = await harness.run_work(Undo(order(), old_situation))
            assert isinstance(result, WorkDone)
            assert map_after(result.situation).has_fact("isOn", ("Jar1", "Table1"))
            truth = await harness.operator.observe("Jar1")
            assert math.dist((truth.x, truth.y), (1.15, 4)) < 0.02
            with pytest.raises(ServiceFailed, match="does not say on what"):
                await harness.run_work(Undo(order(), "Jar1.Color = Red"))

    run(test())


def test_it_reports_while_it_drives() -> None:
    async def test() -> None:
        async with device_harness(speed=2) as harness:
            working = asyncio.create_task(harness.run_work(Perform(order())))
            await asyncio.sleep(2.6)
            working.cancel()
            await asyncio.gather(working, return_exceptions=True)
            notes = [advance.note for advance in harness.advances]
            assert notes[:2] == ["on the way to Jar1"] * 2

    run(test())


def test_a_device_without_a_simulator_says_what_is_missing() -> None:
    with pytest.raises(DeviceError, match="host:port"):
        asyncio.run(Manipulator("Robot1").open())


def test_where_a_formula_says_that_a_thing_is() -> None:
    assert read_spot("Jar1", parse("Jar1 isOn ?Shelf AND Jar2 isOn Table2")) == Spot()
    assert read_spot("Jar1", parse("Jar1 isOn Table1 AND Jar1.PositionX = 1")) == Spot(support="Table1")
    assert read_spot("Jar1", parse("Jar1.PositionX = 1 AND Jar1.PositionY = 2")) == Spot(position=(1, 2))
    assert read_spot("Jar1", None) == Spot()


FURNITURE_OF_ITS_OWN = SITE.replace(
    "facts:",
    """  Rack1: {type: Rack, at: [6.5, 2.5, 0], Shape: {Form: Box, Width: 0.6, Depth: 0.6, Height: 0.5}}
  Stool1: {type: Stool, at: [5, 4.5, 0], Shape: {Form: Box, Width: 0.4, Depth: 0.4, Height: 0.45}, Supporting: true}
  Stool2: {type: Stool, at: [5, 5.3, 0], Shape: {Form: Box, Width: 0.4, Depth: 0.4, Height: 0.45}}
types:
  Rack: {parent: Furniture}
  Stool: {parent: Obstacle}
facts:""",
)


@pytest.mark.parametrize("destination", ["Rack1", "Stool1"])
def test_things_are_put_on_the_furniture_of_a_site_if_it_can_carry_them(destination: str) -> None:
    async def test() -> None:
        async with device_harness(text=FURNITURE_OF_ITS_OWN) as harness:
            with pytest.raises(Refusal, match="cannot put anything on Stool2"):
                await harness.run_work(Quote(order(destination="Stool2")))
            done = await harness.run_work(Perform(order(destination=destination)))
            assert f"Jar1 isOn {destination}" in str(done)
            assert (await harness.operator.observe("Jar1")).support == destination

    run(test())


def test_nothing_is_carried_to_where_nothing_can_be_put() -> None:
    async def test() -> None:
        async with device_harness() as harness:
            with pytest.raises(Refusal, match="cannot put anything on Robot2, only on floors"):
                await harness.run_work(Quote(order(destination="Robot2")))

    run(test())
