"""The questions that a person's Service Manager asks (`devices/person/device.py`), and their answers."""

from __future__ import annotations

from pathlib import Path

from somrs.client.addresses import Addresses
from somrs.client.reply_wait import wait_until_accepted
from somrs.devices.person.questions import FILE, Question, Questions
from somrs.errors import UsageError


def open_questions(data: Path) -> list[Question]:
    """The questions that wait for an answer in the system of the data folder. Raises UsageError if no system runs there."""
    if not (data / FILE).exists():
        Addresses.read(data)  # raises UsageError where no system runs
        return []
    store = Questions(data)
    try:
        return store.open()
    finally:
        store.close()


def put_answer(number: int, formula: str | None, data: Path) -> None:
    """Answer a question, and wait until the person's Service Manager has accepted the answer. `formula`: None for "cannot tell".

    Raises:
        UsageError: the answer is unsuitable or too late.
        RemoteError: the Service Manager did not process the answer within `PATIENCE`.
    """
    if formula is not None and not formula.strip():
        raise UsageError("an answer is a formula that holds now; otherwise answer that you cannot tell")
    if not (data / FILE).exists():
        Addresses.read(data)
    store = Questions(data)
    try:
        store.answer(number, formula or "")
        wait_until_accepted(
            lambda: store.read(number),
            lambda question: question.ended == "taken",
            reply="answer",
            still_open="the question is still open; answer it again",
        )
    finally:
        store.close()
