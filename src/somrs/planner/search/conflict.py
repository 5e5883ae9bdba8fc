"""The smallest part of a goal that cannot come about, though each thing in it can."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.entish import Name, Relation
from somrs.entish.formula import Literal, conjunction
from somrs.planner.grounding.grounding import Grounding, TooLarge
from somrs.planner.grounding.relevance import demands
from somrs.planner.grounding.task import Task
from somrs.planner.model.operators import Inexpressible, goal_operators
from somrs.planner.model.world import World
from somrs.planner.search.search import TooHard, search

EFFORT = 200_000
"""Moves and effects looked at for one part of the goal: about a tenth of a second."""
FACTS = 100_000
"""The same for facts."""
PARTS = 60
"""So many parts of the goal are tried; then what is left is not made smaller any more."""


def is_impossible(parts: Sequence[Literal], world: World) -> bool:
    """Whether it is certain that these cannot come about together."""
    try:
        goals = list(goal_operators(conjunction(*parts), world.vocabulary))
        grounding = Grounding(world, demands(goals, world), effort=FACTS)
        if grounding.guessed:
            return False
        return not grounding.is_goal_reachable or search(Task(grounding), EFFORT) is None
    except (Inexpressible, TooLarge, TooHard):
        return False


def find_minimal_conflict(parts: Sequence[Literal], world: World) -> tuple[Literal, ...]:
    """Of parts that are impossible together, as few as still are, by leaving out halves, quarters, and so on (Zeller and
    Hildebrandt 2002)."""
    kept_parts = list(parts)
    chunk, attempts = max(len(kept_parts) // 2, 1), 0
    while True:
        place = 0
        while place < len(kept_parts) and attempts < PARTS:
            rest = [*kept_parts[:place], *kept_parts[place + chunk :]]
            attempts += 1
            if rest and is_impossible(rest, world):
                kept_parts = rest
            else:
                place += chunk
        if chunk == 1:
            return tuple(kept_parts)
        chunk //= 2


def find_torn_object(parts: Sequence[Literal], world: World) -> str | None:
    """The object that would have to be in two places at a time."""
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
