"""The two sides of a contract in a few states."""

from __future__ import annotations

from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.messages.bodies import FrpBody
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Arrange, Compensate, End, Execute, Outcome, State, Stop, Terms

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


def message(body: FrpBody, relates_to: str | None = None, sender: str = TM, reply_to: str | None = None) -> Message:
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
