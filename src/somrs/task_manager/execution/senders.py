"""Who may speak for a participant: the address that its session was made with, or at which its service is on offer since."""

from __future__ import annotations

from msgspec import structs

from somrs.kernel.component import Effect, Send
from somrs.kernel.service_replica import ServiceReplica
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.session import reply_address
from somrs.protocol.messages.envelope import Message
from somrs.task_manager.execution.member import Member


def follow_address(member: Member, directory: ServiceReplica | None) -> bool:
    """Go on with a participant where its service is on offer: a device may have another address after a restart. Returns whether it has."""
    offer = directory.offers.get(member.offer.service) if directory is not None else None
    if offer is None or offer.address == member.session.peer:
        return False
    member.session.peer = offer.address
    return True


def answer_stranger(message: Message, address: str) -> list[Effect]:
    """The answers to a sender that is no participant here, for example of a transaction that ended long ago."""
    header = message.header
    if header.transaction is None or header.participant is None:
        return []
    session = CoordinatorSession(transaction=header.transaction, participant=header.participant, me=address, peer=header.sender)
    recipient = reply_address(header)
    return [
        Send(structs.replace(answer, header=structs.replace(answer.header, recipient=recipient)))
        for answer in session.receive(message).answers
    ]
