"""The state of a Repository as one tree of data; its queries to the archive of events, and the answers."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.reservations import Reservations
from somrs.kernel.subscription import Subscription
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Section
from somrs.ontology.types import Ontology
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.knowledge import Defined, Event, QueryMap, ReadMap, ReadOntology, Rejected, Updated
from somrs.protocol.messages.neighbours import Adopted, AdoptionRefused
from somrs.protocol.messages.reservations import ReservationDenied, Reserved, TaskAssigned
from somrs.repository.neighbour_state import ForwardedUpdate, Handover, NeighbourState, SharedReservation
from somrs.repository.provenance import Provenance

REMEMBERED = 20_000
"""The number of answers that are stored. A request that arrives again within this number receives the stored answer."""

Answer = Updated | Rejected | Defined | Reserved | ReservationDenied | TaskAssigned | Adopted | AdoptionRefused


class LeasesDue(Struct, frozen=True, tag=True):
    """The timer: the next subscription expires."""


class ReservationsDue(Struct, frozen=True, tag=True):
    """The timer: the next lease of a reservation ends."""


class RepetitionDue(Struct, frozen=True, tag=True):
    """The timer: neighbours that have not answered are asked again."""


class ArchiveWanted(Struct, frozen=True, tag=True):
    """The question: data from the archive, or the answer to a large query, for this request. A repeated request asks the same question."""

    message: Message


class HistoryOf(Struct, frozen=True, kw_only=True, tag=True):
    """A task of the archive: the latest `limit` events that changed an object, newest first, as `ArchivedEvents`, with versions less than
    `before`. Events from before a renaming of the object are included, and those of objects that turned out to be this one."""

    object: str
    limit: int
    before: int | None = None


class EventsOf(Struct, frozen=True, kw_only=True, tag=True):
    """A task of the archive: at most `limit` events as `ArchivedEvents`, newest first, with versions less than `before`; or, with `after`,
    oldest first, with versions greater than `after`.

    `ontology`: only events that changed the ontology. `brief`: only the number of changes of each event.
    """

    limit: int
    before: int | None = None
    after: int | None = None
    ontology: bool = False
    brief: bool = False


class PageOf(Struct, frozen=True, kw_only=True, tag=True):
    """A task of the archive: a page of the map or ontology as it was in the earlier version `at_version`, computed back from `map` and
    `ontology` in `version`. The answer is a `MapPage` or an `OntologyPage`, depending on the question."""

    question: ReadMap | ReadOntology
    at_version: int
    version: int
    map: Map
    ontology: Ontology


class LargeQuery(Struct, frozen=True, kw_only=True, tag=True):
    """A task beside the Repository: a query that takes longer than other requests may wait. `map`: the one that it is about, which is in
    this version. The answer is `Rows`."""

    query: QueryMap
    version: int
    map: Map
    ontology: Ontology


Task = HistoryOf | EventsOf | PageOf | LargeQuery


class ArchivedEvents(Struct, frozen=True, tag="Happened"):
    """The archive's answer to `HistoryOf` and `EventsOf`."""

    events: tuple[Event, ...]


class DefinitionChange(Struct, frozen=True, kw_only=True):
    """The version and the author of the latest change of a definition."""

    version: int
    author: str


class Contents(Struct, kw_only=True):
    """The state of a Repository.

    `changed_at`: the version in which each object changed last (0 if it has no entry); `defined_at`: the same for definitions;
    `answered`: stored answers by message id, oldest first; `subscriptions`: by address; `since`: the earliest version that can be restored;
    `provenance`: since when the map has what it has; `reservations`: what tasks have; `notice_count`: of the notices to Task Managers.
    """

    ontology: Ontology
    map: Map
    address: str = ""
    version: int = 0
    changed_at: dict[str, int] = field(default_factory=dict)
    defined_at: dict[Section, dict[str, DefinitionChange]] = field(default_factory=dict)
    answered: dict[str, Answer] = field(default_factory=dict)
    subscriptions: dict[str, Subscription] = field(default_factory=dict)
    since: int = 0
    provenance: Provenance = field(default_factory=Provenance)
    reservations: Reservations = field(default_factory=Reservations)
    notice_count: int = 0
    neighbours: dict[str, NeighbourState] = field(default_factory=dict)
    """By the names of their maps."""
    forwarded: dict[str, ForwardedUpdate] = field(default_factory=dict)
    """Updates of neighbours' objects that are not done yet, by message id."""
    handovers: dict[str, Handover] = field(default_factory=dict)
    """The objects that are getting another home, by name."""
    shared_reservations: dict[str, SharedReservation] = field(default_factory=dict)
    """What tasks have reserved of neighbours, by task."""
    repeats_at: float | None = None
    """When neighbours are asked again whose answers are due."""

    def neighbour_at(self, address: str) -> NeighbourState | None:
        """The neighbour at an address."""
        return next((neighbour for neighbour in self.neighbours.values() if neighbour.settings.address == address), None)

    def last_change(self, definition_key: DefinitionKey) -> DefinitionChange | None:
        """The latest change of the definition; None if it never changed."""
        return self.defined_at.get(definition_key.section, {}).get(definition_key.name)

    @property
    def ontology_changed_at(self) -> int:
        """The version in which the ontology changed last."""
        return max((defining.version for names in self.defined_at.values() for defining in names.values()), default=0)
