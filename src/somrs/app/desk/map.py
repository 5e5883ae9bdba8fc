"""The map: read, asked and changed."""

from __future__ import annotations

import msgspec

from somrs.app.desk.context import Context
from somrs.app.desk.operations import operation
from somrs.ontology.objects import Fact, Object
from somrs.protocol.knowledge import History, Rows, Updated, UpdateMap


class MapSeen(msgspec.Struct, frozen=True, kw_only=True):
    """A map: all its objects and facts, and the version that it is of."""

    version: int
    objects: tuple[Object, ...]
    facts: tuple[Fact, ...]


class MapDesk:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("GET", "/map")
    async def read(self) -> MapSeen:
        """The whole map as it is now."""
        map = self._context.map
        return MapSeen(version=self._context.version, objects=tuple(map.objects.values()), facts=tuple(map.facts()))

    @operation("POST", "/map/changes")
    async def change(self, body: UpdateMap) -> Updated:
        """Change the map: all or nothing, checked against the types.

        With `expected_version`, only if nothing that it speaks of changed since.
        """
        return Updated(version=await self._context.client.update(body))

    @operation("GET", "/map/query")
    async def query(self, formula: str, limit: int = 100) -> Rows:
        """For which objects does the formula hold?"""
        return await self._context.client.query(formula, limit)

    @operation("GET", "/map/objects/{name}/history")
    async def history(self, name: str, limit: int = 100) -> History:
        """What happened to an object, newest first."""
        return await self._context.client.history(name, limit)
