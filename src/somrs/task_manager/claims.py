"""What tasks that are under way have to themselves, so that none is planned on what another was promised.

From the moment when a task takes a plan until it ends, nobody else changes what its plan changes or relies on, and nobody relies on what
it changes: that may be another way by then. Who needs something that another has waits until that one has ended. Whoever waits has
nothing, not even what it had before, so nobody waits for one that waits for it; of those that wait, the one with the highest priority
comes first, then the one that was submitted first. What is under way is not interrupted, whatever the priority of those that wait for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Not, Relation, Term
from somrs.entish.formula import alternatives, literals, terms
from somrs.ontology.types import Ontology
from somrs.planner.model.plan import Plan, Step

Then = Callable[[float], None]
"""Called once what is waited for is free."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """The objects that a plan changes, and those that have to stay as they are for it."""

    changes: frozenset[str] = frozenset()
    relies: frozenset[str] = frozenset()

    def __or__(self, other: Claim) -> Claim:
        return Claim(changes=self.changes | other.changes, relies=self.relies | other.relies)

    def meets(self, other: Claim) -> frozenset[str]:
        """What both cannot have."""
        return self.changes & (other.changes | other.relies) | self.relies & other.changes


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """There is a plan, but others have what it needs: who, and which of the objects."""

    claim: Claim
    by: dict[str, frozenset[str]]
    plan: Plan

    @property
    def objects(self) -> str:
        return ", ".join(sorted(frozenset[str]().union(*self.by.values())))

    def in_words(self, claims: Claims) -> str:
        who = " and ".join(f"task {task} ({claims.wish(task)})" for task in self.by)
        return f"waiting for {who} to end, which {'has' if len(self.by) == 1 else 'have'} {self.objects}"


@dataclass(slots=True)
class _Waiting:
    claim: Claim
    then: Then | None
    """None: it was called, and makes its plan; until it has that, its claim is respected by whoever comes behind it."""


@dataclass(slots=True)
class Claims:
    """Of all tasks that are under way, by task."""

    _wishes: dict[str, str] = field(default_factory=dict)
    """What each wants, in the order in which they come first: by priority, and then as they were submitted."""
    _priorities: dict[str, int] = field(default_factory=dict)
    _held: dict[str, Claim] = field(default_factory=dict)
    _waiting: dict[str, _Waiting] = field(default_factory=dict)
    _freed: bool = False
    """Something is free that was not when it was looked last."""

    def enter(self, task: str, wish: str, priority: int = 0) -> None:
        """The task was submitted."""
        behind = [other for other in reversed(self._wishes) if self._priorities[other] < priority]
        self._wishes[task], self._priorities[task] = wish, priority
        for other in reversed(behind):
            self._wishes[other] = self._wishes.pop(other)

    def leave(self, task: str) -> None:
        """It is over."""
        self._wishes.pop(task, None)
        self._priorities.pop(task, None)
        self._held.pop(task, None)
        self._waiting.pop(task, None)
        self._freed = True

    def wish(self, task: str) -> str:
        return self._wishes.get(task, "")

    def conflicts(self, task: str, claim: Claim) -> dict[str, frozenset[str]]:
        """Who has what the claim asks for, or waits for it and comes first; empty when it can be had."""
        return {other: met for other, its in self._before(task) if (met := claim.meets(its))}

    def holders(self, task: str, claim: Claim) -> list[str]:
        """Who else has any of it, whoever waits for it."""
        return [other for other, its in self._held.items() if other != task and claim.meets(its)]

    def taken(self, task: str) -> frozenset[str]:
        """The objects that others change."""
        return frozenset(name for _, its in self._before(task) for name in its.changes)

    def _before(self, task: str) -> Iterator[tuple[str, Claim]]:
        yield from ((other, claim) for other, claim in self._held.items() if other != task)
        for other in self._wishes:
            if other == task:
                return
            if (waiting := self._waiting.get(other)) is not None:
                yield other, waiting.claim

    def hold(self, task: str, claim: Claim) -> None:
        """The task has this from now on, and what it had before: that may have to be undone."""
        self._held[task] = self._held.get(task, Claim()) | claim
        self._waiting.pop(task, None)

    def wait(self, task: str, claim: Claim, then: Then) -> None:
        """The task gives up what it has, and waits for this."""
        self._held.pop(task, None)
        self._waiting[task] = _Waiting(claim, then)
        self._freed = True

    def forget(self, task: str) -> None:
        """It does not wait any more."""
        if self._waiting.pop(task, None) is not None:
            self._freed = True

    def wake(self, now: float) -> None:
        """Let those go on that wait for nobody any more."""
        while self._freed:
            self._freed = False
            for task in [task for task in self._wishes if task in self._waiting]:
                waiting = self._waiting.get(task)
                if waiting is not None and waiting.then is not None and not self.conflicts(task, waiting.claim):
                    then, waiting.then = waiting.then, None
                    then(now)


def claim(steps: Iterable[Step], goal: Formula, ontology: Ontology) -> Claim:
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
    return Claim(changes=frozenset(changes), relies=frozenset(relies - changes))


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
