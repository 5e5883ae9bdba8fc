"""The state of a device and its label, derived in one place for the API, the windows and the terminal."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from enum import StrEnum

from somrs.devices.simulator.link.commands import Fault


class DeviceState(StrEnum):
    """The state of a device."""

    READY = "ready"
    """It has services on offer and no work."""
    BUSY = "busy"
    """It executes, stops or compensates a step of a task."""
    BOOKED = "booked"
    """It has a contract for a step that has not begun."""
    NOT_WORKING = "not-working"
    """It has a fault, cannot be reached, or does not start, whether or not it has work."""
    STOPPED = "stopped"
    """An operator has stopped it."""
    OUT_OF_SERVICE = "out-of-service"
    """An operator has taken it out of service: it finishes its work, and gets no more."""
    NOTHING_ON_OFFER = "nothing-on-offer"
    """It is on the map, and has no service on offer."""
    DEPARTED = "gone"
    """It is not on the map, and its services left the Registry a short time ago."""


LABELS: Mapping[DeviceState, str] = {
    DeviceState.READY: "Ready",
    DeviceState.BUSY: "Busy",
    DeviceState.BOOKED: "Booked",
    DeviceState.NOT_WORKING: "Not working",
    DeviceState.STOPPED: "Stopped",
    DeviceState.OUT_OF_SERVICE: "Out of service",
    DeviceState.NOTHING_ON_OFFER: "Nothing on offer",
    DeviceState.DEPARTED: "Gone",
}
"""Texts for users."""

FAULT_LABELS: Mapping[Fault, str] = {
    Fault.DRIVE: "drive broken",
    Fault.GRIPPER: "gripper stuck",
    Fault.SILENT: "silent",
    Fault.LINK: "link cut",
}
"""Texts for users: why a simulated robot is not working."""


def is_working(on_map: bool, faults: Collection[Fault] | None) -> bool:
    """Whether a device works: according to its `faults` if the simulator reports them, and according to the map (`on_map`) otherwise.

    The simulator takes precedence, since the map may be older than the fault or its repair.
    """
    return not faults if faults is not None else on_map


def fault_text(faults: Collection[Fault] | None) -> str:
    """What is wrong with a simulated device, after its name: `has a fault: drive broken`; empty if nothing is."""
    return f"has a fault: {', '.join(FAULT_LABELS[fault] for fault in faults)}" if faults else ""


def state_of(
    *, on_map: bool, offers: bool, working: bool, busy: bool, booked: bool, paused: bool = False, in_service: bool = True
) -> DeviceState:
    """The state of a device. `busy`: it executes a step; `booked`: it has a contract for a step that has not begun."""
    if not on_map and not offers:
        return DeviceState.DEPARTED
    if not working:
        return DeviceState.NOT_WORKING
    if paused:
        return DeviceState.STOPPED
    if not offers:
        return DeviceState.NOTHING_ON_OFFER
    if busy:
        return DeviceState.BUSY
    if not in_service:
        return DeviceState.OUT_OF_SERVICE
    return DeviceState.BOOKED if booked else DeviceState.READY
