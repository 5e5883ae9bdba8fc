"""The map: reading, queries, changes and history."""

from __future__ import annotations

from importlib.util import find_spec

import msgspec

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.client.client import Refused
from somrs.client.operations import Document, operation
from somrs.ontology.files.site import dump_site
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object, ObjectAdded, ValueSet
from somrs.protocol.messages.knowledge import (
    BrokenRule,
    Considered,
    Events,
    History,
    MergeObject,
    ReadEvents,
    Rejected,
    RenameObject,
    Rows,
    Updated,
    UpdateMap,
)
from somrs.repository.rollback import rewind_map

_YAML = "application/yaml"

_POSE = ("Position", "Rotation", "Shape")
"""How the paths of the attributes begin that say where an object is, and how large."""

MAX_REWOUND_VERSIONS = 100
"""Up to this number of versions, reading the changes is faster than reading a map of thousands of objects."""


class MapView(msgspec.Struct, frozen=True, kw_only=True):
    """A version of the map `name`: all its objects and facts."""

    version: int
    name: str = ""
    objects: tuple[Object, ...]
    facts: tuple[Fact, ...]


class MapService:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("GET", "/map", Right.SEE)
    async def read(self, version: int | None = None) -> MapView:
        """Read the whole map as it is now, or as it was at a version."""
        map, now = self._context.map, self._context.version
        if version is not None and version != now:
            map, now = await self._read_map_at(map, now, version), version
        return MapView(version=now, name=map.name, objects=tuple(map.objects.values()), facts=tuple(map.facts()))

    @operation("POST", "/map/changes", Right.MODEL)
    async def change(self, body: UpdateMap) -> Updated:
        """Change the map: all changes or none, checked against the ontology.

        With `expected_version`, the request is refused if an object that it concerns has changed since that version. A typed variable of
        the situation is a sighted object, and `observation` says when and how it was observed; `reception` in the answer has the names of
        the sighted objects, and the parts of the report that were old news. Furniture and robots must fit where they are put: a position in
        a wall, or one in which furniture and a robot overlap, is refused.
        """
        self._check_fit(body)
        return await self._context.client.report(body)

    def _check_fit(self, update: UpdateMap) -> None:
        """Raise Refused if a change puts something where it does not fit. What overlaps already may stay so, but not deeper."""
        map, ontology = self._context.map, self._context.ontology
        added = {change.object.name: change for change in update.changes if isinstance(change, ObjectAdded)}
        posed = [change for change in update.changes if isinstance(change, ValueSet) and change.path.startswith(_POSE)]
        posed = [change for change in posed if change.object in map.objects or change.object in added]  # the Repository refuses the others
        names = dict.fromkeys([*added, *(change.object for change in posed)])
        if not names or find_spec("numpy") is None:  # the geometry needs it, and the API runs with the core alone
            return
        from somrs.space.fitting import misfits

        depths = {(name, obstacle): depth for name, obstacle, depth in misfits(map, ontology, names)}
        broken = tuple(
            BrokenRule(
                subject=name,
                rule="no-room",
                message=f"it does not fit there: it would be {100 * depth:.0f} cm deep in {obstacle}; put it elsewhere",
            )
            for name, obstacle, depth in misfits(map.changed([*added.values(), *posed]), ontology, names)
            if depth > depths.get((name, obstacle), 0.0)
        )
        if broken:
            raise Refused(Rejected(problems=tuple(f"{rule.subject}: {rule.message}" for rule in broken), broken=broken))

    @operation("POST", "/map/consider", Right.SEE)
    async def consider(self, body: UpdateMap) -> Considered:
        """Report the consequences of a change of the map, without making it."""
        return await self._context.client.consider(body)

    @operation("POST", "/map/renames", Right.MODEL)
    async def rename(self, body: RenameObject) -> Updated:
        """Rename an object and all references to it. The object keeps its history."""
        return Updated(version=await self._context.client.rename(body))

    @operation("POST", "/map/merges", Right.MODEL)
    async def merge(self, body: MergeObject) -> Updated:
        """State that two objects are one: `name` is `into`, which keeps its name and has what is known under both.

        Of where it is, the newer news counts. It can be undone like any change.
        """
        return Updated(version=await self._context.client.merge(body))

    @operation("POST", "/map/merges/consider", Right.SEE)
    async def consider_merge(self, body: MergeObject) -> Considered:
        """Report how the map would change if two objects were one, without changing it."""
        return await self._context.client.consider(body)

    @operation("GET", "/map/query", Right.SEE)
    async def query(self, formula: str, limit: int = 100) -> Rows:
        """Find the objects and values for which a formula holds."""
        return await self._context.client.query(formula, limit)

    @operation("GET", "/map/objects/{name}/history", Right.SEE)
    async def history(self, name: str, limit: int = 100, before: int | None = None) -> History:
        """Read the history of an object with versions below `before`, newest first, and who discovered it.

        It includes the time when the object had another name, and that of objects that turned out to be this one. `more`: there are
        earlier events, before the version of the last one.
        """
        return await self._context.client.history(name, limit, before)

    @operation("GET", "/map/events", Right.SEE)
    async def events(self, before: int | None = None, after: int | None = None, limit: int = 100, brief: bool = False) -> Events:
        """Read the events of the map and the ontology with versions below `before`, newest first.

        With `after`: the events with versions above it, oldest first. `brief`: only the number of changes in each event, so that ten
        thousand events can be read at once.
        """
        return await self._context.client.read_events(ReadEvents(before=before, after=after, limit=limit, brief=brief))

    @operation("POST", "/map/undo/{version}", Right.MODEL)
    async def undo(self, version: int, author: str = "") -> Updated:
        """Undo the changes of a version, unless later versions have changed the same things."""
        return Updated(version=await self._context.client.undo(version, author))

    @operation("GET", "/map/export.yaml", Right.SEE)
    async def export(self) -> Document:
        """Export the site as a file for `somrs up`: the map, and its ontology without the upper ontology."""
        text = dump_site(self._context.ontology, self._context.map)
        return Document(content=text.encode(), media_type=_YAML, name="site.yaml")

    async def _read_map_at(self, map: Map, now: int, version: int) -> Map:
        """The map at a version: derived from the current map for a recent version, read as a whole for an older one."""
        if 0 < now - version <= MAX_REWOUND_VERSIONS:
            page = await self._context.client.read_events(ReadEvents(after=version, limit=now - version))
            whole = [event.version for event in page.events] == [*range(version + 1, now + 1)] and page.since <= version
            if whole and all(event.all_changes is None for event in page.events):
                return rewind_map(map, (event.before for event in reversed(page.events)))
        return await self._context.client.map(version)
