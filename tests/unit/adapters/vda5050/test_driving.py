"""A vehicle drives along its way, whatever becomes of the messages."""

from __future__ import annotations

import random
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.adapters.vda5050.control.exchange import Broken, Follow, GaveUp, Halted, Located, Passed, Reachable, Warned
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.messages.states import ErrorLevel, OperatingMode, State, VehicleError
from somrs.adapters.vda5050.simulated.body import Rest
from somrs.adapters.vda5050.simulated.exchange import Faulted, Misbehaves, Repaired, Restarted, Switched
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from tests.support.vda5050_pair import Pair, way

VERSIONS = pytest.mark.parametrize("version", [Version.V2_1, Version.V3_0])


@VERSIONS
def test_a_way_is_an_order(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C", "D", released=3)
    pair.run(10)
    assert pair.passed() == [1, 2]
    assert pair.body.x == 4.0, "it stops at the end of its base"
    (order,) = pair.orders()
    assert [(node.node_id, node.sequence_id, node.released) for node in order.nodes] == [
        ("A", 0, True),
        ("B", 2, True),
        ("C", 4, True),
        ("D", 6, False),
    ]
    assert [(edge.edge_id, edge.maximum_speed) for edge in order.edges] == [("A-B", 1.0), ("B-C", 1.0), ("C-D", 1.0)]


@VERSIONS
def test_more_that_is_released_extends_the_base(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C", "D", released=2)
    pair.run(1)
    pair.follow("A", "B", "C", "D", released=3)
    pair.run(1)
    pair.follow("A", "B", "C", "D", released=4)
    pair.run(10)
    assert pair.body.x == 6.0
    assert pair.passed() == [1, 2, 3]
    assert [order.order_update_id for order in pair.orders()] == [0, 1, 2]
    assert len({order.order_id for order in pair.orders()}) == 1
    assert [order.nodes[0].node_id for order in pair.orders()] == ["A", "B", "C"], "each begins at the decision point"


@VERSIONS
def test_a_base_that_grows_in_time_is_driven_without_a_stop(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C", "D", released=2)
    pair.run(1)
    pair.follow("A", "B", "C", "D", released=4)
    pair.run_until(Passed)
    pair.run(5)
    driving = [message.driving for message in pair.reported if isinstance(message, State)]
    assert driving[: driving.index(True)] == [False] * driving.index(True)
    first, final = driving.index(True), len(driving) - 1 - driving[::-1].index(True)
    assert all(driving[first:final])


@VERSIONS
def test_the_horizon_can_change(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C", released=2)
    pair.run(0.5)
    pair.follow("A", "B", "E", "F", released=2)
    pair.run(0.5)
    pair.follow("A", "B", "E", "F", released=4)
    pair.run(20)
    assert pair.body.x == 10.0
    assert pair.of(GaveUp) == []


@VERSIONS
def test_the_next_trip_is_an_order_of_its_own(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B")
    pair.run(5)
    pair.follow("B", "C", first=1)
    pair.run(5)
    assert pair.body.x == 4.0
    assert len({order.order_id for order in pair.orders()}) == 2
    assert pair.passed() == [1, 2]


@VERSIONS
def test_halting_stops_the_vehicle_where_it_is(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C")
    pair.run(1)
    pair.halt()
    pair.run_until(Halted)
    assert 0.5 < pair.body.x < 1.5
    position = pair.body.x
    pair.run(5)
    assert pair.body.x == position
    assert pair.instant_actions().count("cancelOrder") == 1


@VERSIONS
def test_a_way_after_a_halt_begins_between_two_places(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C")
    pair.run(1)
    pair.halt()
    pair.run_until(Halted)
    pair.forget()
    pair.follow("A", "B", first=7)
    pair.run(5)
    assert pair.body.x == 2.0
    assert pair.of(GaveUp) == []
    assert pair.passed() == [8]


@VERSIONS
def test_halting_a_vehicle_that_stands_is_done_at_once(version: Version) -> None:
    pair = Pair(version)
    pair.halt()
    assert pair.of(Halted) == [Halted()]
    pair.follow("A", "B")
    pair.run(5)
    pair.forget()
    pair.halt()
    assert pair.of(Halted) == [Halted()]
    assert pair.commands == []


@VERSIONS
def test_halted_is_who_stands_and_not_who_says_that_the_order_is_cancelled(version: Version) -> None:
    pair = Pair(version)
    pair.tell(Misbehaves(rolls_on=True))
    pair.follow("A", "B", "C")
    pair.run(1)
    pair.halt()
    pair.run(1)
    assert pair.of(Halted) == []
    pair.run_until(Halted)
    assert pair.body.x == 4.0


@VERSIONS
def test_a_cancellation_that_is_ignored_is_repeated_and_never_taken_for_done(version: Version) -> None:
    pair = Pair(version)
    pair.tell(Misbehaves(ignores_cancel=True))
    pair.follow("A", "B", "C", "D", released=3)
    pair.run(1)
    pair.halt()
    pair.run(20)
    assert pair.of(Halted) == []
    assert pair.instant_actions().count("cancelOrder") > 3
    pair.tell(Misbehaves())
    pair.run_until(Halted)


@VERSIONS
def test_an_order_that_is_lost_is_sent_again_as_it_was(version: Version) -> None:
    lost = iter([0, 0])
    pair = Pair(version, lambda topic: next(lost, 1) if topic is Topic.ORDER else 1)
    pair.follow("A", "B")
    pair.run(15)
    assert pair.body.x == 2.0
    assert len(pair.orders()) == 3
    assert len(set(pair.orders())) == 1


@VERSIONS
@given(seed=st.integers(0, 10_000))
@settings(max_examples=8)
def test_a_vehicle_never_passes_what_is_not_released(seed: int, version: Version) -> None:
    dice = random.Random(seed)
    pair = Pair(version, lambda topic: dice.choice([0, 1, 1, 2]))
    number, released, limit = 0, 1, 0.0
    while number < 5:
        if dice.random() < 0.3:
            pair.forget()
            pair.halt()
            pair.run_until(Halted)
            number, released, limit = max([number, *pair.passed()]), 1, pair.body.x
        names = [chr(ord("A") + index) for index in range(number, 6)]
        released = max(released, min(dice.randint(1, 3), len(names)))
        limit = max(limit, 2.0 * (number + released - 1))
        pair.follow(*names, released=released, first=number)
        pair.run(5 * dice.random())
        assert pair.body.x <= limit + 1e-6
        passed = max([number, *pair.passed()])
        released, number = max(1, released - (passed - number)), passed


@VERSIONS
def test_a_vehicle_that_restarts_gets_the_rest_of_its_order(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C", "D")
    pair.run(3)
    pair.tell(Restarted())
    pair.run(15)
    assert pair.body.x == 6.0
    assert pair.passed() == [1, 2, 3]
    assert [order.nodes[0].node_id for order in pair.orders()] == ["A", "B"]


@VERSIONS
def test_a_vehicle_that_was_driven_by_hand_does_not_go_on_by_itself(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C", "D")
    pair.run(3)
    pair.tell(Switched(mode=OperatingMode.MANUAL))
    pair.run(1)
    position = pair.body.x
    pair.tell(Switched(mode=OperatingMode.AUTOMATIC))
    pair.run(10)
    assert pair.of(Broken) == [Broken(reason="is in the operating mode MANUAL"), Broken(reason=None)]
    assert pair.body.x == position
    pair.follow("B", "C", "D", first=1)
    pair.run(10)
    assert pair.body.x == 6.0


@VERSIONS
def test_a_vehicle_that_was_moved_away_while_it_restarted_is_not_told_to_drive_on(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C", "D")
    pair.run(3)
    pair.body.y = 5.0
    pair.tell(Restarted())
    pair.body.begin(10_000, Rest())
    assert pair.run_until(GaveUp) == GaveUp(description="was moved away from its way")
    pair.run(5)
    assert pair.body.y == 5.0


def fault(level: ErrorLevel) -> Faulted:
    return Faulted(error=VehicleError(error_type="laserScanner", error_level=level, error_description="the glass is dirty"))


@VERSIONS
def test_a_fatal_error_breaks_the_vehicle_and_it_does_not_go_on_by_itself_when_it_is_mended(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C")
    pair.run(1)
    pair.tell(fault(ErrorLevel.FATAL))
    assert pair.run_until(Broken).reason == "laserScanner: the glass is dirty"
    pair.run(5)
    assert pair.body.x < 2.0
    pair.forget()
    pair.tell(Repaired())
    pair.run(10)
    assert pair.of(Broken) == [Broken(reason=None)]
    assert pair.body.x < 2.0
    pair.follow("A", "B", "C", first=10)
    pair.run(10)
    assert pair.body.x == 4.0


@VERSIONS
def test_a_warning_is_told_once_and_stops_nothing(version: Version) -> None:
    pair = Pair(version)
    pair.tell(fault(ErrorLevel.WARNING))
    pair.follow("A", "B", "C")
    pair.run(8)
    assert pair.of(Warned) == [Warned(description="laserScanner: the glass is dirty")]
    assert pair.body.x == 4.0


def test_a_critical_error_fails_the_trip_when_the_vehicle_stands() -> None:
    pair = Pair(Version.V3_0)
    pair.follow("A", "B", "C")
    pair.run(1)
    pair.tell(fault(ErrorLevel.CRITICAL))
    assert pair.run_until(GaveUp).description == "laserScanner: the glass is dirty"
    assert "cancelOrder" in pair.instant_actions()
    pair.tell(Repaired())
    pair.run(5)
    assert pair.body.x < 2.0


@VERSIONS
def test_a_rejected_order_fails_the_trip_with_the_words_of_the_vehicle(version: Version) -> None:
    pair = Pair(version)
    pair.control.vehicle.map_id = "attic"
    pair.follow("A", "B")
    description = pair.run_until(GaveUp).description
    assert description == {Version.V2_1: "orderError: attic", Version.V3_0: "UNKNOWN_MAP_ID: attic"}[version]
    pair.follow("A", "B")
    pair.run(5)
    assert pair.body.x == 2.0


@VERSIONS
def test_an_order_from_before_the_program_started_is_cancelled(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C")
    pair.run(1)
    successor = Pair(version)
    successor.vehicle, successor.body = pair.vehicle, pair.body
    successor.run(2)
    assert "cancelOrder" in successor.instant_actions()
    assert pair.body.x < 2.0


@VERSIONS
def test_a_vehicle_that_cannot_be_reached_goes_on_with_its_base(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C", "D", released=2)
    pair.run(0.5)
    pair.is_cut = True
    pair.follow("A", "B", "C", "D", released=4)
    pair.run(5)
    assert pair.body.x == 2.0
    pair.is_cut = False
    pair.run(15)
    assert pair.body.x == 6.0


@VERSIONS
def test_where_the_vehicle_is_comes_with_each_state(version: Version) -> None:
    pair = Pair(version)
    (located, *_) = [effect for effect in pair.effects if isinstance(effect, Located)]
    assert (located.pose.x, located.pose.y, located.pose.level) == (0.0, 0.0, None)
    assert pair.of(Reachable) == [Reachable(is_connected=True)]


@VERSIONS
def test_a_long_way_is_sent_in_pieces_that_the_vehicle_takes(version: Version) -> None:
    pair = Pair(version)
    limits: Any = pair.control.vehicle
    limits.most_nodes = lambda: 3
    pair.follow("A", "B", "C", "D", "E", "F")
    pair.run(30)
    assert pair.body.x == 10.0
    assert max(len(order.nodes) for order in pair.orders()) == 3


@VERSIONS
def test_a_heading_matters_where_the_way_ends(version: Version) -> None:
    pair = Pair(version)
    start, end = way("A", "B")
    pair.do(Follow(way=(start, msgspec.structs.replace(end, yaw=1.5))))
    (order,) = pair.orders()
    assert [node.node_position.theta for node in order.nodes if node.node_position is not None] == [None, 1.5]


@VERSIONS
def test_edges_are_drawn_for_vehicles_that_take_trajectories(version: Version) -> None:
    pair = Pair(version, sheet=factsheet(takes_trajectories=True))
    pair.follow("A", "B", "C", released=2)
    pair.run(1)
    pair.follow("A", "B", "C", released=3)
    pair.run(10)
    assert pair.body.x == 4.0
    first, update = [order.edges[-1].trajectory for order in pair.orders()]
    assert first == update
    assert first is not None
    assert [(point.x, point.y) for point in first.control_points] == [(2.0, 0.0), (4.0, 0.0)]
