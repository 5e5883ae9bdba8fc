"""The rows of the first page: what the API's answers mean for an operator."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from somrs.api.device_state import FAULT_LABELS, DeviceState
from somrs.api.fleet import DeviceView
from somrs.api.system import PartView
from somrs.client.state_labels import map_neighbour_is_away, map_neighbour_text, neighbour_text
from somrs.client.task_report import reasons
from somrs.gui.device_card import LEAVING, activity_text, problem_sentence, state
from somrs.gui.icons import OUTCOMES, Sign, format_time
from somrs.gui.pages.task_text import count_text, gist, task_path, task_sign
from somrs.protocol.messages.directory import NeighbourView
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.neighbours import MapNeighbourView
from somrs.protocol.messages.orders import RunState, StandingOrder
from somrs.protocol.messages.task_views import Phase, TaskRow

FAILED_TIME = 86_400.0
"""Seconds for which a failed task needs attention."""

MOST_NAMES = 12
"""Maximum number of devices named in a row."""

CONNECTED = "Thing"
"""The type of things that messages connect. A program of several reports what those say that have no service."""
RESPONDS = Sign("check_circle", "Responds", "good")
NO_RESPONSE = Sign("error", "No response", "bad")
PROBLEMS = Sign("warning", "Problems", "busy")
REFUSED = Sign("block", "Refused", "bad")


@dataclass(frozen=True, slots=True)
class Row:
    """A row. `key` is unique in its list; `text` is a link to `target`, if there is one; `progress`: a share from 0 to 1, and its text."""

    key: str
    sign: Sign
    text: str
    note: str = ""
    target: str = ""
    is_formula: bool = False
    progress: tuple[float, str] | None = None


def part_rows(
    parts: Sequence[PartView],
    neighbours: Iterable[NeighbourView] = (),
    maps: Iterable[MapNeighbourView] = (),
    now: float = 0.0,
) -> list[Row]:
    """The parts that respond, and those that do not; the neighbours of the Registry, and the maps of neighbours."""
    responding = [part.name for part in parts if part.milliseconds is not None]
    silent = [part.name for part in parts if part.milliseconds is None]
    return [
        Row(sign.text, sign, ", ".join(names), count_text(len(names), "part"))
        for sign, names in ((NO_RESPONSE, silent), (RESPONDS, responding))
        if names
    ] + [*(neighbour_row(neighbour) for neighbour in neighbours), *(map_row(neighbour, now) for neighbour in maps)]


def neighbour_row(neighbour: NeighbourView) -> Row:
    """A neighbour of the Registry, and whether it answers."""
    sign = RESPONDS if neighbour.away_since is None else NO_RESPONSE
    return Row(f"neighbour {neighbour.name}", sign, f"Neighbour {neighbour.name}", neighbour_text(neighbour, format_time))


def map_row(neighbour: MapNeighbourView, now: float) -> Row:
    """The map of a neighbour, and whether its Repository answers."""
    is_away = map_neighbour_is_away(neighbour, now)
    sign = NO_RESPONSE if is_away else PROBLEMS if neighbour.problems else RESPONDS
    name = neighbour.neighbour.map
    return Row(f"map {name}", sign, f"Map {name}", map_neighbour_text(neighbour, now, format_time))


def outage_rows(
    parts: Iterable[PartView],
    neighbours: Iterable[NeighbourView] = (),
    maps: Iterable[MapNeighbourView] = (),
    now: float = 0.0,
) -> list[Row]:
    """The parts that do not respond, and the neighbours that do not."""
    silent_parts = [Row(part.name, NO_RESPONSE, part.name, part.problem) for part in parts if part.milliseconds is None]
    silent_neighbours = [neighbour_row(neighbour) for neighbour in neighbours if neighbour.away_since is not None]
    return silent_parts + silent_neighbours + [map_row(neighbour, now) for neighbour in maps if map_neighbour_is_away(neighbour, now)]


def running_rows(tasks: Iterable[TaskRow]) -> list[Row]:
    """The tasks that have not ended, newest first."""
    running = sorted((task for task in tasks if task.phase is not Phase.ENDED), key=lambda task: -task.submitted_at)
    return [
        Row(
            key=task.task,
            sign=task_sign(task),
            text=task.effect,
            note=count_text(task.setbacks, "setback") if task.setbacks else "",
            target=task_path(task.task),
            is_formula=True,
            progress=(task.fraction, f"{task.done} of {count_text(task.steps, 'step')}") if task.steps else None,
        )
        for task in running
    ]


def failed_rows(tasks: Iterable[TaskRow], now: float) -> list[Row]:
    """The tasks that failed a short time ago, the latest first, without those whose goals were accomplished since."""
    tasks = [*tasks]
    accomplished: dict[str, float] = {}
    for task in tasks:
        if task.outcome is Outcome.ACCOMPLISHED:
            accomplished[task.effect] = max(task.ended_at or 0.0, accomplished.get(task.effect, 0.0))
    failed = [(task.ended_at or 0.0, task) for task in tasks if task.outcome is Outcome.FAILED]
    return [
        Row(
            key=task.task,
            sign=OUTCOMES[Outcome.FAILED],
            text=task.effect,
            note=" · ".join([format_time(ended_at), *(gist(reason[:1].upper() + reason[1:]) for reason in reasons(task)[:1])]),
            target=task_path(task.task),
            is_formula=True,
        )
        for ended_at, task in sorted(failed, key=lambda pair: -pair[0])
        if ended_at > max(now - FAILED_TIME, accomplished.get(task.effect, 0.0))
    ]


def device_rows(devices: Sequence[DeviceView]) -> list[Row]:
    """The devices by state: those at work each with what they do, all others by their names."""
    rows: list[Row] = []
    for device_state in DeviceState:
        in_state = [device for device in devices if device.state is device_state]
        if device_state in (DeviceState.BUSY, DeviceState.BOOKED):
            for device in in_state:
                work = "".join(f"{activity_text(assignment)} for {assignment.effect}" for assignment in device.assignments[:1])
                rows.append(Row(device.name, state(device), device.name, work, "/fleet"))
        elif in_state:
            names = ", ".join(device.name for device in in_state[:MOST_NAMES])
            more = f" and {len(in_state) - MOST_NAMES} more" if len(in_state) > MOST_NAMES else ""
            rows.append(Row(f"state {device_state}", state(in_state[0]), f"{names}{more}", count_text(len(in_state), "device"), "/fleet"))
    return rows


def unready_rows(devices: Iterable[DeviceView]) -> list[Row]:
    """The devices that somebody has to see to, and why; those with a fault first."""
    by_urgency = sorted(devices, key=lambda device: device.state is not DeviceState.NOT_WORKING)
    return [Row(device.name, state(device), device.name, why, "/fleet") for device in by_urgency if (why := _why_unready(device))]


def _why_unready(device: DeviceView) -> str:
    departure = f"It {LEAVING.get(device.reason, device.reason)} at {format_time(device.departed_at)}." if device.departed_at else ""
    match device.state:
        case DeviceState.NOT_WORKING:
            faults = device.simulated.faults if device.simulated is not None else ()
            labels = ", ".join(FAULT_LABELS[fault] for fault in faults)
            return f"Faults: {labels}." if faults else problem_sentence(device) or "According to the map, it does not work."
        case DeviceState.NOTHING_ON_OFFER if CONNECTED in device.lineage and not departure:
            return ""
        case DeviceState.NOTHING_ON_OFFER:
            return f"{departure} It offers no service: check its program.".strip()
        case DeviceState.DEPARTED if device.reason == "expired":
            return departure
    return ""


def order_rows(orders: Iterable[StandingOrder]) -> list[Row]:
    """The standing orders whose last run failed."""
    rows: list[Row] = []
    for order in orders:
        last = order.last
        if not order.enabled or last is None:
            continue
        note = f"Standing order, {format_time(last.due)}"
        if last.state is RunState.REFUSED:
            rows.append(Row(order.id, REFUSED, order.name, f"{note}: {last.note}", "/define"))
        elif last.outcome is Outcome.FAILED:
            rows.append(Row(order.id, OUTCOMES[Outcome.FAILED], order.name, note, task_path(last.task) if last.task else "/define"))
    return rows
