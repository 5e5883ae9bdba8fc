"""Previews: the plan of a task, its price and its duration, or the reasons why there is none, without executing it."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.submission import Policy
from somrs.protocol.messages.task_views import StepView
from somrs.protocol.messages.waits import WaitsForTasks


class Preview(MessageBody, frozen=True, kw_only=True, tag=True):
    """Plan a task without executing it.

    With `quotes`, the answer has the terms of services, without contracts. The best terms are chosen as in a task with this `policy`,
    `time_value` and `deadline`.
    """

    effect: str
    precondition: str | None = None
    quotes: bool = False
    policy: Policy = Policy.PRICE
    time_value: float = 0.01
    deadline: float | None = None
    priority: int = 0
    recognise: bool = False


class Quotation(Struct, frozen=True, kw_only=True):
    """The answer of a service to a request for terms: the terms, or the `reason` why there are none.

    `start` and `finish` are in seconds from the preview. `chosen`: it would get the step. `estimate`: it received no request now; these are
    its latest terms. `condition`: what it demands at the start of the step, and the plan does not meet.
    """

    step: str
    service: str
    price: float | None = None
    currency: str = "EUR"
    duration: float | None = None
    start: float | None = None
    finish: float | None = None
    chosen: bool = False
    estimate: bool = False
    reason: str = ""
    condition: str | None = None


class Obstacle(StrEnum):
    """Why there is no plan."""

    NO_SERVICE_TYPE = "no-service-type"
    """No known service type brings about the goal."""
    NOT_OFFERED = "not-offered"
    """The Registry has no offer of a service that would bring about the goal."""
    PROMISED = "promised"
    """The services or objects that a plan needs are reserved by other tasks."""
    UNKNOWN = "unknown"
    """The place and state of devices or objects that a plan needs are unknown since a failure."""
    PRECONDITION = "precondition"
    """The map contradicts the precondition of the client."""
    NO_OBJECT = "no-object"
    """The map has no object of this name."""
    TWO_PLACES = "two-places"
    """An object would be in two places at the same time."""


class Outlook(Struct, frozen=True, kw_only=True):
    """What a plan with foreseen steps costs in total, and how long it takes, if it goes on as foreseen.

    The certain steps count with their quotes. A foreseen step counts with the terms that services asked last or state in their offers: the
    prices at least and at most, and the time at least. `unknown`: the foreseen steps for which no terms are known; without them,
    `most_price` is None.
    """

    least_price: float
    most_price: float | None = None
    least_seconds: float = 0.0
    unknown: tuple[str, ...] = ()


class OtherPlan(Struct, frozen=True, kw_only=True):
    """Another plan for the same task, with the services, the price and the `seconds` of the best terms, as in `Previewed`."""

    steps: tuple[StepView, ...]
    price: float | None = None
    currency: str
    seconds: float | None = None
    outlook: Outlook | None = None


class Previewed(MessageBody, frozen=True, kw_only=True, tag=True):
    """The steps of the plan, or the `reasons` why there is none. No steps and no reasons: the goal already holds.

    `waiting_for`: the other tasks for which this one would wait; `waits`: the same as text. With quotes: the answers of the services in the
    order of the steps, the total `price`, and the `seconds` until the last step would be done; None if no service offers a step
    (`unserved`: which, and why), or for several currencies.
    """

    steps: tuple[StepView, ...]
    explanation: str = ""
    reasons: tuple[str, ...] = ()
    """The reasons of which the explanation consists."""
    obstacles: tuple[Obstacle, ...] = ()
    """The kinds of the reasons, for programs, as far as they are of a known kind."""
    waits: str = ""
    waiting_for: WaitsForTasks | None = None
    quotations: tuple[Quotation, ...] = ()
    price: float | None = None
    currency: str = "EUR"
    seconds: float | None = None
    estimate: bool = False
    """Some of the figures are estimates."""
    unserved: dict[str, str] = {}
    alternatives: tuple[OtherPlan, ...] = ()
    """With quotes: other plans, which use other service types. This one is preferred by the policy."""
    outlook: Outlook | None = None
    """With quotes, for a plan with foreseen steps: then `price` and `seconds` are None."""
