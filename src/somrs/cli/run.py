"""`somrs run`: run a single component of a system."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from somrs.cli.options import (
    DEFAULT_FOLDER,
    LOOPBACK,
    SECURE,
    AllowedHosts,
    BusOption,
    Data,
    HostOption,
    Neighbours,
    Oidc,
    PortOption,
    Secure,
    SiteName,
    Speed,
    WorldOption,
    guarded,
)
from somrs.devices.simulator.world.kinds import WorldKind

if TYPE_CHECKING:
    from somrs.client.addresses import Addresses

run_app = typer.Typer(help="Run a single component of a system.", no_args_is_help=True, rich_markup_mode=None)


@run_app.command()
def repository(
    site: Annotated[list[Path], typer.Option(envvar="SOMRS_SITE", help="Initial map and ontology files.")] = [],  # noqa: B006  # typer requires a list as the default
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
    neighbours: Neighbours = None,
    bus: BusOption = None,
    name: SiteName = None,
) -> None:
    """The Repository."""
    from somrs.deployment.components import run_repository
    from somrs.deployment.programs import run_program

    def run() -> None:
        run_program(run_repository(data, site, host, port, addresses_of(data, bus, name).bus if bus is not None else None, neighbours))

    guarded(run)


@run_app.command()
def bus(
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 4222,
    cluster_port: Annotated[
        int, typer.Option(min=1, max=65535, help="The port for the other servers of the bus, if there are several.")
    ] = 6222,
    route: Annotated[
        list[str], typer.Option(envvar="SOMRS_ROUTES", help="HOST:PORT of each server of the bus for the others, its own too.")
    ] = [],  # noqa: B006  # as above
    mqtt: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", envvar="SOMRS_MQTT", help="Be a broker for MQTT there, too.", show_default=False),
    ] = None,
) -> None:
    """A server of the bus: NATS with JetStream. Several that know each other store everything together."""
    from somrs.deployment.bus_server import run_bus
    from somrs.deployment.programs import run_program

    guarded(lambda: run_program(run_bus(data, host, port, cluster_port, route, mqtt=mqtt)))


@run_app.command()
def gateway(
    bus: Annotated[
        str, typer.Option(envvar="SOMRS_BUS", help="The NATS servers of the bus, such as nats://HOST:4222, separated by commas.")
    ],
    name: Annotated[str, typer.Option(envvar="SOMRS_NAME", help="The site's name on the bus: letters, digits, '-' and '_'.")],
    host: HostOption = LOOPBACK,
    port: PortOption = 8600,
    url: Annotated[
        str | None,
        typer.Option(
            envvar="SOMRS_URL", help="The gateway's URL for participants, if it is not that of HOST and PORT.", show_default=False
        ),
    ] = None,
    mqtt: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT,...",
            envvar=["SOMRS_MQTT_SERVERS", "SOMRS_MQTT"],
            help="Where the servers of the bus are a broker for MQTT, for adapters.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """The gateway of a site on the bus: the address of all its components for SOAP participants that are not on the bus."""
    from somrs.deployment.bus import bus_address, run_gateway
    from somrs.deployment.programs import run_program
    from somrs.trust.credentials import Credentials

    def run() -> None:
        scheme = "http" if Credentials.of_environment() is None else "https"
        address = bus_address(bus, name, url or f"{scheme}://{host}:{port}")
        run_program(run_gateway(address, host, port, mqtt))

    guarded(run)


@run_app.command()
def trust(
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 8610,
    url: Annotated[
        str | None, typer.Option(help="The URL for other computers, if it is not that of HOST and PORT.", show_default=False)
    ] = None,
) -> None:
    """The service of the certificate authority, where programs on other computers enrol and renew their certificates."""
    from somrs.deployment.programs import run_program
    from somrs.deployment.trust_service import run_trust

    guarded(lambda: run_program(run_trust(data, host, port, url)))


@run_app.command()
def registry(
    number: Annotated[int, typer.Option(min=1, help="Which one, in a system with several.")] = 1,
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
    neighbours: Neighbours = None,
    bus: BusOption = None,
    name: SiteName = None,
) -> None:
    """The Service Registry."""
    from somrs.deployment.components import run_registry
    from somrs.deployment.programs import run_program

    guarded(lambda: run_program(run_registry(data, addresses_of(data, bus, name), host, port, neighbours, number)))


@run_app.command(name="task-manager")
def task_manager(
    number: Annotated[int, typer.Option(min=1, help="Which one, in a system with several.")] = 1,
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
    bus: BusOption = None,
    name: SiteName = None,
) -> None:
    """A Task Manager."""
    from somrs.deployment.components import run_task_manager
    from somrs.deployment.programs import run_program

    guarded(lambda: run_program(run_task_manager(data, addresses_of(data, bus, name), host, port, number), has_worker=True))


@run_app.command()
def simulator(
    site: Annotated[list[Path], typer.Option(help="Take the map from these files, without a Repository.")] = [],  # noqa: B006  # as above
    repository: Annotated[
        list[str], typer.Option(metavar="URL", help="Simulate the maps of these Repositories in one world, whatever runs at --data.")
    ] = [],  # noqa: B006  # as above
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
    speed: Speed = "1",
    world: WorldOption = WorldKind.PHYSICS,
    bus: BusOption = None,
    name: SiteName = None,
) -> None:
    """The simulator, with the world of the Repository's map, or with that of several maps."""
    from somrs.client.addresses import Addresses
    from somrs.deployment.program_certificates import give_simulator_a_certificate
    from somrs.deployment.programs import run_program, run_simulator, run_simulator_of_files, speed_of

    if site:
        guarded(lambda: run_program(run_simulator_of_files(site, host, port, speed_of(speed), world)))
        return
    guarded(lambda: give_simulator_a_certificate(repository, data, host))
    addresses = (
        Addresses(repository=repository[0], registry="", task_manager="") if repository else guarded(lambda: addresses_of(data, bus, name))
    )
    guarded(lambda: run_program(run_simulator(data, addresses, host, port, speed_of(speed), world, repository)))


