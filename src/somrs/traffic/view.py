"""What is to be seen of traffic from outside."""

from __future__ import annotations

from collections.abc import Iterator

from somrs.protocol.messages.traffic import RobotInTraffic
from somrs.traffic.berths import Berths
from somrs.traffic.schedule import Schedule
from somrs.traffic.state import TrafficState


def view(state: TrafficState, schedule: Schedule, berths: Berths) -> Iterator[RobotInTraffic]:
    """All robots, with the places that they hold, and whom they wait for."""
    for name, record in state.robots.items():
        trip = record.trip
        yield RobotInTraffic(
            robot=name,
            held=tuple(map(berths.name, schedule.held(name))),
            planned=tuple(map(berths.name, schedule.planned(name))),
            waits_for=tuple(dict.fromkeys(schedule.obstacles(name))),
            mobility=record.mobility,
            silent=record.silent,
            trip=trip.id if trip is not None else None,
            destination=berths.name(trip.destination) if trip is not None else None,
        )
