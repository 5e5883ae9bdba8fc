"""The lifts through whose doors robots are about to drive: a place that is granted is not yet open."""

from __future__ import annotations

from msgspec import Struct

from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.traffic import PassageOpen
from somrs.traffic.component import Traffic
from somrs.traffic.state import TrafficState


class Passage(Struct, frozen=True, kw_only=True):
    """The robot is before the doors of a lift, or in it: the cabin has to be on the floor of this height, with its doors open, before the
    robot comes to the next `place` of its way. `progress`: how many places it has come to."""

    lift: str
    level: float
    place: str
    progress: int


def next_passage(traffic: Traffic, robot: str) -> Passage | None:
    """What has to be open before a robot comes to the next place that it was granted; None if nothing has to."""
    held = traffic.state.held[robot][:2]
    if len(held) < 2:
        return None
    current, following = (_whereabouts(traffic.state, number) for number in held)
    lift = current.zone or following.zone
    if lift is None or current == following:
        return None
    place = traffic.place_name(held[1])
    return Passage(lift=lift, level=following.level, place=place, progress=traffic.state.robots[robot].progress)


def lifts_held(traffic: Traffic, robot: str) -> set[str]:
    """The lifts of which a robot holds places."""
    held = (_whereabouts(traffic.state, number) for number in traffic.state.held.get(robot, ()))
    return {whereabouts.zone for whereabouts in held if whereabouts.zone is not None}


def is_inside(traffic: Traffic, robot: str) -> bool:
    """Whether a robot is at a place of a lift."""
    return _whereabouts(traffic.state, traffic.state.held[robot][0]).zone is not None


class _Whereabouts(Struct, frozen=True):
    """The lift of which a place is a part, if any, and the height of its floor."""

    zone: str | None
    level: float


def _whereabouts(state: TrafficState, number: int) -> _Whereabouts:
    """Where a place is, or a berth: it is where the nearest place is from which a robot drives there."""
    places = state.roadmap.places
    if number >= len(places):
        berth = state.berths[number - len(places)]
        assert berth is not None, "only those in use have a number"
        number, _ = min(berth.lanes, key=lambda lane: lane[1])
    return _Whereabouts(places[number].zone, places[number].level)


def opened(traffic: Traffic, robot: str, passage: Passage) -> Message:
    """The message to a robot that it may come to the next place."""
    address, record = traffic.state.address, traffic.state.robots[robot]
    header = Header(
        sender=address,
        recipient=record.address,
        message_id=message_id(address, "passage", robot, record.fence, passage.progress),
        reply_to=address,
    )
    body = PassageOpen(robot=robot, fence=record.fence, progress=passage.progress, passage=passage.lift, place=passage.place)
    return Message(header=header, body=body)
