"""What software of others said, replayed: `tests/integration/adapters/test_vda5050_foreign.py` records it."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from somrs.adapters.vda5050.control.exchange import ActionEnded, Arrived, Effect, Follow, Halt, Halted, Input, Passed, Perform, Send
from somrs.adapters.vda5050.control.vehicle import VehicleControl
from somrs.adapters.vda5050.frames import Frames
from somrs.adapters.vda5050.messages.decoding import Received, decode
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.messages.orders import ActionParameter, InstantActions, Order
from somrs.adapters.vda5050.simulated.body import StandInBody
from somrs.adapters.vda5050.simulated.exchange import Act, Felt, Instructed, Ordered, Publish
from somrs.adapters.vda5050.simulated.exchange import Effect as VehicleEffect
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.simulated.vehicle import SimulatedVehicle
from somrs.adapters.vda5050.topics import read_topic
from tests.support.mqtt_recording import Spoken, read_conversation
from tests.support.paths import ROOT
from tests.support.vda5050_pair import way

DATA = ROOT / "tests" / "data" / "vda5050"

EPAL = (ActionParameter(key="stationType", value="floor"), ActionParameter(key="loadType", value="EPAL"))


def messages(file: str) -> Iterator[tuple[Spoken, Topic, Received]]:
    for spoken in read_conversation(DATA / file):
        addressed = read_topic(spoken.topic)
        assert addressed is not None
        yield spoken, addressed[1], decode(addressed[1], spoken.payload.encode(), Version.V2_0)


def identifiers(message: Struct) -> list[str]:
    """The identifiers of a message of fleet control, in the order in which they were made."""
    match message:
        case InstantActions(actions=actions):
            return [action.action_id for action in actions]
        case Order(order_update_id=0):
            return [*(action.action_id for action in message.actions), message.order_id]
        case _:
            return []


def cause(message: Struct) -> Input | None:
    """What was wanted of fleet control, for which it sent a message; None: nothing, it did so by itself."""
    match message:
        case InstantActions(actions=(action,)) if action.action_type == "cancelOrder":
            return Halt()
        case Order(order_update_id=0) if message.actions:
            return Perform(action_type="pick", parameters=EPAL)
        case Order(order_update_id=0):
            names = [node.node_id for node in message.nodes]
            return Follow(way=way(*names, first={"AB": 0, "BCDEF": 1}.get("".join(names), 100)))
        case _:
            return None


def test_a_vehicle_of_another_make_is_told_the_same_again() -> None:
    conversation = list(messages("foreign_vehicle.jsonl"))
    commands = [received.message for _, topic, received in conversation if topic in (Topic.ORDER, Topic.INSTANT_ACTIONS)]
    made = iter([name for message in commands for name in identifiers(message)])
    control = VehicleControl(Frames(), Version.V2_1, lambda: next(made))
    effects: list[Effect] = []
    for spoken, topic, received in conversation:
        if topic not in (Topic.ORDER, Topic.INSTANT_ACTIONS):
            effects += control.handle(Arrived(topic=topic, received=received), spoken.seconds)
        elif (wanted := cause(received.message)) is not None:
            effects += control.handle(wanted, spoken.seconds)
    assert [effect.message for effect in effects if isinstance(effect, Send)] == commands
    passed = [effect.number for effect in effects if isinstance(effect, Passed)]
    assert passed[:2] == [1, 2]
    assert passed[-1] == 101
    assert [effect for effect in effects if isinstance(effect, ActionEnded | Halted)] == [ActionEnded(failure=None), Halted()]


def test_what_a_vehicle_of_another_make_does_otherwise_is_named() -> None:
    deviations = {deviation for _, _, received in messages("foreign_vehicle.jsonl") for deviation in received.deviations}
    assert {deviation for deviation in deviations if not deviation.startswith("factsheet")} == set()
    assert deviations == {
        f"factsheet.{part} is absent"
        for part in (
            "typeSpecification",
            "physicalParameters",
            "protocolLimits",
            "protocolFeatures",
            "agvGeometry",
            "loadSpecification",
        )
    }


def test_the_simulated_vehicle_carries_out_the_order_of_another_make() -> None:
    vehicle, body = SimulatedVehicle(Version.V2_0, factsheet(), map_id="hall"), StandInBody()
    conversation = [item for item in messages("foreign_fleet_control.jsonl") if item[1] in (Topic.ORDER, Topic.INSTANT_ACTIONS)]
    effects: list[VehicleEffect] = []
    for step in range(300):
        now = 0.1 * step
        inputs: list[Felt | Ordered | Instructed] = [Felt(sensed=body.sense(now))]
        while conversation and conversation[0][0].seconds <= now:
            _, _, received = conversation.pop(0)
            match received.message:
                case Order() as order:
                    inputs.append(Ordered(order=order, deviations=received.deviations))
                case InstantActions() as actions:
                    inputs.append(Instructed(actions=actions, deviations=received.deviations))
        for input in inputs:
            for effect in vehicle.handle(input, now):
                effects.append(effect)
                if isinstance(effect, Act):
                    body.begin(effect.number, effect.command)
    assert any(isinstance(effect, Publish) for effect in effects)
    state = vehicle.state()
    assert (state.order_id, state.last_node_id, state.errors) == ("order-1", "C", ())
    assert [load.load_id for load in state.loads or ()] == ["Jar7"]
