"""The ontology: read and changed."""

from __future__ import annotations

import msgspec

from somrs.app.desk.context import Context
from somrs.app.desk.operations import operation
from somrs.protocol.knowledge import Definitions, by_kind


class OntologySeen(msgspec.Struct, frozen=True, kw_only=True):
    """All definitions, and the version that they are of."""

    version: int
    definitions: Definitions


class OntologyDesk:
    def __init__(self, context: Context) -> None:
        self._context = context

    @operation("GET", "/ontology")
    async def read(self) -> OntologySeen:
        """The whole ontology as it is now."""
        return OntologySeen(version=self._context.version, definitions=by_kind(self._context.ontology))
