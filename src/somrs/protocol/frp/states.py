"""The Failure Recovery Protocol as tables: what each side does with each message in each state, and what it may send.

The tables are complete: they have an entry for each pair of state and message. `session.py` executes them, `diagram.py` draws them, and the
tests visit every entry. They contain no message contents, ids or times.

The network loses, repeats and reorders messages. Three rules keep the tables small:
- Each side only moves forward, so a repeated message meets a later state.
- Nodes repeat a message until the other node has acknowledged it, so Accept, Cancel and End need no answer.
- When a message overtakes another, the one that comes first settles what the later one could start (a Cancel before its Arrange ends the
  session).
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

MessageType = type[object]
"""A type of message: the class of its body."""


class Kind(Enum):
    """What a message means in the state in which it is received."""

    MOVES = "moves"
    """The state changes, or the message brings new information in the same state."""
    REPEATED = "already done: answer again"
    LATE = "too late: ignore"
    FOREIGN = "from somebody else than the other side of the session: refuse"
    """In no table: it depends on the sender, and not on the state."""


class Entry(NamedTuple):
    """What to do with a message: the next state, and the type of message to answer with at once."""

    kind: Kind
    next_state: State
    answer: MessageType | None = None


Table = dict[State, dict[MessageType, Entry]]
Sends = dict[State, dict[MessageType, State]]
Row = dict[MessageType, Entry | None]

NEW, ARRANGING, OFFERED, COMMITTED, EXECUTING = State.NEW, State.ARRANGING, State.OFFERED, State.COMMITTED, State.EXECUTING
COMPLETED, FAILED, STOPPING, STOPPED = State.COMPLETED, State.FAILED, State.STOPPING, State.STOPPED
COMPENSATING, COMPENSATED, STRANDED = State.COMPENSATING, State.COMPENSATED, State.STRANDED
ENDED, UNREACHABLE = State.ENDED, State.UNREACHABLE

TO_PARTICIPANT: tuple[MessageType, ...] = (Arrange, Accept, Cancel, Execute, Stop, Compensate, Query, End, Fault)
TO_COORDINATOR: tuple[MessageType, ...] = (Terms, Refuse, Progress, Completed, Failed, Stopped, Compensated, Stranded, Status, Fault)

PARTICIPANT_STATES = tuple(state for state in State if state is not UNREACHABLE)
COORDINATOR_STATES = tuple(State)


def move(state: State, send: MessageType | None = None) -> Entry:
    return Entry(Kind.MOVES, state, send)


def repeat(send: MessageType | None = None) -> Entry:
    return Entry(Kind.REPEATED, NEW, send)


def late(send: MessageType | None = None) -> Entry:
    return Entry(Kind.LATE, NEW, send)


def _complete(states: tuple[State, ...], messages: tuple[MessageType, ...], rows: dict[State, dict[MessageType, Entry]]) -> Table:
    """Complete the table. A pair that `rows` leaves out is too late; an entry that does not move keeps the state of its row."""
    full_rows = {state: {message: rows[state].get(message, late()) for message in messages} for state in states}
    return {
        state: {message: entry if entry.kind is Kind.MOVES else entry._replace(next_state=state) for message, entry in row.items()}
        for state, row in full_rows.items()
    }


# In every state a participant answers a Query, and ends on End or Cancel; if it is executing, it stops.
_ALWAYS: dict[MessageType, Entry] = {Query: repeat(Status), Cancel: move(ENDED), End: move(ENDED)}
# A participant without a contract, such as one that lost its data, reports this when it receives an order to work or to undo.
_NO_CONTRACT: dict[MessageType, Entry] = {
    **_ALWAYS, Accept: move(FAILED, Failed), Execute: move(FAILED, Failed), Stop: move(FAILED, Failed),
    Compensate: move(STRANDED, Stranded),
}  # fmt: skip

# fmt: off
PARTICIPANT: Table = _complete(PARTICIPANT_STATES, TO_PARTICIPANT, {
    NEW:          {**_NO_CONTRACT, Arrange: move(ARRANGING)},
    ARRANGING:    {**_NO_CONTRACT, Arrange: repeat()},
    # An Execute names the Terms, as an Accept does, so it may come first. A Stop may come before both; then nothing starts.
    OFFERED:      {**_ALWAYS, Arrange: repeat(Terms), Accept: move(COMMITTED), Execute: move(EXECUTING), Stop: move(STOPPED, Stopped),
                   Compensate: move(STRANDED, Stranded)},
    COMMITTED:    {**_ALWAYS, Accept: repeat(), Execute: move(EXECUTING), Stop: move(STOPPED, Stopped),
                   Compensate: move(STRANDED, Stranded)},
    EXECUTING:    {**_ALWAYS, Accept: repeat(), Execute: repeat(), Stop: move(STOPPING), Compensate: late(Fault)},
    COMPLETED:    {**_ALWAYS, Execute: repeat(Completed), Stop: repeat(Completed), Compensate: move(COMPENSATING)},
    FAILED:       {**_ALWAYS, Execute: repeat(Failed), Stop: repeat(Failed), Compensate: move(COMPENSATING)},
    STOPPING:     {**_ALWAYS, Stop: repeat(), Compensate: late(Fault)},
    STOPPED:      {**_ALWAYS, Stop: repeat(Stopped), Compensate: move(COMPENSATING)},
    COMPENSATING: {**_ALWAYS, Compensate: repeat()},
    COMPENSATED:  {**_ALWAYS, Compensate: repeat(Compensated)},
    STRANDED:     {**_ALWAYS, Compensate: repeat(Stranded)},
    ENDED:        {Query: repeat(Status), Cancel: repeat(), End: repeat()},
})

# What a participant may send unasked. Refuse when Offered: the terms expired. Failed when Committed: it broke before the start. Refuse or
# Failed, and Stranded when Compensating: the order to begin came too late. Completed when Stopping: the work was done before the Stop took
# effect. Stopped when Executing: it lost the connection, or a person stopped it.
PARTICIPANT_SENDS: Sends = {
    ARRANGING:    {Terms: OFFERED, Refuse: ENDED},
    OFFERED:      {Refuse: ENDED},
    COMMITTED:    {Failed: FAILED},
    EXECUTING:    {Progress: EXECUTING, Completed: COMPLETED, Failed: FAILED, Stopped: STOPPED},
    STOPPING:     {Progress: STOPPING, Completed: COMPLETED, Failed: FAILED, Stopped: STOPPED},
    COMPENSATING: {Progress: COMPENSATING, Compensated: COMPENSATED, Stranded: STRANDED},
}

# A participant that works, or reports work, without a contract is ended.
_UNKNOWN: dict[MessageType, Entry] = {
    Progress: move(ENDED, End), Completed: move(ENDED, End), Failed: move(ENDED, End), Stopped: move(ENDED, End),
    Compensated: move(ENDED, End), Stranded: move(ENDED, End),
}
# The answer to a participant that does not know yet that the session has ended.
_ENDED_ROW: dict[MessageType, Entry] = dict.fromkeys((Terms, Progress, Completed, Failed, Stopped, Compensated, Stranded), repeat(End))

COORDINATOR: Table = _complete(COORDINATOR_STATES, TO_COORDINATOR, {
    NEW:          {**_UNKNOWN, Terms: move(ENDED, Cancel)},
    ARRANGING:    {**_UNKNOWN, Terms: move(OFFERED), Refuse: move(ENDED), Fault: move(ENDED, Cancel), Status: repeat()},
    OFFERED:      {**_UNKNOWN, Terms: repeat(), Refuse: move(ENDED), Fault: move(ENDED, Cancel), Status: repeat()},
    # Refuse, here and below: the terms had expired before the Accept came; nothing was or will be started.
    COMMITTED:    {Terms: repeat(), Refuse: move(ENDED), Failed: move(FAILED), Status: repeat(), Fault: move(FAILED)},
    EXECUTING:    {Refuse: move(ENDED), Progress: move(EXECUTING), Completed: move(COMPLETED), Failed: move(FAILED), Stopped: move(STOPPED),
                   Status: repeat(), Fault: move(FAILED)},
    COMPLETED:    {Completed: repeat(), Status: repeat()},
    FAILED:       {Failed: repeat(), Status: repeat()},
    # Completed, Failed: they crossed the Stop.
    STOPPING:     {Refuse: move(ENDED), Progress: move(STOPPING), Completed: move(COMPLETED), Failed: move(FAILED), Stopped: move(STOPPED),
                   Status: repeat()},
    STOPPED:      {Stopped: repeat(), Status: repeat()},
    COMPENSATING: {Progress: move(COMPENSATING), Compensated: move(COMPENSATED), Stranded: move(STRANDED), Status: repeat(),
                   Fault: move(STRANDED)},
    COMPENSATED:  {Compensated: repeat(), Status: repeat()},
    # Compensated: the participant had been silent for too long.
    STRANDED:     {Compensated: move(COMPENSATED), Stranded: repeat(), Status: repeat()},
    ENDED:        _ENDED_ROW,
    # A participant that was given up answers again. Another service may have its step, so it must stop if it works; its report is accepted.
    UNREACHABLE:  {Refuse: move(ENDED), Progress: move(STOPPING, Stop), Completed: move(COMPLETED), Failed: move(FAILED),
                   Stopped: move(STOPPED), Status: repeat()},
})

# What a coordinator may send unasked; also a Query, once it has sent anything. Execute when Executing, and Compensate when Compensating:
# the one before did not reach the participant in time.
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

ABANDONED_STATES: dict[State, State] = {**dict.fromkeys((COMMITTED, EXECUTING, STOPPING), UNREACHABLE), COMPENSATING: STRANDED}
"""The state to which the coordinator moves when a participant with a contract stays silent, by the present state.

