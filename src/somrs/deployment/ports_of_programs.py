"""The ports of a system's programs on one machine, and the addresses of its components there or on a bus."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path
from urllib.parse import urlsplit

from somrs.client.addresses import Addresses, registry_path, task_manager_path
from somrs.errors import UsageError
from somrs.ports import Reservation
from somrs.runtime.bus_address import BusAddress


class Part(IntEnum):
    """The parts of a system that have a port, in the order of the ports. Those of further Task Managers and Registries come behind them."""

    REPOSITORY = 0
    REGISTRY = 1
    TASK_MANAGER = 2
    WORLD = 3
    WINDOWS = 4
    API = 5
    SCHEDULER = 6
    TRAFFIC = 7
    BUS = 8
    GATEWAY = 9
    TRUST = 10
    MQTT = 11


_WITHOUT_BUS = {Part.WORLD, Part.WINDOWS, Part.API, Part.TRUST}
"""Those that have ports of their own also in a system on a bus; the others have addresses below the gateway's."""


class Ports:
    """The ports of a system's programs at this host, by the numbers of `Part`. `registries`: how many Registries there are.

    `trust`: the folder of the authority whose certificates the components have; None: they have none.
    """

    def __init__(self, host: str, ports: Sequence[int], registries: int = 1, trust: Path | None = None) -> None:
        self._trust = trust
        self._host, self._ports, self._further_start = host, ports, len(ports) - (registries - 1)

    def __getitem__(self, part: Part) -> int:
        return self._ports[part]

    @property
    def task_managers(self) -> list[int]:
        """The ports of all Task Managers."""
        return [self[Part.TASK_MANAGER], *self._ports[len(Part) : self._further_start]]

    @property
    def registries(self) -> list[int]:
        """The ports of all Registries."""
        return [self[Part.REGISTRY], *self._ports[self._further_start :]]

    @property
    def world(self) -> str:
        """The address of the world: HOST:PORT, before which is `tls://` if it has certificates."""
        return f"{'tls://' if self._trust is not None else ''}{self._host}:{self[Part.WORLD]}"

    def traffic(self, bus: BusAddress | None) -> str:
        """The address of traffic."""
        return f"{self._component_origin(self[Part.TRAFFIC], bus)}/traffic"

    def addresses(self, bus: BusAddress | None, *, has_windows: bool) -> Addresses:
        """The addresses of the components, but for the world's and traffic's, which depend on the map."""
        first, *further = (
            self._component_origin(port, bus) + task_manager_path(number) for number, port in enumerate(self.task_managers, start=1)
        )
        registries = (self._component_origin(port, bus) + registry_path(number) for number, port in enumerate(self.registries, start=1))
        registry, *further_registries = registries
        return Addresses(
            repository=f"{self._component_origin(self[Part.REPOSITORY], bus)}/repository",
            registry=registry,
            further_registries=tuple(further_registries),
            task_manager=first,
            further_task_managers=tuple(further),
            gui=self._origin(self[Part.WINDOWS]) if has_windows else None,
            api=f"{self._origin(self[Part.API])}/api",
            scheduler=f"{self._component_origin(self[Part.SCHEDULER], bus)}/scheduler",
            bus=bus,
            trust=str(self._trust.resolve()) if self._trust is not None else None,
            trust_service=f"https://{self._host}:{self[Part.TRUST]}" if self._trust is not None else None,
        )

    def _component_origin(self, port: int, bus: BusAddress | None) -> str:
        if bus is not None:
            return bus.gateway
        return self._origin(port) if self._trust is None else f"https://{self._host}:{port}"

    def _origin(self, port: int) -> str:
        return f"http://{self._host}:{port}"


def reserve_ports(host: str, count: int, preferred_ports: Sequence[int], first_port: int | None) -> Reservation:
    """Reserve so many ports: from `first_port` on, or else the preferred ones where they are free. Raises UsageError if one that has to be
    had is in use."""
    if first_port is None:
        return Reservation(host, count, preferred_ports)
    required_ports = range(first_port, first_port + count)
    reservation = Reservation(host, count, required_ports)
    if taken_ports := sorted({*required_ports} - {*reservation.ports}):
        reservation.close()
        raise UsageError(
            f"the system needs the ports {required_ports[0]} to {required_ports[-1]} of {host}, and {taken_ports[0]} is in use; "
            "give it another first port"
        )
    return reservation


def ports_before(addresses: Addresses, *, task_managers: int, is_on_bus: bool, has_own_bus: bool) -> list[int]:
    """The ports of an earlier run that had these addresses, as far as this run can have them; 0 for the others."""
    places = {
        Part.REPOSITORY: addresses.repository,
        Part.REGISTRY: addresses.registry,
        Part.TASK_MANAGER: addresses.task_manager,
        Part.WORLD: f"//{(addresses.simulator or addresses.world or '').removeprefix('tls://')}",
        Part.WINDOWS: addresses.gui or "",
        Part.API: addresses.api or "",
        Part.SCHEDULER: addresses.scheduler or "",
        Part.TRAFFIC: addresses.traffic or "",
        Part.BUS: addresses.bus.servers if addresses.bus is not None else "",
        Part.GATEWAY: addresses.bus.gateway if addresses.bus is not None else "",
        Part.TRUST: addresses.trust_service or "",
        Part.MQTT: addresses.mqtt or "",
    }
    ports = {part: urlsplit(place.partition(",")[0]).port or 0 for part, place in places.items()}  # a bus of the own has one server
    if addresses.bus is None:
        further_managers, further_registries = (
            [urlsplit(address).port or 0 for address in further]
            for further in (addresses.further_task_managers, addresses.further_registries)
        )
        return [*ports.values(), *[*further_managers, *[0] * task_managers][: task_managers - 1], *further_registries]
    # The components had the port of the gateway, and devices without a bus take it if nobody reserves it.
    kept = _WITHOUT_BUS | ({Part.GATEWAY} if is_on_bus else set()) | ({Part.BUS, Part.MQTT} if has_own_bus else set())
    return [port if part in kept else 0 for part, port in ports.items()]
