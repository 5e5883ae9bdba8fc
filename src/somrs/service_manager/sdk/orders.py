"""The values between `participant.py`, which decides, and `service_runner.py`, which runs the author's coroutines: orders and answers."""

from __future__ import annotations

from msgspec import Struct

from somrs.entish.formula import Formula
from somrs.errors import InputError, SomrsError
from somrs.kernel.component import AnswerLost, ErrorAnswer, PartialAnswer
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Value
from somrs.protocol.messages.knowledge import Definitions
from somrs.protocol.messages.observations import Observation


class Capability(Struct, frozen=True, kw_only=True):
    """A service of a device: its type, or the name of a type in the common ontology, and the method that performs it."""

    type: ServiceType | str
    method: str
    attributes: dict[str, Value] = {}
    stoppable: bool = False
    """Whether the author defines how the service reaches a safe state when it is interrupted."""
    undoable: bool = False
    occupies: bool = True
    """Whether it takes up some of the device's capacity."""
    inputs: tuple[str, ...] | None = None
    """The names of the inputs that the method reads; None: it serves any definition of the type."""
    outputs: tuple[str, ...] = ()
    """The names of the outputs that the method returns, if it reads `inputs`."""

    def serves(self, definition: ServiceType) -> bool:
        """Whether the method can do what the definition of its type says, as far as the names of inputs and outputs tell."""
        inputs, outputs = ({parameter.name for parameter in parameters} for parameters in (definition.inputs, definition.outputs))
        return self.inputs is None or (inputs == {*self.inputs} and outputs == {*self.outputs})

    @property
    def type_name(self) -> str:
        return self.type if isinstance(self.type, str) else self.type.name


class Profile(Struct, frozen=True, kw_only=True):
    """The description of a device for its Service Manager. `values` and `situation` put it on the map, if it is not there."""

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
        """Return the service's name in the whole system."""
        return f"{self.name}.{capability.type_name}"


class Order(Struct, frozen=True, kw_only=True):
    """The order that was arranged with a participant. `inputs` are Entish terms; times are on the coordinator's clock. `situation` is what
    earlier steps of the plan will have changed on the map when this step starts."""

    participant: str
    method: str
    inputs: dict[str, str]
    effect: str
    precondition: str | None = None
    earliest_start: float | None = None
    latest_finish: float | None = None
    transaction: str = ""
    situation: str | None = None


class Quote(Struct, frozen=True, tag=True):
    """Work out the price and the duration. The answer is `Quoted` or `Refused`."""

    order: Order


class Perform(Struct, frozen=True, tag=True):
    """Perform the service. The answers are any number of `Advance`, then `WorkDone` or `Failure`."""

    order: Order


class Halt(Struct, frozen=True, tag=True):
    """Reach a safe state after an interruption. The answer is `WorkDone` or `Failure`."""

    order: Order


class Undo(Struct, frozen=True, tag=True):
    """Undo the work: restore the situation, or an equivalent. The answers are those of `Perform`."""

    order: Order
    situation: str


class Report(Struct, frozen=True, tag=True):
    """Inform the person who runs the device. `joined`: whether the device joined; None: other information."""

    text: str
    joined: bool | None = None


Work = Quote | Perform | Halt | Undo


class Quoted(Struct, frozen=True, kw_only=True, tag=True):
    """The device does the work for this price, if the `condition` holds at its start (None: in any case) and the `invariant` up to its end.

    `penalty`: what it costs to have the work undone by the device.
    """

    price: float
    currency: str = "EUR"
    duration: float
    condition: str | None = None
    penalty: float | None = None
    invariant: str | None = None


class Refused(Struct, frozen=True, tag=True):
    """The device does not do the work: never, or `not_now`; or only if the `condition` held at its start."""

    reason: str
    not_now: bool = False
    condition: str | None = None


class Advance(PartialAnswer, frozen=True, kw_only=True, tag=True):
    """The progress of the work. `waits`: something that will pass keeps it from going on."""

    fraction: float
    situation: str | None = None
    note: str = ""
    observation: Observation | None = None
    waits: bool = False


class WorkDone(Struct, frozen=True, kw_only=True, tag="Done"):
    """The work is done. `situation` None: the arranged effect; after a Halt: nothing is known."""

    situation: str | None = None
    outputs: dict[str, Value] = {}
    observation: Observation | None = None


class Failure(Struct, frozen=True, tag=True):
    """The effect does not hold. `situation` holds instead, as far as it is known. `tried` False: nothing was begun or changed."""

    description: str
    situation: str | None = None
    tried: bool = True
    observation: Observation | None = None


Answer = Quoted | Refused | Advance | WorkDone | Failure | ErrorAnswer | AnswerLost | None


class Refusal(SomrsError):
    """Raised by an author's price, duration or `able` function: the device cannot, or will not, do the work.

    `not_now`: the reason passes, such as work, charging or a defect; the Task Manager asks again later. `condition`: a formula, in Entish;
    if it held when the service starts, the device could do the work. The Task Manager looks for services that make it true.
    """

    def __init__(self, reason: str, *, not_now: bool = False, condition: str | Formula | None = None) -> None:
        self.reason, self.not_now, self.condition = reason, not_now, condition
        super().__init__(reason)


class ServiceFailed(SomrsError):
    """Raised by an author's service: the effect does not hold. `situation` holds instead, as far as it is known.

    `tried` False: nothing was begun or changed, so that another service can do the step at once.
    """

    def __init__(
        self, description: str, situation: str | None = None, *, tried: bool = True, observation: Observation | None = None
    ) -> None:
        self.description, self.situation, self.tried, self.observation = description, situation, tried, observation
        super().__init__(description, situation)

    def __str__(self) -> str:
        return self.description


def answer_of(error: BaseException) -> Refused | Failure | ErrorAnswer:
    """Return the answer for an exception of an author's code. Only exceptions that are written for people omit the class name."""
    match error:
        case Refusal(reason=reason, not_now=not_now, condition=condition):
            return Refused(reason, not_now, str(condition) if condition is not None else None)
        case ServiceFailed(description=description, situation=situation, tried=tried, observation=observation):
            return Failure(description, situation, tried, observation)
        case InputError():
            return ErrorAnswer(str(error))
        case _:
            return ErrorAnswer(f"{type(error).__name__}: {error}")
