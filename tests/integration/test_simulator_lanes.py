"""Robots keep to the lanes of the building: in their direction, at their speed, facing as they have to, and as the map changes."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from itertools import pairwise

import pytest

from somrs.devices.simulator.link.commands import CommandDone, DriveTo
from somrs.devices.simulator.server.driving_distances import find_legs
from somrs.devices.simulator.server.simulated_world import SimulatedWorld
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, Object, ObjectAdded, ValueSet
from somrs.ontology.types import Value
from somrs.sites.lif.reading import import_bytes
from somrs.sites.openrmf import import_building
from somrs.space.lanes import lanes_of
from somrs.space.lines import point_distance
from tests.support.paths import SHARED
from tests.support.simulator_room import ONTOLOGY, Run, robot, shell

HOTEL = SHARED / "sites" / "hotel.building.yaml"
NOW = "2026-11-01T00:00:00Z"
CORNERS = ((1.5, 1.5), (6.5, 1.5), (6.5, 4.5), (1.5, 4.5))
"""Of a loop, in its direction."""
Point = tuple[float, float]


def waypoint(number: int, point: Point, **values: Value) -> Object:
    return Object(name=f"Waypoint{number}", type="Waypoint", values={"PositionX": point[0], "PositionY": point[1], **values})


def lane(start: int, end: int, **values: Value) -> tuple[Object, Fact, Fact]:
    name = f"Lane{start}to{end}"
    ends = Fact("startsAt", (name, f"Waypoint{start}")), Fact("endsAt", (name, f"Waypoint{end}"))
    return Object(name=name, type="Lane", values={"NavigationGraph": "0", **values}), *ends


def hall(lanes: Sequence[tuple[Object, Fact, Fact]], *robots: Object, points: Sequence[Point] = CORNERS, **values: Value) -> Map:
    waypoints = [waypoint(number, point, **values) for number, point in enumerate(points)]
    objects = [*shell(), *waypoints, *(lane[0] for lane in lanes), *(robots or [rover(CORNERS[0])])]
    return Map(objects, [fact for lane in lanes for fact in lane[1:]])


def rover(point: Point, name: str = "Robot1", yaw: float = 0.0, graph: str = "0") -> Object:
    return robot(name, (*point, yaw), NavigationGraph=graph)


def loop(**values: Value) -> list[tuple[Object, Fact, Fact]]:
    return [lane(number, (number + 1) % 4, **values) for number in range(4)]


def drive(run: Run, *goals: Point, name: str = "Robot1") -> list[tuple[float, float, float]]:
    """Drive to goals. Returns the poses on the way, ten per second."""
    poses: list[tuple[float, float, float]] = []
    for x, y in goals:
        ends = run.start(name, DriveTo(x=x, y=y))
        while not ends:
            state = run.simulation.state(name)
            poses.append((state.x, state.y, state.yaw))
            run.run_for(0.1)
        assert isinstance(ends[0], CommandDone), ends
    return poses


def off_lanes(poses: Sequence[tuple[float, float, float]], corners: Sequence[Point] = CORNERS) -> float:
    """How far the robot was from all lanes at most, m."""
    sides = [*pairwise((*corners, corners[0]))]
    return max(min(point_distance((x, y), *side) for side in sides) for x, y, _ in poses)


def test_a_robot_drives_round_on_one_way_lanes_and_its_quote_is_as_long(world: WorldKind) -> None:
    run = Run(hall(loop()), world)
    (quote,) = find_legs(run.simulation, "Robot1", (CORNERS[3],)).lengths
    poses = drive(run, CORNERS[3])
    length = sum(math.dist(first[:2], second[:2]) for first, second in pairwise(poses))
    assert length == pytest.approx(13, abs=0.6)
    assert quote == pytest.approx(length, abs=0.7)
    assert off_lanes(poses) < 0.15


def test_a_robot_of_another_graph_drives_where_there_is_room(world: WorldKind) -> None:
    run = Run(hall(loop(), rover(CORNERS[0], graph="1")), world)
    poses = drive(run, CORNERS[3])
    assert sum(math.dist(first[:2], second[:2]) for first, second in pairwise(poses)) < 4


def test_a_robot_leaves_the_lanes_for_what_is_beside_them(world: WorldKind) -> None:
    run = Run(hall(loop()), world)
    poses = drive(run, (4, 3), CORNERS[1])
    assert math.dist(poses[-1][:2], CORNERS[1]) < 0.1
    assert not run.collisions


def test_a_robot_keeps_to_the_speed_limit_of_a_lane(world: WorldKind) -> None:
    run = Run(hall([*loop()[:1], *loop(SpeedLimit=0.25)[1:]]), world)
    poses = drive(run, CORNERS[2])
    speeds = {
        is_slow: [math.dist(a[:2], b[:2]) / 0.1 for a, b in pairwise(poses) if (a[1] > 1.6 and b[1] > 1.6) == is_slow]
        for is_slow in (True, False)
    }
    assert max(speeds[True]) < 0.27
    assert max(speeds[False]) > 0.6
    (limited,) = find_legs(run.simulation, "Robot1", (CORNERS[3],)).lengths
    (unlimited,) = find_legs(Run(hall(loop(), rover(CORNERS[2])), world).simulation, "Robot1", (CORNERS[3],)).lengths
    assert limited is not None
    assert unlimited is not None
    assert limited == pytest.approx(unlimited * 0.8 / 0.25, rel=0.2), "as far as the robot drives in that time"


def test_a_robot_backs_out_of_a_lane_into_which_it_drives_forwards(world: WorldKind) -> None:
    run = Run(hall([lane(0, 1, Bidirectional=True, Travel="Forward")]), world)
    forth_poses, back_poses = drive(run, CORNERS[1]), drive(run, CORNERS[0])
    for poses in (forth_poses, back_poses):
        moving = [first[2] for first, second in pairwise(poses[10:-10]) if math.dist(first[:2], second[:2]) > 0.02]
        assert moving
        assert all(abs(yaw) < 0.3 for yaw in moving), "it always faces the end of the lane"


def test_two_robots_on_a_lane_in_both_directions_pass_each_other(world: WorldKind) -> None:
    robots = rover(CORNERS[0]), rover(CORNERS[1], "Robot2", math.pi)
    run = Run(hall([lane(0, 1, Bidirectional=True)], *robots), world)
    ends = [run.start("Robot1", DriveTo(x=6.5, y=1.5)), run.start("Robot2", DriveTo(x=1.5, y=1.5))]
    run.run_until(lambda: all(ends))
    assert all(isinstance(end[0], CommandDone) for end in ends)
    assert not run.collisions


def test_four_robots_on_a_one_way_loop_come_to_their_goals(world: WorldKind) -> None:
    robots = [rover(corner, f"Robot{number}") for number, corner in enumerate(CORNERS)]
    run = Run(hall(loop(), *robots), world)
    ends = [run.start(f"Robot{number}", DriveTo(x=CORNERS[number - 1][0], y=CORNERS[number - 1][1])) for number in range(4)]
    run.run_until(lambda: all(ends), 300)
    assert all(isinstance(end[0], CommandDone) for end in ends)
    assert not run.collisions


def test_a_robot_with_nothing_to_do_goes_on_from_where_robots_are_not_to_stop(world: WorldKind) -> None:
    map = hall(loop())
    map = map.changed([ValueSet("Waypoint1", "PassthroughPoint", True)])
    run = Run(map, world)
    drive(run, CORNERS[1])
    run.run_for(5)
    state = run.simulation.state("Robot1")
    assert math.dist((state.x, state.y), CORNERS[1]) > 0.5
    rest = state.x, state.y
    run.run_for(5)
    state = run.simulation.state("Robot1")
    assert math.dist((state.x, state.y), rest) < 0.05


def test_lanes_change_while_the_robots_are_there() -> None:
    """A loop is drawn, and turned round."""
    simulated = SimulatedWorld(WorldKind.KINEMATIC)
    empty = hall([])
    simulated.build(empty, ONTOLOGY)
    assert simulated.simulation is not None
    added: list[Change] = []
    for object, start, end in loop():
        added += [ObjectAdded(object), FactAdded(start), FactAdded(end)]
    simulated.change(simulated.map.changed(added), added, [], {})
    run = Run.of(simulated.simulation)
    assert len(drive(run, CORNERS[3])) > 120, "round the loop"
    turned = [ValueSet(f"Lane{number}to{(number + 1) % 4}", "Bidirectional", True) for number in range(4)]
    simulated.change(simulated.map.changed(turned), turned, [], {})
    assert len(drive(run, CORNERS[0])) < 80
    regraphed: list[ValueSet] = [ValueSet("Robot1", "NavigationGraph", "5")]
    simulated.change(simulated.map.changed(regraphed), regraphed, [], {})
    run.run_for(1)
    assert {place.graph for place in run.simulation.robots["Robot1"].road.office.roadmap.roadmap.places} == {None}


def test_an_operator_sees_which_way_the_lanes_lead() -> None:
    run = Run(hall(loop()), WorldKind.KINEMATIC)
    run.run_for(0.1)
    roadmap = run.simulation.roadmap()
    for start, end in pairwise((*CORNERS, CORNERS[0])):
        drawn = [(roadmap.places[one], roadmap.places[two]) for one, two in roadmap.one_way]
        on_side = [(one[:2], two[:2]) for one, two in drawn if max(point_distance(point[:2], start, end) for point in (one, two)) < 0.02]
        assert on_side
        assert all(math.dist(start, one) < math.dist(start, two) for one, two in on_side)


@pytest.mark.skipif(not HOTEL.exists(), reason=f"NOT TESTED: there is no {HOTEL}")
def test_robots_of_the_hotel_keep_to_their_lanes() -> None:
    """Of Open-RMF's hotel, with two graphs; from waypoint to waypoint, nobody is farther from its lanes than where it steps aside."""
    site = import_building(HOTEL)
    run = Run(site.map, WorldKind.KINEMATIC, site.ontology)
    lanes = lanes_of(site.map, site.ontology)
    own_lanes = [lane for lane in lanes if lane.graph == "0" and lane.start.level == lane.end.level == 0.0]
    robot_state = run.simulation.state("tinyBot_1")
    waypoints = {(end.x, end.y) for lane in own_lanes for end in (lane.start, lane.end)}
    goal = max(waypoints, key=lambda point: math.dist(point, (robot_state.x, robot_state.y)))
    poses = drive(run, goal, name="tinyBot_1")
    ends = [((lane.start.x, lane.start.y), (lane.end.x, lane.end.y)) for lane in own_lanes]
    apart = [min(point_distance((x, y), *lane) for lane in ends) for x, y, _ in poses]
    assert math.dist(poses[0][:2], goal) > 10
    assert max(apart) < 0.3


