"""The bodies of the Repository's protocol: reading, asking and changing what is known of the environment.

Every change of the map or of the ontology has a version, counted from 1. Long answers come in pages: `after` is the last name
of the page before, `more` says whether another follows.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct

from somrs.ontology.naming import DefinitionKey, Renaming
from somrs.ontology.objects import Change, Fact, Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Definition, FunctionType, ObjectType, RelationType
from somrs.protocol.messages.body import MessageBody


class Definitions(Struct, frozen=True, kw_only=True):
    """Part of an ontology, by kind."""

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
    """The definitions, sorted by what they define."""
    definition_list = list(definitions)
    return Definitions(
        attributes=tuple(d for d in definition_list if isinstance(d, AttributeType)),
        relations=tuple(d for d in definition_list if isinstance(d, RelationType)),
        functions=tuple(d for d in definition_list if isinstance(d, FunctionType)),
        types=tuple(d for d in definition_list if isinstance(d, ObjectType)),
        services=tuple(d for d in definition_list if isinstance(d, ServiceType)),
    )


class ReadOntology(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of definitions, starting behind the first `after`; as they are now, or as they were `at_version`."""

    after: int = 0
    at_version: int | None = None


class OntologyPage(MessageBody, frozen=True, kw_only=True, tag=True):
    """`changed_at` is the version in which the ontology changed last: pages with others in it do not belong together."""

    definitions: Definitions
    version: int
    next: int
    more: bool
    changed_at: int = 0


class Define(MessageBody, frozen=True, kw_only=True, tag=True):
    """Change the ontology. First, some definitions are `removed`; then, others are `renamed`, everywhere where they are spoken of, on the
    map too; then `definitions` are added, or replace those of the same names: they use the new names.

    All or nothing: the ontology must make sense, and the map must conform. `expected_version`: only if none of the definitions of which
    it says something changed after that version.
    """

    definitions: Definitions = Definitions()
    author: str = ""
    removed: tuple[DefinitionKey, ...] = ()
    renamed: tuple[Renaming, ...] = ()
    expected_version: int | None = None


class Defined(MessageBody, frozen=True, kw_only=True, tag=True):
    """On disk. `version` is the version with the change in it."""

    version: int


