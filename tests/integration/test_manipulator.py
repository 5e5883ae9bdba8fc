"""A simulated robot as a device that carries things: what it quotes, what it reports, and what it says when it fails."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import pytest

from somrs.devices.simulator.drivers.manipulator import Manipulator, Spot, read_spot
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.link import OperatorLink
from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.errors import DeviceError
from somrs.ontology.objects import Map
from somrs.ontology.values import value_of
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.service_manager.sdk.device import Ask, MapReader
from somrs.service_manager.sdk.orders import Advance, Halt, Order, Perform, Quote, Quoted, Refusal, ServiceFailed, Undo, WorkDone
from somrs.service_manager.sdk.work import carry_out
from tests.support.robot_lab import after, run, simulator, site
from tests.support.virtual_devices import asking


@dataclass
class Desk:
    """A robot's device, and what stands in for its Service Manager."""

    device: Manipulator
    operator: OperatorLink
    repository: Repository
    told: list[Advance] = field(default_factory=list)

    async def do(self, work: Quote | Perform | Halt | Undo) -> object:
        def told(report: object) -> None:
            assert isinstance(report, Advance)
            self.told.append(report)

        return await carry_out(self.device, work, asking(self.repository, lambda: 0.0), told)

    async def perform(self, order: Order) -> Map:
        """The map after the service, by what it says that holds then."""
        done = await self.do(Perform(order))
        assert isinstance(done, WorkDone)
        return after(done.situation)


def order(object: str = "Jar1", destination: str = "Platform1", precondition: str | None = None) -> Order:
    effect = f"{object} isOn {destination}"
    inputs = {"Object": object, "Destination": destination}
    return Order(participant="p", method="transfer", inputs=inputs, effect=effect, precondition=precondition)


@asynccontextmanager
async def desk(
    name: str = "Robot1", speed: float | None = None, kind: type[Manipulator] = Manipulator, away: float = 0.3
) -> AsyncIterator[Desk]:
    loaded, map = site()
    async with simulator(speed) as server, OperatorLink(server.host, server.port) as operator:
        repository = Repository("http://here/repository", Contents(ontology=loaded.ontology, map=map))
        device = kind(name, f"{server.host}:{server.port}")
        device.reconnect_timeout = away
        ask = asking(repository, lambda: 0.0)
        device.map = MapReader(ask)
        observed: list[asyncio.Task[Body]] = []
        device.observer = lambda situation: observed.append(asyncio.create_task(_told(ask, situation)))
        await device.open()
        try:
            yield Desk(device, operator, repository)
        finally:
            await device.close()


async def _told(ask: Ask, situation: str) -> Body:
    return await ask(UpdateMap(situation=situation))


async def _until(at: Desk, working: bool) -> None:
    async with asyncio.timeout(30):
        while at.repository.contents.map.objects["Robot1"].values.get("Working") is not working:
            await asyncio.sleep(0.02)


@pytest.mark.parametrize("fault", [Fault.DRIVE, Fault.GRIPPER])
def test_a_robot_that_has_nothing_to_do_says_that_it_broke_and_that_it_was_mended(fault: Fault) -> None:
    async def test() -> None:
        async with desk(speed=1.0) as at:
            await at.operator.fault("Robot1", fault)
            await _until(at, False)
            await at.operator.repair("Robot1", fault)
            await _until(at, True)

    run(test())


def test_its_services_are_offered_with_what_the_map_says_of_it() -> None:
    async def test() -> None:
        async with desk() as at:
            (capability,) = at.device.profile().capabilities
            loaded, map = site()
            for feature in ("Payload", "Speed", "OperationRange"):
                assert capability.attributes[feature] == value_of("Robot1", feature, map, loaded.ontology), feature

    run(test())


def test_a_jar_is_carried_and_it_says_where_it_is_to_the_millimetre() -> None:
    async def test() -> None:
        async with desk() as at:
            map = await at.perform(order())
            truth = await at.operator.observe("Jar1")
            assert truth.support == "Platform1"
            assert map.has_fact("isOn", ("Jar1", "Platform1"))
            values = map.objects["Jar1"].values
            assert [values[f"Position{axis}"] for axis in "XYZ"] == [round(v, 3) for v in (truth.x, truth.y, truth.z)]
            robot = (await at.operator.robots())["Robot1"]
            assert map.objects["Robot1"].values["PositionX"] == round(robot.x, 3)
            situations = [advance.situation for advance in at.told if advance.situation]
            assert situations == ["Jar1 isHeldBy Robot1"]
            fractions = [advance.fraction for advance in at.told]
            assert fractions == sorted(fractions)

    run(test())


