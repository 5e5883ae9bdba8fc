"""The addresses of a running system, which its data folder has, or its bus."""

from __future__ import annotations

from pathlib import Path
from zlib import crc32

import msgspec

from somrs.errors import UsageError
from somrs.runtime.bus_address import BusAddress

SYSTEM_FILE = "system.json"
"""The file in the data folder with the addresses of the running system."""

LAST_FILE = "last.json"
"""The file in the data folder with the addresses of the last run. Programs listen there again if they can, because parties to open
contracts know each other by these addresses."""


class Addresses(msgspec.Struct, frozen=True, kw_only=True):
    """The addresses of the components of a running system. A system has a `simulator` or a symbolic `world`, at `host:port`."""

    repository: str
    registry: str
    task_manager: str
    simulator: str | None = None
    world: str | None = None
    """The symbolic world."""
    gui: str | None = None
    """The windows; None for a system without them."""
    api: str | None = None
    """The public API: the URL below which its operations are."""
    scheduler: str | None = None
    """The Scheduler, which keeps templates and standing orders."""
    traffic: str | None = None
    """Traffic, which grants places to robots; None for a symbolic world."""
    bus: BusAddress | None = None
    """The bus on which the components are; None for a system without one."""
    mqtt: str | None = None
    """The URLs, separated by commas, at which the servers of the bus are a broker for MQTT: `mqtts://HOST:PORT`; None if they are none."""
    broker: str | None = None
    """The URL of the broker for MQTT that is started with the system, for its adapters."""
    further_task_managers: tuple[str, ...] = ()
    """The Task Managers besides `task_manager`, in a system with several."""
    further_registries: tuple[str, ...] = ()
    """The Registries besides `registry`, in a system with several."""

    trust: str | None = None
    """The folder of the site's certificate authority, if the components have certificates."""
    trust_service: str | None = None
    """The URL of the authority's service, if there is one."""

    @property
    def task_managers(self) -> dict[str, str]:
        """The addresses of all Task Managers, by their names."""
        return {task_manager_name(number): address for number, address in enumerate((self.task_manager, *self.further_task_managers), 1)}

    @property
    def registries(self) -> dict[str, str]:
        """The addresses of all Registries, by their names. They list the same."""
        return {registry_name(number): address for number, address in enumerate((self.registry, *self.further_registries), 1)}

    def registries_for(self, user: str) -> tuple[str, ...]:
        """The Registries in the order in which this device or Task Manager tries them: each begins with another one."""
        addresses = [*self.registries.values()]
        start = crc32(user.encode()) % len(addresses)
        return (*addresses[start:], *addresses[:start])

    @classmethod
    def read(cls, data: Path, name: str = SYSTEM_FILE) -> Addresses:
        """Read the addresses of the running system from its data folder. Raises UsageError if no system runs there."""
        file = data / name
        try:
            return msgspec.json.decode(file.read_bytes(), type=cls)
        except FileNotFoundError:
            raise UsageError(f"no system runs here: there is no {file}. Start one with `somrs up SITE`, or give --data") from None
        except (msgspec.DecodeError, OSError) as error:
            raise UsageError(f"{file} cannot be read: {error}") from None

    @classmethod
    def of_last_run(cls, data: Path) -> Addresses | None:
        """Those of the last run with a data folder; None if there was none."""
        try:
            return cls.read(data, LAST_FILE)
        except UsageError:
            return None

    def write(self, data: Path, name: str = SYSTEM_FILE) -> None:
        (data / name).write_bytes(msgspec.json.format(msgspec.json.encode(self)))


def registry_path(number: int) -> str:
    """The path of a Registry's address."""
    return "/registry" if number == 1 else f"/registry-{number}"


def registry_name(number: int) -> str:
    """The name of the Registry with this number, counted from 1."""
    return f"Registry{number}"


def task_manager_path(number: int) -> str:
    """The path of a Task Manager's address: on a bus, all addresses have the same origin."""
    return "/task-manager" if number == 1 else f"/task-manager-{number}"


def task_manager_name(number: int) -> str:
    """The name of the Task Manager with this number, counted from 1."""
    return f"TaskManager{number}"
