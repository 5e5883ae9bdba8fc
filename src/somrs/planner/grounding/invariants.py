"""Mutex groups: sets of facts of which at most one holds at a time, derived from the actions where the ontology does not define them.

A candidate is a set of relations, each with the argument places of the shared objects: `at(crate, .)`, `in(crate, .)` and
`lifting(., ., crate)`. A candidate is balanced if each action that adds such a fact deletes another such fact that it requires. An
unbalanced candidate is refined with one more relation (Helmert 2009, "Concise finite-domain representations for PDDL planning tasks").
Unlike there, any number of a fact's arguments may be free, because facts with agents often have two free arguments: the agent that lifts,
and its tool.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations, permutations

from somrs.planner.grounding.actions import Action
from somrs.planner.grounding.task import Task
from somrs.planner.model.operators import Operator
from somrs.planner.model.vocabulary import EXISTS_SUFFIX, Argument, Fact

CANDIDATES = 500
"""The maximum number of candidates."""
SHARED = 3
"""The maximum number of objects that the facts of a group share."""
RELATIONS = 5
"""The maximum number of relations of a candidate."""

Part = tuple[str, tuple[int, ...]]
"""A relation, and the argument places of the shared objects."""
Candidate = frozenset[Part]


@dataclass(frozen=True, slots=True)
class _Change:
    """The relevant effects of an action: added facts that it does not require, and required facts that it deletes."""

    add_effects: tuple[Fact, ...]
    delete_effects: tuple[Fact, ...]


def find_mutex_groups(task: Task) -> list[tuple[Fact, ...]]:
    """Sets of facts of the task; at most one fact of each set holds at any time."""
    facts: dict[str, list[Fact]] = {}
    for fact in task.place:
        if _counted(fact[0], task):
            facts.setdefault(fact[0], []).append(fact)
    mutex_groups: dict[tuple[Fact, ...], None] = {}
    for candidate in _balanced(list(_changes(task)), facts):
        instances: dict[tuple[Argument, ...], list[Fact]] = {}
        for predicate, places in sorted(candidate):
            for fact in facts.get(predicate, ()):
                instances.setdefault(_shared(fact, places), []).append(fact)
        for group in instances.values():
            if len(group) > 1 and sum(_holds_initially(fact, task) for fact in group) <= 1:
                mutex_groups[tuple(group)] = None
    return list(mutex_groups)


def _counted(predicate: str, task: Task) -> bool:
    """Whether the facts of the predicate may be in groups: not attributes, which have one value anyway, nor derived `EXISTS_SUFFIX` facts,
    nor symmetric relations."""
    return (
        predicate in task.vocabulary.ontology.relations
        and not predicate.endswith(EXISTS_SUFFIX)
        and not task.vocabulary.is_symmetric(predicate)
    )


def _holds_initially(fact: Fact, task: Task) -> bool:
    variable, value = task.place[fact]
    return task.initial[variable] == value


def _changes(task: Task) -> Iterator[_Change]:
    """The changes of actions, one for all actions of an operator that differ only in their objects: those with equal objects in the same
    places."""
    seen_signatures: set[tuple[Operator, tuple[int, ...]]] = set()
    constants: dict[Operator, list[Argument]] = {}
    for move in task.moves:
        action = move.action
        operator = action.operator
        if operator not in constants:
            patterns = (*operator.preconditions, *operator.add_effects, *operator.delete_effects)
            constants[operator] = [term for _, terms in patterns for term in terms if isinstance(term, str)]
        arguments = [*(action.binding[name] for name in operator.variables), *constants[operator]]
        first: dict[Argument, int] = {}
        alike = tuple(first.setdefault(argument, place) for place, argument in enumerate(arguments))
        if (operator, alike) not in seen_signatures:
            seen_signatures.add((operator, alike))
            yield _change(action, task)


def _change(action: Action, task: Task) -> _Change:
    replaced = {task.vocabulary.variable_of(fact): fact for fact in action.add_effects if task.vocabulary.variable_of(fact) is not None}
    displaced_facts = [fact for fact in action.preconditions if replaced.get(task.vocabulary.variable_of(fact), fact) != fact]
    deleted_facts = [
        fact
        for fact in dict.fromkeys((*action.delete_effects, *displaced_facts))
        if fact in action.preconditions and fact not in action.add_effects
    ]
    added_facts = [fact for fact in action.add_effects if fact not in action.preconditions]
    return _Change(
        tuple(fact for fact in added_facts if _counted(fact[0], task)),
        tuple(fact for fact in deleted_facts if _counted(fact[0], task)),
    )


def _balanced(changes: list[_Change], facts: dict[str, list[Fact]]) -> Iterator[Candidate]:
    """The balanced candidates: no action adds one of their facts without deleting another."""
    waiting: deque[Candidate] = deque()
    for predicate in sorted(facts):
        for count in range(min(SHARED, len(facts[predicate][0][1])) + 1):
            waiting.extend(frozenset({(predicate, places)}) for places in combinations(range(len(facts[predicate][0][1])), count))
    seen_candidates = set(waiting)
    while waiting:
        candidate = waiting.popleft()
        unbalanced = next((refinements for change in changes if (refinements := _unbalanced(candidate, change)) is not None), None)
        if unbalanced is None:
            yield candidate
            continue
        for part in unbalanced if len(candidate) < RELATIONS else ():
            larger = candidate | {part}
            if larger not in seen_candidates and len(seen_candidates) < CANDIDATES:
                seen_candidates.add(larger)
                waiting.append(larger)


def _unbalanced(candidate: Candidate, change: _Change) -> list[Part] | None:
    """The parts that may balance the candidate for the action; None if the action does not increase the number of facts that hold."""
    added_counts: dict[tuple[Argument, ...], int] = {}
    for shared in _members(candidate, change.add_effects):
        added_counts[shared] = added_counts.get(shared, 0) + 1
    for shared, count in added_counts.items():
        if count > 1:
            return []  # no further relation makes up for two facts at once
        if shared not in _members(candidate, change.delete_effects):
            return [
                part
                for fact in change.delete_effects
                for part in _parts(fact, shared)
                if all(part[0] != relation for relation, _ in candidate)
            ]
    return None


def _members(candidate: Candidate, facts: Iterable[Fact]) -> list[tuple[Argument, ...]]:
    return [_shared(fact, places) for fact in facts for predicate, places in candidate if predicate == fact[0]]


def _shared(fact: Fact, places: tuple[int, ...]) -> tuple[Argument, ...]:
    return tuple(fact[1][place] for place in places)


def _parts(fact: Fact, shared: tuple[Argument, ...]) -> Iterator[Part]:
    """The parts with which the fact shares the given objects."""
    for places in permutations(range(len(fact[1])), len(shared)):
        if _shared(fact, places) == shared:
            yield fact[0], places
