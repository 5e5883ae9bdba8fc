"""What only reads, and need not be kept: it leaves everything as it is, and nobody is owed its answer."""

from __future__ import annotations

import pytest

from somrs.kernel.codec import encode
from somrs.kernel.component import Answered, Ask, Received, Send
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.knowledge import (
    Consider,
    Define,
    Definitions,
    QueryMap,
    ReadEvents,
    ReadHistory,
    ReadMap,
    ReadOntology,
    SubscribeMap,
    Undo,
    UpdateMap,
)
from somrs.repository.component import Repository, only_reads
from somrs.repository.state import ArchivedEvents, ArchiveWanted
from tests.support.lab import CLIENT, REPOSITORY, contents, deliver_request, request


@pytest.mark.parametrize(
    "body",
    [
        ReadOntology(), ReadMap(), ReadMap(at_version=0), QueryMap(formula="Jar1 isOn ?Where"), QueryMap(formula="wrong"), ReadEvents(),
        ReadHistory(object="Jar1"), Consider(change=UpdateMap(situation="Jar1 isOn Table2")), Consider(change=Undo(version=1)),
    ],
)  # fmt: skip
def test_what_is_read_on_a_connection_leaves_everything_as_it_is(body: Body) -> None:
    repository = Repository(REPOSITORY, contents())
    deliver_request(repository, UpdateMap(situation="Jar1 isOn Table2"))
    state_before = encode(repository.state)
    message = Message(header=Header(sender=CLIENT, recipient=REPOSITORY, message_id="urn:uuid:1"), body=body)
    assert only_reads(Received(message))
    (effect,) = repository.handle(Received(message), 2.0)
    if isinstance(effect, Ask):
        answered = Answered(effect.question, ArchivedEvents(()))
        assert only_reads(answered)
        (effect,) = repository.handle(answered, 2.0)
    assert isinstance(effect, Send)
    assert effect.message.header.recipient == ANONYMOUS, "nobody is owed it once the connection is gone"
    assert encode(repository.state) == state_before
    assert not only_reads(Received(request(body))), "somebody who has an address waits for it"


@pytest.mark.parametrize("body", [UpdateMap(), Define(definitions=Definitions()), Undo(version=1), SubscribeMap(lease=60)])
def test_what_changes_something_is_more_than_reading(body: Body) -> None:
    message = Message(header=Header(sender=CLIENT, recipient=REPOSITORY, message_id="urn:uuid:1"), body=body)
    assert not only_reads(Received(message))
    assert not only_reads(Answered(ArchiveWanted(message), ArchivedEvents(())))
