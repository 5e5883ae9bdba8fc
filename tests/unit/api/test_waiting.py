"""Why a robot in traffic waits, in words."""

from __future__ import annotations

import pytest

from somrs.api.waiting import waiting_text, waits_for
from somrs.devices.simulator.link.roads import RobotInTraffic, TrafficState
from somrs.protocol.messages.traffic import Mobility

HERE, THERE = (1.0, 1.0, 0.0), (5.0, 1.0, 0.0)


def robot(*blockers: str, lift: str | None = None, riding: bool = False) -> RobotInTraffic:
    return RobotInTraffic(granted=(HERE,), destination=THERE, waits_for=blockers, lift=lift, riding=riding)


def text(first: RobotInTraffic, *, hold: str = "", closed_lifts: tuple[str, ...] = (), **others: RobotInTraffic) -> str:
    state = TrafficState(roadmap=1, robots={"Robot1": first, **others}, hold=hold, closed_lifts=closed_lifts)
    return waiting_text(first, state)


@pytest.mark.parametrize(
    ("blocker", "reason"),
    [
        (RobotInTraffic(mobility=Mobility.BUSY, command="Place", object="Table2"), "which puts something on Table2"),
        (RobotInTraffic(mobility=Mobility.BUSY, command="Charge"), "which charges"),
        (RobotInTraffic(mobility=Mobility.BUSY), "which works there"),
        (RobotInTraffic(mobility=Mobility.BUSY, paused=True), "which an operator has stopped"),
        (RobotInTraffic(mobility=Mobility.IMMOBILE), "which cannot move"),
        (RobotInTraffic(silent=True), "of which nobody knows where it is"),
        (robot("Robot3"), "which waits for Robot3"),
        (robot(lift="Lift1", riding=True), "which is in Lift1"),
        (RobotInTraffic(granted=(HERE, THERE), destination=THERE), "which has to go first"),
    ],
)
def test_a_robot_waits_for_another_and_it_is_said_what_that_one_does(blocker: RobotInTraffic, reason: str) -> None:
    assert text(robot("Robot2"), Robot2=blocker) == f"waits for Robot2, {reason}"


def test_in_a_fire_robots_wait_because_traffic_is_held_and_not_for_each_other() -> None:
    waits = text(robot("Robot2"), hold="fire alarm in Building1", Robot2=robot())
    assert waits == "waits because traffic is held: fire alarm in Building1"


def test_a_robot_waits_for_a_lift_until_it_comes_or_because_it_is_out_of_order() -> None:
    assert text(robot(lift="Lift1")) == "waits for Lift1"
    assert waits_for(robot(lift="Lift1")) == ("Lift1",)
    state = TrafficState(roadmap=1, robots={"Robot1": robot(lift="Lift1")}, shared_lifts=("Lift1",))
    assert waiting_text(robot(lift="Lift1"), state) == "waits for Lift1, which people or other systems use"
    assert text(robot(lift="Lift1"), closed_lifts=("Lift1",)).startswith("waits for Lift1, which nobody may enter now")
    assert text(robot(lift="Lift1", riding=True), closed_lifts=("Lift1",)).startswith("is in Lift1, which")


def test_robots_that_drive_have_arrived_or_are_stopped_do_not_wait() -> None:
    assert text(RobotInTraffic(granted=(HERE, THERE), destination=THERE)) == ""
    assert text(RobotInTraffic(granted=(HERE,))) == ""
    stopped = RobotInTraffic(granted=(HERE,), destination=THERE, waits_for=("Robot2",), paused=True)
    assert (text(stopped), waits_for(stopped)) == ("", ())


def test_a_robot_that_takes_no_part_says_why() -> None:
    assert text(RobotInTraffic(refusal="Robot1 stands where it sees no place of the roadmap")) == (
        "takes no part in traffic: Robot1 stands where it sees no place of the roadmap"
    )
