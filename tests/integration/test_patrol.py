"""Devices that look where a thing is: a robot that patrols, a camera that hangs, and what they say of it."""

from __future__ import annotations

import asyncio
import math
import re
import textwrap
import time

import pytest

from somrs.deployment.device import load
from somrs.devices.simulator.link.commands import Fault
from somrs.ontology.files.loading import load_text, upper
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.knowledge import Updated, UpdateMap
from somrs.protocol.messages.observations import Observation, observed_at
from somrs.service_manager import Device
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.orders import Halt, Order, Perform, Quote, Quoted, Refusal, ServiceFailed, Undo, WorkDone
from tests.support.observation_lab import SITE, carry_order, lab, look_order, map_after
from tests.support.paths import ROOT
from tests.support.robot_lab import run
from tests.support.virtual_devices import make_ask


def test_a_patrol_finds_a_jar_that_stands_where_it_was_and_measures_it() -> None:
    async def test() -> None:
        async with lab() as harness:
            patrol = await harness.open("Patrol1")
            situation = await harness.recognize(patrol, "Jar1")
            truth = await harness.operator.observe("Jar1")
            map = map_after(situation)
            assert map.has_fact("isOn", ("Jar1", "Table1"))
            values = map.objects["Jar1"].values
            assert values["Unknown"] is False
            assert [values[f"Position{axis}"] for axis in "XYZ"] == pytest.approx([truth.x, truth.y, truth.z], abs=0.03), (
                "as far as a camera can tell"
            )
            robot = (await harness.operator.robots())["Patrol1"]
            assert (map.objects["Patrol1"].values["PositionX"], map.objects["Patrol1"].values["PositionY"]) == (
                round(robot.x, 3),
                round(robot.y, 3),
            )
            assert math.dist((robot.x, robot.y), (8, 5)) > 1, "it had to drive, the wall is between them"
            assert any("looks for Jar1 at the last known position of Jar1" in advance.note for advance in harness.advances)

    run(test())


@pytest.mark.parametrize(
    ("x", "y", "z", "support"),
    [
        (8.2, 0.6, 0.9, "Shelf1"),
        (11.5, 0.5, 0.0, "Floor1"),
        (6.3, 0.3, 0.0, "Floor1"),
        (3.0, 3.0, 0.0, "Floor1"),
    ],
)
def test_a_patrol_finds_a_jar_that_was_taken_elsewhere(x: float, y: float, z: float, support: str) -> None:
    async def test() -> None:
        async with lab() as harness:
            patrol = await harness.open("Patrol1")
            await harness.operator.move("Jar1", x, y, z)
            map = map_after(await harness.recognize(patrol, "Jar1"))
            assert map.has_fact("isOn", ("Jar1", support))
            assert not map.has_fact("isOn", ("Jar1", "Table1"))
            assert map.objects["Jar1"].values["PositionX"] == pytest.approx(x, abs=0.01)

    run(test())


def test_a_jar_in_the_hand_of_a_silent_robot_is_found_there() -> None:
    async def test() -> None:
        async with lab() as harness:
            patrol, robot = await harness.open("Patrol1"), await harness.open("Robot1", silence=1.5)
            await harness.operator.schedule("Robot1", Fault.SILENT, carried=3.0)
            with pytest.raises(ServiceFailed, match="sent nothing"):
                await harness.run_task(robot, Perform(carry_order("Jar1", "Platform1")))
            truth = (await harness.operator.robots())["Robot1"]
            map = map_after(await harness.recognize(patrol, "Jar1"))
            assert map.has_fact("isHeldBy", ("Jar1", "Robot1"))
            assert not map.has_fact("isOn", ("Jar1", "Table1"))
            robot_now = map.objects["Robot1"].values
            assert (robot_now["PositionX"], robot_now["PositionY"]) == pytest.approx((truth.x, truth.y), abs=0.03)
            assert math.dist((truth.x, truth.y), (2, 1.5)) > 1, "and that is not where the map had it"
            of_robot = map_after(await harness.recognize(patrol, "Robot1"))
            assert of_robot.has_fact("isHeldBy", ("Jar1", "Robot1")), "who looks at the robot sees what it holds"
            assert of_robot.objects["Robot1"].values["Unknown"] is False

    run(test())


