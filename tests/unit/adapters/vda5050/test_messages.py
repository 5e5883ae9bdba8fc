"""Messages of VDA 5050 are written as the official schemas have them, and read whatever vehicles make of them."""

from __future__ import annotations

import contextlib
import json
import math
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.adapters.vda5050.messages.decoding import MESSAGES, decode
from somrs.adapters.vda5050.messages.encoding import encode
from somrs.adapters.vda5050.messages.header import Topic, Version, seconds_of, timestamp_of
from somrs.adapters.vda5050.messages.orders import Action, BlockingType, Deviation, InstantActions, Node, NodePosition, Order
from somrs.adapters.vda5050.messages.states import ConnectionState, ErrorLevel, OperatingMode, State
from somrs.errors import InputError
from tests.support.vda5050_messages import HEADER, check_schema, drawn

TOPICS_OF_2 = (Topic.ORDER, Topic.INSTANT_ACTIONS, Topic.STATE, Topic.VISUALIZATION, Topic.CONNECTION, Topic.FACTSHEET)
KINDS = [(Version.V2_1, topic) for topic in TOPICS_OF_2] + [(Version.V3_0, topic) for topic in Topic]

MINIMAL: dict[str, Any] = {
    "headerId": 1,
    "timestamp": "2026-11-29T10:00:00.000Z",
    "version": "2.1.0",
    "manufacturer": "ACME",
    "serialNumber": "0001",
    "orderId": "",
    "orderUpdateId": 0,
    "lastNodeId": "",
    "lastNodeSequenceId": 0,
    "driving": False,
    "operatingMode": "AUTOMATIC",
    "nodeStates": [],
    "edgeStates": [],
    "actionStates": [],
    "errors": [],
    "batteryState": {"batteryCharge": 80.0, "charging": False},
    "safetyState": {"eStop": "NONE", "fieldViolation": False},
}


def state(version: Version = Version.V2_1, **changes: Any) -> tuple[State, tuple[str, ...]]:
    received = decode(Topic.STATE, json.dumps(MINIMAL | changes).encode(), version)
    assert isinstance(received.message, State)
    return received.message, received.deviations


@pytest.mark.parametrize(("version", "topic"), KINDS)
@given(data=st.data())
@settings(max_examples=40)
def test_what_is_sent_is_valid_against_the_official_schema(data: st.DataObject, version: Version, topic: Topic) -> None:
    message = data.draw(drawn(MESSAGES[topic], version))
    if isinstance(message, InstantActions):
        actions = tuple(msgspec.structs.replace(action, blocking_type=BlockingType.NONE, retriable=None) for action in message.actions)
        message = InstantActions(actions=actions)
    check_schema(topic, encode(message, HEADER, version), version)


@pytest.mark.parametrize(("version", "topic"), KINDS)
@given(data=st.data())
@settings(max_examples=40)
def test_what_is_sent_is_read_as_it_was(data: st.DataObject, version: Version, topic: Topic) -> None:
    message = data.draw(drawn(MESSAGES[topic], version))
    received = decode(topic, encode(message, HEADER, version), version)
    assert received.deviations == ()
    repeated = decode(topic, encode(received.message, HEADER, version), version)
    assert (repeated.message, received.header) == (received.message, HEADER)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@given(
    changes=st.dictionaries(st.sampled_from([*MINIMAL, "agvPosition", "loads", "paused", "orderID"]), JSON),
    version=st.sampled_from(Version),
)
def test_any_json_is_read_or_refused(changes: dict[str, Any], version: Version) -> None:
    with contextlib.suppress(InputError):
        decode(Topic.STATE, json.dumps(MINIMAL | changes).encode(), version)


@given(payload=st.binary(max_size=60), topic=st.sampled_from(Topic))
def test_any_bytes_are_read_or_refused(payload: bytes, topic: Topic) -> None:
    with pytest.raises(InputError):
        decode(topic, b"\x00" + payload, Version.V2_1)


def test_a_clean_state_has_no_deviations() -> None:
    assert state()[1] == ()


@pytest.mark.parametrize(
    ("changes", "field", "value", "deviation"),
    [
        ({"driving": "true"}, "driving", True, "state.driving is text"),
        ({"driving": 1}, "driving", True, "state.driving is a number"),
        ({"orderUpdateId": "3"}, "order_update_id", 3, "state.orderUpdateId is text"),
        ({"orderUpdateId": 3.0}, "order_update_id", 3, "state.orderUpdateId is a fraction"),
        ({"orderId": None}, "order_id", "", "state.orderId is null"),
        ({"paused": None}, "paused", None, "state.paused is null"),
        ({"errors": None}, "errors", (), "state.errors is null"),
        ({"operatingMode": "Automatic"}, "operating_mode", OperatingMode.AUTOMATIC, "state.operatingMode is 'Automatic'"),
        ({"operatingMode": "TEACH_IN"}, "operating_mode", OperatingMode.TEACH_IN, "state.operatingMode is 'TEACH_IN'"),
        ({"operatingMode": "ASLEEP"}, "operating_mode", OperatingMode.MANUAL, "state.operatingMode is 'ASLEEP'"),
        ({"OrderID": "7", "orderId": None}, "order_id", "", "state.orderId is null"),
        ({"manner": "fine"}, "order_id", "", "state.manner is unknown"),
    ],
)
def test_what_is_tolerated_is_named(changes: dict[str, Any], field: str, value: object, deviation: str) -> None:
    message, deviations = state(**changes)
    assert getattr(message, field) == value
    assert deviation in deviations


