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


class Parameter(Struct, frozen=True, kw_only=True):
    """An input or output of a service: the variable's name, without `?`, and its type (an object type, or `number`,
    `text`, `truth` for values)."""

    name: str
    type: str


class ServiceType(Struct, frozen=True, kw_only=True):
    """What a service of this type needs and brings about.

    `precondition` (None: always) and `effect` are Entish; their variables are the inputs, the outputs and `?Provider`.
    A variable of the precondition that is no input is found in the map (`?Object isOn ?Source`).
    """

    name: str
    effect: str
    precondition: str | None = None
    inputs: tuple[Parameter, ...] = ()
    outputs: tuple[Parameter, ...] = ()
    kind: ServiceKind = ServiceKind.PHYSICAL
    parent: str | None = None
    doc: str = ""
