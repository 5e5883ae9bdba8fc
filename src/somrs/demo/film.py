"""A film of a scenario: pictures of the storeys, one above the other, with what happens written below them, as an animated WebP file."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL import Image

WIDTH = 720
"""Width of pictures for a film, pixels."""
View = tuple[float, float, float, float]
BUILDING: View = (0.0, 0.23, 1.0, 0.77)
"""The part of a picture that shows the building: left, top, right and bottom, as shares of its width and height."""
ROW, MARGIN, STATE_COLUMN = 20, 12, 210
"""Height of a line of text, distance of texts from the edge, and where the states begin, pixels."""
FRAME_TIME, CAPTION_TIME, LAST_TIME = 60, 1500, 3000
"""How long a frame is shown, the first one with another caption, and the last one, milliseconds."""
QUALITY = 60
"""Quality of the compression, of 100."""

_INK, _ALERT, _FAINT, _PAPER = "#1c2733", "#b3261e", "#52616f", "#ffffff"


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A frame. `pictures`: PNGs of the storeys by their names, the highest first; `caption`: what has just happened; `rows`: the
    tasks and the state of each, or other pairs of texts, the same number in all frames; `view`: the part of the pictures that is shown."""

    pictures: dict[str, bytes]
    caption: str
    rows: tuple[tuple[str, str], ...]
    view: View = BUILDING


@dataclass(slots=True)
class Film:
    """The frames so far. Needs the `simulator` extra."""

    _last_frame: Frame | None = None
    _images: list[Image.Image] = field(default_factory=list)
    _times: list[int] = field(default_factory=list)

    def add(self, frame: Frame) -> None:
        """Add a frame, unless it is like the last one."""
        if frame == self._last_frame:
            return
        is_new_caption = self._last_frame is None or frame.caption != self._last_frame.caption
        self._images.append(draw(frame))
        self._times.append(CAPTION_TIME if is_new_caption else FRAME_TIME)
        self._last_frame = frame

    def save(self, target: Path) -> bool:
        """Write the film, which repeats for ever. Returns False if it has no frames."""
        if not self._images:
            return False
        times = [*self._times[:-1], LAST_TIME]
        self._images[0].save(target, save_all=True, append_images=self._images[1:], duration=times, loop=0, quality=QUALITY, method=4)
        return True


def draw(frame: Frame) -> Image.Image:
    """The frame as an image."""
    from PIL import Image, ImageDraw, ImageFont

    storeys = [_part(png, frame.view) for png in frame.pictures.values()]
    width, height = max(storey.width for storey in storeys), sum(storey.height for storey in storeys)
    image = Image.new("RGB", (width, height + (len(frame.rows) + 1) * ROW + 2 * MARGIN), _PAPER)
    ink, font, bold = ImageDraw.Draw(image), ImageFont.load_default(size=13), ImageFont.load_default(size=15)
    y = 0
    for name, storey in zip(frame.pictures, storeys, strict=True):
        image.paste(storey, (0, y))
        ink.text((MARGIN, y + MARGIN), name, fill=_INK, font=bold)
        y += storey.height
    ink.text((MARGIN, y + MARGIN - 4), frame.caption, fill=_ALERT, font=bold)
    for number, (task, state) in enumerate(frame.rows, start=1):
        ink.text((MARGIN, y + MARGIN + number * ROW), task, fill=_INK, font=font)
        ink.text((STATE_COLUMN, y + MARGIN + number * ROW), state, fill=_FAINT, font=font)
    return image


def _part(png: bytes, view: View) -> Image.Image:
    """The part of a picture that is shown."""
    from PIL import Image

    picture = Image.open(io.BytesIO(png)).convert("RGB")
    left, top, right, bottom = view
    return picture.crop(
        (round(left * picture.width), round(top * picture.height), round(right * picture.width), round(bottom * picture.height))
    )
