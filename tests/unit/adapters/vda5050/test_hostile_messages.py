"""Whatever a vehicle says, and in whatever order it comes: nothing fails in its session, and all that is sent is valid."""

from __future__ import annotations

import json
import logging
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.adapters.vda5050.control.exchange import BuildingChanged, Charge, Effect, Follow, Halt, Input, Perform, Tick
from somrs.adapters.vda5050.control.policy import Policy
from somrs.adapters.vda5050.frames import Frames
from somrs.adapters.vda5050.messages.encoding import encode
from somrs.adapters.vda5050.messages.header import Topic, Version, seconds_of, timestamp_of
from somrs.adapters.vda5050.messages.orders import ZoneType
from somrs.adapters.vda5050.robot import described
from somrs.adapters.vda5050.session import VehicleSession
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.topics import VehicleAddress
from somrs.adapters.vda5050.zoning.site import SiteZone
from tests.support.vda5050_messages import HEADER, check_schema
from tests.support.vda5050_pair import way
from tests.unit.adapters.vda5050.test_doubtful_vehicles import there
from tests.unit.adapters.vda5050.test_messages import MINIMAL

NUMBERS: list[Any] = [0, -1, 1, 0.5, 2**32 - 1, 2**64, -(2**63), 1e308, -1e308, 5e-324]
EXTREMES: list[Any] = [*NUMBERS, True, None, "", "0", "NaN", "1e999", "FATAL", "RETRIABLE", [], {}, [[]], [None], "x" * 300]
"""Values that a vehicle with a defect may write anywhere."""

TIMES = st.sampled_from(
    ["", "0001-01-01T00:00:00.000Z", "9999-12-31T23:59:59.999Z", "1970-01-01T00:00:00Z", "now", "2026-11-29T10:00:00.000Z"]
)


