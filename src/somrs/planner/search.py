"""The small tasks of the day, solved at once: greedy best-first search with the additive heuristic (Bonet and Geffner 2001)."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heappop, heappush

from somrs.planner.task import Assignment, Move, State, Task

EFFORT = 400_000
"""Effects looked at before an engine is asked instead: about half a second."""


class TooHard(Exception):
    """Not found with the effort allowed; which does not say that there is no plan."""


def search(task: Task, effort: int = EFFORT) -> list[Move] | None:
    """The moves that reach the goal, or None if nothing does. Raises TooHard."""
    assert task.goal is not None, "a goal that nothing reaches is not searched for"
    if task.initial[task.goal[0]] == task.goal[1]:
        return []
    estimate = _Estimate(task)
    came: dict[State, tuple[State, Move] | None] = {task.initial: None}
    open_: list[tuple[float, int, State]] = [(0.0, 0, task.initial)]
    while open_:
        _, _, state = heappop(open_)
        for move in task.moves:
            if not move.applicable(state):
                continue
            after = move.apply(state)
            if after in came:
                continue
            came[after] = state, move
            if after[task.goal[0]] == task.goal[1]:
                return _path(came, after)
            value = estimate.of(after)
            if value is not None:
                heappush(open_, (value, len(came), after))
        effort -= len(task.moves)
        if effort - estimate.looked_at < 0:
            raise TooHard
    return None


def _path(came: dict[State, tuple[State, Move] | None], state: State) -> list[Move]:
    moves: list[Move] = []
    while (step := came[state]) is not None:
        state, move = step
        if move.action.operator.service is not None:
            moves.append(move)
    return moves[::-1]


def without_useless(moves: Sequence[Move], task: Task) -> list[Move]:
    """The plan without moves that it can do without, with those that only they make possible (Nakhost and Müller 2010)."""
    kept = list(moves)
    place = 0
    while place < len(kept):
        rest: list[Move] = []
        state = task.initial
        for other in (*kept[:place], *kept[place + 1 :]):
            if other.applicable(state):
                state = other.apply(state)
                rest.append(other)
        if _reaches(state, task):
            kept = rest
        else:
            place += 1
    return kept


def _reaches(state: State, task: Task) -> bool:
    return any(move.action.operator.service is None and move.applicable(state) for move in task.moves)


class _Estimate:
    """How far a state is from the goal: each fact costs what the cheapest action to it costs, and what that needs, added up."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.looked_at = 0
        self.effects: list[tuple[tuple[Assignment, ...], Assignment, int]] = []
        self.needing: dict[Assignment, list[int]] = {}
        self.free: list[int] = []
        for move in task.moves:
            for conditions, variable, value in move.effects:
                needs = tuple(dict.fromkeys((*move.needs, *conditions)))
                for need in needs:
                    self.needing.setdefault(need, []).append(len(self.effects))
                if not needs:
                    self.free.append(len(self.effects))
                self.effects.append((needs, (variable, value), move.cost))

    def of(self, state: State) -> float | None:
        """None when the goal cannot be reached from there, even if nothing were ever undone."""
        left = [len(needs) for needs, _, _ in self.effects]
        cost: dict[Assignment, float] = {}
        total = [float(c) for _, _, c in self.effects]
        queue: list[tuple[float, Assignment]] = [(0.0, assignment) for assignment in enumerate(state)]
        queue += [(total[index], self.effects[index][1]) for index in self.free]
        while queue:
            price, assignment = heappop(queue)
            if assignment in cost:
                continue
            cost[assignment] = price
            if assignment == self.task.goal:
                return price
            for index in self.needing.get(assignment, ()):
                self.looked_at += 1
                left[index] -= 1
                total[index] += price
                if left[index] == 0:
                    heappush(queue, (total[index], self.effects[index][1]))
        return None
