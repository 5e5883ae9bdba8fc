"""Lookahead: plans that follow relaxed plans, for problems too large to ground (YAHSP, Vidal 2004).

An exploration gives, for each part of the goal, a chain of actions that reaches it if nothing becomes false. The chain is followed on the
map by means and ends: to use an action, reach its preconditions first. An action is bound anew where it is used, so a robot that has moved
goes on from where it is. Then the next exploration begins on the new map.

Devices that differ only in what services change, such as their places, are one device to the first exploration (a bag of objects: Riddle,
Douglas, Barley and Franco 2016): what holds of one holds of their representative. The chain then tells which of them to take: the one of
which most of the chain's first facts hold. It is near, because an exploration reaches facts in the order of their costs. A second
exploration is for this device alone.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import islice

from somrs.entish import Term, Variable
from somrs.entish.formula import conjunction, substitute
from somrs.ontology.effects import apply_effect
from somrs.ontology.truth import formula_holds
from somrs.planner.grounding import exploration
from somrs.planner.grounding.actions import Action, added_facts, argument_of, make_action
from somrs.planner.grounding.bags import Bag, find_bags
from somrs.planner.grounding.exploration import Exploration, pattern_variables
from somrs.planner.grounding.grounding import Grounding
from somrs.planner.grounding.joins import Joins, TooLarge
from somrs.planner.grounding.relevance import Demand, demands
from somrs.planner.grounding.task import Move, Task
from somrs.planner.model.facts import Facts
from somrs.planner.model.operators import Operator
from somrs.planner.model.problem import Problem
from somrs.planner.model.vocabulary import GOAL, Argument, Fact
from somrs.planner.model.world import Binding, World, as_term
from somrs.planner.search.search import remove_redundant_moves

ROUNDS = 50
"""The maximum number of explorations."""
PATIENCE = 3
"""The number of explorations in a row that bring the goal no nearer before the lookahead gives up."""
CANDIDATES = 3
"""The number of devices that are tried in the place of a representative."""
EXAMINED = 100
"""The number of devices whose values are examined, to find those."""
CHOICES = 8
"""The number of ways to bind an action among which the cheapest is taken."""
DEPTH = 300
"""The maximum length of a chain of actions."""
STEPS = 3_000
"""The maximum number of steps."""
EFFORT = 200_000
"""The maximum number of facts to match with conditions in all explorations together: one to three seconds."""
EARNED_EFFORT = 20_000
"""The effort that is added for each part of the goal when it is first reached: many parts may take long, a dead end may not."""
FACTS = 40_000
"""The maximum of effort when one action is bound."""


class _GivenUp(Exception):
    """A limit is exceeded."""


class Lookahead:
    """A lookahead for one problem."""

    def __init__(self, problem: Problem, world: World, goals: Sequence[Operator]) -> None:
        self._problem, self._world, self._goals = problem, world, goals
        self._demanded = demands(goals, world, direct=True)
        self._bags = find_bags(problem, world, self._demanded)

    @property
    def fleet(self) -> int:
        """The size of the largest group of devices that differ only in what services change."""
        return max((len(bag.members) for bag in self._bags), default=1)

    def find_moves(self) -> list[Move] | None:
        """The moves of a plan, without redundant ones; None if none is found. There may still be a plan."""
        if any(goal.negative_preconditions or goal.numeric_conditions for goal in self._goals):
            return None  # no chain makes a fact false, or counts
        if any(demand.operator.tells or demand.operator.is_choice for demand in self._demanded):
            return None  # the map does not show what will be known, or is chosen
        effort = EFFORT
        for direct in (True, False):
            demanded = self._demanded if direct else demands(self._goals, self._world)
            bags = self._bags if direct else find_bags(self._problem, self._world, demanded)
            execution = _Execution(self._problem, self._world, self._goals[0], demanded, bags, direct=direct, effort=effort)
            try:
                if execution.run():
                    return _moves(execution, self._goals)
            except (TooLarge, _GivenUp):
                pass
            effort = execution.effort
        return None


class _Execution:
    """The map after the actions so far."""

    def __init__(
        self, problem: Problem, world: World, goal: Operator, demanded: Sequence[Demand], bags: Sequence[Bag], *, direct: bool, effort: int
    ) -> None:
        self.problem, self.world, self.start = problem, world, world
        self.demanded, self.bags, self._goal, self.direct = demanded, bags, goal, direct
        self.effort = effort
        """The effort that is left for explorations."""
        self.actions: list[Action] = []
        self._demands_by_part: dict[Fact, list[Demand]] = {}
        self._used: set[str] = set()
        self._reached: set[Fact] = set()
        self.subjects = frozenset[Argument]()
        """The first objects of the parts of the goal."""
        self._demand_of = {demand.operator: Demand(demand.operator, (), ()) for demand in demanded}

    def run(self) -> bool:
        """Whether the goal is reached."""
        nearest, patience = float("inf"), PATIENCE
        for _ in range(ROUNDS):
            guide = _Guide(self, self.bags, self.demanded, GOAL)
            goal_action = guide.exploration.achievers.get(GOAL)
            if goal_action is None:
                return False
            distance = guide.exploration.cost(GOAL)
            patience = PATIENCE if distance < nearest else patience - 1
            nearest = min(distance, nearest)
            count = len(self.actions)
            self.subjects = frozenset(fact[1][0] for fact in goal_action.preconditions if len(fact[1]) > 1)
            for part in sorted(goal_action.preconditions, key=guide.exploration.cost):
                self._pursue(part, guide)
            if formula_holds(self.problem.goal, self.world.map, self.problem.ontology):
                return True
            if len(self.actions) == count or patience < 0:
                return False
        return False

    def _pursue(self, part: Fact, guide: _Guide) -> None:
        """Reach a part of the goal along its chain; if this fails, with explorations of its own for the best devices."""
        count, world = len(self.actions), self.world
        casts = guide.casts(part, self._used)
        for roles in casts[:1]:
            if guide.achieve(part, roles):
                self._note_reached(part, roles)
                return
            self.undo(count, world)
        for roles in casts:
            bags = [bag.only(roles[bag.representative]) if bag.representative in roles else bag for bag in self.bags]
            if self._pursue_alone(part, bags):
                self._note_reached(part, roles)
                return
            self.undo(count, world)

    def _note_reached(self, part: Fact, roles: Mapping[str, str]) -> None:
        self._used.update(roles.values())
        if part not in self._reached:
            self._reached.add(part)
            self.effort += EARNED_EFFORT

    def _pursue_alone(self, part: Fact, bags: Sequence[Bag]) -> bool:
        """Reach a part of the goal with explorations of its own; at first, without the objects of which other parts speak."""
        rest = self.subjects - set(part[1])
        return any(self._explore_alone(part, bags, omitted_members) for omitted_members in ([rest, frozenset()] if rest else [rest]))

    def _explore_alone(self, part: Fact, bags: Sequence[Bag], omitted_members: frozenset[Argument]) -> bool:
        nearest, patience = float("inf"), PATIENCE
        while True:
            guide = _Guide(self, bags, self._demands_for(part), part, omitted_members)
            distance = guide.exploration.cost(part)
            patience = PATIENCE if distance < nearest else patience - 1
            if part not in guide.exploration.achievers or patience == 0:
                return self.world.fact_holds(part)
            nearest = min(distance, nearest)
            count = len(self.actions)
            if guide.achieve(part, guide.casts(part, set())[0]):
                return True
            if len(self.actions) == count:
                return False

    def _demands_for(self, part: Fact) -> list[Demand]:
        """The demands that lead to one part of the goal."""
        if part not in self._demands_by_part:
            goal = replace(self._goal, preconditions=(part,), static_conditions=(), tests=())
            self._demands_by_part[part] = demands([goal], self.start, direct=self.direct)
        return self._demands_by_part[part]

    def bind(self, operator: Operator, known: Binding) -> Action | None:
        """The cheapest of the operator's first actions that can be used now, with the known values; None without one."""
        joins = Joins(self.world, Facts(self.world), narrow=False, effort=FACTS)
        conditions = [*operator.preconditions, *operator.static_conditions, *operator.tests]
        candidates: list[tuple[float, int, Action]] = []
        for number, binding in enumerate(joins.complete(self._demand_of[operator], conditions, known)):
            action = make_action(operator, binding, self.world)
            if action is not None and self._is_permitted(action):
                candidates.append((self.world.cost(operator.service, binding), number, action))
            if number + 1 >= CHOICES:
                break
        return min(candidates, default=(0.0, 0, None), key=lambda candidate: candidate[:2])[2]

    def _is_permitted(self, action: Action) -> bool:
        """Whether what must not hold does not hold."""
        operator = action.operator
        if not operator.negative_preconditions and not operator.numeric_conditions:
            return True
        condition = substitute(conjunction(*operator.condition), _as_terms(action.binding))
        return formula_holds(condition, self.world.map, self.problem.ontology)

    def apply(self, action: Action) -> None:
        if len(self.actions) >= STEPS:
            raise _GivenUp
        assert action.operator.effect is not None, "only services are applied"
        effect = substitute(action.operator.effect, _as_terms(action.binding))
        self.world = self.world.at(apply_effect(effect, self.world.map, self.problem.ontology))
        self.actions.append(action)

    def fails(self, action: Action, representative: str, device: str) -> bool:
        """Whether a value of the device, in the place of its representative, does not pass a test of the action now."""
        binding = {name: device if value == representative else value for name, value in action.binding.items()}
        for predicate, (owner, value) in (pattern for pattern in action.operator.preconditions if pattern[0].startswith(".")):
            name = argument_of(owner, binding)
            if name == device and isinstance(value, Variable) and (current := self.world.value(device, predicate[1:])) is not None:
                binding[value.name] = current
        return not all(self.world.passes(test, binding) for test in action.operator.tests)

    def undo(self, count: int, world: World) -> None:
        del self.actions[count:]
        self.world = world


