"""The commands by which an operator tells devices directly: stop and go on, out of service and back, go there, charge, be put there; and
the modes of a building."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from somrs.cli.ontology import DEFAULT_AUTHOR, Author
from somrs.cli.options import DEFAULT_FOLDER, Data, Json, awaited, fail

if TYPE_CHECKING:
    from somrs.api.control import Modes
    from somrs.api.remote import Api

control_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)

Result = TypeVar("Result")
DeviceName = Annotated[str, typer.Argument(help="The device.")]
AnyDevice = Annotated[str | None, typer.Argument(help="The device; by default, all devices.", show_default=False)]
StoreyOption = Annotated[str | None, typer.Option(help="Only the devices of this storey.", show_default=False)]


class ModeName(StrEnum):
    """The modes, as the command has them."""

    NORMAL = "normal"
    FIRE = "fire"
    EMERGENCY = "emergency"
    OUT_OF_ORDER = "out-of-order"


async def with_api(data: Path, call: Callable[[Api], Awaitable[Result]]) -> Result:
    """Call an operation of the API of the running system."""
    from somrs.api.remote import api_of

    async with api_of(data) as api:
        return await call(api)


def _print_stopped(names: tuple[str, ...]) -> None:
    print(f"stopped: {', '.join(names)}" if names else "no device is stopped")


@control_app.command()
def stop(device: AnyDevice = None, storey: StoreyOption = None, author: Author = DEFAULT_AUTHOR, data: Data = DEFAULT_FOLDER) -> None:
    """Stop devices at once. They stand still and keep their work, until `somrs release`."""
    _print_stopped(awaited(with_api(data, lambda api: api.control.stop(device=device, storey=storey, by=author))).stopped)


@control_app.command()
def release(device: AnyDevice = None, storey: StoreyOption = None, author: Author = DEFAULT_AUTHOR, data: Data = DEFAULT_FOLDER) -> None:
    """Let stopped devices go on."""
    answer = awaited(with_api(data, lambda api: api.control.release(device=device, storey=storey, by=author)))
    print(f"released: {', '.join(answer.released)}" if answer.released else "nothing to release: no such device was stopped")
    if answer.stopped:
        _print_stopped(answer.stopped)


@control_app.command(name="out-of-service")
def out_of_service(
    device: DeviceName,
    back: Annotated[bool, typer.Option("--back", help="Take it back into service.")] = False,
    author: Author = DEFAULT_AUTHOR,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Take a device out of service, or back. It finishes the work that it has, and gets no more."""
    awaited(with_api(data, lambda api: api.control.service(device, active=back, by=author)))
    print(f"{device} is {'in service' if back else 'out of service'}")


@control_app.command()
def go(
    device: DeviceName, place: Annotated[str, typer.Argument(help="The place, an object of the map.")], data: Data = DEFAULT_FOLDER
) -> None:
    """Send a device to a place, as a task."""
    print(awaited(with_api(data, lambda api: api.control.go(device, place=place))).task)


@control_app.command()
def charge(device: DeviceName, data: Data = DEFAULT_FOLDER) -> None:
    """Let a device charge its battery, as a task."""
    print(awaited(with_api(data, lambda api: api.control.charge(device))).task)


@control_app.command(context_settings={"ignore_unknown_options": True})  # numbers may be negative
def put(
    robot: Annotated[str, typer.Argument(help="The simulated robot.")],
    x: Annotated[float, typer.Argument(help="Its place on the map, in metres: x.")],
    y: Annotated[float, typer.Argument(help="The same: y.")],
    storey: Annotated[str | None, typer.Option(help="The storey; by default, the one on which it is.", show_default=False)] = None,
    turned: Annotated[float, typer.Option(help="Its heading, in radians.")] = 0.0,
    author: Author = DEFAULT_AUTHOR,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Put a simulated robot elsewhere at once, as somebody would carry it.

    It gives up what it does, and its task goes on from there. It must fit there, and hold nothing.
    """
    awaited(with_api(data, lambda api: api.fleet.put(robot, x=x, y=y, storey=storey, turned=turned, by=author)))
    print(f"{robot} was put at x {x:.2f} m, y {y:.2f} m{f' on {storey}' if storey is not None else ''}")


@control_app.command()
def mode(
    mode: Annotated[
        ModeName | None, typer.Argument(help="The mode; without it, the modes are shown.", case_sensitive=False, show_default=False)
    ] = None,
    building: Annotated[str | None, typer.Option(help="Only this building; by default, all.", show_default=False)] = None,
    lift: Annotated[str | None, typer.Option(help="This lift.", show_default=False)] = None,
    door: Annotated[str | None, typer.Option(help="This door.", show_default=False)] = None,
    author: Author = DEFAULT_AUTHOR,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Show the modes of buildings, lifts and doors, or set one.

    In a fire or an emergency, robots stand still until the building is normal again. Nobody uses a lift or a door that is out of order.
    """
    from somrs.client import terminal
    from somrs.ontology.modes import Mode

    if mode is None and (building, lift, door) != (None, None, None):
        fail("say which mode it is to have: fire, emergency, out-of-order or normal", 2)

    async def call(api: Api) -> Modes:
        if mode is None:
            return await api.control.modes()
        return await api.control.set_mode(Mode[mode.name], building=building, lift=lift, door=door, by=author)

    current = awaited(with_api(data, call))
    if json:
        terminal.print_json(current)
    elif not current.modes:
        print("no building is on the map, and no lift or door is out of order")
    else:
        rows = ((entry.object, ModeName[entry.mode.name], entry.reason) for entry in current.modes)
        terminal.console().print(terminal.table("Modes", ("object", "mode", "reason"), rows))
