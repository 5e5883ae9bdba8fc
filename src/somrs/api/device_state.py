"""The state of a device in one word, for the API, the windows and the terminal: derived here, and called the same everywhere."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from enum import StrEnum

from somrs.devices.simulator.link.commands import Fault


class DeviceState(StrEnum):
    """What can be expected of a device now."""

    READY = "ready"
    """It has services on offer, and nothing to do."""
    BUSY = "busy"
    """It works for a task."""
    BOOKED = "booked"
    """It is to work for a task."""
    NOT_WORKING = "not-working"
    """Something of it is broken, whether or not it has something to do."""
    NOTHING_ON_OFFER = "nothing-on-offer"
    """It is on the map, and offers nothing now."""
    DEPARTED = "gone"
    """It is on no map, and left a short time ago."""


LABELS: Mapping[DeviceState, str] = {
    DeviceState.READY: "Ready",
    DeviceState.BUSY: "Busy",
    DeviceState.BOOKED: "Booked",
    DeviceState.NOT_WORKING: "Not working",
    DeviceState.NOTHING_ON_OFFER: "Nothing on offer",
    DeviceState.DEPARTED: "Gone",
}
"""What people read."""

FAULT_LABELS: Mapping[Fault, str] = {
    Fault.DRIVE: "drive broken",
    Fault.GRIPPER: "gripper stuck",
    Fault.SILENT: "silent",
    Fault.LINK: "link cut",
}
"""Why a simulated robot is not working."""


def is_working(on_map: bool, faults: Collection[Fault] | None) -> bool:
    """Whether a device can do what it is for: by its `faults`, where the simulator knows them; otherwise by what the map says. What the map
    says of a simulated robot may be of before it broke, or before it was mended."""
    return not faults if faults is not None else on_map


def state_of(*, on_map: bool, offers: bool, working: bool, busy: bool, booked: bool) -> DeviceState:
    """By whether it is on the map and has services on offer, whether it works, and what it does and is to do for tasks."""
    if not on_map and not offers:
        return DeviceState.DEPARTED
    if not working:
        return DeviceState.NOT_WORKING
    if not offers:
        return DeviceState.NOTHING_ON_OFFER
    if busy:
        return DeviceState.BUSY
    return DeviceState.BOOKED if booked else DeviceState.READY
