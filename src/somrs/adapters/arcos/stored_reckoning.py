"""Where a robot is, in a file: its program may die while it drives."""

from __future__ import annotations

import logging
from pathlib import Path

import msgspec

from somrs.adapters.arcos.odometry import Reckoning

log = logging.getLogger(__name__)


def load_reckoning(path: Path) -> Reckoning | None:
    """What was stored last; None if nothing was, or if it cannot be read."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Reckoning)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.DecodeError) as error:
        log.warning("%s cannot be read, so that the robot begins where the map has it: %s", path, error)
        return None


def store_reckoning(path: Path, reckoning: Reckoning) -> None:
    """Replace the file, so that it is whole at any time. A failure is logged: the robot can do without it."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_bytes(msgspec.json.encode(reckoning))
        part.replace(path)
    except OSError as error:
        log.warning("%s cannot be written: %s", path, error)
