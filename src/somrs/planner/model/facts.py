"""A growing set of facts: those that hold now, which are looked up on the map on demand, and those that are reachable."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.planner.model.vocabulary import Argument, Fact
from somrs.planner.model.world import World


class Facts:
    """Facts, indexed by predicate and by each argument."""

    def __init__(self, world: World) -> None:
        self.new: dict[Fact, None] = {}
        """The reachable facts that do not hold now."""
        self._world = world
        self._by_predicate: dict[str, list[tuple[Argument, ...]]] = {}
        self._by_argument: dict[tuple[str, int, Argument], list[tuple[Argument, ...]]] = {}

    def __contains__(self, fact: Fact) -> bool:
        return fact in self.new or self._world.fact_holds(fact)

    def add(self, fact: Fact) -> bool:
        """Add the fact. Returns whether it is new."""
        if fact in self:
            return False
        self.new[fact] = None
        predicate, arguments = fact
        self._by_predicate.setdefault(predicate, []).append(arguments)
        for place, argument in enumerate(arguments):
            self._by_argument.setdefault((predicate, place, argument), []).append(arguments)
        return True

    def count(self, predicate: str, known_arguments: Sequence[Argument | None]) -> int:
        """An estimate of the number of facts that `find_facts` returns."""
        return self._world.count(predicate, known_arguments) + len(self._find_added_facts(predicate, known_arguments))

    def find_facts(self, predicate: str, known_arguments: Sequence[Argument | None]) -> list[tuple[Argument, ...]]:
        """The arguments of facts that may have the known arguments (None: unknown). Only one of the known arguments is compared; the caller
        compares the rest."""
        added_facts = self._find_added_facts(predicate, known_arguments)
        current_facts = self._world.find_facts(predicate, known_arguments)
        return [*current_facts, *added_facts] if added_facts else current_facts

    def _find_added_facts(self, predicate: str, known_arguments: Sequence[Argument | None]) -> list[tuple[Argument, ...]]:
        lists = [self._by_argument.get((predicate, place, value), []) for place, value in enumerate(known_arguments) if value is not None]
        return min(lists, key=len) if lists else self._by_predicate.get(predicate, [])
