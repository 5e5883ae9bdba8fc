"""From a problem to an abstract plan: a quick match, then relevance, grounding and search; and if there is no plan, the explanation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from msgspec import structs

from somrs.entish import Formula
from somrs.entish.formula import alternatives, conjunction, conjuncts, count_alternatives, names
from somrs.errors import RemoteError, SomrsError
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import PROBLEM
from somrs.ontology.values import value_of
from somrs.planner.alternatives import with_alternatives
from somrs.planner.conditions import ConditionalUses
from somrs.planner.encodings.sas import decode_moves, encode_sas
from somrs.planner.exclusions import exclusion_obstacles, exclusion_text
from somrs.planner.explanation import explain_failure
from somrs.planner.grounding.grounding import EFFORT, Grounding
from somrs.planner.grounding.joins import TooLarge
from somrs.planner.grounding.merging import merge_task
from somrs.planner.grounding.relevance import Demand, demands
from somrs.planner.grounding.task import Move, Task
from somrs.planner.model.choices import ALTERNATIVES
from somrs.planner.model.expansion import expand_quantifiers
from somrs.planner.model.operators import Operator, goal_operators
from somrs.planner.model.plan import NoPlan, Obstacle, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.model.provider_choice import generalize_providers
from somrs.planner.model.quality import best
from somrs.planner.model.vocabulary import Inexpressible
from somrs.planner.model.world import World
from somrs.planner.optimism import optimistic
from somrs.planner.recognition import plan_recognition
from somrs.planner.repair import prefer_repaired, prefer_shorter
from somrs.planner.search import counting
from somrs.planner.search.counting import Counters, CountingFailed, search_with_counters
from somrs.planner.search.lookahead import Lookahead
from somrs.planner.search.matching import match
from somrs.planner.search.numeric import NumericTask
from somrs.planner.search.search import BRIEF, TooHard, cheapest, remove_redundant_moves
from somrs.planner.search.search import EFFORT as SEARCH_EFFORT
from somrs.planner.search.steps import build_plan

Engine = Callable[[str, float], list[str] | None]
"""A function of a task in Fast Downward's format and a time limit in seconds. Returns the names of the operators of a plan, or None
when there is no plan. Raises SomrsError when it finds neither."""

FLEET = 8
"""The number of interchangeable devices up to which the search considers each of them."""
QUICK_EFFORT = 1_250_000
"""The effort, when a task is grounded, before a lookahead is tried: some seconds."""
SIMILAR, LIKELY_SHARE = 1.2, 0.5
"""If there are more relevant actions than this many times the likely ones, or the likely ones differ only by fewer objects, the engines
search the likely ones first, for at most this share of their time."""
VALUES = 5_000
"""The maximum number of actions when effects calculate values and each value is a fact; beyond it, numbers become counters."""
STATES = 5_000
"""The number of states (of facts and numbers) that the search visits before it calls a numeric engine: one to two seconds."""
ALL_STATES = 50_000
"""The number of states that the search visits when there is no numeric engine: at most half a minute."""
NumericEngine = Callable[[str, str, float], list[str] | None]
"""Like `Engine`, for a domain and a problem in numeric PDDL. Returns the names of the actions."""

Improver = Callable[[str, bool], list[list[str]]]
"""A function of a task in Fast Downward's format and whether a short makespan matters more than cost. Returns further plans, if it finds
any in time."""

LONG = 10
"""The number of steps from which the planner looks for a better plan than the first."""

LIMIT = 30.0
"""The time limit of an engine, in seconds."""


@dataclass(frozen=True, slots=True)
class _Engines:
    """The effort of the planner's own search, the engines to call when it gives up, and the time limit of each in seconds."""

    search: Engine | None
    numeric: NumericEngine | None
    improver: Improver | None
    limit: float
    effort: int = SEARCH_EFFORT
    is_overdue: Callable[[], bool] = lambda: False
    """Whether the time for planning is over."""


def plan_quickly(problem: Problem) -> Plan | NoPlan | None:
    """The result that can be found within a few milliseconds; None when the problem needs a search, or an optimistic reading."""
    if problem.recognises:
        return plan_recognition(problem)
    uses = ConditionalUses(problem)
    if uses.ask_to_know:
        return None
    try:
        expanded = expand_quantifiers(uses.problem)
    except Inexpressible as inexpressible:
        return _report_inexpressible(inexpressible)
    result = _plan_quickly(expanded)
    return None if result is None or (isinstance(result, NoPlan) and _may_be_told(expanded)) else _doubted(problem, uses.translate(result))


