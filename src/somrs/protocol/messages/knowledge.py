"""The bodies of the Repository's protocol: reads, queries and changes of the ontology and the map.

Every change of the map or of the ontology has a version, counted from 1. Long answers come in pages: `after` is the last name of the page
before; `more` says whether another page follows.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct

from somrs.ontology.naming import DefinitionKey, Renaming, Section
from somrs.ontology.objects import Change, Fact, Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Definition, FunctionType, ObjectType, RelationType
from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.observations import Discovery, Observation, Reception
from somrs.protocol.messages.reservations import UnderReservation


class Definitions(Struct, frozen=True, kw_only=True):
    """A part of an ontology, by kind."""

    attributes: tuple[AttributeType, ...] = ()
    relations: tuple[RelationType, ...] = ()
    functions: tuple[FunctionType, ...] = ()
    types: tuple[ObjectType, ...] = ()
    services: tuple[ServiceType, ...] = ()

    def all_definitions(self) -> Iterator[Definition]:
        yield from self.attributes
        yield from self.relations
        yield from self.functions
        yield from self.types
        yield from self.services


def by_kind(definitions: Iterable[Definition]) -> Definitions:
    """Group the definitions by kind."""
    definition_list = list(definitions)
    return Definitions(
        attributes=tuple(d for d in definition_list if isinstance(d, AttributeType)),
        relations=tuple(d for d in definition_list if isinstance(d, RelationType)),
        functions=tuple(d for d in definition_list if isinstance(d, FunctionType)),
        types=tuple(d for d in definition_list if isinstance(d, ObjectType)),
        services=tuple(d for d in definition_list if isinstance(d, ServiceType)),
    )


class ReadOntology(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read a page of definitions, without the first `after`, as they are now or as they were `at_version`."""

    after: int = 0
    at_version: int | None = None


