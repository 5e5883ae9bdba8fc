"""What exactly the two sides of a contract say: headers, relations, words and ids."""

from __future__ import annotations

import pytest

from somrs.errors import UsageError
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.frp.session import participant_id, service_of
from somrs.protocol.messages.bodies import FrpBody
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Accept, Completed, Fault, Progress, Query, Refuse, State, Status
from tests.support.sessions import ARRANGE, END, EXECUTE, IDENTITY, SM, TERMS, TM, coordinator, executing, message, offered, participant


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


def test_a_refusal_is_why_both_ended() -> None:
    coordinator_side, participant_side = offered()
    coordinator_side.receive(participant_side.send(Refuse(reason="the terms expired")))
    assert (coordinator_side.state, coordinator_side.reason, participant_side.state, participant_side.reason) == (
        State.ENDED,
        "the terms expired",
    ) * 2


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


def test_what_is_kept_stays_as_it_was() -> None:
    for session in (coordinator(), participant(State.ARRANGING)):
        saved = session.copy()
        assert saved == session
        session.send(ARRANGE if isinstance(session, CoordinatorSession) else TERMS)  # type: ignore[arg-type]  # each of its own side
        assert saved != session
