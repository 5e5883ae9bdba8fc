"""Checks the check: alters each entry of the tables in turn, and sees whether any property falls.

What no property notices is either explained, in `EXPLANATIONS`, or a hole: in the properties, or in the tables, which then say more
than is needed.
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
from verification.model_check.explanations import EXPLANATIONS, NEVER_MET
from verification.model_check.explore import Space, explore
from verification.model_check.media import DUPLICATING, FIFO, UNORDERED, UNORDERED_LOSSY
from verification.model_check.pair import explore_pair
from verification.model_check.properties import Property
from verification.model_check.quotient import quotient
from verification.model_check.system import Link, Lost, Model

MOST_STATES = 120_000
"""Altered tables that lead to more than this go on for ever."""

SIDES = ("PARTICIPANT", "COORDINATOR")
SENDS = ("PARTICIPANT_SENDS", "COORDINATOR_SENDS")


@dataclass(frozen=True, order=True)
class Mutation:
    """One alteration of one entry. `how`: `ignored`, `unanswered`, or the name of a state or message that it has instead."""

    table: str
    state: str
    message: str
    how: str

    def __str__(self) -> str:
        entry = f"{self.state}: {self.message}" if self.message else self.state
        return f"{self.table} {entry}, {self.how}"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Where and how it was noticed, or empty; and the explanation kept for it, or empty."""

    mutation: Mutation
    caught_by: str
    explanation: str
    met: bool = True
    """Some configuration uses the entry."""

    @property
    def misexplained(self) -> bool:
        """It is noticed after all, or an entry is used that is said to be never met, or the other way round."""
        if not self.explanation:
            return False
        return bool(self.caught_by) or self.explanation.startswith(NEVER_MET) is self.met


def all_mutations() -> list[Mutation]:
    """Each entry that moves or answers, left out, without its answer, and leading home at once; each thing that may be said, left out
    and leading home at once; each state in the other tables."""
    found = []
    for table in SIDES:
        for state, row in getattr(states, table).items():
            for message, entry in row.items():
                name = message.__name__
                if entry.kind is Kind.MOVES or entry.send is not None:
                    found.append(Mutation(table, state, name, "ignored"))
                if entry.kind is Kind.MOVES and entry.send is not None:
                    found.append(Mutation(table, state, name, "unanswered"))
                if entry.kind is Kind.MOVES and entry.next is not State.ENDED:
                    found.append(Mutation(table, state, name, "Ended"))
    for table in SENDS:
        for state, sends in getattr(states, table).items():
            for message, after in sends.items():
                found.append(Mutation(table, state, message.__name__, "ignored"))
                if after is not State.ENDED:
                    found.append(Mutation(table, state, message.__name__, "Ended"))
    for state, after in states.ABANDONED_STATES.items():
        found.append(Mutation("GIVES_UP", state, "", "ignored"))
        found += [Mutation("GIVES_UP", state, "", to) for to in (State.FAILED, State.ENDED) if to is not after]
    for state, report in states.RESUMES.items():
        found.append(Mutation("RESUMES", state, "", "ignored"))
        found += [Mutation("RESUMES", state, "", kind.__name__) for kind in (Completed, Failed, Stopped, Stranded) if kind is not report]
    found += [Mutation("HOLDS", state, "", "ignored") for state in sorted(states.HOLDING_STATES)]
    return found


@contextlib.contextmanager
def altered(mutation: Mutation) -> Iterator[None]:
    """With the entry altered."""
    table: Any = getattr(states, mutation.table)
    state = State(mutation.state)
    if mutation.table == "HOLDS":
        setattr(states, "HOLDS", table - {state})  # noqa: B010  # it is a constant to everybody else
        restored: Any = table
        try:
            yield
        finally:
            setattr(states, "HOLDS", restored)  # noqa: B010
        return
    owner, key = (table[state], _named(table[state], mutation.message)) if mutation.message else (table, state)
    order, before = list(owner.items()), owner[key]
    if mutation.table in SIDES:
        owner[key] = _entry(before, state, mutation.how)
    elif mutation.how == "ignored":
        del owner[key]
    elif mutation.table == "RESUMES":
        owner[key] = next(kind for kind in (Completed, Failed, Stopped, Stranded) if kind.__name__ == mutation.how)
    else:
        owner[key] = State(mutation.how)
    try:
        yield
    finally:
        owner.clear()
        owner.update(order)


