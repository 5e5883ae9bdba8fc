"""What exactly a coordinator says: headers, relations, words and ids."""

from __future__ import annotations

import pytest

from somrs.errors import UsageError
from somrs.protocol.frp.session import NOT_ALLOWED, MessageRecord
from somrs.protocol.frp.states import Kind
from somrs.protocol.messages.bodies import FrpBody
from somrs.protocol.messages.envelope import ANONYMOUS, Message
from somrs.protocol.messages.frp import Accept, Cancel, Completed, End, Fault, Outcome, Progress, Query, Refuse, State, Status, Stop
from tests.support.sessions import ARRANGE, COMPENSATE, END, EXECUTE, IDENTITY, SM, STOP, TERMS, TM, coordinator, executing
from tests.support.sessions import message as message_from


def message(body: FrpBody, relates_to: str | None = None) -> Message:
    return message_from(body, relates_to, sender=SM)


@pytest.mark.parametrize(
    ("state", "body", "received", "related"),
    [
        (State.OFFERED, Accept(terms="urn:Terms"), ("Terms",), "Terms"),
        (State.OFFERED, Cancel(reason="r"), ("Terms",), "Terms"),
        (State.COMMITTED, EXECUTE, ("Terms",), "Terms"),
        (State.COMPLETED, COMPENSATE, ("Terms", "Completed"), "Completed"),
        (State.FAILED, COMPENSATE, ("Terms", "Failed"), "Failed"),
        (State.STOPPED, COMPENSATE, ("Terms", "Stopped"), "Stopped"),
        (State.EXECUTING, STOP, ("Terms",), None),
    ],
)
def test_what_a_coordinator_says_is_an_answer_to_what_it_heard(
    state: State, body: FrpBody, received: tuple[str, ...], related: str | None
) -> None:
    session = coordinator(state)
    session.received_messages = {name: MessageRecord(id=f"urn:{name}", body=TERMS) for name in received}
    reply = session.send(body)  # type: ignore[arg-type]  # all of them are a coordinator's
    assert reply.header.relates_to == (f"urn:{related}" if related else None)


@pytest.mark.parametrize(
    ("state", "body", "reason"),
    [(State.OFFERED, Cancel(reason="too dear"), "too dear"), (State.COMPLETED, END, "ended"), (State.EXECUTING, STOP, "")],
)
def test_why_a_coordinator_ended(state: State, body: Cancel | End | Stop, reason: str) -> None:
    session = coordinator(state)
    session.send(body)
    assert session.reason == reason


@pytest.mark.parametrize(
    ("state", "received", "reason", "answer"),
    [
        (State.NEW, Completed(situation=""), "ended", End(outcome=Outcome.CANCELLED)),
        (State.NEW, TERMS, "ended", Cancel(reason="this service takes no part in the transaction")),
        (
            State.UNREACHABLE,
            Progress(fraction=0.5),
            "",
            Stop(reason="it was silent for too long, and another service may have its step"),
        ),
        (State.COMMITTED, Refuse(reason="no"), "no", None),
        (State.ENDED, Completed(situation=""), "", None),
    ],
)
def test_what_a_coordinator_answers_at_once(state: State, received: FrpBody, reason: str, answer: FrpBody | None) -> None:
    session = coordinator(state)
    result = session.receive(message(received))
    assert [reply.body for reply in result.answers] == ([answer] if answer is not None else [])
    assert session.reason == reason


@pytest.mark.parametrize("ending", [END, Cancel(reason="too dear")])
def test_who_missed_the_end_hears_it_as_it_was(ending: End | Cancel) -> None:
    session = coordinator(State.COMMITTED)
    final_message = session.send(ending)
    assert session.receive(message(Completed(situation=""))).answers == (final_message,)


@pytest.mark.parametrize(
    ("state", "state_after"),
    [
        (State.NEW, None),
        (State.OFFERED, None),
        (State.COMMITTED, State.UNREACHABLE),
        (State.STOPPING, State.UNREACHABLE),
        (State.COMPENSATING, State.STRANDED),
        (State.UNREACHABLE, None),
    ],
)
def test_only_who_owes_something_is_given_up(state: State, state_after: State | None) -> None:
    session = coordinator(state)
    assert session.abandon() is (state_after is not None)
    assert session.state is (state_after or state)


