"""Vehicles that reject everything, say nothing, are somewhere else, or are two: it is said, and they are left alone."""

from __future__ import annotations

import itertools
import json
import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Struct

from somrs.adapters.vda5050.control.exchange import Arrived, Broken, Delayed, Effect, Follow, GaveUp, Input, Located, Refused, Send, Tick
from somrs.adapters.vda5050.control.orders import OPTIONAL, OrderWriter
from somrs.adapters.vda5050.control.policy import Policy
from somrs.adapters.vda5050.control.vehicle import VehicleControl
from somrs.adapters.vda5050.frames import Frame, Frames, Pose
from somrs.adapters.vda5050.messages.decoding import decode
from somrs.adapters.vda5050.messages.encoding import encode
from somrs.adapters.vda5050.messages.header import Topic, Version, timestamp_of
from somrs.adapters.vda5050.messages.orders import InstantActions, Order
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.devices.road_robot import Waypoint
from tests.support.vda5050_messages import HEADER, check_schema
from tests.support.vda5050_pair import way
from tests.unit.adapters.vda5050.test_messages import MINIMAL


class Dialogue:
    """A vehicle of which the test writes each message, in virtual time."""

    def __init__(self, frames: Frames | None = None, policy: Policy | None = None) -> None:
        identifiers = itertools.count(1)
        self.control = VehicleControl(frames or Frames(), Version.V2_1, lambda: f"id-{next(identifiers)}", policy)
        self.now = 1_790_000_000.0
        self.effects: list[Effect] = []
        self.said: dict[str, Any] = {}
        self._numbers = itertools.count(1)

    def do(self, input: Input) -> list[Effect]:
        effects = self.control.handle(input, self.now)
        self.effects += effects
        return effects

    def connect(self) -> None:
        self._arrive(Topic.CONNECTION, {"connectionState": "ONLINE"})

    def restart_numbers(self) -> None:
        """The vehicle counts its messages from the beginning."""
        self._numbers = itertools.count(1)

    def state(self, *, number: int | None = None, **fields: Any) -> list[Effect]:
        """The vehicle sends a state: what it said before, with these fields."""
        self.said |= fields
        return self._arrive(Topic.STATE, {**MINIMAL, **self.said}, number)

    def stand_at(self, x: float, map_id: str = "hall") -> list[Effect]:
        return self.state(agvPosition={"x": x, "y": 0.0, "theta": 0.0, "mapId": map_id, "positionInitialized": True})

    def run(self, seconds: float, *, is_silent: bool = False) -> None:
        """A state and a look each second."""
        for _ in range(round(seconds)):
            self.now += 1.0
            if not is_silent:
                self.state()
            self.do(Tick())

    def describe(self) -> None:
        received = decode(Topic.FACTSHEET, encode(factsheet(), HEADER, Version.V2_1), Version.V2_1)
        self.do(Arrived(topic=Topic.FACTSHEET, received=received))

    def _arrive(self, topic: Topic, fields: dict[str, Any], number: int | None = None) -> list[Effect]:
        head = {"headerId": number if number is not None else next(self._numbers), "timestamp": timestamp_of(self.now), "version": "2.1.0"}
        payload = json.dumps({"manufacturer": "ACME", "serialNumber": "1", **fields, **head}).encode()
        return self.do(Arrived(topic=topic, received=decode(topic, payload, Version.V2_1)))

    def forget(self) -> None:
        self.effects = []

    def sent(self) -> list[Struct]:
        return [effect.message for effect in self.effects if isinstance(effect, Send)]

    def orders(self) -> list[Order]:
        return [message for message in self.sent() if isinstance(message, Order)]

    def asked(self) -> list[str]:
        return [message.actions[0].action_type for message in self.sent() if isinstance(message, InstantActions)]

    def reasons(self) -> list[str | None]:
        return [effect.reason for effect in self.effects if isinstance(effect, Broken)]


def there(policy: Policy | None = None) -> Dialogue:
    """A vehicle that stands at (0, 0), and has said what it is."""
    dialogue = Dialogue(policy=policy)
    dialogue.connect()
    dialogue.stand_at(0.0)
    dialogue.describe()
    dialogue.forget()
    return dialogue


