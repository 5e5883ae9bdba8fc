"""Why an operation was not carried out, as the API and the pages say it."""

from __future__ import annotations

import msgspec

from somrs.client.client import Refused
from somrs.errors import FormulaError, InputError, ModelError, Problem, RemoteError, SomrsError, UsageError
from somrs.protocol.messages.knowledge import BrokenRule, Rejected
from somrs.runtime.wire import Unanswered

__all__ = ["REFUSALS", "Changed", "ErrorReport", "NotFound", "Refused", "error_report", "refusal", "refusal_of", "status"]


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


class ErrorReport(msgspec.Struct, frozen=True, kw_only=True):
    """Why an operation was not carried out; nothing was changed. `problem` is for people, and says what to do next; `error` says for
    programs of which sort it is. `position`: where in the formula, which is `text`, counted from 0; `problems`: each by itself, when there
    are several. `broken`: the rules that a change of the map or the ontology would break, with what each concerns; `mistakes`: those in a
    file."""

    problem: str
    error: str = ""
    text: str = ""
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


def error_report(error: SomrsError) -> ErrorReport:
    """The error as it is sent."""
    sort = type(error).__name__
    if isinstance(error, FormulaError):
        return ErrorReport(problem=error.problem, error=sort, text=error.text, position=error.position, hint=error.hint)
    problems = tuple(str(error).splitlines())
    if isinstance(error, Refused):
        return ErrorReport(problem=str(error), error=sort, problems=problems, broken=error.broken)
    if isinstance(error, ModelError):
        mistakes = tuple(Mistake(**{name: getattr(problem, name) for name in problem.__slots__}) for problem in error.problems)
        return ErrorReport(problem=str(error), error=sort, problems=tuple(map(str, error.problems)), mistakes=mistakes)
    return ErrorReport(problem=str(error), error=sort, problems=problems)


def refusal(code: int, report: ErrorReport) -> SomrsError:
    """The error again, of what was sent with this HTTP status."""
    match report:
        case ErrorReport(position=int() as position):
            return FormulaError(report.text, position, report.problem, report.hint)
        case ErrorReport(mistakes=mistakes) if mistakes:
            return ModelError([Problem(**msgspec.structs.asdict(mistake)) for mistake in mistakes])
        case ErrorReport(error="Refused"):
            return Refused(Rejected(problems=report.problems, broken=report.broken))
        case ErrorReport(error="Changed"):
            return Changed(report.problem)
    return {400: UsageError, 404: NotFound, 503: Unanswered}.get(code, RemoteError)(report.problem)


def refusal_of(report: ErrorReport) -> SomrsError:
    """The error again, of what another part of the system said, which has no HTTP status."""
    return refusal({"NotFound": 404, "RemoteError": 409, "Unanswered": 503}.get(report.error, 400), report)
