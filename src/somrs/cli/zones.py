"""The command by which an operator draws no-go zones and slow zones, and removes them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import typer

from somrs.cli.control import with_api
from somrs.cli.ontology import DEFAULT_AUTHOR, Author
from somrs.cli.options import DEFAULT_FOLDER, Data, Json, awaited, fail

if TYPE_CHECKING:
    from somrs.api.remote import Api
    from somrs.api.zones import ZoneList

zones_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)


@zones_app.command()
def zone(
    name: Annotated[str | None, typer.Argument(help="The zone; without it, all zones are shown.", show_default=False)] = None,
    corners: Annotated[
        str | None,
        typer.Option(help='Draw it with these corners, in metres: "1,1 4,1 4,3". Two are those of a box.', show_default=False),
    ] = None,
    limit: Annotated[float | None, typer.Option(help="The highest speed in it, m/s; by default, no robot enters it.")] = None,
    storey: Annotated[str | None, typer.Option(help="The storey; needed if there are several.", show_default=False)] = None,
    remove: Annotated[bool, typer.Option("--remove", help="Remove it.")] = False,
    author: Author = DEFAULT_AUTHOR,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Show the zones of the map, draw one, or remove one.

    Robots do not enter a no-go zone; those that are in it may leave. In a slow zone, they drive at its limit at most.
    """
    if name is None and (corners is not None or remove):
        fail("say which zone: somrs zone NAME --corners ..., or somrs zone NAME --remove", 2)
    if name is not None and (corners is None) != remove:
        fail(f"say what to do: somrs zone {name} --corners ..., or somrs zone {name} --remove", 2)
    points = _points(corners) if corners is not None else ()

    async def call(api: Api) -> ZoneList:
        from somrs.api.zones import ZoneDrawing, ZoneList

        if name is None:
            return await api.zones.list()
        if remove:
            await api.zones.remove(name, by=author)
            return ZoneList(zones=())
        drawing = ZoneDrawing(name=name, corners=points, storey=storey, limit=limit, by=author)
        return ZoneList(zones=((await api.zones.draw(drawing)).zone,))

    _show(awaited(with_api(data, call)), name if remove else None, json)


def _show(zones: ZoneList, removed: str | None, json: bool) -> None:
    from somrs.client import terminal

    if removed is not None:
        print(f"{removed} was removed")
    elif json:
        terminal.print_json(zones)
    elif not zones.zones:
        print("no zone is on the map")
    else:
        rows = (
            (
                zone.name,
                "no-go" if zone.limit is None else f"at most {zone.limit:g} m/s",
                zone.storey or f"{zone.height:g} m",
                " ".join(f"{x:g},{y:g}" for x, y in zone.corners),
            )
            for zone in zones.zones
        )
        terminal.console().print(terminal.table("Zones", ("zone", "speed", "storey", "corners, m"), rows))


def _points(text: str) -> tuple[tuple[float, float], ...]:
    """The corners of a zone, as they are written."""
    try:
        points = tuple((float(x), float(y)) for x, y in (corner.split(",") for corner in text.split()))
    except ValueError:
        points = ()
    if len(points) < 2 or not all(map(math.isfinite, (value for point in points for value in point))):
        fail(f'corners are written as "1,1 4,1 4,3", in metres, and not as "{text}"', 2)
    return points
