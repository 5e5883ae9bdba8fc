"""What a vehicle does besides driving, and the end of what it does."""

from __future__ import annotations

from dataclasses import dataclass

from somrs.adapters.vda5050.control.outbox import UNHEEDED
from somrs.adapters.vda5050.control.retrying import Retrying
from somrs.adapters.vda5050.messages.orders import Action
from somrs.adapters.vda5050.messages.states import State

CHARGING_SHOWS = 30.0
"""Seconds in which a vehicle says that it charges, after it has said that it has begun."""


@dataclass(kw_only=True)
class Job:
    """An action at the place of the vehicle: in an order of its own, or `is_instant`, sent at `sending_time`. `charges`: it goes on until
    the battery is full. `sendings`: how often it was sent to a vehicle that says how it is. `unlisted`: how many states in a row do not
    say what has become of it."""

    action: Action
    retrying: Retrying
    charges: bool = False
    is_instant: bool = False
    sending_time: float | None = None
    sendings: int = 0
    unlisted: int = 0


@dataclass(kw_only=True)
class Charging:
    """The battery is charged up to `full` (0 to 100), since `start_time`, and until `least_end` at least. `stop_id`: of the action
    stopCharging, which was sent at `sending_time`, and `sendings` times to a vehicle that says how it is. `is_left`: its next order says
    that it is to stop."""

    full: float
    start_time: float
    least_end: float = 0.0
    has_charged: bool = False
    is_interrupted: bool = False
    is_left: bool = False
    stop_id: str | None = None
    sending_time: float = 0.0
    sendings: int = 0

    def is_over(self, state: State, now: float) -> bool:
        """Whether the vehicle charges no more, or was told in vain to stop."""
        power = state.power_supply
        is_idle = self.has_charged or power.state_of_charge >= self.full or now >= self.start_time + CHARGING_SHOWS
        action = state.action(self.stop_id) if self.stop_id is not None else None
        has_answered = action is not None and action.action_status.is_final
        return (is_idle and not power.charging) or self.is_left or has_answered or self.sendings >= UNHEEDED
