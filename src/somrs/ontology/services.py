"""Service types: the services that devices can offer, in terms of the ontology (paper, "Services")."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

PROVIDER = "Provider"
"""In a service type's formulas, `?Provider` is the device that offers the service."""

PROVIDER_TYPE = "PhysicalObject"
"""The type of `?Provider`: any physical object may be a device, such as a door with a drive."""


class ServiceKind(StrEnum):
    """The paper's three kinds of services."""

    PHYSICAL = "physical"
    """Changes situations in the environment."""
    COGNITIVE = "cognitive"
    """Recognises the situation that a formula describes."""
    SOFTWARE = "software"
    """Processes data."""


class Occasion(StrEnum):
    """The occasion on which a handler applies."""

    FAILURE = "failure"
    """A step failed: the handler runs before the step is given to another service."""
    COMPENSATION = "compensation"
    """A step is undone: the handler runs instead of restoring the state before the step."""


class Parameter(Struct, frozen=True, kw_only=True):
    """An input or output of a service: the variable's name, without `?`, and its type (an object type, or `number`,
    `text`, `truth` for values)."""

    name: str
    type: str


class Handler(Struct, frozen=True, kw_only=True):
    """A predefined procedure for failure handling or compensation (paper, "Failure handling and recovery").

    When `on` occurs for a step and `when` holds on the map (None: always), `effect` becomes a goal, for any suitable services. Both are
    Entish formulas over the step's inputs and `?Provider`, the device that executed the step. `service_type` limits a task's handler to
    the steps of that type (None: all steps). A handler in a service type applies to the steps of that type.
    """

    on: Occasion
    effect: str
    when: str | None = None
    service_type: str | None = None


class ServiceType(Struct, frozen=True, kw_only=True):
    """The inputs, outputs, precondition and effect of the services of one type.

    `precondition` (None: always) and `effect` are Entish formulas; their variables are the inputs, the outputs and `?Provider`.
    Other variables of the precondition are bound by the map (`?Object isOn ?Source`). `cost` is an Entish term over the inputs and
    `?Provider`: an estimate of the price, before services state their terms. `invariant` has to hold from the start to the end (PDDL 2.1:
    *over all*; None: nothing); its variables are the inputs and `?Provider`. In files, its key is `while`.
    """

    name: str
    effect: str
    precondition: str | None = None
    inputs: tuple[Parameter, ...] = ()
    outputs: tuple[Parameter, ...] = ()
    kind: ServiceKind = ServiceKind.PHYSICAL
    parent: str | None = None
    handlers: tuple[Handler, ...] = ()
    cost: str | None = None
    doc: str = ""
    invariant: str | None = None

    @property
    def start_condition(self) -> str | None:
        """What has to hold when a service of the type starts: the precondition and the invariant; None: nothing."""
        if self.precondition is None or self.invariant is None:
            return self.precondition or self.invariant
        return f"({self.precondition}) AND ({self.invariant})"
