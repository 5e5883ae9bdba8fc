"""Robots work from where they get to: the nearest stand may be behind a wall, or a shut door."""

from __future__ import annotations

import pytest

from somrs.devices.simulator.link.commands import Approach, CommandDone, LookAt, Open
from somrs.devices.simulator.link.lines import HANDLES
from somrs.devices.simulator.server.driving_distances import find_legs
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.map import Map
from tests.support.simulator_room import Run, box, robot, shell, thing

DOOR = "Door001"
HATCH = (4.5, 3.0)
"""The middle of a hatch in the wall of a closet."""


def closet(*, door: bool = False) -> Map:
    """A closet of 1.5 m by 3 m without an open door, in the middle of a room. In a hatch on its east side is a table, or a shut door. The
    robot is west of it, so that the stands in the closet are the nearest."""
    x, y = HATCH
    walls = [
        box("ClosetW", "Wall", (x - 1.5, y, 0), (0.1, 3.1, 2.5)),
        box("ClosetN", "Wall", (x - 0.75, y + 1.5, 0), (1.4, 0.1, 2.5)),
        box("ClosetS", "Wall", (x - 0.75, y - 1.5, 0), (1.4, 0.1, 2.5)),
        box("ClosetEN", "Wall", (x, y + 1.0, 0), (0.1, 1.1, 2.5)),
        box("ClosetES", "Wall", (x, y - 1.0, 0), (0.1, 1.1, 2.5)),
    ]
    table = box("Table001", "Table", (x, y, 0), (0.5, 0.88, 0.74)), thing("Jar001", "Jar", x, y, 0.74)
    closing = [box(DOOR, "Door", (x, y, 0), (0.1, 0.88, 2.1), Open=False)] if door else table
    return Map([*shell(), *walls, *closing, robot("Robot1", (1.5, 3.0, 0.0))])


@pytest.mark.parametrize("target", ["Jar001", "Table001"])
def test_a_robot_goes_to_the_side_of_a_table_that_it_can_get_to(target: str, world: WorldKind) -> None:
    run = Run(closet(), world)
    (quote,) = find_legs(run.simulation, "Robot1", (target,)).lengths
    assert quote is not None
    ends = run.start("Robot1", Approach(object=target))
    run.run_until(lambda: bool(ends), 120)
    assert isinstance(ends[0], CommandDone), ends
    assert run.simulation.state("Robot1").x > HATCH[0] + 0.3, "it is not in the closet"
    assert not run.collisions


def test_a_robot_looks_from_where_it_can_get_to(world: WorldKind) -> None:
    run = Run(closet(), world)
    ends = run.start("Robot1", LookAt(x=HATCH[0], y=HATCH[1], z=0.8))
    run.run_until(lambda: bool(ends), 120)
    assert isinstance(ends[0], CommandDone), ends
    assert not run.collisions


def test_a_robot_moves_a_door_from_the_side_that_it_can_get_to(world: WorldKind) -> None:
    """The door of the closet leads east, and the robot, west of it, is nearer to its inner side."""
    run = Run(closet(door=True), world)
    (quote,) = find_legs(run.simulation, "Robot1", (f"{DOOR}{HANDLES}",)).lengths
    assert quote is not None
    ends = run.start("Robot1", Open(object=DOOR))
    run.run_until(lambda: bool(ends), 120)
    assert isinstance(ends[0], CommandDone), ends
    assert run.simulation.observe(DOOR).open is True
    assert run.simulation.state("Robot1").x > HATCH[0] + 0.3
    assert not run.collisions
