"""All that a Repository knows, as one tree of data; what it asks of the archive of what happened, and what it hears from there."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.ontology.naming import DefinitionKey, Section
from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.knowledge import Defined, Event, ReadMap, ReadOntology, Rejected, Updated

REMEMBERED = 20_000
"""So many requests are remembered with their answers; one of them that comes again is answered again, not carried out again."""

Answer = Updated | Rejected | Defined


class LeasesDue(Struct, frozen=True, tag=True):
    """The timer: the next subscription runs out."""


class ArchiveWanted(Struct, frozen=True, tag=True):
    """The question: something from the archive, for this request. One that comes again asks the same."""

    message: Message


class HistoryOf(Struct, frozen=True, kw_only=True, tag=True):
    """A task of the archive: the latest events that changed an object, newest first, as `ArchivedEvents`. If it had other names before,
    what happened to it then is told, too."""

    object: str
    limit: int


class EventsOf(Struct, frozen=True, kw_only=True, tag=True):
    """A task of the archive: `limit` events, newest first, from the version before `before`; or, with `after`, oldest first, from the
    version behind it; as `ArchivedEvents`. `ontology`: only what changed that; `brief`: only how many changes they were."""

    limit: int
    before: int | None = None
    after: int | None = None
    ontology: bool = False
    brief: bool = False


class PageOf(Struct, frozen=True, kw_only=True, tag=True):
    """A task of the archive: `map` and `ontology` are as at `version`; which page is asked for of what they were `at_version`, before
    that? A `MapPage` or an `OntologyPage`, as the question wants."""

    question: ReadMap | ReadOntology
    at_version: int
    version: int
    map: Map
    ontology: Ontology


Task = HistoryOf | EventsOf | PageOf


class ArchivedEvents(Struct, frozen=True, tag="Happened"):
    """Events that were asked for."""

    events: tuple[Event, ...]


class DefinitionChange(Struct, frozen=True, kw_only=True):
    """That a definition changed: in which version, and by whom."""

    version: int
    author: str


class Subscription(Struct, frozen=True, kw_only=True):
    """Somebody is told of changes until `until`; it subscribed when the map was at `version`."""

    until: float
    version: int


class Contents(Struct, kw_only=True):
    """`changed_at`: the version in which each object changed last, 0 if it is not there; `defined_at`: likewise of definitions;
    `answered`: by message id, oldest first; `subscriptions`: by address; `since`: the first version to which a way leads back."""

    ontology: Ontology
    map: Map
    address: str = ""
    version: int = 0
    changed_at: dict[str, int] = field(default_factory=dict)
    defined_at: dict[Section, dict[str, DefinitionChange]] = field(default_factory=dict)
    answered: dict[str, Answer] = field(default_factory=dict)
    subscriptions: dict[str, Subscription] = field(default_factory=dict)
    since: int = 0

    def last_change(self, definition_key: DefinitionKey) -> DefinitionChange | None:
        """When the definition changed last; None if it never did."""
        return self.defined_at.get(definition_key.section, {}).get(definition_key.name)

    @property
    def ontology_changed_at(self) -> int:
        """The version in which the ontology changed last."""
        return max((defining.version for names in self.defined_at.values() for defining in names.values()), default=0)
