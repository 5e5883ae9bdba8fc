"""What a vehicle is asked that does not say it by itself."""

from __future__ import annotations

import math

from somrs.adapters.vda5050.control.listener import SILENCE, Listener
from somrs.adapters.vda5050.control.outbox import RESEND, Outbox

UNANSWERED = 3
"""How often something is asked that is not answered."""


class Inquiry:
    """Brokers may lose retained messages, and some vehicles send no state before they have an order."""

    def __init__(self, vehicle: Listener, outbox: Outbox) -> None:
        self._vehicle, self._outbox = vehicle, outbox
        self._asking_time = -math.inf
        self._greetings, self._states, self._factsheets = 0, UNANSWERED, UNANSWERED
        """How often it may still be asked whether it is there, how it is, and what it is."""

    def begin(self) -> None:
        """The broker is there. Vehicles whose retained messages do not come are asked."""
        self._vehicle.was_heard = False
        self._greetings = self._states = self._factsheets = UNANSWERED

    def ask(self, now: float) -> None:
        """Ask for what is missing."""
        vehicle = self._vehicle
        if now < self._asking_time + RESEND or not vehicle.takes_instant_actions:
            return
        self._asking_time = now
        if not vehicle.is_connected and not vehicle.is_outdated:
            if not vehicle.was_heard and self._greetings:
                self._greetings -= 1
                self._outbox.instant("stateRequest")
                self._outbox.instant("factsheetRequest")
            return
        is_missing = vehicle.state is None or vehicle.is_outdated
        if is_missing and self._states:
            self._states -= 1
            self._outbox.instant("stateRequest")
        elif is_missing:
            vehicle.assume_idle()
        else:
            self._states = UNANSWERED
            if vehicle.silence(now) >= SILENCE:
                self._outbox.instant("stateRequest")
        if vehicle.factsheet is None and self._factsheets:
            self._factsheets -= 1
            self._outbox.instant("factsheetRequest")
