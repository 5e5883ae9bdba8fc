"""What a driver does about robots that stall, are stopped by hand, fall silent or restart; and what a robot does without its driver."""

from __future__ import annotations

import math

from somrs.adapters.arcos.driver import Driver
from somrs.adapters.arcos.events import (
    ActionDone,
    ActionFailed,
    Advance,
    BatteryLevel,
    Broken,
    FillBattery,
    Follow,
    GaveUp,
    Heard,
    Holds,
    Located,
    MoveGripper,
    Passed,
    Quit,
    Received,
    Tick,
    TurnTo,
)
from somrs.adapters.arcos.messages import GripperCommand
from somrs.adapters.arcos.motors import MotorsOff
from somrs.adapters.arcos.odometry import Pose
from somrs.adapters.arcos.simulated.body import Obstacle, Place
from tests.support.pioneers import AHEAD, Pioneer, events, perfect, stalled, under_way, way


def test_a_robot_whose_driver_died_stands_within_its_watchdog() -> None:
    pioneer = under_way()
    pioneer.is_connected = False
    start = pioneer.now
    assert pioneer.run(10, pioneer.stands)
    assert pioneer.now - start < 2.0 + 500 / 300 + 0.1  # and the time in which it brakes
    position = pioneer.body.place.x
    pioneer.run(60)
    assert pioneer.body.place.x == position


