"""The messages of a conversation, for contestants without their own: as many as the protocol's, and of the same size."""

from __future__ import annotations

import uuid
from itertools import count

from msgspec import Struct

Body = dict[str, str | float]


class Note(Struct, frozen=True, kw_only=True):
    """A message. Its header has the same information as one of the Failure Recovery Protocol."""

    kind: str
    sender: str
    recipient: str
    id: str
    relates_to: str | None
    transaction: str
    participant: str
    body: Body


GOAL = "Jar002 isOn Platform001"
BODIES: dict[str, Body] = {
    "Arrange": {
        "service_type": "TransferObject",
        "object": "Jar002",
        "destination": "Platform001",
        "effect": GOAL,
        "precondition": "Jar002 isOn Cupboard001",
        "earliest_start": 1767225600.0,
        "reply_by": 1767225610.0,
    },
    "Terms": {
        "effect": GOAL,
        "precondition": "Jar002 isOn Cupboard001",
        "price": 4.0,
        "currency": "EUR",
        "duration": 1.0,
        "start_from": 1767225600.0,
        "valid_until": 1767225720.0,
    },
    "Accept": {"terms": "urn:uuid:6f1c9f0e-5a58-5b5e-9a36-50e4c0a0f5f1"},
    "Cancel": {"reason": "another service was chosen by price"},
    "Execute": {"object": "Jar002", "destination": "Platform001", "precondition": "Jar002 isOn Cupboard001"},
    "Completed": {"situation": GOAL},
    "End": {"outcome": "accomplished"},
}
"""The body of each message."""


class Speaker:
    """Writes the messages of one side. Ids are unique, and cheaper than ids that are reproduced after a restart."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._life = uuid.uuid4().urn
        self._counter = count()

    def write_note(
        self, kind: str, recipient: str, transaction: str, participant: str, request: Note | None = None, body: Body | None = None
    ) -> Note:
        return Note(
            kind=kind,
            sender=self.name,
            recipient=recipient,
            id=f"{self._life}-{next(self._counter)}",
            relates_to=request.id if request is not None else None,
            transaction=transaction,
            participant=participant,
            body=body or BODIES[kind],
        )


class Bidder:
    """A bidder. Its price differs from one conversation to the next, so that each bidder gets some contracts."""

    def __init__(self, name: str, number: int) -> None:
        self._speaker, self._number = Speaker(name), number
        self._offers = 0

    def answer(self, note: Note) -> Note | None:
        match note.kind:
            case "Arrange":
                self._offers += 1
                price = float((self._offers + self._number) % 10)
                return self._reply("Terms", note, {**BODIES["Terms"], "price": price})
            case "Execute":
                return self._reply("Completed", note)
            case _:
                return None

    def _reply(self, kind: str, request: Note, body: Body | None = None) -> Note:
        return self._speaker.write_note(kind, request.sender, request.transaction, request.participant, request, body)


class Negotiation:
    """The coordinator's side of one conversation: its first messages, and its answers."""

    def __init__(self, speaker: Speaker, transaction: str, bidders: tuple[str, ...]) -> None:
        self._speaker, self._transaction, self._bidders = speaker, transaction, bidders
        self._terms: list[Note] = []
        self.is_finished = False

    def open(self) -> list[Note]:
        return [self._write_note("Arrange", bidder) for bidder in self._bidders]

    def receive(self, note: Note) -> list[Note]:
        match note.kind:
            case "Terms":
                self._terms.append(note)
                return self._award() if len(self._terms) == len(self._bidders) else []
            case "Completed":
                self.is_finished = True
                return [self._write_note("End", note.sender, note)]
            case _:
                return []

    def _award(self) -> list[Note]:
        best = min(self._terms, key=lambda terms: (terms.body["price"], terms.sender))
        decided = [self._write_note("Accept" if terms is best else "Cancel", terms.sender, terms) for terms in self._terms]
        return [*decided, self._write_note("Execute", best.sender, best)]

    def _write_note(self, kind: str, bidder: str, request: Note | None = None) -> Note:
        return self._speaker.write_note(kind, bidder, self._transaction, f"{bidder}.TransferObject#s1", request)
