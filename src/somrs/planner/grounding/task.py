"""The ground problem in finite-domain variables: the place of an object, for example, is one variable, whose value a service replaces.

Such a task is small and needs no delete effects. `search.py` searches it, and `sas.py` writes it for engines.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from somrs.planner.grounding.actions import Action
from somrs.planner.grounding.finite_task import Assignment as Assignment
from somrs.planner.grounding.finite_task import State as State
from somrs.planner.grounding.grounding import Grounding
from somrs.planner.model.vocabulary import EXISTS_SUFFIX, GOAL, Argument, Fact

Key = tuple[str, object]


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """An action in finite-domain variables: preconditions, and assignments, each with conditions (mostly none)."""

    action: Action
    preconditions: tuple[Assignment, ...]
    effects: tuple[tuple[tuple[Assignment, ...], int, int], ...]
    cost: float = 1.0
    """The estimated cost of the service, before it quotes a price."""

    @property
    def length(self) -> int:
        """The number of steps: 0 for a move that only reaches the goal, else 1."""
        return 0 if self.action.operator.service is None else 1

    def is_applicable(self, state: State) -> bool:
        return all(state[variable] == value for variable, value in self.preconditions)

    def apply(self, state: State) -> State:
        successor = list(state)
        for conditions, variable, value in self.effects:
            if all(state[condition_variable] == condition_value for condition_variable, condition_value in conditions):
                successor[variable] = value
        return tuple(successor)


class Task:
    """A ground task. `values[v]` lists the facts that the values of variable v stand for; value 0 means none of them."""

    def __init__(self, grounding: Grounding) -> None:
        self.vocabulary = grounding.world.vocabulary
        self.hurry = grounding.world.hurry
        self._cost = grounding.world.cost
        self.values: list[list[Fact | None]] = []
        self.place: dict[Fact, Assignment] = {}
        self.negated: dict[Fact, int] = {}
        """For a fact that shares its variable with others: the variable that is 1 while the fact does not hold."""
        self._variables: dict[Key, int] = {}
        # The facts with a variable of their own and the negated facts, by relation and the object that can leave it.
        self._by_first: dict[tuple[str, Argument], list[Fact]] = {}
        forbidden = {action: grounding.forbidden_facts(action) for action in grounding.actions if action.operator.negative_preconditions}
        actions = self._useful(grounding, forbidden)
        initial_facts = [fact for fact in self._mentioned if grounding.world.fact_holds(fact)]
        self._conflicting_variables = self._find_conflicting_variables(initial_facts)
        for fact in (*initial_facts, *(fact for fact in grounding.facts.new if fact in self._mentioned)):
            self._place(fact)
        for facts in forbidden.values():
            for fact in facts:
                if fact in self.place and len(self.values[self.place[fact][0]]) > 2 and fact not in self.negated:
                    self.negated[fact] = len(self.values)
                    self.values.append([None, ("NOT", (str(fact),))])
                    self._by_object(fact)
        self.goal = self.place.get(GOAL)
        self.moves = [move for action in actions if (move := self._move(action, forbidden.get(action, []))) is not None]
        choices = [move for move in self.moves if move.action.operator.is_choice]
        self.moves = _reopen_choices(self.moves, choices)
        self._choices: dict[int, list[Move]] = {}
        """The choices that depend on a variable, or set it. They are made whenever they hold."""
        for choice in choices:
            for variable in {variable for variable, _ in choice.preconditions} | {variable for _, variable, _ in choice.effects}:
                self._choices.setdefault(variable, []).append(choice)
        self.initial = self._make_choices(self._initial(initial_facts), self._choices)

    def apply(self, move: Move, state: State) -> State:
        """The state after the move, and after the choices that then hold."""
        successor = move.apply(state)
        return self._make_choices(successor, (variable for _, variable, _ in move.effects)) if self._choices else successor

    def _make_choices(self, state: State, changed: Iterable[int]) -> State:
        waiting = list(changed)
        while waiting:
            for choice in self._choices.get(waiting.pop(), ()):
                if not choice.action.numeric_conditions and choice.is_applicable(state):
                    successor = choice.apply(state)
                    if successor != state:
                        state = successor
                        waiting += [variable for _, variable, _ in choice.effects]
        return state

    def _useful(self, grounding: Grounding, forbidden: dict[Action, list[Fact]]) -> list[Action]:
        """The actions with an effect that another action or the goal needs or forbids. Sets `mentioned` to those facts."""
        actions = grounding.actions
        while True:
            needed_facts = dict.fromkeys([fact for action in actions for fact in action.preconditions] + [GOAL])
            unwanted = dict.fromkeys(fact for action in actions for fact in forbidden.get(action, ()))
            displacement_keys = {self._displacement_key(fact) for fact in unwanted}
            useful_actions = [
                action
                for action in actions
                if any(
                    fact in needed_facts
                    or self._existential_fact(fact) in needed_facts
                    or self._displacement_key(fact) in displacement_keys
                    for fact in action.add_effects
                )
                or any(fact in unwanted for fact in action.delete_effects)
                or action.numeric_effects
            ]
            if len(useful_actions) == len(actions):
                self._mentioned = needed_facts | unwanted | dict.fromkeys(fact for action in actions for fact in action.delete_effects)
                return useful_actions
            actions = useful_actions

    def _displacement_key(self, fact: Fact) -> object:
        """The key that a fact shares with all facts that adding it can delete."""
        predicate, arguments = fact
        if predicate.startswith(".") or not arguments:
            return predicate, arguments[:1]
        relation = self.vocabulary.ontology.relations.get(predicate)
        if relation is None or self.vocabulary.is_symmetric(predicate):
            return None
        return relation.excludes or predicate, arguments[0]

    def _existential_fact(self, fact: Fact) -> Fact:
        return fact[0] + EXISTS_SUFFIX, fact[1][:1]

    def _find_conflicting_variables(self, initial_facts: list[Fact]) -> set[Key]:
        """Variables with several values on a map that violates its rules; each of their facts gets a variable of its own."""
        count: dict[Key, int] = {}
        for fact in initial_facts:
            key = self.vocabulary.variable_of(fact)
            if key is not None:
                count[key] = count.get(key, 0) + 1
        return {key for key, number in count.items() if number > 1}

    def _key(self, fact: Fact) -> Key:
        if fact == GOAL or fact[0].endswith(EXISTS_SUFFIX):
            return "alone", fact
        key = self.vocabulary.variable_of(fact)
        return key if key is not None and key not in self._conflicting_variables else ("alone", fact)

    def _place(self, fact: Fact) -> None:
        variable = self._variables.setdefault(self._key(fact), len(self.values))
        if variable == len(self.values):
            self.values.append([None])
        self.place[fact] = variable, len(self.values[variable])
        self.values[variable].append(fact)
        if self._key(fact) == ("alone", fact):
            self._by_object(fact)

    def _by_object(self, fact: Fact) -> None:
        """Index the fact by the object that can leave the relation."""
        for argument in fact[1] if self.vocabulary.is_symmetric(fact[0]) else fact[1][:1]:
            self._by_first.setdefault((fact[0], argument), []).append(fact)

    def _initial(self, initial_facts: list[Fact]) -> State:
        state = [0] * len(self.values)
        for fact in initial_facts:
            variable, value = self.place[fact]
            state[variable] = value
        holding = set(initial_facts)
        for fact, variable in self.negated.items():
            state[variable] = int(fact not in holding)
        return tuple(state)

    def _move(self, action: Action, forbidden: list[Fact]) -> Move | None:
        preconditions = dict.fromkeys(self.place[fact] for fact in action.preconditions)
        for fact in forbidden:
            if fact in self.negated:
                preconditions[self.negated[fact], 1] = None
            elif fact in self.place:
                preconditions[self.place[fact][0], 0] = None
        if len({variable for variable, _ in preconditions}) < len(preconditions) or set(action.add_effects) & set(action.delete_effects):
            return None
        if len({self._key(fact) for fact in action.add_effects}) < len(action.add_effects):
            return None  # the action would give one variable two values
        effects: dict[int, tuple[tuple[Assignment, ...], int]] = {}
        for fact in action.delete_effects:
            self._remove(fact, effects, ())
        for fact in action.add_effects:
            self._displace(fact, action, effects)
        for fact in action.add_effects:
            self._add(fact, effects)
        move_effects = tuple((conditions, variable, value) for variable, (conditions, value) in effects.items())
        return Move(action, tuple(preconditions), move_effects, self._cost(action.operator.service, action.binding))

    def _remove(self, fact: Fact, effects: dict[int, tuple[tuple[Assignment, ...], int]], conditions: tuple[Assignment, ...]) -> None:
        if fact not in self.place:
            return
        variable, value = self.place[fact]
        if len(self.values[variable]) > 2 or self._existential_fact(fact) in self.place:
            conditions = ((variable, value),)
        effects[variable] = conditions, 0
        if fact in self.negated:
            effects[self.negated[fact]] = (), 1
        if self._existential_fact(fact) in self.place:
            effects[self.place[self._existential_fact(fact)][0]] = conditions, 0

    def _displace(self, fact: Fact, action: Action, effects: dict[int, tuple[tuple[Assignment, ...], int]]) -> None:
        """Add the effects that delete what the fact replaces: the relations that the object leaves, or the attribute's old value."""
        predicate, arguments = fact
        if not arguments:
            return
        if predicate.startswith("."):
            displaced_predicates = [predicate]
        else:
            relation = self.vocabulary.ontology.relations.get(predicate)
            displaced_predicates = [
                *self.vocabulary.excluded_by(predicate),
                *([predicate] if relation is not None and relation.functional else []),
            ]
            for displaced_predicate in self.vocabulary.excluded_by(predicate):
                if (existential_fact := (displaced_predicate + EXISTS_SUFFIX, arguments[:1])) in self.place:
                    effects[self.place[existential_fact][0]] = (), 0
        key = self._key(fact)
        if key in self._variables:
            effects[self._variables[key]] = (), 0
        for displaced_predicate in displaced_predicates:
            for rival in self._by_first.get((displaced_predicate, self._entering(fact, action)), ()):
                if rival in self.negated:
                    effects[self.negated[rival]] = (), 1
                elif rival != fact:
                    effects[self.place[rival][0]] = (), 0

    def _entering(self, fact: Fact, action: Action) -> Argument:
        """The object that enters the relation: the first argument of the effect as written."""
        if self.vocabulary.is_symmetric(fact[0]):
            for predicate, terms in action.operator.add_effects:
                if predicate == fact[0]:
                    written = [term if isinstance(term, str) else action.binding[term.name] for term in terms]  # type: ignore[union-attr]
                    if set(written) == set(fact[1]):
                        return written[0]
        return fact[1][0]

    def _add(self, fact: Fact, effects: dict[int, tuple[tuple[Assignment, ...], int]]) -> None:
        for added_fact in (fact, self._existential_fact(fact)):
            if added_fact in self.place:
                variable, value = self.place[added_fact]
                effects[variable] = (), value
            if added_fact in self.negated:
                effects[self.negated[added_fact]] = (), 0


def _reopen_choices(moves: list[Move], choices: Sequence[Move]) -> list[Move]:
    """The moves, such that each move of a service makes the choices open again that it may undo: the facts on which they depend have
    changed. A choice that still holds is made again at no cost."""
    dependents: dict[int, set[int]] = {}
    """For a variable, the variables of the choices that depend on it."""
    on_numbers: set[int] = set()
    for choice in choices:
        made = {variable for _, variable, _ in choice.effects}
        for variable, _ in choice.preconditions:
            dependents.setdefault(variable, set()).update(made)
        if choice.action.numeric_conditions:
            on_numbers |= made
    if not choices:
        return moves
    return [move if move.action.operator.service is None else _reopen(move, dependents, on_numbers) for move in moves]


def _reopen(move: Move, dependents: Mapping[int, set[int]], on_numbers: set[int]) -> Move:
    changed = {variable for _, variable, _ in move.effects}
    reopened = set(on_numbers) if move.action.numeric_effects else set()
    waiting = [*changed, *reopened]
    while waiting:
        new = dependents.get(waiting.pop(), set()) - reopened
        reopened |= new
        waiting += new
    return replace(move, effects=(*move.effects, *(((), variable, 0) for variable in sorted(reopened)))) if reopened else move
