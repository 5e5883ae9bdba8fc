"""What robots do with things in the simulator, and what becomes of the things when robots break."""

from __future__ import annotations

import math
import random

import pytest

from somrs.devices.simulator.link.commands import Approach, CommandDone, CommandGivenUp, DriveTo, Fault, Grip, Place, PutDown, Sense, Stop
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from tests.support.simulator_room import Run, box, robot, room, shell, thing

TRANSFER = (Approach(object="Jar002"), Grip(object="Jar002"), Approach(object="Platform001"), Place(support="Platform001"))


def test_a_robot_carries_the_jar_to_the_platform(world: WorldKind) -> None:
    run = Run(room(), world)
    run.execute_all("Robot1", *TRANSFER)
    jar_sighting = run.simulation.observe("Jar002")
    assert jar_sighting.support == "Platform001"
    assert abs(jar_sighting.z - 0.3) < 0.005
    assert run.simulation.scene.upright("Jar002")
    assert not run.collisions
    assert run.simulation.state("Robot1").holding is None


def test_what_is_held_is_on_nothing(world: WorldKind) -> None:
    run = Run(room(), world)
    run.execute_all("Robot1", Grip(object="Jar002"))
    assert run.simulation.state("Robot1").holding == "Jar002"
    assert run.simulation.observe("Jar002").support is None


@pytest.mark.parametrize("seed", range(4))
def test_a_jar_that_a_broken_robot_put_down_is_taken_on_by_another(seed: int, world: WorldKind) -> None:
    chance = random.Random(seed)
    run = Run(room((chance.uniform(1.5, 2.5), chance.uniform(0.5, 2.5), chance.uniform(-3, 3))), world)
    run.execute_all("Robot1", *TRANSFER[:2])
    ends = run.start("Robot1", TRANSFER[2])
    fault_time = run.simulation.time + chance.uniform(0.3, 8)
    run.run_until(lambda: run.simulation.time > fault_time)
    run.simulation.fault("Robot1", Fault.DRIVE)
    run.step()
    run.step()
    x, y = run.simulation.state("Robot1").x, run.simulation.state("Robot1").y
    run.run_until(lambda: ends)
    end, jar = ends[0], run.simulation.observe("Jar002")
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "drive-dead"
    assert end.state.holding is None
    assert [(sighting.object, sighting.support) for sighting in end.object_states if sighting.object == "Jar002"] == [("Jar002", "Floor1")]
    assert abs(jar.z) < 0.005
    assert run.simulation.scene.upright("Jar002")
    assert abs(end.state.x - x) + abs(end.state.y - y) < 0.02, "the dead robot rolled on"
    run.execute_all("Robot2", *TRANSFER)
    assert run.simulation.observe("Jar002").support == "Platform001"
    assert not run.collisions


THINGS = [
    thing("Bottle1", "Bottle", 7.5, 4.2, 1.08),
    thing("Carton1", "Carton", 4.2, 5.0, 0.74, RotationZ=0.6),
    thing("Cup1", "Cup", 3.0, 3.0, 0.0),
    thing("Can1", "Can", 0.9, 1.3, 0.1),
]
SUPPORTS = [
    box("Counter", "Cupboard", (7.6, 4, 0), (0.6, 2, 1.08)),
    box("Low", "Platform", (1, 1.2, 0), (0.6, 0.6, 0.1)),
    box("High", "Shelf", (2, 5.6, 0), (1, 0.6, 1.2)),
    thing("Spot", "Place", 5.5, 3.5, 0),
]


@pytest.mark.parametrize(
    ("name", "support"), [("Bottle1", "Low"), ("Can1", "High"), ("Cup1", "Counter"), ("Carton1", "Floor1"), ("Jar002", "Spot")]
)
def test_things_of_all_forms_go_to_all_heights(name: str, support: str, world: WorldKind) -> None:
    run = Run(room((2.5, 2, 0), (5.5, 4.5, 3.1), [*SUPPORTS, *THINGS]), world)
    run.execute_all("Robot1", Grip(object=name), Place(support=support))
    assert run.simulation.observe(name).support == support
    assert run.simulation.scene.upright(name)


def test_a_thing_is_put_just_where_it_was_wanted(world: WorldKind) -> None:
    run = Run(room(), world)
    run.execute_all("Robot1", Grip(object="Jar002"), Place(support="Table001", x=4.2, y=4.95))
    jar_sighting = run.simulation.observe("Jar002")
    assert abs(jar_sighting.x - 4.2) < 0.02
    assert abs(jar_sighting.y - 4.95) < 0.02


def test_put_down_works_with_a_dead_drive(world: WorldKind) -> None:
    run = Run(room(), world)
    run.execute_all("Robot1", Grip(object="Jar002"))
    run.simulation.fault("Robot1", Fault.DRIVE)
    run.run_until(lambda: not run.simulation.busy)
    assert run.simulation.state("Robot1").holding is None
    assert run.simulation.scene.upright("Jar002")
    end = run.execute("Robot1", DriveTo(x=4, y=3))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "drive-dead"
    assert "Jar002" in [sighting.object for sighting in end.object_states], "where the jar was left is said with the next answer"


