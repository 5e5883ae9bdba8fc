"""The implementation of `somrs status`: what runs where, and whether it answers."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec
from rich.markup import escape
from rich.table import Table

from somrs.api.service import open_api_service
from somrs.api.system import PartView
from somrs.client import terminal
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.client.credentials import credentials_for
from somrs.client.state_labels import map_neighbour_is_away, map_neighbour_text, neighbour_text
from somrs.deployment.bus import running_components
from somrs.deployment.incidents import Incident
from somrs.errors import RemoteError
from somrs.protocol.messages.directory import NeighbourView
from somrs.protocol.messages.neighbours import MapNeighbourView
from somrs.storage.running_component import RunningComponent


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """What `somrs status` shows. `parts`: the components; `processes`: those that run them on a bus; `neighbours`: of the Registry."""

    parts: Sequence[PartView] = ()
    processes: Sequence[RunningComponent] = ()
    neighbours: Sequence[NeighbourView] = ()
    neighbouring_maps: Sequence[MapNeighbourView] = ()
    incidents: Sequence[Incident] = ()
    brokers: Sequence[str] = ()
    """Where brokers for MQTT are that belong to the system."""


async def status(addresses: Addresses, data: Path, *, json: bool) -> None:
    """Show the components of a system that is not on a bus; on a bus, the processes that run them, which may be on several hosts."""
    status = await _read(addresses, data)
    if json:
        terminal.print_json(status)
    elif addresses.bus is not None and not status.processes:
        print(f"no component of the site {addresses.bus.site} runs on the bus at {addresses.bus.servers}")
    else:
        terminal.console().print(processes_table(status.processes) if addresses.bus is not None else _render_parts(status.parts))
        _print_neighbours(status.neighbours)
        _print_neighbouring_maps(status.neighbouring_maps)
        for broker in status.brokers:
            print(f"the broker for MQTT: {broker}")
        for incident in status.incidents:
            print(f"{terminal.moment(incident.at)} {incident.text}")


async def _read(addresses: Addresses, data: Path) -> Status:
    brokers = [broker for broker in (addresses.mqtt, addresses.broker) if broker is not None]
    if addresses.bus is None:
        async with open_api_service(addresses, data) as service:
            system = await service.system.read()
        return Status(
            parts=system.parts,
            neighbours=system.neighbours,
            neighbouring_maps=system.neighbouring_maps,
            incidents=system.incidents,
            brokers=brokers,
        )
    processes = await running_components(addresses.bus, credentials_for(addresses))
    if processes:
        with contextlib.suppress(RemoteError):  # the table says what does not run
            async with Client(addresses) as client:
                neighbours, maps = await client.neighbours(), (await client.map_neighbours()).neighbours
                return Status(processes=processes, neighbours=neighbours, neighbouring_maps=maps, brokers=brokers)
    return Status(processes=processes, brokers=brokers)


def _print_neighbours(neighbours: Sequence[NeighbourView]) -> None:
    """Print the neighbours of the Registry, if it has some."""
    table = Table("neighbour", "address", "state")
    for neighbour in neighbours:
        sign = "[green]✔[/]" if neighbour.away_since is None else "[red]✘[/]"
        table.add_row(escape(neighbour.name), escape(neighbour.address), f"{sign} {escape(neighbour_text(neighbour, terminal.clock))}")
    if neighbours:
        terminal.console().print(table)


def _print_neighbouring_maps(neighbours: Sequence[MapNeighbourView]) -> None:
    """Print the maps of neighbours, if there are some."""
    table, now = Table("map", "address", "state"), time.time()
    for neighbour in neighbours:
        sign = "[red]✘[/]" if map_neighbour_is_away(neighbour, now) else "[yellow]![/]" if neighbour.problems else "[green]✔[/]"
        state = escape(map_neighbour_text(neighbour, now, terminal.clock))
        table.add_row(escape(neighbour.neighbour.map), escape(neighbour.neighbour.address), f"{sign} {state}")
    if neighbours:
        terminal.console().print(table)


def processes_table(processes: Sequence[RunningComponent]) -> Table:
    """What runs where, who leads, and what is wrong."""
    table = Table("component", "host", "process", "state", "inputs", "behind")
    leading = {process.component: process.number for process in processes if process.leads}
    for process in processes:
        behind = max(0, leading.get(process.component, process.number) - process.number)
        state = "[green]✔ leads[/]" if process.leads else "standby"
        if process.problem:
            state += f"\n[red]✘[/] {escape(process.problem)}"
        table.add_row(process.component, process.host, str(process.process), state, str(process.number), str(behind))
    for component in sorted({process.component for process in processes} - set(leading)):
        table.add_row(component, "", "", "[red]✘ nobody leads[/]", "", "")
    return table


def _render_parts(parts: Sequence[PartView]) -> Table:
    table = Table("component", "address", "answers")
    for part in parts:
        answers = f"[green]✔[/] in {part.milliseconds:g} ms" if part.milliseconds is not None else f"[red]✘[/] {part.problem}"
        table.add_row(part.name, part.address, answers)
    return table
