"""Vehicles that do not take what they are sent, or do not say what has become of it: it is given up with a reason, and nothing hangs."""

from __future__ import annotations

from typing import Any

import pytest

from somrs.adapters.vda5050.control.exchange import (
    ActionEnded,
    Charge,
    Follow,
    GaveUp,
    Halt,
    Halted,
    Perform,
    Reachable,
    Tick,
)
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


# Bases that are others than those that were sent


def stretched(*released: bool) -> Dialogue:
    """A vehicle that has an order to B, with C in its horizon. It says of B and C whether they are released."""
    dialogue = there()
    dialogue.do(Follow(way=way("A", "B", "C", released=2)))
    (order,) = dialogue.orders()
    dialogue.state(orderId=order.order_id, lastNodeId="A", nodeStates=listed(B=released[0], C=released[1]), driving=True)
    return dialogue


def listed(**released: bool) -> list[dict[str, Any]]:
    return [{"nodeId": name, "sequenceId": 2 * (ord(name) - ord("A")), "released": is_so} for name, is_so in released.items()]


def test_a_vehicle_that_would_drive_into_its_horizon_is_stopped() -> None:
    dialogue = stretched(True, True)
    assert instant_actions(dialogue, "cancelOrder")
    dialogue.state(driving=True)
    assert not any(isinstance(effect, GaveUp) for effect in dialogue.effects), "it has not halted yet"
    cancel(dialogue)
    assert [effect.description for effect in dialogue.effects if isinstance(effect, GaveUp)] == ["says that C is released, which it is not"]


def test_an_update_continues_what_the_vehicle_says_that_it_has() -> None:
    """It would reject one that begins at C."""
    dialogue = stretched(True, False)
    dialogue.do(Follow(way=way("A", "B", "C", "D", released=3)))
    update = dialogue.orders()[-1]
    dialogue.state(orderUpdateId=1, nodeStates=listed(B=True, C=False, D=False))
    dialogue.do(Follow(way=way("A", "B", "C", "D")))
    dialogue.run(1)
    assert dialogue.orders()[-1] == update, "the vehicle may not have said all yet"
    dialogue.run(3)
    repetition = dialogue.orders()[-1]
    assert (repetition.order_update_id, [node.node_id for node in repetition.nodes if node.released]) == (2, ["B", "C", "D"])
    dialogue.state(orderUpdateId=2, nodeStates=listed(B=True, C=True, D=True))
    dialogue.run(30)
    assert dialogue.orders()[-1] == repetition


def test_a_vehicle_that_never_takes_more_of_its_order_is_given_up() -> None:
    dialogue = stretched(True, False)
    dialogue.do(Follow(way=way("A", "B", "C", released=3)))
    for _ in range(60):
        dialogue.state(orderUpdateId=dialogue.orders()[-1].order_update_id)
        dialogue.run(1)
    assert len(dialogue.orders()) < 10
    cancel(dialogue)
    words = "says that its order is released to B only"
    assert [effect.description for effect in dialogue.effects if isinstance(effect, GaveUp)] == [words]


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
    cancellations = instant_actions(dialogue, "cancelOrder")
    assert len(cancellations) == 2
    assert cancellations[0].action_id != cancellations[1].action_id
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


def picking() -> tuple[Dialogue, Action]:
    """A vehicle that performs an action of its order."""
    dialogue = there()
    dialogue.do(Perform(action_type="pick"))
    (order,) = dialogue.orders()
    dialogue.state(orderId=order.order_id, actionStates=[reported(order.actions[0], "RUNNING")])
    return dialogue, order.actions[0]


def test_a_vehicle_that_does_not_heed_a_cancellation_amid_an_action_is_as_one_that_cannot_be_reached() -> None:
    """Nobody knows what it does. Seen: it was told each 3 s for ever, and the task waited for it."""
    dialogue, pick = picking()
    dialogue.do(Halt())
    dialogue.run(600)
    assert 6 < len(instant_actions(dialogue, "cancelOrder")) < 20
    assert [effect for effect in dialogue.effects if isinstance(effect, Reachable)] == [Reachable(is_connected=False)]
    assert dialogue.control.vehicle.absence == "goes on with an order that it was told to cancel"
    assert not any(isinstance(effect, Halted) for effect in dialogue.effects)
    dialogue.forget()
    dialogue.state(actionStates=[reported(pick, "FINISHED")])
    assert Halted() in dialogue.effects
    assert dialogue.effects[-1] == Reachable(is_connected=True)
    dialogue.do(Follow(way=way("A", "B")))
    assert dialogue.orders()


def test_one_that_ends_what_it_cannot_interrupt_heeds_it() -> None:
    dialogue, pick = picking()
    dialogue.do(Halt())
    (cancellation,) = instant_actions(dialogue, "cancelOrder")
    dialogue.state(actionStates=[reported(pick, "RUNNING"), reported(cancellation, "RUNNING")])
    dialogue.run(600)
    assert instant_actions(dialogue, "cancelOrder") == [cancellation]
    assert not any(isinstance(effect, Reachable) for effect in dialogue.effects)


def test_one_whose_cancellations_fail_again_and_again_does_not_heed_them() -> None:
    dialogue = driving()
    dialogue.do(Halt())
    for _ in range(60):
        dialogue.state(actionStates=[reported(instant_actions(dialogue, "cancelOrder")[-1], "FAILED")])
        dialogue.run(1)
    assert Reachable(is_connected=False) in dialogue.effects


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
