"""An action that has failed and can be tried again is tried again as the site wants it, and then given up; nothing hangs on it."""

from __future__ import annotations

from typing import Any

import pytest

from somrs.adapters.vda5050.control.exchange import ActionEnded, Charge, Halted, Perform
from somrs.adapters.vda5050.control.policy import Policy
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.messages.orders import ActionParameter, InstantActions
from somrs.adapters.vda5050.messages.states import ActionStatus
from tests.support.vda5050_pair import Pair
from tests.unit.adapters.vda5050.test_doubtful_vehicles import Dialogue, there

JAR = (ActionParameter(key="loadId", value="Jar7"),)


def blocked_pair(policy: Policy | None = None, **options: Any) -> Pair:
    """A vehicle that picks, while something is in its way."""
    pair = Pair(Version.V3_0, policy=policy, **options)
    pair.body.obstacle = "the fork is blocked"
    pair.do(Perform(action_type="pick", parameters=JAR))
    return pair


def test_an_action_that_failed_is_tried_again_and_may_succeed() -> None:
    pair = blocked_pair()
    pair.run(2)
    assert [state.action_status for state in pair.vehicle.state().action_states] == [ActionStatus.RETRIABLE]
    pair.body.obstacle = None
    assert pair.run_until(ActionEnded) == ActionEnded(failure=None)
    assert pair.instant_actions().count("retry") == 1
    assert [order.actions[0].retriable for order in pair.orders()] == [True]


@pytest.mark.parametrize("retries", [0, 1, 3])
def test_it_is_given_up_when_it_fails_again_and_again(retries: int) -> None:
    pair = blocked_pair(Policy(retries=retries))
    failure = pair.run_until(ActionEnded).failure
    assert failure is not None
    assert "the fork is blocked" in failure
    assert pair.instant_actions().count("retry") == retries
    pair.body.obstacle = None
    pair.forget()
    pair.do(Perform(action_type="pick", parameters=JAR))
    assert pair.run_until(ActionEnded) == ActionEnded(failure=None), "the vehicle is free for another order"


def test_nothing_hangs_on_answers_that_are_lost() -> None:
    lost = iter([0, 0, 0])
    pair = blocked_pair(Policy(retries=0), fate=lambda topic: next(lost, 1) if topic is Topic.INSTANT_ACTIONS else 1)
    failure = pair.run_until(ActionEnded).failure
    assert failure is not None


def test_a_halt_ends_the_waiting() -> None:
    pair = blocked_pair()
    pair.run(2)
    pair.halt()
    pair.run_until(Halted)
    assert [state.action_status for state in pair.vehicle.state().action_states] == [ActionStatus.FAILED]


def test_vehicles_that_know_no_retries_are_not_asked_for_any() -> None:
    pair = Pair(Version.V2_1)
    pair.body.obstacle = "the fork is blocked"
    pair.do(Perform(action_type="pick", parameters=JAR))
    pair.run_until(ActionEnded)
    assert "retry" not in pair.instant_actions()
    assert [order.actions[0].retriable for order in pair.orders()] == [None]


# A vehicle that waits for another try although nobody has allowed that.


def performing(policy: Policy | None = None) -> tuple[Dialogue, str]:
    """A vehicle that performs a pick, and the id of that."""
    dialogue = there(policy=policy)
    dialogue.do(Perform(action_type="pick", parameters=JAR))
    (order,) = dialogue.orders()
    dialogue.said["orderId"] = order.order_id
    return dialogue, order.actions[0].action_id


def waiting(dialogue: Dialogue, action_id: str) -> None:
    states = [{"actionId": action_id, "actionType": "pick", "actionStatus": "RETRIABLE"}]
    dialogue.state(actionStates=[*states, *shown(dialogue, "cancelOrder", "RUNNING")])


def shown(dialogue: Dialogue, action_type: str, status: str) -> list[dict[str, str]]:
    messages = [message for message in dialogue.sent() if isinstance(message, InstantActions)]
    actions = [action for message in messages for action in message.actions if action.action_type == action_type]
    return [{"actionId": action.action_id, "actionType": action_type, "actionStatus": status} for action in actions[-1:]]


def test_a_vehicle_that_heeds_neither_gets_its_order_cancelled() -> None:
    dialogue, action_id = performing()
    for _ in range(90):
        waiting(dialogue, action_id)
        dialogue.run(1)
    assert dialogue.asked().count("cancelOrder") >= 1
    dialogue.state(actionStates=shown(dialogue, "cancelOrder", "FINISHED"))
    assert [effect for effect in dialogue.effects if isinstance(effect, ActionEnded)] == [
        ActionEnded(failure="the vehicle does not say why")
    ]


def test_somebody_at_the_vehicle_may_help() -> None:
    dialogue, action_id = performing()
    waiting(dialogue, action_id)
    dialogue.run(3)
    dialogue.state(actionStates=[{"actionId": action_id, "actionType": "pick", "actionStatus": "FINISHED"}])
    assert [effect for effect in dialogue.effects if isinstance(effect, ActionEnded)] == [ActionEnded(failure=None)]
    assert dialogue.asked() == []


def test_charging_is_tried_again_too() -> None:
    pair = Pair(Version.V3_0)
    pair.do(Charge())
    pair.run(3)
    assert [order.actions[0].retriable for order in pair.orders()] == [True]