@run_app.command()
def traffic(
    data: Data = DEFAULT_FOLDER, host: HostOption = LOOPBACK, port: PortOption = 0, bus: BusOption = None, name: SiteName = None
) -> None:
    """The traffic of a building without a simulator, which has one of its own."""
    from somrs.deployment.programs import run_program
    from somrs.deployment.traffic import run_traffic

    guarded(lambda: run_program(run_traffic(data, addresses_of(data, bus, name), host, port), has_worker=True))


@run_app.command()
def world(
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
    speed: Annotated[str, typer.Option(help="At speed 1, a service of cost 1 takes 1 s; at `max`, no time.")] = "1",
    bus: BusOption = None,
    name: SiteName = None,
) -> None:
    """The symbolic world of devices without a simulated body."""
    from somrs.deployment.programs import run_program, run_world, speed_of

    guarded(lambda: run_program(run_world(addresses_of(data, bus, name), host, port, speed_of(speed))))


@run_app.command()
def scheduler(
    data: Data = DEFAULT_FOLDER, host: HostOption = LOOPBACK, port: PortOption = 0, bus: BusOption = None, name: SiteName = None
) -> None:
    """The Scheduler, which keeps templates and standing orders."""
    from somrs.deployment.programs import run_program
    from somrs.scheduling.program import run_scheduler

    guarded(lambda: run_program(run_scheduler(data, addresses_of(data, bus, name), host, port)))


@run_app.command()
def api(
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
    bus: BusOption = None,
    name: SiteName = None,
    allowed_hosts: AllowedHosts = [],  # noqa: B006  # as above
    secure: Secure = SECURE,
) -> None:
    """The API: REST and WebSocket."""
    from somrs.api.program import run_api
    from somrs.deployment.programs import run_program

    guarded(lambda: run_program(run_api(data, addresses_of(data, bus, name), host, port, allowed_hosts, secure=secure)))


@run_app.command()
def gui(
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
    bus: BusOption = None,
    name: SiteName = None,
    allowed_hosts: AllowedHosts = [],  # noqa: B006  # as above
    secure: Secure = SECURE,
    oidc: Oidc = None,
) -> None:
    """The windows, for the browser. They need the API."""
    from somrs.deployment.programs import has_windows, run_program
    from somrs.errors import UsageError

    def run() -> None:
        if not has_windows():
            raise UsageError("the windows need additional packages: pip install 'somrs[gui]'")
        from somrs.gui.server import run_gui

        run_program(run_gui(data, addresses_of(data, bus, name), host, port, allowed_hosts, secure=secure, oidc=oidc))

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
    bus: BusOption = None,
    name: SiteName = None,
) -> None:
    """The Service Managers of several devices, in one process."""
    from somrs.deployment.device_host import parse_device, run_devices

    guarded(lambda: run_devices(dict(map(parse_device, devices)), addresses_of(data, bus, name), data, host))


@run_app.command()
def broker(data: Data = DEFAULT_FOLDER, host: HostOption = LOOPBACK, port: PortOption = 1883) -> None:
    """A broker for MQTT, for adapters."""
    from somrs.deployment.mqtt_broker import run_broker
    from somrs.deployment.programs import run_program

    guarded(lambda: run_program(run_broker(data, host, port)))


@run_app.command()
def adapter(
    name: Annotated[str, typer.Argument(help="The adapter, such as vda5050.")],
    simulated: Annotated[bool, typer.Option("--simulated", help="The other end: robots of the simulator behind the protocol.")] = False,
    devices: Annotated[list[str], typer.Argument(help="NAME=adapter for each device of which it is known that it is one.")] = [],  # noqa: B006  # as above
    site: Annotated[
        list[Path],
        typer.Option(help="Files with `adapters:`; by default, the adapters that `somrs up` has started.", show_default=False),
    ] = [],  # noqa: B006  # as above
    data: Data = DEFAULT_FOLDER,
    host: HostOption = LOOPBACK,
    bus: BusOption = None,
    site_name: SiteName = None,
) -> None:
    """The adapter for robots or things of one protocol."""
    from somrs.deployment.adapters import run_adapter

    guarded(lambda: run_adapter(name, addresses_of(data, bus, site_name), data, host, site, is_simulated=simulated))


def addresses_of(data: Path, bus: str | None, name: str | None) -> Addresses:
    """The addresses of the running system: of its data folder, or of a site on a bus. Raises UsageError when it is not there."""
    from somrs.client.addresses import Addresses

    if bus is None:
        return Addresses.read(data)
    from somrs.client.credentials import credentials_in
    from somrs.deployment.bus import find_site

    return asyncio.run(find_site(bus, name, credentials_in(data, bus)))
