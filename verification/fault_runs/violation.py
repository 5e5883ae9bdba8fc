"""The properties that are checked, and the error of a run that violates one."""

from __future__ import annotations

from enum import StrEnum


class Property(StrEnum):
    """The properties of the protocol, and one of the implementation."""

    MUTUAL_EXCLUSION = "mutual exclusion"
    OWN_WORK = "no change of what another task has"
    CONTRACT = "no work without a contract"
    TERMINATION = "termination"
    PARTIAL_RESULT = "no silent partial result"
    MAP = "map correctness"
    ORPHAN = "no orphan"
    RESTART = "restart transparency"
    INVARIANT = "no work without what has to hold meanwhile"
    WAITING = "a wait goes on"
    OUTPUTS = "steps use what services told"
    IDENTITY = "one name for each thing"
    COPIES = "copies are true"
    UNHANDLED_INPUT = "no unhandled input"
    """Not a property of the protocol: no input makes a component fail."""


class Violation(Exception):
    """A violated property, with a description of what was observed."""

    def __init__(self, property: Property, description: str) -> None:
        self.property, self.description = property, description
        super().__init__(f"{property}: {description}")