def test_a_robot_with_a_quick_watchdog_drives_faster() -> None:
    """It may be faster before its stops, because it stops sooner when it is told nothing more."""
    times = []
    for watchdog in (0.5, 2.0):
        pioneer = Pioneer(watchdog=watchdog).ready()
        start = pioneer.now
        assert pioneer.drive(way((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (2.0, 1.0)))
        times.append(pioneer.now - start)
    assert times[0] < 0.8 * times[1]


def test_a_robot_that_was_configured_for_gentle_braking_stops_as_reckoned() -> None:
    """It is told how to accelerate and brake when it is connected."""
    pioneer = Pioneer()
    pioneer.firmware.rates = [100.0, 60.0, 30.0, 20.0]
    pioneer.ready().run(1)
    pioneer.give(Follow(way((0.0, 0.0), (3.0, 0.0), (6.0, 0.0), released=2)))
    assert pioneer.run(30, lambda: pioneer.body.place.x > 1.5)
    pioneer.is_connected = False
    assert pioneer.run(10, pioneer.stands)
    assert pioneer.body.place.x < 3.0 + 0.1
    assert pioneer.firmware.rates[:2] == [300.0, 300.0]


def test_a_robot_that_cannot_be_observed_is_stopped() -> None:
    """Its reports are lost; what it is told arrives."""
    pioneer = under_way()
    pioneer.from_robot = lambda data: b""
    position = pioneer.body.place.x
    assert pioneer.run(3, pioneer.stands)
    assert pioneer.body.place.x - position < 0.7
    assert pioneer.run(6, lambda: pioneer.effects[-1] == Heard(False))
    assert not pioneer.run(10, lambda: not pioneer.stands())


def test_a_robot_goes_on_when_the_line_is_there_again() -> None:
    pioneer = under_way()
    pioneer.disconnect()
    assert Heard(False) in pioneer.effects
    pioneer.run(30)
    assert pioneer.stands()
    pioneer.connect()
    assert pioneer.run(60, lambda: Passed(2) in pioneer.effects and pioneer.stands())
    assert pioneer.distance_to(6.0, 0.0) < 0.05
    assert events(pioneer, Heard) == [Heard(True), Heard(False), Heard(True)]


def test_a_new_line_stops_a_robot_that_still_drives_before_anything_else() -> None:
    """Velocities of a program that died would go on with the first command, the watchdog having stopped them."""
    pioneer = under_way()
    pioneer.is_connected = False
    pioneer.run(10)
    follower = Pioneer()
    follower.firmware, follower.body = pioneer.firmware, pioneer.body
    position = pioneer.body.place.x
    follower.run(10)
    assert Heard(True) in follower.effects
    assert abs(follower.body.place.x - position) < 0.05


def test_a_driver_that_is_started_anew_goes_on_from_where_the_earlier_one_was() -> None:
    """Its robot is in the same session, and has rolled on meanwhile."""
    pioneer = under_way()
    reckoning = pioneer.driver.reckoning
    pioneer.is_connected = False
    pioneer.run(10)
    pioneer.driver = Driver(Pose(x=0.0, y=0.0, yaw=0.0), earlier=reckoning)
    pioneer.effects.clear()
    pioneer.connect()
    assert pioneer.run(5, lambda: Heard(True) in pioneer.effects)
    assert abs(pioneer.driver.pose.x - pioneer.body.place.x) < 0.02
    assert pioneer.body.place.x > 1.0


def test_a_driver_of_a_robot_that_was_off_begins_where_it_is_told() -> None:
    pioneer = under_way()
    reckoning = pioneer.driver.reckoning
    pioneer.is_connected = False
    pioneer.firmware = type(pioneer.firmware)(pioneer.body)
    pioneer.driver = Driver(Pose(x=0.5, y=0.0, yaw=0.0), earlier=reckoning)
    pioneer.effects.clear()
    pioneer.connect()
    assert pioneer.run(5, lambda: Heard(True) in pioneer.effects)
    assert pioneer.driver.pose.x == 0.5


def test_a_robot_that_was_restarted_is_connected_again_and_goes_on_from_where_it_stands() -> None:
    pioneer = under_way()
    pioneer.firmware = type(pioneer.firmware)(pioneer.body)
    assert pioneer.run(20, lambda: events(pioneer, Heard)[-2:] == [Heard(False), Heard(True)])
    assert pioneer.run(60, lambda: Passed(2) in pioneer.effects)
    assert pioneer.distance_to(6.0, 0.0) < 0.2  # it was not observed while it braked


def test_a_driver_that_quits_stops_its_robot_and_ends_the_session() -> None:
    pioneer = under_way()
    pioneer.give(Quit())
    assert pioneer.run(3, pioneer.stands)
    assert pioneer.firmware.step(0.2) == b""


def test_a_robot_that_cannot_be_reached_has_stopped_by_itself_when_it_is_told_to() -> None:
    pioneer = under_way()
    pioneer.disconnect()
    pioneer.halt()
    assert pioneer.stands()


def test_a_robot_whose_drive_breaks_is_broken_and_its_motors_are_switched_off() -> None:
    pioneer = under_way()
    assert "its motors stall in both directions" in str(stalled(pioneer).reason)
    assert pioneer.run(1, lambda: not pioneer.firmware._motors)
    pioneer.body.is_stuck = False
    position = pioneer.body.place
    pioneer.run(20)
    assert pioneer.body.place == position


def test_a_robot_whose_drive_was_mended_goes_on_when_its_motors_were_switched_on() -> None:
    pioneer = under_way()
    stalled(pioneer)
    pioneer.run(1)
    pioneer.body.is_stuck = False
    pioneer.firmware.switch_motors_on()
    assert pioneer.run(3, lambda: events(pioneer, Broken)[-1] == Broken(None))
    position = pioneer.body.place.x
    pioneer.run(5)
    assert pioneer.body.place.x == position
    pioneer.give(Follow(way((position, 0.0), (6.0, 0.0), start=10)))
    assert pioneer.run(60, lambda: Passed(11) in pioneer.effects)


def test_a_robot_whose_drive_broke_puts_down_what_it_holds_unless_its_stop_button_is_pressed() -> None:
    pioneer = under_way()
    stalled(pioneer)
    assert not isinstance(pioneer.act(MoveGripper(GripperCommand.OPEN)), ActionFailed)
    assert isinstance(pioneer.act(Advance(distance=0.1)), ActionFailed)
    pioneer.give(MoveGripper(GripperCommand.CLOSE))
    pioneer.firmware.stop_button = True
    assert pioneer.run(1, lambda: isinstance(pioneer.effects[-1], Broken))
    assert events(pioneer, ActionFailed)[-1] == ActionFailed(description="its stop button is pressed")
    assert pioneer.act(MoveGripper(GripperCommand.OPEN)) == ActionFailed(description="its stop button is pressed")


def test_a_robot_that_pushes_against_something_draws_back_and_gives_up() -> None:
    """It can go on elsewhere."""
    pioneer = under_way()
    pioneer.body.obstacles = (Obstacle(x=pioneer.body.place.x + 1.0, y=0.0, radius=0.2),)
    pioneer.body.echo = lambda x, y, heading: math.inf  # type: ignore[method-assign]
    assert pioneer.run(20, lambda: bool(events(pioneer, GaveUp)))
    touched = pioneer.body.obstacles[0].x - 0.2 - pioneer.body.radius
    pioneer.run(3)
    assert 0.01 < touched - pioneer.body.place.x < 0.06
    assert not events(pioneer, Broken)
    assert pioneer.firmware._motors


def test_a_robot_that_does_not_hear_how_it_is_to_draw_back_is_not_broken() -> None:
    pioneer = under_way()
    pioneer.body.is_stuck = True
    assert pioneer.run(3, lambda: pioneer.firmware._stalled > 0)
    pioneer.to_robot = lambda data: b""
    assert pioneer.run(10, lambda: bool(events(pioneer, GaveUp)))
    assert "motor is stalled" in str(events(pioneer, GaveUp)[0])
    assert not events(pioneer, Broken)


def test_a_robot_that_does_not_move_gives_up() -> None:
    """Its motors are on, and its wheels stand: nothing reports a stall."""
    pioneer = Pioneer().ready()
    pioneer.to_robot = lambda data: b""
    pioneer.give(Follow(AHEAD))
    assert pioneer.run(10, lambda: bool(events(pioneer, GaveUp)))
    assert "does not move" in str(events(pioneer, GaveUp)[0])


def test_something_that_sonar_does_not_see_is_met_by_the_bumpers() -> None:
    pioneer = Pioneer().ready()
    pioneer.body.obstacles = (Obstacle(x=2.0, y=0.1, radius=0.2),)
    pioneer.body.echo = lambda x, y, heading: math.inf  # type: ignore[method-assign]
    pioneer.give(Follow(AHEAD))
    assert pioneer.run(20, lambda: bool(events(pioneer, GaveUp)))
    assert "front bumpers" in str(events(pioneer, GaveUp)[0])


def test_the_stop_button_stops_a_robot_until_somebody_switches_its_motors_on() -> None:
    pioneer = under_way()
    pioneer.firmware.stop_button = True
    assert pioneer.run(3, pioneer.stands)
    assert events(pioneer, Broken) == [Broken("its stop button is pressed")]
    pioneer.firmware.stop_button = False
    pioneer.run(20)
    assert pioneer.stands()
    broken = events(pioneer, Broken)[-1]
    assert isinstance(broken, Broken)
    assert "MOTORS" in str(broken.reason)
    pioneer.firmware._motors = True
    assert pioneer.run(3, lambda: events(pioneer, Broken)[-1] == Broken(None))
    pioneer.run(10)
    assert pioneer.stands()


def test_a_broken_robot_does_nothing() -> None:
    pioneer = Pioneer().ready()
    pioneer.firmware.stop_button = True
    pioneer.run(1)
    assert pioneer.act(TurnTo(1.0)) == ActionFailed(description="its stop button is pressed")


def test_the_gripper_takes_what_is_between_its_paddles() -> None:
    pioneer = Pioneer().ready()
    pioneer.body.thing = (0.6, 0.0)
    assert not isinstance(pioneer.act(MoveGripper(GripperCommand.DEPLOY)), ActionFailed)
    approach = pioneer.act(Advance(distance=0.4, until_beam=True))
    assert not isinstance(approach, ActionFailed)
    assert approach.is_occupied
    closing = pioneer.act(MoveGripper(GripperCommand.CLOSE))
    assert not isinstance(closing, ActionFailed)
    assert closing.is_occupied
    pioneer.act(MoveGripper(GripperCommand.LIFT_UP))
    pioneer.act(Advance(distance=-0.2))
    assert abs(pioneer.body.place.x) < 0.05
    pioneer.act(MoveGripper(GripperCommand.OPEN))
    assert pioneer.body.thing != (0.6, 0.0)


def test_a_driver_says_whether_its_robot_holds_something() -> None:
    """A thing that stands between open paddles, or before closed ones, is not held."""
    pioneer = Pioneer()
    pioneer.body.thing = (0.35, 0.0)
    pioneer.ready().run(1)
    pioneer.act(MoveGripper(GripperCommand.OPEN))
    pioneer.act(MoveGripper(GripperCommand.CLOSE))
    pioneer.run(0.5)
    assert pioneer.driver.handle(Tick(), pioneer.now) == []
    assert events(pioneer, Holds)[-1] == Holds(True)
    pioneer.act(MoveGripper(GripperCommand.OPEN))
    pioneer.run(0.5)
    assert events(pioneer, Holds)[-1] == Holds(False)
    assert pioneer.body.has_thing


def test_what_slips_out_while_the_paddles_close_is_not_held() -> None:
    """Seen in the simulator: the thing was beside its place, and was carried away by a robot that held nothing."""
    pioneer = Pioneer()
    pioneer.body.thing = (0.35, 0.0)
    pioneer.body.is_slippery = True
    pioneer.ready().run(1)
    pioneer.act(MoveGripper(GripperCommand.OPEN))
    end = pioneer.act(MoveGripper(GripperCommand.CLOSE))
    assert not isinstance(end, ActionFailed)
    assert not end.is_occupied


def test_an_empty_gripper_says_so() -> None:
    pioneer = Pioneer().ready()
    pioneer.act(MoveGripper(GripperCommand.OPEN))
    end = pioneer.act(MoveGripper(GripperCommand.CLOSE))
    assert not isinstance(end, ActionFailed)
    assert not end.is_occupied


def test_a_gripper_that_is_stuck_fails() -> None:
    pioneer = Pioneer().ready()
    assert pioneer.firmware.gripper is not None
    pioneer.firmware.gripper.is_stuck = True
    end = pioneer.act(MoveGripper(GripperCommand.OPEN))
    assert isinstance(end, ActionFailed)
    assert "did not move" in end.description


def test_an_action_can_be_interrupted() -> None:
    pioneer = Pioneer().ready()
    pioneer.effects.clear()
    pioneer.give(MoveGripper(GripperCommand.OPEN))
    pioneer.run(1)
    pioneer.halt()
    assert len(events(pioneer, ActionFailed)) == 1


def test_a_robot_without_gripper_is_known_as_one() -> None:
    pioneer = Pioneer(gripper=False).ready()
    pioneer.run(2)
    assert not pioneer.driver.has_gripper

    pioneer = Pioneer().ready()
    pioneer.run(2)
    assert pioneer.driver.has_gripper


def at_charger() -> Pioneer:
    """A robot that charges: its controller keeps the motors off meanwhile."""
    pioneer = Pioneer().ready()
    pioneer.body.charger, pioneer.body.charge = (0.0, 0.0), 0.8
    pioneer.give(FillBattery())
    assert pioneer.run(2, lambda: not pioneer.firmware._motors)
    return pioneer


def test_a_robot_charges_until_its_battery_is_full_and_drives_on() -> None:
    pioneer = at_charger()
    assert pioneer.run(30, lambda: pioneer._end() is not None)
    assert isinstance(pioneer._end(), ActionDone)
    assert pioneer.body.charge == 1.0
    pioneer.run(20)
    assert events(pioneer, BatteryLevel)[-1] == BatteryLevel(100)
    assert pioneer.driver.motors_off is None
    assert isinstance(pioneer.act(Advance(distance=0.5)), ActionDone)


def test_a_charger_without_power_is_reported() -> None:
    pioneer = Pioneer().ready()
    assert pioneer.act(FillBattery(), 30) == ActionFailed(description="the charger gives no power")
    assert isinstance(pioneer.act(Advance(distance=0.5)), ActionDone)


def test_a_program_that_finds_its_robot_at_a_charger_takes_it_from_there() -> None:
    pioneer = at_charger()
    pioneer.driver = Driver(pioneer.driver.pose, earlier=pioneer.driver.reckoning)
    pioneer.effects.clear()
    pioneer.connect()
    assert pioneer.run(20, lambda: Heard(True) in pioneer.effects)
    pioneer.run(5)
    assert pioneer.driver.motors_off is None
    assert isinstance(pioneer.act(Advance(distance=0.5)), ActionDone)


def test_a_stop_button_that_is_pressed_at_a_charger_is_heeded() -> None:
    pioneer = at_charger()
    pioneer.firmware.stop_button = True
    pioneer.run(1)
    assert pioneer.driver.motors_off is MotorsOff.BY_HAND


def test_a_pushed_robot_knows_where_it_was_pushed_while_it_is_connected() -> None:
    pioneer = Pioneer().ready()
    for _ in range(100):
        pioneer.body.place = Place(x=pioneer.body.place.x + 0.01, y=0.0, yaw=0.0)
        pioneer.run(0.1)
    assert abs(pioneer.driver.pose.x - 1.0) < 0.02


def test_a_counter_that_begins_anew_does_not_move_the_robot() -> None:
    pioneer = under_way()
    pioneer.run(5)
    pose = pioneer.driver.pose
    pioneer.firmware._counted = (50_000.0, 0.0, 0.0)
    pioneer.run(0.2)
    assert abs(pioneer.driver.pose.x - pose.x) < 0.3


def test_odometry_outlives_the_wrapping_of_its_counters() -> None:
    """A P3-DX counts 0.485 mm: 15 bits are 16 m."""
    pioneer = Pioneer(subclass="p3dx").ready()
    points = [(0.0, 0.0), (12.0, 0.0), (24.0, 0.0), (36.0, 0.0), (36.0, 20.0)]
    assert pioneer.drive(way(*points), 400)
    assert pioneer.distance_to(36.0, 20.0) < 0.05


def test_what_a_robot_reported_long_ago_is_no_news() -> None:
    """A packet that seemed to begin holds reports back until enough bytes have come."""
    pioneer = Pioneer().ready()
    pioneer.give(Received(b"\xfa\xfb\xf9"))
    pioneer.run(0.2)
    pioneer.from_robot = lambda data: b""
    pioneer.body.place = Place(x=1.0, y=0.0, yaw=0.0)
    pioneer.run(2)
    pioneer.from_robot = perfect
    pioneer.effects.clear()
    pioneer.run(1)
    assert {round(effect.pose.x, 2) for effect in pioneer.effects if isinstance(effect, Located)} == {1.0}


def test_noise_on_the_line_moves_nothing() -> None:
    pioneer = Pioneer().ready()
    position = pioneer.body.place
    for value in range(256):
        pioneer.give(Received(bytes([value, 0xFA, 0xFB, value])))
        pioneer.run(0.1)
    assert pioneer.body.place == position
