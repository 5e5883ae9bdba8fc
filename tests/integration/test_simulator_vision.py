"""What cameras see: in range, in their field of view, hidden by nothing; and how robots look for something."""

from __future__ import annotations

import math

import pytest

from somrs.devices.simulator.link.commands import (
    CommandDone,
    CommandGivenUp,
    DriveTo,
    Fault,
    Grip,
    Likeness,
    LookAround,
    LookAt,
    ObjectState,
    Sense,
)
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.devices.simulator.world.vision import view
from somrs.ontology.objects import Object
from somrs.ontology.types import Value
from tests.support.simulator_room import Run, box, robot, room, thing

PATROL = robot("Patrol1", (2.5, 2.5, 0.0), type="PatrolRobot")


def hung(x: float, y: float, z: float, turned: float, **values: Value) -> Object:
    return thing("Camera1", "Camera", x, y, z, RotationZ=turned, **values)


def sense_objects(run: Run, viewer: str, radius: float | None = None) -> dict[str, ObjectState]:
    """What the camera has in view, as it truly is."""
    return {state.object: state for state in view(run.simulation.scene, viewer, radius)}


def test_things_are_recognised_by_their_looks_and_not_by_name(world: WorldKind) -> None:
    run = Run(room(extra_objects=[hung(0.1, 5.9, 2.3, -0.8, OperationRange=6, Accuracy=0.004)]), world)
    result = run.execute("Camera1", Sense(like=Likeness(type="Graspable")))
    assert isinstance(result, CommandDone)
    (jar,) = [sighting for sighting in result.sightings if sighting.alike]
    truth = run.simulation.observe("Jar002")
    assert (jar.type, jar.support, jar.values["Shape.Form"]) == ("Jar", "Cupboard001", "Cylinder")
    assert (jar.x, jar.y, jar.z) == pytest.approx((truth.x, truth.y, truth.z), abs=0.02)
    assert (jar.x, jar.y, jar.z) != (truth.x, truth.y, truth.z), "a camera measures with noise"
    assert not {"Jar002", "Robot1"} & {state.object for state in result.object_states}
    again = run.execute("Camera1", Sense(like=Likeness(type="Graspable")))
    assert isinstance(again, CommandDone)
    assert again.sightings == result.sightings, "the same moment gives the same noise"


def test_a_camera_sees_what_is_in_range_and_in_its_field_of_view(world: WorldKind) -> None:
    # From the north-west corner, over the cupboard, it looks to the south-east.
    run = Run(room(extra_objects=[hung(0.1, 5.9, 2.3, -0.8, OperationRange=6)]), world)
    sightings = sense_objects(run, "Camera1")
    assert {"Jar002", "Robot1"} < set(sightings)
    assert sightings["Jar002"].support == "Cupboard001"
    assert (sightings["Jar002"].x, sightings["Jar002"].y) == pytest.approx((0.43, 3.9), abs=0.005)
    assert "Platform001" not in sightings, "it is 8 m away"
    for turned, is_visible in ((-0.8, True), (2.3, False)):
        turned_run = Run(room(extra_objects=[hung(0.1, 5.9, 2.3, turned, OperationRange=6)]), world)
        assert ("Jar002" in sense_objects(turned_run, "Camera1")) is is_visible
    level = Run(room(extra_objects=[hung(1.2, 3.9, 2.2, math.pi, RotationY=0)]), world)
    assert "Jar002" not in sense_objects(level, "Camera1"), "it is below what a camera sees that looks straight ahead"
    assert "Jar002" in sense_objects(Run(room(extra_objects=[hung(1.2, 3.9, 2.2, math.pi, RotationY=1)]), world), "Camera1")


def test_walls_and_furniture_hide_things(world: WorldKind) -> None:
    screen = box("Wall9", "Wall", (1.8, 3.9, 0), (0.1, 2, 2.5))
    assert "Jar002" in sense_objects(Run(room(first_start=(3, 3.9, math.pi)), world), "Robot1")
    assert "Jar002" not in sense_objects(Run(room(first_start=(3, 3.9, math.pi), extra_objects=[screen]), world), "Robot1")
    cup = thing("Cup1", "Cup", 6.5, 2.1, 0.0)
    rear_run = Run(room(extra_objects=[cup, hung(6.5, 0.1, 0.5, math.pi / 2, RotationY=0)]), world)
    assert "Cup1" not in sense_objects(rear_run, "Camera1"), "the platform is before it"
    top_run = Run(room(extra_objects=[cup, hung(6.5, 0.1, 2.4, math.pi / 2, RotationY=0.8)]), world)
    assert "Cup1" in sense_objects(top_run, "Camera1")


