"""What a person has stopped does not drive on, whatever is reset or started anew; and a robot that touches something stops at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from somrs.adapters.arcos.driver import Driver
from somrs.adapters.arcos.events import ActionDone, ActionFailed, Advance, Broken, Follow, GaveUp, Heard, Passed, TurnTo
from somrs.adapters.arcos.motors import WHY_OFF, MotorsOff
from somrs.adapters.arcos.odometry import Pose, Reckoning
from somrs.adapters.arcos.stalls import is_towards
from somrs.adapters.arcos.steering import Speeds
from somrs.adapters.arcos.stored_reckoning import Stored, load_reckoning, store_reckoning
from tests.support.pioneers import AHEAD, Pioneer, events, stalled, under_way, way

BY_HAND = WHY_OFF[MotorsOff.BY_HAND]


def restarted(pioneer: Pioneer, motors_off: MotorsOff | None) -> None:
    """Another program takes the robot on, in the session as it is. `motors_off`: what the earlier one has stored."""
    pioneer.driver = Driver(pioneer.driver.pose, earlier=pioneer.driver.reckoning, motors_off=motors_off)
    pioneer.effects.clear()
    pioneer.connect()
    assert pioneer.run(20, lambda: Heard(True) in pioneer.effects)


def switched_off_by_hand() -> Pioneer:
    """A robot whose motors somebody has switched off while it drove."""
    pioneer = under_way()
    pioneer.firmware._motors = False
    assert pioneer.run(2, lambda: events(pioneer, Broken) == [Broken(BY_HAND)])
    return pioneer


@pytest.mark.parametrize("is_line_lost", [True, False], ids=["switched off and on", "reset"])
def test_motors_that_a_person_has_switched_off_stay_off_when_the_controller_begins_anew(is_line_lost: bool) -> None:
    """Seen: after a reset, or when the robot was switched off and on, it drove on by itself eight seconds later."""
    pioneer = switched_off_by_hand()
    if is_line_lost:
        pioneer.disconnect()
    pioneer.firmware = type(pioneer.firmware)(pioneer.body)
    pioneer.run(3)
    if is_line_lost:
        pioneer.connect()
    assert pioneer.run(10, lambda: events(pioneer, Heard)[-2:] == [Heard(False), Heard(True)])
    pioneer.give(Follow(AHEAD))
    assert not pioneer.run(20, lambda: pioneer.firmware._motors)
    assert events(pioneer, Broken) == [Broken(BY_HAND)]
    pioneer.firmware.switch_motors_on()
    assert pioneer.run(2, lambda: events(pioneer, Broken)[-1] == Broken(None))


def test_motors_that_a_person_has_switched_off_stay_off_when_another_program_takes_the_robot_on() -> None:
    pioneer = switched_off_by_hand()
    restarted(pioneer, pioneer.driver.motors_off)
    assert not pioneer.run(10, lambda: pioneer.firmware._motors)
    assert events(pioneer, Broken) == [Broken(BY_HAND)]
    pioneer.firmware = type(pioneer.firmware)(pioneer.body)
    restarted(pioneer, pioneer.driver.motors_off)
    assert not pioneer.run(10, lambda: pioneer.firmware._motors)
    assert events(pioneer, Broken) == [Broken(BY_HAND)]


def test_motors_that_a_person_has_switched_off_while_no_program_ran_stay_off() -> None:
    """In a session that goes on, the earlier program had switched them on."""
    pioneer = under_way()
    pioneer.is_connected = False
    pioneer.firmware._motors = False
    pioneer.run(5)
    restarted(pioneer, None)
    assert not pioneer.run(10, lambda: pioneer.firmware._motors)
    assert events(pioneer, Broken) == [Broken(BY_HAND)]


def test_motors_that_a_person_has_switched_on_while_no_program_ran_are_on() -> None:
    pioneer = switched_off_by_hand()
    pioneer.is_connected = False
    pioneer.firmware.switch_motors_on()
    restarted(pioneer, pioneer.driver.motors_off)
    assert not pioneer.run(5, lambda: not pioneer.firmware._motors)
    assert events(pioneer, Broken)[-1:] in ([], [Broken(None)])


def test_a_robot_whose_drive_broke_has_its_motors_off_when_another_program_takes_it_on() -> None:
    pioneer = under_way()
    stalled(pioneer)
    assert pioneer.run(1, lambda: not pioneer.firmware._motors)
    pioneer.firmware = type(pioneer.firmware)(pioneer.body)
    restarted(pioneer, pioneer.driver.motors_off)
    assert not pioneer.run(10, lambda: pioneer.firmware._motors)
    assert "stall in both directions" in str(events(pioneer, Broken)[-1])


def test_a_robot_that_is_connected_with_its_stop_button_pressed_waits_for_its_motors_to_be_switched_on() -> None:
    pioneer = Pioneer()
    pioneer.firmware.stop_button = True
    assert pioneer.run(10, lambda: bool(events(pioneer, Broken)))
    pioneer.run(1)
    pioneer.firmware.stop_button = False
    assert not pioneer.run(10, lambda: pioneer.firmware._motors)
    assert events(pioneer, Broken)[-1] == Broken(BY_HAND)


@pytest.mark.parametrize("heeds_bumpers", [True, False], ids=["controller stalls", "controller does not stall"])
def test_a_robot_stops_as_fast_as_it_can_when_a_bumper_touches_something(heeds_bumpers: bool) -> None:
    """Seen with a controller that leaves BUMPSTALL unheeded: the robot rolled on for 30 cm."""
    pioneer = under_way()
    pioneer.firmware.heeds_bumpers = heeds_bumpers
    pioneer.body.pressed = "front"
    position = pioneer.body.place.x
    assert pioneer.run(3, pioneer.stands)
    assert pioneer.body.place.x - position < 0.17


@pytest.mark.parametrize("heeds_bumpers", [True, False], ids=["controller stalls", "controller does not stall"])
def test_a_robot_does_not_drive_on_while_its_bumper_is_pressed(heeds_bumpers: bool) -> None:
    """Seen: the next trips led on for four metres."""
    pioneer = under_way()
    pioneer.firmware.heeds_bumpers = heeds_bumpers
    pioneer.body.pressed = "front"
    assert pioneer.run(10, lambda: bool(events(pioneer, Broken)))
    assert events(pioneer, Broken) == [Broken("its front bumpers touch something")]
    assert GaveUp("its front bumpers touch something") in pioneer.effects
    position = pioneer.body.place.x
    for number in range(3):
        pioneer.give(Follow(way((position, 0.0), (6.0, 0.0), start=10 * (number + 1))))
        pioneer.run(10)
    assert pioneer.act(TurnTo(1.0)) == ActionFailed(description="its front bumpers touch something")
    assert abs(pioneer.body.place.x - position) < 0.01
    pioneer.body.pressed = None
    assert pioneer.run(1, lambda: events(pioneer, Broken)[-1:] == [Broken(None)])
    pioneer.give(Follow(way((position, 0.0), (6.0, 0.0), start=50)))
    assert pioneer.run(60, lambda: Passed(51) in pioneer.effects)


def test_a_robot_that_stands_drives_away_from_what_its_bumper_touches_but_not_towards_it() -> None:
    pioneer = Pioneer().ready()
    pioneer.body.pressed = "rear"
    assert isinstance(pioneer.act(Advance(distance=0.3)), ActionDone)
    assert abs(pioneer.body.place.x - 0.3) < 0.02
    assert pioneer.act(Advance(distance=-0.3)) == ActionFailed(description="its rear bumpers touch something")
    assert 0.28 < pioneer.body.place.x < 0.4


def test_a_robot_that_is_touched_on_both_sides_stands() -> None:
    assert is_towards(("front", "rear"), Speeds(forward=0.1))
    assert is_towards(("front", "rear"), Speeds(forward=-0.1))
    assert is_towards(("front",), Speeds(turning=0.1))
    assert not is_towards(("front",), Speeds(forward=-0.1, turning=0.1))
    assert not is_towards(("front", "rear"), Speeds())


def test_it_is_stored_why_motors_are_off(tmp_path: Path) -> None:
    pose = Pose(x=1.0, y=2.0, yaw=0.5)
    stored = Stored(reckoning=Reckoning(pose=pose, x=1, y=2, heading=3), on_map=pose, motors_off=MotorsOff.BY_HAND)
    store_reckoning(tmp_path / "Robot1.json", stored)
    assert load_reckoning(tmp_path / "Robot1.json") == stored
    earlier = (tmp_path / "Robot1.json").read_text().replace(',"motors_off":"by_hand"', "")
    (tmp_path / "Robot1.json").write_text(earlier)
    loaded = load_reckoning(tmp_path / "Robot1.json")
    assert loaded is not None
    assert loaded.motors_off is None
