"""What the Repository has put on disk, what it asks of its store, and what it is built from when it starts again. The tables are
`storage.repository_store`'s."""

from __future__ import annotations

from dataclasses import dataclass, field

from msgspec import Struct

from somrs.ontology.naming import Named
from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Defined, Event, Rejected, Updated

REMEMBERED = 20_000
"""So many requests are remembered with their answers; one of them that comes again is answered again, not carried out again."""

Answer = Updated | Rejected | Defined


class Handled(Struct, frozen=True, kw_only=True):
    """A request to change something was dealt with: the answer, and what it changed, if anything, with all that leads back."""

    request: str
    answer: Answer
    event: Event | None = None


class Subscription(Struct, frozen=True, kw_only=True):
    """Somebody is told of changes until `until`; None: no more."""

    address: str
    until: float | None


Entry = Handled | Subscription


class LeasesDue(Struct, frozen=True, tag=True):
    """The timer: the next subscription runs out."""


class StoreWanted(Struct, frozen=True, tag=True):
    """The question: something from the store, for the request of that id."""

    request: str


class HistoryOf(Struct, frozen=True, kw_only=True):
    """A question for the store: the latest events that changed an object, newest first, as a tuple of `Event`. If it had other names
    before, what happened to it then is told, too."""

    object: str
    limit: int


class EventsOf(Struct, frozen=True, kw_only=True):
    """A question for the store: `limit` events, newest first, from the version before `before`; or, with `after`, oldest first, from
    the version behind it; as a tuple of `Event`. `ontology`: only what changed that; `brief`: only how many changes they were."""

    limit: int
    before: int | None = None
    after: int | None = None
    ontology: bool = False
    brief: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PastOf:
    """A question for the store: `map` and `ontology` are as at `version`; what were they `at_version`, before that? A `past.Past`."""

    at_version: int
    version: int
    map: Map
    ontology: Ontology


@dataclass(frozen=True, slots=True, kw_only=True)
class Defining:
    """That a definition changed: in which version, and by whom."""

    version: int
    author: str


@dataclass(slots=True, kw_only=True)
class Contents:
    """All that a Repository knows. `changed_at`: the version in which each object changed last, 0 if it is not there; `defined_at`:
    likewise of definitions; `answered`: by message id, oldest first; `subscriptions`: until when, by address; `since`: the first version
    to which a way leads back."""

    ontology: Ontology
    map: Map
    version: int = 0
    changed_at: dict[str, int] = field(default_factory=dict)
    defined_at: dict[Named, Defining] = field(default_factory=dict)
    answered: dict[str, Answer] = field(default_factory=dict)
    subscriptions: dict[str, float] = field(default_factory=dict)
    since: int = 0

    @property
    def ontology_changed_at(self) -> int:
        """The version in which the ontology changed last."""
        return max((defining.version for defining in self.defined_at.values()), default=0)
