"""From operators to actions: the facts and actions that are reachable in the delete relaxation, where no fact becomes false.

Grounding evaluates static conditions on the map; the conditions of the actions depend only on what services change.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from somrs.entish import Variable
from somrs.planner.grounding.actions import Action, added_facts, argument_of, make_action
from somrs.planner.grounding.joins import Condition, Joins, TooLarge, operator_name
from somrs.planner.grounding.relevance import Demand
from somrs.planner.model.facts import Facts
from somrs.planner.model.operators import NegativePrecondition, Operator
from somrs.planner.model.vocabulary import GOAL, Argument, Fact, Pattern
from somrs.planner.model.world import Binding, World

EFFORT = 10_000_000
"""The default maximum of effort (`Joins`): half a minute, and about a gigabyte of actions."""
ACTION_EFFORT = 10
"""The effort for an action, beside that for its facts: its memory is limited, too."""


class Grounding:
    """The actions that are demanded and reachable, and the facts that they add. The constructor raises TooLarge."""

    def __init__(
        self, world: World, demanded: list[Demand], *, narrow: bool = False, effort: int = EFFORT, max_actions: int | None = None
    ) -> None:
        self.world = world
        self.narrow = narrow
        self._max_actions = max_actions
        self.facts = Facts(world)
        self.joins = Joins(world, self.facts, narrow=narrow, effort=effort)
        self.actions: list[Action] = []
        self._action_keys: set[tuple[Operator, tuple[Argument, ...]]] = set()
        self._waiting: list[Fact] = []
        self._run(demanded)

    @classmethod
    def of(cls, world: World, actions: Iterable[Action]) -> Grounding:
        """The grounding that consists of the given actions."""
        grounding = cls(world, [])
        for action in actions:
            grounding.actions.append(action)
            for fact in added_facts(action, world):
                grounding.facts.add(fact)
        return grounding

    @property
    def is_goal_reachable(self) -> bool:
        return GOAL in self.facts.new

    def _run(self, demanded: list[Demand]) -> None:
        # The preconditions that a fact may meet, by its predicate and the place and value of a known argument; place -1 if none is known.
        demands_by_precondition: dict[tuple[str, int, Argument], list[tuple[Demand, Binding, Pattern]]] = {}
        for demand in demanded:
            binding = dict(demand.values)
            for precondition in dict.fromkeys(demand.operator.preconditions):
                known_arguments = [argument_of(term, binding) for term in precondition[1]]
                place = next((place for place, value in enumerate(known_arguments) if value is not None), -1)
                demands_by_precondition.setdefault((precondition[0], place, known_arguments[place] or "" if place >= 0 else ""), []).append(
                    (demand, binding, precondition)
                )
            self._extend(demand, binding, None)
        while self._waiting:
            fact = self._waiting.pop()
            if not self.facts.add(fact):
                continue
            for arguments in self.joins.orders(*fact):
                for place, value in ((-1, ""), *enumerate(arguments)):
                    for demand, binding, precondition in demands_by_precondition.get((fact[0], place, value), ()):
                        matched = self.joins.match(demand, precondition, arguments, binding)
                        if matched is not None:
                            self._extend(demand, matched, precondition)

    def _extend(self, demand: Demand, binding: Binding, met_precondition: Pattern | None) -> None:
        operator = demand.operator
        conditions: list[Condition] = [precondition for precondition in operator.preconditions if precondition != met_precondition]
        conditions += [*operator.static_conditions, *operator.tests]
        for complete in self.joins.complete(demand, conditions, binding):
            self._add(operator, complete)

    def _add(self, operator: Operator, binding: Binding) -> None:
        key = operator, tuple(binding[name] for name in operator.variables)
        if key in self._action_keys:
            return
        self._action_keys.add(key)
        action = make_action(operator, binding, self.world)
        if action is None:
            return
        self.actions.append(action)
        self.joins.spend(ACTION_EFFORT + len(action.preconditions) + len(action.add_effects), operator)
        if self._max_actions is not None and len(self.actions) > self._max_actions:
            raise TooLarge(f"there are more than {self._max_actions} ways to use services, the last one of them {operator_name(operator)}")
        self._waiting += added_facts(action, self.world)

    def forbidden_facts(self, action: Action) -> list[Fact]:
        """The reachable facts that must not hold when the action starts."""
        return [fact for forbidden in action.operator.negative_preconditions for fact in self._forbidden_by(forbidden, action)]

    def _forbidden_by(self, forbidden: NegativePrecondition, action: Action) -> Iterator[Fact]:
        predicate, terms = forbidden.pattern
        hidden = forbidden.test.hidden if forbidden.test is not None else {}
        for arguments in self.joins.possibilities(forbidden.pattern, action.binding):
            matched: Binding = dict(action.binding)
            for term, value in zip(terms, arguments, strict=True):
                if isinstance(term, Variable):
                    if matched.setdefault(term.name, value) != value:
                        break
                    types = action.operator.types.get(term.name, frozenset())
                    if term.name not in hidden and not self.world.has_types(value, types):
                        break
                elif term != value:
                    break
            else:
                if forbidden.test is None or self.world.passes(forbidden.test, matched):
                    yield self.world.canonical((predicate, arguments))
