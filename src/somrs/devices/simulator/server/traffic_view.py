"""What an operator sees of the traffic of a simulation: the roadmap, the ways that are granted and planned, and who waits for whom."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from somrs.devices.simulator.link.roads import PointOf, Roadmap, RoadPoint, RobotInTraffic, TrafficState, driving, road_point, undirected
from somrs.devices.simulator.motion.robot import Robot
from somrs.devices.simulator.server.robot_work import RobotWork
from somrs.devices.simulator.server.simulated_traffic import SimulatedTraffic
from somrs.protocol.messages.traffic import ReadTraffic, TrafficView
from somrs.protocol.messages.traffic import RobotInTraffic as RobotView


def roadmap_view(traffic: SimulatedTraffic) -> Roadmap:
    """The roadmap, and what of it is closed now."""
    office = traffic.office
    numbers, graph = office.roadmap.numbers, office.roadmap.graph
    lanes, one_way = undirected({(start, end) for start, ends in enumerate(graph.successors) for end in ends})
    positions = {lane: position for position, lane in enumerate(lanes)}
    closed_lanes = ((numbers[lane.start], numbers[lane.end]) for lane in office.closed_lanes)
    return Roadmap(
        number=office.component.state.roadmap_number,
        places=tuple(road_point(place.x, place.y, place.level) for place in office.roadmap.roadmap.places),
        lanes=lanes,
        one_way=one_way,
        closed_places=tuple(sorted(numbers[place] for place in office.closed_places)),
        closed_lanes=tuple(sorted({positions[min(lane), max(lane)] for lane in closed_lanes})),
    )


def traffic_view(traffic: SimulatedTraffic, robots: Mapping[str, Robot], work: RobotWork) -> TrafficState:
    """Where the robots may drive, and whom they wait for; also those of any make that take part."""
    office = traffic.office
    view = office.tell("operator", ReadTraffic())
    assert isinstance(view, TrafficView), "the answer to ReadTraffic"
    in_traffic = {robot.robot: robot for robot in view.robots}
    berths = {berth.name: berth for berth in view.berths}

    def point(name: str) -> RoadPoint:
        berth = berths.get(name)
        place = office.roadmap.roadmap.places[office.roadmap.numbers[name if berth is None else berth.places[0]]]
        return road_point(place.x, place.y, place.level) if berth is None else road_point(berth.x, berth.y, place.level)

    foreign = {name: driving(robot, point) for name, robot in in_traffic.items() if name not in robots}
    simulated = {name: _robot_view(robot, in_traffic.get(name), point, work.object(name)) for name, robot in robots.items()}
    return TrafficState(
        roadmap=view.roadmap,
        robots={**foreign, **simulated},
        hold=view.hold,
        closed_lifts=tuple(sorted(name for name, lift in traffic.lifts.items() if not lift.is_usable)),
    )


def _robot_view(robot: Robot, view: RobotView | None, point: PointOf, object: str | None) -> RobotInTraffic:
    """What is known of a simulated robot."""
    if view is None:
        return RobotInTraffic(command=robot.activity, object=object, paused=robot.paused, refusal=robot.road.refusal)
    lift, is_riding = _lift_of(robot)
    return structs.replace(driving(view, point), lift=lift, riding=is_riding, paused=robot.paused, command=robot.activity, object=object)


def _lift_of(robot: Robot) -> tuple[str | None, bool]:
    """The lift in which a robot is, or in front of which it waits to be let in; and whether it is inside."""
    road, lifts = robot.road, robot.fleet.lifts
    if road.zone in lifts:
        return road.zone, True
    waits = road.next_zone in lifts and not road.is_on_its_way and robot.stands
    return (road.next_zone if waits else None), False
