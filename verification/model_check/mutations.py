"""Checks the check: alters each entry of the tables and each rule in turn, and tests whether a property is violated.

A mutation that violates no property needs an explanation in `EXPLANATIONS`. Without one it shows a gap in the properties, or an entry of
the tables that is not needed.
"""

from __future__ import annotations

import contextlib
import multiprocessing
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from somrs.protocol.frp import states
from somrs.protocol.frp.states import Kind
from somrs.protocol.messages.frp import Completed, Failed, State, Stopped, Stranded
from verification.model_check.explanations import EXPLANATIONS, UNUSED_ENTRY
from verification.model_check.explore import StateSpace, explore
from verification.model_check.media import DUPLICATING, FIFO, UNORDERED, UNORDERED_LOSSY
from verification.model_check.pair import explore_pair
from verification.model_check.property import Property
from verification.model_check.quotient import quotient
from verification.model_check.rules import RULES
from verification.model_check.step import StepKind
from verification.model_check.system import Link, LostDisk, Model

MAX_STATES = 120_000
"""The limit on the states with altered tables. Parts beyond it count as infinite."""

SIDES = ("PARTICIPANT", "COORDINATOR")
RULE_TABLE = "RULES"
SENDS = ("PARTICIPANT_SENDS", "COORDINATOR_SENDS")


@dataclass(frozen=True, order=True)
class Mutation:
    """An alteration of one entry. `change` is `ignored`, `unanswered`, or the name of the new state or message.

    In the table `RULES`, `state` is the name of a rule of the Task Manager, and `change` that of the wrong rule in its place.
    """

    table: str
    state: str
    message: str
    change: str

    def __str__(self) -> str:
        entry = f"{self.state}: {self.message}" if self.message else self.state
        return f"{self.table} {entry}, {self.change}"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The result of one mutation: the property and configuration that caught it, or empty; and its explanation, or empty."""

    mutation: Mutation
    caught_by: str
    explanation: str
    is_exercised: bool = True
    """Whether some configuration uses the entry."""

    @property
    def misexplained(self) -> bool:
        """Whether the explanation is wrong: the mutation is caught, or the entry is used and explained as unused, or the reverse."""
        if not self.explanation:
            return False
        return bool(self.caught_by) or self.explanation.startswith(UNUSED_ENTRY) is self.is_exercised


def all_mutations() -> list[Mutation]:
    """Return all mutations. An entry that moves or answers is ignored, unanswered, or leads to the end. A message that a side may send is
    not allowed, or leads to the end. The other tables lose or change each state. Each rule is replaced by wrong ones."""
    mutations = []
    for table in SIDES:
        for state, row in getattr(states, table).items():
            for message, entry in row.items():
                name = message.__name__
                if entry.kind is Kind.MOVES or entry.answer is not None:
                    mutations.append(Mutation(table, state, name, "ignored"))
                if entry.kind is Kind.MOVES and entry.answer is not None:
                    mutations.append(Mutation(table, state, name, "unanswered"))
                if entry.kind is Kind.MOVES and entry.next_state is not State.ENDED:
                    mutations.append(Mutation(table, state, name, "Ended"))
    for table in SENDS:
        for state, sends in getattr(states, table).items():
            for message, target in sends.items():
                mutations.append(Mutation(table, state, message.__name__, "ignored"))
                if target is not State.ENDED:
                    mutations.append(Mutation(table, state, message.__name__, "Ended"))
    for state, target in states.ABANDONED_STATES.items():
        mutations.append(Mutation("ABANDONED_STATES", state, "", "ignored"))
        mutations += [
            Mutation("ABANDONED_STATES", state, "", replacement) for replacement in (State.FAILED, State.ENDED) if replacement is not target
        ]
    mutations += [Mutation("UNBEGUN", state, "", "ignored") for state in states.UNBEGUN]
    for state, report in states.RESUMES.items():
        mutations.append(Mutation("RESUMES", state, "", "ignored"))
        mutations += [
            Mutation("RESUMES", state, "", kind.__name__) for kind in (Completed, Failed, Stopped, Stranded) if kind is not report
        ]
    mutations += [Mutation("HOLDING_STATES", state, "", "ignored") for state in sorted(states.HOLDING_STATES)]
    return mutations + [Mutation(RULE_TABLE, name, "", change) for name, rule in RULES.items() for change in rule.changes]


@contextlib.contextmanager
def altered(mutation: Mutation) -> Iterator[None]:
    """A context in which the entry, or the rule, is altered."""
    if mutation.table == RULE_TABLE:
        with RULES[mutation.state].altered(mutation.change):
            yield
        return
    table: Any = getattr(states, mutation.table)
    state = State(mutation.state)
    if mutation.table == "HOLDING_STATES":
        setattr(states, "HOLDING_STATES", table - {state})  # noqa: B010  # a constant everywhere else
        restored: Any = table
        try:
            yield
        finally:
            setattr(states, "HOLDING_STATES", restored)  # noqa: B010
        return
    owner, key = (table[state], _named(table[state], mutation.message)) if mutation.message else (table, state)
    order, original = list(owner.items()), owner[key]
    if mutation.table in SIDES:
        owner[key] = _entry(original, state, mutation.change)
    elif mutation.change == "ignored":
        del owner[key]
    elif mutation.table == "RESUMES":
        owner[key] = next(kind for kind in (Completed, Failed, Stopped, Stranded) if kind.__name__ == mutation.change)
    else:
        owner[key] = State(mutation.change)
    try:
        yield
    finally:
        owner.clear()
        owner.update(order)


def _named(owner: dict[type[object], object], name: str) -> type[object]:
    return next(kind for kind in owner if kind.__name__ == name)


def _entry(entry: states.Entry, state: State, change: str) -> states.Entry:
    if change == "ignored":
        return states.Entry(Kind.LATE, state)
    return entry._replace(answer=None) if change == "unanswered" else entry._replace(next_state=State(change))


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A configuration in which altered tables are checked. The fastest ones come first."""

    name: str
    model: Model
    two_participants: bool = False

    def part(self) -> StateSpace:
        return explore(Link(self.model), single_participant=not self.two_participants, stop_at_first=True, max_states=MAX_STATES)

    def violated_property(self) -> str:
        """Return a property that is violated, or an empty string."""
        part = self.part()
        if part.violations:
            return next(iter(part.violations))
        if self.two_participants:
            return next(iter(explore_pair(quotient(part), stop_at_first=True).violations), "")
        if self.model.restarts:
            calm = explore(Link(replace(self.model, restarts=False)), single_participant=True, stop_at_first=True, max_states=MAX_STATES)
            return Property.RESTART if part.outcomes - calm.outcomes else ""
        return ""


