"""Who answers a Task Manager's questions for a plan: memory, a short match, or the planner's process."""

from __future__ import annotations

from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.plan_cache import PlanCache
from somrs.planner.planning import plan_quickly
from somrs.planner_service.process import PlannerProcess


class Planner:
    """Answers at once what takes a few milliseconds, and leaves what takes a search to a process of its own."""

    def __init__(self, process: PlannerProcess) -> None:
        self._process = process
        self._cache = PlanCache()

    async def plan(self, problem: Problem) -> Plan | NoPlan:
        """Raises what the planner raises."""
        result = plan_quickly(problem) or self._cache.recall(problem)
        if result is None:
            result = await self._process.plan(problem)
            self._cache.store(problem, result)
        return result