def test_a_patrol_that_finds_nothing_says_where_it_looked() -> None:
    async def test() -> None:
        async with lab() as harness:
            patrol = await harness.open("Patrol1")
            harness.server.simulation.remove("Jar1")
            with pytest.raises(ServiceFailed) as failed:
                await harness.run_task(patrol, Perform(look_order("Jar1")))
            description = failed.value.description
            assert description.startswith("Patrol1 did not find Jar1; it searched the last known position of Jar1")
            assert all(name in description for name in ("Table1", "Shelf1", "Platform1", "Robot1"))
            robot = (await harness.operator.robots())["Patrol1"]
            map = map_after(failed.value.situation)
            assert map.objects["Patrol1"].values["PositionX"] == pytest.approx(robot.x, abs=0.002)
            assert "Unknown" not in map.objects["Jar1"].values, "nothing is claimed of the jar"

    run(test())


def test_a_patrol_that_breaks_says_so() -> None:
    async def test() -> None:
        async with lab() as harness:
            patrol = await harness.open("Patrol1")
            await harness.operator.schedule("Patrol1", Fault.DRIVE, delay=3.0)
            with pytest.raises(ServiceFailed, match="drive of Patrol1 is dead") as failed:
                await harness.run_task(patrol, Perform(look_order("Jar1")))
            assert map_after(failed.value.situation).objects["Patrol1"].values["Working"] is False
            with pytest.raises(Refusal, match="drive is dead"):
                await harness.run_task(patrol, Quote(look_order("Jar1")))

    run(test())


def test_a_patrol_quotes_by_the_way_and_does_not_look_at_itself() -> None:
    async def test() -> None:
        async with lab() as harness:
            patrol = await harness.open("Patrol1", price_per_metre=1.0)
            far_quote, near_quote = (
                await harness.run_task(patrol, Quote(look_order("Jar1"))),
                await harness.run_task(patrol, Quote(look_order("Platform1"))),
            )
            assert isinstance(far_quote, Quoted)
            assert isinstance(near_quote, Quoted)
            assert far_quote.price > near_quote.price > 3
            assert far_quote.duration > near_quote.duration
            start_time = (await harness.operator.clock()).time
            await harness.recognize(patrol, "Jar1")
            assert (await harness.operator.clock()).time - start_time < 2 * far_quote.duration
            with pytest.raises(Refusal, match="cannot look at itself"):
                await harness.run_task(patrol, Quote(look_order("Patrol1")))

    run(test())


def test_a_patrol_that_is_stopped_stands_and_one_that_is_undone_has_nothing_to_undo() -> None:
    async def test() -> None:
        async with lab(speed=10) as harness:
            patrol = await harness.open("Patrol1")
            working = asyncio.create_task(harness.run_task(patrol, Perform(look_order("Jar1"))))
            while not harness.advances:
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.2)
            working.cancel()
            await asyncio.gather(working, return_exceptions=True)
            result = await harness.run_task(patrol, Halt(look_order("Jar1")))
            assert isinstance(result, WorkDone)
            stopped = map_after(result.situation).objects["Patrol1"].values
            await asyncio.sleep(0.3)
            robot = (await harness.operator.robots())["Patrol1"]
            assert robot.activity is None
            assert (stopped["PositionX"], stopped["PositionY"]) == pytest.approx((robot.x, robot.y), abs=0.3)
            (capability,) = [capability for capability in patrol.profile().capabilities if capability.method == "recognize"]
            assert capability.undoable, "else a Service Manager would report it as stranded"
            undone = await harness.run_task(patrol, Undo(look_order("Jar1"), "Jar1.Unknown = TRUE"))
            assert isinstance(undone, WorkDone)
            assert "Jar1" not in str(undone.situation)

    run(test())


def test_a_camera_says_where_a_thing_is_that_it_sees_and_refuses_what_it_does_not() -> None:
    async def test() -> None:
        async with lab() as harness:
            camera = await harness.open("Camera1")
            with pytest.raises(Refusal, match="Camera1 does not see Jar1"):
                await harness.run_task(camera, Quote(look_order("Jar1")))
            await harness.operator.move("Jar1", 10.4, 4.1, 0.3)
            await harness.operator.idle()
            quoted = await harness.run_task(camera, Quote(look_order("Jar1")))
            assert isinstance(quoted, Quoted)
            assert quoted.price == 1
            map = map_after(await harness.recognize(camera, "Jar1"))
            assert map.has_fact("isOn", ("Jar1", "Platform1"))
            assert map.objects["Jar1"].values["PositionX"] == pytest.approx(10.4, abs=0.01)
            await harness.operator.move("Jar1", 1.1, 4, 0.7)
            with pytest.raises(ServiceFailed, match="no longer sees Jar1"):
                await harness.run_task(camera, Perform(look_order("Jar1")))
            await harness.operator.fault("Camera1", Fault.SILENT)
            with pytest.raises(Refusal, match="does not answer"):
                await harness.run_task(camera, Quote(look_order("Platform1")))

    run(test())


