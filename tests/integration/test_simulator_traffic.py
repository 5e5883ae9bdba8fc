"""Robots that share rooms: they never touch each other, and do not wait for ever."""

from __future__ import annotations

import itertools
import math
import random

import pytest

from somrs.devices.simulator.link.commands import Approach, CommandDone, CommandGivenUp, DriveTo, Fault
from somrs.devices.simulator.motion.traffic import Capsule
from somrs.devices.simulator.server.simulated_traffic import UseRoadmap
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.space.lines import segment_distance
from somrs.traffic.layout import Layout, lay_out
from tests.support.simulator_room import Run, box, robot, room, shell, thing


def drive_all(run: Run, goals: dict[str, tuple[float, float]], limit: float = 120.0) -> dict[str, CommandDone | CommandGivenUp]:
    ends = {name: run.start(name, DriveTo(x=x, y=y)) for name, (x, y) in goals.items()}
    run.run_until(lambda: all(ends.values()), limit)
    return {name: end[0] for name, end in ends.items()}


def test_two_robots_that_change_places_pass_each_other(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0), (6.5, 3, math.pi)), world)
    ends = drive_all(run, {"Robot1": (6.5, 3), "Robot2": (1.5, 3)})
    assert all(isinstance(end, CommandDone) for end in ends.values()), ends
    assert not run.collisions


def test_crossing_robots_never_touch(world: WorldKind) -> None:
    chance = random.Random(7)
    for _ in range(4):
        places = [(chance.uniform(2, 5.2), chance.uniform(0.6, 3.9)) for _ in range(4)]
        if min(math.dist(first, second) for first, second in itertools.combinations(places, 2)) < 0.8:
            continue
        run = Run(room((*places[0], 0), (*places[1], 0)), world)
        ends = drive_all(run, {"Robot1": places[2], "Robot2": places[3]})
        assert all(isinstance(end, CommandDone) for end in ends.values()), ends
        assert not run.collisions


def corridor() -> list[Object]:
    """A corridor 1 m wide and 6 m long between two rooms: no two robots pass each other in it."""
    objects = [box("Floor1", "Floor", (6, 0, -0.1), (14, 4, 0.1))]
    for side, name in ((1, "N"), (-1, "S")):
        objects.append(box(f"Long{name}", "Wall", (6, side * 0.55, 0), (6, 0.1, 2.5)))
        objects += [box(f"End{name}{x}", "Wall", (x, side * 1.3, 0), (0.1, 1.4, 2.5)) for x in (3.05, 8.95)]
    return objects


def test_robots_that_meet_in_a_corridor_do_not_wait_for_ever(world: WorldKind) -> None:
    run = Run(Map([*corridor(), robot("Robot1", (1, 0.2, 0)), robot("Robot2", (11, -0.2, math.pi), 0.6)]), world)
    ends = drive_all(run, {"Robot1": (11, 0), "Robot2": (1, 0)})
    assert all(isinstance(end, CommandDone) for end in ends.values()), ends
    assert not run.collisions


def test_three_robots_on_each_side_of_a_corridor_change_places(world: WorldKind) -> None:
    """One side goes first, close behind each other; then the other one. Nobody drives into the corridor to back out of it again."""
    walls = [box(f"Wall{side}", "Wall", (8, side * 2, 0), (8, 3, 2.5)) for side in (1, -1)]
    left, right = ([(x, y) for y in (-1.5, 0.0, 1.5)] for x in (1.0, 15.0))
    robots = [robot(f"Robot{number}", (*start, 0)) for number, start in enumerate([*left, *right])]
    run = Run(Map([box("Floor1", "Floor", (8, 0, -0.1), (16, 6, 0.1)), *walls, *robots]), world)
    ends = drive_all(run, {f"Robot{number}": goal for number, goal in enumerate([*right, *left])})
    assert all(isinstance(end, CommandDone) for end in ends.values()), ends
    assert not run.collisions
    lone = Run(Map([box("Floor1", "Floor", (8, 0, -0.1), (16, 6, 0.1)), *walls, robot("Robot1", (1, 0, 0))]), world)
    lone.execute_all("Robot1", DriveTo(x=12.4, y=0))  # out of the corridor; then the others begin in front of it
    behind = 0.7 / 0.8  # the time between two robots that follow each other as closely as they can
    lower_bound = 2 * (lone.simulation.time + 2 * behind)
    assert run.simulation.time <= 1.6 * lower_bound


