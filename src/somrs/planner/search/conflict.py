"""Minimal conflicts: the smallest sets of goal parts that are unreachable together, though each part is reachable by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from somrs.entish import Name, Relation
from somrs.entish.formula import Literal, conjunction
from somrs.planner.grounding.grounding import Grounding
from somrs.planner.grounding.joins import TooLarge
from somrs.planner.grounding.relevance import demands
from somrs.planner.grounding.task import Task
from somrs.planner.model.operators import goal_operators
from somrs.planner.model.vocabulary import Inexpressible
from somrs.planner.model.world import World
from somrs.planner.search.search import TooHard, search

EFFORT = 200_000
"""The maximum number of moves and effects to examine for one set of goal parts: about a tenth of a second."""
FACTS = 250_000
"""The maximum of effort for the grounding of one set of goal parts."""
TRIES = 60
"""The maximum number of sets of goal parts to try for one explanation; then it is no longer made more precise."""


@dataclass(slots=True)
class Tries:
    """The number of sets of goal parts that may still be tried."""

    left: int = TRIES


def is_impossible(parts: Sequence[Literal], world: World, tries: Tries) -> bool:
    """Whether the parts are certainly unreachable together; False if undecided."""
    if tries.left == 0:
        return False
    tries.left -= 1
    try:
        goals = list(goal_operators(conjunction(*parts), world.vocabulary))
        grounding = Grounding(world, demands(goals, world), effort=FACTS)
        if grounding.joins.guessed:
            return False
        return not grounding.is_goal_reachable or search(Task(grounding), EFFORT) is None
    except (Inexpressible, TooLarge, TooHard):
        return False


def find_minimal_conflict(parts: Sequence[Literal], world: World, tries: Tries) -> tuple[Literal, ...]:
    """A minimal subset of the parts that is still impossible, by delta debugging: leave out halves, quarters, and so on (Zeller and
    Hildebrandt 2002)."""
    kept_parts = list(parts)
    chunk = max(len(kept_parts) // 2, 1)
    while True:
        place = 0
        while place < len(kept_parts) and tries.left:
            rest = [*kept_parts[:place], *kept_parts[place + chunk :]]
            if rest and is_impossible(rest, world, tries):
                kept_parts = rest
            else:
                place += chunk
        if chunk == 1:
            return tuple(kept_parts)
        chunk //= 2


def find_torn_object(parts: Sequence[Literal], world: World) -> str | None:
    """The object that would have to be in two places at a time, if there is one."""
    seen_places: set[tuple[str, str]] = set()
    for part in parts:
        if isinstance(part, Relation) and part.relation in world.vocabulary.relations and world.vocabulary.is_exclusive(part.relation):
            thing = part.arguments[0]
            if isinstance(thing, Name):
                place = world.vocabulary.place(part.relation), thing.name
                if place in seen_places:
                    return thing.name
                seen_places.add(place)
    return None
