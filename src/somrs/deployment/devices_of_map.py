"""Which devices of a map have a driver, and whether they belong to a simulator or a symbolic world."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.errors import UsageError
from somrs.ontology.map import Map
from somrs.ontology.modes import DOOR, LIFT
from somrs.ontology.qualified_names import home_of
from somrs.ontology.types import Ontology


def devices(map: Map, ontology: Ontology) -> list[tuple[str, str]]:
    """The own devices of the map that have a driver, as pairs of name and driver. The object types name the drivers."""
    drivers = ((name, ontology.driver(object.type)) for name, object in sorted(map.objects.items()) if not home_of(name))
    return [(name, driver) for name, driver in drivers if driver is not None]


def symbolic(driven: Sequence[tuple[str, str]]) -> bool:
    """Whether the devices belong to a symbolic world and not to the simulator. Raises UsageError if the map mixes them."""
    bodiless = [name for name, driver in driven if driver.startswith("somrs.devices.symbolic.")]
    simulated = [name for name, driver in driven if driver.startswith("somrs.devices.simulator.")]
    if bodiless and simulated:
        conflict = f"{bodiless[0]} is a device of a symbolic world, and {simulated[0]} is a device of the simulator"
        raise UsageError(f"{conflict}; a system has only one of the two, so remove one of the devices from the map")
    return bool(bodiless)


def unsimulated(driven: Sequence[tuple[str, str]], map: Map, ontology: Ontology) -> list[tuple[str, str]]:
    """The devices of a building without a simulator. Nobody drives its lifts and doors unless their types have drivers of their own.

    Raises UsageError if another device needs a simulator.
    """
    kept: list[tuple[str, str]] = []
    for name, driver in driven:
        if not driver.startswith("somrs.devices.simulator."):
            kept.append((name, driver))
        elif not any(ontology.is_subtype(map.objects[name].type, kind) for kind in (LIFT, DOOR)):
            raise UsageError(
                f"{name} is a device of the simulator, by the driver of its type, {driver}: start the system with a simulator, or give it "
                "a type without this driver"
            )
    return kept
