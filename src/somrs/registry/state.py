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
    expires_at: float = field(name="until")


class RegistryState(Struct, kw_only=True):
    """`initial_ontology` is the ontology until the Repository's was read, if there is one to be followed. `subscribers`: until when, by
    address; `answers`: by message id, oldest first; `news_count` counts the news."""

    address: str
    initial_ontology: Ontology = field(name="given")
    replica: Replica | None = None
    providers: dict[str, Provider] = field(default_factory=dict)
    subscribers: dict[str, float] = field(default_factory=dict)
    answers: dict[str, Published | Retracted | Fault] = field(default_factory=dict, name="answered")
    news_count: int = field(default=0, name="told")
