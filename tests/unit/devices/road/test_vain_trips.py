"""Robots that cannot drive on from where they stand are not asked to make room for others."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from somrs.devices.road.traveller import Traveller
from somrs.devices.road.vain_trips import LONGEST_RETRY, RETRY, VainTrips
from somrs.protocol.messages.traffic import Mobility
from somrs.traffic.robot_tasks import MobilityChanged, TripWanted
from tests.support.outside_robot import OutsideRobot

HERE, ELSEWHERE = (1.0, 2.0), (1.3, 2.0)
WHY = "something is in the way"


def test_who_gives_up_for_the_first_time_may_try_another_way() -> None:
    trips = VainTrips()
    assert trips.add(HERE, WHY) is None
    assert trips.add(ELSEWHERE, WHY) is None


def test_who_gives_up_again_rests_longer_each_time() -> None:
    trips = VainTrips()
    trips.add(HERE, WHY)
    rests = [trips.add(HERE, WHY) for _ in range(10)]
    assert rests[:3] == [RETRY, 2 * RETRY, 4 * RETRY]
    assert rests[-1] == LONGEST_RETRY


def test_who_has_moved_begins_anew() -> None:
    trips = VainTrips()
    trips.add(HERE, WHY)
    trips.add(HERE, WHY)
    assert not trips.is_over((1.05, 2.0))
    assert trips.reason == WHY
    assert trips.is_over(ELSEWHERE)
    assert not trips.reason
    assert not trips.is_over(HERE)
    assert trips.add(HERE, WHY) is None


def play(actions: Callable[[Traveller], None]) -> list[object]:
    """What the program of a robot in traffic is told, when the robot has given up twice, and then does this."""

    async def run() -> list[object]:
        road, notices = OutsideRobot("Robot1").road, list[object]()
        road.tell = notices.append
        road.located(*HERE, 0.0, 0.0)
        road.gave_up(WHY)
        road.gave_up(WHY)
        actions(road)
        return [notice for notice in notices if isinstance(notice, MobilityChanged | TripWanted)]

    return asyncio.run(run())


def test_traffic_takes_a_robot_that_gave_up_twice_for_one_that_cannot_move() -> None:
    assert play(lambda road: None) == [MobilityChanged(Mobility.IMMOBILE)]


def test_a_robot_that_moves_can_make_room_again() -> None:
    assert play(lambda road: road.located(*ELSEWHERE, 0.0, 0.0))[-1] == MobilityChanged(Mobility.FREE)
