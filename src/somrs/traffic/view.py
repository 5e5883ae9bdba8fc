"""What is to be seen of traffic from outside."""

from __future__ import annotations

from collections.abc import Iterator

from somrs.protocol.messages.paging import fit_page
from somrs.protocol.messages.traffic import RoadmapLane, RoadmapPage, RoadmapPlace, RobotInTraffic, TrafficView
from somrs.traffic.berths import Berths
from somrs.traffic.drives import Drives
from somrs.traffic.passages import Passages
from somrs.traffic.roadmap import NumberedRoadmap
from somrs.traffic.schedule import Schedule
from somrs.traffic.state import RobotRecord, TrafficState


def traffic_view(state: TrafficState, schedule: Schedule, berths: Berths, drives: Drives) -> TrafficView:
    """All robots and passages."""
    return TrafficView(
        robots=tuple(_robots(state, schedule, berths, drives)),
        berths=tuple(entry.berth for entry in state.berths if entry),
        passages=tuple(drives.view()),
        hold=state.hold,
        edition=state.edition,
        roadmap=state.roadmap_number,
    )


def _robots(state: TrafficState, schedule: Schedule, berths: Berths, drives: Drives) -> Iterator[RobotInTraffic]:
    """All robots, with the places that they hold, and whom they wait for."""
    for name, record in state.robots.items():
        trip, (passage, is_inside) = record.trip, drives.awaited_by(name)
        yield RobotInTraffic(
            robot=name,
            held=tuple(map(berths.name, schedule.held(name))),
            planned=tuple(map(berths.name, schedule.planned(name))),
            waits_for=_waits_for(name, record, schedule),
            mobility=record.mobility,
            silent=record.silent,
            trip=trip.id if trip is not None else None,
            destination=berths.name(trip.destination) if trip is not None else None,
            passage=passage,
            inside=is_inside,
        )


def held_up(name: str, record: RobotRecord, schedule: Schedule, drives: Drives) -> tuple[str | None, tuple[str, ...]]:
    """What keeps a robot from going on that wants to: the lift or the door that is not open for it, or the robots that go first."""
    passage, is_inside = drives.awaited_by(name) if len(schedule.held(name)) > 1 else (None, False)
    if passage is not None and not is_inside:
        return passage, ()
    wants_to_drive = record.trip is not None or bool(schedule.planned(name))
    return None, _waits_for(name, record, schedule) if wants_to_drive and len(schedule.held(name)) == 1 else ()


def _waits_for(name: str, record: RobotRecord, schedule: Schedule) -> tuple[str, ...]:
    """The robots that go first by the plan. While no way is planned, because nobody gets past: the first one on its shortest way."""
    first = tuple(dict.fromkeys(schedule.obstacles(name)))
    if first or record.trip is None or schedule.planned(name):
        return first
    way = schedule.graph.way(schedule.last(name), record.trip.destination, name)
    holder = next((holder for place in way if (holder := schedule.holder(place, besides=name)) is not None), None)
    return (holder,) if holder is not None else ()


def roadmap_page(state: TrafficState, roadmap: NumberedRoadmap, passages: Passages, offset: int) -> RoadmapPage:
    """The places of the roadmap from this number on, as many as fit on a page."""
    places, offset, graph, rules = state.roadmap.places, max(offset, 0), roadmap.graph, roadmap.rules
    closed_places, closed_lanes = state.all_closed.all_places, state.all_closed.all_lanes
    items = (
        RoadmapPlace(
            name=place.name,
            x=place.x,
            y=place.y,
            level=place.level,
            radius=place.radius,
            graph=place.graph,
            passthrough=place.passthrough,
            zone=place.zone,
            lanes=tuple(
                RoadmapLane(
                    end=places[end].name,
                    seconds=graph.length(number, end),
                    speed_limit=rules[number, end].speed_limit if (number, end) in rules else None,
                    travel=rules[number, end].travel if (number, end) in rules else None,
                    closed=(number, end) in closed_lanes,
                    passages=passages.entered(number, end),
                )
                for end in graph.successors[number]
            ),
            closed=number in closed_places,
        )
        for number, place in enumerate(places[offset:], offset)
    )
    page = tuple(fit_page(items))
    end = offset + len(page)
    return RoadmapPage(edition=state.edition, places=page, next=end, more=end < len(places))