def test_names_of_another_version_are_understood() -> None:
    message, deviations = state(mobileRobotPosition={"x": 1, "y": 2, "theta": 0, "mapId": "hall", "localized": True})
    assert message.mobile_robot_position is not None
    assert message.mobile_robot_position.x == 1.0
    assert "state.mobileRobotPosition belongs to 3.0.0" in deviations
    actions = {key: MINIMAL[key] for key in ("headerId", "timestamp", "version", "manufacturer", "serialNumber")}
    action = {"actionId": "a", "actionType": "stateRequest", "blockingType": "NONE"}
    received = decode(Topic.INSTANT_ACTIONS, json.dumps(actions | {"instantActions": [action]}).encode(), Version.V2_1)
    assert isinstance(received.message, InstantActions)
    assert received.message.actions[0].action_type == "stateRequest"
    assert received.deviations == ("instantActions.instantActions belongs to 2.0.0",)


def test_an_error_of_a_level_that_is_not_known_is_fatal() -> None:
    message, deviations = state(errors=[{"errorType": "smoke", "errorLevel": "PANIC"}, {"errorType": "fire"}])
    assert [error.error_level for error in message.errors] == [ErrorLevel.FATAL, ErrorLevel.FATAL]
    assert "state.errors.errorLevel is 'PANIC'" in deviations


def test_each_version_has_its_words() -> None:
    action = Action(action_type="initializePosition", action_id="a", blocking_type=BlockingType.NONE)
    position = NodePosition(x=1.0, y=2.0, map_id="hall", allowed_deviation_xy=Deviation(a=0.5, b=0.3, theta=0.0))
    node = Node(node_id="n", sequence_id=0, released=True, actions=(action,), node_position=position)
    order = Order(order_id="o", order_update_id=0, nodes=(node,), edges=())
    earlier = json.loads(encode(order, HEADER, Version.V2_1))["nodes"][0]
    assert earlier["nodePosition"]["allowedDeviationXY"] == 0.3
    assert earlier["actions"][0]["actionType"] == "initPosition"
    newest = json.loads(encode(order, HEADER, Version.V3_0))["nodes"][0]
    assert newest["nodePosition"]["allowedDeviationXY"] == {"a": 0.5, "b": 0.3, "theta": 0.0}
    instant = InstantActions(actions=(action,))
    assert [key for key in json.loads(encode(instant, HEADER, Version.V2_0)) if "ctions" in key] == ["instantActions"]
    assert [key for key in json.loads(encode(instant, HEADER, Version.V2_1)) if "ctions" in key] == ["actions"]
    received = decode(Topic.CONNECTION, json.dumps(MINIMAL | {"connectionState": "CONNECTIONBROKEN"}).encode(), Version.V2_1)
    assert received.message.connection_state is ConnectionState.CONNECTION_BROKEN  # type: ignore[attr-defined]


def test_numbers_that_json_does_not_have_are_not_sent() -> None:
    node = Node(node_id="n", sequence_id=0, released=True, actions=(), node_position=NodePosition(x=math.nan, y=0.0, map_id="hall"))
    with pytest.raises(ValueError, match="nan cannot be sent"):
        encode(Order(order_id="o", order_update_id=0, nodes=(node,), edges=()), HEADER, Version.V2_1)


def test_the_version_is_the_closest_one() -> None:
    assert [Version.closest(text, major) for text, major in [("2.0.0", 2), ("2.2.0", 2), ("", 2), ("3.1.0", 3)]] == [
        Version.V2_0,
        Version.V2_1,
        Version.V2_1,
        Version.V3_0,
    ]


def test_timestamps() -> None:
    assert timestamp_of(0.25) == "1970-01-01T00:00:00.250Z"
    assert [seconds_of(text) for text in ("1970-01-01T00:00:00.250Z", "1970-01-01T00:00:01", "soon")] == [0.25, 1.0, None]


def test_deviations_have_the_names_of_the_version() -> None:
    with pytest.raises(InputError, match=r"state\.batteryState is no object"):
        state(batteryState=17)
    _, deviations = state(agvPosition={"x": "1", "y": 0.0, "theta": 0.0, "mapId": "hall"})
    assert {"state.agvPosition.x is text", "state.agvPosition.positionInitialized is absent"} <= set(deviations)
    with pytest.raises(InputError, match=r"state\.powerSupply is no object"):
        state(Version.V3_0, powerSupply=17)
