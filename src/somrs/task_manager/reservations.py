"""What tasks that are under way have to themselves, so that none is planned on what another was promised.

From the moment when a task takes a plan until it ends, nobody else changes what its plan changes or relies on, and nobody relies on what
it changes: that may be another way by then. Who needs something that another has waits until that one has ended. Whoever waits has
nothing, not even what it had before, so nobody waits for one that waits for it; of those that wait, the one with the highest priority
comes first, then the one that was submitted first. What is under way is not interrupted, whatever the priority of those that wait for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct, field

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Not, Relation, Term
from somrs.entish.formula import alternatives, literals, terms
from somrs.ontology.types import Ontology
from somrs.planner.model.plan import Plan, Step


class Reservation(Struct, frozen=True, kw_only=True):
    """The objects that a plan changes, and those that have to stay as they are for it."""

    changes: frozenset[str] = frozenset()
    relies_on: frozenset[str] = field(default=frozenset(), name="relies")

    def __or__(self, reservation: Reservation) -> Reservation:
        return Reservation(changes=self.changes | reservation.changes, relies_on=self.relies_on | reservation.relies_on)

    def overlap(self, reservation: Reservation) -> frozenset[str]:
        """What both cannot have."""
        return self.changes & (reservation.changes | reservation.relies_on) | self.relies_on & reservation.changes


class BlockedPlan(Struct, frozen=True, kw_only=True):
    """There is a plan, but others have what it needs: who, and which of the objects."""

    reservation: Reservation
    holders: dict[str, frozenset[str]]
    plan: Plan

    @property
    def objects(self) -> tuple[str, ...]:
        return tuple(sorted(frozenset[str]().union(*self.holders.values())))


class _Waiting(Struct):
    reservation: Reservation = field(name="wanted")
    admitted: bool = field(default=False, name="called")
    """It makes its plan; until it has that, what it waits for is respected by whoever comes behind it."""


class Reservations(Struct, kw_only=True):
    """Of all tasks that are under way, by task."""

    goals: dict[str, str] = {}
    """What each wants, in the order in which they come first: by priority, and then as they were submitted."""
    priorities: dict[str, int] = {}
    held: dict[str, Reservation] = {}
    waiting: dict[str, _Waiting] = field(default_factory=dict)
    freed: bool = False
    """Something is free that was not when it was looked last."""

    def add_task(self, task: str, goal: str, priority: int = 0) -> None:
        """The task was submitted."""
        later_tasks = [other_task for other_task in reversed(self.goals) if self.priorities[other_task] < priority]
        self.goals[task], self.priorities[task] = goal, priority
        for other_task in reversed(later_tasks):
            self.goals[other_task] = self.goals.pop(other_task)

    def remove_task(self, task: str) -> None:
        """It is over."""
        self.goals.pop(task, None)
        self.priorities.pop(task, None)
        self.held.pop(task, None)
        self.waiting.pop(task, None)
        self.freed = True

    def goal(self, task: str) -> str:
        return self.goals.get(task, "")

    def conflicts(self, task: str, reservation: Reservation) -> dict[str, frozenset[str]]:
        """Who has what is wanted, or waits for it and comes first; empty when it can be had."""
        return {
            other_task: contested_objects
            for other_task, other_reservation in self._prior_reservations(task)
            if (contested_objects := reservation.overlap(other_reservation))
        }

    def holders(self, task: str, reservation: Reservation) -> list[str]:
        """Who else has any of it, whoever waits for it."""
        return [
            other_task
            for other_task, other_reservation in self.held.items()
            if other_task != task and reservation.overlap(other_reservation)
        ]

    def reserved_objects(self, task: str) -> frozenset[str]:
        """The objects that others change."""
        return frozenset(name for _, other_reservation in self._prior_reservations(task) for name in other_reservation.changes)

    def _prior_reservations(self, task: str) -> Iterator[tuple[str, Reservation]]:
        yield from ((other_task, other_reservation) for other_task, other_reservation in self.held.items() if other_task != task)
        for other_task in self.goals:
            if other_task == task:
                return
            if (waiting := self.waiting.get(other_task)) is not None:
                yield other_task, waiting.reservation

    def hold(self, task: str, reservation: Reservation) -> None:
        """The task has this from now on, and what it had before: that may have to be undone."""
        self.held[task] = self.held.get(task, Reservation()) | reservation
        self.waiting.pop(task, None)

    def wait(self, task: str, reservation: Reservation) -> None:
        """The task gives up what it has, and waits for this."""
        self.held.pop(task, None)
        self.waiting[task] = _Waiting(reservation)
        self.freed = True

    def stop_waiting(self, task: str) -> None:
        """It does not wait any more."""
        if self.waiting.pop(task, None) is not None:
            self.freed = True

    def admit_waiting(self) -> Iterator[str]:
        """Those that wait for nobody any more, each once. Between two of them, anything may change."""
        while self.freed:
            self.freed = False
            for task in [task for task in self.goals if task in self.waiting]:
                waiting = self.waiting.get(task)
                if waiting is not None and not waiting.admitted and not self.conflicts(task, waiting.reservation):
                    waiting.admitted = True
                    yield task


def plan_reservation(steps: Iterable[Step], goal: Formula, ontology: Ontology) -> Reservation:
    """What a plan changes and relies on. Of a goal with OR it is not known which part will be so."""
    changes: set[str] = set()
    relies: set[str] = set()
    for step in steps:
        for literal in literals(step.effect):
            atom = literal.atom if isinstance(literal, Not) else literal
            if isinstance(atom, Comparison):
                target, source = (atom.left, atom.right) if isinstance(atom.left, Attribute) else (atom.right, atom.left)
                changes.update(_term_objects(target))
                relies.update(_term_objects(source))
            else:
                changes.update(_subjects(atom, ontology))
        if step.precondition is not None:
            relies.update(_formula_objects(step.precondition, ontology))
    if len([*alternatives(goal)]) == 1:
        relies.update(_formula_objects(goal, ontology))
    return Reservation(changes=frozenset(changes), relies_on=frozenset(relies - changes))


def _formula_objects(formula: Formula, ontology: Ontology) -> Iterator[str]:
    for literal in literals(formula):
        atom = literal.atom if isinstance(literal, Not) else literal
        if isinstance(atom, Comparison):
            yield from _term_objects(atom.left)
            yield from _term_objects(atom.right)
        else:
            yield from _subjects(atom, ontology)


def _subjects(atom: Relation, ontology: Ontology) -> Iterator[str]:
    """The objects that a fact says something of: the first; of a symmetric relation, all."""
    relation = ontology.relations.get(atom.relation)
    subjects = atom.arguments if relation is not None and relation.symmetric else atom.arguments[:1]
    yield from (argument.name for argument in subjects if isinstance(argument, Name))


def _term_objects(term: Term) -> Iterator[str]:
    """The objects whose values a term is made of."""
    for inner in terms(term):
        match inner:
            case Attribute(Name(name)):
                yield name
            case Call(_, arguments):
                yield from (argument.name for argument in arguments if isinstance(argument, Name))
