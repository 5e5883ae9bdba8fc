"""Tables in a terminal."""

from __future__ import annotations

import io

from rich.console import Console

from somrs.client import terminal


def test_a_title_is_in_one_line_where_the_terminal_has_room() -> None:
    goal = "Valve1.Pressure = ?p AND Skylight1.Shut = TRUE"
    table = terminal.table(goal, ["?p"], [["3 bar"]])
    for width, is_whole in ((80, True), (30, False)):
        console = Console(width=width, file=io.StringIO(), record=True)
        console.print(table)
        assert (goal in console.export_text()) is is_whole
