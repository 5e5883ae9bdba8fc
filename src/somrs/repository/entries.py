"""What the Repository has put on disk, and what it is built from when it starts again. The tables are `app.store`'s."""

from __future__ import annotations

from dataclasses import dataclass, field

from msgspec import Struct

from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology
from somrs.protocol.knowledge import Defined, Definitions, Event, Rejected, Updated

REMEMBERED = 20_000
"""So many requests are remembered with their answers; one of them that comes again is answered again, not carried out again."""

Answer = Updated | Rejected | Defined


class Handled(Struct, frozen=True, kw_only=True):
    """A request to change something was dealt with: the answer, and what it changed, if anything."""

    request: str
    answer: Answer
    event: Event | None = None
    definitions: Definitions | None = None


class Subscription(Struct, frozen=True, kw_only=True):
    """Somebody is told of changes until `until`; None: no more."""

    address: str
    until: float | None


Entry = Handled | Subscription


class HistoryOf(Struct, frozen=True, kw_only=True):
    """A question for the store: the latest events that changed an object, newest first, as a tuple of `Event`."""

    object: str
    limit: int


@dataclass(slots=True, kw_only=True)
class Contents:
    """All that a Repository knows. `changed_at`: the version in which each object changed last, 0 if it is not there;
    `answered`: by message id, oldest first; `subscriptions`: until when, by address."""

    ontology: Ontology
    map: Map
    version: int = 0
    changed_at: dict[str, int] = field(default_factory=dict)
    answered: dict[str, Answer] = field(default_factory=dict)
    subscriptions: dict[str, float] = field(default_factory=dict)
