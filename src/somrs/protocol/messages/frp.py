"""The bodies of the Failure Recovery Protocol, between a Task Manager (coordinator) and a service (participant).

Formulas are Entish text. Times are seconds: `duration` and `reply_by` etc. on the clock of the coordinator's node.

`begin_by`: an order that comes later than that is not obeyed, as its step may be another's by then. None: whenever it comes.
"""

from __future__ import annotations

from enum import StrEnum

from somrs.ontology.types import Value
from somrs.protocol.messages.body import MessageBody


class State(StrEnum):
    """The states of a participant; the coordinator's view of it has `UNREACHABLE` besides."""

    NEW = "New"
    """Nothing is known of it yet."""
    ARRANGING = "Arranging"
    """Working out terms."""
    OFFERED = "Offered"
    COMMITTED = "Committed"
    """Its terms were accepted."""
    EXECUTING = "Executing"
    COMPLETED = "Completed"
    FAILED = "Failed"
    STOPPING = "Stopping"
    STOPPED = "Stopped"
    COMPENSATING = "Compensating"
    COMPENSATED = "Compensated"
    STRANDED = "Stranded"
    """It could not be undone."""
    ENDED = "Ended"
    UNREACHABLE = "Unreachable"
    """The coordinator's view only: silent past every deadline."""


class Outcome(StrEnum):
    """How a transaction ends."""

    ACCOMPLISHED = "accomplished"
    FAILED = "failed"
    CANCELLED = "cancelled"


class Arrange(MessageBody, frozen=True, kw_only=True, tag=True):
    """The intention: can you, and on what terms? `inputs` are Entish terms by the service type's input names."""

    service_type: str
    inputs: dict[str, str]
    effect: str
    precondition: str | None = None
    earliest_start: float | None = None
    latest_finish: float | None = None
    reply_by: float | None = None


class Terms(MessageBody, frozen=True, kw_only=True, tag=True):
    """The commitment the service would enter. `price` in `currency`, `duration` in seconds."""

    effect: str
    price: float
    duration: float
    precondition: str | None = None
    currency: str = "EUR"
    start_from: float | None = None
    start_until: float | None = None
    valid_until: float | None = None


class Refuse(MessageBody, frozen=True, kw_only=True, tag=True):
    """Cannot, or will not."""

    reason: str


class Accept(MessageBody, frozen=True, kw_only=True, tag=True):
    """The commitment holds. `terms` is the message id of the Terms."""

    terms: str


class Cancel(MessageBody, frozen=True, kw_only=True, tag=True):
    """Leave before execution: a losing bid, or a plan that changed."""

    reason: str


class Execute(MessageBody, frozen=True, kw_only=True, tag=True):
    """Start. `precondition` is the situation as it is now."""

    inputs: dict[str, str]
    precondition: str | None = None
    begin_by: float | None = None


class Progress(MessageBody, frozen=True, kw_only=True, tag=True):
    """Monitoring and liveness: the fraction done (0 to 1), the situation if it changed, and a word for people."""

    fraction: float
    situation: str | None = None
    note: str = ""


class Completed(MessageBody, frozen=True, kw_only=True, tag=True):
    """The effect holds; this is the situation now."""

    situation: str
    outputs: dict[str, Value] = {}


class Failed(MessageBody, frozen=True, kw_only=True, tag=True):
    """The effect does not hold; here is what does, as far as it is known. `tried` FALSE: nothing was begun, and things are as they were."""

    description: str
    situation: str | None = None
    tried: bool = True


class Stop(MessageBody, frozen=True, kw_only=True, tag=True):
    """Stop executing."""

    reason: str


class Stopped(MessageBody, frozen=True, kw_only=True, tag=True):
    """It stopped, safely."""

    situation: str | None = None


class Compensate(MessageBody, frozen=True, kw_only=True, tag=True):
    """Undo: the situation to restore, or an equivalent from which the task can go on."""

    situation: str
    begin_by: float | None = None


class Compensated(MessageBody, frozen=True, kw_only=True, tag=True):
    """Undone."""

    situation: str


class Stranded(MessageBody, frozen=True, kw_only=True, tag=True):
    """Could not be undone; a person or another service must. `tried` FALSE: nothing was done about it, and things are as they were."""

    description: str
    situation: str | None = None
    tried: bool = True


class Query(MessageBody, frozen=True, kw_only=True, tag=True):
    """What state are you in?"""


class Status(MessageBody, frozen=True, kw_only=True, tag=True):
    """The state, and the id of the last message sent."""

    state: State
    last_message: str | None = None


class End(MessageBody, frozen=True, kw_only=True, tag=True):
    """The transaction is over for you."""

    outcome: Outcome


class Fault(MessageBody, frozen=True, kw_only=True, tag=True):
    """The message could not be processed (malformed, unknown version, not allowed). `code` is a SOAP fault (sub)code."""

    code: str
    text: str
