"""A planning problem on its way to another process: what that process has of the map already is not sent again."""

from __future__ import annotations

from msgspec import Struct, structs

from somrs.ontology.objects import Change, Map, differences
from somrs.ontology.types import Ontology
from somrs.planner.model.problem import Problem

NOTHING = Map()
"""In place of the map, while a problem is on its way."""


class Shipment(Struct, frozen=True, kw_only=True):
    """A problem without what it was about last; `changes` lead from the last map to its own."""

    problem: Problem
    same_ontology: bool
    changes: tuple[Change, ...]
    map: Map | None
    """The whole map, when it is the first, or the changes are many."""


MANY = 1_000
"""More changes than this take longer to send than they save."""


class Sender:
    """What the other process has."""

    def __init__(self) -> None:
        self._ontology: Ontology | None = None
        self._map: Map | None = None

    def packed(self, problem: Problem) -> Shipment:
        same = self._ontology is problem.ontology
        changes = tuple(differences(self._map, problem.map)) if self._map is not None else ()
        whole = self._map is None or len(changes) > MANY
        self._ontology, self._map = problem.ontology, problem.map
        return Shipment(
            problem=structs.replace(problem, map=NOTHING, ontology=Ontology() if same else problem.ontology),
            same_ontology=same,
            changes=() if whole else changes,
            map=problem.map if whole else None,
        )


class Recipient:
    """The same, in the other process."""

    def __init__(self) -> None:
        self._ontology = Ontology()
        self._map = Map()

    def unpacked(self, shipment: Shipment) -> Problem:
        if not shipment.same_ontology:
            self._ontology = shipment.problem.ontology
        if shipment.map is not None:
            self._map = shipment.map
        elif shipment.changes:
            self._map = self._map.changed(shipment.changes)
        return structs.replace(shipment.problem, ontology=self._ontology, map=self._map)
