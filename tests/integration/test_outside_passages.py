"""Simulated lifts and doors that programs of their own serve, which take part in traffic by messages."""

from __future__ import annotations

import pytest

from somrs.devices.simulator.link.commands import Command, CommandDone, CommandGivenUp, Fault, ReleasePassage, ServePassage
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import Run, box


def tower_run(world: WorldKind = WorldKind.KINEMATIC, *, is_outside: bool = True) -> Run:
    """The tower, with its lift and a door, which take part in traffic from outside."""
    run = Run(tower(extra_objects=[box("Door1", "AutomaticDoor", (4, 3, 0), (0.1, 1.2, 2.1))]), world)
    for name in ("Lift1", "Door1"):
        run.simulation.set_outside(name, is_outside)
    return run


def end_of(run: Run, name: str, command: Command) -> CommandDone | CommandGivenUp:
    ends = run.start(name, command)
    run.run_until(lambda: bool(ends), 60.0)
    return ends[0]


def test_a_lift_serves_a_floor_with_open_doors_until_it_is_released(world: WorldKind) -> None:
    run = tower_run(world)
    end = end_of(run, "Lift1", ServePassage(z=HEIGHT))
    assert isinstance(end, CommandDone), end
    assert end.state.z == pytest.approx(HEIGHT, abs=0.02)
    run.run_for(10.0)
    assert run.simulation.linked.lifts[0].is_open(HEIGHT)
    assert isinstance(end_of(run, "Lift1", ReleasePassage()), CommandDone)
    run.run_for(10.0)
    assert not run.simulation.linked.lifts[0].is_open(HEIGHT)


def test_a_door_stays_open_until_it_is_released(world: WorldKind) -> None:
    run = tower_run(world)
    assert isinstance(end_of(run, "Door1", ServePassage()), CommandDone)
    run.run_for(10.0)
    assert run.simulation.scene.world.solids["Door1"].open
    assert isinstance(end_of(run, "Door1", ReleasePassage()), CommandDone)
    run.run_for(10.0)
    assert not run.simulation.scene.world.solids["Door1"].open


def test_a_lift_that_breaks_gives_up(world: WorldKind) -> None:
    run = tower_run(world)
    ends = run.start("Lift1", ServePassage(z=HEIGHT))
    run.run_for(1.0)
    run.simulation.fault("Lift1", Fault.DRIVE)
    run.run_until(lambda: bool(ends), 5.0)
    assert isinstance(ends[0], CommandGivenUp)
    assert ends[0].reason == "drive-dead"


def test_the_simulation_serves_robots_unless_a_program_does() -> None:
    run = tower_run(is_outside=False)
    end = end_of(run, "Lift1", ServePassage(z=HEIGHT))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "not-possible"