class ReadMap(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of objects in the order of their names, with the facts whose first argument is on the page; as it is now, or as it
    was `at_version`."""

    after: str = ""
    at_version: int | None = None


class MapPage(MessageBody, frozen=True, kw_only=True, tag=True):
    objects: tuple[Object, ...]
    facts: tuple[Fact, ...]
    version: int
    more: bool


class QueryMap(MessageBody, frozen=True, kw_only=True, tag=True):
    """For which objects does the formula hold?"""

    formula: str
    limit: int = 100


class Row(Struct, frozen=True, kw_only=True):
    """One way in which a formula holds: an object or value, as Entish, for each variable."""

    bindings: dict[str, str]


class Rows(MessageBody, frozen=True, kw_only=True, tag=True):
    """Every way in which the formula holds, up to the limit; a formula without variables has one or none."""

    rows: tuple[Row, ...]
    version: int
    more: bool = False


class UpdateMap(MessageBody, frozen=True, kw_only=True, tag=True):
    """Change the map: single changes, and a situation (a formula that holds now). All or nothing, checked against the types.
    `expected_version`: only if no object of which it says something changed after that version; of a fact, that is the first."""

    changes: tuple[Change, ...] = ()
    situation: str | None = None
    author: str = ""
    expected_version: int | None = None


class Updated(MessageBody, frozen=True, kw_only=True, tag=True):
    """On disk. `version` is the map's version with the update in it."""

    version: int


class RenameObject(MessageBody, frozen=True, kw_only=True, tag=True):
    """Give an object of the map another name, everywhere where it is spoken of: in facts, and in the ontology. All or nothing.
    `expected_version`: only if it did not change after that version."""

    name: str
    to: str
    author: str = ""
    expected_version: int | None = None


class Undo(MessageBody, frozen=True, kw_only=True, tag=True):
    """Bring back what a version changed, if nothing changed it since. That is a change like any other, and can be undone itself."""

    version: int
    author: str = ""


Alteration = Define | UpdateMap | RenameObject | Undo
"""A change that can be considered before it is made."""


class BrokenRule(Struct, frozen=True, kw_only=True):
    """What is wrong, and where. `subject` is what `section` names: a definition, an object, or a fact; `path` is the attribute or key in
    it that is at fault."""

    subject: str
    rule: str
    message: str
    path: str = ""
    section: str = "objects"


class Rejected(MessageBody, frozen=True, kw_only=True, tag=True):
    """Nothing was changed, and why: for people, and each by what it concerns. `version`: that of the map on which that was found out."""

    problems: tuple[str, ...]
    version: int | None = None
    broken: tuple[BrokenRule, ...] = ()


class Consider(MessageBody, frozen=True, kw_only=True, tag=True):
    """What would come of a change, if it were made now? Nothing is changed."""

    change: Alteration


class Revision(Struct, frozen=True, kw_only=True):
    """What a change does to an ontology: the definitions that it changes, as they are before it and after it. What is in one of the
    two only is removed or added, or has another name in the other."""

    before: Definitions = Definitions()
    after: Definitions = Definitions()


class Considered(MessageBody, frozen=True, kw_only=True, tag=True):
    """What would come of the change: the rules that would be `broken`, so that it would be rejected; what it would change in the
    ontology; and how it would change the map. Of what is too long for a message, the first is told, and how many there are."""

    version: int
    broken: tuple[BrokenRule, ...] = ()
    revision: Revision | None = None
    changes: tuple[Change, ...] = ()
    all_broken: int = 0
    all_changes: int = 0


class ReadHistory(MessageBody, frozen=True, kw_only=True, tag=True):
    """What happened to an object, newest first."""

    object: str
    limit: int = 100


class Event(Struct, frozen=True, kw_only=True):
    """One change of the map or the ontology: who, when (seconds since 1970), which changes of the map, and which `revision` of the
    ontology. `renamed`: what has another name since; `undoes`: the version that it undid.

    Whoever asks what happened hears more: `before` are the changes that lead back, in order; and of what is too long for a message, the
    first `changes` are told (and `before`, and the `revision`, left out), and how many there are in `all_changes`.
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


class History(MessageBody, frozen=True, kw_only=True, tag=True):
    object: str
    events: tuple[Event, ...]


class ReadEvents(MessageBody, frozen=True, kw_only=True, tag=True):
    """What happened to the map and the ontology, newest first, from the version before `before`; or, with `after`, oldest first, from
    the version behind it. `ontology`: only what changed that; `brief`: without the changes, but how many they were."""

    before: int | None = None
    after: int | None = None
    limit: int = 100
    ontology: bool = False
    brief: bool = False


class Events(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of events, and whether there are more behind it. `since`: the first version at which the map is still known."""

    events: tuple[Event, ...]
    more: bool
    since: int = 0


class SubscribeMap(MessageBody, frozen=True, kw_only=True, tag=True):
    """Send the sender every change as it happens, for `lease` seconds."""

    lease: float


class MapSubscribed(MessageBody, frozen=True, kw_only=True, tag=True):
    version: int
    until: float


class MapChanged(MessageBody, frozen=True, kw_only=True, tag=True):
    """To subscribers. A gap between versions means that a message was lost: read the map again."""

    event: Event


class OntologyChanged(MessageBody, frozen=True, kw_only=True, tag=True):
    """To subscribers: the definitions that were removed (or have another name now), then those that were added or replaced; how the map
    changed with them; and what of both has another name. A gap between versions means that a message was lost."""

    definitions: Definitions
    version: int
    removed: tuple[DefinitionKey, ...] = ()
    changes: tuple[Change, ...] = ()
    renamed: tuple[Renaming, ...] = ()
