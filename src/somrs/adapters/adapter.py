"""What an adapter is: it connects robots or things of one protocol, and has a device for each of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Protocol

from somrs.service_manager.sdk.device import Device


class Fleet(Protocol):
    """Runs the devices of an adapter: they join the system, and are started again when they fail."""

    @property
    def data(self) -> Path:
        """The data folder of the running system, where an adapter may store data; it may not exist yet."""

    def add(self, device: Device) -> None:
        """Let a device join. One of this name takes the place of an earlier one."""

    def report_problem(self, name: str, problem: str | None) -> None:
        """Say why an object that the adapter serves has no device yet, as of `Device.report_problem`. When it has one, that says it."""

    async def remove(self, name: str) -> None:
        """Let a device leave the system."""

    async def storeys(self) -> Mapping[str, float]:
        """The storeys of the building on the map, by name, with their heights in metres. It waits until the map is known."""


class Adapter(Protocol):
    """Connects the robots or things of one protocol.

    It is made from its settings: what the site file has under its name. `folder` is that of the site file, to which relative paths in the
    settings refer. Raises InputError, which says where in the settings, what, and what to do next.
    """

    def __init__(self, settings: Mapping[str, Any], folder: Path) -> None: ...

    @property
    def names(self) -> Collection[str]:
        """The objects of the map that it serves, as far as the settings name them: no other program is started for them."""

    @property
    def simulated(self) -> Collection[str]:
        """The robots and things of the simulator that `simulate` puts behind the protocol, by their names on the map."""

    async def simulate(self, simulator: str, storeys: Mapping[str, float]) -> None:
        """Be the other end of the protocol for these, with the simulator at this address, until it is cancelled. It runs in a process of
        its own. `storeys`: as of `Fleet.storeys`."""

    # An adapter may have `misfits(site: Site) -> Iterable[Mistake]` besides: what of its settings does not fit the map of the site.

    async def run(self, fleet: Fleet) -> None:
        """Connect, and add a device for each robot or thing, until it is cancelled. That a broker or a robot is not there yet is no
        error: it is tried again."""
