"""Finding objects: by a formula, whose bindings are marked on the plan and listed, or by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.errors import FormulaError, SomrsError
from somrs.gui.components.formula import FormulaField
from somrs.gui.components.rebuilt import RebuiltElement
from somrs.gui.components.table_head import table_head
from somrs.gui.examples import examples
from somrs.gui.pages.map.entries import list_note
from somrs.gui.pages.map.map_view import MapView
from somrs.gui.shell import guarded
from somrs.protocol.messages.knowledge import Row, Rows

_LIMIT = 200
_NAMES = 60


class SearchPanel:
    """`open_object` opens an object."""

    def __init__(self, api: LiveApi, map_view: MapView, open_object: Callable[[str], None]) -> None:
        self._api, self._map_view, self._open_object = api, map_view, open_object
        self._query = ""
        example = examples(api.context.map, api.context.ontology).query
        with ui.element("section").props('aria-label="Find by a formula"'):
            self._field = FormulaField("Query formula", placeholder=example, on_submit=self._submitted)
            with ui.element("div").classes("somrs-map-buttons"):
                ui.button("Find", icon="search", on_click=guarded(self._run_query)).props("unelevated dense no-caps")
                self._clear = ui.button("Clear", on_click=self.clear).props("flat dense no-caps")
            self._status_label = ui.label().classes("somrs-map-found-said").props('role="status"')
            self._problem = ui.label().classes("somrs-map-problem").props('role="alert"')
            self._rows = RebuiltElement().classes("somrs-map-rows")
        with ui.element("section").props('aria-label="Find by name"').classes("somrs-map-names"):
            self._name = ui.input("Or by name, type or label", on_change=guarded(self._list)).props(
                "outlined dense clearable debounce=150 autocomplete=off"
            )
            self._names = ui.element("ul").props('aria-label="Objects"')
        self._clear.visible = self._problem.visible = False

    async def begin(self) -> None:
        await self._list()

    async def _submitted(self, text: str) -> None:
        await guarded(self._run_query)()

    async def _run_query(self) -> None:
        """Run the query and show the result."""
        text = str(self._field.value or "").strip()
        if not text:
            self._field.focus()
            return
        self._problem.visible = False
        try:
            rows = await self._api.map.query(text, _LIMIT)
        except FormulaError as error:
            self._show_problem(str(error))
            return
        except SomrsError as error:
            self._show_problem(str(error))
            return
        self._query = text
        self._show_rows(rows)

    def _show_problem(self, text: str) -> None:
        self._problem.text, self._problem.visible = text, True
        self._status_label.text = ""
        self._rows.clear()
        self._map_view.highlight({})

    def clear(self) -> None:
        self._query = ""
        self._field.value = ""
        self._status_label.text = ""
        self._problem.visible = self._clear.visible = False
        self._rows.clear()
        self._map_view.highlight({})

    async def refresh(self) -> None:
        """Repeat the query after a change of the map."""
        if self._query and self._query == str(self._field.value or "").strip():
            try:
                self._show_rows(await self._api.map.query(self._query, _LIMIT))
            except SomrsError as error:
                self._show_problem(str(error))

    def _show_rows(self, result: Rows) -> None:
        rows = result.rows
        names = [*(rows[0].bindings if rows else {})]
        objects = self._api.context.map.objects
        marks: dict[str, list[str]] = {}
        for row in rows:
            for variable, value in row.bindings.items():
                if value in objects and f"?{variable}" not in marks.setdefault(value, []):
                    marks[value].append(f"?{variable}")
        if not names and rows:
            marks = {word: [] for word in self._query.replace("(", " ").replace(")", " ").replace(",", " ").split() if word in objects}
        self._map_view.highlight({name: " ".join(variables) for name, variables in marks.items()})
        self._clear.visible = True
        self._status_label.text = _status_text(result, bool(names))
        if names:
            self._rows.show((names, rows), lambda: self._build_table(names, rows))
        else:
            self._rows.clear()

    def _build_table(self, names: list[str], rows: Sequence[Row]) -> None:
        with ui.element("table").classes("somrs-map-table"):
            table_head(f"?{name}" for name in names)
            with ui.element("tbody"):
                for row in rows:
                    with ui.element("tr"):
                        for name in names:
                            with ui.element("td"):
                                self._cell(row.bindings.get(name, ""))

    def _cell(self, value: str) -> None:
        if value in self._api.context.map.objects:
            ui.button(value, on_click=lambda: self._open_object(value)).props("flat dense no-caps").classes("somrs-map-link")
        else:
            ui.label(value)

    async def _list(self) -> None:
        result = await self._api.formulas.things(typed=str(self._name.value or ""), limit=_NAMES)
        self._names.clear()
        with self._names:
            for thing in result.things:
                with (
                    ui.element("li"),
                    ui.button(thing.name, icon=thing.symbol, on_click=lambda thing=thing: self._open_object(thing.name)) as button,
                ):
                    button.props("flat dense no-caps align=left")
                    details = thing.type + (f", {thing.label}" if thing.label else "") + (f", {thing.location}" if thing.location else "")
                    ui.label(details).classes("somrs-soft")
            if result.is_truncated:
                list_note("There are more: type more of the name.")
            if not result.things:
                list_note("No matches.")


def _status_text(result: Rows, variables: bool) -> str:
    if not variables:
        return "True." if result.rows else "False."
    count = len(result.rows)
    if not count:
        return "No results."
    return f"{'The first ' if result.more else ''}{count} {'result' if count == 1 else 'results'}"
