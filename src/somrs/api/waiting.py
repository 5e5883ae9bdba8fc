"""Why a robot in traffic waits, in words: for whom, and what that one does."""

from __future__ import annotations

from somrs.devices.simulator.link.roads import RobotInTraffic, TrafficState
from somrs.protocol.messages.traffic import Mobility

WORK = {
    "Grip": "grips {}",
    "Place": "puts something on {}",
    "Insert": "puts something into {}",
    "Open": "opens {}",
    "Close": "shuts {}",
    "Weigh": "weighs {}",
    "LookAt": "looks for {}",
    "LookAround": "looks for {}",
    "Approach": "works at {}",
}
"""What a robot does at an object, by its command."""

WORK_ALONE = {"Charge": "charges", "PutDown": "puts something down", "LookAt": "looks around", "LookAround": "looks around"}
"""What a robot does whose command names no object."""


def waits_for(robot: RobotInTraffic) -> tuple[str, ...]:
    """The robots that have to go first, or the lift, if it waits."""
    if not _wants_to_drive(robot):
        return ()
    return (robot.lift,) if robot.lift is not None and not robot.riding else robot.waits_for


def waiting_text(robot: RobotInTraffic | None, state: TrafficState) -> str:
    """Why the robot waits, after its name; empty if it does not."""
    if robot is None:
        return ""
    if robot.refusal and not robot.granted:
        return f"takes no part in traffic: {robot.refusal}"
    if not _wants_to_drive(robot):
        return ""
    if state.hold and len(robot.granted) == 1:
        return f"waits because traffic is held: {state.hold}"
    if robot.lift in state.closed_lifts:
        place = "is in" if robot.riding else "waits for"
        return f"{place} {robot.lift}, which nobody may enter now: it is out of order, or does not work"
    if robot.lift is not None and not robot.riding:
        return f"waits for {robot.lift}{', which people or other systems use' if robot.lift in state.shared_lifts else ''}"
    reasons = [f"{name}, {_cause(state.robots.get(name))}" for name in robot.waits_for]
    return f"waits for {' and for '.join(reasons)}" if reasons else ""


def _wants_to_drive(robot: RobotInTraffic) -> bool:
    return not robot.paused and not robot.silent and (robot.destination is not None or bool(robot.planned))


def _cause(robot: RobotInTraffic | None) -> str:
    """What a robot does for which others wait."""
    if robot is None:
        return "which has to go first"
    if robot.silent:
        return "of which nobody knows where it is"
    if robot.paused:
        return "which an operator has stopped"
    if robot.mobility is Mobility.IMMOBILE:
        return "which cannot move"
    if robot.mobility is Mobility.BUSY:
        return f"which {_work(robot)}"
    if robot.riding:
        return f"which is in {robot.lift}"
    if robot.lift is not None:
        return f"which waits for {robot.lift}"
    if robot.waits_for and robot.destination is not None:
        return f"which waits for {' and for '.join(robot.waits_for)}"
    return "which has to go first"


def _work(robot: RobotInTraffic) -> str:
    command = robot.command or ""
    if robot.object is not None:
        return WORK.get(command, "works at {}").format(robot.object)
    return WORK_ALONE.get(command, "works there")