TRIALS = (
    *(
        Trial(name=f"1 participant, {medium.name}", model=Model(medium=medium, lapses=True))
        for medium in (DUPLICATING, FIFO, UNORDERED_LOSSY, UNORDERED)
    ),
    *(
        Trial(name=f"{lost_disk.value} disk lost, {medium.name}", model=Model(medium=medium, restarts=False, lost_disk=lost_disk))
        for medium, lost_disk in ((FIFO, LostDisk.COORDINATOR), (UNORDERED, LostDisk.COORDINATOR), (FIFO, LostDisk.PARTICIPANT))
    ),
    Trial(name=f"2 participants, {DUPLICATING.name}", model=Model(medium=DUPLICATING), two_participants=True),
    *(
        Trial(name=f"{kind}, {medium.name}", model=Model(medium=medium, lapses=True, kind=kind))
        for kind, medium in (
            (StepKind.RECOGNITION, DUPLICATING),
            (StepKind.NOT_NOW, DUPLICATING),
            (StepKind.WHILE, DUPLICATING),
            (StepKind.CONDITIONAL, FIFO),
        )
    ),
)

Entry = tuple[str, str, str]
"""A table, a state and, in tables of messages, a message."""


def used_entries(trial: Trial) -> frozenset[Entry]:
    """Return the entries that the unaltered tables use in this configuration."""
    link = trial.part().link
    sides = (("PARTICIPANT", link.participants), ("COORDINATOR", link.coordinators))
    entries = {
        (table, str(side.states[state_number].session.state), side.inbox.name(token))
        for table, side in sides
        for state_number, token in side.reactions
    }
    for table, side in sides:
        for state in {side_state.session.state for side_state in side.states}:
            entries |= {(f"{table}_SENDS", state, message.__name__) for message in getattr(states, f"{table}_SENDS").get(state, {})}
            entries |= {(other_table, state, "") for other_table in ("ABANDONED_STATES", "RESUMES", "HOLDING_STATES", "UNBEGUN")}
    entries |= {(RULE_TABLE, name, "") for name, rule in RULES.items() if trial.model.kind in rule.kinds}
    return frozenset(entries)


def find_violation(mutation: Mutation, trials: Iterable[Trial] = TRIALS) -> str:
    """Return the property and the configuration in which it is violated, or an empty string."""
    with altered(mutation):
        for trial in trials:
            if violated := trial.violated_property():
                return f"{violated} ({trial.name})"
    return ""


def judge(mutation: Mutation, trials: Sequence[Trial] = TRIALS) -> Verdict:
    explanation = EXPLANATIONS.get((mutation.table, mutation.state, mutation.message, mutation.change), "")
    return Verdict(mutation=mutation, caught_by=find_violation(mutation, trials), explanation=explanation, is_exercised=bool(trials))


def judge_all(mutations: Sequence[Mutation], processes: int) -> Iterator[Verdict]:
    """Yield the verdicts in order. Each mutation is tried in the configurations in which the unaltered tables use its entry."""
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        trial_entries = list(zip(TRIALS, pool.map(used_entries, TRIALS, chunksize=1), strict=True))
        jobs = [
            (mutation, [trial for trial, entries in trial_entries if (mutation.table, mutation.state, mutation.message) in entries])
            for mutation in mutations
        ]
        yield from pool.imap(_judge_job, jobs)


def _judge_job(job: tuple[Mutation, list[Trial]]) -> Verdict:
    return judge(*job)
