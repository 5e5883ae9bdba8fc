"""The protocol's tables: total, forward only, and sound together on a medium that loses, reorders and repeats."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest

from somrs.protocol.frp import diagram, states
from somrs.protocol.frp.states import Entry, Kind, MessageType, Table
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import Accept, Arrange, Cancel, Completed, End, Execute, Failed, Progress, Query, State, Status, Stop
from tests.support.paths import ROOT

# How far a participant is. Every move goes to a higher rank, so that a message that comes twice meets a state it left.
RANK = {
    State.NEW: 0,
    State.ARRANGING: 1,
    State.OFFERED: 2,
    State.COMMITTED: 3,
    State.EXECUTING: 4,
    State.STOPPING: 5,
    State.COMPLETED: 6,
    State.FAILED: 6,
    State.STOPPED: 6,
    State.COMPENSATING: 7,
    State.COMPENSATED: 8,
    State.STRANDED: 8,
    State.ENDED: 9,
}

SIDES = (
    pytest.param(states.PARTICIPANT, states.PARTICIPANT_STATES, states.TO_PARTICIPANT, states.TO_COORDINATOR, id="participant"),
    pytest.param(states.COORDINATOR, states.COORDINATOR_STATES, states.TO_COORDINATOR, states.TO_PARTICIPANT, id="coordinator"),
)


@pytest.mark.parametrize(("table", "all_states", "received_types", "sent_types"), SIDES)
def test_every_message_means_something_in_every_state(
    table: Table, all_states: tuple[State, ...], received_types: tuple[MessageType, ...], sent_types: tuple[MessageType, ...]
) -> None:
    for state, message in product(all_states, received_types):
        entry = table[state][message]
        assert entry.next_state in all_states
        assert entry.answer is None or entry.answer in sent_types
        assert entry.kind is Kind.MOVES or entry.next_state is state, f"{message.__name__} in {state} stays where it is"


def test_the_two_sides_together_know_every_message_of_the_protocol() -> None:
    messages = {kind for kind in vars(frp).values() if isinstance(kind, type) and kind.__module__ == frp.__name__}
    assert set(states.TO_PARTICIPANT) | set(states.TO_COORDINATOR) == messages - {State, frp.Outcome}


def test_a_participant_only_moves_forward() -> None:
    for state, row in states.PARTICIPANT.items():
        assert all(RANK[entry.next_state] > RANK[state] for entry in row.values() if entry.kind is Kind.MOVES)
    for state, sends in states.PARTICIPANT_SENDS.items():
        assert all(RANK[target] > RANK[state] for message, target in sends.items() if message is not Progress)


def test_a_message_repeated_at_once_never_moves_a_participant_twice() -> None:
    for row in states.PARTICIPANT.values():
        for message, entry in row.items():
            if entry.kind is Kind.MOVES:
                assert states.PARTICIPANT[entry.next_state][message].kind is not Kind.MOVES


@pytest.mark.parametrize("message", [End, Cancel])
def test_end_and_cancel_end_a_participant_in_every_state(message: MessageType) -> None:
    assert {row[message].next_state for row in states.PARTICIPANT.values()} == {State.ENDED}


def test_a_participant_says_its_state_in_every_state() -> None:
    assert all(row[Query] == Entry(Kind.REPEATED, state, Status) for state, row in states.PARTICIPANT.items())


def test_overtaking() -> None:
    participant = states.PARTICIPANT
    assert participant[State.NEW][Cancel].next_state is State.ENDED
    assert participant[State.ENDED][Arrange].kind is Kind.LATE, "an Arrange overtaken by its Cancel starts nothing"
    assert participant[State.OFFERED][Execute].next_state is State.EXECUTING, "an Execute that names the terms may overtake the Accept"
    assert participant[State.EXECUTING][Accept].kind is Kind.REPEATED
    for state in (State.OFFERED, State.COMMITTED):
        stopped = participant[state][Stop]
        assert stopped.next_state is State.STOPPED
        assert participant[State.STOPPED][Execute].kind is Kind.LATE, "an Execute overtaken by its Stop starts nothing"
    assert participant[State.COMPLETED][Stop] == Entry(Kind.REPEATED, State.COMPLETED, Completed), "a Stop that crossed Completed"
    assert states.COORDINATOR[State.STOPPING][Completed].next_state is State.COMPLETED


def test_nothing_executes_that_was_not_offered() -> None:
    doors = {
        (state, m)
        for state, row in states.PARTICIPANT.items()
        for m, e in row.items()
        if e.next_state is State.EXECUTING and e.kind is Kind.MOVES
    }
    assert doors == {(State.OFFERED, Execute), (State.COMMITTED, Execute)}


def test_every_state_can_be_left_towards_the_end() -> None:
    for table, sends in ((states.PARTICIPANT, states.PARTICIPANT_SENDS), (states.COORDINATOR, states.COORDINATOR_SENDS)):
        reach = {State.ENDED}
        while True:
            further = {s for s, row in table.items() if any(e.next_state in reach for e in row.values())}
            further |= {s for s, row in sends.items() if any(target in reach for target in row.values())}
            if further <= reach:
                break
            reach |= further
        assert reach == set(table)


Message = tuple[str, MessageType]
Pair = tuple[State, State, frozenset[Message]]


def _moves(pair: Pair) -> list[Pair]:
    """What can happen next to one coordinator and one participant, on a medium where a message once sent may arrive at any
    time, any number of times, or never: it holds the set of everything that was ever sent."""
    coordinator, participant, medium = pair
    successors: list[Pair] = []
    for message, state in states.COORDINATOR_SENDS.get(coordinator, {}).items():
        successors.append((state, participant, medium | {("p", message)}))
    for message, state in states.PARTICIPANT_SENDS.get(participant, {}).items():
        successors.append((coordinator, state, medium | {("c", message)}))
    for side, message in medium:
        if side == "p":
            entry = states.PARTICIPANT[participant][message]
            successors.append((coordinator, entry.next_state, medium | ({("c", entry.answer)} if entry.answer else frozenset())))
        else:
            entry = states.COORDINATOR[coordinator][message]
            successors.append((entry.next_state, participant, medium | ({("p", entry.answer)} if entry.answer else frozenset())))
    return successors


def _reachable() -> set[Pair]:
    start: Pair = (State.NEW, State.NEW, frozenset())
    visited, waiting = {start}, [start]
    while waiting:
        for pair in _moves(waiting.pop()):
            if pair not in visited:
                visited.add(pair)
                waiting.append(pair)
    return visited


def test_one_coordinator_and_one_participant_agree_whatever_the_medium_does() -> None:
    reachable = _reachable()
    assert len(reachable) > 200
    believed_over = {State.COMPLETED, State.FAILED, State.STOPPED, State.COMPENSATED, State.STRANDED}
    for coordinator, participant, medium in reachable:
        description = f"{coordinator.value}/{participant.value} with {sorted(m.__name__ for _, m in medium)}"
        if participant is State.EXECUTING:
            assert ("p", Execute) in medium, description
            assert coordinator in (State.EXECUTING, State.STOPPING), f"someone works who is believed not to: {description}"
        if coordinator in believed_over:
            assert participant not in (State.EXECUTING, State.STOPPING), f"another could be given the same step: {description}"
        assert ("c", frp.Fault) not in medium, f"one side found a message wrong: {description}"
        if coordinator is State.ENDED and participant is State.ENDED:
            continue
        assert _can_end(coordinator, participant, medium), description


def _can_end(coordinator: State, participant: State, medium: frozenset[Message]) -> bool:
    """Whether somebody has something left to do: a message that moves its receiver, or a move of its own."""
    for side, message in medium:
        entry = states.PARTICIPANT[participant][message] if side == "p" else states.COORDINATOR[coordinator][message]
        if entry.kind is Kind.MOVES:
            return True
    if coordinator in states.COORDINATOR_SENDS:
        return True
    return any(message is not Progress for message in states.PARTICIPANT_SENDS.get(participant, {}))


def test_work_without_a_contract_is_sent_home() -> None:
    for message in (Progress, Completed, Failed):
        assert states.COORDINATOR[State.NEW][message] == Entry(Kind.MOVES, State.ENDED, End)
        assert states.COORDINATOR[State.UNREACHABLE][message].kind is Kind.MOVES
    assert states.COORDINATOR[State.UNREACHABLE][Progress].answer is Stop


def test_the_page_in_the_docs_shows_these_tables() -> None:
    written = (ROOT / diagram.PAGE).read_text(encoding="utf-8")
    assert written == diagram.page(), f"run `python -m somrs.protocol.frp.diagram {diagram.PAGE}`"


def test_the_page_is_written_where_it_is_wanted_and_otherwise_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    diagram.main([str(tmp_path / "page.md")])
    assert ((tmp_path / "page.md").read_text(encoding="utf-8"), capsys.readouterr().out) == (diagram.page(), "")
    diagram.main([])
    assert capsys.readouterr().out == diagram.page()
