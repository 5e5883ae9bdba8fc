"""All that a Registry knows, as one tree of data."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.replica import Replica, ReplicaDue
from somrs.ontology.types import Ontology
from somrs.protocol.messages.directory import Offer, Published, Retracted
from somrs.protocol.messages.frp import Fault


class LeasesDue(Struct, frozen=True, tag=True):
    """The next lease runs out."""


Timer = LeasesDue | ReplicaDue


class Provider(Struct, kw_only=True):
    """What a device offers, by service name, and until when."""

    offers: dict[str, Offer]
    until: float


class RegistryState(Struct, kw_only=True):
    """`given` is the ontology until the Repository's was read, if there is one to be followed. `subscribers`: until when, by address;
    `answered`: by message id, oldest first; `told` counts the news."""

    address: str
    given: Ontology
    replica: Replica | None = None
    providers: dict[str, Provider] = field(default_factory=dict)
    subscribers: dict[str, float] = field(default_factory=dict)
    answered: dict[str, Published | Retracted | Fault] = field(default_factory=dict)
    told: int = 0
