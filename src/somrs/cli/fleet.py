"""The implementation of `somrs fleet`: show the devices of a running system, once or continuously."""

from __future__ import annotations

from pathlib import Path

from rich.console import Group
from rich.live import Live
from rich.text import Text

from somrs.api.assignments import BUSY
from somrs.api.device_state import LABELS, DeviceState
from somrs.api.fleet import Devices, DeviceView
from somrs.api.service import open_api_service
from somrs.client import terminal
from somrs.client.addresses import Addresses
from somrs.client.refusals import ErrorReport
from somrs.protocol.messages.directory import PresenceChange
from somrs.protocol.messages.event_text import short_id

MAX_LOG_LINES = 5
"""Maximum number of arrivals and departures shown."""

SIGNS = {
    DeviceState.READY: ("✔", "green"),
    DeviceState.BUSY: ("▶", "green"),
    DeviceState.BOOKED: ("▷", "green"),
    DeviceState.NOT_WORKING: ("✘", "red"),
    DeviceState.STOPPED: ("✋", "red"),
    DeviceState.OUT_OF_SERVICE: ("", "dim"),
    DeviceState.NOTHING_ON_OFFER: ("", "yellow"),
    DeviceState.DEPARTED: ("", "dim"),
}
"""A sign and a colour for each state; colour is never the only sign."""


async def fleet(data: Path, *, follow: bool, json: bool) -> None:
    async with open_api_service(Addresses.read(data), data) as service:
        if not follow:
            fleet_state = await service.fleet.devices()
            if json:
                terminal.print_json(fleet_state)
            else:
                terminal.console().print(_render_fleet(fleet_state))
            return
        with Live(console=terminal.console(), auto_refresh=False) as screen, service.context.hub.subscribe("fleet") as subscription:
            async for news in subscription:
                match news.value:
                    case Devices() as devices:
                        screen.update(_render_fleet(devices), refresh=True)
                    case ErrorReport(problem=problem):
                        screen.update(Text(problem, style="red"), refresh=True)


def _render_fleet(fleet_state: Devices) -> Group:
    """All devices, and the latest arrivals and departures."""
    rows = (
        (
            terminal.lines(device.name, f"a {device.type}" if device.type else "", f"from {device.registry}" if device.registry else ""),
            _state(device),
            _describe_activity(device),
            _services(device),
        )
        for device in fleet_state.devices
    )
    columns = ("device", "state", "work", "services and their reliability")
    return Group(terminal.table("Fleet", columns, rows), *map(_log_line, fleet_state.log[:MAX_LOG_LINES]))


def _log_line(change: PresenceChange) -> Text:
    device = f"{change.device} of {change.registry}" if change.registry else change.device
    return Text(f"{terminal.clock(change.at)}  {device} {'joined' if change.joined else f'left: {change.reason}'}", style="dim")


def _state(device: DeviceView) -> Text:
    sign, colour = SIGNS.get(device.state, ("", ""))
    state = Text(f"{sign} {LABELS[device.state].lower()}".strip(), style=colour)
    state.append(f"\nutilisation {100 * device.utilisation:.0f} %", style="dim")
    if device.charge is not None:
        state.append(f"\nbattery {device.charge:.0f} %", style="dim")
    if device.problem:
        state.append(f"\n! {device.problem}", style="red")
    return state


def _describe_activity(device: DeviceView) -> str:
    lines: list[str] = []
    for assignment in device.assignments:
        progress = (
            f"{100 * assignment.fraction:.0f} %"
            if assignment.fraction is not None and assignment.state in BUSY
            else assignment.state.value.lower()
        )
        lines.append(
            f"{assignment.service_type} ({', '.join(assignment.inputs.values())}), {progress}\n"
            f"for {assignment.effect} ({short_id(assignment.task)})"
        )
        if assignment.note and not device.waiting:
            lines.append(assignment.note)
    held = device.simulated.holding if device.simulated is not None else None
    for name in dict.fromkeys([*((held,) if held else ()), *device.holding]):
        lines.append(f"{'carries' if 'Lift' in device.lineage else 'holds'} {name}")
    if device.waiting:
        lines.append(device.waiting)
    return "\n".join(lines) or "-"


def _services(device: DeviceView) -> str:
    return (
        "\n".join(
            terminal.lines(
                f"{service.type}{f', {service.price:g} EUR' if service.price is not None else ''}"
                f"{'' if service.on_offer else ', not on offer'}",
                f"  {service.tally.in_words()}",
            )
            for service in device.services
        )
        or "-"
    )
