"""The bodies of the Repository's protocol: reading, asking and changing what is known of the environment.

Every change of the map or of the ontology has a version, counted from 1. Long answers come in pages: `after` is the last name
of the page before, `more` says whether another follows.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct

from somrs.ontology.objects import Change, Fact, Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Definition, FunctionType, ObjectType, RelationType


class Definitions(Struct, frozen=True, kw_only=True):
    """Part of an ontology, by kind."""

    attributes: tuple[AttributeType, ...] = ()
    relations: tuple[RelationType, ...] = ()
    functions: tuple[FunctionType, ...] = ()
    types: tuple[ObjectType, ...] = ()
    services: tuple[ServiceType, ...] = ()

    def each(self) -> Iterator[Definition]:
        yield from self.attributes
        yield from self.relations
        yield from self.functions
        yield from self.types
        yield from self.services


def by_kind(definitions: Iterable[Definition]) -> Definitions:
    """The definitions, sorted by what they define."""
    kept = list(definitions)
    return Definitions(
        attributes=tuple(d for d in kept if isinstance(d, AttributeType)),
        relations=tuple(d for d in kept if isinstance(d, RelationType)),
        functions=tuple(d for d in kept if isinstance(d, FunctionType)),
        types=tuple(d for d in kept if isinstance(d, ObjectType)),
        services=tuple(d for d in kept if isinstance(d, ServiceType)),
    )


class ReadOntology(Struct, frozen=True, kw_only=True, tag=True):
    """A page of definitions, starting behind the first `after`."""

    after: int = 0


class OntologyPage(Struct, frozen=True, kw_only=True, tag=True):
    definitions: Definitions
    version: int
    next: int
    more: bool


class Define(Struct, frozen=True, kw_only=True, tag=True):
    """Add definitions, or replace those of the same names. All or nothing: the map must still conform."""

    definitions: Definitions
    author: str = ""


class Defined(Struct, frozen=True, kw_only=True, tag=True):
    version: int


class ReadMap(Struct, frozen=True, kw_only=True, tag=True):
    """A page of objects in the order of their names, with the facts whose first argument is on the page."""

    after: str = ""


class MapPage(Struct, frozen=True, kw_only=True, tag=True):
    objects: tuple[Object, ...]
    facts: tuple[Fact, ...]
    version: int
    more: bool


class QueryMap(Struct, frozen=True, kw_only=True, tag=True):
    """For which objects does the formula hold?"""

    formula: str
    limit: int = 100


class Row(Struct, frozen=True, kw_only=True):
    """One way in which a formula holds: an object or value, as Entish, for each variable."""

    bindings: dict[str, str]


class Rows(Struct, frozen=True, kw_only=True, tag=True):
    """Every way in which the formula holds, up to the limit; a formula without variables has one or none."""

    rows: tuple[Row, ...]
    version: int
    more: bool = False


class UpdateMap(Struct, frozen=True, kw_only=True, tag=True):
    """Change the map: single changes, and a situation (a formula that holds now). All or nothing, checked against the types.
    `expected_version`: only if no object of which it says something changed after that version; of a fact, that is the first."""

    changes: tuple[Change, ...] = ()
    situation: str | None = None
    author: str = ""
    expected_version: int | None = None


class Updated(Struct, frozen=True, kw_only=True, tag=True):
    """On disk. `version` is the map's version with the update in it."""

    version: int


class Rejected(Struct, frozen=True, kw_only=True, tag=True):
    """Nothing was changed, and why. `version`: that of the map on which that was found out."""

    problems: tuple[str, ...]
    version: int | None = None


class ReadHistory(Struct, frozen=True, kw_only=True, tag=True):
    """What happened to an object, newest first."""

    object: str
    limit: int = 100


class Event(Struct, frozen=True, kw_only=True):
    """One update of the map: who, when (seconds since 1970), which changes."""

    version: int
    at: float
    author: str
    changes: tuple[Change, ...]


class History(Struct, frozen=True, kw_only=True, tag=True):
    object: str
    events: tuple[Event, ...]


class SubscribeMap(Struct, frozen=True, kw_only=True, tag=True):
    """Send the sender every change as it happens, for `lease` seconds."""

    lease: float


class MapSubscribed(Struct, frozen=True, kw_only=True, tag=True):
    version: int
    until: float


class MapChanged(Struct, frozen=True, kw_only=True, tag=True):
    """To subscribers. A gap between versions means that a message was lost: read the map again."""

    event: Event


class OntologyChanged(Struct, frozen=True, kw_only=True, tag=True):
    """To subscribers: the definitions that were added or replaced."""

    definitions: Definitions
    version: int
