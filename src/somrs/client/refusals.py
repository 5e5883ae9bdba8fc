"""Errors of operations, and how the API sends them."""

from __future__ import annotations

import msgspec

from somrs.client.client import Refused, RequestMistaken
from somrs.errors import FormulaError, InputError, ModelError, Problem, RemoteError, SomrsError, UsageError
from somrs.protocol.messages.knowledge import BrokenRule, Rejected
from somrs.runtime.wire import Unanswered

__all__ = [
    "REFUSALS",
    "Changed",
    "ErrorReport",
    "Forbidden",
    "NotFound",
    "Refused",
    "TooSoon",
    "Unauthenticated",
    "WrongFormat",
    "WrongMethod",
    "error_report",
    "refusal",
    "refusal_of",
    "status",
]


class NotFound(InputError):
    """The object of the request does not exist."""


class WrongMethod(InputError):
    """The path exists, and does not have the method of the request."""


class WrongFormat(InputError):
    """The body of the request is not in a format that is read."""


class Forbidden(InputError):
    """Who sends the request may not do so."""


class Unauthenticated(InputError):
    """Who sends the request has not proven who it is."""


class TooSoon(InputError):
    """After wrong tries, the next one has to wait."""


class Changed(SomrsError):
    """The object of the request has changed since the client read it."""


class Mistake(msgspec.Struct, frozen=True, kw_only=True):
    """A mistake in a file."""

    file: str
    line: int | None
    subject: str
    rule: str
    message: str


class ErrorReport(msgspec.Struct, frozen=True, kw_only=True):
    """Why an operation was not carried out; nothing was changed.

    `problem`: a text for users, with what to do next; `error`: the kind of error, for programs. `problems`: the problems one by one, if
    there are several. For a mistake in a formula: `text`, the formula; `position` in it, counted from 0; `hint`, what was expected.
    `broken`: the rules that a change of the map or the ontology would break, with what each concerns. `mistakes`: mistakes in a file.
    """

    problem: str
    error: str = ""
    text: str = ""
    problems: tuple[str, ...] = ()
    position: int | None = None
    hint: str = ""
    broken: tuple[BrokenRule, ...] = ()
    mistakes: tuple[Mistake, ...] = ()


REFUSALS = {
    400: "The request is invalid; the report says what is wrong and what to do",
    401: "Who sends the request has to prove who it is: sign in, or send a token",
    403: "Who sends the request may not do so: it lacks the right, or is the page of another site",
    404: "The object of the request does not exist",
    409: "The request cannot be carried out in the current state",
    503: "A component of the system does not answer; try again",
}
"""Descriptions of the errors by HTTP status."""


def status(error: SomrsError) -> int:
    """The HTTP status of an error."""
    match error:
        case Unanswered():
            return 503
        case NotFound():
            return 404
        case Unauthenticated():
            return 401
        case Forbidden():
            return 403
        case TooSoon():
            return 429
        case WrongMethod():
            return 405
        case WrongFormat():
            return 415
        case InputError() | RequestMistaken():
            return 400
        case _:
            return 409


def error_report(error: SomrsError) -> ErrorReport:
    """The error as the API sends it."""
    sort = type(error).__name__
    if isinstance(error, FormulaError):
        return ErrorReport(problem=error.problem, error=sort, text=error.text, position=error.position, hint=error.hint)
    if isinstance(error, Refused):
        return ErrorReport(problem=str(error), error=sort, problems=error.problems, broken=error.broken)
    if isinstance(error, ModelError):
        mistakes = tuple(Mistake(**{name: getattr(problem, name) for name in problem.__slots__}) for problem in error.problems)
        return ErrorReport(problem=str(error), error=sort, problems=tuple(map(str, error.problems)), mistakes=mistakes)
    return ErrorReport(problem=str(error), error=sort)


_BY_STATUS: dict[int, type[SomrsError]] = {
    400: UsageError,
    401: Unauthenticated,
    403: Forbidden,
    404: NotFound,
    405: WrongMethod,
    415: WrongFormat,
    429: TooSoon,
    503: Unanswered,
}


def refusal(code: int, report: ErrorReport) -> SomrsError:
    """The error that was sent as this report with this HTTP status."""
    match report:
        case ErrorReport(position=int() as position):
            return FormulaError(report.text, position, report.problem, report.hint)
        case ErrorReport(mistakes=mistakes) if mistakes:
            return ModelError([Problem(**msgspec.structs.asdict(mistake)) for mistake in mistakes])
        case ErrorReport(error="Refused"):
            return Refused(Rejected(problems=report.problems, broken=report.broken))
        case ErrorReport(error="Changed"):
            return Changed(report.problem)
    return _BY_STATUS.get(code, RemoteError)(report.problem)


def refusal_of(report: ErrorReport) -> SomrsError:
    """The error that another component sent as this report, without an HTTP status."""
    return refusal({"NotFound": 404, "RemoteError": 409, "Unanswered": 503}.get(report.error, 400), report)