def test_a_robot_that_fell_silent_is_said_to_have_failed_and_nothing_is_claimed_of_the_thing() -> None:
    async def test() -> None:
        async with lab() as harness:
            robot = await harness.open("Robot1", silence=1.5)
            await harness.operator.schedule("Robot1", Fault.SILENT, carried=1.0)
            with pytest.raises(ServiceFailed, match="has sent nothing") as failed:
                await harness.run_task(robot, Perform(carry_order("Jar1", "Platform1")))
            assert failed.value.situation == "Robot1.Working = FALSE"

    run(test())


def test_the_documentation_shows_how_to_offer_it_oneself() -> None:
    page = (ROOT / "docs" / "how-to" / "cognitive-services.md").read_text()
    (python,) = [block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "LabelReader" in block]
    names: dict[str, object] = {}
    exec(python, names)
    kind = names["LabelReader"]
    assert isinstance(kind, type)
    assert issubclass(kind, Device)

    async def test() -> None:
        async with lab() as harness:
            device = kind("Reader1")
            assert await harness.run_task(device, Quote(look_order("Jar1"))) == Quoted(price=1.0, duration=1.0)
            assert map_after(await harness.recognize(device, "Jar1")).has_fact("isOn", ("Jar1", "Table1"))
            with pytest.raises(Refusal, match="does not read the label of Jar2"):
                await harness.run_task(device, Quote(look_order("Jar2")))

    run(test())


def test_what_the_documentation_puts_on_a_map_is_a_map() -> None:
    page = (ROOT / "docs" / "how-to" / "cognitive-services.md").read_text()
    (text,) = [block for block in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL) if "Anna" in block]
    site = SITE.replace("Patrol1", "Patrol9").replace("facts:", textwrap.indent(text, "  ") + "facts:")
    loaded = load_text(site, base=upper())
    assert loaded.map is not None
    drivers = {name: loaded.ontology.driver(loaded.map.objects[name].type) for name in ("Patrol1", "Camera001", "Anna")}
    assert all(load(driver or "").__name__ in ("PatrolRobot", "FixedCamera", "Person") for driver in drivers.values())


@pytest.mark.parametrize("name", ["Camera1", "Patrol1"])
def test_what_happens_after_the_picture_is_newer_than_what_it_shows(name: str) -> None:
    async def test() -> None:
        async with lab() as harness:
            device = await harness.open(name)
            await harness.operator.move("Jar1", 10.5, 4.0, 0.3)
            ask = make_ask(harness.repository, time.time)

            async def ask_while_a_robot_takes_the_jar(body: Body) -> Body:
                answer = await ask(body)
                if isinstance(body, UpdateMap):
                    taken = Observation(as_of=time.time(), caused=True)
                    assert isinstance(await ask(UpdateMap(situation="Jar1 isHeldBy Robot1", observation=taken)), Updated)
                return answer

            device.map = MapReader(ask_while_a_robot_takes_the_jar)
            done = await harness.run_task(device, Perform(look_order("Jar1")))
            assert isinstance(done, WorkDone)
            assert done.situation is not None
            assert "Jar1 isOn Platform1" in done.situation
            result = UpdateMap(situation=done.situation, observation=observed_at(done.observation, time.time()))
            assert isinstance(await ask(result), Updated)
            assert harness.repository.contents.map.has_fact("isHeldBy", ("Jar1", "Robot1"))

    run(test())


@pytest.mark.parametrize("name", ["Camera1", "Patrol1"])
def test_a_look_at_a_place_says_when_the_picture_was_taken(name: str) -> None:
    async def test() -> None:
        async with lab() as harness:
            device = await harness.open(name)
            began = time.time()
            order = Order(
                participant="p", method="look_at_place", inputs={"Place": "Platform1"}, effect="?Thing isOn Platform1", transaction="t"
            )
            done = await harness.run_task(device, Perform(order))
            assert isinstance(done, WorkDone)
            assert done.observation is not None
            assert done.observation.as_of is not None
            assert began <= done.observation.as_of <= time.time()

    run(test())
