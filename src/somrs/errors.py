"""The exceptions that SO-MRS raises.

    SomrsError
    ├── InputError            invalid input; the message gives the place, the problem and what to do next
    │   ├── FormulaError      a text that is not Entish, or uses a name that the ontology does not have
    │   ├── ModelError        an ontology, map or site that breaks its rules; holds every Problem
    │   ├── DeviceError       a device class or program that cannot run as it is written
    │   └── UsageError        a command or call that cannot be carried out as given
    │       └── SettingsError settings of an adapter that are not valid; holds every mistake
    ├── WireError             bytes or a message from another program that cannot be processed; becomes a SOAP Fault
    ├── RemoteError           another component refused a request, failed, or did not reply
    └── SimulationError       the simulated world cannot be built, or its physics is invalid (NaN)

Any other exception is a defect of SO-MRS.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


class SomrsError(Exception):
    """The base class of all exceptions of SO-MRS."""


class InputError(SomrsError):
    """Invalid input, which the user can correct."""


class FormulaError(InputError):
    """A formula that cannot be parsed or does not agree with the ontology.

    `text` is the whole formula, `position` the 0-based offset of the invalid part, `problem` what is wrong there,
    `hint` what is expected or which similar names exist.
    """

    def __init__(self, text: str, position: int, problem: str, hint: str = "") -> None:
        self.text, self.position, self.problem, self.hint = text, position, problem, hint
        super().__init__(text, position, problem, hint)

    def __str__(self) -> str:
        text_before = self.text[: self.position]
        line_start = text_before.rfind("\n") + 1
        line_end = self.text.find("\n", self.position)
        line = self.text[line_start:] if line_end < 0 else self.text[line_start:line_end]
        caret = " " * (self.position - line_start) + "^"
        return f"{self.problem}\n  {line}\n  {caret}" + (f"\n{self.hint}" if self.hint else "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One violated rule in a file: the place, the object or type (`subject`), the rule, and what to do (`message`)."""

    file: str
    line: int | None
    subject: str
    rule: str
    message: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line is not None else self.file
        return f"{place}: {self.subject}: {self.message} [{self.rule}]"


class ModelError(InputError):
    """An ontology, map or site that violates its rules; `problems` holds all violations."""

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = problems
        super().__init__(problems)

    def __str__(self) -> str:
        return "\n".join(str(problem) for problem in self.problems)


class DeviceError(InputError):
    """A device class or program that cannot run as it is written."""


class UsageError(InputError):
    """A command or call that cannot be carried out as given."""


Mistake = tuple[tuple[str | int, ...], str]
"""Where it is below the name of an adapter, and what to do about it."""


class SettingsError(UsageError):
    """Settings of an adapter that are not valid. `mistakes`: of each, where it is below the name of the adapter, and what to do."""

    def __init__(self, adapter: str, mistakes: Sequence[Mistake]) -> None:
        self.adapter, self.mistakes = adapter, mistakes
        super().__init__(adapter, mistakes)

    def __str__(self) -> str:
        return "\n".join(f"{'.'.join(map(str, ('adapters', self.adapter, *path)))}: {message}" for path, message in self.mistakes)


class WireError(SomrsError):
    """A message that cannot be processed. `code` is a SOAP 1.2 / WS-Addressing fault code or subcode.

    `headers` are the mandatory header blocks, as `{namespace}name`, that were not understood.
    """

    def __init__(self, code: str, text: str, headers: tuple[str, ...] = ()) -> None:
        self.code, self.text, self.headers = code, text, headers
        super().__init__(code, text)

    def __str__(self) -> str:
        return f"{self.code}: {self.text}"


class RemoteError(SomrsError):
    """Another component refused a request, failed, or did not reply."""


class SimulationError(SomrsError):
    """The simulated world cannot be built, or its physics is invalid."""