def _may_be_told(problem: Problem) -> bool:
    """Whether what a plan lacks may be a matter of knowledge."""
    return _unmet_precondition(problem) is None and next(optimistic(problem), None) is not None


def _plan_quickly(problem: Problem) -> Plan | NoPlan | None:
    try:
        result = _check_map(problem)
        if result is not None:
            return result
        short = match(problem, *_compile_problem(problem))
        if short is not None and len(short.steps) >= LONG:
            short = None  # a search may find a better plan
        return generalize_providers(problem, prefer_repaired(problem, short))
    except Inexpressible as inexpressible:
        return _report_inexpressible(inexpressible)


def plan(
    problem: Problem,
    engine: Engine | None = None,
    limit: float = LIMIT,
    numeric: NumericEngine | None = None,
    improver: Improver | None = None,
    is_overdue: Callable[[], bool] = lambda: False,
) -> Plan | NoPlan:
    """A plan that makes the goal true on the map, or why there is none. Prefers the rest of the previous plan if it is as short.

    A plan that assumes what services have to tell first (`model/reading.py`) is the last resort, unless services state conditions about
    what is not known: then the better plan of both is taken.
    """
    if problem.recognises:
        return plan_recognition(problem)
    uses = ConditionalUses(problem)
    try:
        expanded = expand_quantifiers(uses.problem)
    except Inexpressible as inexpressible:
        return _report_inexpressible(inexpressible)
    engines = _Engines(engine, numeric, improver, limit, is_overdue=is_overdue)
    return _doubted(problem, uses.translate(_plan_or_assume(expanded, engines, ask_to_know=uses.ask_to_know)))


def _doubted(problem: Problem, result: Plan | NoPlan) -> Plan | NoPlan:
    """The result. If the goal holds already, it says which of the devices in it have problems."""
    if isinstance(result, NoPlan) or result.steps:
        return result
    problems = {name: value_of(name, PROBLEM, problem.map, problem.ontology) for name in sorted({*names(problem.goal)})}
    return structs.replace(result, doubts=tuple(f"{name} {text}" for name, text in problems.items() if isinstance(text, str) and text))


def _plan_or_assume(problem: Problem, engines: _Engines, *, ask_to_know: bool) -> Plan | NoPlan:
    result = _plan_quickly(problem)
    if result is None:
        result = generalize_providers(problem, prefer_shorter(problem, _plan(problem, engines)))
    if isinstance(result, NoPlan) or (ask_to_know and result.steps):
        for reading in optimistic(problem) if _unmet_precondition(problem) is None else ():
            if isinstance(optimistic_plan := _plan(reading, engines), Plan):
                assumed = generalize_providers(reading, optimistic_plan)
                if isinstance(result, NoPlan) or best(reading, [result, assumed]) is assumed:
                    return assumed
                break
    return result if isinstance(result, NoPlan) else with_alternatives(problem, result, partial(_plan_briefly, engines.is_overdue))


