"""Wrong rules for reservations, to check the check: each has to violate a property of the model of reservations."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

from somrs.kernel.reservations import Reservations
from verification.model_check.media import DUPLICATING, FIFO, UNORDERED_LOSSY
from verification.model_check.reservation_check import check_reservations
from verification.model_check.reservation_model import ReservationModel

RULES: Mapping[tuple[str, str], Any] = {
    ("_conflicts", "no tasks are in each other's way"): lambda *_, **__: {},
    ("_release", "a task that waits holds what it had"): staticmethod(lambda claimant: None),
    ("admit_waiting", "nobody is told that objects are free"): lambda *_: iter(()),
    ("remove", "a task that has ended is not forgotten"): lambda *_: None,
    ("is_held", "every fencing number is valid"): lambda *_: True,
}
"""The wrong rules, by the method of `Reservations` that each replaces, and what it says."""

CONFIGURATIONS = {
    "restarts": (ReservationModel(medium=UNORDERED_LOSSY, decisions=False), ReservationModel(medium=DUPLICATING, decisions=False)),
    "restarts, leases that end": (ReservationModel(medium=FIFO, decisions=False, lapses=True),),
}
"""The smallest configurations that are checked without wrong rules. One of them catches each wrong rule."""


@contextlib.contextmanager
def replaced(attribute: str, wrong_rule: Any) -> Iterator[None]:
    """Let the wrong rule decide."""
    rule = vars(Reservations)[attribute]
    setattr(Reservations, attribute, wrong_rule)
    try:
        yield
    finally:
        setattr(Reservations, attribute, rule)


def find_violation(attribute: str, wrong_rule: Any) -> str:
    """Return the property that the wrong rule violates, and where, or an empty string."""
    with replaced(attribute, wrong_rule):
        for configuration, models in CONFIGURATIONS.items():
            for model in models:
                cells = check_reservations(model, configuration).cells
                if violated := [str(property) for property, counterexample in cells.items() if counterexample is not None]:
                    return f"{violated[0]} ({model.medium.name}, {configuration})"
    return ""