def _named(owner: dict[type[object], object], name: str) -> type[object]:
    return next(kind for kind in owner if kind.__name__ == name)


def _entry(entry: states.Entry, state: State, how: str) -> states.Entry:
    if how == "ignored":
        return states.Entry(Kind.LATE, state)
    return entry._replace(send=None) if how == "unanswered" else entry._replace(next=State(how))


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A configuration that altered tables are tried on, the quickest first."""

    name: str
    model: Model
    two: bool = False

    def part(self) -> Space:
        return explore(Link(self.model), alone=not self.two, hasty=True, most=MOST_STATES)

    def falls(self) -> str:
        """A property that falls, or nothing."""
        part = self.part()
        if part.falls:
            return next(iter(part.falls))
        if self.two:
            return next(iter(explore_pair(quotient(part), hasty=True).falls), "")
        if self.model.restarts:
            calm = explore(Link(replace(self.model, restarts=False)), alone=True, hasty=True, most=MOST_STATES)
            return Property.RESTART if part.outcomes - calm.outcomes else ""
        return ""


TRIALS = (
    *(
        Trial(name=f"1 participant, {medium.name}", model=Model(medium=medium, lapses=True))
        for medium in (DUPLICATING, FIFO, UNORDERED_LOSSY, UNORDERED)
    ),
    *(
        Trial(name=f"{whose.value} disk lost, {medium.name}", model=Model(medium=medium, restarts=False, lost_disk=whose))
        for medium, whose in ((FIFO, Lost.COORDINATOR), (UNORDERED, Lost.COORDINATOR), (FIFO, Lost.PARTICIPANT))
    ),
    Trial(name=f"2 participants, {DUPLICATING.name}", model=Model(medium=DUPLICATING), two=True),
)

Entry = tuple[str, str, str]
"""A table, a state and, in the tables that have it, a message."""


def used(trial: Trial) -> frozenset[Entry]:
    """The entries that the tables as they are use in it."""
    link = trial.part().link
    sides = (("PARTICIPANT", link.participants), ("COORDINATOR", link.coordinators))
    found = {(table, str(side.states[at].session.state), side.hears.name(token)) for table, side in sides for at, token in side.heard}
    for table, side in sides:
        for state in {one.session.state for one in side.states}:
            found |= {(f"{table}_SENDS", state, message.__name__) for message in getattr(states, f"{table}_SENDS").get(state, {})}
            found |= {(other, state, "") for other in ("GIVES_UP", "RESUMES", "HOLDS")}
    return frozenset(found)


def noticed(mutation: Mutation, trials: Iterable[Trial] = TRIALS) -> str:
    """Where and by which property; empty when by none."""
    with altered(mutation):
        for trial in trials:
            if found := trial.falls():
                return f"{found} ({trial.name})"
    return ""


def judge(mutation: Mutation, trials: Sequence[Trial] = TRIALS) -> Verdict:
    explanation = EXPLANATIONS.get((mutation.table, mutation.state, mutation.message, mutation.how), "")
    return Verdict(mutation=mutation, caught_by=noticed(mutation, trials), explanation=explanation, met=bool(trials))


def try_all(mutations: Sequence[Mutation], processes: int) -> Iterator[Verdict]:
    """The verdicts, in order, as they come in. Each is tried where the tables as they are use its entry."""
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        uses = list(zip(TRIALS, pool.map(used, TRIALS, chunksize=1), strict=True))
        wanted = [(one, [trial for trial, entries in uses if (one.table, one.state, one.message) in entries]) for one in mutations]
        yield from pool.imap(_judged, wanted)


def _judged(wanted: tuple[Mutation, list[Trial]]) -> Verdict:
    return judge(*wanted)
