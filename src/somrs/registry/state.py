"""The state of a Registry, as one tree of data."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.replica import Replica, ReplicaDue
from somrs.kernel.subscription import Subscription
from somrs.ontology.types import Ontology
from somrs.protocol.messages.directory import Offer, PresenceChange, Published, Retracted
from somrs.protocol.messages.frp import Fault
from somrs.registry.neighbours import NeighbourDue, NeighbourState


class LeasesDue(Struct, frozen=True, tag=True):
    """The next lease expires."""


Timer = LeasesDue | ReplicaDue | NeighbourDue


class Provider(Struct, kw_only=True):
    """The offers of a device by service name, as it published them, and when its lease expires.

    `ontology_version`: the version of the Repository from which it has the definitions of the service types; 0: not known. `expected_by`:
    until when it is expected to publish again, because service types are defined anew.
    """

    offers: dict[str, Offer]
    expires_at: float = field(name="until")
    ontology_version: int = 0
    expected_by: float | None = None


class RegistryState(Struct, kw_only=True):
    """The state of a Registry.

    `initial_ontology` is used until the Repository's ontology has been read, if the Registry follows a Repository. `version`: that of the
    offers listed; the first one is the time of the first start, so that a Registry that lost its state does not repeat versions.
    `subscribers`: by address. `answers`: by message id, oldest first. `news_count`: notifications so far. `presence_log`: the latest
    arrivals and departures, oldest first. `neighbours`: by name, in order of precedence.
    """

    address: str
    initial_ontology: Ontology = field(name="given")
    replica: Replica | None = None
    providers: dict[str, Provider] = field(default_factory=dict)
    version: int = 0
    subscribers: dict[str, Subscription] = field(default_factory=dict)
    answers: dict[str, Published | Retracted | Fault] = field(default_factory=dict, name="answered")
    news_count: int = field(default=0, name="told")
    presence_log: list[PresenceChange] = field(default_factory=list)
    neighbours: dict[str, NeighbourState] = field(default_factory=dict)

    def audience(self, address: str) -> str:
        """The name of the neighbour that has this address; empty for those of this system, who see everything that is listed."""
        return next((name for name, neighbour in self.neighbours.items() if neighbour.settings.address == address), "")

    @property
    def other_registries(self) -> tuple[str, ...]:
        """The addresses of the other Registries of the site."""
        return tuple(neighbour.settings.address for neighbour in self.neighbours.values() if neighbour.settings.is_of_site)

    def version_for(self, audience: str) -> int:
        """The version of what such a subscriber sees."""
        return self.neighbours[audience].version if audience else self.version
