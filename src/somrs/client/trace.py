"""Trace files: the messages of the Failure Recovery Protocol, one JSON object per line, in a file that other programs can follow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from somrs.limits import limits
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.task_views import MessageView
from somrs.storage.log_files import LogFile, older_file

TASK_MANAGER = "TaskManager"


class Line(msgspec.Struct, frozen=True, kw_only=True):
    """A message of a transaction. `at`: seconds since 1970."""

    at: float
    sender: str
    recipient: str
    type: str
    transaction: str
    participant: str
    message_id: str
    relates_to: str | None
    body: dict[str, Any]


def _line_of(message: Message, now: float, coordinator: str) -> Line:
    """The trace line of a message, with `TaskManager` and the names of services in place of addresses."""
    header = message.header
    service = (header.participant or "").partition("#")[0] or header.recipient
    is_outgoing = header.sender == coordinator
    body: dict[str, Any] = msgspec.to_builtins(message.body)
    body.pop("type", None)
    return Line(
        at=now,
        sender=TASK_MANAGER if is_outgoing else service,
        recipient=service if is_outgoing else TASK_MANAGER,
        type=type(message.body).__name__,
        transaction=header.transaction or "",
        participant=header.participant or "",
        message_id=header.message_id,
        relates_to=header.relates_to,
        body={key: value for key, value in body.items() if value is not None},
    )


def lines_of(record: TaskRecord) -> list[Line]:
    """The trace lines of an ended task, from its record."""
    return lines_from(record.messages, record.task)


def lines_from(messages: Sequence[MessageView], task: str) -> list[Line]:
    """The trace lines of a task, with `TaskManager` and the names of services in place of addresses."""
    coordinator = next((message.sender for message in messages if message.type == "Arrange"), "")
    lines = []
    for message in messages:
        service, is_outgoing = message.participant.partition("#")[0], message.sender == coordinator
        body: dict[str, Any] = msgspec.json.decode(message.body)
        lines.append(
            Line(
                at=message.at,
                sender=TASK_MANAGER if is_outgoing else service,
                recipient=service if is_outgoing else TASK_MANAGER,
                type=message.type,
                transaction=task,
                participant=message.participant,
                message_id=message.id,
                relates_to=message.relates_to,
                body={key: value for key, value in body.items() if key != "type" and value is not None},
            )
        )
    return lines


def without_heartbeats(lines: Sequence[Line]) -> list[Line]:
    """The lines without heartbeats, except the last of each sequence of heartbeats of a participant."""
    next_types: dict[str, str] = {}
    kept_lines: list[Line] = []
    for line in reversed(lines):
        if line.type != "Progress" or next_types.get(line.participant) != line.type:
            kept_lines.append(line)
        next_types[line.participant] = line.type
    return kept_lines[::-1]


def trace_file(data: Path, number: int = 1) -> Path:
    """The trace file of the Task Manager with this number, counted from 1."""
    return data / ("messages.jsonl" if number == 1 else f"messages-{number}.jsonl")


class Trace:
    """Writes messages to a trace file. The earlier ones of a long trace are in the file beside it, and the earliest are gone."""

    def __init__(self, path: Path) -> None:
        self._file = LogFile(path, limits().log_bytes)
        self.coordinator = ""

    def __call__(self, message: Message, now: float) -> None:
        self._file.write_line(msgspec.json.encode(_line_of(message, now, self.coordinator)))

    def close(self) -> None:
        self._file.close()


class Follower:
    """Reads a trace file that is still being written."""

    def __init__(self, path: Path) -> None:
        self._path, self._offset = path, 0
        self._file_number: int | None = None
        """The inode of the file that is being read."""

    def new(self) -> Iterator[Line]:
        """The lines that were added since the last call."""
        for path in (older_file(self._path), self._path):
            if not path.exists():
                continue
            number = path.stat().st_ino
            if path == self._path and number != self._file_number:
                self._file_number, self._offset = number, 0
            if number == self._file_number:
                yield from self._lines(path)

    def _lines(self, path: Path) -> Iterator[Line]:
        with path.open("rb") as file:
            file.seek(self._offset)
            for raw in file:
                if not raw.endswith(b"\n"):
                    return
                self._offset += len(raw)
                yield msgspec.json.decode(raw, type=Line)
