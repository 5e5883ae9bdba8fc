"""A vehicle picks, drops and charges where it stands, and says why when it cannot."""

from __future__ import annotations

import itertools

import msgspec
import pytest

from somrs.adapters.vda5050.control.exchange import (
    ActionEnded,
    Arrived,
    Charge,
    Charged,
    Follow,
    Halted,
    Perform,
    Reachable,
    Send,
    Tick,
    Tolerated,
)
from somrs.adapters.vda5050.control.headers import HeaderLog
from somrs.adapters.vda5050.control.vehicle import VehicleControl
from somrs.adapters.vda5050.frames import Frame, Frames
from somrs.adapters.vda5050.messages.decoding import Received
from somrs.adapters.vda5050.messages.factsheets import BatteryCharging, Configuration, Factsheet
from somrs.adapters.vda5050.messages.header import Header, Topic, Version, timestamp_of
from somrs.adapters.vda5050.messages.orders import ActionParameter, GrantType, Order, Responses
from somrs.adapters.vda5050.messages.states import (
    Connection,
    ConnectionState,
    ErrorLevel,
    Position,
    RequestStatus,
    State,
    VehicleError,
    Visualization,
    ZoneRequest,
)
from somrs.adapters.vda5050.simulated.exchange import Faulted, Restarted
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from tests.support.vda5050_pair import Pair, way

VERSIONS = pytest.mark.parametrize("version", [Version.V2_1, Version.V3_0])

JAR = (ActionParameter(key="loadId", value="Jar7"), ActionParameter(key="stationName", value="Shelf1"))


def ended(pair: Pair) -> list[ActionEnded]:
    return [effect for effect in pair.effects if isinstance(effect, ActionEnded)]