def insist(dialogue: Dialogue, seconds: int, words: str = "mapId: hall") -> None:
    """Somebody wants the vehicle to drive, again and again, and it rejects each order."""
    for _ in range(seconds):
        dialogue.now += 1.0
        for input in (Follow(way=way("A", "B")), Tick()):
            sent = [effect.message for effect in dialogue.do(input) if isinstance(effect, Send) and isinstance(effect.message, Order)]
            for order in sent:
                reference = [{"referenceKey": "orderId", "referenceValue": order.order_id}]
                error = {"errorType": "validationError", "errorLevel": "WARNING", "errorDescription": words, "errorReferences": reference}
                dialogue.state(errors=[error])
        dialogue.state()


# Rejections


def test_a_vehicle_that_rejects_each_order_is_not_asked_again_and_again() -> None:
    dialogue = there()
    insist(dialogue, 50)
    assert len(dialogue.orders()) == 3
    assert len([effect for effect in dialogue.effects if isinstance(effect, GaveUp)]) == 3
    assert dialogue.reasons() == ["rejects its orders: validationError: mapId: hall"], "it is out of order, and says why"
    insist(dialogue, 600)
    assert len(dialogue.orders()) <= 8, "it is tried again, at longer and longer intervals"


@pytest.mark.parametrize("change", [{"errors": [{"errorType": "worn", "errorLevel": "WARNING"}]}, {"operatingMode": "SEMIAUTOMATIC"}])
def test_it_gets_an_order_again_when_something_has_changed(change: dict[str, Any]) -> None:
    dialogue = there()
    insist(dialogue, 10)
    dialogue.forget()
    dialogue.state(**change)
    assert dialogue.reasons() == [None]
    dialogue.now += 1.0
    dialogue.do(Follow(way=way("A", "B")))
    assert len(dialogue.orders()) == 1


def test_it_gets_an_order_again_when_it_was_moved_or_switched_on_anew() -> None:
    moved, restarted = there(), there()
    for dialogue in (moved, restarted):
        insist(dialogue, 10)
        dialogue.forget()
    moved.stand_at(0.8)
    restarted.connect()
    restarted.state()
    assert moved.reasons() == restarted.reasons() == [None]


def test_a_vehicle_that_is_to_stay_where_it_is_gets_no_order() -> None:
    dialogue = there()
    dialogue.do(Follow(way=way("A", "B", released=1)))
    dialogue.run(5)
    assert dialogue.orders() == []


# What is sent, and when


@given(
    yaw=st.one_of(st.sampled_from([math.pi, -math.pi, 3.1416, 3.14159]), st.floats(-10.0, 10.0)),
    turned=st.one_of(st.sampled_from([0.0, math.pi / 2, math.pi]), st.floats(-7.0, 7.0)),
    x=st.floats(-1e4, 1e4),
    travel=st.sampled_from([None, "Forward", "Backward"]),
    version=st.sampled_from([Version.V2_1, Version.V3_0]),
)
def test_every_order_is_valid_also_after_rounding(yaw: float, turned: float, x: float, travel: str | None, version: Version) -> None:
    frames = Frames([Frame(map_id="hall", x=x, yaw=turned, level=0.0)])
    pose = Pose(x=x, y=0.3, yaw=yaw, level=0.0)
    writer = OrderWriter(frames=frames, map_id="hall", pose=pose, parameters=OPTIONAL)
    places = [Waypoint(number=n, name=f"P{n}", x=x * n, y=-x, level=0.0, released=True, yaw=yaw, travel=travel) for n in range(3)]
    order = writer.new_order("order", tuple(places))
    check_schema(Topic.ORDER, encode(order, HEADER, version), version)
    sent = order.nodes[-1].node_position
    assert sent is not None
    assert sent.theta is not None
    assert abs(math.remainder(sent.theta - (yaw - turned), math.tau)) < 1e-4


