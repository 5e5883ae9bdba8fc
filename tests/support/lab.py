"""A small laboratory on the map, and functions that send requests to a Repository, for tests of the Repository and its replicas."""

from __future__ import annotations

import itertools
from typing import TypeVar

from somrs.kernel.component import Component, Effect, Received, Record, Send
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.repository.state import Contents
from tests.support.building import building

REPOSITORY = "http://here/repository"
CLIENT = "http://127.0.0.1/client"

SITE = (
    building("Lab", 10, 10, "Room1: {type: Room}", "Room2: {type: Room}")
    + """
  Table1: {type: Table, at: [1, 1, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.7}}
  Table2: {type: Table, at: [8, 8, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.7}, Color: Red}
  Jar1: {type: Jar, at: [1, 1, 0.7]}
  Jar2: {type: Jar, at: [1.2, 1, 0.7], Color: Blue}
  Robot1: {type: PioneerP3DX, at: [3, 3, 0]}
facts:
  - Jar1 isOn Table1
  - Jar2 isOn Table1
  - Room1 isAdjacentTo Room2
"""
)

_numbers = itertools.count()

B = TypeVar("B")


def lab() -> tuple[Ontology, Map]:
    loaded = load_text(SITE, base=upper())
    assert loaded.map is not None
    return loaded.ontology, loaded.map


def contents() -> Contents:
    ontology, map = lab()
    return Contents(ontology=ontology, map=map)


def request(body: Body, sender: str = CLIENT, recipient: str = REPOSITORY, identity: str | None = None) -> Message:
    """Return a message with a new id, whose answer goes to its sender."""
    identity = identity or message_id("request", next(_numbers))
    return Message(header=Header(sender=sender, recipient=recipient, message_id=identity, reply_to=sender), body=body)


def ask_on_connection(body: Body, recipient: str) -> Message:
    """Return a message with a new id, whose answer comes back on its connection."""
    identity = message_id("request", next(_numbers))
    return Message(header=Header(sender=CLIENT, recipient=recipient, message_id=identity, reply_to=ANONYMOUS), body=body)


def deliver_request(component: Component, body: Body, now: float = 0.0, sender: str = CLIENT, identity: str | None = None) -> list[Effect]:
    return component.handle(Received(request(body, sender, identity=identity)), now)


def sent_bodies(effects: list[Effect], body_type: type[B]) -> list[B]:
    """Return the bodies of this type that are sent, in order."""
    return [e.message.body for e in effects if isinstance(e, Send) and isinstance(e.message.body, body_type)]


def ask(component: Component, body: Body, answer: type[B], now: float = 0.0, sender: str = CLIENT, identity: str | None = None) -> B:
    """Return the answer, which has to be a single one of that type."""
    bodies = sent_bodies(deliver_request(component, body, now, sender, identity), object)
    (reply,) = [body for body in bodies if isinstance(body, answer)] or bodies
    assert isinstance(reply, answer), reply
    return reply


def records(effects: list[Effect]) -> list[object]:
    return [effect.entry for effect in effects if isinstance(effect, Record)]
