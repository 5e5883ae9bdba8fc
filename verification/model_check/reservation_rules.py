"""Wrong rules for reservations, to check the check: each has to violate a property of the model of reservations."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from somrs.kernel.reservations import Reservations
from somrs.repository.shared_reserving import SharedReserving
from verification.model_check import shared_reservation_repository
from verification.model_check.media import DUPLICATING, FIFO, UNORDERED_LOSSY
from verification.model_check.reservation_check import check_reservations
from verification.model_check.reservation_model import ReservationModel
from verification.model_check.shared_reservation_model import SharedReservationModel

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


SHARED_RULES: Mapping[tuple[str, str], tuple[object, Any]] = {
    ("_release_at", "what a task had at a neighbour is not released"): (SharedReserving, lambda *_: iter(())),
    ("_freed", "nobody is told that a neighbour's objects are free"): (SharedReserving, lambda *_: iter(())),
    ("_lost", "a task keeps what a neighbour has given away"): (SharedReserving, lambda *_: iter(())),
    ("reservation_at", "reports name no reservation at the neighbour"): (shared_reservation_repository, lambda *_: None),
}
"""The wrong rules for reservations at neighbours: each with what has the rule."""

EXPLANATIONS = {
    "a task keeps what a neighbour has given away": "the neighbour refuses its reports until the other task has ended: it works in vain",
}
"""Why wrong rules violate no property, by what they say."""

SHARED_CONFIGURATIONS = {
    "delays": (SharedReservationModel(medium=FIFO, delays=True),),
    "delays, leases that end": (SharedReservationModel(medium=FIFO, delays=True, lapses=True),),
}
"""Where each of these is caught."""


@contextlib.contextmanager
def replaced(owner: object, attribute: str, wrong_rule: Any) -> Iterator[None]:
    """Let the wrong rule decide."""
    rule = vars(owner)[attribute]
    setattr(owner, attribute, wrong_rule)
    try:
        yield
    finally:
        setattr(owner, attribute, rule)


def find_violation(attribute: str, wrong_rule: Any) -> str:
    """Return the property that the wrong rule violates, and where, or an empty string."""
    return _violation(Reservations, attribute, wrong_rule, CONFIGURATIONS)


def find_shared_violation(attribute: str, owner: object, wrong_rule: Any) -> str:
    """Return the property that the wrong rule for reservations at neighbours violates, and where, or an empty string."""
    return _violation(owner, attribute, wrong_rule, SHARED_CONFIGURATIONS)


def _violation(
    owner: object, attribute: str, wrong_rule: Any, configurations: Mapping[str, Iterable[ReservationModel | SharedReservationModel]]
) -> str:
    with replaced(owner, attribute, wrong_rule):
        for configuration, models in configurations.items():
            for model in models:
                cells = check_reservations(model, configuration).cells
                if violated := [str(property) for property, counterexample in cells.items() if counterexample is not None]:
                    return f"{violated[0]} ({model.medium.name}, {configuration})"
    return ""
