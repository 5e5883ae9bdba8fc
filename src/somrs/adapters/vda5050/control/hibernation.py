"""A vehicle that has nothing to do hibernates, if the site wants that, and wakes up when it is wanted (3.0, 6.2.3.1)."""

from __future__ import annotations

import math

from somrs.adapters.vda5050.control.condition import is_idle
from somrs.adapters.vda5050.control.listener import Listener
from somrs.adapters.vda5050.control.outbox import RESEND, Outbox
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.states import State

START, STOP = "startHibernation", "stopHibernation"


class Hibernation:
    """`idle_time`: seconds without anything to do, after which the vehicle is to hibernate; None: it is not."""

    def __init__(self, vehicle: Listener, outbox: Outbox, idle_time: float | None) -> None:
        self._vehicle, self._outbox, self._idle_time = vehicle, outbox, idle_time
        self._idle_since: float | None = None
        self._start: str | None = None
        self._sending_time = -math.inf

    def reconcile(self, now: float, *, is_wanted: bool) -> None:
        """Wake the vehicle if something is wanted from it, or if nobody knows how it is; have it hibernate after a while otherwise."""
        vehicle = self._vehicle
        if vehicle.is_hibernating:
            self._idle_since, self._start = None, None
            if (is_wanted or vehicle.state is None) and now >= self._sending_time + RESEND:
                self._sending_time = now
                self._outbox.instant(STOP)
            return
        state = vehicle.state
        if is_wanted or self._idle_time is None or state is None or not self._may_rest(state):
            self._idle_since = None
            return
        self._idle_since = now if self._idle_since is None else self._idle_since
        if now >= self._idle_since + self._idle_time:
            self._begin(state, now)

    def is_falling_asleep(self, state: State, now: float) -> bool:
        """Whether the vehicle may be about to hibernate, so that it would not take an order."""
        shown = state.action(self._start) if self._start is not None else None
        is_open = shown is not None and not shown.action_status.is_final
        if self._start is not None and not is_open and now >= self._sending_time + RESEND:
            self._start = None
        return self._start is not None

    def _may_rest(self, state: State) -> bool:
        vehicle = self._vehicle
        can_rest = vehicle.version is Version.V3_0 and vehicle.factsheet is not None and vehicle.can_perform(START)
        return can_rest and vehicle.takes_orders and is_idle(state) and not state.paused and not state.power_supply.charging

    def _begin(self, state: State, now: float) -> None:
        shown = state.action(self._start) if self._start is not None else None
        if shown is not None and shown.action_status.is_final:
            self._idle_since = now  # it could not, or goes on for a reason of its own
        elif shown is None and now >= self._sending_time + RESEND:
            self._sending_time = now
            self._start = self._outbox.instant(START)
