"""What a vehicle does besides driving, and the end of what it does."""

from __future__ import annotations

from dataclasses import dataclass, field

from somrs.adapters.vda5050.control.exchange import Effect
from somrs.adapters.vda5050.control.retrying import Retrying
from somrs.adapters.vda5050.messages.orders import Action


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
    """The battery is charged up to `full` (0 to 100), since `start_time`. `stop_id`: of the action stopCharging, which was sent at
    `sending_time`, and `sendings` times to a vehicle that says how it is."""

    full: float
    start_time: float
    has_charged: bool = False
    is_interrupted: bool = False
    stop_id: str | None = None
    sending_time: float = 0.0
    sendings: int = 0


@dataclass(kw_only=True)
class Cancellation:
    """The order is being cancelled since `start_time`. `effects`: what to do when the vehicle stands."""

    action: Action
    start_time: float
    sending_time: float
    effects: list[Effect] = field(default_factory=list)
