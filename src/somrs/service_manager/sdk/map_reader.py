"""How a device reads the map in the Repository, and reports to it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from msgspec import structs

from somrs.entish.formula import Formula
from somrs.errors import RemoteError
from somrs.ontology.objects import Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Value
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import MapPage, OntologyPage, QueryMap, ReadMap, ReadOntology, Rejected, Rows, Updated, UpdateMap
from somrs.protocol.messages.observations import Reception
from somrs.service_manager.sdk.values import python_value

PAGE = 1000
"""How many solutions are asked for at a time."""
ATTEMPTS = 8
"""How often a query of several pages is begun anew because the map has changed meanwhile."""

Ask = Callable[[Body], Awaitable[Body]]
"""Sends a request to the Repository and returns the answer."""


class MapReader:
    """Reads the map in the Repository, and reports to it.

    With a `situation`, in Entish: reads the map as it would be if this formula held, too.
    """

    def __init__(self, ask: Ask, situation: str | None = None) -> None:
        self._ask, self._situation = ask, situation

    async def object(self, name: str) -> Object | None:
        """Return the object with its explicit values; None when the map has no such object."""
        page = await self._answer(ReadMap(after=predecessor_name(name), situation=self._situation))
        if not isinstance(page, MapPage):
            raise RemoteError(f"the Repository answered ReadMap with {type(page).__name__}")
        return page.objects[0] if page.objects and page.objects[0].name == name else None

    async def query(self, formula: str | Formula, limit: int | None = None) -> list[dict[str, Value]]:
        """Return all solutions of the formula, up to `limit`: a value, or the name of an object, for each variable."""
        rows = await self.rows(formula, limit)
        return [{name: python_value(text) for name, text in row.bindings.items()} for row in rows.rows]

    async def rows(self, formula: str | Formula, limit: int | None = None) -> Rows:
        """Return the solutions, up to `limit`, as Entish, with the version of the map in which they hold.

        Many solutions come in several pages. If the map changes all the time meanwhile, the later ones are of later versions.
        """
        for is_last_attempt in [False] * ATTEMPTS + [True]:
            rows = page = await self._page(formula, 0, limit)
            while page.more and (limit is None or len(rows.rows) < limit):
                page = await self._page(formula, len(rows.rows), limit)
                if page.version != rows.version and not is_last_attempt:
                    break
                rows = structs.replace(rows, rows=(*rows.rows, *page.rows), more=page.more)
            else:
                return rows
        raise AssertionError("the last attempt returns")

    async def _page(self, formula: str | Formula, skip: int, limit: int | None) -> Rows:
        left = PAGE if limit is None else limit - skip
        rows = await self._answer(QueryMap(formula=str(formula), limit=left, situation=self._situation, skip=skip))
        if not isinstance(rows, Rows):
            raise RemoteError(f"the Repository answered QueryMap with {type(rows).__name__}")
        return rows

    async def holds(self, formula: str | Formula) -> bool:
        return bool(await self.query(formula, limit=1))

    async def service_type(self, name: str) -> ServiceType | None:
        """Return the service type of the common ontology; None when it has none of this name."""
        after, more = 0, True
        while more:
            page = await self._answer(ReadOntology(after=after))
            if not isinstance(page, OntologyPage):
                raise RemoteError(f"the Repository answered ReadOntology with {type(page).__name__}")
            for service_type in page.definitions.services:
                if service_type.name == name:
                    return service_type
            after, more = page.next, page.more
        return None

    async def update(self, update: UpdateMap) -> bool:
        """Change the map unless it changed after the `expected_version`. Returns whether the Repository made the whole update.

        An update that overtook another one on its way is not made where the map has newer news, whatever version it expected.
        """
        answer = await self._answer(update)
        return isinstance(answer, Updated) and (answer.reception is None or not answer.reception.superseded)

    async def report(self, update: UpdateMap) -> Reception:
        """Change the map, and return what became of the report. Raises RemoteError when the Repository rejects it."""
        answer = await self._answer(update)
        match answer:
            case Updated(reception=reception):
                return reception if reception is not None else Reception()
            case Rejected(problems=problems):
                raise RemoteError("; ".join(problems))
        raise RemoteError(f"the Repository answered UpdateMap with {type(answer).__name__}")

    async def _answer(self, body: Body) -> Body:
        answer = await self._ask(body)
        if isinstance(answer, Fault):
            raise RemoteError(answer.text)
        return answer


def predecessor_name(name: str) -> str:
    """Return a text just before the name in the order of names: the page after it begins with the name."""
    return f"{name[:-1]}{chr(ord(name[-1]) - 1)}\ufffd"
