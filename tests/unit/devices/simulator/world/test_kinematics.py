"""The world without forces: things stand, follow hands, fall and are stacked; it agrees with the physics about what robots do."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from somrs.devices.simulator.link.commands import CommandDone, DriveTo, Grip, Open, Place, PutDown
from somrs.devices.simulator.server.poses import Table
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from tests.support.simulator_room import Run, box, robot, room, shell, thing

KINEMATIC = WorldKind.KINEMATIC


def test_the_same_work_has_the_same_outcome_in_both_worlds() -> None:
    ends = []
    for kind in WorldKind:
        run = Run(room(), kind)
        run.execute_all("Robot1", Open(object="Cupboard001"), Grip(object="Jar002"), Place(support="Table001", x=4.2, y=4.95))
        run.execute_all("Robot2", DriveTo(x=6.5, y=3.0, yaw=1.0))
        run.run_for(1.0)
        ends.append([run.simulation.observe(name) for name in ("Jar002", "Cupboard001", "Robot2")])
        table = Table(run.simulation)
        assert len(table.row()) == sum(mover.numbers for mover in table.movers)
    for pushed, moved in zip(*ends, strict=True):
        assert (pushed.support, pushed.held_by, pushed.open) == (moved.support, moved.held_by, moved.open)
        assert (pushed.x, pushed.y, pushed.z) == pytest.approx((moved.x, moved.y, moved.z), abs=0.03)


def test_what_a_robot_holds_follows_its_hand_with_what_stands_on_it() -> None:
    carton = thing("Carton1", "Carton", 4.0, 5.0, 0.74)
    run = Run(Map([*room().objects.values(), carton]), KINEMATIC)
    height = run.simulation.scene.world.solids["Carton1"].height
    run.simulation.add(thing("Cup1", "Cup", 4.01, 5.0, 0.8 + height))
    assert run.simulation.observe("Cup1").support == "Carton1"
    assert run.simulation.observe("Cup1").z == pytest.approx(0.74 + height)
    run.execute_all("Robot1", Grip(object="Carton1"))
    assert run.simulation.observe("Cup1").support == "Carton1"
    run.execute_all("Robot1", DriveTo(x=3, y=2.5), PutDown())
    carton_state, cup_state = run.simulation.observe("Carton1"), run.simulation.observe("Cup1")
    assert (carton_state.support, cup_state.support) == ("Floor1", "Carton1")
    assert math.dist((carton_state.x, carton_state.y), (3, 2.5)) < 1.0
    assert math.dist((carton_state.x, carton_state.y), (cup_state.x, cup_state.y)) == pytest.approx(0.01)
    assert cup_state.z == pytest.approx(height, abs=0.001)


def carried_stack() -> Run:
    """Robot1 carries Carton1, on which Cup1 stands."""
    run = Run(Map([*room().objects.values(), thing("Carton1", "Carton", 4.0, 5.0, 0.74)]), KINEMATIC)
    run.simulation.add(thing("Cup1", "Cup", 4.0, 5.0, 2.0))
    run.execute_all("Robot1", Grip(object="Carton1"))
    return run


def test_what_is_taken_from_a_carried_thing_follows_it_no_more() -> None:
    run = carried_stack()
    run.simulation.move("Cup1", 6.5, 1.5, 0.3)
    run.execute_all("Robot1", DriveTo(x=3, y=2.5))
    assert run.simulation.observe("Cup1").support == "Platform001"


def test_what_is_removed_from_a_carried_thing_is_gone() -> None:
    run = carried_stack()
    run.simulation.remove("Cup1")
    run.execute_all("Robot1", DriveTo(x=3, y=2.5), PutDown())
    assert [*run.simulation.scene.things()] == ["Jar002", "Carton1"]


def test_what_is_put_on_a_carried_thing_follows_it() -> None:
    run = carried_stack()
    x, y, z, _ = run.simulation.scene.pose("Carton1")
    run.simulation.add(thing("Cup2", "Cup", x, y, z + 1.0))
    run.simulation.move("Jar002", x, y, z + 1.0)
    run.execute_all("Robot1", DriveTo(x=3, y=2.5))
    assert run.simulation.observe("Cup2").support == "Cup1"
    assert run.simulation.observe("Jar002").support == "Cup2"


def test_a_stack_of_thin_things_stays_as_it_is() -> None:
    run = Run(room(), KINEMATIC)
    for name in ("Plate1", "Plate2", "Plate3"):
        run.simulation.add(thing(name, "Cup", 4.0, 5.0, 1.0, **{"Shape.Height": 0.008}))
    run.simulation.move("Jar002", 6.5, 1.5, 0.3)
    plates = [run.simulation.observe(name) for name in ("Plate1", "Plate2", "Plate3")]
    assert [plate.support for plate in plates] == ["Table001", "Plate1", "Plate2"]
    assert [plate.z for plate in plates] == pytest.approx([0.74, 0.748, 0.756])


def test_things_fall_to_what_is_below_them() -> None:
    cupboard = box("Cupboard9", "Cupboard", (2.0, 5.5, 0), (0.5, 1.2, 0.8), RotationZ=-math.pi / 2, Open=True)
    things = [thing("High", "Cup", 4.0, 5.2, 1.5), thing("Inside", "Cup", 2.0, 5.5, 0.2), thing("Nowhere", "Cup", 30.0, 5.0, 0.4)]
    run = Run(room(extra_objects=[cupboard, *things]), KINEMATIC)
    assert run.simulation.observe("High").support == "Table001"
    assert run.simulation.observe("Inside").container == "Cupboard9"
    assert run.simulation.observe("Nowhere").support is None
    run.simulation.remove("Table001")
    assert (run.simulation.observe("High").support, run.simulation.observe("High").z) == ("Floor1", 0.0)
    run.simulation.move("High", 6.5, 1.5, 2.0)
    assert run.simulation.observe("High").support == "Platform001"


def test_only_what_moves_is_moved() -> None:
    run = Run(room(), KINEMATIC)
    table = Table(run.simulation)
    row_before = table.row()
    ends = run.start("Robot1", DriveTo(x=3, y=2))
    run.run_until(lambda: ends)
    assert isinstance(ends[0], CommandDone)
    moved = table.flag_movers(np.abs(table.row() - row_before) > 1e-9)
    assert [mover.name for mover, flag in zip(table.movers, moved, strict=True) if flag] == ["Robot1"]
    assert table.edition == run.simulation.scene.edition
    run.simulation.add(thing("Cup1", "Cup", 4, 5, 0.74))
    assert table.edition != run.simulation.scene.edition


def test_robots_of_all_speeds_drive_round_corners_without_collisions() -> None:
    walls = [box(f"Wall{n}", "Wall", (2.0 + 2 * n, 2.0 + 2 * (n % 2), 0), (0.1, 4.0, 2.5)) for n in range(3)]
    robots = [robot(f"Robot{n}", (0.7, 0.7 + 0.9 * n, 0.0), speed=0.4 + 0.6 * n) for n in range(3)]
    run = Run(Map([*shell(), *walls, *robots]), KINEMATIC)
    ends = [run.start(f"Robot{n}", DriveTo(x=7.3, y=0.7 + 0.9 * n)) for n in range(3)]
    run.run_until(lambda: all(ends))
    for n, (end,) in enumerate(ends):  # those that have arrived make room for the others
        assert isinstance(end, CommandDone)
        assert math.dist((end.state.x, end.state.y), (7.3, 0.7 + 0.9 * n)) < 0.02
    assert not run.collisions


def test_a_world_without_mujoco() -> None:
    """A process with a kinematic world does not load MuJoCo, unless it draws pictures."""
    program = """
import sys
from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support.simulator_room import ONTOLOGY, room
simulation = Simulation(room(), ONTOLOGY, WorldKind.KINEMATIC)
simulation.step()
assert "mujoco" not in sys.modules
"""
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_an_object_that_takes_no_space_is_no_body() -> None:
    run = Run(room(), KINEMATIC)
    run.simulation.add(Object(name="Room1", type="CuboidRoom"))
    assert "Room1" not in run.simulation.scene.world.solids
