"""An action that has failed, and waits for whether it is to be tried again (3.0, 6.6.9)."""

from __future__ import annotations

from somrs.adapters.vda5050.control.condition import words_about
from somrs.adapters.vda5050.control.listener import Listener
from somrs.adapters.vda5050.control.outbox import RESEND, UNHEEDED, Outbox
from somrs.adapters.vda5050.messages.orders import Action, ActionParameter, BlockingType
from somrs.adapters.vda5050.messages.states import State

PAUSE = 5.0
"""Seconds in which what was in the way may go, or somebody at the vehicle may help, before the action is tried again."""

RETRY, SKIP = "retry", "skipRetry"


class Retrying:
    """`tries`: how often the action may still be tried again. `reason`: why it failed, as the vehicle said; None: it did not."""

    def __init__(self, vehicle: Listener, outbox: Outbox, action_id: str, tries: int) -> None:
        self._vehicle, self._outbox, self._action_id = vehicle, outbox, action_id
        self.tries = tries
        self.reason: str | None = None
        self._start_time: float | None = None
        self._answer: Action | None = None
        self._sending_time = 0.0
        self._sendings = 0

    def reconcile(self, state: State, now: float) -> bool:
        """Say what is to become of the action, which waits for it. Returns whether the vehicle does not heed that."""
        self.reason = words_about(state, self._action_id)
        if self._start_time is None:
            self._start_time = now
        if self._answer is None:
            return self._decide(now)
        shown = state.action(self._answer.action_id)
        if now < self._sending_time + RESEND:
            return False
        if shown is None and self._sendings < UNHEEDED:
            self._send(now)
        elif shown is None or shown.action_status.is_final:
            return self._answer.action_type == SKIP or self._decide(now)
        return False

    def _decide(self, now: float) -> bool:
        """Have the action tried again, or given up. Returns whether the vehicle can do neither."""
        may_retry = self.tries > 0 and self._vehicle.can_perform(RETRY)
        if may_retry and self._start_time is not None and now < self._start_time + PAUSE:
            return False
        if not may_retry and not self._vehicle.can_perform(SKIP):
            return True
        self.tries -= 1
        parameter = ActionParameter(key="actionId", value=self._action_id)
        self._answer = self._outbox.action(RETRY if may_retry else SKIP, BlockingType.NONE, (parameter,))
        self._sendings, self._start_time = 0, now
        self._send(now)
        return False

    def _send(self, now: float) -> None:
        assert self._answer is not None, "it was decided"
        self._sending_time = now
        self._sendings += 1
        self._outbox.send_action(self._answer)
