"""The picture of who did what when can be read: nothing is cut off, and no line runs through words."""

from __future__ import annotations

import io

import pytest
from lxml import etree
from msgspec import structs
from rich.console import Console

from somrs.client.timeline import LETTER, Bar, Mark, bars, svg, timeline_table
from somrs.client.trace import Line

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


def message(sender: str, type: str, recipient: str, at: float, participant: str, **body: object) -> Line:
    return Line(
        at=at,
        sender=sender,
        recipient=recipient,
        type=type,
        transaction="task-1",
        participant=participant,
        message_id=f"{sender} {type}",
        relates_to=None,
        body=body,
    )


def test_bars_are_labelled_by_what_the_work_is_about() -> None:
    def work(service: str, **inputs: str) -> list[Line]:
        return [
            message("TaskManager", "Execute", service, 1.0, service, inputs=inputs),
            message(service, "Completed", "TaskManager", 2.0, service, situation="Door001.Open = TRUE"),
        ]

    opening, sealing, charging = work("Robot1.OpenDoor", Door="Door001"), work("Anna.SealJar", Jar="Jar004"), work("Robot1.ChargeBattery")
    assert [bar.label for bar in bars(opening)] == ["Door001"]
    assert [bar.label for bar in bars(charging)] == ["ChargeBattery"]
    assert [bar.label for bar in bars([*opening, *sealing, *charging])] == ["OpenDoor Door001", "SealJar Jar004", "ChargeBattery"]


def test_two_tasks_of_one_device_have_a_bar_each() -> None:
    def work(task: str, began: float) -> list[Line]:
        lines = [
            message("TaskManager", "Execute", "Robot1.TransferObject", began, "Robot1.TransferObject#step1", inputs={"Object": task}),
            message("Robot1.TransferObject", "Completed", "TaskManager", began + 1, "Robot1.TransferObject#step1"),
        ]
        return [structs.replace(line, transaction=task) for line in lines]

    shown = bars([*work("Jar1", 1.0), *work("Jar2", 5.0)])
    assert [(bar.label, bar.start, bar.end) for bar in shown] == [("Jar1", 1.0, 2.0), ("Jar2", 5.0, 6.0)]


@pytest.mark.parametrize("width", [60, 80, 100, 160])
def test_the_whole_timeline_fits_the_terminal(width: int) -> None:
    console = Console(width=width, file=io.StringIO(), record=True)
    shown_bars = [bar(0.0, 50.0), bar(99.0, 100.0, "a carton that has a long name, by which nobody calls it")]
    console.print(timeline_table(shown_bars, [Mark(at=100.0, subject="client", text="changes its mind")], console.width))
    text = console.export_text()
    assert text.count("█ ✔") == 2
    assert text.count("◆") == 1
    assert "100.0 s" in text
    assert "does: Carton001" in text
    assert text.count("…") == 1
