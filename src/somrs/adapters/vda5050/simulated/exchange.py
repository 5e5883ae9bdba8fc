"""What the state machine of a simulated vehicle takes in, and what it has done about it."""

from __future__ import annotations

from msgspec import Struct

from somrs.adapters.vda5050.messages.factsheets import Factsheet
from somrs.adapters.vda5050.messages.header import Topic
from somrs.adapters.vda5050.messages.orders import InstantActions, Order, Responses, ZoneSetContent
from somrs.adapters.vda5050.messages.states import Connection, OperatingMode, State, VehicleError
from somrs.adapters.vda5050.simulated.body import Command, Sensed


class Ordered(Struct, frozen=True, kw_only=True):
    """An order has come. `deviations`: what of it is not as the standard has it."""

    order: Order
    deviations: tuple[str, ...] = ()


class Instructed(Struct, frozen=True, kw_only=True):
    """Instant actions have come."""

    actions: InstantActions
    deviations: tuple[str, ...] = ()


class Zoned(Struct, frozen=True, kw_only=True):
    """A zone set has come."""

    content: ZoneSetContent


class Responded(Struct, frozen=True, kw_only=True):
    """Fleet control has answered requests."""

    responses: Responses


class Garbled(Struct, frozen=True, kw_only=True):
    """Something has come on a topic that cannot be read."""

    topic: Topic
    reason: str


class Felt(Struct, frozen=True, kw_only=True):
    """How the body is."""

    sensed: Sensed


class Connected(Struct, frozen=True):
    """The connection to the broker is there, for the first time or again."""


class Switched(Struct, frozen=True, kw_only=True):
    """Somebody switched the operating mode at the vehicle."""

    mode: OperatingMode


class Pressed(Struct, frozen=True, kw_only=True):
    """Somebody pressed a button at the vehicle, which pauses it or lets it go on."""

    pauses: bool


class Faulted(Struct, frozen=True, kw_only=True):
    """The vehicle has an error, until it is `Repaired`."""

    error: VehicleError


class Repaired(Struct, frozen=True):
    """The vehicle has no error of its own any more."""


class Restarted(Struct, frozen=True):
    """The vehicle was switched off and on: it knows nothing of an order."""


class Misbehaves(Struct, frozen=True, kw_only=True):
    """The vehicle is not as the standard has it. `ignores_cancel`: nothing happens at cancelOrder. `rolls_on`: it says that the order is
    cancelled, and drives on to the end of its leg. `cannot_download`: it does not reach the server of the maps."""

    ignores_cancel: bool = False
    rolls_on: bool = False
    cannot_download: bool = False


Input = (
    Ordered | Instructed | Zoned | Responded | Garbled | Felt | Connected | Switched | Pressed | Faulted | Repaired | Restarted | Misbehaves
)


class Publish(Struct, frozen=True, kw_only=True):
    """Publish a message."""

    topic: Topic
    message: Connection | State | Factsheet


class Act(Struct, frozen=True, kw_only=True):
    """Have the body begin a command."""

    number: int
    command: Command


Effect = Publish | Act
