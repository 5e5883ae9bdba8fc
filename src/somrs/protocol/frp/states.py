"""The Failure Recovery Protocol as tables: what each side does about each message in each state, and what it may say.

Plain data, complete: no pair of state and message is left to chance. `session.py` plays the tables, `diagram.py` draws
them, and the tests walk through all of them. Nothing here knows bodies, ids or time.

Media lose, reorder and repeat messages. Three facts keep the tables small all the same:
- each side only ever moves forward, so that a repeated message finds its state left behind;
- nodes repeat a message until the other node has acknowledged it, so Accept, Cancel and End need no answer of their own;
- whatever a late message could start is closed by the message that overtook it (a Cancel before its Arrange ends).
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from somrs.protocol.messages.frp import (
    Accept,
    Arrange,
    Cancel,
    Compensate,
    Compensated,
    Completed,
    End,
    Execute,
    Failed,
    Fault,
    Progress,
    Query,
    Refuse,
    State,
    Status,
    Stop,
    Stopped,
    Stranded,
    Terms,
)

Said = type[object]
"""A type of message: the class of its body."""


class Kind(Enum):
    """What a message is to the state it meets."""

    MOVES = "moves"
    """News: the state changes, or something is learned in it."""
    ALREADY = "already done: answer again"
    LATE = "too late: ignore"


class Entry(NamedTuple):
    """What to do about a message: the state to be in then, and the type of message to answer with at once."""

    kind: Kind
    next: State
    send: Said | None = None


Table = dict[State, dict[Said, Entry]]
Sends = dict[State, dict[Said, State]]
Row = dict[Said, Entry | None]

NEW, ARRANGING, OFFERED, COMMITTED, EXECUTING = State.NEW, State.ARRANGING, State.OFFERED, State.COMMITTED, State.EXECUTING
COMPLETED, FAILED, STOPPING, STOPPED = State.COMPLETED, State.FAILED, State.STOPPING, State.STOPPED
COMPENSATING, COMPENSATED, STRANDED = State.COMPENSATING, State.COMPENSATED, State.STRANDED
ENDED, UNREACHABLE = State.ENDED, State.UNREACHABLE

TO_PARTICIPANT: tuple[Said, ...] = (Arrange, Accept, Cancel, Execute, Stop, Compensate, Query, End, Fault)
TO_COORDINATOR: tuple[Said, ...] = (Terms, Refuse, Progress, Completed, Failed, Stopped, Compensated, Stranded, Status, Fault)

PARTICIPANT_STATES = tuple(state for state in State if state is not UNREACHABLE)
COORDINATOR_STATES = tuple(State)


def to(state: State, send: Said | None = None) -> Entry:
    return Entry(Kind.MOVES, state, send)


def again(send: Said | None = None) -> Entry:
    return Entry(Kind.ALREADY, NEW, send)


def late(send: Said | None = None) -> Entry:
    return Entry(Kind.LATE, NEW, send)


def _complete(states: tuple[State, ...], messages: tuple[Said, ...], rows: dict[State, dict[Said, Entry]]) -> Table:
    """Every pair. What a row leaves out is too late; what does not move stays in the row's state."""
    found = {state: {message: rows[state].get(message, late()) for message in messages} for state in states}
    return {
        state: {message: entry if entry.kind is Kind.MOVES else entry._replace(next=state) for message, entry in row.items()}
        for state, row in found.items()
    }


# In every state a participant says its state when asked, and is over on End, or on Cancel: if it is executing, it stops.
_ALWAYS: dict[Said, Entry] = {Query: again(Status), Cancel: to(ENDED), End: to(ENDED)}
# Work, or undoing, is demanded of a participant that has no contract, such as one that lost its memory: it says so.
_NO_CONTRACT: dict[Said, Entry] = {
    **_ALWAYS, Accept: to(FAILED, Failed), Execute: to(FAILED, Failed), Stop: to(FAILED, Failed), Compensate: to(STRANDED, Stranded),
}  # fmt: skip

# fmt: off
PARTICIPANT: Table = _complete(PARTICIPANT_STATES, TO_PARTICIPANT, {
    NEW:          {**_NO_CONTRACT, Arrange: to(ARRANGING)},
    ARRANGING:    {**_NO_CONTRACT, Arrange: again()},
    # An Execute names the Terms, as an Accept does: it may overtake it. A Stop may overtake both, and then nothing starts.
    OFFERED:      {**_ALWAYS, Arrange: again(Terms), Accept: to(COMMITTED), Execute: to(EXECUTING), Stop: to(STOPPED, Stopped),
                   Compensate: to(STRANDED, Stranded)},
    COMMITTED:    {**_ALWAYS, Accept: again(), Execute: to(EXECUTING), Stop: to(STOPPED, Stopped), Compensate: to(STRANDED, Stranded)},
    EXECUTING:    {**_ALWAYS, Accept: again(), Execute: again(), Stop: to(STOPPING), Compensate: late(Fault)},
    COMPLETED:    {**_ALWAYS, Execute: again(Completed), Stop: again(Completed), Compensate: to(COMPENSATING)},
    FAILED:       {**_ALWAYS, Execute: again(Failed), Stop: again(Failed), Compensate: to(COMPENSATING)},
    STOPPING:     {**_ALWAYS, Stop: again(), Compensate: late(Fault)},
    STOPPED:      {**_ALWAYS, Stop: again(Stopped), Compensate: to(COMPENSATING)},
    COMPENSATING: {**_ALWAYS, Compensate: again()},
    COMPENSATED:  {**_ALWAYS, Compensate: again(Compensated)},
    STRANDED:     {**_ALWAYS, Compensate: again(Stranded)},
    ENDED:        {Query: again(Status), Cancel: again(), End: again()},
})

