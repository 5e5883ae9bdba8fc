"""Planning problems as sent to another process: only the changes of the map since the previous problem are sent."""

from __future__ import annotations

from msgspec import Struct, structs

from somrs.ontology.differences import differences
from somrs.ontology.map import Map
from somrs.ontology.objects import Change
from somrs.ontology.types import Ontology
from somrs.planner.model.problem import Problem

EMPTY_MAP = Map()
"""Stands in for the map in a problem that is sent."""


class ProblemDelta(Struct, frozen=True, kw_only=True):
    """A problem without its map and, if it is unchanged, without its ontology; `changes` lead from the previous map to its own."""

    problem: Problem
    same_ontology: bool
    changes: tuple[Change, ...]
    map: Map | None
    """The whole map, for the first problem and when there are many changes; else None."""


MAX_CHANGES = 1_000
"""The maximum number of changes to send; beyond it, the whole map is sent."""


class Sender:
    """Packs problems; keeps the ontology and map that the other process has."""

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
    """Unpacks problems in the other process; keeps the latest ontology and map."""

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
