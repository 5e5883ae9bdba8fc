"""What `somrs fleet` does: show the devices of a running system, once or as they change."""

from __future__ import annotations

from pathlib import Path

from rich.console import Group
from rich.live import Live
from rich.text import Text

from somrs.api.device_state import FAULT_LABELS, LABELS, DeviceState
from somrs.api.fleet import BUSY, Devices, DeviceView
from somrs.api.service import open_api_service
from somrs.client import terminal
from somrs.client.client import Addresses
from somrs.client.refusals import ErrorReport

SHOWN = 5
"""Comings and goings that are shown."""

SIGNS = {
    DeviceState.READY: ("✔", "green"),
    DeviceState.BUSY: ("▶", "green"),
    DeviceState.BOOKED: ("▷", "green"),
    DeviceState.NOT_WORKING: ("✘", "red"),
    DeviceState.NOTHING_ON_OFFER: ("", "yellow"),
    DeviceState.DEPARTED: ("", "dim"),
}
"""A sign and a colour for each state; colour is never the only sign."""


async def fleet(data: Path, *, follow: bool, json: bool) -> None:
    async with open_api_service(Addresses.read(data), data) as desk:
        if not follow:
            found = await desk.fleet.devices()
            if json:
                terminal.print_json(found)
            else:
                terminal.console().print(seen(found))
            return
        with Live(console=terminal.console(), auto_refresh=False) as screen, desk.context.hub.subscribe("fleet") as listening:
            async for news in listening:
                match news.value:
                    case Devices() as devices:
                        screen.update(seen(devices), refresh=True)
                    case ErrorReport(problem=problem):
                        screen.update(Text(problem, style="red"), refresh=True)


def seen(found: Devices) -> Group:
    """All devices, and who came and went lately."""
    rows = (
        (terminal.lines(one.name, f"a {one.type}" if one.type else ""), _state(one), _does(one), _services(one)) for one in found.devices
    )
    columns = ("device", "state", "does", "services, and how they have done")
    least = {"device": terminal.column_width(one.name for one in found.devices)}
    made = terminal.table("Fleet", columns, rows, least=least)
    log = [
        Text(f"{terminal.clock(one.at)}  {one.device} {'joined' if one.joined else f'left: {one.reason}'}", style="dim")
        for one in found.log[:SHOWN]
    ]
    return Group(made, *log)


def _state(device: DeviceView) -> Text:
    sign, colour = SIGNS.get(device.state, ("", ""))
    state = Text(f"{sign} {LABELS[device.state].lower()}".strip(), style=colour)
    state.append(f"\nload {100 * device.load:.0f} %", style="dim")
    if device.charge is not None:
        state.append(f"\nbattery {device.charge:.0f} %", style="dim")
    for fault in device.simulated.faults if device.simulated is not None else ():
        state.append(f"\n! {FAULT_LABELS[fault]}", style="red")
    return state


def _does(device: DeviceView) -> str:
    said: list[str] = []
    for one in device.assignments:
        how = f"{100 * one.fraction:.0f} %" if one.fraction is not None and one.state in BUSY else one.state.value.lower()
        said.append(f"{one.service_type} ({', '.join(one.inputs.values())}), {how}\nfor {one.effect} ({terminal.short(one.task)})")
    held = device.simulated.holding if device.simulated is not None else None
    for name in dict.fromkeys([*((held,) if held else ()), *device.holding]):
        said.append(f"holds {name}")
    return "\n".join(said) or "-"


def _services(device: DeviceView) -> str:
    return (
        "\n".join(
            terminal.lines(
                f"{one.type}{f', {one.price:g} EUR' if one.price is not None else ''}{'' if one.on_offer else ', not on offer'}",
                f"  {one.tally.in_words()}",
            )
            for one in device.services
        )
        or "-"
    )
