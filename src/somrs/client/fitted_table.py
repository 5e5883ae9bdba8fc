"""A table for the terminal that shows all of its content, however narrow the terminal is."""

from __future__ import annotations

from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Column, Table
from rich.text import Text

GAP = 3
"""Characters between two columns: a padding on both sides of the line between them."""


class FittedTable(Table):
    """A table whose columns fold between words until it fits. If it does not, each row is a block with a line for each cell.

    rich crops what does not fit: it takes no width from other columns for the `min_width` of one, and folds no column without wrapping.
    """

    def __init__(self, title: str) -> None:
        self._title = Text(title, "bold", overflow="fold")
        super().__init__(
            title=self._title if title else None,
            title_justify="left",
            header_style="bold",
            box=SIMPLE_HEAD,
            show_edge=False,
            padding=(0, 1),
        )
        self.min_width = cell_len(title)  # rich wraps a title at the width of its table, although the terminal has room

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        widths = self._fitting_widths(console, options)
        if widths is None:
            yield Group(self._title, *self._blocks())
            return
        for column, width in zip(self.columns, widths, strict=True):
            column.width = width
        yield from super().__rich_console__(console, options)

    def _fitting_widths(self, console: Console, options: ConsoleOptions) -> list[int] | None:
        """The widths of the columns: the widest become narrower until all fit; None if words would be cut."""
        measured = [_measure(column, console, options) for column in self.columns]
        widths = [width.maximum for width in measured]
        least = [width.maximum if column.no_wrap else width.minimum for column, width in zip(self.columns, measured, strict=True)]
        room = options.max_width - GAP * len(widths) + 1  # there is a padding at both ends, too
        if sum(least) > room:
            return None
        for _ in range(sum(widths) - room):
            widest = max((index for index, width in enumerate(widths) if width > least[index]), key=widths.__getitem__)
            widths[widest] -= 1
        return widths

    def _blocks(self) -> Iterator[RenderableType]:
        """The rows, cell below cell, each after the name of its column."""
        for row in zip(*(column.cells for column in self.columns), strict=True):
            yield Text("")
            for column, cell in zip(self.columns, row, strict=True):
                name = f"{column.header}: " if column.header else ""
                if isinstance(cell, Text):
                    yield Text.assemble((name, "bold"), Text("\n  ").join(cell.split("\n")), overflow="fold")
                else:
                    yield Group(Text(name, "bold"), Padding(cell, (0, 0, 0, 2)))


def _measure(column: Column, console: Console, options: ConsoleOptions) -> Measurement:
    measured = [Measurement.get(console, options, cell) for cell in (Text(str(column.header)), *column.cells)]
    return Measurement(max(cell.minimum for cell in measured), max(cell.maximum for cell in measured))