def _plan_briefly(is_overdue: Callable[[], bool], problem: Problem) -> Plan | NoPlan:
    """A plan that a brief search finds: others than the first one are not to take longer than it."""
    if is_overdue():
        return NoPlan(explanation="the time for planning is over", undecided=True)
    engines = _Engines(None, None, None, LIMIT, SEARCH_EFFORT // BRIEF, is_overdue)
    return _plan_or_assume(problem, engines, ask_to_know=False)


def _plan(problem: Problem, engines: _Engines) -> Plan | NoPlan:
    try:
        return _search_plan(problem, *_compile_problem(problem, engines.is_overdue), engines)
    except Inexpressible as inexpressible:
        return _report_inexpressible(inexpressible)
    except (TooLarge, CountingFailed) as large:
        return NoPlan(explanation=f"this is too large to be searched: {large}", undecided=True)
    except TooHard as hard:
        explanation = f"this takes a longer search ({hard}); install the engine for it: pip install 'somrs[planner]'"
        return NoPlan(explanation=explanation, undecided=True)
    except SomrsError as error:
        return NoPlan(explanation=f"no plan was found: {error}", undecided=True)


def _unmet_precondition(problem: Problem) -> NoPlan | None:
    """The result for a precondition of the task that does not hold on the map; None if it holds."""
    if problem.precondition is None or formula_holds(problem.precondition, problem.map, problem.ontology):
        return None
    parts = conjuncts(problem.precondition)
    denied = [part for part in parts if not formula_holds(part, problem.map, problem.ontology)] or parts
    denied_text = " and ".join(map(str, denied))
    return NoPlan(
        explanation=f"the task starts from {denied_text}, which does not hold on the map",
        missing=tuple(map(str, denied)),
        obstacles=(Obstacle.PRECONDITION,),
    )


def _check_map(problem: Problem) -> Plan | NoPlan | None:
    """The result that follows from the map alone: an unmet precondition, or a goal that already holds. None otherwise."""
    unmet = _unmet_precondition(problem)
    if unmet is not None:
        return unmet
    if not formula_holds(problem.goal, problem.map, problem.ontology):
        return None
    doubtful = [name for name in names(problem.goal) if name in problem.excluded]
    branches = alternatives(problem.goal) if count_alternatives(problem.goal) <= ALTERNATIVES else ()
    if doubtful and not any(_holds_beyond_doubt(conjunction(*branch), problem) for branch in branches):
        explanation = f"{problem.goal}: {exclusion_text(doubtful, problem)}"
        return NoPlan(explanation=explanation, obstacles=exclusion_obstacles(doubtful, problem))
    return Plan()


def _holds_beyond_doubt(branch: Formula, problem: Problem) -> bool:
    """Whether an alternative of the goal holds, and names no excluded object."""
    return problem.excluded.isdisjoint(names(branch)) and formula_holds(branch, problem.map, problem.ontology)


def _compile_problem(problem: Problem, is_overdue: Callable[[], bool] = lambda: False) -> tuple[World, list[Operator]]:
    world = World(problem, is_overdue=is_overdue)
    return world, list(goal_operators(problem.goal, world.vocabulary))


def _report_inexpressible(inexpressible: Inexpressible) -> NoPlan:
    return NoPlan(explanation=f"this cannot be planned for: {inexpressible}", undecided=True)


def _search_plan(problem: Problem, world: World, goals: list[Operator], engines: _Engines) -> Plan | NoPlan:
    """A plan from a search among the ground uses of services; from a lookahead, if there are too many of these."""
    lookahead = Lookahead(problem, world, goals)
    if lookahead.fleet <= FLEET:
        try:
            return _plan_grounded(problem, world, goals, engines, QUICK_EFFORT)
        except TooLarge:
            if world.vocabulary.calculates:
                return _plan_with_counters(problem, engines)
    if (moves := lookahead.find_moves()) is not None:
        return build_plan(problem, moves)
    try:
        return _plan_grounded(problem, world, goals, engines, EFFORT)
    except TooLarge:
        if not world.vocabulary.calculates:
            raise
        return _plan_with_counters(problem, engines)


def _plan_grounded(problem: Problem, world: World, goals: list[Operator], engines: _Engines, effort: int) -> Plan | NoPlan:
    """Search among the likely actions first (narrow), then among all relevant ones: only the latter can prove that there is no plan.

    The engines have a limited time for the likely actions of a hard task, and none if there are nearly as many relevant ones: a single
    action may be missing without which there is no plan, such as the one that empties a hand (docs/decisions/0049). Raises TooLarge.
    """

    def ground(demanded: list[Demand], narrow: bool) -> Grounding:
        max_actions = VALUES if world.vocabulary.calculates else None
        return Grounding(world, demanded, narrow=narrow, effort=effort, max_actions=max_actions)

    def finish(task: Task, moves: list[Move]) -> Plan:
        return _improve_plan(problem, build_plan(problem, remove_redundant_moves(moves, task)), task, engines)

    likely_demands = demands(goals, world, narrow=True)
    likely = ground(likely_demands, narrow=True)
    likely_task = Task(likely) if likely.is_goal_reachable else None
    hard: TooHard | None = None
    if likely_task is not None:
        try:
            if (moves := _search(likely_task, engines)) is not None:
                return finish(likely_task, moves)
        except TooHard as error:
            hard = error

    def search_likely(share: float) -> Plan | None:
        """The plan that engines find among the likely actions in this share of their time. If it is all of it, failure is an error."""
        if likely_task is None or hard is None:
            return None
        try:
            moves = _call_engine(likely_task, engines, hard, share)
        except (TooHard, RemoteError):
            if share == 1:
                raise
            return None
        return finish(likely_task, moves) if moves is not None else None

    relevant_demands = demands(goals, world, narrow=False)
    left_out = not {*relevant_demands} <= {*likely_demands}
    is_whole = not left_out and not likely.joins.limited
    if not left_out and (found := search_likely(1.0 if is_whole else LIKELY_SHARE)) is not None:
        return found
    if is_whole:
        return _explain(problem, world, likely.joins.guessed)
    try:
        relevant = ground(relevant_demands, narrow=False)
    except TooLarge:
        if left_out and (found := search_likely(1.0)) is not None:
            return found
        raise
    if left_out and len(relevant.actions) > SIMILAR * len(likely.actions) and (found := search_likely(LIKELY_SHARE)) is not None:
        return found
    if relevant.is_goal_reachable:
        task = Task(relevant)
        if (moves := _solve(task, engines)) is not None:
            return finish(task, moves)
    return _explain(problem, world, relevant.joins.guessed)


def _explain(problem: Problem, world: World, guessed: bool) -> NoPlan:
    """Why there is no plan, if that is wanted."""
    return explain_failure(problem, world, guessed) if problem.explained else NoPlan(explanation="")


def _improve_plan(problem: Problem, first_plan: Plan, task: Task, engines: _Engines) -> Plan:
    """A better plan than the first, if the improver finds one in time. When planning follows a failure (`problem.rest`), the first plan is
    kept, because devices are waiting."""
    if engines.improver is None or len(first_plan.steps) < LONG or problem.rest:
        return first_plan
    other_plans = engines.improver(encode_sas(merge_task(task)), problem.hurry)
    return best(
        problem, [first_plan, *(build_plan(problem, remove_redundant_moves(decode_moves(names, task), task)) for names in other_plans)]
    )


def _plan_with_counters(problem: Problem, engines: _Engines) -> Plan | NoPlan:
    """Plan with counters beside the facts, for numbers that may take too many values to have a fact each."""
    world = World(problem, counting=True, is_overdue=engines.is_overdue)
    goals = list(goal_operators(problem.goal, world.vocabulary))
    for narrow in (True, False):
        grounding = Grounding(world, demands(goals, world, narrow=narrow), narrow=narrow)
        if grounding.is_goal_reachable:
            task = Task(grounding)
            counters = Counters(task, world)
            moves = _solve_with_counters(task, counters, engines)
            if moves is not None:
                return build_plan(problem, counting.remove_redundant_moves(moves, task, counters))
    return _explain(problem, world, grounding.joins.guessed)


def _solve_with_counters(task: Task, counters: Counters, engines: _Engines) -> list[Move] | None:
    try:
        return search_with_counters(task, counters, STATES if engines.numeric is not None else ALL_STATES)
    except CountingFailed as error:
        if engines.numeric is None:
            raise CountingFailed(f"{error}; install the engine for numbers: pip install 'somrs[numbers]'") from None
    numeric_task = NumericTask(task, counters)
    names = engines.numeric(numeric_task.domain, numeric_task.problem, engines.limit)
    if names is None:
        return None
    moves = numeric_task.decode_moves(names)
    if not counting.reaches_goal(moves, task, counters):
        raise CountingFailed("the plan from the engine for numbers fails in exact arithmetic")
    return moves


def _search(task: Task, engines: _Engines) -> list[Move] | None:
    """The moves that the planner's own search finds; None if there is no plan. A second search may make a plan too short for the improver.
    Raises TooHard."""
    return cheapest(task, engines.effort, longest=2 * LONG if engines.improver is not None else None)


def _solve(task: Task, engines: _Engines) -> list[Move] | None:
    try:
        return _search(task, engines)
    except TooHard as hard:
        return _call_engine(task, engines, hard)


def _call_engine(task: Task, engines: _Engines, hard: TooHard, share: float = 1.0) -> list[Move] | None:
    """The moves that an engine finds in this share of its time; None if there is no plan. Raises `hard`, why the planner's own search gave
    up, if there is no engine, and RemoteError."""
    if engines.search is None:
        raise hard
    try:
        names = engines.search(encode_sas(merge_task(task)), share * engines.limit)
    except SomrsError as error:
        raise RemoteError(f"{error}; the short search before it: {hard}") from error
    return decode_moves(names, task) if names is not None else None