def test_an_idle_robot_makes_way(world: WorldKind) -> None:
    run = Run(Map([*corridor(), robot("Robot1", (6, 0, 0)), robot("Robot2", (11, 0, math.pi))]), world)
    ends = drive_all(run, {"Robot2": (1, 0)})
    assert isinstance(ends["Robot2"], CommandDone), ends
    assert not run.collisions


def test_a_robot_that_cannot_pass_gives_up_after_a_while(world: WorldKind) -> None:
    run = Run(Map([*corridor(), robot("Robot1", (6, 0, 0)), robot("Robot2", (11, 0, math.pi))]), world)
    run.simulation.fault("Robot1", Fault.DRIVE)
    end = run.execute("Robot2", DriveTo(x=1, y=0))
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "blocked"
    assert "Robot1" in end.description


def doorway(open: bool) -> Map:
    walls = [box("Low", "Wall", (4, 1.2, 0), (0.1, 2.4, 2.5)), box("Up", "Wall", (4, 4.8, 0), (0.1, 2.4, 2.5))]
    door = box("Door1", "Door", (4, 3, 0), (0.1, 1.2, 2.1), Open=open)
    return Map([*shell(), *walls, door, robot("Robot1", (2, 3, 0))])


def test_a_closed_door_blocks_and_an_open_one_does_not(world: WorldKind) -> None:
    shut = Run(doorway(open=False), world).execute("Robot1", DriveTo(x=6, y=3))
    assert isinstance(shut, CommandGivenUp)
    assert shut.reason == "unreachable"
    run = Run(doorway(open=True), world)
    run.execute_all("Robot1", DriveTo(x=6, y=3))
    assert abs(run.simulation.state("Robot1").x - 6) < 0.03
    assert not run.collisions


def test_robots_stand_where_they_were_sent_and_look_there(world: WorldKind) -> None:
    run = Run(room(), world)
    run.execute_all("Robot1", DriveTo(x=3, y=2, yaw=1.0))
    state = run.simulation.state("Robot1")
    assert math.dist((state.x, state.y), (3, 2)) < 0.02
    assert abs(state.yaw - 1.0) < 0.03


def test_the_gap_between_capsules_is_what_sampling_finds() -> None:
    chance = random.Random(3)
    for _ in range(50):
        first_start, first_end, second_start, second_end = ((chance.uniform(-1, 1), chance.uniform(-1, 1)) for _ in range(4))
        shares = [i / 60 for i in range(61)]
        first_points = [
            (first_start[0] + s * (first_end[0] - first_start[0]), first_start[1] + s * (first_end[1] - first_start[1])) for s in shares
        ]
        second_points = [
            (second_start[0] + s * (second_end[0] - second_start[0]), second_start[1] + s * (second_end[1] - second_start[1]))
            for s in shares
        ]
        slow = min(math.dist(p, q) for p in first_points for q in second_points)
        assert abs(segment_distance(first_start, first_end, second_start, second_end) - slow) < 0.05
        assert (
            Capsule(first_start, first_end, 0.1).gap(Capsule(second_start, second_end, 0.2))
            == segment_distance(first_start, first_end, second_start, second_end) - 0.1 - 0.2
        )


