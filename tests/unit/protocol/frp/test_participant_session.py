"""What exactly a participant says: headers, relations, words and ids."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from msgspec import structs

from somrs.errors import UsageError, WireError
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.frp.session import NOT_ALLOWED, MessageRecord
from somrs.protocol.frp.states import Kind
from somrs.protocol.messages.bodies import FrpBody
from somrs.protocol.messages.envelope import ANONYMOUS, Message, message_id
from somrs.protocol.messages.frp import (
    Accept,
    Cancel,
    Compensated,
    Completed,
    Failed,
    Fault,
    Progress,
    Query,
    Refuse,
    State,
    Status,
    Stopped,
    Stranded,
)
from tests.support.sessions import (
    ARRANGE,
    COMPENSATE,
    END,
    EXECUTE,
    IDENTITY,
    OTHER_ADDRESS,
    SM,
    STOP,
    TERMS,
    TM,
    executing,
    message,
    offered,
    participant,
)


@pytest.mark.parametrize(
    ("state", "body", "received", "related"),
    [
        (State.ARRANGING, TERMS, ("Arrange",), "Arrange"),
        (State.ARRANGING, Refuse(reason="r"), ("Arrange",), "Arrange"),
        (State.EXECUTING, Progress(fraction=0.5), ("Accept", "Execute"), "Execute"),
        (State.STOPPING, Progress(fraction=0.5), ("Execute", "Stop"), "Stop"),
        (State.COMPENSATING, Progress(fraction=0.5), ("Execute", "Stop", "Compensate"), "Compensate"),
        (State.EXECUTING, Completed(situation=""), ("Accept", "Execute"), "Execute"),
        (State.STOPPING, Completed(situation=""), ("Stop", "Execute"), "Execute"),
        (State.EXECUTING, Failed(description="d"), ("Accept", "Execute"), "Execute"),
        (State.COMMITTED, Failed(description="d"), ("Arrange", "Accept"), "Accept"),
        (State.STOPPING, Stopped(), ("Execute", "Stop"), "Stop"),
        (State.EXECUTING, Stopped(), ("Execute",), "Execute"),
        (State.COMPENSATING, Compensated(situation=""), ("Execute", "Compensate"), "Compensate"),
        (State.COMPENSATING, Stranded(description="d"), ("Execute", "Compensate"), "Compensate"),
        (State.ARRANGING, TERMS, (), None),
    ],
)
def test_what_a_participant_says_is_an_answer_to_what_it_heard(
    state: State, body: FrpBody, received: tuple[str, ...], related: str | None
) -> None:
    session = participant(state)
    session.received_messages = {name: MessageRecord(id=f"urn:{name}", body=ARRANGE) for name in received}
    reply = session.send(body)  # type: ignore[arg-type]  # all of them are a participant's
    assert reply.header.relates_to == (f"urn:{related}" if related else None)


def test_signs_of_life_have_ids_of_their_own_and_take_none_from_the_contract() -> None:
    _, session = executing()
    number = session.number
    ids = [session.send(Progress(fraction=0.5)).header.message_id for _ in range(3)]
    assert len(set(ids)) == 3
    assert session.number == number
    assert ids[0] == message_id("t1", IDENTITY, "participant", number, "Progress", session.received_messages["Execute"].id, "")
    assert ids[1] == message_id("t1", IDENTITY, "participant", number, "Progress", session.received_messages["Execute"].id, ids[0])
    assert session.send(Completed(situation="")).header.message_id == message_id("t1", IDENTITY, "participant", number + 1, "Completed")


def test_the_last_message_is_no_sign_of_life() -> None:
    _, session = executing()
    assert participant().last_message is None
    terms = session.last_message
    assert terms == session.sent_messages["Terms"].id
    session.send(Progress(fraction=0.5))
    assert session.last_message == terms
    completed = session.send(Completed(situation=""))
    assert session.last_message == completed.header.message_id


@pytest.mark.parametrize(
    ("state", "received_body", "answer", "state_after"),
    [
        (State.NEW, Accept(terms="x"), Failed(description="there is no contract here, so Accept started nothing"), State.FAILED),
        (State.NEW, EXECUTE, Failed(description="there is no contract here, so Execute started nothing"), State.FAILED),
        (State.ARRANGING, STOP, Failed(description="there is no contract here, so Stop started nothing"), State.FAILED),
        (
            State.NEW,
            COMPENSATE,
            Stranded(description="nothing was done under this contract that could be undone", tried=False),
            State.STRANDED,
        ),
        (State.COMMITTED, STOP, Stopped(tried=False), State.STOPPED),
        (
            State.COMMITTED,
            COMPENSATE,
            Stranded(description="nothing was done under this contract that could be undone", tried=False),
            State.STRANDED,
        ),
        (
            State.STOPPED,
            COMPENSATE,
            Stranded(description="nothing was done under this contract that could be undone", tried=False),
            State.STRANDED,
        ),
        (State.EXECUTING, COMPENSATE, Fault(code=NOT_ALLOWED, text="Compensate does not fit the state Executing"), State.EXECUTING),
        (State.NEW, Query(), Status(state=State.NEW), State.NEW),
        (State.ENDED, Query(), Status(state=State.ENDED), State.ENDED),
        (State.EXECUTING, Completed(situation=""), Fault(code=NOT_ALLOWED, text="Completed is not for a participant"), State.EXECUTING),
    ],
)
def test_what_a_participant_answers_at_once(state: State, received_body: FrpBody, answer: FrpBody, state_after: State) -> None:
    session = participant(state)
    [reply] = session.receive(message(received_body)).answers
    assert (reply.body, reply.header.relates_to, reply.header.recipient, session.state) == (answer, "urn:x", TM, state_after)


@pytest.mark.parametrize("state", [State.NEW, State.EXECUTING, State.ENDED])
def test_a_fault_is_never_answered(state: State) -> None:
    result = participant(state).receive(message(Fault(code="c", text="t")))
    assert (result.kind, result.state_before, result.state, result.answers) == (Kind.LATE, state, state, ())


@pytest.mark.parametrize(
    ("body", "reply_to", "peer"),
    [(Query(), OTHER_ADDRESS, TM), (STOP, OTHER_ADDRESS, OTHER_ADDRESS), (STOP, ANONYMOUS, TM), (STOP, TM, TM)],
)
def test_the_coordinator_is_answered_where_it_wants_its_answers(body: FrpBody, reply_to: str, peer: str) -> None:
    _, session = executing()
    session.receive(message(body, reply_to=reply_to))
    assert session.peer == peer


@pytest.mark.parametrize("sender", [OTHER_ADDRESS, SM, ANONYMOUS])
@pytest.mark.parametrize("body", [ARRANGE, STOP, END, COMPENSATE, Cancel(reason="r"), Fault(code="c", text="t")])
def test_only_the_coordinator_gives_orders(body: FrpBody, sender: str) -> None:
    session = ParticipantSession.from_message(message(ARRANGE), SM)
    session.receive(message(ARRANGE))
    session.send(TERMS)
    session_before = session.copy()
    result = session.receive(message(body, sender=sender, reply_to=TM))
    assert (result.kind, result.moved, session) == (Kind.FOREIGN, False, session_before)
    text = f"{type(body).__name__} comes from {sender}, and {IDENTITY} takes orders from {TM} only"
    assert [answer.body for answer in result.answers] == ([] if isinstance(body, Fault) else [Fault(code=NOT_ALLOWED, text=text)])


def test_whoever_asks_for_the_state_is_told_where_it_wants() -> None:
    _, session = executing()
    [reply] = session.receive(message(Query(), sender=OTHER_ADDRESS)).answers
    assert (reply.header.recipient, reply.body) == (
        OTHER_ADDRESS,
        Status(state=State.EXECUTING, last_message=session.sent_messages["Terms"].id),
    )


@pytest.mark.parametrize(
    ("body", "relates_to", "moved"),
    [
        (Accept(terms="TERMS"), None, True),
        (Accept(terms="urn:other"), "TERMS", False),
        (EXECUTE, "TERMS", True),
        (EXECUTE, "urn:other", False),
        (EXECUTE, None, False),
        (STOP, None, True),
    ],
)
def test_only_the_terms_that_were_offered_are_accepted(body: FrpBody, relates_to: str | None, moved: bool) -> None:
    _, session = offered()
    terms = session.sent_messages["Terms"].id
    if isinstance(body, Accept):
        body = Accept(terms=body.terms.replace("TERMS", terms))
    result = session.receive(message(body, relates_to=terms if relates_to == "TERMS" else relates_to))
    assert result.moved is moved
    assert (session.state is State.OFFERED) is not moved
    if not moved:
        named = body.terms if isinstance(body, Accept) else relates_to
        text = f"{type(body).__name__} names the terms {named}, and the offered terms are {terms}"
        assert [answer.body for answer in result.answers] == [Fault(code=NOT_ALLOWED, text=text)]


@pytest.mark.parametrize(
    ("hear", "reason"),
    [
        (lambda: message(Cancel(reason="another was cheaper")), "another was cheaper"),
        (lambda: message(END), "ended"),
        (lambda: message(STOP), ""),
    ],
)
def test_why_a_participant_ended(hear: Callable[[], Message], reason: str) -> None:
    _, session = executing()
    session.receive(hear())
    assert session.reason == reason


@pytest.mark.parametrize("header", [{"transaction": "t2"}, {"participant": "p2"}])
def test_a_message_of_another_contract_is_no_business_of_a_session(header: dict[str, str]) -> None:
    plain = message(Query())
    with pytest.raises(UsageError):
        participant().receive(Message(header=structs.replace(plain.header, **header), body=Query()))


@pytest.mark.parametrize("header", [{"transaction": None}, {"participant": None}])
def test_a_session_is_opened_by_a_message_with_both_ids(header: dict[str, None]) -> None:
    plain = message(ARRANGE)
    assert ParticipantSession.from_message(plain, SM) == structs.replace(participant(), coordinator=TM)
    with pytest.raises(WireError) as error:
        ParticipantSession.from_message(Message(header=structs.replace(plain.header, **header), body=ARRANGE), SM)
    assert (error.value.code, error.value.text) == (NOT_ALLOWED, "Arrange needs a transaction and a participant in its header")


@pytest.mark.parametrize(
    ("state", "report"),
    [
        (State.OFFERED, "Terms"),
        (State.ENDED, "Refuse"),
        (State.COMPLETED, "Completed"),
        (State.STRANDED, "Stranded"),
        (State.EXECUTING, None),
    ],
)
def test_the_last_report_is_that_of_its_state(state: State, report: str | None) -> None:
    session = participant(state)
    session.sent_messages = {
        name: MessageRecord(id=f"urn:{name}", body=TERMS) for name in ("Terms", "Refuse", "Completed", "Stranded", "Progress")
    }
    assert [answer.header.message_id for answer in session.last_report()] == ([f"urn:{report}"] if report else [])