def test_vehicles_keep_to_the_edges_of_their_type_in_a_layout() -> None:
    """A layout in LIF has edges in one direction, each for some types of vehicles; robots are added on the map."""
    layouts = {
        "metaInformation": {"projectIdentification": "Hall", "creator": "us", "exportTimestamp": NOW, "lifVersion": "1.0.0"},
        "layouts": [
            {
                "layoutId": "Hall",
                "layoutVersion": "1",
                "nodes": [
                    {"nodeId": f"N{number}", "nodePosition": {"x": x, "y": y}, "vehicleTypeNodeProperties": []}
                    for number, (x, y) in enumerate(CORNERS)
                ],
                "edges": [edge(number, (number + 1) % 4, "Tugger") for number in range(4)],
            }
        ],
    }
    site = import_bytes(json.dumps(layouts).encode())
    tugger, free = (robot(name, (*CORNERS[0], 0.0), NavigationGraph=graph) for name, graph in (("Robot1", "Tugger"), ("Robot2", "Lifter")))
    lengths = []
    for vehicle in (tugger, free):
        run = Run(site.map.changed([ObjectAdded(vehicle)]), WorldKind.KINEMATIC, site.ontology)
        poses = drive(run, CORNERS[3], name=vehicle.name)
        lengths.append(sum(math.dist(first[:2], second[:2]) for first, second in pairwise(poses)))
    assert lengths[0] == pytest.approx(13, abs=0.6)
    assert lengths[1] < 4


def edge(start: int, end: int, vehicle: str) -> dict[str, object]:
    vehicle_type = {"vehicleTypeId": vehicle, "rotationAllowed": True}
    return {"edgeId": f"E{start}", "startNodeId": f"N{start}", "endNodeId": f"N{end}", "vehicleTypeEdgeProperties": [vehicle_type]}