def test_price_and_duration_come_from_the_map_and_the_way() -> None:
    class Taxi(Manipulator):
        price_per_metre = 2.0

    async def test() -> None:
        async with desk() as at:
            near = await at.do(Quote(order()))
            assert isinstance(near, Quoted)
            assert (near.price, near.currency) == (10, "EUR")
            before = (await at.operator.clock()).time
            await at.perform(order())
            took = (await at.operator.clock()).time - before
            assert took == pytest.approx(near.duration, rel=0.4)
        async with desk(kind=Taxi) as at:
            taxi = await at.do(Quote(order()))
            assert isinstance(taxi, Quoted)
            way = sum(length or 0 for length in await at.operator.ways("Robot1", "Jar1", "Platform1"))
            assert taxi.price == pytest.approx(10 + 2 * way, abs=0.01)

    run(test())


def test_a_quote_counts_with_where_the_thing_is_going_to_be() -> None:
    async def test() -> None:
        async with desk() as at:

            async def quoted(precondition: str) -> float:
                quote = await at.do(Quote(order(precondition=precondition)))
                assert isinstance(quote, Quoted)
                return quote.duration

            now = await quoted("Jar1 isOn Table1")
            there = await quoted("Jar1.PositionX = 3 AND Jar1.PositionY = 2 AND Jar1.PositionZ = 0")
            assert there < now - 2
            assert await quoted("Jar1 isOn Platform1") == pytest.approx(now, abs=6)

    run(test())


@pytest.mark.parametrize(
    ("wanted", "fault", "told"),
    [
        (order("Anvil1"), None, "too heavy for Robot1: 4 kg, and it carries 2 kg"),
        (order(), Fault.DRIVE, "its drive is dead"),
        (order(), Fault.GRIPPER, "its gripper is stuck"),
        (order(), Fault.SILENT, "does not answer"),
        (order(), Fault.LINK, "does not answer"),
        (order(destination="Robot9"), None, "Robot9 is not in the simulated world"),
        (order(destination="Wall1", precondition="Jar1.PositionX = 30 AND Jar1.PositionY = 1"), None, "finds no way to Jar1"),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_reason(wanted: Order, fault: Fault | None, told: str) -> None:
    async def test() -> None:
        async with desk() as at:
            if fault is not None:
                await at.operator.fault("Robot1", fault)
            with pytest.raises(Refusal, match=told):
                await at.do(Quote(wanted))

    run(test())


def test_a_drive_that_dies_in_mid_transport_is_told_exactly_and_another_robot_goes_on() -> None:
    async def test() -> None:
        async with desk() as at:
            await at.operator.schedule("Robot1", Fault.DRIVE, carried=2.5)
            with pytest.raises(ServiceFailed, match="drive of Robot1 is dead") as failed:
                await at.do(Perform(order()))
            truth = await at.operator.observe("Jar1")
            situation = failed.value.situation
            assert situation is not None
            first = [str(part) for part in conjuncts(parse(situation))][:4]
            assert [text.partition(" = ")[0] for text in first] == [
                "Jar1.PositionX",
                "Jar1.PositionY",
                "Jar1.PositionZ",
                "Jar1 isOn Floor1",
            ]
            map = after(situation)
            values = map.objects["Jar1"].values
            for axis, real in zip("XYZ", (truth.x, truth.y, truth.z), strict=True):
                assert values[f"Position{axis}"] == pytest.approx(real, abs=0.002)
            assert values["PositionZ"] == 0
            assert map.has_fact("isOn", ("Jar1", "Floor1"))
            robot = map.objects["Robot1"].values
            assert robot["Working"] is False
            assert math.dist((float(robot["PositionX"]), float(robot["PositionY"])), (truth.x, truth.y)) < 0.8

            second = Manipulator("Robot2", at.device.simulator)
            second.map = at.device.map
            await second.open()
            other = Desk(second, at.operator, at.repository)
            at_floor = " AND ".join(first[:3])
            assert isinstance(await other.do(Quote(order(precondition=at_floor))), Quoted)
            assert (await other.perform(order(precondition=at_floor))).has_fact("isOn", ("Jar1", "Platform1"))
            assert (await at.operator.observe("Jar1")).support == "Platform1"
            await second.close()

    run(test())


def test_a_gripper_that_sticks_keeps_hold_of_the_jar_and_says_so() -> None:
    async def test() -> None:
        async with desk() as at:
            await at.operator.schedule("Robot1", Fault.GRIPPER, carried=1.0)
            with pytest.raises(ServiceFailed) as failed:
                await at.do(Perform(order()))
            map = after(failed.value.situation)
            assert map.has_fact("isHeldBy", ("Jar1", "Robot1"))
            assert not map.has_fact("isOn", ("Jar1", "Table1"))
            assert map.objects["Robot1"].values["Working"] is False

    run(test())


def test_a_link_that_is_lost_fails_with_what_was_known_last() -> None:
    async def test() -> None:
        async with desk() as at:
            await at.operator.schedule("Robot1", Fault.LINK, carried=1.0)
            with pytest.raises(ServiceFailed, match="lost") as failed:
                await at.do(Perform(order()))
            map = after(failed.value.situation)
            assert map.has_fact("isHeldBy", ("Jar1", "Robot1"))
            assert map.objects["Robot1"].values["Working"] is False

    run(test())


@pytest.mark.parametrize(("after", "carried"), [(1.0, None), (None, 1.0)])
def test_a_link_that_is_lost_for_a_moment_does_not_end_the_work(after: float | None, carried: float | None) -> None:
    async def test() -> None:
        async with desk(away=6.0) as at:
            await at.operator.schedule("Robot1", Fault.LINK, delay=after, carried=carried)
            working = asyncio.create_task(at.perform(order()))
            while not (await at.operator.robots())["Robot1"].faults:
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.3)
            assert not working.done()
            await at.operator.repair("Robot1", Fault.LINK)
            map = await working
            assert map.has_fact("isOn", ("Jar1", "Platform1"))
            assert (await at.operator.observe("Jar1")).support == "Platform1"

    run(test())


def test_a_quote_waits_for_a_link_that_was_lost_just_now() -> None:
    async def test() -> None:
        async with desk(away=6.0) as at:
            await at.operator.fault("Robot1", Fault.LINK)
            quoting = asyncio.create_task(at.do(Quote(order())))
            await asyncio.sleep(0.3)
            assert not quoting.done()
            await at.operator.repair("Robot1", Fault.LINK)
            assert isinstance(await quoting, Quoted)

    run(test())


def test_where_it_went_without_work_is_told_too() -> None:
    async def test() -> None:
        async with desk() as at:
            await at.device._link.drive_to(3, 2)  # as if another robot wanted to pass
            robot = (await at.operator.robots())["Robot1"]
            async with asyncio.timeout(120):
                while at.repository.contents.map.objects["Robot1"].values["PositionX"] != pytest.approx(robot.x, abs=0.001):
                    await asyncio.sleep(0.1)
            version = at.repository.contents.version
            await asyncio.sleep(2.5)
            assert at.repository.contents.version == version, "what was told is not told again"

    run(test())


def test_stopped_in_the_middle_it_puts_the_jar_down_and_says_where() -> None:
    async def test() -> None:
        async with desk(speed=20) as at:
            working = asyncio.create_task(at.do(Perform(order())))
            while not any(advance.situation for advance in at.told):
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.1)
            working.cancel()
            await asyncio.gather(working, return_exceptions=True)
            done = await at.do(Halt(order()))
            assert isinstance(done, WorkDone)
            truth = await at.operator.observe("Jar1")
            assert truth.support == "Floor1"
            map = after(done.situation)
            assert map.has_fact("isOn", ("Jar1", "Floor1"))
            assert map.objects["Jar1"].values["PositionX"] == pytest.approx(truth.x, abs=0.002)
            assert (await at.operator.robots())["Robot1"].holding is None

    run(test())


