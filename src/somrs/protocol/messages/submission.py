"""Submitting a task to a Task Manager, and cancelling it."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum

from msgspec import Struct, structs

from somrs.ontology.services import Handler
from somrs.protocol.messages.body import MessageBody


class Policy(StrEnum):
    """How arrangement chooses among Terms."""

    PRICE = "price"
    """The lowest price; at equal prices, the earliest finish."""
    TIME = "time"
    """The earliest finish; at equal times, the lowest price."""
    WEIGHTED = "weighted"
    """The lowest sum of the price and the value of the time (`time_value` per second)."""


class Submit(MessageBody, frozen=True, kw_only=True, tag=True):
    """State a task: make `effect` true.

    `precondition` is the initial situation, if the client states it. `deadline` is in seconds from now, of the world's time.
    `time_value` is the value of a second, in the currency of the terms, for the weighted policy. `handlers` take precedence over those of
    the service types. `priority`: among tasks that wait for the same objects or devices, the one with the higher number goes first; work
    under way is not interrupted.
    `waits`: if no service can do it now, for reasons that pass, the task waits and tries again, until its deadline; otherwise it fails.
    `recognise`: find out whether, and for which objects and values, `effect` holds, instead of making it true (`findings.py`).
    `retry_of`: the id of the ended task that this one repeats.
    """

    effect: str
    precondition: str | None = None
    policy: Policy = Policy.PRICE
    time_value: float = 0.01
    deadline: float | None = None
    handlers: tuple[Handler, ...] = ()
    priority: int = 0
    waits: bool = True
    recognise: bool = False
    retry_of: str | None = None


class SubmitOnce(MessageBody, frozen=True, kw_only=True, tag=True):
    """State a task at one of several Task Managers. The same message may be sent to several of them, for example because one does not
    answer: it is one task. They agree at the Repository whose it is, and answer that (`TaskAssigned`)."""

    submission: Submit


def with_formulas(task: Submit, write: Callable[[str], str]) -> Submit:
    """Return the task with each of its formulas as `write` returns it."""

    def write_optional(formula: str | None) -> str | None:
        return write(formula) if formula is not None else None

    return structs.replace(
        task,
        effect=write(task.effect),
        precondition=write_optional(task.precondition),
        handlers=tuple(
            structs.replace(handler, effect=write(handler.effect), when=write_optional(handler.when)) for handler in task.handlers
        ),
    )


class Submitted(MessageBody, frozen=True, kw_only=True, tag=True):
    task: str


class FormulaMistake(Struct, frozen=True, kw_only=True):
    """A mistake in a formula: the formula, the position in it (counted from 0), what is wrong there, and what was expected."""

    text: str
    position: int
    problem: str
    hint: str = ""


class TaskRejected(MessageBody, frozen=True, kw_only=True, tag=True):
    """The task is not valid, and why: for people, and for a mistake in one of its formulas also for programs."""

    problem: str
    mistake: FormulaMistake | None = None


class CancelTask(MessageBody, frozen=True, kw_only=True, tag=True):
    task: str
    reason: str = "cancelled by the client"


class PauseTask(MessageBody, frozen=True, kw_only=True, tag=True):
    """Pause a task, or let it go on (`resume`). Nothing of a paused task begins; its devices stand still; its deadline stays."""

    task: str
    resume: bool = False
    author: str = ""


class TaskPaused(MessageBody, frozen=True, kw_only=True, tag=True):
    """The answer to PauseTask: whether the task is paused now. One that has ended is not."""

    task: str
    paused: bool


class Cancelling(MessageBody, frozen=True, kw_only=True, tag=True):
    task: str
