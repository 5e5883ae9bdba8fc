"""What follows from an input: messages to the vehicle, and news of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from somrs.adapters.vda5050.control.exchange import Effect, Send
from somrs.adapters.vda5050.messages.factsheets import StringLengths
from somrs.adapters.vda5050.messages.header import Topic
from somrs.adapters.vda5050.messages.identifiers import fitting_id
from somrs.adapters.vda5050.messages.orders import Action, ActionParameter, BlockingType, InstantActions
from somrs.adapters.vda5050.messages.states import ActionState, State

RESEND = 3.0
"""Seconds after which a message is sent again that the vehicle does not show to have received."""

UNHEEDED = 5
"""How often something is sent that the vehicle does not show to have received, although it says how it is, until that is given up."""

FINISHED_ACTIONS = 10
"""Finished actions of a kind in the state of a vehicle, after which it is told to drop them (3.0, 7.8)."""


class Outbox:
    """The effects of the input that is being handled, in their order. `make_id`: makes identifiers that are never used again; `limits`:
    those of the vehicle for them."""

    def __init__(self, make_id: Callable[[], str]) -> None:
        self._make_id = make_id
        self.limits: StringLengths | None = None
        self.effects: list[Effect] = []
        self._clearing: dict[str, str] = {}
        """By type: the actions by which the vehicle is to drop others, and has not shown that yet."""

    def new_id(self) -> str:
        """An identifier that is never used again."""
        return fitting_id(self._make_id(), self.limits)

    def add(self, *effects: Effect) -> None:
        self.effects.extend(effects)

    def action(self, action_type: str, blocking: BlockingType, parameters: tuple[ActionParameter, ...] = ()) -> Action:
        return Action(action_type=action_type, action_id=self.new_id(), blocking_type=blocking, action_parameters=parameters or None)

    def instant(self, action_type: str, *parameters: ActionParameter) -> str:
        """Send an instant action. Returns its id."""
        action = self.action(action_type, BlockingType.NONE, parameters)
        self.send_action(action)
        return action.action_id

    def send_action(self, action: Action) -> None:
        self.add(Send(topic=Topic.INSTANT_ACTIONS, message=InstantActions(actions=(action,))))

    def clear(self, action_type: str, state: State, actions: Sequence[ActionState]) -> None:
        """Have the vehicle drop those of its actions that are finished. Not while it has others: it would drop them, too."""
        if any(not action.action_status.is_final for action in actions):
            return
        clearing = self._clearing.get(action_type)
        if len(actions) < FINISHED_ACTIONS:
            self._clearing.pop(action_type, None)
        elif clearing is None or state.action(clearing) is not None:
            self._clearing[action_type] = self.instant(action_type)