# What a participant may say of its own accord. Refuse when Offered: the terms expired. Failed when Committed: it broke before
# the start. Either, and Stranded when Compensating: the order to begin came too late. Completed when Stopping: it was quicker.
# Stopped when Executing: it was cut off, or a person stopped it.
PARTICIPANT_SENDS: Sends = {
    ARRANGING:    {Terms: OFFERED, Refuse: ENDED},
    OFFERED:      {Refuse: ENDED},
    COMMITTED:    {Failed: FAILED},
    EXECUTING:    {Progress: EXECUTING, Completed: COMPLETED, Failed: FAILED, Stopped: STOPPED},
    STOPPING:     {Progress: STOPPING, Completed: COMPLETED, Failed: FAILED, Stopped: STOPPED},
    COMPENSATING: {Progress: COMPENSATING, Compensated: COMPENSATED, Stranded: STRANDED},
}

# Whoever works, or reports work, without a contract is sent home.
_UNKNOWN: dict[Said, Entry] = {
    Progress: to(ENDED, End), Completed: to(ENDED, End), Failed: to(ENDED, End), Stopped: to(ENDED, End),
    Compensated: to(ENDED, End), Stranded: to(ENDED, End),
}
# An answer to anyone who has not heard that it is over.
_OVER: dict[Said, Entry] = dict.fromkeys((Terms, Progress, Completed, Failed, Stopped, Compensated, Stranded), again(End))

COORDINATOR: Table = _complete(COORDINATOR_STATES, TO_COORDINATOR, {
    NEW:          {**_UNKNOWN, Terms: to(ENDED, Cancel)},
    ARRANGING:    {**_UNKNOWN, Terms: to(OFFERED), Refuse: to(ENDED), Fault: to(ENDED, Cancel), Status: again()},
    OFFERED:      {**_UNKNOWN, Terms: again(), Refuse: to(ENDED), Fault: to(ENDED, Cancel), Status: again()},
    # Refuse from here on: the terms had expired before the Accept came, and nothing was or will be started.
    COMMITTED:    {Terms: again(), Refuse: to(ENDED), Failed: to(FAILED), Status: again(), Fault: to(FAILED)},
    EXECUTING:    {Refuse: to(ENDED), Progress: to(EXECUTING), Completed: to(COMPLETED), Failed: to(FAILED), Stopped: to(STOPPED),
                   Status: again(), Fault: to(FAILED)},
    COMPLETED:    {Completed: again(), Status: again()},
    FAILED:       {Failed: again(), Status: again()},
    # Completed, Failed: they crossed the Stop.
    STOPPING:     {Refuse: to(ENDED), Progress: to(STOPPING), Completed: to(COMPLETED), Failed: to(FAILED), Stopped: to(STOPPED),
                   Status: again()},
    STOPPED:      {Stopped: again(), Status: again()},
    COMPENSATING: {Progress: to(COMPENSATING), Compensated: to(COMPENSATED), Stranded: to(STRANDED), Status: again(),
                   Fault: to(STRANDED)},
    COMPENSATED:  {Compensated: again(), Status: again()},
    # Compensated: it had been silent for too long.
    STRANDED:     {Compensated: to(COMPENSATED), Stranded: again(), Status: again()},
    ENDED:        _OVER,
    # One that was given up came back. Its step may be another's by now, so if it works it must stop; its report is the truth.
    UNREACHABLE:  {Refuse: to(ENDED), Progress: to(STOPPING, Stop), Completed: to(COMPLETED), Failed: to(FAILED), Stopped: to(STOPPED),
                   Status: again()},
})

# What a coordinator may say of its own accord; Query besides, once it has said anything. Execute when Executing, Compensate when
# Compensating: it was not reached in time by the one before.
COORDINATOR_SENDS: Sends = {
    NEW:          {Arrange: ARRANGING},
    ARRANGING:    {Cancel: ENDED},
    OFFERED:      {Accept: COMMITTED, Cancel: ENDED},
    COMMITTED:    {Execute: EXECUTING, Cancel: ENDED, End: ENDED},
    EXECUTING:    {Execute: EXECUTING, Stop: STOPPING},
    COMPLETED:    {Compensate: COMPENSATING, End: ENDED},
    FAILED:       {Compensate: COMPENSATING, End: ENDED},
    STOPPED:      {Compensate: COMPENSATING, End: ENDED},
    COMPENSATING: {Compensate: COMPENSATING},
    COMPENSATED:  {End: ENDED},
    STRANDED:     {End: ENDED},
    UNREACHABLE:  {End: ENDED},
}
# fmt: on

GIVES_UP: dict[State, State] = {**dict.fromkeys((COMMITTED, EXECUTING, STOPPING), UNREACHABLE), COMPENSATING: STRANDED}
"""The coordinator's move, in the states in which it waits for a participant with a contract, when that one stays silent.

An undoing of which nothing is heard counts as one that failed. Were it Unreachable, a late sign of life from the work before would
have it told to stop, and it would be waited for, although it may never have begun to undo."""

CONTRACTED = frozenset((COMMITTED, EXECUTING, STOPPING, COMPENSATING, UNREACHABLE))
"""The coordinator's states in which a participant owes it something."""

WORKING = frozenset((EXECUTING, STOPPING, COMPENSATING))
"""The states in which a participant's device may be moving."""

HOLDS = frozenset((COMMITTED, EXECUTING, STOPPING, COMPENSATING))
"""The coordinator's states in which the step is this participant's. While one is in them, no other is accepted for the step."""

RESUMES: dict[State, Said] = {EXECUTING: Failed, STOPPING: Stopped, COMPENSATING: Stranded}
"""What a participant reports that was restarted, or could reach nobody, in the middle of its work, once its device is in a safe
state."""