class OntologyPage(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of definitions. `changed_at` is the version of the last change of the ontology; pages with different values do not match."""

    definitions: Definitions
    version: int
    next: int
    more: bool
    changed_at: int = 0


class Define(MessageBody, frozen=True, kw_only=True, tag=True):
    """Change the ontology: remove definitions (`removed`), then rename others (`renamed`), then add or replace `definitions`.

    Renaming covers all references, also on the map; `definitions` use the new names. The change is made completely or not at all: the
    ontology must be consistent, and the map must conform to it. `expected_version`: make the change only if none of its definitions changed
    after that version. `brought`: a device brings these definitions with its program; those that the ontology has stay as they are, unless
    the author defined them, and one that the program does not agree with is refused.
    """

    definitions: Definitions = Definitions()
    author: str = ""
    removed: tuple[DefinitionKey, ...] = ()
    renamed: tuple[Renaming, ...] = ()
    expected_version: int | None = None
    brought: bool = False


class Defined(MessageBody, frozen=True, kw_only=True, tag=True):
    """The change is on disk. `version` is the version with the change."""

    version: int


class ReadMap(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read a page of objects in the order of their names, with the facts whose first argument is on the page.

    `at_version`: as they were in that version; None: as they are now. `situation`: as they would be if this formula held, too; not
    together with `at_version`. `own`: only objects that have their home on this map, as they are now.
    """

    after: str = ""
    at_version: int | None = None
    situation: str | None = None
    own: bool = False


class MapPage(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of the map with the name `map`. `leaving`: objects on it of which the reader, a neighbour, is becoming the home.

    `former_names`, on the first page: what objects are called now, by names that they had and no object has any more.
    """

    objects: tuple[Object, ...]
    facts: tuple[Fact, ...]
    version: int
    more: bool
    map: str = ""
    leaving: tuple[str, ...] = ()
    former_names: dict[str, str] = {}


class QueryMap(MessageBody, frozen=True, kw_only=True, tag=True):
    """Find the objects for which the formula holds. `situation`: on the map as it would be if this formula held, too. `skip`: so many
    solutions are left out, which earlier pages had."""

    formula: str
    limit: int = 100
    situation: str | None = None
    skip: int = 0


class Row(Struct, frozen=True, kw_only=True):
    """One solution of a formula: an object or value, as Entish, for each variable."""

    bindings: dict[str, str]


class Rows(MessageBody, frozen=True, kw_only=True, tag=True):
    """All solutions of the formula, up to the limit. A formula without variables has one or none. `more`: there are further ones."""

    rows: tuple[Row, ...]
    version: int
    more: bool = False


class UpdateMap(MessageBody, frozen=True, kw_only=True, tag=True):
    """Change the map: by single changes, and by a situation (a formula that holds now, or that held when it was observed).

    A typed variable of the situation is a sighted object: `?Seen: Jar isOn Table001`. The Repository finds it on the map, or adds it.
    The update is checked against the types, and made completely or not at all. `expected_version`: make it only if none of its objects
    changed after that version; the object of a fact is its first argument. `observation`: when and how the update was observed; what is
    older than the map's news is left out then, and the `reception` of the answer says so. `reservation`: the task that reports, and under
    which reservation.
    """

    changes: tuple[Change, ...] = ()
    situation: str | None = None
    author: str = ""
    expected_version: int | None = None
    observation: Observation | None = None
    reservation: UnderReservation | None = None


class Updated(MessageBody, frozen=True, kw_only=True, tag=True):
    """The update is on disk. `version` is the map's version with the update; `reception`: what became of its parts, if not all are news."""

    version: int
    reception: Reception | None = None


class RenameObject(MessageBody, frozen=True, kw_only=True, tag=True):
    """Rename an object of the map and all references to it, in facts and in the ontology, completely or not at all.

    `expected_version`: rename it only if it did not change after that version.
    """

    name: str
    to: str
    author: str = ""
    expected_version: int | None = None


class MergeObject(MessageBody, frozen=True, kw_only=True, tag=True):
    """Two objects of the map are one: `name` is `into`, which keeps its name and has what is known under both, completely or not at all.

    Reports that name `name` later are about `into`. `expected_version`: only if neither changed after that version.
    """

    name: str
    into: str
    author: str = ""
    expected_version: int | None = None


class Undo(MessageBody, frozen=True, kw_only=True, tag=True):
    """Revert the changes of a version, if nothing has changed them since. This is a change like any other, and can be undone itself."""

    version: int
    author: str = ""


Alteration = Define | UpdateMap | RenameObject | MergeObject | Undo
"""A change that can be considered before it is made."""


class BrokenRule(Struct, frozen=True, kw_only=True):
    """A broken rule, and where it is broken.

    `subject` is a definition, an object or a fact, as `section` says; `path` is the attribute or key in it.
    """

    subject: str
    rule: str
    message: str
    path: str = ""
    section: str = "objects"


class Rejected(MessageBody, frozen=True, kw_only=True, tag=True):
    """The change was rejected, with the problems as sentences for people, and as data. `version` is that of the map that was checked."""

    problems: tuple[str, ...]
    version: int | None = None
    broken: tuple[BrokenRule, ...] = ()


class Consider(MessageBody, frozen=True, kw_only=True, tag=True):
    """Report what a change would do, if it were made now. Nothing is changed."""

    change: Alteration


class Revision(Struct, frozen=True, kw_only=True):
    """The effect of a change on an ontology: the definitions that it changes, before and after it.

    A definition in only one of the two is added, removed or renamed.
    """

    before: Definitions = Definitions()
    after: Definitions = Definitions()


class Considered(MessageBody, frozen=True, kw_only=True, tag=True):
    """What the change would do: the rules that it would break (and be rejected for), and how it would change the ontology and the map.

    Of a list that is too long for a message, the answer has the beginning, and the number of all entries.
    """

    version: int
    broken: tuple[BrokenRule, ...] = ()
    revision: Revision | None = None
    changes: tuple[Change, ...] = ()
    all_broken: int = 0
    all_changes: int = 0


class ReadHistory(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read the events of an object, newest first, from before the version `before`: under all names that it had, and those of the objects
    that turned out to be this one."""

    object: str
    limit: int = 100
    before: int | None = None


class Merging(Struct, frozen=True, kw_only=True):
    """The object `name` turned out to be the object `into`, whose name it has now."""

    name: str
    into: str

    def __str__(self) -> str:
        return f"{self.name} is {self.into}"


def new_names_of(renamed: Iterable[Renaming], merged: Iterable[Merging] = ()) -> dict[str, str]:
    """The names that objects have now, by the names that they lost."""
    names = {renaming.name: renaming.to for renaming in renamed if renaming.section is Section.OBJECTS}
    return names | {merging.name: merging.into for merging in merged}


class Event(Struct, frozen=True, kw_only=True):
    """One change of the map or the ontology: its author, time (seconds since 1970), changes of the map, and `revision` of the ontology.

    `renamed`: what the change renamed; `merged`: objects that turned out to be others; `undoes`: the version that it reverts; `reception`:
    what became of the report that it comes from.

    In answers, `before` are the changes that revert the event, in order. Of an event that is too long for a message, the answer has the
    first `changes` and their number in `all_changes`, without `before` and `revision`.
    """

    version: int
    at: float
    author: str
    changes: tuple[Change, ...]
    revision: Revision | None = None
    renamed: tuple[Renaming, ...] = ()
    undoes: int | None = None
    before: tuple[Change, ...] = ()
    all_changes: int | None = None
    reception: Reception | None = None
    merged: tuple[Merging, ...] = ()

    @property
    def new_names(self) -> dict[str, str]:
        """The names that objects have after the event, by the names that they lost."""
        return new_names_of(self.renamed, self.merged)


class History(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of the events of an object. `more`: another page follows, before the version of the last event.

    `discovered`: who put it on the map by a sighting, and when; None if it was known otherwise.
    """

    object: str
    events: tuple[Event, ...]
    more: bool = False
    discovered: Discovery | None = None


class ReadEvents(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read the events of the map and the ontology: newest first, from before `before`, or oldest first, from after `after`.

    `ontology`: only changes of the ontology. `brief`: the number of changes instead of the changes.
    """

    before: int | None = None
    after: int | None = None
    limit: int = 100
    ontology: bool = False
    brief: bool = False


class Events(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of events. `more`: another page follows. `since`: the first version at which the map is still known."""

    events: tuple[Event, ...]
    more: bool
    since: int = 0


class SubscribeMap(MessageBody, frozen=True, kw_only=True, tag=True):
    """Send the sender every change as it happens, for `lease` seconds. `own`: only changes of objects that have their home on this map;
    other versions come without changes."""

    lease: float
    own: bool = False


class MapSubscribed(MessageBody, frozen=True, kw_only=True, tag=True):
    """A subscription in version `version`, until `until` (seconds since 1970). Unasked, it says that something else is to be read.

    `complete`: the maps of which the subscriber sees all objects. `shown`: the places that it sees, if it is a neighbour and sees not all.
    """

    version: int
    until: float
    complete: tuple[str, ...] = ()
    shown: tuple[str, ...] = ()


class MapChanged(MessageBody, frozen=True, kw_only=True, tag=True):
    """To subscribers: the map changed. A gap between versions means that a message was lost: read the map again."""

    event: Event


class OntologyChanged(MessageBody, frozen=True, kw_only=True, tag=True):
    """To subscribers: the ontology changed.

    `removed` are the definitions that were removed or renamed, `definitions` those that were added or replaced, `changes` those of the map,
    and `renamed` the new names in both. A gap between versions means that a message was lost.
    """

    definitions: Definitions
    version: int
    removed: tuple[DefinitionKey, ...] = ()
    changes: tuple[Change, ...] = ()
    renamed: tuple[Renaming, ...] = ()
