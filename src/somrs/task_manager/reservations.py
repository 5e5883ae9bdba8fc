"""The objects that running tasks have reserved.

A task reserves the objects that its plan changes or relies on, from the moment it takes the plan until it ends. No other task changes
these objects, or relies on an object that the plan changes. A task that needs a reserved object waits until the other task has ended. A
waiting task holds no reservation, not even an earlier one, so tasks cannot deadlock. Among waiting tasks, the one with the highest priority
comes first, then the one that was submitted first. A task that holds a reservation is not interrupted, whatever the priority of others.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping

from msgspec import Struct, field

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Not, Relation, Term
from somrs.entish.formula import alternatives, literals, terms
from somrs.ontology.services import ServiceKind
from somrs.ontology.types import Ontology
from somrs.planner.model.plan import Plan, Step
from somrs.protocol.messages.waits import Holder


class Reservation(Struct, frozen=True, kw_only=True):
    """The objects that a plan changes, and the other objects that it relies on."""

    changes: frozenset[str] = frozenset()
    relies_on: frozenset[str] = field(default=frozenset(), name="relies")

    def __or__(self, reservation: Reservation) -> Reservation:
        return Reservation(changes=self.changes | reservation.changes, relies_on=self.relies_on | reservation.relies_on)

    def renamed(self, names: Mapping[str, str]) -> Reservation:
        """The reservation with new names of objects."""
        changes = frozenset(names.get(name, name) for name in self.changes)
        return Reservation(changes=changes, relies_on=frozenset(names.get(name, name) for name in self.relies_on) - changes)

    def within(self, objects: Container[str]) -> Reservation:
        """The reservation of these objects only. A plan also names outputs, which no map has yet."""
        return Reservation(
            changes=frozenset(name for name in self.changes if name in objects),
            relies_on=frozenset(name for name in self.relies_on if name in objects),
        )

    def overlap(self, reservation: Reservation) -> frozenset[str]:
        """The objects on which the two reservations conflict."""
        return self.changes & (reservation.changes | reservation.relies_on) | self.relies_on & reservation.changes


class BlockedPlan(Struct, frozen=True, kw_only=True):
    """A plan that needs objects of other tasks: the `holders`, with the contested objects."""

    reservation: Reservation
    holders: tuple[Holder, ...]
    plan: Plan


class _Waiting(Struct):
    reservation: Reservation = field(name="wanted")
    admitted: bool = field(default=False, name="called")
    """The task is making its plan. Until it has one, tasks behind it respect the reservation that it waits for."""


class Reservations(Struct, kw_only=True):
    """The reservations of all running tasks, by task."""

    goals: dict[str, str] = {}
    """The goal of each task, in order of precedence: by priority, then by submission."""
    priorities: dict[str, int] = {}
    held: dict[str, Reservation] = {}
    waiting: dict[str, _Waiting] = field(default_factory=dict)
    freed: bool = False
    """Whether anything was freed since `admit_waiting` last checked."""

    def add_task(self, task: str, goal: str, priority: int = 0) -> None:
        """Register a submitted task."""
        later_tasks = [other_task for other_task in reversed(self.goals) if self.priorities[other_task] < priority]
        self.goals[task], self.priorities[task] = goal, priority
        for other_task in reversed(later_tasks):
            self.goals[other_task] = self.goals.pop(other_task)

    def remove_task(self, task: str) -> None:
        """Remove a task that has ended, with its reservations."""
        self.goals.pop(task, None)
        self.priorities.pop(task, None)
        self.held.pop(task, None)
        self.waiting.pop(task, None)
        self.freed = True

    def conflicts(self, task: str, reservation: Reservation) -> dict[str, frozenset[str]]:
        """The contested objects, by other task that holds them or waits for them with precedence; empty if there is no conflict."""
        return {
            other_task: contested_objects
            for other_task, other_reservation in self._prior_reservations(task)
            if (contested_objects := reservation.overlap(other_reservation))
        }

    def holders(self, task: str, reservation: Reservation) -> tuple[Holder, ...]:
        """The other tasks whose held reservations conflict with this one; waiting tasks do not count."""
        conflicts = {other_task: reservation.overlap(held) for other_task, held in self.held.items() if other_task != task}
        return self.describe({other_task: objects for other_task, objects in conflicts.items() if objects})

    def describe(self, conflicts: Mapping[str, frozenset[str]]) -> tuple[Holder, ...]:
        """The contested objects, by task, for clients."""
        return tuple(
            Holder(task=task, goal=self.goals.get(task, ""), objects=tuple(sorted(objects)), waiting=task not in self.held)
            for task, objects in conflicts.items()
        )

    def reserved_objects(self, task: str) -> frozenset[str]:
        """The objects that other tasks change, or wait to change with precedence."""
        return frozenset(name for _, other_reservation in self._prior_reservations(task) for name in other_reservation.changes)

    def _prior_reservations(self, task: str) -> Iterator[tuple[str, Reservation]]:
        yield from ((other_task, other_reservation) for other_task, other_reservation in self.held.items() if other_task != task)
        for other_task in self.goals:
            if other_task == task:
                return
            if (waiting := self.waiting.get(other_task)) is not None:
                yield other_task, waiting.reservation

    def hold(self, task: str, reservation: Reservation) -> None:
        """Reserve for the task. It keeps its earlier reservations, because that work may have to be undone."""
        self.held[task] = self.held.get(task, Reservation()) | reservation
        self.waiting.pop(task, None)

    def rename(self, task: str, names: Mapping[str, str], goal: str) -> None:
        """Give objects of the task the names that they have now. `goal`: its goal with these names."""
        self.goals[task] = goal
        if task in self.held:
            self.held[task] = self.held[task].renamed(names)
        if task in self.waiting:
            self.waiting[task].reservation = self.waiting[task].reservation.renamed(names)

    def wait(self, task: str, reservation: Reservation) -> None:
        """Release what the task holds, and let it wait for this reservation."""
        self.held.pop(task, None)
        self.waiting[task] = _Waiting(reservation)
        self.freed = True

    def release(self, task: str) -> None:
        """Release what the task holds."""
        if self.held.pop(task, None) is not None:
            self.freed = True

    def stop_waiting(self, task: str) -> None:
        """Remove the task from those that wait."""
        if self.waiting.pop(task, None) is not None:
            self.freed = True

    def admit_waiting(self) -> Iterator[str]:
        """The waiting tasks without conflicts, each once. The reservations may change between two of them."""
        while self.freed:
            self.freed = False
            for task in [task for task in self.goals if task in self.waiting]:
                waiting = self.waiting.get(task)
                if waiting is not None and not waiting.admitted and not self.conflicts(task, waiting.reservation):
                    waiting.admitted = True
                    yield task


def plan_reservation(steps: Iterable[Step], goal: Formula, ontology: Ontology) -> Reservation:
    """The objects that a plan changes and relies on. A service that only tells something changes nothing. A goal with OR adds none: it is
    not known which part will hold."""
    changes: set[str] = set()
    relies: set[str] = set()
    for step in steps:
        if step.kind is not ServiceKind.PHYSICAL:
            relies.update(_formula_objects(step.effect, ontology))
        for literal in literals(step.effect) if step.kind is ServiceKind.PHYSICAL else ():
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
    """The objects that a fact is about: its first argument, or all arguments of a symmetric relation."""
    relation = ontology.relations.get(atom.relation)
    subjects = atom.arguments if relation is not None and relation.symmetric else atom.arguments[:1]
    yield from (argument.name for argument in subjects if isinstance(argument, Name))


def _term_objects(term: Term) -> Iterator[str]:
    """The objects whose attributes a term uses."""
    for inner in terms(term):
        match inner:
            case Attribute(Name(name)):
                yield name
            case Call(_, arguments):
                yield from (argument.name for argument in arguments if isinstance(argument, Name))
