"""The planner for a Task Manager: a quick match, the cache of results, or the planner's process."""

from __future__ import annotations

from somrs.planner.alternatives import may_have_alternatives
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.plan_cache import PlanCache
from somrs.planner.planning import plan_quickly
from somrs.planner_service.process import PlannerProcess


class Planner:
    """Plans in this process what takes a few milliseconds, and in a separate process what needs a search."""

    def __init__(self, process: PlannerProcess) -> None:
        self._process = process
        self._cache = PlanCache()

    async def plan(self, problem: Problem) -> Plan | NoPlan:
        """A plan, or why there is none. Raises RemoteError when the planner's process fails."""
        result = plan_quickly(problem)
        if isinstance(result, Plan) and may_have_alternatives(problem, result):
            result = None
        result = result or self._cache.recall(problem)
        if result is None:
            result = await self._process.plan(problem)
            self._cache.store(problem, result)
        return result
