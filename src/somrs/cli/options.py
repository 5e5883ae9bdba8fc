"""The options that several commands share, and the runner of commands, which prints a user's mistake without a stack trace."""

from __future__ import annotations

import asyncio
import os
import re
import sys
from collections.abc import Coroutine
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand

from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import InputError, SomrsError

SiteFiles = Annotated[
    list[Path] | None,
    typer.Argument(
        help="A site: map and ontology files, or a building to import. By default the one of the data folder, or the demonstration's.",
        show_default=False,
    ),
]
Data = Annotated[Path, typer.Option("--data", envvar="SOMRS_DATA", help="The data folder of the system.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]
HostOption = Annotated[str, typer.Option("--host", envvar="SOMRS_HOST", help="The address to listen on.")]
WorldOption = Annotated[
    WorldKind,
    typer.Option("--world", help="What moves the simulated world: `physics`, or `kinematic`, without forces, for hundreds of robots."),
]
PortOption = Annotated[int, typer.Option("--port", min=0, max=65535, help="The port to listen on; 0 selects a free port.")]
AllowedHosts = Annotated[
    list[str],
    typer.Option(
        "--allowed-host",
        envvar="SOMRS_ALLOWED_HOSTS",
        help="A name of this server for browsers, besides IP addresses and this computer's name; in the variable, spaces separate several.",
        show_default=False,
    ),
]
Secure = Annotated[
    bool,
    typer.Option(
        "--secure/--insecure",
        envvar="SOMRS_SECURE",
        help="Whether people and programs have to say who they are at the API and the windows, and may do what their role allows.",
    ),
]
Certificates = Annotated[
    bool | None,
    typer.Option(
        "--certificates/--no-certificates",
        envvar="SOMRS_CERTIFICATES",
        help="Whether components and devices prove to each other who they are, and may send what their role allows. By default as in the "
        "last run with this data folder, at first they do; with --insecure, they do not.",
        show_default=False,
    ),
]
Oidc = Annotated[
    Path | None,
    typer.Option(
        "--oidc",
        envvar="SOMRS_OIDC",
        help="The file of the OpenID Connect provider at which people sign in, and of the roles that they then have.",
        show_default=False,
    ),
]
SECURE = True
"""The default of `Secure`."""
BusOption = Annotated[
    str | None,
    typer.Option(
        "--bus",
        envvar="SOMRS_BUS",
        help="Run on the bus with these NATS servers, such as nats://HOST:4222, separated by commas.",
        show_default=False,
    ),
]
SiteName = Annotated[
    str | None,
    typer.Option(
        "--name", envvar="SOMRS_NAME", help="The site's name on the bus; not necessary when there is only one.", show_default=False
    ),
]
Neighbours = Annotated[
    Path | None,
    typer.Option(
        "--neighbours",
        envvar="SOMRS_NEIGHBOURS",
        help="The file of the neighbours: whose offers are listed and whose objects are on the map, and what they are given and shown.",
        show_default=False,
    ),
]
DevicesPerProcess = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="How many devices share a process; 1 gives each its own. By default, many devices with drivers of SO-MRS share a few.",
        show_default=False,
    ),
]
DriverOption = Annotated[
    list[str],
    typer.Option(
        "--driver",
        envvar="SOMRS_DRIVERS",
        help="A program of devices, `module:Class` or `file.py:Class`, besides those of SO-MRS and of the site's files.",
        show_default=False,
    ),
]
TaskManagers = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="How many Task Managers share the tasks. By default as many as in the last run with this data folder, at first one.",
        show_default=False,
    ),
]
Registries = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="How many Registries list the services. By default as many as in the last run with this data folder, at first one.",
        show_default=False,
    ),
]
OwnBusOption = Annotated[
    str | None,
    typer.Option(
        help="Have the components talk over NATS: `--bus` alone starts a server, `--bus nats://HOST:4222` joins one.",
        show_default=False,
    ),
]
MqttOption = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT,...", help="Where the servers of the bus are a broker for MQTT. By default, at a free port.", show_default=False
    ),
]
_SERVERS = re.compile(r"\w+://|[^/,]+:\d+(,|$)")
"""How the servers of a bus begin, and no file of a site."""


class UpCommand(TyperCommand):
    """Takes `--bus` alone, which no option of typer can be: the system then starts a bus of its own."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        completed: list[str] = []
        for argument, following in zip(args, [*args[1:], ""], strict=True):
            completed.append(argument)
            if argument == "--bus" and not _SERVERS.match(following):
                completed.append("own")
        return super().parse_args(ctx, completed)


Speed = Annotated[str, typer.Option(help="Speed of simulated time: 1 is real time, `max` is as fast as possible.")]
Fresh = Annotated[bool, typer.Option("--fresh", help="Discard the map of an earlier run, and start with the site's map.")]
Vda5050Option = Annotated[
    str | None,
    typer.Option(metavar="URL", help="Control the VDA 5050 vehicles at this broker, such as mqtt://HOST:1883.", show_default=False),
]
ArcosOption = Annotated[bool, typer.Option("--arcos", help="Drive the Pioneer robots of the simulator by ARCOS.")]
Simulates = Annotated[
    bool,
    typer.Option(
        "--simulator/--no-simulator",
        help="Simulate the building; without, its robots are real, and `somrs` only grants them their ways.",
    ),
]
FirstPort = Annotated[
    int | None,
    typer.Option(
        min=1024,
        max=65000,
        help="Listen at this port and those that follow, so that neighbours know the addresses. By default those of the last run, if free.",
        show_default=False,
    ),
]
SharedSimulator = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT",
        help="The simulator that simulates this building with those of neighbours (`somrs run simulator --repository ...`).",
        show_default=False,
    ),
]
Formula = Annotated[str, typer.Argument(help="An Entish formula, such as 'Jar002 isOn Platform001'.")]


def _parse_priority(text: object) -> int:
    from somrs.client.state_labels import parse_priority

    try:
        return parse_priority(str(text))
    except InputError as error:
        raise typer.BadParameter(str(error)) from None


Priority = Annotated[
    int,
    typer.Option(
        parser=_parse_priority,
        metavar="PRIORITY",
        show_default="normal",
        help="low, normal, high, urgent, or a whole number. Among tasks that wait for the same objects or devices, the one with the higher "
        "priority goes first.",
    ),
]


class UnavailableOption(StrEnum):
    """What a task does while no service is available for it."""

    wait = "wait"
    fail = "fail"


Unavailable = Annotated[
    UnavailableOption,
    typer.Option(help="What the task does if no service can do it now, such as when all robots are broken: wait and try again, or fail."),
]
DEFAULT_FOLDER = Path(".somrs")
LOOPBACK = "127.0.0.1"


def awaited(main: Coroutine[Any, Any, Any]) -> Any:
    """Run the coroutine, and return its result; a `SomrsError` ends the program as in `guarded`."""
    return guarded(lambda: asyncio.run(main))


def guarded(run: Any) -> Any:
    """Call `run`, and return its result. On an error, print it and exit: with status 2 for an invalid request, 1 for any other failure."""
    try:
        return run()
    except InputError as error:
        fail(str(error), 2)
    except SomrsError as error:
        fail(str(error), 1)
    except BrokenPipeError:  # the reader of the pipe has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        if error.filename is None:
            raise
        fail(f"{error.filename}: {error.strerror}", 2)
    except KeyboardInterrupt:
        sys.exit(130)


def fail(text: str, code: int) -> NoReturn:
    typer.echo(text, err=True)
    sys.exit(code)