def test_put_down_leaves_the_thing_right_here(world: WorldKind) -> None:
    run = Run(room(), world)
    run.execute_all("Robot1", Grip(object="Jar002"), DriveTo(x=3, y=2.5), PutDown())
    jar_sighting = run.simulation.observe("Jar002")
    assert jar_sighting.support == "Floor1"
    assert abs(jar_sighting.x - 3) + abs(jar_sighting.y - 2.5) < 1.0


def test_a_stuck_gripper_is_said_and_keeps_what_it_holds(world: WorldKind) -> None:
    run = Run(room(), world)
    run.simulation.fault("Robot1", Fault.GRIPPER)
    end = run.execute("Robot1", Grip(object="Jar002"))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "gripper-stuck"
    run.simulation.repair("Robot1", Fault.GRIPPER)
    run.execute_all("Robot1", Grip(object="Jar002"))
    run.simulation.fault("Robot1", Fault.GRIPPER)
    end = run.execute("Robot1", Place(support="Platform001"))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "gripper-stuck"
    assert end.state.holding == "Jar002"


def test_a_silent_robot_stops_and_never_answers(world: WorldKind) -> None:
    run = Run(room(), world)
    ends = run.start("Robot1", DriveTo(x=6, y=3))
    run.run_for(4)
    run.simulation.fault("Robot1", Fault.SILENT)
    run.run_for(0.2)
    state_before = run.simulation.state("Robot1")
    run.run_for(4)
    state_after = run.simulation.state("Robot1")
    assert abs(state_after.x - state_before.x) + abs(state_after.y - state_before.y) < 1e-3
    assert ends == []
    assert not run.simulation.busy


def test_stopped_with_its_fingers_on_a_jar_it_lets_go_before_it_leaves(world: WorldKind) -> None:
    run = Run(room(), world)
    robot, scene = run.simulation.robots["Robot1"], run.simulation.scene
    run.execute_all("Robot1", Approach(object="Jar002"))
    run.start("Robot1", Grip(object="Jar002"))
    run.run_until(lambda: len(scene.touching_fingers("Robot1", "Jar002")) == 2)
    assert robot.holding is None
    run.execute_all("Robot1", Stop(), DriveTo(x=4, y=2))
    assert run.simulation.observe("Jar002").support == "Cupboard001"
    run.execute_all("Robot1", Grip(object="Jar002"), Place(support="Platform001"))
    assert run.simulation.observe("Jar002").support == "Platform001"


def test_stop_ends_the_running_command(world: WorldKind) -> None:
    run = Run(room(), world)
    ends = run.start("Robot1", DriveTo(x=6, y=3))
    run.run_for(2)
    stopped = run.execute("Robot1", Stop())
    assert isinstance(stopped, CommandDone)
    assert [end.reason for end in ends if isinstance(end, CommandGivenUp)] == ["stopped"]
    run.run_until(lambda: not run.simulation.busy, limit=2)
    now = run.simulation.state("Robot1")
    assert math.dist((now.x, now.y), (stopped.state.x, stopped.state.y)) < 0.003, "it says where it came to a stand"


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (Grip(object="Nothing"), "unknown-object"),
        (Grip(object="Table001"), "not-possible"),
        (Place(support="Table001"), "not-holding"),
        (PutDown(), "not-holding"),
        (Approach(object="Nothing"), "unknown-object"),
        (DriveTo(x=40, y=3), "unreachable"),
    ],
)
def test_what_cannot_be_done_is_given_up_with_a_reason(command: Grip, reason: str, world: WorldKind) -> None:
    end = Run(room(), world).execute("Robot1", command)
    assert isinstance(end, CommandGivenUp)
    assert end.reason == reason
    assert end.description


def test_a_full_top_has_no_space(world: WorldKind) -> None:
    tiny = box("Tiny", "Table", (4, 2, 0), (0.2, 0.2, 0.5))
    run = Run(room(extra_objects=[tiny, thing("Cup1", "Cup", 4, 2, 0.5)]), world)
    run.execute_all("Robot1", Grip(object="Jar002"))
    end = run.execute("Robot1", Place(support="Tiny"))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "no-space"
    assert end.state.holding == "Jar002"


def test_a_robot_without_a_gripper_drives_but_carries_nothing(world: WorldKind) -> None:
    run = Run(room(extra_objects=[robot("Cart1", (4, 2, 0), type="MobileRobot")]), world)
    run.execute_all("Cart1", DriveTo(x=5, y=3))
    end = run.execute("Cart1", Grip(object="Jar002"))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "not-possible"


def test_sensing_sees_what_nothing_hides(world: WorldKind) -> None:
    screen = box("Screen", "Wall", (4, 3, 0), (0.1, 3, 2))
    objects: list[Object] = [*shell(), screen, robot("Robot1", (2, 3, 0)), thing("Near", "Cup", 3, 3, 0), thing("Far", "Cup", 6, 3, 0)]
    run = Run(Map(objects), world)
    end = run.execute("Robot1", Sense(radius=10))
    assert isinstance(end, CommandDone)
    [sighting] = end.sightings
    assert (sighting.type, sighting.support) == ("Cup", "Floor1")
    assert sighting.x == pytest.approx(3, abs=0.1)
