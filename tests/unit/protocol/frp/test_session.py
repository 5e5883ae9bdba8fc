"""Sessions joined in memory: the paper's scenarios, message by message, and any mixture of what a bad medium delivers."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import UsageError
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.frp.session import CoordinatorBody, ParticipantBody, participant_id, service_of
from somrs.protocol.frp.states import Kind
from somrs.protocol.messages.bodies import FrpBody
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import (
    Accept,
    Arrange,
    Cancel,
    Compensate,
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

TM, SM = "http://here/tm", "http://there/sm"
ARRANGE = Arrange(service_type="TransferObject", inputs={"Object": "Jar002"}, effect="Jar002 isOn Platform001")
TERMS = Terms(effect="Jar002 isOn Platform001", price=4.0, duration=30.0)
EXECUTE = Execute(inputs={"Object": "Jar002"}, precondition="Jar002 isOn Shelf001")
COMPLETED = Completed(situation="Jar002 isOn Platform001")
LYING = "Jar002.PositionX = 12.5 AND Jar002.PositionY = 1.3 AND Jar002.PositionZ = 7"


class Pair:
    """A coordinator's and a participant's session, and what went between them, in order."""

    def __init__(self, service: str, log: list[str], attempt: int = 1) -> None:
        self.service, self.log = service, log
        identity = participant_id(service, "s1", attempt)
        self.coordinator = CoordinatorSession(transaction="t1", participant=identity, me=TM, peer=SM)
        self.participant = ParticipantSession(transaction="t1", participant=identity, me=SM, peer=TM)

    def ask(self, body: CoordinatorBody) -> Message:
        return self.ask_with(self.coordinator.send(body))

    def ask_with(self, message: Message) -> Message:
        self._note("->", message)
        for answer in self.participant.receive(message).answers:
            self._note("<-", answer)
            self.coordinator.receive(answer)
        return message

    def answer(self, body: ParticipantBody) -> Message:
        message = self.participant.send(body)
        self._note("<-", message)
        for answer in self.coordinator.receive(message).answers:
            self.ask_with(answer)
        return message

    def states(self) -> tuple[State, State]:
        return self.coordinator.state, self.participant.state

    def _note(self, arrow: str, message: Message) -> None:
        self.log.append(f"{arrow} {self.service} {type(message.body).__name__}")


def _two() -> tuple[Pair, Pair, list[str]]:
    log: list[str] = []
    return Pair("Robot1.TransferObject", log), Pair("Robot2.TransferObject", log), log


def _arrange_both(first: Pair, second: Pair) -> None:
    first.ask(ARRANGE)
    second.ask(ARRANGE)
    first.answer(TERMS)
    second.answer(msgspec.structs.replace(TERMS, price=9.0, duration=12.0))
    first.ask_with(first.coordinator.accept())
    second.ask(Cancel(reason="another was cheaper"))


ARRANGED = [
    "-> Robot1.TransferObject Arrange",
    "-> Robot2.TransferObject Arrange",
    "<- Robot1.TransferObject Terms",
    "<- Robot2.TransferObject Terms",
    "-> Robot1.TransferObject Accept",
    "-> Robot2.TransferObject Cancel",
    "-> Robot1.TransferObject Execute",
]


def test_scenario_1() -> None:
    first, second, log = _two()
    _arrange_both(first, second)
    first.ask(EXECUTE)
    first.answer(Progress(fraction=0.5))
    first.answer(COMPLETED)
    first.ask(End(outcome=Outcome.ACCOMPLISHED))
    assert log == [
        *ARRANGED,
        "<- Robot1.TransferObject Progress",
        "<- Robot1.TransferObject Completed",
        "-> Robot1.TransferObject End",
    ]
    assert first.states() == second.states() == (State.ENDED, State.ENDED)
    assert second.participant.reason == "another was cheaper"
    assert first.coordinator.terms == TERMS


def test_scenario_1b() -> None:
    first, second, log = _two()
    _arrange_both(first, second)
    first.ask(EXECUTE)
    first.answer(Failed(description="the drive is out of order", situation=LYING))
    retry = Pair("Robot2.TransferObject", log, attempt=2)
    retry.ask(msgspec.structs.replace(ARRANGE, precondition=LYING))
    retry.answer(msgspec.structs.replace(TERMS, precondition=LYING))
    retry.ask_with(retry.coordinator.accept())
    retry.ask(msgspec.structs.replace(EXECUTE, precondition=LYING))
    retry.answer(COMPLETED)
    assert first.states() == (State.FAILED, State.FAILED), "the failed one stays until the transaction ends"
    first.ask(End(outcome=Outcome.ACCOMPLISHED))
    retry.ask(End(outcome=Outcome.ACCOMPLISHED))
    assert log == [
        *ARRANGED,
        "<- Robot1.TransferObject Failed",
        "-> Robot2.TransferObject Arrange",
        "<- Robot2.TransferObject Terms",
        "-> Robot2.TransferObject Accept",
        "-> Robot2.TransferObject Execute",
        "<- Robot2.TransferObject Completed",
        "-> Robot1.TransferObject End",
        "-> Robot2.TransferObject End",
    ]
    assert first.states() == retry.states() == (State.ENDED, State.ENDED)


def _offered() -> Pair:
    pair = Pair("Robot1.TransferObject", [])
    pair.ask(ARRANGE)
    pair.answer(TERMS)
    return pair


def _executing() -> Pair:
    pair = _offered()
    pair.ask_with(pair.coordinator.accept())
    pair.ask(EXECUTE)
    return pair


def test_messages_are_correlated() -> None:
    pair = Pair("Robot1.TransferObject", [])
    arrange = pair.ask(ARRANGE)
    terms = pair.answer(TERMS)
    accept = pair.ask_with(pair.coordinator.accept())
    execute = pair.ask(EXECUTE)
    completed = pair.answer(COMPLETED)
    assert terms.header.relates_to == arrange.header.message_id
    assert accept.body == Accept(terms=terms.header.message_id)
    assert execute.header.relates_to == terms.header.message_id
    assert completed.header.relates_to == execute.header.message_id
    ids = [m.header.message_id for m in (arrange, terms, accept, execute, completed)]
    assert len(set(ids)) == 5
    assert {m.header.participant for m in (arrange, terms, accept)} == {"Robot1.TransferObject#s1"}
    assert service_of("Robot1.TransferObject#s1.2") == "Robot1.TransferObject"


def test_the_same_conversation_has_the_same_ids() -> None:
    first, second = _executing(), _executing()
    assert first.answer(COMPLETED) == second.answer(COMPLETED)


def test_executing_before_accepting_is_an_error_that_says_what_can_be_said() -> None:
    pair = _offered()
    with pytest.raises(UsageError, match=r"Robot1\.TransferObject#s1 in t1 is Offered: Execute is not allowed; allowed: Accept, Cancel"):
        pair.coordinator.send(EXECUTE)


def test_accepting_other_terms_than_those_offered_is_an_error_here_and_a_fault_there() -> None:
    pair = _offered()
    with pytest.raises(UsageError, match="the Accept names"):
        pair.coordinator.send(Accept(terms="urn:uuid:other"))
    header = Header(sender=TM, recipient=SM, message_id="m", transaction="t1", participant=pair.participant.participant)
    for body in (Accept(terms="urn:uuid:other"), EXECUTE):
        result = pair.participant.receive(Message(header=header, body=body))
        assert [type(answer.body).__name__ for answer in result.answers] == ["Fault"]
        assert pair.participant.state is State.OFFERED


def test_a_message_of_another_session_is_a_local_error() -> None:
    first, second = Pair("A", []), Pair("B", [])
    with pytest.raises(UsageError, match="look sessions up"):
        second.participant.receive(first.coordinator.send(ARRANGE))


def test_the_same_message_twice_is_answered_with_the_same_message() -> None:
    pair = Pair("A", [])
    arrange = pair.ask(ARRANGE)
    terms = pair.answer(TERMS)
    result = pair.participant.receive(arrange)
    assert (result.kind, result.answers) == (Kind.REPEATED, (terms,))


def test_stop_crossing_completed() -> None:
    pair = _executing()
    completed = pair.participant.send(COMPLETED)
    stop = pair.coordinator.send(Stop(reason="the client cancelled"))
    assert pair.participant.receive(stop).answers == (completed,)
    assert pair.coordinator.receive(completed).moved
    assert pair.states() == (State.COMPLETED, State.COMPLETED)
    pair.ask(Compensate(situation="Jar002 isOn Shelf001"))
    assert pair.states() == (State.COMPENSATING, State.COMPENSATING)


def test_an_execute_says_that_the_condition_of_the_terms_holds() -> None:
    pair = _offered()
    pair.coordinator.received_messages["Terms"] = msgspec.structs.replace(
        pair.coordinator.received_messages["Terms"], body=msgspec.structs.replace(TERMS, condition="Door001.Open = TRUE")
    )
    pair.ask_with(pair.coordinator.accept())
    with pytest.raises(UsageError, match="the Execute does not say that it holds"):
        pair.coordinator.send(EXECUTE)
    assert pair.coordinator.state is State.COMMITTED
    pair.ask(Execute(inputs={}, precondition="Jar002 isOn Shelf001 AND Door001.Open = TRUE"))
    assert pair.states() == (State.EXECUTING, State.EXECUTING)


def test_stop_overtaking_execute_starts_nothing() -> None:
    pair = _offered()
    accept, execute, stop = pair.coordinator.accept(), pair.coordinator.send(EXECUTE), pair.coordinator.send(Stop(reason="no more"))
    (stopped,) = pair.participant.receive(stop).answers
    assert stopped.body == Stopped(tried=False)
    for late in (execute, accept):
        assert pair.participant.receive(late).kind is Kind.LATE
    pair.coordinator.receive(stopped)
    assert pair.states() == (State.STOPPED, State.STOPPED)


def test_terms_that_expired_before_the_accept_came() -> None:
    pair = _offered()
    accept, execute = pair.coordinator.accept(), pair.coordinator.send(EXECUTE)
    refuse = pair.participant.send(Refuse(reason="the terms expired"))
    for late in (execute, accept):
        assert pair.participant.receive(late).kind is Kind.LATE
    assert pair.coordinator.receive(refuse).moved
    assert (pair.coordinator.state, pair.coordinator.reason) == (State.ENDED, "the terms expired")


def test_who_was_stopped_before_it_began_has_nothing_to_undo() -> None:
    pair = _offered()
    pair.coordinator.accept()
    pair.coordinator.send(EXECUTE)  # neither arrives
    (stopped,) = pair.participant.receive(pair.coordinator.send(Stop(reason="no more"))).answers
    pair.coordinator.receive(stopped)
    (stranded,) = pair.participant.receive(pair.coordinator.send(Compensate(situation="Jar002 isOn Shelf001"))).answers
    assert isinstance(stranded.body, Stranded)
    assert not stranded.body.tried
    pair.coordinator.receive(stranded)
    assert pair.states() == (State.STRANDED, State.STRANDED)


def test_an_unreachable_participant_that_comes_back_working_is_stopped() -> None:
    pair = _executing()
    assert pair.coordinator.abandon()
    assert pair.coordinator.state is State.UNREACHABLE
    pair.answer(Progress(fraction=0.3))
    assert pair.states() == (State.STOPPING, State.STOPPING)
    pair.answer(Stopped(situation=LYING))
    pair.ask(End(outcome=Outcome.FAILED))
    assert pair.states() == (State.ENDED, State.ENDED)
    assert not pair.coordinator.abandon()


def test_a_participant_that_lost_its_memory_counts_as_failed() -> None:
    pair = _executing()
    query = pair.coordinator.send(Query())
    amnesiac = ParticipantSession.from_message(query, SM)
    (status,) = amnesiac.receive(query).answers
    assert status.body == Status(state=State.NEW)
    assert pair.coordinator.receive(status).moved
    assert pair.coordinator.state is State.FAILED
    (failed,) = ParticipantSession.from_message(query, SM).receive(msgspec.structs.replace(query, body=EXECUTE)).answers
    assert isinstance(failed.body, Failed)


def test_a_question_that_overtook_the_arrange_does_not_count_as_lost_memory() -> None:
    pair = Pair("A", [])
    arrange, query = pair.coordinator.send(ARRANGE), pair.coordinator.send(Query())
    (status,) = pair.participant.receive(query).answers
    pair.ask_with(arrange)
    pair.answer(TERMS)
    pair.ask_with(pair.coordinator.accept())
    assert not pair.coordinator.receive(status).moved
    assert pair.coordinator.state is State.COMMITTED


def test_who_missed_the_end_is_told_again() -> None:
    pair = _executing()
    completed = pair.answer(COMPLETED)
    end = pair.coordinator.send(End(outcome=Outcome.ACCOMPLISHED))
    assert pair.coordinator.receive(completed).answers == (end,)


def test_sessions_go_through_the_journal() -> None:
    pair = _executing()
    saved = pair.participant.copy()
    read = msgspec.msgpack.decode(msgspec.msgpack.encode(saved), type=ParticipantSession)
    pair.answer(COMPLETED)
    assert read == saved
    assert read.state is State.EXECUTING
    assert read.send(COMPLETED) == pair.participant._repeat("Completed")[0]
    coordinator = pair.coordinator.copy()
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(coordinator), type=CoordinatorSession) == coordinator


CHOICES: tuple[FrpBody, ...] = (
    ARRANGE, Cancel(reason="r"), EXECUTE, Stop(reason="r"), Compensate(situation="S"), Query(), End(outcome=Outcome.FAILED),
    TERMS, Refuse(reason="r"), Progress(fraction=0.1), COMPLETED, Failed(description="d"), Stopped(),
)  # fmt: skip


@given(st.lists(st.tuples(st.integers(0, 40), st.booleans()), max_size=60))
def test_any_interleaving_of_what_was_sent_keeps_the_contract(script: list[tuple[int, bool]]) -> None:
    """Each step of the script says something that may be said, or delivers any message ever sent, to its recipient."""
    pair = Pair("A", [])
    messages: list[Message] = []
    accepted = False
    for number, deliver in script:
        if deliver and messages:
            message = messages[number % len(messages)]
            result = (pair.participant if message.header.recipient == SM else pair.coordinator).receive(message)
            messages += result.answers
        else:
            body = CHOICES[number % len(CHOICES)]
            session = pair.participant if number % 2 else pair.coordinator
            try:
                messages.append(session.send(body))  # type: ignore[arg-type]  # what the other side says is refused, too
            except UsageError:
                if pair.coordinator.state is State.OFFERED and number % 3 == 0:
                    messages.append(pair.coordinator.accept())
                    accepted = True
        if pair.participant.state in (State.EXECUTING, State.STOPPING, State.COMPLETED):
            assert accepted
            assert pair.participant.terms is not None


@given(st.lists(st.tuples(st.integers(0, 12), st.integers(0, 3), st.booleans()), max_size=40))
def test_a_participant_survives_any_message_of_anybody(script: list[tuple[int, int, bool]]) -> None:
    """A coordinator that breaks every rule gets answers, and no work without naming the terms."""
    session = ParticipantSession(transaction="t1", participant="A#s1", me=SM, peer=TM)
    for choice, identity, offer in script:
        if offer and session.state is State.ARRANGING:
            session.send(TERMS)
        body: FrpBody = Accept(terms=f"m{identity}") if choice == 12 else CHOICES[choice]
        header = Header(sender=TM, recipient=SM, message_id=f"m{identity}", relates_to="x", transaction="t1", participant="A#s1")
        session.receive(Message(header=header, body=body))
        assert session.state not in (State.COMMITTED, State.EXECUTING, State.STOPPING)


def test_the_last_report_is_said_again_as_it_was() -> None:
    first, second, _ = _two()
    first.ask(ARRANGE)
    second.ask(ARRANGE)
    offered = first.participant.send(TERMS)
    refused = second.participant.send(Refuse(reason="too heavy"))
    assert first.participant.last_report() == (offered,)
    assert second.participant.last_report() == (refused,)
    first.coordinator.receive(offered)
    first.ask_with(first.coordinator.accept())
    assert first.participant.last_report() == ()
    first.ask(EXECUTE)
    completed = first.participant.send(COMPLETED)
    assert first.participant.last_report() == (completed,)


def test_an_answer_to_what_was_never_asked_moves_nothing() -> None:
    pair, _, _ = _two()
    pair.ask(ARRANGE)
    offered = pair.participant.send(TERMS)
    stray = msgspec.structs.replace(offered, header=msgspec.structs.replace(offered.header, relates_to="urn:uuid:other"))
    result = pair.coordinator.receive(stray)
    assert (result.kind, result.moved, pair.coordinator.state) == (Kind.LATE, False, State.ARRANGING)
    assert pair.coordinator.receive(offered).moved
    assert pair.coordinator.state is State.OFFERED


def test_a_fault_about_a_question_ends_no_contract_and_one_about_an_order_does() -> None:
    pair, _, _ = _two()
    arrange = pair.coordinator.send(ARRANGE)
    question = pair.coordinator.send(Query())
    for subject, state in ((question, State.ARRANGING), (arrange, State.ENDED)):
        header = Header(
            sender=SM,
            recipient=TM,
            message_id=f"f{state}",
            relates_to=subject.header.message_id,
            transaction="t1",
            participant=subject.header.participant,
        )
        pair.coordinator.receive(Message(header=header, body=Fault(code="Sender", text="no")))
        assert pair.coordinator.state is state


def test_nothing_is_accepted_before_it_was_offered() -> None:
    pair, _, _ = _two()
    pair.ask(ARRANGE)
    with pytest.raises(UsageError):
        pair.coordinator.accept()
    assert pair.states() == (State.ARRANGING, State.ARRANGING)
    assert pair.coordinator.order == pair.participant.order == ARRANGE
    pair.answer(TERMS)
    with pytest.raises(UsageError, match="the Accept names"):
        pair.coordinator.send(Accept(terms="others"))
    assert pair.states() == (State.OFFERED, State.OFFERED)
