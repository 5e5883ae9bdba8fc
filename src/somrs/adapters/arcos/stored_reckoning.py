"""Where a robot is, and whether its motors may be switched on, in a file: its program may die while it drives."""

from __future__ import annotations

import logging
from pathlib import Path

import msgspec
from msgspec import Struct

from somrs.adapters.arcos.motors import MotorsOff
from somrs.adapters.arcos.odometry import Pose, Reckoning
from somrs.atomic_files import write_atomically

log = logging.getLogger(__name__)


class Stored(Struct, frozen=True, kw_only=True):
    """`on_map`: the pose that the map had, as far as the program knew: if it still has that, nobody has put the robot elsewhere since.
    `motors_off`: why its motors stay off until a person switches them on; None: they do not."""

    reckoning: Reckoning
    on_map: Pose
    motors_off: MotorsOff | None = None


def load_reckoning(path: Path) -> Stored | None:
    """What was stored last; None if nothing was, or if it cannot be read."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Stored)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.DecodeError) as error:
        log.warning("%s cannot be read, so that the robot begins where the map has it: %s", path, error)
        return None


def store_reckoning(path: Path, stored: Stored) -> None:
    """Store it in place of what was stored before. A failure is logged: the robot can do without it."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, msgspec.json.encode(stored))
    except OSError as error:
        log.warning("%s cannot be written: %s", path, error)
