"""The ground problem in finite-domain variables: the place of a thing is one variable, whose value a service replaces.

Such a task is small, needs no delete effects, and is what engines read (`sas.py`) and `search.py` looks through.
"""

from __future__ import annotations

from dataclasses import dataclass

from somrs.planner.grounding.finite import Assignment as Assignment
from somrs.planner.grounding.finite import State as State
from somrs.planner.grounding.grounding import Action, Grounding
from somrs.planner.model.operators import GOAL, SOME, Argument, Fact

Key = tuple[str, object]


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """An action: what it needs, and what it assigns, each under conditions (mostly none)."""

    action: Action
    needs: tuple[Assignment, ...]
    effects: tuple[tuple[tuple[Assignment, ...], int, int], ...]
    cost: float = 1.0
    """What the service costs, as far as can be told before anybody is asked."""

    @property
    def length(self) -> int:
        """How many steps it is: that the goal is reached is none."""
        return 0 if self.action.operator.service is None else 1

    def applicable(self, state: State) -> bool:
        return all(state[variable] == value for variable, value in self.needs)

    def apply(self, state: State) -> State:
        after = list(state)
        for conditions, variable, value in self.effects:
            if all(state[other] == wanted for other, wanted in conditions):
                after[variable] = value
        return tuple(after)