def test_orders_keep_the_interval_that_the_vehicle_asks_for() -> None:
    dialogue = there()
    sheet = factsheet()
    limits = sheet.protocol_limits
    slow = msgspec.structs.replace(limits, timing=msgspec.structs.replace(limits.timing, minimum_order_interval=2.0))
    dialogue.control.vehicle.factsheet = msgspec.structs.replace(sheet, protocol_limits=slow)
    times = []
    for step in range(40):
        dialogue.now += 0.25
        dialogue.forget()
        dialogue.do(Follow(way=way("A", "B", first=2 * step)))
        for order in dialogue.orders():
            times.append(dialogue.now)
            dialogue.state(orderId=order.order_id, lastNodeId="B", lastNodeSequenceId=2)
    assert len(times) > 3
    assert min(end - start for start, end in itertools.pairwise(times)) >= 2.0


def test_a_vehicle_that_is_back_gets_nothing_before_it_has_said_how_it_is() -> None:
    dialogue = there()
    dialogue.do(Follow(way=way("A", "B", "C", "D", released=2)))
    (order,) = dialogue.orders()
    on_its_way: dict[str, Any] = {"nodeStates": [{"nodeId": "B", "sequenceId": 2, "released": True}], "driving": True}
    dialogue.state(orderId=order.order_id, lastNodeId="A", **on_its_way)
    dialogue.now += 5.0
    dialogue.forget()
    dialogue.connect()
    dialogue.do(Follow(way=way("A", "B", "C", "D")))
    assert dialogue.orders() == []
    assert dialogue.asked() == ["stateRequest"]
    dialogue.state(orderId="", lastNodeId="", nodeStates=[], driving=False)
    dialogue.run(2)
    (rest,) = dialogue.orders()
    assert (rest.order_id != order.order_id, rest.order_update_id, rest.nodes[0].sequence_id) == (True, 0, 0)


def test_a_vehicle_that_does_not_answer_is_asked_again() -> None:
    dialogue = there()
    dialogue.do(Follow(way=way("A", "B")))
    dialogue.forget()
    dialogue.connect()
    dialogue.run(7, is_silent=True)
    assert dialogue.asked().count("stateRequest") == 4


# Where it is, and who it is


def test_a_vehicle_on_a_map_that_the_settings_do_not_name_does_not_know_where_it_is() -> None:
    dialogue = Dialogue(Frames([Frame(map_id="hall", level=0.0)]))
    dialogue.connect()
    dialogue.stand_at(3.0, "cellar")
    assert not any(isinstance(effect, Located) for effect in dialogue.effects)
    assert dialogue.reasons() == ["is on the map cellar, and the site has only hall: give its `level` under `maps` in the settings"]
    dialogue.stand_at(3.0)
    assert dialogue.reasons()[-1] is None
    assert any(isinstance(effect, Located) for effect in dialogue.effects)


def test_a_vehicle_without_a_state_for_half_a_minute_is_hindered_and_not_dead() -> None:
    dialogue = there()
    dialogue.run(60)
    assert not any(isinstance(effect, Delayed) for effect in dialogue.effects)
    dialogue.run(29, is_silent=True)
    assert not any(isinstance(effect, Delayed) for effect in dialogue.effects)
    dialogue.forget()
    dialogue.run(100, is_silent=True)
    words = "has sent no state that can be read for 30 s"
    assert [effect for effect in dialogue.effects if isinstance(effect, Delayed | Refused)] == [
        Refused(description=words),
        Delayed(reason=words),
    ]
    assert dialogue.reasons() == []
    assert "stateRequest" in dialogue.asked()
    dialogue.forget()
    dialogue.state()
    assert Delayed(reason=None) in dialogue.effects


def test_two_vehicles_with_one_serial_number_are_left_alone() -> None:
    dialogue = there()
    for turn in range(4):
        dialogue.now += 1.0
        dialogue.state(number=5000 + turn)
        dialogue.now += 1.0
        dialogue.state(number=100 + turn)
    (reason,) = dialogue.reasons()
    assert reason is not None
    assert "shares its manufacturer and serial number with another vehicle" in reason
    for turn in range(70):
        dialogue.now += 1.0
        dialogue.state(number=200 + turn)
    assert dialogue.reasons()[-1] is None, "the other one was switched off"


def test_a_vehicle_that_is_switched_on_anew_is_one() -> None:
    dialogue = there()
    for _ in range(2):
        for turn in range(20):
            dialogue.now += 1.0
            dialogue.state(number=turn)
    assert dialogue.reasons() == []
