"""Films of scenarios: what is seen when they are played."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

from PIL import Image, ImageSequence

from somrs.demo.film import CAPTION_TIME, FRAME_TIME, LAST_TIME, WIDTH, Film, Frame, draw


def png(colour: str) -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (WIDTH, WIDTH * 3 // 4), colour).save(buffer, format="PNG")
    return buffer.getvalue()


def frame(upper: str, lower: str, caption: str = "a robot drives") -> Frame:
    return Frame(pictures={"upper floor": png(upper), "ground floor": png(lower)}, caption=caption, rows=(("Jar1 isOn Table1", "waits"),))


def middle(image: Image.Image, part: float) -> tuple[int, ...]:
    """The colour in the middle of a row of the image, at this part of its height."""
    colour = image.convert("RGB").getpixel((image.width // 2, round(part * image.height)))
    assert isinstance(colour, tuple)
    return colour


def test_a_frame_has_the_storeys_one_above_the_other_and_text_below() -> None:
    image = draw(frame("red", "blue"))
    assert middle(image, 0.2)[0] > 200
    assert middle(image, 0.6)[2] > 200
    texts = image.crop((0, image.height - 60, image.width, image.height)).convert("L").getextrema()
    assert texts == (texts[0], 255)
    assert isinstance(texts[0], int | float)
    assert texts[0] < 100, "there is ink on paper"


def test_a_frame_shows_the_part_of_a_picture_that_is_to_be_seen() -> None:
    picture = Image.new("RGB", (400, 300), "red")
    picture.paste("blue", (200, 0, 400, 300))
    buffer = io.BytesIO()
    picture.save(buffer, format="PNG")
    image = draw(Frame(pictures={"": buffer.getvalue()}, caption="", rows=(("Failed", "from Robot1"),), view=(0.5, 0.0, 1.0, 0.5)))
    assert image.width == 200
    red, _, blue = middle(image, 0.2)
    assert blue > red


def test_a_film_has_each_frame_once_and_shows_new_captions_longer(tmp_path: Path) -> None:
    film = Film()
    for picture in (
        frame("red", "blue"),
        frame("red", "blue"),
        frame("green", "blue"),
        frame("green", "blue", "a lift breaks"),
        frame("red", "red"),
    ):
        film.add(picture)
    film.add(replace(frame("blue", "red"), caption="a robot drives"))
    assert film.save(tmp_path / "film.webp")
    times = []
    with Image.open(tmp_path / "film.webp") as image:
        for shown in ImageSequence.Iterator(image):
            shown.load()
            times.append(shown.info["duration"])
    assert times == [CAPTION_TIME, FRAME_TIME, CAPTION_TIME, CAPTION_TIME, LAST_TIME]


def test_a_film_without_frames_is_not_written(tmp_path: Path) -> None:
    assert not Film().save(tmp_path / "film.webp")
    assert not [*tmp_path.iterdir()]