class _Guide:
    """An exploration from the current map, and the means to follow its chains."""

    def __init__(
        self,
        execution: _Execution,
        bags: Sequence[Bag],
        demanded: Sequence[Demand],
        target: Fact,
        others: Collection[Argument] = (),
    ) -> None:
        """`others`: the objects that no action may use, besides those that the bags leave out."""
        self.execution = execution
        map = execution.world.map
        self.bags = {bag.representative: bag for bag in bags if len(bag.members) > 1}
        self.holders = {bag.representative: bag.find_holders(map, execution.world) for bag in self.bags.values()}
        omitted_members = {member for bag in bags for member in bag.left_out}.union(name for name in others if isinstance(name, str))
        world = execution.world.without(omitted_members) if omitted_members else execution.world
        known = (fact for holders in self.holders.values() for fact in holders)
        self.exploration = self._explore(world, demanded, known, target)
        self._under_way: set[Fact] = set()
        self._touched_by: dict[Fact, frozenset[object]] = {}

    def _explore(self, world: World, demanded: Sequence[Demand], known: Iterable[Fact], target: Fact) -> Exploration:
        """Explore at the expense of the lookahead."""
        available = min(self.execution.effort, exploration.EFFORT)
        self.execution.effort -= available
        result = Exploration(world, demanded, known, target, effort=available)
        self.execution.effort += max(result.joins.effort, 0)
        return result

    def casts(self, part: Fact, used_devices: Collection[str]) -> list[Mapping[str, str]]:
        """For each representative in the chain to the part, a device; the best choices first."""
        chain, first_facts = self._chain(part)
        ranked = {
            name: self._rank(self.bags[name], chain, first_facts, used_devices)
            for name in self.bags
            if name in _objects(first_facts, chain)
        }
        count = max((len(devices) for devices in ranked.values()), default=1)
        return [{name: devices[min(n, len(devices) - 1)] for name, devices in ranked.items()} for n in range(count)]

    def _chain(self, part: Fact) -> tuple[list[Action], list[Fact]]:
        """The actions of the chain to the fact, and the facts that it begins with, both in the order in which they are used."""
        actions, first_facts = list[Action](), list[Fact]()
        seen = {part}
        waiting: list[tuple[Fact, Action | None]] = [(part, None)]
        while waiting:
            fact, done = waiting.pop()
            if done is not None:
                actions.append(done)
                continue
            action = self.exploration.achievers.get(fact)
            if action is None:
                first_facts.append(fact)
                continue
            waiting.append((fact, action))
            new = [precondition for precondition in self._ordered(action.preconditions) if precondition not in seen]
            seen.update(new)
            waiting += ((precondition, None) for precondition in reversed(new))
        return actions, first_facts

    def _rank(self, bag: Bag, chain: Sequence[Action], first_facts: Iterable[Fact], used_devices: Collection[str]) -> list[str]:
        """The devices that can begin the chain where they are, and whose values allow it; those that have nothing else to do first."""
        score = dict.fromkeys(bag.members, 0.0)
        weight = 1.0
        for fact in first_facts:
            holders = self.holders[bag.representative].get(fact, ()) if not fact[0].startswith(".") else ()
            for device in holders:
                score[device] += weight
            if holders:
                weight /= 2  # where it is used first is where it begins
        order = sorted(bag.members, key=lambda device: (device in used_devices, -score[device]))[:EXAMINED]
        able = (device for device in order if not any(self.execution.fails(action, bag.representative, device) for action in chain))
        return list(dict.fromkeys([*islice(able, CANDIDATES), *order[:CANDIDATES]]))[:CANDIDATES]

    def achieve(self, fact: Fact, roles: Mapping[str, str]) -> bool:
        """Make the fact true, with devices in the place of representatives. Returns whether it is true then."""
        target = _cast(fact, roles, self.execution.world)
        if self.execution.world.fact_holds(target):
            return True
        relaxed_action = self.exploration.achievers.get(fact)
        if relaxed_action is None or fact in self._under_way or len(self._under_way) > DEPTH:
            return False
        self._under_way.add(fact)
        try:
            action = self._bind(relaxed_action, target, roles)
            if action is None:
                for precondition in self._ordered(relaxed_action.preconditions):
                    self.achieve(precondition, roles)
                action = self._bind(relaxed_action, target, roles)
            if action is None:
                return False
            self.execution.apply(action)
            return self.execution.world.fact_holds(target)
        finally:
            self._under_way.discard(fact)

    def _ordered(self, preconditions: Sequence[Fact]) -> list[Fact]:
        """The order in which to achieve them: what the chain of another one is likely to undo comes later (where a robot is, after what it
        fetches from elsewhere), and otherwise the most expensive first."""
        touched = [self._touched(fact) for fact in preconditions]

        def rank(number: int) -> tuple[int, float]:
            own = _subject(preconditions[number])
            return sum(own in keys for other, keys in enumerate(touched) if other != number), -self.exploration.cost(preconditions[number])

        return [preconditions[number] for number in sorted(range(len(preconditions)), key=rank)]

    def _touched(self, fact: Fact) -> frozenset[object]:
        """The predicates and first objects of the facts in the chain to the fact, which is empty if the fact holds."""
        if fact not in self._touched_by:
            action = self.exploration.achievers.get(fact)
            preconditions = action.preconditions if action is not None else ()
            self._touched_by[fact] = frozenset(map(_subject, preconditions)).union(*map(self._touched, preconditions))
        return self._touched_by[fact]

    def _bind(self, relaxed_action: Action, target: Fact, roles: Mapping[str, str]) -> Action | None:
        """An action of the same operator that makes the fact true and can be used now, with the same inputs as far as possible."""
        operator = relaxed_action.operator
        same = {name: roles.get(value, value) if isinstance(value, str) else value for name, value in relaxed_action.binding.items()}
        effect_variables = {name for pattern in operator.add_effects for name in pattern_variables(pattern)}
        action = self.execution.bind(operator, {name: value for name, value in same.items() if "." not in name})
        if action is None:
            condition_variables = {name for condition in operator.preconditions for name in pattern_variables(condition)}
            bound_values = {name: value for name, value in same.items() if name in effect_variables or name not in condition_variables}
            action = self.execution.bind(operator, {name: value for name, value in bound_values.items() if "." not in name})
        return action if action is not None and self._achieves(action, target) else None

    def _achieves(self, action: Action, target: Fact) -> bool:
        return any(fact == target for fact in added_facts(action, self.execution.world))


def _subject(fact: Fact) -> tuple[object, ...]:
    return fact[0], *fact[1][:1]


def _objects(facts: Iterable[Fact], actions: Iterable[Action]) -> set[Argument]:
    return {argument for fact in facts for argument in fact[1]}.union(*(action.binding.values() for action in actions))


def _cast(fact: Fact, roles: Mapping[str, str], world: World) -> Fact:
    predicate, arguments = fact
    return world.canonical((predicate, tuple(roles.get(value, value) if isinstance(value, str) else value for value in arguments)))


def _as_terms(binding: Binding) -> dict[str, Term]:
    return {name: as_term(value) for name, value in binding.items()}


def _moves(execution: _Execution, goals: Sequence[Operator]) -> list[Move] | None:
    """The moves of the actions, without redundant ones."""
    last = next((action for goal in goals if (action := execution.bind(goal, {})) is not None), None)
    if last is None:
        return None
    task = Task(Grounding.of(execution.start, [*execution.actions, last]))
    by_action = {move.action: move for move in task.moves}
    moves = [by_action[action] for action in execution.actions if action in by_action]
    return remove_redundant_moves(moves, task)
