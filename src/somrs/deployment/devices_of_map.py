"""Which devices of a map the system starts programs for.

A map and its ontology come over the wire. So a type only names which of the site's programs serves its devices (`DevicePrograms`); and what
cannot be started is left out, for a reason that people read, while all others start.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from somrs.errors import InputError
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.modes import DOOR, LIFT
from somrs.ontology.qualified_names import home_of
from somrs.ontology.types import Ontology

SYMBOLIC, SIMULATED = "somrs.devices.symbolic.", "somrs.devices.simulator."
"""How the drivers of devices of a symbolic world begin, and those of devices of the simulator."""

_OWN = re.compile(r"somrs(\.[a-z_][a-z0-9_]*)+:[A-Za-z_]\w*", re.ASCII)

Driven = Sequence[tuple[str, str]]
"""Devices, as pairs of name and driver."""


class Selection(NamedTuple):
    """The devices to start, and why others are left out."""

    devices: list[tuple[str, str]]
    problems: list[str]


def devices(map: Map, ontology: Ontology) -> list[tuple[str, str]]:
    """The own devices of the map that have a driver, as pairs of name and driver. The object types name the drivers."""
    drivers = ((name, ontology.driver(object.type)) for name, object in sorted(map.objects.items()) if not home_of(name))
    return [(name, driver) for name, driver in drivers if driver is not None]


def is_own_driver(driver: str) -> bool:
    """Whether the driver is a class of SO-MRS."""
    return _OWN.fullmatch(driver) is not None and not driver.partition(":")[0].endswith(".py")


class DevicePrograms:
    """The programs that a site has for its devices: those of SO-MRS, those that the types of its files name, and the `drivers` that were
    named at its start."""

    def __init__(self, site: Sequence[Path], drivers: Collection[str] = ()) -> None:
        self._site, self._drivers = site, frozenset(drivers)

    def select(self, driven: Driven) -> Selection:
        """The devices whose drivers are programs of the site."""
        unnamed = {driver for _, driver in driven if not is_own_driver(driver)} - self._drivers
        refused = unnamed - self._drivers_of_site() if unnamed else unnamed
        problems = [
            f"{name} is left out: its type names the program {driver}, which is none of this site; if it is to run, start the system with "
            f"--driver {driver}, or name it in a type of a file of the site"
            for name, driver in driven
            if driver in refused
        ]
        return Selection([device for device in driven if device[1] not in refused], problems)

    def _drivers_of_site(self) -> set[str]:
        try:
            ontology = load(self._site).ontology
        except InputError:  # the map of an earlier run needs the files no more
            return set()
        return {type.driver for type in ontology.types.values() if type.driver is not None}


def is_symbolic(driven: Driven) -> bool:
    """Whether the devices, or most of those that are of a world, are of a symbolic world and not of the simulator."""
    symbolic = sum(driver.startswith(SYMBOLIC) for _, driver in driven)
    return symbolic > sum(driver.startswith(SIMULATED) for _, driver in driven)


def of_one_world(driven: Driven, *, symbolic: bool) -> Selection:
    """The devices without those of the other kind of world: a system has one of the two."""
    other = SIMULATED if symbolic else SYMBOLIC
    worlds = ("the simulator", "a symbolic world") if symbolic else ("a symbolic world", "the simulator")
    problems = [
        f"{name} is left out: it is a device of {worlds[0]}, by its driver {driver}, and most others are devices of {worlds[1]}; a system "
        "has only one of the two, so remove it from the map"
        for name, driver in driven
        if driver.startswith(other)
    ]
    return Selection([device for device in driven if not device[1].startswith(other)], problems)


def unsimulated(driven: Driven, map: Map, ontology: Ontology) -> Selection:
    """The devices of a building without a simulator. Nobody drives its lifts and doors unless their types have drivers of their own."""
    problems = [
        f"{name} is left out: it is a device of the simulator, by the driver of its type, {driver}; start the system with a simulator, or "
        "give it a type without this driver"
        for name, driver in driven
        if driver.startswith(SIMULATED) and not any(ontology.is_subtype(map.objects[name].type, kind) for kind in (LIFT, DOOR))
    ]
    return Selection([device for device in driven if not device[1].startswith(SIMULATED)], problems)
