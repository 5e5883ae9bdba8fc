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
    relies: frozenset[str] = frozenset()

    def __or__(self, other: Reservation) -> Reservation:
        return Reservation(changes=self.changes | other.changes, relies=self.relies | other.relies)

    def meets(self, other: Reservation) -> frozenset[str]:
        """What both cannot have."""
        return self.changes & (other.changes | other.relies) | self.relies & other.changes


class Held(Struct, frozen=True, kw_only=True):
    """There is a plan, but others have what it needs: who, and which of the objects."""

    wanted: Reservation
    by: dict[str, frozenset[str]]
    plan: Plan

    @property
    def objects(self) -> tuple[str, ...]:
        return tuple(sorted(frozenset[str]().union(*self.by.values())))


class _Waiting(Struct):
    wanted: Reservation
    called: bool = False
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

    def enter(self, task: str, goal: str, priority: int = 0) -> None:
        """The task was submitted."""
        behind = [other for other in reversed(self.goals) if self.priorities[other] < priority]
        self.goals[task], self.priorities[task] = goal, priority
        for other in reversed(behind):
            self.goals[other] = self.goals.pop(other)

    def leave(self, task: str) -> None:
        """It is over."""
        self.goals.pop(task, None)
        self.priorities.pop(task, None)
        self.held.pop(task, None)
        self.waiting.pop(task, None)
        self.freed = True

    def goal(self, task: str) -> str:
        return self.goals.get(task, "")

    def conflicts(self, task: str, wanted: Reservation) -> dict[str, frozenset[str]]:
        """Who has what is wanted, or waits for it and comes first; empty when it can be had."""
        return {other: met for other, its in self._before(task) if (met := wanted.meets(its))}

    def holders(self, task: str, wanted: Reservation) -> list[str]:
        """Who else has any of it, whoever waits for it."""
        return [other for other, its in self.held.items() if other != task and wanted.meets(its)]

    def taken(self, task: str) -> frozenset[str]:
        """The objects that others change."""
        return frozenset(name for _, its in self._before(task) for name in its.changes)

    def _before(self, task: str) -> Iterator[tuple[str, Reservation]]:
        yield from ((other, its) for other, its in self.held.items() if other != task)
        for other in self.goals:
            if other == task:
                return
            if (waiting := self.waiting.get(other)) is not None:
                yield other, waiting.wanted

    def hold(self, task: str, wanted: Reservation) -> None:
        """The task has this from now on, and what it had before: that may have to be undone."""
        self.held[task] = self.held.get(task, Reservation()) | wanted
        self.waiting.pop(task, None)

    def wait(self, task: str, wanted: Reservation) -> None:
        """The task gives up what it has, and waits for this."""
        self.held.pop(task, None)
        self.waiting[task] = _Waiting(wanted)
        self.freed = True

    def forget(self, task: str) -> None:
        """It does not wait any more."""
        if self.waiting.pop(task, None) is not None:
            self.freed = True

    def called(self) -> Iterator[str]:
        """Those that wait for nobody any more, each once. Between two of them, anything may change."""
        while self.freed:
            self.freed = False
            for task in [task for task in self.goals if task in self.waiting]:
                waiting = self.waiting.get(task)
                if waiting is not None and not waiting.called and not self.conflicts(task, waiting.wanted):
                    waiting.called = True
                    yield task


def reservation(steps: Iterable[Step], goal: Formula, ontology: Ontology) -> Reservation:
    """What a plan changes and relies on. Of a goal with OR it is not known which part will be so."""
    changes: set[str] = set()
    relies: set[str] = set()
    for step in steps:
        for literal in literals(step.effect):
            atom = literal.atom if isinstance(literal, Not) else literal
            if isinstance(atom, Comparison):
                target, source = (atom.left, atom.right) if isinstance(atom.left, Attribute) else (atom.right, atom.left)
                changes.update(_named(target))
                relies.update(_named(source))
            else:
                changes.update(_subjects(atom, ontology))
        if step.precondition is not None:
            relies.update(_read(step.precondition, ontology))
    if len([*alternatives(goal)]) == 1:
        relies.update(_read(goal, ontology))
    return Reservation(changes=frozenset(changes), relies=frozenset(relies - changes))


def _read(formula: Formula, ontology: Ontology) -> Iterator[str]:
    for literal in literals(formula):
        atom = literal.atom if isinstance(literal, Not) else literal
        if isinstance(atom, Comparison):
            yield from _named(atom.left)
            yield from _named(atom.right)
        else:
            yield from _subjects(atom, ontology)


def _subjects(atom: Relation, ontology: Ontology) -> Iterator[str]:
    """The objects that a fact says something of: the first; of a symmetric relation, all."""
    relation = ontology.relations.get(atom.relation)
    said = atom.arguments if relation is not None and relation.symmetric else atom.arguments[:1]
    yield from (argument.name for argument in said if isinstance(argument, Name))


def _named(term: Term) -> Iterator[str]:
    """The objects whose values a term is made of."""
    for inner in terms(term):
        match inner:
            case Attribute(Name(name)):
                yield name
            case Call(_, arguments):
                yield from (argument.name for argument in arguments if isinstance(argument, Name))
