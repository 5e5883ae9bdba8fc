"""What a simulated vehicle complains about, and until when."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.states import ErrorLevel, VehicleError
from somrs.adapters.vda5050.simulated.problems import Problem

DRIVE_ERROR = "driveError"
"""The type of the error of a vehicle whose drive is dead."""


class Complaints:
    """`own`: errors that end when somebody mends the vehicle. Others are about messages and work, and end when a new order is accepted."""

    def __init__(self, version: Version) -> None:
        self._version = version
        self.own: list[VehicleError] = []
        self._about_work: list[VehicleError] = []
        self._about_zones: list[VehicleError] = []

    @property
    def errors(self) -> tuple[VehicleError, ...]:
        return (*self.own, *self._about_work, *self._about_zones)

    def add(self, problem: Problem, description: str, **references: str) -> None:
        error = problem.error(self._version, description, **references)
        if error not in self._about_work:
            self._about_work.append(error)

    def forget_work(self) -> None:
        """A new order is accepted."""
        self._about_work = []

    def forget(self, problem: Problem) -> None:
        """Something is over."""
        kind = problem.error(self._version, "").error_type
        self._about_work = [error for error in self._about_work if error.error_type != kind]

    def note_fault(self, fault: str | None) -> None:
        """The body cannot move any more, or can again."""
        self.own = [error for error in self.own if error.error_type != DRIVE_ERROR]
        if fault is not None:
            self.own.append(VehicleError(error_type=DRIVE_ERROR, error_level=ErrorLevel.FATAL, error_description=fault))

    def note_zones(self, problems: Sequence[tuple[Problem, str]]) -> None:
        """What is wrong about the zones in which the vehicle is, by their ids."""
        self._about_zones = [problem.error(self._version, f"the zone {name}", zoneId=name) for problem, name in problems]

    def has(self, *levels: ErrorLevel) -> bool:
        return any(error.error_level in levels for error in self.errors)