def test_robots_leave_and_come_while_the_world_goes_on(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0)), world)
    run.simulation.remove("Robot1")
    run.simulation.remove("Robot2")
    run.run_for(4)
    run.simulation.add(robot("Robot3", (1.5, 3, 0)))
    run.execute_all("Robot3", DriveTo(x=5, y=3))
    assert not run.collisions


def test_a_robot_that_finds_no_path_does_not_count_as_driving(world: WorldKind) -> None:
    run = Run(doorway(open=False), world)
    assert isinstance(run.execute("Robot1", DriveTo(x=6, y=3)), CommandGivenUp)
    assert not run.simulation.robots["Robot1"].road.is_travelling


def test_a_robot_drives_a_few_centimetres_without_a_detour(world: WorldKind) -> None:
    run = Run(room((3.13, 2.87, 0)), world)
    run.execute_all("Robot1", DriveTo(x=3.13, y=2.87))
    farthest = 0.0
    ends = run.start("Robot1", DriveTo(x=3.18, y=2.89))
    while not ends:
        run.run_for(0.1)
        state = run.simulation.state("Robot1")
        farthest = max(farthest, math.dist((state.x, state.y), (3.18, 2.89)))
    assert isinstance(ends[0], CommandDone)
    assert farthest < 0.1


def test_robots_drive_on_around_what_was_built_while_a_roadmap_is_made(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0)), world)
    begun: list[tuple[Layout, UseRoadmap]] = []
    run.simulation.shared_traffic.layouter = lambda layout, use: begun.append((layout, use))
    roadmap = run.simulation.robots["Robot1"].road.office.roadmap
    run.simulation.add(box("Shelf9", "Cupboard", (3.5, 3, 0), (0.4, 1.2, 0.8)))
    run.execute_all("Robot1", DriveTo(x=5, y=3))
    assert run.simulation.robots["Robot1"].road.office.roadmap is roadmap
    run.simulation.add(box("Shelf8", "Cupboard", (2.5, 1, 0), (0.4, 0.4, 0.8)))
    run.run_for(1)
    ((layout, use),) = begun  # one at a time
    use(lay_out(layout.building, layout.kinds))
    run.run_for(1)
    assert run.simulation.robots["Robot1"].road.office.roadmap is not roadmap
    layout, use = begun[1]
    assert "Shelf8" in layout.map.objects
    use(None)  # it could not be made
    run.execute_all("Robot1", DriveTo(x=1.5, y=3))
    assert not run.collisions


@pytest.mark.parametrize("breaks_at", [2.6, 2.9])
def test_a_robot_that_breaks_beside_another_does_not_keep_it_from_going_on(breaks_at: float, world: WorldKind) -> None:
    """It stands between two places, too near to the other for a place of its own, and what it carried lies before it."""
    run = Run(room((1.5, 2.5, 0.0), (5.5, 3.6, math.pi), [thing("Jar009", "Jar", 7.5, 5.5, 0.0)]), world)
    run.execute_all("Robot2", DriveTo(x=3.0, y=1.9))
    run.start("Robot1", DriveTo(x=5.0, y=2.5))
    run.run_until(lambda: run.simulation.state("Robot1").x > breaks_at)
    run.simulation.fault("Robot1", Fault.DRIVE)
    run.run_for(2)
    broken = run.simulation.state("Robot1")
    run.simulation.move("Jar009", broken.x + 0.55 * math.cos(broken.yaw), broken.y + 0.55 * math.sin(broken.yaw), 0.0)
    run.run_for(1)
    run.execute_all("Robot2", Approach(object="Jar009"))
    assert not run.collisions


def test_a_robot_comes_to_a_point_beside_one_that_stands_there(world: WorldKind) -> None:
    """If two robots cannot come that near to each other, the one that stands there makes room."""
    for distance in (0.53, 0.5505, 0.575):
        run = Run(room((1.0, 2.5, 0.0), (4.0, 3.6, math.pi)), world)
        run.execute_all("Robot2", DriveTo(x=1.0 + distance, y=2.5))
        assert not run.collisions
