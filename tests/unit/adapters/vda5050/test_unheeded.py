"""Vehicles that do not take what they are sent, or do not say what has become of it: it is given up with a reason, and nothing hangs."""

from __future__ import annotations

from typing import Any

import pytest

from somrs.adapters.vda5050.control.exchange import ActionEnded, Charge, Follow, GaveUp, Halt, Halted, Perform, Tick
from somrs.adapters.vda5050.messages.orders import Action, InstantActions
from tests.support.vda5050_pair import way
from tests.unit.adapters.vda5050.test_doubtful_vehicles import Dialogue, there


def instant_actions(dialogue: Dialogue, action_type: str) -> list[Action]:
    messages = [message for message in dialogue.sent() if isinstance(message, InstantActions)]
    return [action for message in messages for action in message.actions if action.action_type == action_type]


def reported(action: Action, status: str) -> dict[str, str]:
    return {"actionId": action.action_id, "actionType": action.action_type, "actionStatus": status}


def cancel(dialogue: Dialogue) -> None:
    """The vehicle has no order any more."""
    action = instant_actions(dialogue, "cancelOrder")[-1]
    dialogue.state(actionStates=[reported(action, "FINISHED")], nodeStates=[], driving=False)


def test_a_vehicle_that_never_shows_its_order_is_given_up() -> None:
    dialogue = there()
    dialogue.do(Follow(way=way("A", "B")))
    dialogue.run(60)
    assert [effect.description for effect in dialogue.effects if isinstance(effect, GaveUp)] == ["does not show that it has its order"]
    assert 3 < len(dialogue.orders()) < 10


def test_one_that_cannot_be_heard_meanwhile_is_not() -> None:
    dialogue = there()
    dialogue.do(Follow(way=way("A", "B")))
    dialogue.run(60, is_silent=True)
    assert not any(isinstance(effect, GaveUp) for effect in dialogue.effects)


def test_a_vehicle_that_answers_an_update_with_its_earlier_number_is_given_up() -> None:
    dialogue = there()
    dialogue.do(Follow(way=way("A", "B", "C", released=2)))
    (order,) = dialogue.orders()
    dialogue.state(orderId=order.order_id, lastNodeId="A", nodeStates=[{"nodeId": "B", "sequenceId": 2, "released": True}], driving=True)
    dialogue.do(Follow(way=way("A", "B", "C")))
    dialogue.run(40)
    assert instant_actions(dialogue, "cancelOrder"), "it is to stop, before anything else is wanted from it"
    cancel(dialogue)
    assert [effect.description for effect in dialogue.effects if isinstance(effect, GaveUp)] == ["does not show that it has its order"]


def test_a_rejection_that_looks_like_the_one_before_is_one() -> None:
    """Its error does not say which order it is about, and stays until an order is accepted."""
    dialogue = there()
    dialogue.state(errors=[{"errorType": "orderError", "errorLevel": "WARNING", "errorDescription": "no route"}])
    dialogue.do(Follow(way=way("A", "B")))
    dialogue.run(60)
    (gave_up,) = [effect for effect in dialogue.effects if isinstance(effect, GaveUp)]
    assert "orderError: no route" in gave_up.description


def test_an_action_of_which_the_vehicle_says_nothing_has_failed() -> None:
    dialogue = there()
    dialogue.do(Perform(action_type="pick"))
    (order,) = dialogue.orders()
    dialogue.state(orderId=order.order_id)
    dialogue.run(30)
    assert [effect for effect in dialogue.effects if isinstance(effect, ActionEnded)] == [
        ActionEnded(failure="the vehicle does not say what has become of pick")
    ]


# Cancellations


def driving(*, number: int = 2) -> Dialogue:
    dialogue = there()
    dialogue.do(Follow(way=way("A", "B")))
    (order,) = dialogue.orders()
    nodes = [{"nodeId": "B", "sequenceId": number, "released": True}]
    dialogue.state(orderId=order.order_id, lastNodeId="A", nodeStates=nodes, driving=True)
    return dialogue


def test_a_cancellation_that_failed_has_not_halted_a_vehicle_that_waits() -> None:
    """Something is in its protective field: it stands, and goes on afterwards."""
    dialogue = driving()
    dialogue.do(Halt())
    (action,) = instant_actions(dialogue, "cancelOrder")
    dialogue.state(driving=False, actionStates=[reported(action, "FAILED")])
    dialogue.run(4)
    assert not any(isinstance(effect, Halted) for effect in dialogue.effects)
    again = instant_actions(dialogue, "cancelOrder")
    assert len(again) == 2
    assert again[0].action_id != again[1].action_id
    cancel(dialogue)
    assert any(isinstance(effect, Halted) for effect in dialogue.effects)


def test_a_vehicle_that_lists_the_nodes_of_a_cancelled_order_is_told_once_and_gets_another_one() -> None:
    dialogue = driving()
    dialogue.do(Halt())
    (action,) = instant_actions(dialogue, "cancelOrder")
    dialogue.state(driving=False, actionStates=[reported(action, "FINISHED")])
    dialogue.run(20)
    assert any(isinstance(effect, Halted) for effect in dialogue.effects)
    assert len(instant_actions(dialogue, "cancelOrder")) == 1
    dialogue.do(Follow(way=way("A", "B", first=10)))
    assert len(dialogue.orders()) == 2


def test_a_vehicle_that_drives_on_with_a_cancelled_order_is_told_so_no_more_than_each_3_s() -> None:
    dialogue = driving()
    dialogue.do(Halt())
    for _ in range(200):
        for action in instant_actions(dialogue, "cancelOrder")[-1:]:
            dialogue.state(actionStates=[reported(action, "FINISHED")], driving=False)
            dialogue.state(driving=True)
        dialogue.now += 0.1
        dialogue.do(Tick())
    assert 2 <= len(instant_actions(dialogue, "cancelOrder")) <= 9


# Charging


def charging(**power: Any) -> Dialogue:
    """A vehicle that says that it has begun to charge."""
    dialogue = there()
    dialogue.do(Charge())
    (order,) = dialogue.orders()
    dialogue.state(orderId=order.order_id, actionStates=[reported(order.actions[0], "FINISHED")], batteryState=power)
    return dialogue


@pytest.mark.parametrize(("charge", "failure"), [(100.0, None), (99.5, None), (40.0, "the vehicle does not charge, and is at 40 %")])
def test_a_vehicle_that_never_says_that_it_charges(charge: float, failure: str | None) -> None:
    dialogue = charging(batteryCharge=charge, charging=False)
    dialogue.run(40)
    assert [effect for effect in dialogue.effects if isinstance(effect, ActionEnded)] == [ActionEnded(failure=failure)]


def test_a_vehicle_that_does_not_stop_charging_stands_all_the_same() -> None:
    dialogue = charging(batteryCharge=50.0, charging=True)
    dialogue.do(Halt())
    dialogue.run(40)
    assert any(isinstance(effect, Halted) for effect in dialogue.effects)
    assert len(instant_actions(dialogue, "stopCharging")) == 6