@VERSIONS
def test_an_action_is_an_order_at_the_place_of_the_vehicle(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B")
    pair.run(4)
    pair.forget()
    pair.do(Perform(action_type="pick", parameters=JAR))
    assert pair.run_until(ActionEnded) == ActionEnded(failure=None)
    (order,) = pair.orders()
    assert [node.node_id for node in order.nodes] == ["B"]
    assert order.nodes[0].actions[0].parameter("loadId") == "Jar7"
    assert pair.vehicle.state().loads is not None
    assert [load.load_id for load in pair.vehicle.state().loads or ()] == ["Jar7"]


@VERSIONS
def test_an_action_waits_until_the_vehicle_has_come(version: Version) -> None:
    pair = Pair(version)
    pair.follow("A", "B", "C", released=2)
    pair.run(0.5)
    pair.do(Perform(action_type="pick", parameters=JAR))
    pair.run_until(ActionEnded)
    assert pair.body.x == 2.0
    assert [len(order.nodes) for order in pair.orders()] == [3, 1, 1], "the second one takes away the horizon"


@VERSIONS
def test_an_action_that_fails_says_why(version: Version) -> None:
    pair = Pair(version)
    pair.body.obstacle = "there is no load"
    pair.do(Perform(action_type="pick", parameters=JAR))
    failure = pair.run_until(ActionEnded).failure
    assert failure is not None
    assert "there is no load" in failure
    pair.body.obstacle = None
    pair.forget()
    pair.do(Perform(action_type="pick", parameters=JAR))
    assert pair.run_until(ActionEnded) == ActionEnded(failure=None)


@VERSIONS
def test_an_action_that_the_vehicle_does_not_have_fails(version: Version) -> None:
    pair = Pair(version)
    pair.do(Perform(action_type="dance"))
    failure = pair.run_until(ActionEnded).failure
    assert failure in ("orderError: dance", "INVALID_ORDER_ACTION: dance")


@VERSIONS
def test_an_action_is_interrupted(version: Version) -> None:
    pair = Pair(version)
    pair.do(Perform(action_type="pick", parameters=JAR))
    pair.run(1)
    pair.halt()
    pair.run_until(Halted)
    pair.run(10)
    assert pair.vehicle.state().loads == ()
    assert ended(pair) == []


@VERSIONS
def test_a_broken_vehicle_performs_nothing(version: Version) -> None:
    pair = Pair(version)
    error = VehicleError(error_type="laserScanner", error_level=ErrorLevel.FATAL)
    pair.do(Perform(action_type="pick", parameters=JAR))
    pair.run(1)
    pair.tell(Faulted(error=error))
    assert pair.run_until(ActionEnded) == ActionEnded(failure="laserScanner")
    pair.forget()
    pair.do(Perform(action_type="drop", parameters=JAR))
    assert ended(pair) == [ActionEnded(failure="laserScanner")]
    assert pair.orders() == []


@VERSIONS
def test_an_action_is_not_repeated_when_the_vehicle_has_restarted(version: Version) -> None:
    pair = Pair(version)
    pair.do(Perform(action_type="pick", parameters=JAR))
    pair.run(1)
    pair.tell(Restarted())
    assert pair.run_until(ActionEnded).failure == "the vehicle has lost the order"
    pair.run(10)
    assert len(pair.orders()) == 1


@VERSIONS
def test_an_action_whose_order_is_lost_is_performed_once(version: Version) -> None:
    lost = iter([0, 0])
    pair = Pair(version, lambda topic: next(lost, 2) if topic is Topic.ORDER else 1)
    pair.do(Perform(action_type="pick", parameters=JAR))
    pair.run_until(ActionEnded)
    pair.run(10)
    assert ended(pair) == [ActionEnded(failure=None)]


@VERSIONS
def test_charging_lasts_until_the_battery_is_full(version: Version) -> None:
    pair = Pair(version)
    pair.do(Charge())
    pair.run(10)
    assert pair.vehicle.state().power_supply.charging
    assert ended(pair) == []
    assert pair.run_until(ActionEnded) == ActionEnded(failure=None)
    pair.run(1)
    assert pair.body.charge > 98.0
    assert not pair.vehicle.state().power_supply.charging
    assert "stopCharging" in pair.instant_actions()


@pytest.mark.parametrize("is_interrupted", [False, True])
def test_charging_takes_the_time_that_the_vehicle_wants_for_it_unless_it_is_wanted(is_interrupted: bool) -> None:
    wishes = Configuration(battery_charging=BatteryCharging(maximum_desired_charging_level=50.0, minimum_charging_time=60.0))
    pair = Pair(Version.V3_0, sheet=msgspec.structs.replace(factsheet(), mobile_robot_configuration=wishes))
    pair.do(Charge())
    pair.run(50)
    assert pair.vehicle.state().power_supply.charging
    assert ended(pair) == []
    if is_interrupted:
        pair.halt()
    pair.run(15)
    assert not pair.vehicle.state().power_supply.charging
    assert pair.of(ActionEnded, Halted) == [Halted() if is_interrupted else ActionEnded(failure=None)]


@VERSIONS
def test_charging_is_interrupted(version: Version) -> None:
    pair = Pair(version)
    pair.do(Charge())
    pair.run(10)
    pair.halt()
    pair.run_until(Halted)
    assert not pair.vehicle.state().power_supply.charging
    pair.follow("A", "B")
    pair.run(5)
    assert pair.body.x == 2.0


def test_requests_for_zones_are_refused_once() -> None:
    pair = Pair(Version.V3_0)
    request = ZoneRequest(request_id="r1", request_type="ACCESS", zone_id="z", zone_set_id="s", request_status=RequestStatus.REQUESTED)
    state = pair.vehicle.state()
    fields = {name: getattr(state, name) for name in State.__struct_fields__} | {"zone_requests": (request,)}
    for header_id in (900, 901):
        received = Received(header=header(header_id, pair.now), message=State(**fields))
        pair.do(Arrived(topic=Topic.STATE, received=received))
    responses = [message for _, message in pair.commands if isinstance(message, Responses)]
    assert [(response.request_id, response.grant_type) for message in responses for response in message.responses] == [
        ("r1", GrantType.REJECTED)
    ]


def test_finished_instant_actions_are_cleared_in_3() -> None:
    pair = Pair(Version.V3_0)
    for _ in range(12):
        pair.do(Arrived(topic=Topic.CONNECTION, received=Received(header=header(1, 0.0), message=ONLINE)))
        pair.run(0.5)
    assert "clearInstantActions" in pair.instant_actions()
    assert len(pair.vehicle.state().instant_action_states) < 10


ONLINE = Connection(connection_state=ConnectionState.ONLINE)


def header(header_id: int, seconds: float) -> Header:
    return Header(header_id=header_id, timestamp=timestamp_of(seconds), version="", manufacturer="ACME", serial_number="1")


def test_headers_tell_what_is_late() -> None:
    log = HeaderLog()
    assert not log.is_old(Topic.STATE, header(10, 100.0), 0.0)
    assert log.is_old(Topic.STATE, header(10, 100.0), 0.0), "repeated"
    assert log.is_old(Topic.STATE, header(9, 99.0), 0.0), "out of order"
    assert not log.is_old(Topic.STATE, header(14, 101.0), 0.0)
    assert log.lost == 3
    assert not log.is_old(Topic.STATE, header(0, 102.0), 0.0), "the vehicle has restarted"
    assert not log.is_old(Topic.STATE, header(2**32 - 1, 103.0), 0.0)
    assert not log.is_old(Topic.STATE, header(0, 104.0), 0.0), "the counter begins anew"
    assert not log.is_old(Topic.CONNECTION, header(5, 0.0), 0.0)
    assert not log.is_old(Topic.CONNECTION, header(5, 0.0), 0.0), "a last will has the header of when the vehicle connected"


def test_a_state_proves_that_the_vehicle_is_there_whatever_a_late_last_will_says() -> None:
    pair = Pair()
    pair.forget()
    broken = Connection(connection_state=ConnectionState.CONNECTION_BROKEN)
    pair.do(Arrived(topic=Topic.CONNECTION, received=Received(header=header(1, 0.0), message=broken)))
    assert pair.of(Reachable) == [Reachable(is_connected=False)]
    pair.run(2)
    assert pair.of(Reachable) == [Reachable(is_connected=False), Reachable(is_connected=True)]


def test_a_vehicle_that_sends_no_state_before_it_has_an_order_gets_one() -> None:
    identifiers = itertools.count()
    control = VehicleControl(Frames(), Version.V2_0, lambda: str(next(identifiers)))
    pose = Position(x=0.0, y=0.0, theta=0.0, map_id="hall", localized=True)
    control.handle(Arrived(topic=Topic.CONNECTION, received=Received(header=header(1, 0.0), message=ONLINE)), 0.0)
    control.handle(
        Arrived(topic=Topic.VISUALIZATION, received=Received(header=header(1, 0.0), message=Visualization(mobile_robot_position=pose))), 0.1
    )
    effects = control.handle(Follow(way=way("A", "B")), 1.0)
    for second in range(2, 20):
        effects += control.handle(Tick(), float(second))
    orders = [effect.message for effect in effects if isinstance(effect, Send) and isinstance(effect.message, Order)]
    assert {order.order_id for order in orders} == {orders[0].order_id}
    assert any(isinstance(effect, Tolerated) for effect in effects)


def test_maps_of_vehicles_are_turned_and_moved() -> None:
    frame = Frame(map_id="upstairs", x=10.0, y=5.0, yaw=1.5707963267948966, level=3.0)
    pose = frame.to_site(1.0, 0.0, 0.0)
    assert (round(pose.x, 6), round(pose.y, 6), round(pose.yaw, 4), pose.level) == (10.0, 6.0, 1.5708, 3.0)
    x, y = frame.from_site(pose.x, pose.y)
    assert (round(x, 6), round(y, 6)) == (1.0, 0.0)
    frames = Frames([frame, Frame(map_id="ground", level=0.0)])
    assert frames.frame_at(2.9, "ground").map_id == "upstairs"
    assert frames.frame_at(0.1, "upstairs").map_id == "ground"
    assert Frames().frame_at(0.1, "any").map_id == "any"


def sheet_with_scope(action_type: str, scope: str) -> Factsheet:
    """A factsheet of a vehicle that has an action there only."""
    sheet = factsheet()
    features = sheet.protocol_features
    actions = tuple(
        msgspec.structs.replace(action, action_scopes=(scope,)) if action.action_type == action_type else action
        for action in features.mobile_robot_actions
    )
    return msgspec.structs.replace(sheet, protocol_features=msgspec.structs.replace(features, mobile_robot_actions=actions))


@VERSIONS
@pytest.mark.parametrize("is_full", [False, True])
def test_a_vehicle_that_stops_charging_by_an_order_only_is_told_so_with_the_next_one(version: Version, is_full: bool) -> None:
    pair = Pair(version, sheet=sheet_with_scope("stopCharging", "NODE"))
    pair.do(Charge())
    pair.run(5)
    assert pair.vehicle.state().power_supply.charging
    if is_full:
        assert pair.run_until(ActionEnded) == ActionEnded(failure=None)
    else:
        pair.halt()
        assert pair.of(Halted) == [Halted()]
    pair.follow("A", "B")
    pair.run(6)
    assert pair.body.x == 2.0
    assert not pair.vehicle.state().power_supply.charging
    assert "stopCharging" not in pair.instant_actions()
    pair.follow("B", "C", first=1)
    pair.run(5)
    assert [[action.action_type for action in order.actions] for order in pair.orders()] == [["startCharging"], ["stopCharging"], []]


@VERSIONS
def test_a_vehicle_that_charges_by_an_instant_action_only_gets_one(version: Version) -> None:
    pair = Pair(version, sheet=sheet_with_scope("startCharging", "INSTANT"))
    pair.follow("A", "B")
    pair.do(Charge())
    pair.run(3)
    assert pair.vehicle.state().power_supply.charging
    pair.halt()
    pair.run_until(Halted)
    assert not pair.vehicle.state().power_supply.charging
    pair.do(Charge())
    assert pair.run_until(ActionEnded) == ActionEnded(failure=None)
    assert pair.body.charge > 98.0
    assert [order.actions for order in pair.orders()] == [()] * len(pair.orders())


@VERSIONS
def test_a_battery_that_is_charged_no_further_is_full(version: Version) -> None:
    pair = Pair(version)
    pair.do(Charge())
    pair.run_until(ActionEnded)
    levels = [effect.level for effect in pair.effects if isinstance(effect, Charged)]
    assert pair.body.charge < 100.0
    assert (levels[0], levels[-1]) == (80.8, 100.0)
