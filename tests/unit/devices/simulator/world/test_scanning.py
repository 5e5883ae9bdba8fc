"""What laser scanners of simulated robots measure, in both kinds of worlds."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.devices.simulator.link.commands import Command, CommandDone, Scan, Sense
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support.simulator_room import ONTOLOGY, box, room, thing

WORLDS = pytest.mark.parametrize("world", [WorldKind.PHYSICS, WorldKind.KINEMATIC])


def answer(simulation: Simulation, command: Command, robot: str = "Robot1") -> CommandDone:
    results: list[object] = []
    simulation.command(robot, command, results.append)
    (result,) = results
    assert isinstance(result, CommandDone)
    return result


@WORLDS
def test_a_scan_measures_walls_furniture_and_robots(world: WorldKind) -> None:
    simulation = Simulation(room((1.5, 1.5, 0.0), (1.5, 4.5, 0.0)), ONTOLOGY, world)
    ahead = answer(simulation, Scan(rays=1, view=0.1, range=20.0)).ranges[0]
    assert ahead == pytest.approx(6.1 - 1.5, abs=0.002)  # the platform
    assert answer(simulation, Scan(rays=1, view=0.1, range=4.0)).ranges == (None,)
    above = answer(simulation, Scan(rays=1, view=0.1, range=20.0, height=0.5)).ranges[0]
    assert above == pytest.approx(8.0 - 1.5, abs=0.002)  # the wall behind it
    turned = Simulation(room((1.5, 1.5, math.pi / 2), (1.5, 4.5, 0.0)), ONTOLOGY, world)
    robot_ahead = answer(turned, Scan(rays=1, view=0.1, range=20.0)).ranges[0]
    assert robot_ahead is not None
    assert 2.5 < robot_ahead < 3.0


@WORLDS
def test_a_shut_door_is_measured_and_an_open_one_is_not(world: WorldKind) -> None:
    def ahead(*, is_open: bool) -> float | None:
        door = box("Door1", "Door", (3.0, 1.5, 0), (0.1, 1.2, 2.1), Open=is_open)
        simulation = Simulation(room((1.5, 1.5, 0.0), (6.5, 4.5, 0.0), [door]), ONTOLOGY, world)
        return answer(simulation, Scan(rays=1, view=0.1)).ranges[0]

    assert ahead(is_open=False) == pytest.approx(1.5, abs=0.08)
    assert ahead(is_open=True) == pytest.approx(4.6, abs=0.01)


@settings(deadline=None, max_examples=20)
@given(x=st.floats(1.0, 3.0), y=st.floats(0.8, 2.6), yaw=st.floats(-3.1, 3.1))
def test_every_ray_ends_where_a_solid_begins(x: float, y: float, yaw: float) -> None:
    simulation = Simulation(room((x, y, yaw), (6.5, 4.5, 0.0)), ONTOLOGY, WorldKind.KINEMATIC)
    scan = Scan(rays=24, range=12.0)
    solids = [solid for name, solid in simulation.scene.world.solids.items() if name not in ("Robot1", "Floor1", "Jar002")]
    for number, distance in enumerate(answer(simulation, scan).ranges):
        angle = yaw - math.pi + (number + 0.5) * math.tau / 24
        assert distance is not None
        end = x + distance * math.cos(angle), y + distance * math.sin(angle)
        assert min(solid.distance(*end) for solid in solids) == pytest.approx(0.0, abs=0.002)
        halfway = x + distance * math.cos(angle) / 2, y + distance * math.sin(angle) / 2
        assert min(solid.distance(*halfway) for solid in solids) > 0


def test_who_does_not_know_the_furniture_recognises_it_by_its_looks_and_hears_no_names() -> None:
    map = room((1.5, 4.0, math.pi), (6.5, 4.5, 0.0), [thing("Jar9", "Jar", 4.0, 5.2, 0.74, Color="Red")])
    seen = answer(Simulation(map, ONTOLOGY, WorldKind.KINEMATIC), Sense(furniture=True))
    assert seen.object_states == ()
    cupboard = next(sighting for sighting in seen.sightings if sighting.type == "Cupboard")
    assert (cupboard.x, cupboard.y, cupboard.values["Shape.Width"]) == pytest.approx((0.3, 4.0, 0.5))
    jar = next(sighting for sighting in seen.sightings if sighting.type == "Jar")
    assert (jar.support, jar.container) == (None, None)
    assert jar.z == pytest.approx(0.8, abs=0.01)
