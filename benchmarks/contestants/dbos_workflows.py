"""DBOS on its SQLite system database: a durable workflow for each conversation, in one process, in two forms.

`Steps` is the fastest variant for DBOS: a workflow calls the bidders as steps, one after the other in a thread (faster than coroutines, and
than all at the same time). A step is written once, at its end, so two messages (Arrange and its Terms, Execute and its Completed) cost one
write. `Messages` works as the other contestants do: the bidders are separate workflows, and all messages use `send` and `recv`; a message
to all bidders is one transaction. Both use a write-ahead log with `synchronous=FULL`, which is not DBOS's default, and is faster.
"""

from __future__ import annotations

import asyncio
import uuid
from pathlib import Path
from typing import Any

import msgspec
import sqlalchemy
from dbos import DBOS, DBOSConfig, SendMessage, SetWorkflowID

from contestants.contest import BIDDERS
from contestants.conversation import Bidder, Negotiation, Note, Speaker

COORDINATOR = "task-manager"
NAMES = tuple(f"robot-{number}" for number in range(BIDDERS))
POLL = 0.001
"""The polling interval in seconds: on SQLite DBOS polls for messages, and this is the shortest interval."""

Record = dict[str, Any]
"""A note in the form that DBOS stores."""

bidders = {name: Bidder(name, number) for number, name in enumerate(NAMES)}
speaker = Speaker(COORDINATOR)


def _record(note: Note) -> Record:
    record: Record = msgspec.structs.asdict(note)
    return record


def _launch(data: Path) -> None:
    engine = sqlalchemy.create_engine(f"sqlite:///{data / 'dbos.sqlite'}", pool_size=20, max_overflow=0, pool_timeout=30)

    @sqlalchemy.event.listens_for(engine, "connect")
    def prepare(connection: Any, record: Any) -> None:
        connection.isolation_level = "IMMEDIATE"  # as in DBOS's own connections
        for setting in ("journal_mode=WAL", "synchronous=FULL", "busy_timeout=30000", "foreign_keys=ON"):
            connection.execute(f"PRAGMA {setting}")

    config: DBOSConfig = {
        "name": "coordination",
        "system_database_engine": engine,
        "log_level": "ERROR",
        "notification_listener_polling_interval_sec": POLL,
    }
    DBOS(config=config)
    DBOS.launch()


# Steps


@DBOS.step()
def ask(record: Record) -> Record | None:
    """Send a bidder a note, and return its answer."""
    answer = bidders[record["recipient"]].answer(Note(**record))
    return _record(answer) if answer is not None else None


@DBOS.workflow()
def contract(transaction: str) -> str:
    negotiation = Negotiation(speaker, transaction, NAMES)
    notes = negotiation.open()
    while notes:
        answers = [ask(_record(note)) for note in notes]
        notes = [note for answer in answers if answer is not None for note in negotiation.receive(Note(**answer))]
    return "accomplished"


class Steps:
    async def start(self, data: Path) -> None:
        _launch(data)

    async def converse(self, line: int) -> None:
        await asyncio.to_thread(contract, uuid.uuid4().urn)

    async def stop(self) -> None:
        DBOS.destroy()


# Messages


def _mailbox(name: str, transaction: str) -> str:
    """Return the id of a party's workflow in a conversation."""
    return f"{transaction}/{name}"


async def _send_notes(notes: list[Note]) -> None:
    await DBOS.send_bulk_async([SendMessage(_mailbox(note.recipient, note.transaction), _record(note)) for note in notes])


@DBOS.workflow()
async def bid(name: str) -> str:
    """A bidder's workflow in one conversation: it runs until its Cancel or End."""
    while True:
        note = Note(**await DBOS.recv_async())
        answer = bidders[name].answer(note)
        if answer is not None:
            await DBOS.send_async(_mailbox(answer.recipient, answer.transaction), _record(answer))
        if note.kind in ("Cancel", "End"):
            return note.kind


@DBOS.workflow()
async def negotiate(transaction: str) -> str:
    negotiation = Negotiation(speaker, transaction, NAMES)
    await _send_notes(negotiation.open())
    while not negotiation.is_finished:
        if notes := negotiation.receive(Note(**await DBOS.recv_async())):
            await _send_notes(notes)
    return "accomplished"


class Messages:
    async def start(self, data: Path) -> None:
        _launch(data)

    async def converse(self, line: int) -> None:
        transaction = uuid.uuid4().urn
        for name in NAMES:
            with SetWorkflowID(_mailbox(name, transaction)):
                await DBOS.start_workflow_async(bid, name)
        with SetWorkflowID(_mailbox(COORDINATOR, transaction)):
            await negotiate(transaction)

    async def stop(self) -> None:
        DBOS.destroy()
