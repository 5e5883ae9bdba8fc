"""The simulated world as made from a map: what is in it, what comes and goes, and how it fails."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from somrs.devices.simulator.link.commands import Approach, CommandDone, CommandGivenUp, DriveTo, Grip, Place
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world import physics
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.devices.simulator.world.physics import PhysicsScene
from somrs.devices.simulator.world.scene import RESTING
from somrs.devices.simulator.world.world import triangles
from somrs.errors import SimulationError, UsageError
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology
from somrs.space.solids import Role, role_of, solid_of
from tests.support.paths import ROOT
from tests.support.simulator_room import ONTOLOGY, Run, box, robot, room, shell, thing


def test_every_physical_object_of_the_map_is_in_the_world() -> None:
    scene = PhysicsScene(room(extra_objects=[Object(name="Room1", type="CuboidRoom")]), ONTOLOGY)
    assert set(scene.world.solids) == set(room().objects)
    assert scene.observe("Jar002").support == "Cupboard001"
    assert scene.observe("Robot1").support == "Floor1"
    assert scene.pose("Robot2")[:2] == (6.5, 4.5)


def test_types_bring_their_defaults() -> None:
    solid = solid_of(thing("Jar1", "Jar", 1, 2, 0), ONTOLOGY)
    assert solid is not None
    assert (solid.role, solid.radius, solid.height, solid.weight) == (Role.THING, 0.04, 0.14, 0.3)


@pytest.mark.parametrize(
    ("type", "stated", "role", "role_in_0_3"),
    [
        ("Table", None, Role.SUPPORT, Role.SUPPORT),
        ("Table", False, Role.STATIC, Role.STATIC),
        ("Furniture", None, Role.SUPPORT, Role.STATIC),
        ("Chair", None, Role.STATIC, Role.STATIC),
        ("Chair", True, Role.SUPPORT, Role.SUPPORT),
        ("Wall", True, Role.WALL, Role.WALL),
        ("Jar", True, Role.THING, Role.THING),
        ("StationaryManipulator", None, Role.SUPPORT, Role.SUPPORT),
    ],
)
def test_the_map_states_where_things_can_be_put(type: str, stated: bool | None, role: Role, role_in_0_3: Role) -> None:
    object = Object(name="It", type=type, values={} if stated is None else {"Supporting": stated})
    assert role_of(object, upper()) is role
    earlier = load_text((ROOT / "tests/data/upper-0.3.0.yaml").read_text("utf-8"), base=Ontology()).ontology
    assert role_of(object, earlier) is role_in_0_3


def test_things_stay_where_they_are_for_a_minute(world: WorldKind) -> None:
    run = Run(room(extra_objects=[thing("Carton1", "Carton", 4, 5.2, 0.74, RotationZ=0.5)]), world)
    poses_before = run.simulation.scene.pose("Carton1"), run.simulation.scene.pose("Jar002")
    run.simulation.scene.step(3000)
    poses_after = run.simulation.scene.pose("Carton1"), run.simulation.scene.pose("Jar002")
    assert np.allclose(poses_before, poses_after, atol=1e-3)


def physics_of(run: Run) -> PhysicsScene:
    assert isinstance(run.simulation.scene, PhysicsScene)
    return run.simulation.scene


def sleeping(run: Run) -> list[str]:
    scene = physics_of(run)
    return [thing for thing in scene.things() if scene.data.tree_asleep[scene.model.body_treeid[scene.model.body(thing).id]] >= 0]


def test_what_sleeps_is_as_it_would_be_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    extra_things = [thing("Jar003", "Jar", 0.4, 4.3, 0.8), thing("Carton1", "Carton", 4, 5.2, 0.74, RotationZ=0.5)]
    ends = []
    for wake in (RESTING, math.inf):
        monkeypatch.setattr(physics, "RESTING", wake)
        run = Run(room(extra_objects=extra_things))
        run.execute_all("Robot1", Grip(object="Jar003"), Place(support="Platform001"))
        run.run_for(2)
        assert sleeping(run) == (["Jar002", "Jar003", "Carton1"] if wake < math.inf else [])
        ends.append([run.simulation.observe(name) for name in ("Robot1", "Jar002", "Jar003", "Carton1")])
    for slept, awake in zip(*ends, strict=True):
        assert (slept.support, slept.held_by) == (awake.support, awake.held_by)
        assert (slept.x, slept.y, slept.z, slept.yaw) == pytest.approx((awake.x, awake.y, awake.z, awake.yaw), abs=0.002)


def test_what_sleeps_falls_when_what_it_stands_on_is_gone() -> None:
    run = Run(room())
    run.run_until(lambda: sleeping(run))
    assert run.simulation.observe("Jar002").support == "Cupboard001"
    assert "Cupboard001" in run.simulation.scene.supporters("Jar002")
    run.simulation.remove("Cupboard001")
    run.run_until(lambda: run.simulation.time > 3 and not run.simulation.busy)
    assert run.simulation.observe("Jar002").support == "Floor1"
    assert run.simulation.scene.pose("Jar002")[2] < 0.1


def test_nothing_is_busy_until_somebody_says_something(world: WorldKind) -> None:
    run = Run(room(), world)
    assert not run.simulation.busy
    run.start("Robot1", DriveTo(x=3, y=3))
    assert run.simulation.busy
    run.run_until(lambda: not run.simulation.busy)


def test_physics_that_stopped_making_sense_is_an_error() -> None:
    run = Run(room())
    joint = physics_of(run).model.joint("Jar002")
    physics_of(run).data.qvel[joint.dofadr[0]] = math.nan
    with pytest.raises(SimulationError, match="the physics diverged"):
        run.step()


def test_what_appears_while_it_runs_is_there_and_changes_nothing_else(world: WorldKind) -> None:
    run = Run(room(), world)
    run.execute_all("Robot1", Grip(object="Jar002"))
    ends = run.start("Robot1", Approach(object="Platform001"))
    run.run_for(2)
    states_before = run.simulation.state("Robot1"), run.simulation.observe("Jar002")
    run.simulation.add(thing("Cup1", "Cup", 4, 5, 0.74))
    run.simulation.add(box("Table002", "Table", (2.5, 4.5, 0), (0.8, 0.8, 0.7)))
    run.simulation.add(robot("Robot3", (7, 5.3, 2.0)))
    states_after = run.simulation.state("Robot1"), run.simulation.observe("Jar002")
    assert (states_after[0].x, states_after[0].y, states_after[0].holding) == pytest.approx(
        (states_before[0].x, states_before[0].y, "Jar002"), abs=1e-6
    )
    assert (
        math.dist((states_before[1].x, states_before[1].y, states_before[1].z), (states_after[1].x, states_after[1].y, states_after[1].z))
        < 1e-6
    )
    run.run_until(lambda: ends)
    assert isinstance(ends[0], CommandDone)
    run.execute_all("Robot1", Place(support="Table002"))
    run.execute_all("Robot3", Grip(object="Cup1"), Place(support="Platform001"))
    assert run.simulation.observe("Cup1").support == "Platform001"
    assert not run.collisions


def test_what_is_removed_is_gone(world: WorldKind) -> None:
    run = Run(room(), world)
    run.execute_all("Robot1", Grip(object="Jar002"))
    run.simulation.remove("Jar002")
    assert run.simulation.state("Robot1").holding is None
    ends = run.start("Robot2", DriveTo(x=3, y=3))
    run.step()
    run.simulation.remove("Robot2")
    assert [end.reason for end in ends if isinstance(end, CommandGivenUp)] == ["stopped"]
    run.simulation.remove("Platform001")
    run.execute_all("Robot1", DriveTo(x=6.5, y=1.5))
    with pytest.raises(UsageError, match="not in the simulated world"):
        run.simulation.observe("Jar002")


def test_somebody_can_move_a_thing(world: WorldKind) -> None:
    run = Run(room(), world)
    run.simulation.move("Jar002", 4, 5.2, 0.74)
    run.run_until(lambda: not run.simulation.busy)
    assert run.simulation.observe("Jar002").support == "Table001"
    with pytest.raises(UsageError, match="not a thing"):
        run.simulation.move("Table001", 1, 1, 0)


def test_an_empty_map_is_no_world() -> None:
    with pytest.raises(SimulationError, match="no physical object"):
        Simulation(Map(), ONTOLOGY)


@pytest.mark.parametrize(("path", "value"), [("PositionX", math.nan), ("Shape.Width", 0.0)])
def test_an_object_that_cannot_be_built_is_named(path: str, value: float) -> None:
    table = box("Table9", "Table", (1, 1, 0), (0.0, 0.0, 0.7) if path == "Shape.Width" else (1, 1, 0.7))
    broken = Object(name="Table9", type="Table", values={**table.values, path: value})
    with pytest.raises(SimulationError, match="Table9"):
        Simulation(Map([*shell(), broken]), ONTOLOGY)


def test_a_polygon_is_cut_into_triangles_of_its_area() -> None:
    outline = ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (2.0, 3.0), (2.0, 1.0), (0.0, 1.0))
    area = sum(
        abs((second[0] - first[0]) * (third[1] - first[1]) - (third[0] - first[0]) * (second[1] - first[1])) / 2
        for first, second, third in triangles(outline)
    )
    assert area == pytest.approx(8.0)


def test_robots_work_on_a_floor_with_an_outline(world: WorldKind) -> None:
    text = "0,0 6,0 6,4 3,4 3,2 0,2"
    shape: dict[str, float | str | bool] = {"Shape.Form": "Polygon", "Shape.Outline": text, "Shape.Height": 0.1}
    floor = thing("Floor1", "Floor", 0, 0, -0.1, **shape)
    run = Run(Map([floor, thing("Cup1", "Cup", 5, 3.2, 0), robot("Robot1", (1, 1, 0))]), world)
    run.execute_all("Robot1", Grip(object="Cup1"), DriveTo(x=1, y=1), Place(support="Floor1"))
    assert run.simulation.observe("Cup1").support == "Floor1"
    end = run.execute("Robot1", DriveTo(x=1, y=3.5))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "unreachable"


def test_a_cup_is_moved_in_an_office_with_a_hundred_pieces_of_furniture(world: WorldKind) -> None:
    rng = random.Random(5)
    desks = [box(f"Desk{i}", "Table", (2 + 3 * (i % 10), 8 + 3 * (i // 10), 0), (1.4, 0.7, 0.74)) for i in range(60)]
    chairs = [box(f"Chair{i}", "Chair", (2 + 3 * (i % 10), 8.8 + 3 * (i // 10), 0), (0.45, 0.45, 0.85)) for i in range(60)]
    cups = [thing(f"Cup{i}", "Cup", 2 + 3 * (i % 10) + rng.uniform(-0.5, 0.5), 8 + 3 * (i // 10), 0.74) for i in range(10)]
    floor = box("Floor1", "Floor", (16, 13, -0.1), (33, 27, 0.1))
    run = Run(Map([floor, *desks, *chairs, *cups, robot("Robot1", (5, 3, 0)), robot("Robot2", (25, 3, 0))]), world)
    run.execute_all("Robot1", Grip(object="Cup3"), Place(support="Desk5"))
    assert run.simulation.observe("Cup3").support == "Desk5"
