"""What a Service Manager asks of its device, and what it hears back: the values between `participant.py`, which decides, and
`service_runner.py`, which runs the author's coroutines.
"""

from __future__ import annotations

from msgspec import Struct

from somrs.errors import InputError, SomrsError
from somrs.kernel.component import AnswerLost, ErrorAnswer, PartialAnswer
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Value
from somrs.protocol.messages.knowledge import Definitions


class Capability(Struct, frozen=True, kw_only=True):
    """One service of a device: its type, or the name of one in the common ontology, and the method that performs it."""

    type: ServiceType | str
    method: str
    attributes: dict[str, Value] = {}
    stoppable: bool = False
    """Whether the author says how to reach a safe state when it is interrupted."""
    undoable: bool = False

    @property
    def type_name(self) -> str:
        return self.type if isinstance(self.type, str) else self.type.name


class Profile(Struct, frozen=True, kw_only=True):
    """What a Service Manager has to know of its device. `values` and `situation` put it on the map, if it is not there."""

    name: str
    type: str
    capabilities: tuple[Capability, ...]
    definitions: Definitions = Definitions()
    values: dict[str, Value] = {}
    situation: str | None = None
    capacity: int = 1
    heartbeat: float = 5.0
    valid_for: float = 120.0
    lease: float = 30.0

    def service(self, capability: Capability) -> str:
        """The service's name in the whole system."""
        return f"{self.name}.{capability.type_name}"


class Order(Struct, frozen=True, kw_only=True):
    """What was arranged with one participant. `inputs` are Entish terms; times are on the coordinator's clock."""

    participant: str
    method: str
    inputs: dict[str, str]
    effect: str
    precondition: str | None = None
    earliest_start: float | None = None
    latest_finish: float | None = None
    transaction: str = ""


class Quote(Struct, frozen=True, tag=True):
    """Work out what it costs and how long it takes. Answered by `Quoted` or `Refused`."""

    order: Order


class Perform(Struct, frozen=True, tag=True):
    """Do it. Answered by any number of `Advance`, then by `WorkDone` or `Failure`."""

    order: Order


class Halt(Struct, frozen=True, tag=True):
    """The work was interrupted: reach a safe state. Answered by `WorkDone` or `Failure`."""

    order: Order


class Undo(Struct, frozen=True, tag=True):
    """Restore the situation, or an equivalent. Answered like `Perform`."""

    order: Order
    situation: str


class Report(Struct, frozen=True, tag=True):
    """Tell the person who runs the device: it `joined`, or why it cannot; or something else (None)."""

    text: str
    joined: bool | None = None


Work = Quote | Perform | Halt | Undo


class Quoted(Struct, frozen=True, kw_only=True, tag=True):
    price: float
    currency: str = "EUR"
    duration: float


class Refused(Struct, frozen=True, tag=True):
    """The device cannot, or will not."""

    reason: str


class Advance(PartialAnswer, frozen=True, kw_only=True, tag=True):
    """How far the work is."""

    fraction: float
    situation: str | None = None
    note: str = ""


class WorkDone(Struct, frozen=True, kw_only=True, tag="Done"):
    """The work is done. `situation` None: what was to be brought about, or, of a Halt, nothing that is known."""

    situation: str | None = None
    outputs: dict[str, Value] = {}


class Failure(Struct, frozen=True, tag=True):
    """The effect does not hold, why, and what holds instead as far as it is known."""

    description: str
    situation: str | None = None


Answer = Quoted | Refused | Advance | WorkDone | Failure | ErrorAnswer | AnswerLost | None


class Refusal(SomrsError):
    """Raised by an author's price, duration or `able` function: cannot, or will not."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


class ServiceFailed(SomrsError):
    """Raised by an author's service: the effect does not hold, why, and what holds instead as far as it is known."""

    def __init__(self, description: str, situation: str | None = None) -> None:
        self.description, self.situation = description, situation
        super().__init__(description, situation)

    def __str__(self) -> str:
        return self.description


def answer_of(error: BaseException) -> Refused | Failure | ErrorAnswer:
    """What an author's code raised, as an answer; with its class, unless it is an exception that is meant to be read."""
    match error:
        case Refusal(reason=reason):
            return Refused(reason)
        case ServiceFailed(description=description, situation=situation):
            return Failure(description, situation)
        case InputError():
            return ErrorAnswer(str(error))
        case _:
            return ErrorAnswer(f"{type(error).__name__}: {error}")
