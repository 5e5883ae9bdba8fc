"""Why an operation was not carried out, as the API and the pages say it."""

from __future__ import annotations

import msgspec

from somrs.client.client import Refused
from somrs.errors import FormulaError, InputError, ModelError, SomrsError
from somrs.protocol.messages.knowledge import BrokenRule
from somrs.runtime.wire import Unanswered

__all__ = ["REFUSALS", "NotFound", "Refused", "Trouble", "status", "trouble"]


class NotFound(InputError):
    """There is no such thing."""


class Changed(SomrsError):
    """Somebody else changed it since it was read."""


class Mistake(msgspec.Struct, frozen=True, kw_only=True):
    """What is wrong in a file, and in which line."""

    file: str
    line: int | None
    subject: str
    rule: str
    message: str


class Trouble(msgspec.Struct, frozen=True, kw_only=True):
    """Why an operation was not carried out; nothing was changed. `problem` is for people, and says what to do next. `position`: where in
    the formula, counted from 0; `problems`: each by itself, when there are several. `broken`: the rules that a change of the map or the
    ontology would break, with what each concerns; `mistakes`: those in a file."""

    problem: str
    problems: tuple[str, ...] = ()
    position: int | None = None
    hint: str = ""
    broken: tuple[BrokenRule, ...] = ()
    mistakes: tuple[Mistake, ...] = ()


REFUSALS = {
    400: "What was asked is not right: what, and what to do",
    404: "There is no such thing",
    409: "It cannot be done as things are now",
    503: "A part of the system does not answer; try again",
}
"""By HTTP status."""


def status(error: SomrsError) -> int:
    """The HTTP status that says of which sort the error is."""
    match error:
        case Unanswered():
            return 503
        case NotFound():
            return 404
        case InputError():
            return 400
        case _:
            return 409


def trouble(error: SomrsError) -> Trouble:
    if isinstance(error, FormulaError):
        return Trouble(problem=error.problem, position=error.position, hint=error.hint)
    if isinstance(error, Refused):
        return Trouble(problem=str(error), problems=tuple(str(error).splitlines()), broken=error.broken)
    if isinstance(error, ModelError):
        mistakes = tuple(Mistake(**{name: getattr(one, name) for name in one.__slots__}) for one in error.problems)
        return Trouble(problem=str(error), problems=tuple(map(str, error.problems)), mistakes=mistakes)
    return Trouble(problem=str(error), problems=tuple(str(error).splitlines()))