class Task:
    """`values[v]` are the facts that variable v can stand for, by value; value 0 is none of them."""

    def __init__(self, grounding: Grounding) -> None:
        self.known = grounding.world.known
        self.hurry = grounding.world.hurry
        self._cost = grounding.world.cost
        self.values: list[list[Fact | None]] = []
        self.place: dict[Fact, Assignment] = {}
        self.negated: dict[Fact, int] = {}
        """The variable that is 1 while the fact, one of several values of its own variable, does not hold."""
        self._variables: dict[Key, int] = {}
        # The facts that do not share a variable, and the negated ones, by relation and the object that would give them up.
        self._by_first: dict[tuple[str, Argument], list[Fact]] = {}
        forbidden = {action: grounding.forbidden(action) for action in grounding.actions if action.operator.forbids}
        actions = self._useful(grounding, forbidden)
        so = [fact for fact in self.mentioned if grounding.world.so(fact)]
        self._crowded = self._several_at_once(so)
        for fact in (*so, *(fact for fact in grounding.facts.new if fact in self.mentioned)):
            self._place(fact)
        for facts in forbidden.values():
            for fact in facts:
                if fact in self.place and len(self.values[self.place[fact][0]]) > 2 and fact not in self.negated:
                    self.negated[fact] = len(self.values)
                    self.values.append([None, ("NOT", (str(fact),))])
                    self._by_object(fact)
        self.initial = self._initial(so)
        self.goal = self.place.get(GOAL)
        self.moves = [move for action in actions if (move := self._move(action, forbidden.get(action, []))) is not None]

    def _useful(self, grounding: Grounding, forbidden: dict[Action, list[Fact]]) -> list[Action]:
        """The actions with an effect that any of them, or the goal, needs or forbids; `mentioned` are those facts."""
        actions = grounding.actions
        while True:
            needed = dict.fromkeys([fact for action in actions for fact in action.needs] + [GOAL])
            unwanted = dict.fromkeys(fact for action in actions for fact in forbidden.get(action, ()))
            gone = {self._first(fact) for fact in unwanted}
            kept = [
                action
                for action in actions
                if any(fact in needed or self._some(fact) in needed or self._first(fact) in gone for fact in action.adds)
                or any(fact in unwanted for fact in action.removes)
                or action.sets
            ]
            if len(kept) == len(actions):
                self.mentioned = needed | unwanted | dict.fromkeys(fact for action in actions for fact in action.removes)
                return kept
            actions = kept

    def _first(self, fact: Fact) -> object:
        """Adding a fact can take away only facts of which this is the same."""
        predicate, arguments = fact
        if predicate.startswith(".") or not arguments:
            return predicate, arguments[:1]
        relation = self.known.ontology.relations.get(predicate)
        if relation is None or self.known.symmetric(predicate):
            return None
        return relation.excludes or predicate, arguments[0]

    def _some(self, fact: Fact) -> Fact:
        return fact[0] + SOME, fact[1][:1]

    def _several_at_once(self, so: list[Fact]) -> set[Key]:
        """Variables that the map gives two values, against its own rules: their facts stand alone."""
        count: dict[Key, int] = {}
        for fact in so:
            key = self.known.variable_of(fact)
            if key is not None:
                count[key] = count.get(key, 0) + 1
        return {key for key, number in count.items() if number > 1}

    def _key(self, fact: Fact) -> Key:
        if fact == GOAL or fact[0].endswith(SOME):
            return "alone", fact
        key = self.known.variable_of(fact)
        return key if key is not None and key not in self._crowded else ("alone", fact)

    def _place(self, fact: Fact) -> None:
        variable = self._variables.setdefault(self._key(fact), len(self.values))
        if variable == len(self.values):
            self.values.append([None])
        self.place[fact] = variable, len(self.values[variable])
        self.values[variable].append(fact)
        if self._key(fact) == ("alone", fact):
            self._by_object(fact)

    def _by_object(self, fact: Fact) -> None:
        """Keep a fact to be looked up by the object that would give it up."""
        for argument in fact[1] if self.known.symmetric(fact[0]) else fact[1][:1]:
            self._by_first.setdefault((fact[0], argument), []).append(fact)

    def _initial(self, so: list[Fact]) -> State:
        state = [0] * len(self.values)
        for fact in so:
            variable, value = self.place[fact]
            state[variable] = value
        holding = set(so)
        for fact, variable in self.negated.items():
            state[variable] = int(fact not in holding)
        return tuple(state)

    def _move(self, action: Action, forbidden: list[Fact]) -> Move | None:
        needs = dict.fromkeys(self.place[fact] for fact in action.needs)
        for fact in forbidden:
            if fact in self.negated:
                needs[self.negated[fact], 1] = None
            elif fact in self.place:
                needs[self.place[fact][0], 0] = None
        if len({variable for variable, _ in needs}) < len(needs) or set(action.adds) & set(action.removes):
            return None
        if len({self._key(fact) for fact in action.adds}) < len(action.adds):
            return None  # an object cannot be in two of these at a time
        effects: dict[int, tuple[tuple[Assignment, ...], int]] = {}
        for fact in action.removes:
            self._remove(fact, effects, ())
        for fact in action.adds:
            self._displace(fact, action, effects)
        for fact in action.adds:
            self._add(fact, effects)
        made = tuple((conditions, variable, value) for variable, (conditions, value) in effects.items())
        return Move(action, tuple(needs), made, self._cost(action.operator.service, action.bound))

    def _remove(self, fact: Fact, effects: dict[int, tuple[tuple[Assignment, ...], int]], conditions: tuple[Assignment, ...]) -> None:
        if fact not in self.place:
            return
        variable, value = self.place[fact]
        if len(self.values[variable]) > 2 or self._some(fact) in self.place:
            conditions = ((variable, value),)
        effects[variable] = conditions, 0
        if fact in self.negated:
            effects[self.negated[fact]] = (), 1
        if self._some(fact) in self.place:
            effects[self.place[self._some(fact)][0]] = conditions, 0

    def _displace(self, fact: Fact, action: Action, effects: dict[int, tuple[tuple[Assignment, ...], int]]) -> None:
        """What an object gives up when it enters into a relation, and an attribute when it gets a value."""
        predicate, arguments = fact
        if not arguments:
            return
        if predicate.startswith("."):
            others = [predicate]
        else:
            relation = self.known.ontology.relations[predicate]
            others = [*self.known.excluded_by(predicate), *([predicate] if relation.functional else [])]
            for other in self.known.excluded_by(predicate):
                if (some := (other + SOME, arguments[:1])) in self.place:
                    effects[self.place[some][0]] = (), 0
        key = self._key(fact)
        if key in self._variables:
            effects[self._variables[key]] = (), 0
        for other in others:
            for rival in self._by_first.get((other, self._entering(fact, action)), ()):
                if rival in self.negated:
                    effects[self.negated[rival]] = (), 1
                elif rival != fact:
                    effects[self.place[rival][0]] = (), 0

    def _entering(self, fact: Fact, action: Action) -> Argument:
        """The object that enters into the relation: the first one as the effect is written."""
        if self.known.symmetric(fact[0]):
            for predicate, terms in action.operator.adds:
                if predicate == fact[0]:
                    written = [term if isinstance(term, str) else action.bound[term.name] for term in terms]  # type: ignore[union-attr]
                    if set(written) == set(fact[1]):
                        return written[0]
        return fact[1][0]

    def _add(self, fact: Fact, effects: dict[int, tuple[tuple[Assignment, ...], int]]) -> None:
        for added in (fact, self._some(fact)):
            if added in self.place:
                variable, value = self.place[added]
                effects[variable] = (), value
            if added in self.negated:
                effects[self.negated[added]] = (), 0
