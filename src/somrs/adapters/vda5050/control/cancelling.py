"""Ending the order of a vehicle (3.0, 6.1.3): `cancelOrder` is sent until the vehicle stands, and has no order."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from somrs.adapters.vda5050.control.condition import CLEARING, is_idle, stands
from somrs.adapters.vda5050.control.driving import Driving
from somrs.adapters.vda5050.control.exchange import Effect
from somrs.adapters.vda5050.control.listener import Listener
from somrs.adapters.vda5050.control.outbox import RESEND, UNHEEDED, Outbox
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.orders import Action, ActionParameter, BlockingType
from somrs.adapters.vda5050.messages.states import ActionStatus, State

PATIENT_RESEND = 60.0
"""Seconds after which a vehicle is told again to cancel its order that has not heeded it several times."""


@dataclass(kw_only=True)
class Cancellation:
    """The order is being cancelled since `start_time`. `effects`: what to do when the vehicle stands."""

    action: Action
    start_time: float
    sending_time: float
    effects: list[Effect] = field(default_factory=list)


class Cancelling:
    """`current`: the cancellation that the vehicle has not carried out; None: there is none."""

    def __init__(self, vehicle: Listener, outbox: Outbox, driving: Driving) -> None:
        self._vehicle, self._outbox, self._driving = vehicle, outbox, driving
        self.current: Cancellation | None = None
        self._cancelled_order = ""
        """The order that was cancelled last, at `_beginning_time`."""
        self._beginning_time = -math.inf
        self._sendings = 0
        """How often the vehicle was told since it had no order, although it says how it is, and nothing hinders it."""

    def begin(self, now: float, *effects: Effect) -> None:
        """Have the vehicle cancel its order. `effects`: what to do when it stands."""
        action = self._action(self._driving.order.message.order_id if self._names_order() and self._driving.order is not None else None)
        self.current = Cancellation(action=action, start_time=now, sending_time=now, effects=list(effects))
        self._beginning_time = now
        if not self.clears_orders():
            self._send(self.current, now)

    def _names_order(self) -> bool:
        order = self._driving.order
        return self._vehicle.version is Version.V3_0 and order is not None and order.is_acknowledged

    def _action(self, order_id: str | None = None) -> Action:
        parameters = (ActionParameter(key="orderId", value=order_id),) if order_id is not None else ()
        return self._outbox.action("cancelOrder", BlockingType.NONE, parameters)

    def clears_orders(self) -> bool:
        """Whether the vehicle is in a mode in which it drops its order, and is to be sent nothing."""
        state = self._vehicle.state
        return state is not None and state.operating_mode in CLEARING

    def is_due(self, state: State, now: float) -> bool:
        """Whether the vehicle carries out an order that it is not to have: one from before this program was started, or one that came after
        its end. One that it goes on with, although it was cancelled, is cancelled again after a while."""
        is_strange = bool(state.order_id) and not is_idle(state)
        return is_strange and (state.order_id != self._cancelled_order or now >= self._beginning_time + self._pause())

    def see(self, cancellation: Cancellation, state: State, now: float) -> None:
        """Take in what a state says about it. A vehicle that says that its order is cancelled may still roll: only one that stands has
        halted."""
        order = self._driving.order
        if order is not None and state.order_id == order.message.order_id:
            self._driving.see_progress(order, state)
        action = state.action(cancellation.action.action_id)
        status = action.action_status if action is not None else None
        is_ended = status is ActionStatus.FINISHED or (status is ActionStatus.FAILED and is_idle(state))
        is_unneeded = is_idle(state) and now >= cancellation.start_time + RESEND
        if stands(state) and (is_ended or is_unneeded):
            self.current, self._driving.order = None, None
            self._cancelled_order = state.order_id
            if status is ActionStatus.FINISHED:
                self._vehicle.note_cancelled(state.order_id)
            self._outbox.add(*cancellation.effects)
        elif status is ActionStatus.FAILED and now >= cancellation.sending_time + self._pause():
            # It did not know the order, or could not stop then: it has an order all the same.
            cancellation.action = self._action()
            self._send(cancellation, now)

    def review(self, state: State) -> None:
        """A vehicle without an order has heeded what it was told."""
        if is_idle(state):
            self._sendings = 0
            self._vehicle.disobeys(False)

    def repeat(self, cancellation: Cancellation, state: State, now: float) -> None:
        """Tell a vehicle again that does not show that it was told. Nobody knows what one does that does not heed it."""
        if state.action(cancellation.action.action_id) is None and now >= cancellation.sending_time + self._pause():
            self._send(cancellation, now)

    def _send(self, cancellation: Cancellation, now: float) -> None:
        if self._sendings >= UNHEEDED:
            self._vehicle.disobeys(True)
        self._sendings += self._vehicle.is_heard(now) and self._vehicle.hindrance is None
        cancellation.sending_time = now
        self._outbox.send_action(cancellation.action)

    def _pause(self) -> float:
        return RESEND if self._sendings <= UNHEEDED else PATIENT_RESEND