def test_stopped_before_it_gripped_it_leaves_the_jar_alone() -> None:
    async def test() -> None:
        async with desk() as at:
            done = await at.do(Halt(order()))
            assert isinstance(done, WorkDone)
            assert (await at.operator.observe("Jar1")).support == "Table1"
            assert after(done.situation).has_fact("isOn", ("Jar1", "Table1"))

    run(test())


def test_what_was_done_is_undone() -> None:
    async def test() -> None:
        async with desk() as at:
            await at.perform(order())
            was = "Jar1 isOn Table1 AND Jar1.PositionX = 1.15 AND Jar1.PositionY = 4"
            done = await at.do(Undo(order(), was))
            assert isinstance(done, WorkDone)
            assert after(done.situation).has_fact("isOn", ("Jar1", "Table1"))
            truth = await at.operator.observe("Jar1")
            assert math.dist((truth.x, truth.y), (1.15, 4)) < 0.02
            with pytest.raises(ServiceFailed, match="does not say on what"):
                await at.do(Undo(order(), "Jar1.Color = Red"))

    run(test())


def test_it_reports_while_it_drives() -> None:
    async def test() -> None:
        async with desk(speed=2) as at:
            working = asyncio.create_task(at.do(Perform(order())))
            await asyncio.sleep(2.6)
            working.cancel()
            await asyncio.gather(working, return_exceptions=True)
            notes = [advance.note for advance in at.told]
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


def test_nothing_is_carried_to_where_nothing_can_be_put() -> None:
    async def test() -> None:
        async with desk() as at:
            with pytest.raises(Refusal, match="nothing can be put on Robot2"):
                await at.do(Quote(order(destination="Robot2")))

    run(test())
