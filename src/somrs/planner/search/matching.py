"""A quick match for everyday tasks: one service, or a chain of two, for each part of the goal."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.planner.grounding.grounding import Grounding
from somrs.planner.grounding.joins import TooLarge
from somrs.planner.grounding.relevance import demands
from somrs.planner.grounding.task import Move, Task
from somrs.planner.model.operators import Operator
from somrs.planner.model.plan import Plan
from somrs.planner.model.problem import Problem
from somrs.planner.model.world import World
from somrs.planner.search.search import TooHard, cheapest, remove_redundant_moves
from somrs.planner.search.steps import build_plan

CHAINS = (1, 2)
"""The lengths of the chains to try. Each service of a chain achieves a precondition of the next; each goal part has its own chain."""
FACTS = 4_000
"""The maximum of effort for a grounding: about ten milliseconds."""
EFFORT = 10_000
"""The maximum number of moves and effects that the search examines."""


def match(problem: Problem, world: World, goals: Sequence[Operator]) -> Plan | None:
    """A plan of short chains: the shortest, or the cheapest if the known costs of services differ. None if none is found within the limits;
    there may still be a plan."""
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
