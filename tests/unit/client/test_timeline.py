"""The picture of who did what when can be read: nothing is cut off, and no line runs through words."""

from __future__ import annotations

import pytest
from lxml import etree

from somrs.client.timeline import LETTER, Bar, Mark, svg

SVG = "{http://www.w3.org/2000/svg}"


def bar(start: float, end: float, label: str = "Carton001") -> Bar:
    return Bar(device="Robot1", label=label, kind="does", start=start, end=end, ending="Completed")


@pytest.mark.parametrize("seconds", [0.1, 5.0, 8.0, 20.0])
def test_what_stands_beside_the_last_bar_is_within_the_picture(seconds: float) -> None:
    picture = etree.fromstring(svg([bar(0.0, 1.0), bar(100.0 - seconds, 100.0)], [], "Who did what").encode())
    named = [text for text in picture.iter(f"{SVG}text") if (text.text or "").endswith("Carton001")]
    assert len(named) == 2
    for text in named:
        assert float(text.get("x", "nan")) + LETTER * len(text.text or "") <= float(picture.get("width", "nan"))


def test_words_are_drawn_over_the_lines() -> None:
    marks = [Mark(at=time, subject="client", text="changes its mind") for time in (1.0, 2.0, 3.0)]
    drawn = list(etree.fromstring(svg([bar(0.0, 10.0)], marks, "Who did what").encode()))
    lines = [number for number, part in enumerate(drawn) if part.tag == f"{SVG}line"]
    words = [number for number, part in enumerate(drawn) if (part.text or "").endswith(("Carton001", "changes its mind"))]
    assert len(words) == 4
    assert min(words) > max(lines)
