"""What a demonstration leaves: the files in its folder, and the tables at its end."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from rich.console import Console

from somrs.client import terminal
from somrs.client.message_chart import chart
from somrs.client.timeline import Bar, Mark, svg
from somrs.client.trace import Line, trace_file
from somrs.demo.picture_sheet import sheet
from somrs.ontology.files.site import dump_site
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology


class Results:
    """The results of one demonstration. `title`: of its drawings; `captions`: of its pictures, by the letters that are their names."""

    def __init__(self, folder: Path, console: Console, title: str, captions: Mapping[str, str]) -> None:
        self._folder, self._console, self._title, self._captions = folder, console, title, captions

    def write_map(self, ontology: Ontology, map: Map, name: str = "map") -> None:
        """Write a map as it is at the end."""
        (self._folder / f"{name}-after.yaml").write_text(dump_site(ontology, map), encoding="utf-8")

    def write_messages(self, data: Path, lines: Sequence[Line]) -> None:
        """Write all messages of a system with this data folder, and a chart of these of them."""
        shutil.copy(trace_file(data), self._folder)
        self.write_chart(lines)

    def write_chart(self, lines: Sequence[Line]) -> None:
        """Draw messages."""
        (self._folder / "messages.svg").write_text(chart(lines, self._title), encoding="utf-8")

    def write_timeline(self, bars: Sequence[Bar], marks: Sequence[Mark] = ()) -> None:
        """Draw who did what when."""
        (self._folder / "timeline.svg").write_text(svg(bars, marks, self._title), encoding="utf-8")

    def write_sheet(self) -> list[Path]:
        """Put the pictures that were taken on one sheet. Returns their files."""
        pictures = [file for letter in sorted(self._captions) if (file := self._folder / f"{letter}.png").exists()]
        if pictures:
            sheet(pictures, self._captions, self._folder / "pictures.png")
        return pictures

    def show_pictures(self, pictures: Iterable[Path]) -> None:
        """List pictures with their captions."""
        if rows := [(picture.name, self._captions[picture.stem]) for picture in pictures]:
            self._console.print(terminal.table("Pictures", ("file", "content"), rows))

    def show_checks(self, checks: Mapping[str, bool]) -> None:
        """List what was checked, and whether it is so."""
        rows = ((check, "yes" if passed else "NO") for check, passed in checks.items())
        self._console.print(terminal.table("Checks", ("", ""), rows))

    def conclude(self, checks: Mapping[str, bool], started: float) -> int:
        """List the checks, and say where the files are. `started`: when, by the monotonic clock. Returns the exit code: 0 if all passed."""
        self.show_checks(checks)
        self._console.print(f"It took {time.monotonic() - started:.0f} s. All files are in {self._folder}/")
        return 0 if all(checks.values()) else 1


def without_progress(lines: Iterable[Line]) -> list[Line]:
    """The messages that change something."""
    return [line for line in lines if line.type != "Progress"]


def are_all_released(lines: Sequence[Line]) -> bool:
    """Whether each participant with a contract was released."""
    accepted = {(line.transaction, line.participant) for line in lines if line.type == "Accept"}
    return accepted <= {(line.transaction, line.participant) for line in lines if line.type in ("End", "Cancel")}