@pytest.mark.parametrize(
    ("state_before", "query_state", "reported_state", "related", "state_after"),
    [
        (State.COMMITTED, State.COMMITTED, State.NEW, True, State.FAILED),
        (State.EXECUTING, State.COMMITTED, State.NEW, True, State.FAILED),
        (State.COMPENSATING, State.COMPENSATING, State.NEW, True, State.STRANDED),
        (State.EXECUTING, State.EXECUTING, State.ENDED, True, State.FAILED),
        (State.COMPENSATING, State.COMPENSATING, State.ENDED, True, State.STRANDED),
        (State.EXECUTING, State.EXECUTING, State.ENDED, False, State.EXECUTING),
        (State.EXECUTING, State.OFFERED, State.NEW, True, State.EXECUTING),
        (State.EXECUTING, State.EXECUTING, State.EXECUTING, True, State.EXECUTING),
        (State.EXECUTING, State.EXECUTING, State.NEW, False, State.EXECUTING),
        (State.COMPLETED, State.EXECUTING, State.NEW, True, State.COMPLETED),
    ],
)
def test_who_knows_nothing_of_its_contract_has_failed(
    state_before: State, query_state: State, reported_state: State, related: bool, state_after: State
) -> None:
    session = coordinator(query_state)
    query = session.send(Query())
    session.state = state_before
    session.receive(message(Status(state=reported_state), relates_to=query.header.message_id if related else "urn:other"))
    assert session.state is state_after


def test_who_says_nothing_of_its_contract_without_being_asked_has_not_failed() -> None:
    session = coordinator(State.EXECUTING)
    session.receive(message(Status(state=State.NEW)))
    assert session.state is State.EXECUTING


@pytest.mark.parametrize(
    ("body", "kind", "moved"),
    [
        (TERMS, "Arrange", True),
        (TERMS, "Query", False),
        (TERMS, None, True),
        (Refuse(reason="r"), "Arrange", True),
        (Refuse(reason="r"), "Query", False),
        (Fault(code="c", text="t"), "Arrange", True),
        (Fault(code="c", text="t"), "Query", False),
        (Fault(code="c", text="t"), None, False),
    ],
)
def test_an_answer_to_something_else_moves_nothing(body: FrpBody, kind: str | None, moved: bool) -> None:
    session = coordinator()
    requests = {"Arrange": session.send(ARRANGE), "Query": session.send(Query())}
    result = session.receive(message(body, relates_to=requests[kind].header.message_id if kind else None))
    assert result.moved is moved
    assert (result.state_before, result.state) == (State.ARRANGING, session.state)


@pytest.mark.parametrize("kind", ["Arrange", "Accept", "Execute"])
def test_a_fault_about_any_order_ends_the_contract(kind: str) -> None:
    session, _ = executing()
    session.receive(message(Fault(code="c", text="t"), relates_to=session.sent_messages[kind].id))
    assert session.state is State.FAILED


def test_a_fault_about_an_undoing_leaves_it_stranded() -> None:
    session, participant_side = executing()
    session.receive(participant_side.send(Completed(situation="")))
    session.receive(message(Fault(code="c", text="t"), relates_to=session.send(COMPENSATE).header.message_id))
    assert session.state is State.STRANDED


def test_a_message_moves_once_and_signs_of_life_each_time() -> None:
    session, participant_side = executing()
    progress = participant_side.send(Progress(fraction=0.5))
    assert [session.receive(progress).kind for _ in range(2)] == [Kind.MOVES, Kind.MOVES]
    assert "Progress" not in session.received_messages
    completed = participant_side.send(Completed(situation=""))
    assert [session.receive(completed).kind for _ in range(2)] == [Kind.MOVES, Kind.REPEATED]
    assert session.received_messages["Completed"] == MessageRecord(
        id=completed.header.message_id, body=Completed(situation=""), relates_to=completed.header.relates_to, state=State.EXECUTING
    )


@pytest.mark.parametrize(("state", "allowed"), [(State.OFFERED, "Accept, Cancel"), (State.ENDED, "nothing")])
def test_nothing_can_be_accepted_where_nothing_was_offered(state: State, allowed: str) -> None:
    with pytest.raises(UsageError) as error:
        coordinator(state).accept()
    assert str(error.value) == f"{IDENTITY} in t1 is {state.value}: Accept is not allowed; allowed: {allowed}"


@pytest.mark.parametrize("sender", [TM, ANONYMOUS, "http://there/other"])
@pytest.mark.parametrize("body", [Completed(situation=""), Progress(fraction=0.5), Status(state=State.NEW), Fault(code="c", text="t")])
def test_only_the_participant_reports_its_work(body: FrpBody, sender: str) -> None:
    session, _ = executing()
    query = session.send(Query())
    session_before = session.copy()
    result = session.receive(message_from(body, query.header.message_id, sender=sender, reply_to="http://there/other"))
    assert (result.kind, result.moved, session) == (Kind.FOREIGN, False, session_before)
    text = f"{type(body).__name__} comes from {sender}, and {IDENTITY} is at {SM}"
    expected = [] if isinstance(body, Fault) else [("http://there/other", Fault(code=NOT_ALLOWED, text=text))]
    assert [(answer.header.recipient, answer.body) for answer in result.answers] == expected