A silent compensation counts as a failed one. If it became Unreachable, a late heartbeat from the work before would make the coordinator
send a Stop and wait for the participant, although it may never have begun to undo.
"""

CONTRACTED = frozenset((COMMITTED, EXECUTING, STOPPING, COMPENSATING, UNREACHABLE))
"""The coordinator's states in which a participant has a contract and has not reported its end."""

WORKING = frozenset((EXECUTING, STOPPING, COMPENSATING))
"""The states in which a participant's device may be moving."""

HOLDING_STATES = frozenset((COMMITTED, EXECUTING, STOPPING, COMPENSATING))
"""The coordinator's states in which the participant holds the step. Meanwhile no other participant is accepted for it."""

UNBEGUN: dict[State, MessageType] = {OFFERED: Refuse, COMMITTED: Failed}
"""What a participant answers to an Execute that it must not carry out (`ParticipantSession.objection`), by its state. Nothing begins.

In other states such an Execute is like any other. The answer to such a Compensate is Stranded.
"""

RESUMES: dict[State, MessageType] = {EXECUTING: Failed, STOPPING: Stopped, COMPENSATING: Stranded}
"""What a participant reports after a restart or a lost connection in the middle of its work, once its device is in a safe state."""

UNREACHED_STATES: dict[State, tuple[State, ...]] = {EXECUTING: (OFFERED, COMMITTED), COMPENSATING: (COMPLETED, FAILED, STOPPED)}
"""By the coordinator's state of a participant: the states in a Status which show that the last order has not arrived. It is sent again."""


REPORTED_STATES: dict[State, tuple[State, ...]] = {
    EXECUTING: (COMPLETED, FAILED, STOPPED),
    STOPPING: (COMPLETED, FAILED, STOPPED),
    COMPENSATING: (COMPENSATED, STRANDED),
}
"""By the coordinator's state of a participant: the states in a Status which show that it has reported. The report is on its way, or it went
to somebody else who gave an order."""
