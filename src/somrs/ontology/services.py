"""Service types: what devices can do, in the words of the ontology (paper, "Services")."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

PROVIDER = "Provider"
"""In a service type's formulas, `?Provider` is the device that offers the service."""


class ServiceKind(StrEnum):
    """The paper's three kinds of services."""

    PHYSICAL = "physical"
    """Changes situations in the environment."""
    COGNITIVE = "cognitive"
    """Recognises the situation that a formula describes."""
    SOFTWARE = "software"
    """Processes data."""


class Occasion(StrEnum):
    """When a handler is called for."""

    FAILURE = "failure"
    """A service failed, or was found to have failed: before the step is given to another."""
    COMPENSATION = "compensation"
    """What a step did is to be undone: instead of restoring what was before it."""


class Parameter(Struct, frozen=True, kw_only=True):
    """An input or output of a service: the variable's name, without `?`, and its type (an object type, or `number`,
    `text`, `truth` for values)."""

    name: str
    type: str


class Handler(Struct, frozen=True, kw_only=True):
    """A predefined procedure for failure handling or compensation (paper, "Failure handling and recovery": a concrete plan should
    contain them).

    `effect` is to be brought about, by whichever services can, when `on` comes to a step and `when` holds on the map (None:
    always). Both are Entish, and speak of the step's inputs, and of the device that did it as `?Provider`. `service_type` says
    for which steps a task's handler is (None: all); one of a service type is for the steps of that type.
    """

    on: Occasion
    effect: str
    when: str | None = None
    service_type: str | None = None


class ServiceType(Struct, frozen=True, kw_only=True):
    """What a service of this type needs and brings about.

    `precondition` (None: always) and `effect` are Entish; their variables are the inputs, the outputs and `?Provider`.
    A variable of the precondition that is no input is found in the map (`?Object isOn ?Source`). `cost` is an Entish term over
    the inputs and `?Provider`: what doing it costs, as far as can be told before anybody is asked.
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
