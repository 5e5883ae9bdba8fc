"""What an operator sees of the simulated robots in traffic: their ways, and for whom they wait."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

from somrs.api.traffic import Traffic, view_of
from somrs.devices.simulator.link.commands import DriveTo
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.map import Map
from somrs.protocol.messages.traffic import TrafficEntered
from somrs.traffic.participant import Participant
from tests.support.robot_lab import run as run_in_room
from tests.support.robot_lab import simulator
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import Run, box, robot, room
from tests.support.small_system import running


def corridor() -> Map:
    """A corridor between two rooms, in which nobody gets past another robot."""
    walls = [box(f"Long{name}", "Wall", (6, side * 0.55, 0), (6, 0.1, 2.5)) for side, name in ((1, "N"), (-1, "S"))]
    ends = [box(f"End{x}{side}", "Wall", (x, side * 1.3, 0), (0.1, 1.4, 2.5)) for x in (3.05, 8.95) for side in (1, -1)]
    floor = box("Floor1", "Floor", (6, 0, -0.1), (14, 4, 0.1))
    return Map([floor, *walls, *ends, robot("Robot1", (6, 0, 0)), robot("Robot2", (11, 0, math.pi))])


def waiting(run: Run, name: str) -> str:
    return {robot.robot: robot.waiting for robot in view_of(run.simulation.traffic()).robots}[name]


def test_a_robot_in_a_corridor_waits_for_the_one_that_an_operator_has_stopped_there(world: WorldKind) -> None:
    run = Run(corridor(), world)
    run.simulation.linked.set_paused("Robot1", True)
    run.start("Robot2", DriveTo(x=1, y=0))
    run.run_until(lambda: waiting(run, "Robot2"))
    assert waiting(run, "Robot2") == "waits for Robot1, which an operator has stopped"
    run.simulation.hold("fire alarm in Building1")
    assert waiting(run, "Robot2") == "waits because traffic is held: fire alarm in Building1"
    run.simulation.hold("")
    run.simulation.linked.set_paused("Robot1", False)
    run.run_until(lambda: not waiting(run, "Robot2") and not waiting(run, "Robot1"))


def test_the_granted_way_begins_at_the_robot_and_the_planned_one_leads_on_to_its_destination(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0)), world)
    end = run.start("Robot1", DriveTo(x=6.5, y=3))
    run.run_until(lambda: run.simulation.robots["Robot1"].speed > 0.3)
    seen = run.simulation.traffic().robots["Robot1"]
    assert math.dist(seen.granted[0][:2], run.simulation.robots["Robot1"].pose()[:2]) < 1.2
    assert len(seen.granted) > 1
    assert seen.destination is not None
    assert math.dist(seen.destination[:2], (6.5, 3)) < 0.03
    assert seen.destination in seen.planned
    run.run_until(lambda: end)
    arrived = run.simulation.traffic().robots["Robot1"]
    assert (len(arrived.granted), arrived.planned, arrived.destination) == (1, (), None)


def test_the_roadmap_has_another_number_after_something_was_put_in_the_way(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0)), world)
    run.run_for(0.2)
    roadmap = run.simulation.roadmap()
    assert run.simulation.traffic().roadmap == roadmap.number
    assert not roadmap.closed_places
    run.simulation.move("Jar002", 4.0, 3.0, 0.0)
    run.run_for(2.5)
    blocked = run.simulation.roadmap()
    assert run.simulation.traffic().roadmap == blocked.number != roadmap.number
    assert all(math.dist(blocked.places[place][:2], (4, 3)) < 1 for place in blocked.closed_places)
    assert blocked.closed_places or blocked.closed_lanes
    assert (blocked.places, blocked.lanes) == (roadmap.places, roadmap.lanes)


def test_robots_wait_for_the_lift_and_for_the_one_that_is_in_it(world: WorldKind) -> None:
    run = Run(tower((2, 2, 0), (3, 4, 0)), world)
    ends = [run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT)), run.start("Robot2", DriveTo(x=4, y=3, z=HEIGHT))]
    texts: set[str] = set()
    riding: set[str | None] = set()

    def step() -> bool:
        traffic = view_of(run.simulation.traffic())
        texts.update(robot.waiting for robot in traffic.robots)
        riding.update(robot.lift for robot in traffic.robots)
        return all(ends)

    run.run_until(step, 200)
    assert "waits for Lift1" in texts
    assert any(text.endswith(("which is in Lift1", "which waits for Lift1")) for text in texts), texts
    assert "Lift1" in riding


def test_the_simulator_answers_an_operator() -> None:
    async def scenario() -> None:
        async with simulator() as server, OperatorLink(server.host, server.port) as operator:
            roadmap, traffic = await operator.roadmap(), await operator.traffic()
            assert roadmap.number == traffic.roadmap
            assert len(roadmap.places) > 10
            assert {*traffic.robots} == {"Robot1", "Robot2"}

    run_in_room(scenario())


def test_a_system_without_a_simulator_has_no_traffic(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(tmp_path) as (_, api):
            assert await api.traffic.read() == Traffic()

    asyncio.run(run())


def test_robots_of_any_make_that_take_part_are_seen_too(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0)), world)
    office = run.simulation._traffic.office
    place = next(place for place in office.roadmap.roadmap.places if math.dist((place.x, place.y), (6.5, 3)) < 1)
    foreigner = Participant("Foreigner", place.name)
    answer = office.tell("Foreigner", foreigner.enter(1000.0))
    assert isinstance(answer, TrafficEntered), answer
    seen = {robot.robot: robot for robot in view_of(run.simulation.traffic()).robots}
    assert [math.dist(point[:2], (place.x, place.y)) < 0.01 for point in seen["Foreigner"].granted] == [True]
    assert "Robot1" in seen
