"""The map: read, asked, changed, and looked back at."""

from __future__ import annotations

import msgspec

from somrs.api.context import Context
from somrs.client.operations import Document, operation
from somrs.ontology.files.site import dump_site
from somrs.ontology.objects import Fact, Map, Object
from somrs.protocol.messages.knowledge import Considered, Events, History, ReadEvents, RenameObject, Rows, Updated, UpdateMap
from somrs.repository.rollback import rewind_map

YAML = "application/yaml"

MAX_REWOUND_VERSIONS = 100
"""So many changes are told in less time than a map of thousands of objects."""


class MapView(msgspec.Struct, frozen=True, kw_only=True):
    """A map: all its objects and facts, and the version that it is of."""

    version: int
    objects: tuple[Object, ...]
    facts: tuple[Fact, ...]


class MapService:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("GET", "/map")
    async def read(self, version: int | None = None) -> MapView:
        """The whole map as it is now, or as it was at a version."""
        map, now = self._context.map, self._context.version
        if version is not None and version != now:
            map, now = await self._read_map_at(map, now, version), version
        return MapView(version=now, objects=tuple(map.objects.values()), facts=tuple(map.facts()))

    @operation("POST", "/map/changes")
    async def change(self, body: UpdateMap) -> Updated:
        """Change the map: all or nothing, checked against the types.

        With `expected_version`, only if nothing that it speaks of changed since.
        """
        return Updated(version=await self._context.client.update(body))

    @operation("POST", "/map/consider")
    async def consider(self, body: UpdateMap) -> Considered:
        """What would come of changing the map so? Nothing is changed."""
        return await self._context.client.consider(body)

    @operation("POST", "/map/renames")
    async def rename(self, body: RenameObject) -> Updated:
        """Give an object another name, everywhere where it is spoken of; its history stays with it."""
        return Updated(version=await self._context.client.rename(body))

    @operation("GET", "/map/query")
    async def query(self, formula: str, limit: int = 100) -> Rows:
        """For which objects does the formula hold?"""
        return await self._context.client.query(formula, limit)

    @operation("GET", "/map/objects/{name}/history")
    async def history(self, name: str, limit: int = 100) -> History:
        """What happened to an object, newest first; also while it had another name."""
        return await self._context.client.history(name, limit)

    @operation("GET", "/map/events")
    async def events(self, before: int | None = None, after: int | None = None, limit: int = 100, brief: bool = False) -> Events:
        """What happened to the map and the ontology, newest first, from the version before `before`.

        With `after`, oldest first, from the version behind it. `brief`: without the changes, but how many they were, so that ten thousand
        events can be read at once.
        """
        return await self._context.client.read_events(ReadEvents(before=before, after=after, limit=limit, brief=brief))

    @operation("POST", "/map/undo/{version}")
    async def undo(self, version: int, author: str = "") -> Updated:
        """Bring back what a version changed, if nothing changed it since."""
        return Updated(version=await self._context.client.undo(version, author))

    @operation("GET", "/map/export.yaml")
    async def export(self) -> Document:
        """The whole site as it is now, as a file that `somrs up` takes: the map, and what its ontology has beyond the upper one."""
        text = dump_site(self._context.ontology, self._context.map)
        return Document(content=text.encode(), media_type=YAML, name="site.yaml")

    async def _read_map_at(self, map: Map, now: int, version: int) -> Map:
        """The map at a version: of one that is near, what leads back is soon told; any other is read as a whole."""
        if 0 < now - version <= MAX_REWOUND_VERSIONS:
            page = await self._context.client.read_events(ReadEvents(after=version, limit=now - version))
            whole = [event.version for event in page.events] == [*range(version + 1, now + 1)] and page.since <= version
            if whole and all(event.all_changes is None for event in page.events):
                return rewind_map(map, (event.before for event in reversed(page.events)))
        return await self._context.client.map(version)