def paths(document: Any, prefix: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The places of all values in a document."""
    items = document.items() if isinstance(document, dict) else enumerate(document) if isinstance(document, list) else ()
    return [path for key, value in items for path in [(*prefix, key), *paths(value, (*prefix, key))]]


def _at(document: Any, path: tuple[Any, ...]) -> Any:
    """What is at a place of a document."""
    for key in path:
        document = document[key]
    return document


def changed(document: Any, path: tuple[Any, ...], value: Any) -> Any:
    """A document with another value at a place; None: without it."""
    key, *rest = path
    copy = dict(document) if isinstance(document, dict) else list(document)
    copy[key] = changed(document[key], tuple(rest), value) if rest else value
    return copy


def rich_state(version: Version, zone_set_id: str) -> dict[str, Any]:
    """A state with something in most of its fields. `zone_set_id`: that of a zone set with the zone Hall."""
    trajectory = {
        "degree": 1,
        "knotVector": [0.0, 0.0, 1.0, 1.0],
        "controlPoints": [{"x": 0.0, "y": 0.0}, {"x": 2.0, "y": 0.0, "weight": 1.0}],
    }
    request = {"requestId": "r", "requestType": "REPLANNING", "zoneId": "Hall", "zoneSetId": zone_set_id, "requestStatus": "REQUESTED"}
    error = {"errorType": "driveError", "errorLevel": "WARNING", "errorReferences": [{"referenceKey": "orderId", "referenceValue": "o"}]}
    position = {"x": 0.0, "y": 0.0, "theta": 0.0, "mapId": "hall", "positionInitialized": True, "localized": True}
    state = {
        **MINIMAL,
        "nodeStates": [{"nodeId": "B", "sequenceId": 2, "released": True}],
        "edgeStates": [{"edgeId": "A-B", "sequenceId": 1, "released": True, "trajectory": trajectory}],
        "actionStates": [{"actionId": "a", "actionType": "pick", "actionStatus": "RUNNING", "actionResult": "r"}],
        "loads": [{"loadId": "Jar7", "loadPosition": "top", "weight": 1.0}],
        "errors": [error],
        "maps": [{"mapId": "hall", "mapVersion": "1", "mapStatus": "ENABLED"}],
    }
    if version is Version.V2_1:
        return {**state, "agvPosition": position}
    battery, safety = {"stateOfCharge": 50.0, "charging": False}, {"activeEmergencyStop": "NONE", "fieldViolation": False}
    zones = {
        "zoneSets": [{"zoneSetId": zone_set_id, "mapId": "hall", "zoneSetStatus": "ENABLED"}],
        "zoneRequests": [{**request, "trajectory": trajectory}],
    }
    return {**state, **zones, "mobileRobotPosition": position, "powerSupply": battery, "safetyState": safety, "instantActionStates": []}


def documents(version: Version, zone_set_id: str = "") -> dict[Topic, dict[str, Any]]:
    """Messages without mistakes, by their topics."""
    zones = (ZoneType.RELEASE.value, ZoneType.COORDINATED_REPLANNING.value)
    sheet = json.loads(encode(factsheet(takes_trajectories=True, finds_paths=True, supported_zones=zones), HEADER, version))
    connection = {key: MINIMAL[key] for key in ("headerId", "timestamp", "version", "manufacturer", "serialNumber")}
    return {
        Topic.STATE: rich_state(version, zone_set_id),
        Topic.FACTSHEET: sheet,
        Topic.CONNECTION: {**connection, "connectionState": "ONLINE"},
    }


ZONES = (
    SiteZone(name="Hall", zone_type=ZoneType.LINE_GUIDED, outline=((-5.0, -5.0), (9.0, -5.0), (9.0, 5.0), (-5.0, 5.0)), level=0.0),
    SiteZone(name="Lift", zone_type=ZoneType.RELEASE, outline=((1.0, -1.0), (2.0, -1.0), (2.0, 1.0)), level=0.0),
)

WISHES: list[Input] = [
    Follow(way=way("A", "B", "C")), Follow(way=way("A", "B", "C", released=2)), Halt(), Perform(action_type="pick"), Charge(), Tick(),
    BuildingChanged(zones=ZONES),
]  # fmt: skip


@st.composite
def messages(draw: st.DrawFn, version: Version, zone_set_id: str) -> tuple[Topic, bytes]:
    """A message with up to three wrong values."""
    topic = draw(st.sampled_from([Topic.STATE, Topic.STATE, Topic.STATE, Topic.FACTSHEET, Topic.CONNECTION]))
    document = documents(version, zone_set_id)[topic]
    if topic is Topic.STATE and draw(st.booleans()):
        document |= {"nodeStates": [], "edgeStates": [], "actionStates": []}
    leaves = [path for path in paths(document) if not isinstance(_at(document, path), dict | list)]
    for path in draw(st.lists(st.sampled_from(leaves) | st.sampled_from(paths(document)), max_size=3, unique=True)):
        try:
            is_number = isinstance(_at(document, path), int | float)
            document = changed(document, path, draw(st.sampled_from(NUMBERS if is_number and draw(st.booleans()) else EXTREMES)))
        except (KeyError, TypeError, IndexError):
            continue  # what was there was changed already
    document |= {"timestamp": draw(TIMES), "headerId": draw(st.sampled_from([0, 1, 2000, 4000, 2**32 - 1]))}
    return topic, json.dumps(document).encode()


@pytest.mark.parametrize("version", [Version.V2_1, Version.V3_0])
@given(data=st.data())
@settings(max_examples=40, deadline=None)
def test_whatever_a_vehicle_says_nothing_fails_and_what_is_sent_is_valid(data: st.DataObject, version: Version) -> None:
    sent: list[tuple[str, bytes]] = []
    address = VehicleAddress(interface="uagv", major=version.major, manufacturer="ACME", serial_number="1")
    session = VehicleSession(address, Frames(), lambda topic, payload: sent.append((topic, payload)), Policy(hibernate_after=10.0))
    failures: list[str] = []
    handler = logging.Handler(logging.ERROR)
    handler.emit = lambda record: failures.append(record.getMessage())  # type: ignore[method-assign]
    log = logging.getLogger("somrs.adapters.vda5050.session")
    log.addHandler(handler)
    try:
        for topic, document in documents(version).items():
            session.receive(topic, json.dumps(document).encode())
        session.give(BuildingChanged(zones=ZONES))
        sets = [json.loads(payload)["zoneSet"]["zoneSetId"] for name, payload in sent if name.endswith(Topic.ZONE_SET)]
        for item in data.draw(st.lists(st.sampled_from(WISHES) | messages(version, next(iter(sets), "")), max_size=8)):
            if isinstance(item, tuple):
                session.receive(*item)
            session.give(item if not isinstance(item, tuple) else data.draw(st.sampled_from(WISHES)))
            described(session)
    finally:
        log.removeHandler(handler)
    assert failures == []
    for name, payload in sent:
        check_schema(Topic(name.rpartition("/")[2]), payload, version)


@pytest.mark.parametrize("seconds", [1e300, -1e300, 0.0, 253402300799.0, float("inf")])
def test_any_time_is_written_as_a_timestamp(seconds: float) -> None:
    assert seconds_of(timestamp_of(seconds)) is not None


def test_a_defect_in_what_has_to_do_with_one_vehicle_is_in_the_log_and_nothing_else(caplog: pytest.LogCaptureFixture) -> None:
    """Other vehicles of the same program go on."""
    address = VehicleAddress(interface="uagv", major=2, manufacturer="ACME", serial_number="1")
    session = VehicleSession(address, Frames(), lambda topic, payload: None)

    def fail(effect: Effect) -> None:
        raise RuntimeError("a defect")

    session.on_effect = fail
    session.receive(Topic.STATE, json.dumps(MINIMAL).encode())
    assert "ACME 1: Reachable had no effect" in caplog.text
    assert session.control.vehicle.is_connected


def test_what_differs_each_time_does_not_fill_the_log(caplog: pytest.LogCaptureFixture) -> None:
    address = VehicleAddress(interface="uagv", major=2, manufacturer="ACME", serial_number="1")
    session = VehicleSession(address, Frames(), lambda topic, payload: None)
    for number in range(400):
        head = {"headerId": number, "timestamp": timestamp_of(1e9 + number)}
        session.receive(Topic.STATE, json.dumps({**MINIMAL, **head, f"field{'x' * number}": 1}).encode())
        session.receive(Topic.STATE, json.dumps({**MINIMAL, **head, "errors": f"{'y' * number}{number}"}).encode())
    assert len(caplog.records) < 300
    assert max(len(record.getMessage()) for record in caplog.records) < 600


@pytest.mark.parametrize("x", [1e308, -1e308, 1e9])
def test_a_vehicle_at_a_point_that_is_on_no_map_is_where_it_was(x: float) -> None:
    """Seen: the width of the first node was calculated from there, which is no number."""
    dialogue = there()
    dialogue.stand_at(x)
    dialogue.do(Follow(way=way("A", "B")))
    (order,) = dialogue.orders()
    position = order.nodes[0].node_position
    assert position is not None
    assert position.allowed_deviation_xy is None
    assert dialogue.control.vehicle.pose is not None
    assert dialogue.control.vehicle.pose.x == 0.0


def test_sizes_that_no_vehicle_has_are_not_put_on_the_map() -> None:
    """Seen: the square of such a size is no number, which ended the program of all vehicles."""
    session = VehicleSession(
        VehicleAddress(interface="uagv", major=2, manufacturer="ACME", serial_number="1"), Frames(), lambda *sent: None
    )
    sheet = factsheet(width=1e200, length=1e200, speed=1e30)
    session.receive(Topic.FACTSHEET, encode(sheet, HEADER, Version.V2_1))
    assert described(session) == {"Payload": 20.0}


def test_numbers_of_a_vehicle_without_a_clock_may_begin_anew() -> None:
    """Seen: the states of a vehicle were taken for late ones after it was switched on again, until it had sent as many as before."""
    dialogue = there()
    dialogue.now = 60.0  # as it is whenever the vehicle is switched on
    dialogue.run(20)
    dialogue.now = 61.0
    dialogue.restart_numbers()
    dialogue.connect()
    dialogue.stand_at(7.0)
    assert dialogue.control.vehicle.pose is not None
    assert dialogue.control.vehicle.pose.x == 7.0


def test_a_vehicle_that_asks_for_milliseconds_between_orders_is_not_waited_for() -> None:
    dialogue = there()
    sheet = factsheet()
    timing = msgspec.structs.replace(sheet.protocol_limits.timing, minimum_order_interval=500.0)
    limits = msgspec.structs.replace(sheet.protocol_limits, timing=timing)
    dialogue.control.vehicle.factsheet = msgspec.structs.replace(sheet, protocol_limits=limits)
    assert dialogue.control.vehicle.order_interval() == 10.0
