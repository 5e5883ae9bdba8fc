"""Puts the pictures of a scenario on one sheet, with letters and captions (the paper's Figure "Moving a jar" scenario)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

WIDTH, CAPTION, GAP, COLUMNS = 600, 40, 8, 3
"""Width of a picture, height of its caption and gap between pictures, in pixels; and pictures per row."""

_INK, _PAPER = "#1c2733", "#ffffff"


def sheet(pictures: Sequence[Path], captions: Mapping[str, str], target: Path) -> None:
    """Write the sheet to `target`. The stem of a picture's file name is its letter. Needs the `simulator` extra."""
    from PIL import Image, ImageDraw, ImageFont

    images = [Image.open(picture).convert("RGB") for picture in pictures]
    height = round(WIDTH * images[0].height / images[0].width)
    columns = min(COLUMNS, len(images))
    rows = -(-len(images) // columns)
    size = columns * (WIDTH + GAP) + GAP, rows * (height + CAPTION + GAP) + GAP
    page = Image.new("RGB", size, _PAPER)
    draw = ImageDraw.Draw(page)
    font = ImageFont.load_default(size=18)
    for number, (picture, image) in enumerate(zip(pictures, images, strict=True)):
        x = GAP + number % columns * (WIDTH + GAP)
        y = GAP + number // columns * (height + CAPTION + GAP)
        page.paste(image.resize((WIDTH, height)), (x, y))
        draw.text((x + 4, y + height + 8), f"{picture.stem}   {captions.get(picture.stem, '')}", fill=_INK, font=font)
    page.save(target)
