"""The lifts through whose doors robots are about to drive: a place that is granted is not yet open."""

from __future__ import annotations

from msgspec import Struct

from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.traffic import PassageOpen
from somrs.traffic.component import Traffic


class Passage(Struct, frozen=True, kw_only=True):
    """The robot is before the doors of a lift, or in it: the cabin has to be on the floor of this height, with its doors open, before the
    robot comes to the next `place` of its way. `progress`: how many places it has come to."""

    lift: str
    level: float
    place: str
    progress: int


def next_passage(traffic: Traffic, robot: str) -> Passage | None:
    """What has to be open before a robot comes to the next place that it was granted; None if nothing has to."""
    held = traffic.positions(robot)[:2]
    if len(held) < 2:
        return None
    current, following = held
    lift = current.zone or following.zone
    if lift is None or (current.zone, current.level) == (following.zone, following.level):
        return None
    place = traffic.place_name(traffic.state.held[robot][1])
    return Passage(lift=lift, level=following.level, place=place, progress=traffic.state.robots[robot].progress)


def lifts_held(traffic: Traffic, robot: str) -> set[str]:
    """The lifts in which a robot may be, or to which it was granted the way."""
    positions = traffic.positions(robot) if robot in traffic.state.robots else traffic.state.astray.get(robot, ())
    return {position.zone for position in positions if position.zone is not None}


def is_inside(traffic: Traffic, robot: str) -> bool:
    """Whether a robot is at a place of a lift."""
    return traffic.positions(robot)[0].zone is not None


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
