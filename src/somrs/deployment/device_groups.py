"""Which devices share a process."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from somrs.deployment.devices_of_map import is_own_driver

LEAST_PROCESSES = 4
"""The number of devices up to which each has a process of its own, also on a machine with fewer cores."""


@dataclass(frozen=True, slots=True)
class DeviceGroup:
    """The devices of a process: the drivers by the devices' names."""

    name: str
    drivers: Mapping[str, str]


def group_devices(driven: Sequence[tuple[str, str]], per_process: int | None = None) -> list[DeviceGroup]:
    """Divide devices, given as pairs of name and driver, among processes: `per_process` in each.

    By default, the devices with drivers of SO-MRS share as many processes as the machine has cores, but at least `LEAST_PROCESSES`. Other
    drivers may block their process, so that their devices have one each.
    """
    if per_process is not None:
        return _named(_split(driven, math.ceil(len(driven) / per_process)))
    shared = [device for device in driven if is_own_driver(device[1])]
    separate_devices = [device for device in driven if not is_own_driver(device[1])]
    process_count = min(len(shared), max(os.cpu_count() or 1, LEAST_PROCESSES))
    return _named([*_split(shared, process_count), *([device] for device in separate_devices)])


def _split(devices: Sequence[tuple[str, str]], process_count: int) -> list[Sequence[tuple[str, str]]]:
    """Split the devices into parts that differ by at most one device. A device more moves few others to another process."""
    bounds = [len(devices) * number // process_count for number in range(process_count + 1)] if process_count else [0]
    return [devices[start:end] for start, end in itertools.pairwise(bounds)]


def _named(parts: Sequence[Sequence[tuple[str, str]]]) -> list[DeviceGroup]:
    """Name each process after its device, or number it if it has several."""
    groups: list[DeviceGroup] = []
    for number, part in enumerate(parts, 1):
        name = part[0][0] if len(part) == 1 else f"devices-{number}"
        groups.append(DeviceGroup(name, dict(part)))
    return groups
