"""What exactly the two sides of a contract say: headers, relations, words and ids."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from msgspec import structs

from somrs.errors import UsageError, WireError
from somrs.protocol.frp.session import (
    NOT_ALLOWED,
    CoordinatorSession,
    FrpBody,
    MessageRecord,
    ParticipantSession,
    participant_id,
    service_of,
)
from somrs.protocol.frp.states import Kind
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
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
    Outcome,
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

TM, SM, OTHER_ADDRESS = "http://here/tm", "http://there/sm", "http://there/other"
IDENTITY = "Robot1.TransferObject#s1"
ARRANGE = Arrange(service_type="TransferObject", inputs={}, effect="A isOn B")
TERMS = Terms(effect="A isOn B", price=4.0, duration=30.0)
EXECUTE = Execute(inputs={})
COMPENSATE = Compensate(situation="A isOn C")
STOP = Stop(reason="enough")
END = End(outcome=Outcome.ACCOMPLISHED)


def coordinator(state: State = State.NEW) -> CoordinatorSession:
    return CoordinatorSession(transaction="t1", participant=IDENTITY, me=TM, peer=SM, state=state)


def participant(state: State = State.NEW) -> ParticipantSession:
    return ParticipantSession(transaction="t1", participant=IDENTITY, me=SM, peer=TM, state=state)


def message(
    body: FrpBody, identity: str = "urn:x", relates_to: str | None = None, sender: str = TM, reply_to: str | None = None
) -> Message:
    header = Header(
        sender=sender,
        recipient=SM,
        message_id="urn:x",
        relates_to=relates_to,
        reply_to=reply_to or sender,
        transaction="t1",
        participant=IDENTITY,
    )
    return Message(header=header, body=body)


def offered() -> tuple[CoordinatorSession, ParticipantSession]:
    coordinator_side, participant_side = coordinator(), participant()
    participant_side.receive(coordinator_side.send(ARRANGE))
    coordinator_side.receive(participant_side.send(TERMS))
    return coordinator_side, participant_side


def executing() -> tuple[CoordinatorSession, ParticipantSession]:
    coordinator_side, participant_side = offered()
    participant_side.receive(coordinator_side.accept())
    participant_side.receive(coordinator_side.send(EXECUTE))
    return coordinator_side, participant_side


@pytest.mark.parametrize(("attempt", "identity"), [(1, "A.B#s1"), (2, "A.B#s1.2")])
def test_the_id_of_a_participant_names_its_service(attempt: int, identity: str) -> None:
    assert participant_id("A.B", "s1", attempt) == identity
    assert service_of(identity) == "A.B"


def test_the_first_attempt_is_meant_when_none_is_named() -> None:
    assert participant_id("A.B", "s1") == "A.B#s1"


def test_a_message_says_who_says_it_to_whom_and_of_what() -> None:
    arrange = coordinator().send(ARRANGE)
    assert arrange == Message(
        header=Header(
            sender=TM,
            recipient=SM,
            message_id=message_id("t1", IDENTITY, "coordinator", 1, "Arrange"),
            reply_to=TM,
            transaction="t1",
            participant=IDENTITY,
        ),
        body=ARRANGE,
    )
    session = participant()
    session.receive(arrange)
    assert session.send(TERMS) == Message(
        header=Header(
            sender=SM,
            recipient=TM,
            message_id=message_id("t1", IDENTITY, "participant", 1, "Terms"),
            relates_to=arrange.header.message_id,
            reply_to=SM,
            transaction="t1",
            participant=IDENTITY,
        ),
        body=TERMS,
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


def test_signs_of_life_have_ids_of_their_own_and_take_none_from_the_contract() -> None:
    _, session = executing()
    number = session.number
    ids = [session.send(Progress(fraction=0.5)).header.message_id for _ in range(3)]
    assert len(set(ids)) == 3
    assert session.number == number
    assert ids[0] == message_id("t1", IDENTITY, "participant", number, "Progress", session.received_messages["Execute"].id, "")
    assert ids[1] == message_id("t1", IDENTITY, "participant", number, "Progress", session.received_messages["Execute"].id, ids[0])
    assert session.send(Completed(situation="")).header.message_id == message_id("t1", IDENTITY, "participant", number + 1, "Completed")


@pytest.mark.parametrize("body", [Query(), Status(state=State.NEW), Fault(code="c", text="t"), Progress(fraction=0.5)])
def test_what_changes_no_contract_takes_no_number_from_it(body: Query | Status | Fault | Progress) -> None:
    coordinator_side, participant_side = executing()
    number = coordinator_side.number, participant_side.number
    if isinstance(body, Query):
        coordinator_side.send(body)
    elif isinstance(body, Progress):
        participant_side.send(body)
    else:
        request = Query() if isinstance(body, Status) else Completed(situation="")
        assert [type(answer.body) for answer in participant_side.receive(message(request)).answers] == [type(body)]
    assert (coordinator_side.number, participant_side.number) == number


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
        (State.COMMITTED, STOP, Stopped(), State.STOPPED),
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
    ("body", "sender", "reply_to", "peer"),
    [
        (Query(), OTHER_ADDRESS, OTHER_ADDRESS, TM),
        (Fault(code="c", text="t"), OTHER_ADDRESS, OTHER_ADDRESS, TM),
        (STOP, OTHER_ADDRESS, OTHER_ADDRESS, OTHER_ADDRESS),
        (STOP, OTHER_ADDRESS, TM, TM),
        (STOP, OTHER_ADDRESS, ANONYMOUS, OTHER_ADDRESS),
    ],
)
def test_whoever_gives_orders_is_answered_from_then_on(body: FrpBody, sender: str, reply_to: str, peer: str) -> None:
    _, session = executing()
    session.receive(message(body, sender=sender, reply_to=reply_to))
    assert session.peer == peer


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


def test_a_refusal_is_why_both_ended() -> None:
    coordinator_side, participant_side = offered()
    coordinator_side.receive(participant_side.send(Refuse(reason="the terms expired")))
    assert (coordinator_side.state, coordinator_side.reason, participant_side.state, participant_side.reason) == (
        State.ENDED,
        "the terms expired",
    ) * 2


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


@pytest.mark.parametrize(
    ("session", "body", "text"),
    [
        (coordinator(), EXECUTE, f"{IDENTITY} in t1 is New: Execute is not allowed; allowed: Arrange"),
        (coordinator(), Query(), f"{IDENTITY} in t1 is New: Query is not allowed; allowed: Arrange"),
        (coordinator(State.OFFERED), EXECUTE, f"{IDENTITY} in t1 is Offered: Execute is not allowed; allowed: Accept, Cancel"),
        (coordinator(State.OFFERED), Accept(terms="urn:x"), f"{IDENTITY} offered the terms None; the Accept names urn:x"),
        (coordinator(State.ENDED), END, f"{IDENTITY} in t1 is Ended: End is not allowed; allowed: nothing"),
        (participant(), TERMS, f"{IDENTITY} in t1 is New: Terms is not allowed; allowed: nothing"),
        (participant(State.OFFERED), TERMS, f"{IDENTITY} in t1 is Offered: Terms is not allowed; allowed: Refuse"),
    ],
)
def test_what_cannot_be_said_now_is_an_error_that_says_what_can(
    session: CoordinatorSession | ParticipantSession, body: FrpBody, text: str
) -> None:
    session_before = session.copy()
    with pytest.raises(UsageError) as error:
        session.send(body)  # type: ignore[arg-type]  # each of its own side
    assert str(error.value) == text
    assert session == session_before


@pytest.mark.parametrize(("state", "allowed"), [(State.OFFERED, "Accept, Cancel"), (State.ENDED, "nothing")])
def test_nothing_can_be_accepted_where_nothing_was_offered(state: State, allowed: str) -> None:
    with pytest.raises(UsageError) as error:
        coordinator(state).accept()
    assert str(error.value) == f"{IDENTITY} in t1 is {state.value}: Accept is not allowed; allowed: {allowed}"


@pytest.mark.parametrize("header", [{"transaction": "t2"}, {"participant": "p2"}])
def test_a_message_of_another_contract_is_no_business_of_a_session(header: dict[str, str]) -> None:
    plain = message(Query())
    with pytest.raises(UsageError):
        participant().receive(Message(header=structs.replace(plain.header, **header), body=Query()))


@pytest.mark.parametrize("header", [{"transaction": None}, {"participant": None}])
def test_a_session_is_opened_by_a_message_with_both_ids(header: dict[str, None]) -> None:
    plain = message(ARRANGE)
    assert ParticipantSession.from_message(plain, SM) == participant()
    with pytest.raises(WireError) as error:
        ParticipantSession.from_message(Message(header=structs.replace(plain.header, **header), body=ARRANGE), SM)
    assert (error.value.code, error.value.text) == (NOT_ALLOWED, "Arrange needs a transaction and a participant in its header")


def test_what_was_ordered_and_offered_is_known_on_both_sides() -> None:
    assert (coordinator().order, coordinator().terms, coordinator().terms_id) == (None, None, None)
    assert (participant().order, participant().terms) == (None, None)
    coordinator_side, participant_side = offered()
    assert (coordinator_side.order, coordinator_side.terms, coordinator_side.terms_id) == (
        ARRANGE,
        TERMS,
        participant_side.sent_messages["Terms"].id,
    )
    assert (participant_side.order, participant_side.terms) == (ARRANGE, TERMS)


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


def test_what_is_kept_stays_as_it_was() -> None:
    for session in (coordinator(), participant(State.ARRANGING)):
        saved = session.copy()
        assert saved == session
        session.send(ARRANGE if isinstance(session, CoordinatorSession) else TERMS)  # type: ignore[arg-type]  # each of its own side
        assert saved != session
