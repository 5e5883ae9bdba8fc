"""The bodies of the Failure Recovery Protocol, between a Task Manager (coordinator) and a service (participant).

Formulas are Entish text. Times are in seconds on the clock of the coordinator's node.

A situation in a report may also describe objects that were sighted, by typed variables. `observation`: when and how it was observed.

`begin_by`: the participant does not carry out an order that comes later than this, because another service may have the step by then. None:
no limit.
"""

from __future__ import annotations

from enum import StrEnum

from somrs.ontology.types import Value
from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.observations import Observation


class State(StrEnum):
    """The states of a participant. The coordinator's view of it also has `UNREACHABLE`."""

    NEW = "New"
    """No message has come yet."""
    ARRANGING = "Arranging"
    """The participant works out its terms."""
    OFFERED = "Offered"
    COMMITTED = "Committed"
    """The terms were accepted."""
    EXECUTING = "Executing"
    COMPLETED = "Completed"
    FAILED = "Failed"
    STOPPING = "Stopping"
    STOPPED = "Stopped"
    COMPENSATING = "Compensating"
    COMPENSATED = "Compensated"
    STRANDED = "Stranded"
    """The work could not be undone."""
    ENDED = "Ended"
    UNREACHABLE = "Unreachable"
    """In the coordinator's view only: the participant was silent past every deadline."""


class Outcome(StrEnum):
    """How a transaction ends."""

    ACCOMPLISHED = "accomplished"
    FAILED = "failed"
    CANCELLED = "cancelled"


class Arrange(MessageBody, frozen=True, kw_only=True, tag=True):
    """Request terms for a step. `inputs` are Entish terms, by the names of the service type's inputs.

    `situation` is the promised situation: what earlier steps of the plan will have changed on the map when this step starts. The terms are
    for that situation. None: the map as it is.
    """

    service_type: str
    inputs: dict[str, str]
    effect: str
    precondition: str | None = None
    earliest_start: float | None = None
    latest_finish: float | None = None
    reply_by: float | None = None
    situation: str | None = None


class Terms(MessageBody, frozen=True, kw_only=True, tag=True):
    """The terms of a service. `price` is in `currency`, `duration` in seconds.

    `condition`: the terms hold only if this formula holds when the service starts. Whoever accepts them makes it true before, by other
    steps of the plan; otherwise nothing is started. `invariant`: the part of it that has to hold from the start to the end of the service;
    the Task Manager watches it, and stops the service when it does not hold any more. `penalty`: what it costs, in `currency`, to have the
    work undone by this service (Compensate); None: the service does not say.
    """

    effect: str
    price: float
    duration: float
    precondition: str | None = None
    currency: str = "EUR"
    start_from: float | None = None
    start_until: float | None = None
    valid_until: float | None = None
    condition: str | None = None
    penalty: float | None = None
    invariant: str | None = None


class Refuse(MessageBody, frozen=True, kw_only=True, tag=True):
    """The service does not do the step.

    `not_now`: it may do it later, because the reason passes: it is busy, charging or broken, or did not answer in time. Otherwise it never
    will, as things are: the thing is too heavy, the place is on another storey. `condition`: a formula; if it held at the start, the
    service could do the step. `lapsed`: the terms that were offered do not hold any more, because they have expired, or another contract
    came first; asked again, the service gives new ones.
    """

    reason: str
    not_now: bool = False
    condition: str | None = None
    lapsed: bool = False

    @property
    def passes(self) -> bool:
        """Whether the service may be asked again: later, or in another situation. In a session of its own: this one is over."""
        return self.not_now or self.condition is not None


class Accept(MessageBody, frozen=True, kw_only=True, tag=True):
    """Accept the terms: there is a contract. `terms` is the message id of the Terms."""

    terms: str


class Cancel(MessageBody, frozen=True, kw_only=True, tag=True):
    """Leave before execution: another bid won, or the plan changed."""

    reason: str


class Execute(MessageBody, frozen=True, kw_only=True, tag=True):
    """Start. `precondition` is the present situation; it includes the condition of the Terms."""

    inputs: dict[str, str]
    precondition: str | None = None
    begin_by: float | None = None


class Progress(MessageBody, frozen=True, kw_only=True, tag=True):
    """Heartbeat and monitoring: the fraction done (0 to 1), the situation if it changed, and a note for people.

    `waits`: something that will pass keeps the service from going on, so that its time begins again.
    """

    fraction: float
    situation: str | None = None
    note: str = ""
    observation: Observation | None = None
    waits: bool = False


class Completed(MessageBody, frozen=True, kw_only=True, tag=True):
    """The effect holds; `situation` is the present one."""

    situation: str
    outputs: dict[str, Value] = {}
    observation: Observation | None = None


class Failed(MessageBody, frozen=True, kw_only=True, tag=True):
    """The effect does not hold; `situation` holds instead, as far as it is known. `tried` FALSE: nothing was begun or changed."""

    description: str
    situation: str | None = None
    tried: bool = True
    observation: Observation | None = None


class Stop(MessageBody, frozen=True, kw_only=True, tag=True):
    """Stop executing."""

    reason: str


class Stopped(MessageBody, frozen=True, kw_only=True, tag=True):
    """The service stopped in a safe state. `tried` FALSE: the Stop came before it had begun, so nothing was changed."""

    situation: str | None = None
    tried: bool = True
    observation: Observation | None = None


class Compensate(MessageBody, frozen=True, kw_only=True, tag=True):
    """Undo the work: restore the situation, or an equivalent from which the task can continue."""

    situation: str
    begin_by: float | None = None


class Compensated(MessageBody, frozen=True, kw_only=True, tag=True):
    """The work is undone."""

    situation: str
    observation: Observation | None = None


class Stranded(MessageBody, frozen=True, kw_only=True, tag=True):
    """The work could not be undone; a person or another service must. `tried` FALSE: nothing was attempted or changed."""

    description: str
    situation: str | None = None
    tried: bool = True
    observation: Observation | None = None


class Query(MessageBody, frozen=True, kw_only=True, tag=True):
    """Request the state of the participant."""


class Status(MessageBody, frozen=True, kw_only=True, tag=True):
    """The state of the participant, and the id of the last message that it sent."""

    state: State
    last_message: str | None = None


class End(MessageBody, frozen=True, kw_only=True, tag=True):
    """The transaction is over for this participant."""

    outcome: Outcome


class Fault(MessageBody, frozen=True, kw_only=True, tag=True):
    """The message could not be processed (malformed, unknown version, not allowed). `code` is a SOAP fault code or subcode."""

    code: str
    text: str

    @property
    def is_of_sender(self) -> bool:
        """Whether the mistake is in the message, which must not be sent again as it is."""
        return self.code.removeprefix("env:") == "Sender"
