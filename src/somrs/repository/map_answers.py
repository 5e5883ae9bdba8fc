"""Answers questions about a map, as it is or as it would be in a promised situation."""

from __future__ import annotations

from itertools import islice

from somrs.ontology.check import check
from somrs.ontology.map import Map
from somrs.ontology.truth import bindings
from somrs.ontology.types import Ontology
from somrs.ontology.work_budget import ExcessiveWork, WorkBudget
from somrs.protocol.messages.knowledge import MapPage, QueryMap, ReadMap, Row, Rows
from somrs.protocol.messages.paging import fit_page
from somrs.repository.pages import map_page
from somrs.repository.promised_maps import PromisedMaps
from somrs.repository.state import LargeQuery

MOST_ROWS = 1000
"""The maximum number of rows in the answer to a QueryMap."""
SMALL_WORK = 20_000
"""The work of a query, in steps, for which other requests wait."""
LARGE_WORK = 2_000_000
"""The work that a query may take at all."""
KEPT = 256
"""The number of answers to keep. All who are asked for a quote ask much the same at the same time, such as where a thing is."""


class MapAnswers:
    """Answers questions, and keeps for the next ones what is the same in several."""

    def __init__(self) -> None:
        self._promised = PromisedMaps()
        self._basis: tuple[Map, Ontology, int] | None = None
        """What the answers are about that are kept."""
        self._rows: dict[QueryMap, Rows] = {}

    def answer(self, question: QueryMap | ReadMap, map: Map, ontology: Ontology, version: int) -> Rows | MapPage | LargeQuery:
        """The answer to a question about a map of this version, or the task to find it. Raises FormulaError."""
        if isinstance(question, ReadMap):
            return map_page(self._promised.map_in(question.situation, map, ontology), version, question.after)
        if self._basis is None or self._basis[0] is not map or self._basis[1] is not ontology or self._basis[2] != version:
            self._basis, self._rows = (map, ontology, version), {}
        if question not in self._rows:
            promised_map = self._promised.map_in(question.situation, map, ontology)
            try:
                rows = _rows(question, promised_map, ontology, version, SMALL_WORK)
            except ExcessiveWork:
                return LargeQuery(query=question, version=version, map=promised_map, ontology=ontology)
            if len(self._rows) >= KEPT:
                del self._rows[next(iter(self._rows))]
            self._rows[question] = rows
        return self._rows[question]


def answer_large(task: LargeQuery) -> Rows:
    """The answer to a query that takes long. Raises FormulaError."""
    return _rows(task.query, task.map, task.ontology, task.version, LARGE_WORK)


def _rows(query: QueryMap, map: Map, ontology: Ontology, version: int, most_work: int) -> Rows:
    formula = check(query.formula, ontology, map)
    skip, limit = max(query.skip, 0), min(max(query.limit, 0), MOST_ROWS)
    matching_rows = [
        Row(bindings={name: str(term) for name, term in row.items()})
        for row in islice(bindings(formula, map, ontology, budget=WorkBudget(most_work)), skip, skip + limit + 1)
    ]
    rows = tuple(fit_page(matching_rows, limit))
    return Rows(rows=rows, version=version, more=len(rows) < len(matching_rows))
