"""A list of rows, updated in place, so that the focus stays."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from somrs.gui.icons import Badge, Gauge
from somrs.gui.pages.start.rows import Row


class RowList:
    """At most `limit` rows; a link to `more` says how many others there are."""

    def __init__(self, label: str, limit: int, more: str) -> None:
        self._limit = limit
        self._rows: dict[str, _RowElement] = {}
        self._list = ui.element("ul").classes("somrs-start-rows").props(f'aria-label="{label}"')
        self._more = ui.link("", more).classes("somrs-start-more")
        self.show([])

    @property
    def is_empty(self) -> bool:
        return not self._rows

    def show(self, rows: Sequence[Row]) -> None:
        shown_rows = {row.key: row for row in rows[: self._limit]}
        for key in [key for key in self._rows if key not in shown_rows]:
            self._rows.pop(key).element.delete()
        with self._list:
            for index, (key, row) in enumerate(shown_rows.items()):
                if key not in self._rows:
                    self._rows[key] = _RowElement()
                    if index != len(self._rows) - 1:
                        self._rows[key].element.move(target_index=index)
                self._rows[key].show(row)
        self._list.visible = bool(shown_rows)
        rest = max(0, len(rows) - self._limit)
        self._more.text = f"{rest} more"
        self._more.visible = rest > 0


class _RowElement:
    def __init__(self) -> None:
        self._row: Row | None = None
        self._badge: Badge | None = None
        self._gauge: Gauge | None = None
        self.element = ui.element("li").classes("somrs-start-row")

    def show(self, row: Row) -> None:
        if row == self._row:
            return
        if self._badge is None or self._row is None or self._row.target != row.target:
            self._fill(row)
        assert self._badge is not None
        assert self._gauge is not None
        self._row = row
        self._badge.show_sign(row.sign)
        self._text.set_text(row.text)
        self._note.set_text(row.note)
        self._note.visible = bool(row.note)
        share, share_text = row.progress or (0.0, "")
        self._gauge.element.visible = row.progress is not None
        self._gauge.show_share(share, share_text, "busy")

    def _fill(self, row: Row) -> None:
        self.element.clear()
        with self.element:
            self._badge = Badge(row.sign)
            with ui.element("div").classes("somrs-start-text"):
                self._text = ui.link(row.text, row.target) if row.target else ui.label(row.text)
                self._text.classes("somrs-formula" if row.is_formula else "")
                self._note = ui.label().classes("somrs-soft")
            self._gauge = Gauge("Progress", "Steps of the plan that are done")