def test_what_a_robot_holds_is_seen_in_its_hand(world: WorldKind) -> None:
    run = Run(room(extra_objects=[hung(0.1, 5.9, 2.3, -0.8)]), world)
    run.execute_all("Robot1", Grip(object="Jar002"), DriveTo(x=2, y=4))
    sightings = sense_objects(run, "Camera1")
    assert (sightings["Jar002"].held_by, sightings["Jar002"].support) == ("Robot1", None)
    assert sightings["Robot1"].held_by is None
    robot = run.simulation.state("Robot1")
    assert (sightings["Robot1"].x, sightings["Robot1"].y, sightings["Robot1"].yaw) == pytest.approx((robot.x, robot.y, robot.yaw), abs=1e-6)
    run.simulation.fault("Robot1", Fault.SILENT)
    assert sense_objects(run, "Camera1")["Jar002"].held_by == "Robot1", "a robot need not speak to be seen"


def test_a_camera_takes_no_other_commands(world: WorldKind) -> None:
    run = Run(room(extra_objects=[hung(0.1, 5.9, 2.3, -0.8)]), world)
    end = run.execute("Camera1", DriveTo(x=1, y=1))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "not-possible"
    assert not run.simulation.busy


def test_a_robot_goes_where_it_can_see_a_place_and_stops_when_it_sees_the_thing(world: WorldKind) -> None:
    screen = box("Wall9", "Wall", (1.8, 3.9, 0), (0.1, 2, 2.5))
    run = Run(room(extra_objects=[screen, robot("Patrol1", (5, 4, 0), type="PatrolRobot")]), world)
    assert "Jar002" not in sense_objects(run, "Patrol1")
    result = run.execute("Patrol1", LookAt(x=0.43, y=3.9, z=0.9, like=Likeness(type="Jar")))
    assert isinstance(result, CommandDone)
    assert [sighting.type for sighting in result.sightings if sighting.alike] == ["Jar"]
    assert not run.collisions
    for _ in range(50):
        run.simulation.step()
    later = run.simulation.state("Patrol1")
    assert (later.x, later.y) == pytest.approx((result.state.x, result.state.y), abs=1e-3), "it stands still when it reports"
    start = run.simulation.time
    second_result = run.execute("Patrol1", LookAt(x=7.5, y=5.5, z=0.3, like=Likeness(type="Jar")))
    assert isinstance(second_result, CommandDone)
    assert run.simulation.time - start < 2, "it sees the jar already, and need not drive to the other corner"


def test_turning_about_it_sees_all_around(world: WorldKind) -> None:
    run = Run(room(extra_objects=[PATROL]), world)
    ahead = sense_objects(run, "Patrol1")
    assert "Cupboard001" not in ahead, "that is behind it"
    result = run.execute("Patrol1", LookAround())
    assert isinstance(result, CommandDone)
    assert {"Cupboard001", "Platform001", "Table001"} <= {state.object for state in result.object_states}
    assert {"Jar", "PioneerP3DX"} <= {sighting.type for sighting in result.sightings}
    state = run.simulation.state("Patrol1")
    assert (state.x, state.y) == pytest.approx((2.5, 2.5), abs=0.02)


def test_what_cannot_be_seen_from_anywhere_is_given_up(world: WorldKind) -> None:
    run = Run(room(extra_objects=[PATROL]), world)
    end = run.execute("Patrol1", LookAt(x=20, y=20, z=0.5))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "unreachable"
    run.simulation.fault("Patrol1", Fault.DRIVE)
    end = run.execute("Patrol1", LookAt(x=6, y=5.5, z=0.5))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "drive-dead"


def test_cameras_come_and_go(world: WorldKind) -> None:
    run = Run(room(), world)
    run.simulation.add(hung(0.1, 5.9, 2.3, -0.8))
    assert "Jar002" in sense_objects(run, "Camera1")
    run.simulation.remove("Camera1")
    assert "Camera1" not in run.simulation.linked
