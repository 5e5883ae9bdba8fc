"""The questions that a person's Service Manager asks (`devices/person/device.py`), and their answers."""

from __future__ import annotations

import time
from pathlib import Path

from somrs.client.client import Addresses
from somrs.devices.person.questions import FILE, Question, Questions
from somrs.errors import RemoteError, UsageError

ANSWER_PATIENCE = 10.0
"""Seconds within which a person's Service Manager processes an answer, if it runs."""


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
        RemoteError: the Service Manager did not process the answer within `ANSWER_PATIENCE`.
    """
    if formula is not None and not formula.strip():
        raise UsageError("an answer is a formula that holds now; otherwise answer that you cannot tell")
    if not (data / FILE).exists():
        Addresses.read(data)
    store = Questions(data)
    try:
        store.answer(number, formula or "")
        _wait(store, number)
    finally:
        store.close()


def _wait(store: Questions, number: int) -> None:
    end, person = time.monotonic() + ANSWER_PATIENCE, ""
    while time.monotonic() < end:
        question = store.read(number)
        assert question is not None, "questions are not deleted"
        person = question.person
        if question.ended == "taken":
            return
        if question.ended is not None:
            raise UsageError(f"the answer came too late: {question.ended}")
        if question.problem:
            raise UsageError(f"{question.problem}\nthe question is still open; answer it again")
        time.sleep(0.1)
    raise RemoteError(f"the answer was not accepted within {ANSWER_PATIENCE:.0f} s; is the program of {person} running?")
