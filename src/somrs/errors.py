"""Every error that SO-MRS raises on purpose.

    SomrsError
    ├── InputError            what somebody gave us is wrong; the message says where, what, and what to do next
    │   ├── FormulaError      a text that is not Entish, or names what the ontology does not have
    │   ├── ModelError        an ontology, map or site that breaks its rules: carries every Problem at once
    │   ├── DeviceError       a device author's class or program that cannot be run as it is
    │   └── UsageError        a command or call that cannot be carried out as asked
    ├── WireError             bytes or a message from another program that we cannot process; becomes a SOAP Fault
    ├── RemoteError           another component answered that it cannot do what we asked, or did not answer
    └── SimulationError       the physics stopped making sense (NaN, a world that cannot be built)

Anything else that escapes is a defect of SO-MRS itself.
"""

from __future__ import annotations

from dataclasses import dataclass


class SomrsError(Exception):
    """The root: catch this to catch everything that SO-MRS raises on purpose."""


class InputError(SomrsError):
    """Something given to us is wrong, and the person who gave it can mend it."""


class FormulaError(InputError):
    """A formula that cannot be read or does not fit the ontology.

    `text` is the whole formula, `position` the 0-based offset of the offending part, `problem` what is wrong there,
    `hint` what was expected or which name was probably meant.
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
    """One broken rule in a file: where it is, which object or type it concerns, which rule, and what to do."""

    file: str
    line: int | None
    subject: str
    rule: str
    message: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line is not None else self.file
        return f"{place}: {self.subject}: {self.message} [{self.rule}]"


class ModelError(InputError):
    """An ontology, map or site that does not obey its rules; `problems` holds all of them."""

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = problems
        super().__init__(problems)

    def __str__(self) -> str:
        return "\n".join(str(problem) for problem in self.problems)


class DeviceError(InputError):
    """A device class or program that cannot be run as it is written."""


class UsageError(InputError):
    """A command or call that cannot be carried out as asked."""


class WireError(SomrsError):
    """A message that cannot be processed. `code` is a SOAP 1.2 / WS-Addressing fault code or subcode.

    `headers` are the header blocks, as `{namespace}name`, that had to be understood and were not.
    """

    def __init__(self, code: str, text: str, headers: tuple[str, ...] = ()) -> None:
        self.code, self.text, self.headers = code, text, headers
        super().__init__(code, text)

    def __str__(self) -> str:
        return f"{self.code}: {self.text}"


class RemoteError(SomrsError):
    """Another component refused, failed or did not answer."""


class SimulationError(SomrsError):
    """The simulated world cannot be built, or its physics stopped making sense."""
