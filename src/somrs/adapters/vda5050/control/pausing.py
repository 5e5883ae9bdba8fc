"""Pausing a vehicle while an operator has stopped it: what is wanted is compared with what the vehicle says of itself."""

from __future__ import annotations

from somrs.adapters.vda5050.control.outbox import RESEND, Outbox
from somrs.adapters.vda5050.messages.orders import Action, BlockingType
from somrs.adapters.vda5050.messages.states import ActionStatus, State

START, STOP = "startPause", "stopPause"


class Pausing:
    """`is_wanted`: whether the vehicle is to stand still. A pause that somebody began at the vehicle is ended there."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self.is_wanted = False
        self._action: Action | None = None
        self._sending_time = 0.0

    def reconcile(self, state: State, now: float) -> None:
        """Send what the vehicle does not show to have done."""
        action_type = START if self.is_wanted else STOP
        if not self._is_needed(state, action_type):
            return
        is_new = self._action is None or self._action.action_type != action_type
        if not is_new and now < self._sending_time + RESEND:
            return
        if is_new or self._status(state) is not None:  # one that the vehicle has carried out is not carried out again
            self._action = self._outbox.action(action_type, BlockingType.NONE)
        assert self._action is not None, "it was made"
        self._sending_time = now
        self._outbox.send_action(self._action)

    def _is_needed(self, state: State, action_type: str) -> bool:
        if state.paused is self.is_wanted:
            return False
        if not self.is_wanted and not self._is_ours(state):
            return False
        is_sent = self._action is not None and self._action.action_type == action_type
        return state.paused is not None or not (is_sent and self._status(state) is ActionStatus.FINISHED)

    def _status(self, state: State) -> ActionStatus | None:
        action = state.action(self._action.action_id) if self._action is not None else None
        return action.action_status if action is not None else None

    def _is_ours(self, state: State) -> bool:
        """Whether fleet control has begun the pause, perhaps before this program was started."""
        if self._action is not None:
            return True
        pauses = [action for action in state.all_actions if action.action_type in (START, STOP)]
        return bool(pauses) and (pauses[-1].action_type, pauses[-1].action_status) == (START, ActionStatus.FINISHED)
