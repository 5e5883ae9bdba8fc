"""The tasks that come all day: what one service brings about, or one after another that makes it possible, found at once."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.planner.grounding.grounding import Grounding, TooLarge
from somrs.planner.grounding.relevance import demands
from somrs.planner.grounding.task import Move, Task
from somrs.planner.model.operators import Operator
from somrs.planner.model.plan import Plan
from somrs.planner.model.problem import Problem
from somrs.planner.model.world import World
from somrs.planner.search.search import TooHard, cheapest, remove_redundant_moves
from somrs.planner.search.steps import build_plan

CHAINS = (1, 2)
"""So many services one after the other, each for what the next needs; the goal's parts have such chains each."""
FACTS = 2_000
"""Facts looked at before the match is given up: a few milliseconds."""
EFFORT = 10_000
"""The same for moves and effects."""


def match(problem: Problem, world: World, goals: Sequence[Operator]) -> Plan | None:
    """A plan of short chains, if there is one among few possibilities: the shortest, or the cheapest, if it is known that services cost
    more or less. None says nothing."""
    plans: list[list[Move]] = []
    for depth in CHAINS:
        try:
            grounding = Grounding(world, demands(goals, world, narrow=True, depth=depth), narrow=True, effort=FACTS)
            if grounding.is_goal_reachable:
                task = Task(grounding)
                moves = cheapest(task, EFFORT)
                if moves is not None:
                    plans.append(remove_redundant_moves(moves, task))
        except (TooLarge, TooHard):
            break
        if plans and not (world.has_varying_costs and not problem.hurry):
            break
    return build_plan(problem, min(plans, key=lambda moves: sum(move.cost for move in moves))) if plans else None
