"""What is said of robots that do not answer, do not obey, or send damaged packets."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from somrs.adapters.arcos.driver import Driver
from somrs.adapters.arcos.events import Connected, Disconnected, Effect, Follow, GaveUp, Heard, LineIsPoor, Received, Tick, Transmit
from somrs.adapters.arcos.odometry import Pose
from somrs.adapters.arcos.simulated.firmware import packet
from tests.support.pioneers import AHEAD, Pioneer, damaged, events, perfect, under_way, way

MINUTES = 180.0


def told_of(answer: Callable[[int], bytes]) -> list[Effect]:
    """What is said in three minutes of a robot that sends this, by the number of the step of 0.05 s, and whatever it is told."""
    driver, effects = Driver(Pose(x=0.0, y=0.0, yaw=0.0)), list[Effect]()
    effects += driver.handle(Connected(), 0.0)
    for step in range(1, round(MINUTES / 0.05)):
        if data := answer(step):
            effects += driver.handle(Received(data), step * 0.05)
        effects += driver.handle(Tick(), step * 0.05)
    return [effect for effect in effects if not isinstance(effect, Transmit)]


def every(period: int, data: bytes) -> Callable[[int], bytes]:
    return lambda step: data if step % period == 0 else b""


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        (lambda step: b"", "nothing comes"),
        (every(2, b"\x80\xe0\x00\x1c"), "baud rate"),
        (every(2, packet(b"\x05")), "another program"),
    ],
    ids=["silence", "noise", "other packets"],
)
def test_a_handshake_that_fails_is_said_once_with_what_came(answer: Callable[[int], bytes], problem: str) -> None:
    """Seen: three minutes of OPEN and CLOSE, and no word of it."""
    (heard,) = told_of(answer)
    assert isinstance(heard, Heard)
    assert not heard.is_connected
    assert problem in str(heard.problem)


def test_a_robot_that_opens_a_session_and_reports_nothing_is_said_to() -> None:
    pioneer = Pioneer()
    pioneer.from_robot = lambda data: b"" if pioneer.firmware._is_open else data
    pioneer.run(60)
    assert events(pioneer, Heard) == [Heard(False, "it opens a session, and reports nothing then")]
    pioneer.from_robot = perfect
    assert pioneer.run(20, lambda: Heard(True) in pioneer.effects)


def test_a_port_that_cannot_be_opened_is_said_once() -> None:
    driver = Driver(Pose(x=0.0, y=0.0, yaw=0.0))
    assert driver.handle(Disconnected("it is refused"), 0.0) == [Heard(False, "it is refused")]
    assert driver.handle(Disconnected("it is refused"), 1.0) == []


def test_a_robot_that_ignores_commands_is_stopped_by_its_watchdog_and_said_to() -> None:
    """Seen: it drove six metres past its goal, as each command that it ignored began its watchdog anew."""
    pioneer = Pioneer().ready()
    pioneer.give(Follow(way((0.0, 0.0), (4.0, 0.0))))
    assert pioneer.run(20, lambda: pioneer.body.place.x > 2.0)
    pioneer.obeys = lambda data: False
    assert pioneer.run(30, lambda: Heard(False) in [Heard(effect.is_connected) for effect in pioneer.effects if isinstance(effect, Heard)])
    assert "does not do what it is told" in str(events(pioneer, Heard)[-1])
    assert pioneer.run(6, pioneer.stands)
    assert pioneer.body.place.x < 5.5
    position = pioneer.body.place.x
    pioneer.obeys = lambda data: True
    assert pioneer.run(20, lambda: events(pioneer, Heard)[-1] == Heard(True))
    assert any(isinstance(effect, GaveUp) and "what it is told" in effect.description for effect in pioneer.effects)
    pioneer.run(5)
    assert abs(pioneer.body.place.x - position) < 0.02
    assert abs(pioneer.driver.pose.x - position) < 0.05


def test_a_robot_whose_reports_are_late_is_said_to() -> None:
    """Seen: with reports of a second ago, it turned to and fro for 25 s."""
    pioneer, reports = Pioneer().ready(), [b""] * 50
    pioneer.give(Follow(way((0.0, 0.0), (0.0, 3.0))))
    for _ in range(round(20 / 0.02)):
        pioneer.now += 0.02
        reports.append(pioneer.firmware.step(0.02))
        if data := reports.pop(0):
            pioneer.give(Received(data))
        pioneer.give(Tick())
    assert any("reports late" in str(heard) for heard in events(pioneer, Heard))


def test_a_line_that_damages_packets_is_said_to() -> None:
    """Seen: one packet of twenty was damaged, and nobody was told."""
    pioneer, chance = Pioneer().ready(), random.Random(1)
    pioneer.run(65)
    assert not events(pioneer, LineIsPoor)
    pioneer.from_robot = lambda data: data[:-1] + b"\0" if data and chance.random() < 0.05 else data
    pioneer.run(125)
    (poor,) = events(pioneer, LineIsPoor)
    assert isinstance(poor, LineIsPoor)
    assert poor.share is not None
    assert 0.01 < poor.share < 0.15
    pioneer.from_robot = perfect
    pioneer.run(65)
    assert events(pioneer, LineIsPoor)[-1] == LineIsPoor(None)


def test_lost_commands_and_a_person_who_pushes_are_no_disobedience() -> None:
    pioneer, chance = under_way(), random.Random(2)
    pioneer.to_robot = lambda data: damaged(data, chance, 0.01)
    pioneer.give(Follow(AHEAD))
    pioneer.run(20)
    assert [*events(pioneer, Heard), *events(pioneer, GaveUp)] == [Heard(True)]
