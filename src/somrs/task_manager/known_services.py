"""What one task knows about services, as a part of its state. `available_services.py` judges by it."""

from __future__ import annotations

from typing import Self

from msgspec import Struct

from somrs.ontology.services import ServiceType
from somrs.protocol.messages.directory import Offer

FIRST_BACKOFF, LONGEST_BACKOFF = 2.0, 60.0
"""For how long a service is not asked that has failed twice in a row, and at most, in seconds. The time doubles with each failure."""


class Backoff(Struct, frozen=True, kw_only=True):
    """A service that failed is not asked for a while.

    `failures`: so often in the task since it last completed a step in it. `end`: when it may be asked again, in seconds since 1970; after
    its first failure, at once. `device_broke`: its device said that it does not work any more.
    """

    failures: int
    end: float
    device_broke: bool = False

    @classmethod
    def following(cls, previous: Self | None, now: float, *, device_broke: bool) -> Self:
        """That after a failure. `previous`: that after the failure before it, if there was one."""
        failures = previous.failures + 1 if previous is not None else 1
        pause = min(FIRST_BACKOFF * 2.0 ** (failures - 2), LONGEST_BACKOFF) if failures > 1 else 0.0
        return cls(failures=failures, end=now + pause, device_broke=device_broke)


class KnownServices(Struct, kw_only=True):
    """What one task knows about services.

    `offers`: what it discovered itself, in the journal of a program that did so for each task; otherwise None.
    """

    offers: tuple[Offer, ...] | None = None
    broken: dict[str, str] = {}
    """Services that failed or refused in this task, and why: new plans leave them out."""
    unable: set[str] = set()
    """Those of them that refused for good, or reported the same impossible situation twice."""
    silent: set[str] = set()
    """Those of them that fell silent, and have not been heard of since."""
    unoffered: tuple[str, ...] = ()
    """The service types that the latest plan lacked, because no device offered them."""
    failures: dict[str, int] = {}
    """The failures that each service has reported since it last completed a step."""
    backoffs: dict[str, Backoff] = {}
    """The services that have failed since they last completed a step. Refusals and silence do not end the count of these failures."""
    impossible: dict[str, str] = {}
    """Why the last impossible report of each service was rejected."""
    fruitless: set[tuple[str, str]] = set()
    """Devices and uses of services (as `Step.use`) that told nothing in this task. They are not asked for the same again."""
    told: set[str] = set()
    """The uses of services that told something in this task."""
    types: dict[str, ServiceType] = {}
    """The types of all offers so far. A type outlasts its offers, because a service may be committed to a step of it."""
    common_types: dict[str, ServiceType] = {}
    """The types of the latest offers as the ontology defined them then."""
