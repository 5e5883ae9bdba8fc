"""Vehicles are paused, driven by hand, warn, and say nothing: their work waits, is given up, or goes on."""

from __future__ import annotations

import itertools

import pytest

from somrs.adapters.vda5050.control.exchange import (
    ActionEnded,
    Broken,
    Delayed,
    Follow,
    GaveUp,
    Halted,
    Located,
    Pause,
    Perform,
    Remarked,
    Resume,
    Send,
    Subscribed,
    Tick,
    Warned,
)
from somrs.adapters.vda5050.control.vehicle import VehicleControl
from somrs.adapters.vda5050.frames import Frames
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.messages.orders import InstantActions
from somrs.adapters.vda5050.messages.states import ErrorLevel, OperatingMode, VehicleError
from somrs.adapters.vda5050.simulated.exchange import Faulted, Pressed, Repaired, Switched
from tests.support.vda5050_pair import Pair, way
from tests.unit.adapters.vda5050.test_doubtful_vehicles import there

VERSIONS = pytest.mark.parametrize("version", [Version.V2_1, Version.V3_0])


# An operator stops the vehicle.


@VERSIONS
def test_a_vehicle_that_an_operator_stops_stands_still_and_goes_on_afterwards(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C")
    pair.run(1)
    pair.do(Pause())
    pair.run(20)
    x = pair.body.x
    assert 0.5 < x < 1.5
    assert pair.vehicle.state().paused
    pair.do(Resume())
    pair.run(10)
    assert pair.body.x == 4.0
    assert len(pair.orders()) == 1
    assert pair.instant_actions().count("startPause") == pair.instant_actions().count("stopPause") == 1
    assert pair.of(GaveUp, Broken) == []


@VERSIONS
def test_a_pause_whose_messages_are_lost_is_said_again(version: Version) -> None:
    lost = iter([1, 1, 0, 0])
    pair = Pair(version, lambda topic: next(lost, 1) if topic is Topic.INSTANT_ACTIONS else 1)
    pair.follow("A", "B", "C", "D", "E", "F", "G", "H", "I")
    pair.run(1)
    lost = iter([0, 0])
    pair.do(Pause())
    pair.run(10)
    assert pair.vehicle.state().paused
    lost = iter([0, 0])
    pair.do(Resume())
    pair.run(20)
    assert not pair.vehicle.state().paused
    assert pair.body.x == 16.0


@VERSIONS
def test_a_stopped_vehicle_gets_no_order(version: Version) -> None:
    pair = Pair(version)
    pair.do(Pause())
    pair.follow("A", "B")
    pair.run(10)
    assert pair.orders() == []
    pair.do(Resume())
    pair.run(5)
    assert pair.body.x == 2.0


@VERSIONS
def test_a_pause_at_the_vehicle_is_waited_for_and_left_to_those_there(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C")
    pair.run(1)
    pair.tell(Pressed(pauses=True))
    pair.run(120)
    assert pair.of(Delayed) == [Delayed(reason="is paused")]
    assert "stopPause" not in pair.instant_actions()
    pair.tell(Pressed(pauses=False))
    pair.run(10)
    assert pair.of(Delayed)[-1] == Delayed(reason=None)
    assert pair.body.x == 4.0
    assert pair.of(GaveUp, Broken) == []


@VERSIONS
def test_who_lets_a_stopped_vehicle_go_on_at_the_vehicle_is_not_heard(version: Version) -> None:
    pair = Pair(version)
    pair.do(Pause())
    pair.run(5)
    pair.tell(Pressed(pauses=False))
    pair.run(5)
    assert pair.vehicle.state().paused


@VERSIONS
def test_a_pause_ends_also_when_the_program_has_restarted_meanwhile(version: Version) -> None:
    pair = Pair(version)
    pair.do(Pause())
    pair.run(5)
    identifiers = itertools.count(1000)
    pair.control = VehicleControl(Frames(), version, lambda: f"id-{next(identifiers)}")
    pair.run(5)
    assert not pair.vehicle.state().paused


@VERSIONS
def test_a_stopped_vehicle_can_be_halted(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C")
    pair.run(1)
    pair.do(Pause())
    pair.run(1)
    pair.halt()
    pair.run_until(Halted)
    pair.do(Resume())
    x = pair.body.x
    pair.run(5)
    assert pair.body.x == x


# Somebody takes over.


HAND_MODES = pytest.mark.parametrize("mode", [OperatingMode.MANUAL, OperatingMode.SERVICE, OperatingMode.TEACH_IN])


@HAND_MODES
@VERSIONS
def test_a_vehicle_that_is_driven_by_hand_leaves_its_duty_and_is_sent_nothing(version: Version, mode: OperatingMode) -> None:
    pair = Pair(version)
    pair.do(Perform(action_type="pick"))
    pair.run(1)
    pair.forget()
    pair.tell(Switched(mode=mode))
    pair.do(Pause())
    pair.run(30)
    assert [effect.failure for effect in pair.effects if isinstance(effect, ActionEnded)] == [f"is in the operating mode {mode}"]
    assert pair.commands == []
    pair.halt()
    assert pair.of(Halted) == [Halted()]
    assert pair.commands == []
    pair.do(Resume())
    pair.tell(Switched(mode=OperatingMode.AUTOMATIC))
    pair.follow("A", "B")
    pair.run(5)
    assert pair.of(Broken)[-1] == Broken(reason=None)
    assert pair.body.x == 2.0


def test_a_vehicle_in_semiautomatic_mode_is_on_duty() -> None:
    pair = Pair(Version.V3_0)
    pair.tell(Switched(mode=OperatingMode.SEMIAUTOMATIC))
    pair.follow("A", "B")
    pair.run(5)
    assert pair.body.x == 2.0
    assert pair.of(Broken) == []


def test_a_vehicle_that_is_intervened_gets_its_order_cancelled_and_no_other_instant_action() -> None:
    pair = Pair(Version.V3_0)
    pair.follow("A", "B", "C")
    pair.run(1)
    pair.forget()
    pair.tell(Switched(mode=OperatingMode.INTERVENED))
    pair.do(Pause())
    pair.run(10)
    assert set(pair.instant_actions()) == {"cancelOrder"}
    pair.do(Resume())
    x = pair.body.x
    pair.tell(Switched(mode=OperatingMode.AUTOMATIC))
    pair.run(10)
    assert pair.body.x == x, "it does not drive on by itself"


def test_where_a_vehicle_is_that_starts_up_is_not_believed() -> None:
    pair = Pair(Version.V3_0)
    pair.tell(Switched(mode=OperatingMode.STARTUP))
    pair.forget()
    pair.run(3)
    assert pair.of(Located) == []
    pair.tell(Switched(mode=OperatingMode.AUTOMATIC))
    pair.run(1)
    assert pair.of(Located) != []


# It warns.


def test_a_warning_is_told_and_the_vehicle_goes_on() -> None:
    pair = Pair(Version.V3_0)
    pair.follow("A", "B", "C")
    pair.run(1)
    pair.tell(Faulted(error=VehicleError(error_type="DIRTY_LIDAR", error_level=ErrorLevel.WARNING, error_hint="clean it")))
    pair.tell(Faulted(error=VehicleError(error_type="BATTERY_LOW", error_level=ErrorLevel.URGENT)))
    pair.run(10)
    assert pair.of(Remarked)[-1] == Remarked(text="DIRTY_LIDAR: clean it; BATTERY_LOW (needs attention)")
    assert pair.of(Warned) == [
        Warned(description="DIRTY_LIDAR: clean it"),
        Warned(description="BATTERY_LOW", is_urgent=True),
    ]
    assert pair.body.x == 4.0
    pair.tell(Repaired())
    pair.run(1)
    assert pair.of(Remarked)[-1] == Remarked(text=None)


def test_a_warning_with_another_number_each_time_is_told_once() -> None:
    dialogue = there()
    for level in range(40, 20, -1):
        dialogue.state(errors=[{"errorType": "batteryLow", "errorLevel": "WARNING", "errorDescription": f"{level} %"}])
    assert [effect for effect in dialogue.effects if isinstance(effect, Warned)] == [Warned(description="batteryLow: 40 %")]
    assert [effect for effect in dialogue.effects if isinstance(effect, Remarked)][-1] == Remarked(text="batteryLow: 21 %")


def test_what_a_vehicle_says_about_messages_is_not_for_those_who_wait_for_it() -> None:
    pair = Pair(Version.V3_0)
    pair.do(Perform(action_type="dance"))
    pair.run(5)
    assert [effect.description for effect in pair.effects if isinstance(effect, Warned)] == ["INVALID_ORDER_ACTION: dance"]
    assert pair.of(Remarked) == []


# It says nothing.


@VERSIONS
def test_a_vehicle_whose_retained_messages_are_lost_is_asked(version: Version) -> None:
    pair = Pair(version, lambda topic: int(topic not in (Topic.CONNECTION, Topic.FACTSHEET, Topic.STATE)))
    pair.forget()
    pair.do(Subscribed())
    pair.fate = lambda topic: 1
    pair.run(2)
    assert pair.control.vehicle.is_connected
    assert pair.control.vehicle.factsheet is not None
    pair.follow("A", "B")
    pair.run(5)
    assert pair.body.x == 2.0


def test_a_vehicle_that_is_not_there_is_not_asked_for_ever() -> None:
    identifiers = itertools.count()
    control = VehicleControl(Frames(), Version.V2_1, lambda: str(next(identifiers)))
    effects = control.handle(Subscribed(), 0.0) + control.handle(Follow(way=way("A", "B")), 0.0)
    for second in range(1, 100):
        effects += control.handle(Tick(), float(second))
    sent = [effect.message for effect in effects if isinstance(effect, Send)]
    types = [action.action_type for message in sent if isinstance(message, InstantActions) for action in message.actions]
    assert types == ["stateRequest", "factsheetRequest"] * 3
    assert len(sent) == 6
