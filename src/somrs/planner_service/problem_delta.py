"""A planning problem on its way to another process: what that process has of the map already is not sent again."""

from __future__ import annotations

from msgspec import Struct, structs

from somrs.ontology.objects import Change, Map, differences
from somrs.ontology.types import Ontology
from somrs.planner.model.problem import Problem

EMPTY_MAP = Map()
"""In place of the map, while a problem is on its way."""


class ProblemDelta(Struct, frozen=True, kw_only=True):
    """A problem without what it was about last; `changes` lead from the last map to its own."""

    problem: Problem
    same_ontology: bool
    changes: tuple[Change, ...]
    map: Map | None
    """The whole map, when it is the first, or the changes are many."""


MAX_CHANGES = 1_000
"""More changes than this take longer to send than they save."""


class Sender:
    """What the other process has."""

    def __init__(self) -> None:
        self._ontology: Ontology | None = None
        self._map: Map | None = None

    def pack(self, problem: Problem) -> ProblemDelta:
        is_same_ontology = self._ontology is problem.ontology
        changes = tuple(differences(self._map, problem.map)) if self._map is not None else ()
        whole = self._map is None or len(changes) > MAX_CHANGES
        self._ontology, self._map = problem.ontology, problem.map
        return ProblemDelta(
            problem=structs.replace(problem, map=EMPTY_MAP, ontology=Ontology() if is_same_ontology else problem.ontology),
            same_ontology=is_same_ontology,
            changes=() if whole else changes,
            map=problem.map if whole else None,
        )


class Recipient:
    """The same, in the other process."""

    def __init__(self) -> None:
        self._ontology = Ontology()
        self._map = Map()

    def unpack(self, delta: ProblemDelta) -> Problem:
        if not delta.same_ontology:
            self._ontology = delta.problem.ontology
        if delta.map is not None:
            self._map = delta.map
        elif delta.changes:
            self._map = self._map.changed(delta.changes)
        return structs.replace(delta.problem, ontology=self._ontology, map=self._map)
