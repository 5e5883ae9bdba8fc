"""Lazy greedy best-first search with preferred operators (Richter and Helmert 2009), guided by the additive heuristic (Bonet and Geffner
2001). It solves most everyday tasks within half a second."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from heapq import heapify, heappop, heappush

from somrs.planner.grounding.finite_task import Assignment, State
from somrs.planner.grounding.task import Move, Task
from somrs.planner.search.progress import Progress, measure_progress

EFFORT = 1_500_000
"""The number of moves and effects that the search examines before it gives up: about half a second."""

BRIEF = 10
"""The part of the effort that a second search for a plan of fewer steps takes: a twentieth of a second."""

REDUNDANCY_EFFORT = 300_000_000
"""The number of values in the states that are computed to find redundant moves: some seconds."""


class TooHard(Exception):
    """The search gave up at its limit of effort. There may or may not be a plan."""

    def __init__(self, progress: Progress) -> None:
        super().__init__(str(progress))
        self.progress = progress


def cheapest(task: Task, effort: int = EFFORT, longest: int | None = None) -> list[Move] | None:
    """A plan, or a cheaper one if a second search finds one; None if there is no plan. If all moves cost the same, the second search is for
    fewer steps, and brief; there is none for a plan of `longest` steps or more, for which better ways are known. Raises TooHard."""
    moves = _single_move(task) or search(task, effort)
    costs_vary = len({move.cost for move in task.moves if move.length}) > 1
    if moves is None or task.hurry or (not costs_vary and not 2 <= len(moves) < (longest or len(moves) + 1)):
        return moves
    plans = [remove_redundant_moves(moves, task)]
    with contextlib.suppress(TooHard):
        plans.append(remove_redundant_moves(search(task, effort if costs_vary else effort // BRIEF, cheap=True) or moves, task))
    return min(plans, key=lambda plan: sum(move.cost for move in plan))


def _single_move(task: Task) -> list[Move]:
    """The cheapest move that reaches the goal by itself; empty if there is none, or the goal is reached. A search may overlook it."""
    goal_moves: dict[Assignment, list[Move]] = {}
    for move in task.moves:
        if move.action.operator.reaches_goal:
            if move.is_applicable(task.initial):
                return []
            for assignment in move.preconditions:
                goal_moves.setdefault(assignment, []).append(move)

    def is_enough(move: Move) -> bool:
        candidates = [goal_move for _, variable, value in move.effects for goal_move in goal_moves.get((variable, value), ())]
        if not candidates or not move.is_applicable(task.initial):
            return False
        state = task.apply(move, task.initial)
        return any(goal_move.is_applicable(state) for goal_move in candidates)

    return sorted(filter(is_enough, task.moves), key=lambda move: move.cost)[:1]


def search(task: Task, effort: int = EFFORT, *, cheap: bool = False) -> list[Move] | None:
    """The moves of a plan, or None if there is no plan. With `cheap`, the cost of the moves to a state is added to its heuristic value, as
    in A*, for a cheaper plan after a longer search. Raises TooHard."""
    assert task.goal is not None, "a goal that nothing reaches is not searched for"
    heuristic = AdditiveHeuristic(task, cheap=cheap)
    parents: dict[State, tuple[State, Move] | None] = {task.initial: None}
    spent = {task.initial: 0.0}
    open_: list[tuple[float, bool, int, State]] = [(0.0, True, 0, task.initial)]
    count = 0
    while open_:
        *_, state = heappop(open_)
        if state[task.goal[0]] == task.goal[1]:
            return _path(parents, state)
        distance, helpful = heuristic.evaluate(state)
        if distance is None:
            continue
        for move in task.moves:
            if not move.is_applicable(state):
                continue
            successor = task.apply(move, state)
            costs = spent[state] + move.cost if cheap else 0.0
            if successor in parents and costs >= spent[successor]:
                continue
            parents[successor], spent[successor] = (state, move), costs
            if successor[task.goal[0]] == task.goal[1] and not cheap:
                return _path(parents, successor)
            count += 1
            heappush(open_, (costs + distance, move not in helpful, count, successor))
        effort -= len(task.moves)
        if effort - heuristic.visit_count < 0:
            raise TooHard(measure_progress(task, parents))
    return None


def _path(parents: dict[State, tuple[State, Move] | None], state: State) -> list[Move]:
    moves: list[Move] = []
    while (step := parents[state]) is not None:
        state, move = step
        if not move.action.operator.reaches_goal:
            moves.append(move)
    return moves[::-1]


def remove_redundant_moves(moves: Sequence[Move], task: Task) -> list[Move]:
    """The plan without redundant moves, and without moves that only redundant moves make applicable (Nakhost and Müller 2010).

    The effort is quadratic, so a plan beyond `REDUNDANCY_EFFORT` stays as it is."""
    if len(moves) ** 2 * len(task.initial) > REDUNDANCY_EFFORT:
        return list(moves)
    kept_moves = list(moves)
    place = 0
    while place < len(kept_moves):
        rest: list[Move] = []
        state = task.initial
        for move in (*kept_moves[:place], *kept_moves[place + 1 :]):
            if move.is_applicable(state):
                state = task.apply(move, state)
                rest.append(move)
        if _reaches(state, task):
            kept_moves = rest
        else:
            place += 1
    return kept_moves


def _reaches(state: State, task: Task) -> bool:
    return any(move.action.operator.reaches_goal and move.is_applicable(state) for move in task.moves)


class AdditiveHeuristic:
    """The additive heuristic: the cost of a fact is the cost of its best achieving move plus the sum of the costs of that move's
    preconditions. A move costs 1, or, with `cheap`, its estimated cost."""

    def __init__(self, task: Task, *, cheap: bool = False) -> None:
        self.task, self.cheap = task, cheap
        self.visit_count = 0
        # Effects of a move with the same conditions form one unit, with its own preconditions.
        self.moves: list[Move] = []
        self.preconditions: list[tuple[Assignment, ...]] = []
        self.effects: list[list[Assignment]] = []
        self._dependents: dict[Assignment, list[int]] = {}
        for move in task.moves:
            units: dict[tuple[Assignment, ...], list[Assignment]] = {}
            for conditions, variable, value in move.effects:
                units.setdefault(conditions, []).append((variable, value))
            for conditions, unit_effects in units.items():
                unit_preconditions = tuple(dict.fromkeys((*move.preconditions, *conditions)))
                for precondition in unit_preconditions:
                    self._dependents.setdefault(precondition, []).append(len(self.moves))
                self.moves.append(move)
                self.preconditions.append(unit_preconditions)
                self.effects.append(unit_effects)

    def evaluate(self, state: State) -> tuple[float | None, set[Move]]:
        """The estimated distance to the goal, and the helpful moves: the applicable moves of the relaxed plan. The distance is None if the
        goal is unreachable even in the delete relaxation."""
        unmet_counts = [len(unit_preconditions) for unit_preconditions in self.preconditions]
        total = [move.cost if self.cheap else float(move.length) for move in self.moves]
        supporter: dict[Assignment, int] = {}
        queue: list[tuple[float, Assignment, int]] = [(0.0, assignment, -1) for assignment in enumerate(state)]
        queue += [
            (total[n], effect, n)
            for n, unit_preconditions in enumerate(self.preconditions)
            if not unit_preconditions
            for effect in self.effects[n]
        ]
        heapify(queue)
        while queue:
            price, assignment, index = heappop(queue)
            if assignment in supporter:
                continue
            supporter[assignment] = index
            if assignment == self.task.goal:
                return price, self._helpful(supporter, state)
            for index in self._dependents.get(assignment, ()):
                self.visit_count += 1
                unmet_counts[index] -= 1
                total[index] += price
                if unmet_counts[index] == 0:
                    for effect in self.effects[index]:
                        if effect not in supporter:
                            heappush(queue, (total[index], effect, index))
        return None, set()

    def _helpful(self, supporter: dict[Assignment, int], state: State) -> set[Move]:
        assert self.task.goal is not None, "it was just reached"
        helpful_moves: set[Move] = set()
        waiting, seen_assignments = [self.task.goal], {self.task.goal}
        while waiting:
            index = supporter[waiting.pop()]
            if index < 0:
                continue
            if self.moves[index].is_applicable(state):
                helpful_moves.add(self.moves[index])
            new = [precondition for precondition in self.preconditions[index] if precondition not in seen_assignments]
            seen_assignments.update(new)
            waiting.extend(new)
        return helpful_moves
