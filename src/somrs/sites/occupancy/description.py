"""The YAML file of an occupancy map (`reading.py` reads the image that it names, for which it loads numpy)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import yaml
from msgspec import Meta, Struct

_LONGEST = 64 * 1024
"""A longer YAML file describes no occupancy map, bytes."""


class MapDescription(Struct, frozen=True, kw_only=True):
    """The YAML file of an occupancy map; fields that it does not have here are ignored.

    `resolution`: metres per pixel. `origin`: x, y (m) and yaw (rad) of the image's lower left corner. Occupancy above `occupied_thresh` is
    occupied, and below `free_thresh` free; both are from 0 to 1.
    """

    image: str
    resolution: Annotated[float, Meta(gt=0)]
    origin: Annotated[tuple[float, ...], Meta(min_length=2, max_length=3)] = (0.0, 0.0, 0.0)
    negate: bool = False
    occupied_thresh: Annotated[float, Meta(ge=0, le=1)] = 0.65
    free_thresh: Annotated[float, Meta(ge=0, le=1)] = 0.196
    mode: Literal["trinary", "scale", "raw"] = "trinary"


def is_occupancy_map(path: Path) -> bool:
    """Whether the file describes an occupancy map: YAML with an `image` and its `resolution`."""
    try:
        with path.open("rb") as file:
            text = file.read(_LONGEST + 1)
        data = yaml.load(text, yaml.CSafeLoader) if len(text) <= _LONGEST else None
    except (OSError, yaml.YAMLError, ValueError):
        return False
    return isinstance(data, dict) and "image" in data and "resolution" in data
