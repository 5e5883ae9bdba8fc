"""`somrs run`: run a single component of a system."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from somrs.cli.options import DEFAULT_FOLDER, LOOPBACK, Data, HostOption, PortOption, WorldOption, guarded
from somrs.devices.simulator.world.kinds import WorldKind

run_app = typer.Typer(help="Run a single component of a system.", no_args_is_help=True, rich_markup_mode=None)


@run_app.command()
def repository(
    site: Annotated[list[Path], typer.Option(help="Initial map and ontology files.")] = [],  # noqa: B006  # typer requires a list as the default
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
) -> None:
    """The Repository."""
    from somrs.deployment.programs import run_program, run_repository

    guarded(lambda: run_program(run_repository(data, site, host, port)))


@run_app.command()
def registry(data: Data = DEFAULT_FOLDER, host: HostOption = LOOPBACK, port: PortOption = 0) -> None:
    """The Service Registry."""
    from somrs.client.client import Addresses
    from somrs.deployment.programs import run_program, run_registry

    guarded(lambda: run_program(run_registry(data, Addresses.read(data), host, port)))


@run_app.command(name="task-manager")
def task_manager(
    number: Annotated[int, typer.Option(min=1, help="Which one, in a system with several.")] = 1,
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
) -> None:
    """A Task Manager."""
    from somrs.client.client import Addresses
    from somrs.deployment.programs import run_program, run_task_manager

    guarded(lambda: run_program(run_task_manager(data, Addresses.read(data), host, port, number)))


@run_app.command()
def simulator(
    site: Annotated[list[Path], typer.Option(help="Take the map from these files, without a Repository.")] = [],  # noqa: B006  # as above
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
    speed: Annotated[str, typer.Option(help="Speed of simulated time: 1 is real time, `max` is as fast as possible.")] = "1",
    world: WorldOption = WorldKind.PHYSICS,
) -> None:
    """The simulator, with the world of the Repository's map."""
    from somrs.client.client import Addresses
    from somrs.deployment.programs import run_program, run_simulator, run_simulator_of_files, speed_of

    if site:
        guarded(lambda: run_program(run_simulator_of_files(site, host, port, speed_of(speed), world)))
    else:
        guarded(lambda: run_program(run_simulator(data, Addresses.read(data), host, port, speed_of(speed), world)))


@run_app.command()
def traffic(data: Data = DEFAULT_FOLDER, host: HostOption = LOOPBACK, port: PortOption = 0) -> None:
    """The traffic of a building without a simulator, which has one of its own."""
    from somrs.client.client import Addresses
    from somrs.deployment.programs import run_program
    from somrs.deployment.traffic import run_traffic

    guarded(lambda: run_program(run_traffic(data, Addresses.read(data), host, port)))


@run_app.command()
def world(
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
    speed: Annotated[str, typer.Option(help="At speed 1, a service of cost 1 takes 1 s; at `max`, no time.")] = "1",
) -> None:
    """The symbolic world of devices without a simulated body."""
    from somrs.client.client import Addresses
    from somrs.deployment.programs import run_program, run_world, speed_of

    guarded(lambda: run_program(run_world(Addresses.read(data), host, port, speed_of(speed))))


@run_app.command()
def scheduler(data: Data = DEFAULT_FOLDER, host: HostOption = LOOPBACK, port: PortOption = 0) -> None:
    """The Scheduler, which keeps templates and standing orders."""
    from somrs.client.client import Addresses
    from somrs.deployment.programs import run_program
    from somrs.scheduling.program import run_scheduler

    guarded(lambda: run_program(run_scheduler(data, Addresses.read(data), host, port)))


@run_app.command()
def api(data: Data = DEFAULT_FOLDER, host: HostOption = LOOPBACK, port: PortOption = 0) -> None:
    """The API: REST and WebSocket."""
    from somrs.api.program import run_api
    from somrs.client.client import Addresses
    from somrs.deployment.programs import run_program

    guarded(lambda: run_program(run_api(data, Addresses.read(data), host, port)))


@run_app.command()
def gui(data: Data = DEFAULT_FOLDER, host: HostOption = LOOPBACK, port: PortOption = 0) -> None:
    """The windows, for the browser. They need the API."""
    from somrs.client.client import Addresses
    from somrs.deployment.programs import has_windows, run_program
    from somrs.errors import UsageError

    def run() -> None:
        if not has_windows():
            raise UsageError("the windows need additional packages: pip install 'somrs[gui]'")
        from somrs.gui.server import run_gui

        run_program(run_gui(data, Addresses.read(data), host, port))

    guarded(run)


@run_app.command()
def device(
    driver: Annotated[str, typer.Argument(help="The device's class: `module:Class` or `file.py:Class`.")],
    name: Annotated[str, typer.Option(help="The device's object on the map.")],
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
) -> None:
    """The Service Manager of a device."""
    from somrs.deployment.device import run_driver

    guarded(lambda: run_driver(driver, name, data, host))


@run_app.command()
def devices(
    devices: Annotated[list[str], typer.Argument(help="NAME=DRIVER for each device; a driver is `module:Class` or `file.py:Class`.")],
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
) -> None:
    """The Service Managers of several devices, in one process."""
    from somrs.deployment.device_host import parse_device, run_devices

    guarded(lambda: run_devices(dict(map(parse_device, devices)), data, host))
