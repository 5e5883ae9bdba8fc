"""Reads an occupancy map as ROS writes it: a YAML file, and the image that it names.

The format, with the modes `trinary`, `scale` and `raw`, is that of `map_server` (http://wiki.ros.org/map_server, "Map format") and of
`nav2_map_server` (`map_io.cpp`). Black is occupied and white is free, unless `negate` says otherwise; the first row of the image is that
with the largest y.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import yaml
from PIL import Image

from somrs.errors import InputError
from somrs.sites.occupancy.description import MapDescription
from somrs.sites.occupancy.grid import Cell, OccupancyGrid, States

MOST_CELLS = 64_000_000
"""The largest image that is read, in pixels: 400 m × 400 m with cells of 5 cm."""


def read_grid(path: Path) -> OccupancyGrid:
    """The grid of an occupancy map. Raises InputError."""
    try:
        data = yaml.safe_load(path.read_text("utf-8-sig"))
        description = msgspec.convert(_plain(data), MapDescription, strict=False)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{path} cannot be read ({error}); give the path of a map.yaml that map_saver has written") from error
    except msgspec.ValidationError as error:
        raise InputError(f"{path} is no description of an occupancy map: {error}; correct it, or save the map anew") from error
    if not all(map(math.isfinite, (description.resolution, *description.origin))):
        raise InputError(f"{path}: resolution and origin have to be finite numbers; correct them")
    if description.free_thresh > description.occupied_thresh:
        raise InputError(f"{path}: free_thresh is above occupied_thresh, so that cells would be both; exchange them")
    image = path.parent / description.image
    x, y, yaw = (*description.origin, 0.0)[:3]
    states = np.flipud(states_of(_pixels(image), description))
    return OccupancyGrid(states=np.ascontiguousarray(states), resolution=description.resolution, x=x, y=y, yaw=yaw)


def _plain(data: Any) -> Any:
    """The description with the keys as lower case, and `negate: 1` as a truth value."""
    if not isinstance(data, dict):
        return data
    plain = {str(key).lower(): value for key, value in data.items() if value is not None}
    if plain.get("negate") in (0, 1):
        plain["negate"] = bool(plain["negate"])
    if isinstance(plain.get("mode"), str):
        plain["mode"] = plain["mode"].lower()
    return plain


def _pixels(image: Path) -> np.ndarray[Any, Any]:
    """The image as rows × columns × channels, from 0 to 255: one channel, and that of its opacity. Raises InputError."""
    try:
        with Image.open(image) as picture:
            if picture.width * picture.height > MOST_CELLS:
                raise InputError(f"{image} has {picture.width} × {picture.height} pixels; cut it into maps of at most {MOST_CELLS} pixels")
            channels = np.asarray(picture.convert("RGBA"), dtype=float)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(f"{image} cannot be read as an image ({error}); map.yaml has to name a PGM or PNG beside it") from error
    return np.dstack([channels[..., :3].mean(axis=2), channels[..., 3]])


UNKNOWN_GREY = 205
"""The grey of unknown cells that map savers write in the mode `trinary`, whatever thresholds they write beside it."""


def states_of(pixels: np.ndarray[Any, Any], description: MapDescription) -> States:
    """The states of cells, in the order of the pixels (rows × columns × 2: shade and opacity, from 0 to 255)."""
    shade, opacity = pixels[..., 0], pixels[..., 1]
    if description.mode == "raw":  # the value of a pixel is its occupancy in percent; above 100, it is unknown
        occupancy = np.where(shade <= 100, shade / 100, math.nan)
    else:
        occupancy = (shade if description.negate else 255 - shade) / 255
        if description.mode == "scale":
            occupancy = np.where(opacity < 255, math.nan, occupancy)
    states = np.full(shade.shape, Cell.UNKNOWN, dtype=np.int8)
    states[occupancy > description.occupied_thresh] = Cell.OCCUPIED
    states[occupancy < description.free_thresh] = Cell.FREE
    if description.mode == "trinary" and not description.negate:
        states[shade == UNKNOWN_GREY] = Cell.UNKNOWN
    return states
