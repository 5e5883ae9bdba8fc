"""Wishes put together by choosing: line by line, a thing and what is to be so of it."""

from __future__ import annotations

import re
from collections.abc import Callable

from msgspec import structs
from nicegui import background_tasks, ui

from somrs.api.choices import Sayable, SayableAttribute
from somrs.errors import SomrsError
from somrs.gui.components.fields.picker import Choice, Picker, things
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.define.lines import ORDERS, Line, lines_of, same, text_of
from somrs.ontology.types import ABSTRACT, Kind

GROUPS = ("Services can bring it about", "Other relations", "Attributes")
ORDER_WORDS = {"=": "is", "!=": "is not", "<": "is less than", "<=": "is at most", ">": "is more than", ">=": "is at least"}

FIXED = ("BuildingElement", ABSTRACT)
"""What nobody means who points at the plan to say which thing is to be brought somewhere."""


class Builder:
    """The lines of the wish, as far as it is of that form; where it is not, that is said, and nothing is changed."""

    def __init__(self, form: Form) -> None:
        self._form = form
        self._rows: list[_Row] = []
        self._other = ui.element("div").classes("somrs-define-other").props('role="note"')
        with self._other:
            ui.icon("info").props('aria-hidden="true"')
            ui.label("This formula says more than lines can show, such as OR, or variables. Change it above; what you drag is added to it.")
        self._list = ui.element("div").classes("somrs-define-lines").props('role="group" aria-label="Lines of the wish"')
        self._more = ui.button("And also", icon="add", on_click=self._add).props("flat dense no-caps").classes("somrs-define-more")
        self._show()
        form.on_change(self._show)

    @property
    def lines(self) -> list[Line]:
        return [row.line for row in self._rows]

    def _show(self) -> None:
        text = self._form.draft.effect
        found = lines_of(text, self._form.desk.context.ontology) if text.strip() else []
        # While a formula is being typed it is none for moments; the lines wait for what it becomes.
        shown = found is not None or not self._rows
        self._other.visible = found is None and not _begun(text)
        self._list.visible = self._more.visible = not self._other.visible
        if shown and not same(text_of(self.lines), text.strip()):
            self._rebuild(found or [])
        if not self._rows and not self._other.visible:
            self._rebuild([])

    def _rebuild(self, lines: list[Line]) -> None:
        self._list.clear()
        self._rows = []
        for line in lines or [Line()]:
            self._put(line)

    def _put(self, line: Line) -> _Row:
        with self._list:
            row = _Row(self._form, line, self._changed, self._remove, first=not self._rows)
        self._rows.append(row)
        return row

    async def point(self, name: str) -> None:
        """Somebody pointed at a thing: it fills the first field of a line that waits for one."""
        for row in self._rows:
            if await row.fill(name):
                return

    def _add(self) -> None:
        self._put(Line()).focus()

    def _remove(self, row: _Row) -> None:
        self._rows.remove(row)
        lines = self.lines
        self._rebuild(lines)
        self._changed()

    def _changed(self) -> None:
        text = text_of(self.lines)
        if not same(text, self._form.draft.effect.strip()):
            self._form.draft.effect = text
            self._form.changed()


def _begun(text: str) -> bool:
    """Whether it may become lines yet."""
    return not re.search(r"\bOR\b|[?(+*]| - ", text)


class _Row:
    """One line, and the fields in which it is chosen."""

    def __init__(self, form: Form, line: Line, changed: Callable[[], None], remove: Callable[[_Row], None], *, first: bool) -> None:
        self._form, self.line, self._changed = form, line, changed
        self._known: Sayable | None = None
        with ui.element("div").classes("somrs-define-line") as self.element:
            ui.label("" if first else "and").classes("somrs-define-and").props('aria-hidden="true"')
            self._thing = Picker("Thing", value=line.thing, placeholder="Which thing", source=things(), on_pick=self._pick_thing)
            self._said = Picker("What of it", value=_said(line), placeholder="What of it", options=[], on_pick=self._pick_said)
            self._rest = ui.element("div").classes("somrs-define-rest")
            with ui.element("div").classes("somrs-define-line-ways"):
                self._not = ui.button("not", on_click=self._deny).props('flat dense no-caps size=sm aria-label="Not so"')
                self._not.classes("somrs-define-not").tooltip("It is not to be so")
                away = ui.button(icon="close", on_click=lambda: remove(self)).props("flat dense round size=sm")
                away.props('aria-label="Remove this line"')
        self._show_denied()
        self._fill()
        if line.thing:
            background_tasks.create(self._learn(), context=self.element)

    def focus(self) -> None:
        self._thing.focus()

    async def fill(self, name: str) -> bool:
        """Take a thing that was pointed at, if one is missing here that it can be."""
        context = self._form.desk.context
        object = context.map.objects.get(name)
        if object is None or (self.line.thing and (not self.line.relation or self.line.other)):
            return False
        if self.line.thing:
            fits = context.ontology.is_subtype(object.type, context.ontology.relations[self.line.relation].joins[1])
            if fits and name != self.line.thing:
                self._pick_other(name)
                self._fill()
            return True
        if any(context.ontology.is_subtype(object.type, fixed) for fixed in FIXED):
            return False
        self._thing.choose(name)
        await self._pick_thing(name)
        return True

    # What was chosen

    async def _pick_thing(self, name: str) -> None:
        self.line = structs.replace(self.line, thing=name)
        await self._learn()
        self._changed()

    async def _learn(self) -> None:
        """What can be said of the thing; of what was said, what cannot is left out."""
        try:
            known = await self._form.desk.formulas.sayable(self.line.thing)
        except SomrsError as error:
            self._thing.blame(str(error))
            return
        self._thing.blame("")
        self._known = known
        relations = [
            Choice(value=one.name, text=_words(one.name), detail=one.doc, symbol="link", group=GROUPS[0 if one.achievable else 1])
            for one in known.relations
        ]
        attributes = [
            Choice(value=f".{one.path}", text=one.path, detail=_now(one), symbol="tune", group=GROUPS[2]) for one in known.attributes
        ]
        self._said.offer(options=[*relations, *attributes])
        if not self.line.relation and not self.line.path and relations:
            self._choose(relations[0]["value"])
        elif (self.line.relation or f".{self.line.path}") not in {one["value"] for one in (*relations, *attributes)}:
            self._choose("")
        elif self.line.path:
            self._fill()

    def _pick_said(self, said: str) -> None:
        self._choose(said)
        self._changed()

    def _choose(self, said: str) -> None:
        thing, denied = self.line.thing, self.line.denied
        if said.startswith("."):
            attribute = self._attribute(said[1:])
            kind = attribute.kind if attribute is not None else Kind.TEXT
            unit = attribute.units[0] if attribute is not None and attribute.units else ""
            self.line = Line(thing=thing, path=said[1:], kind=kind, unit=unit, denied=denied)
        else:
            self.line = Line(thing=thing, relation=said, other=self.line.other if said else "", denied=denied)
        self._said.choose(said)
        self._fill()

    def _attribute(self, path: str) -> SayableAttribute | None:
        return next((one for one in self._known.attributes if one.path == path), None) if self._known is not None else None

    def _fill(self) -> None:
        """The fields for the rest of the line: another thing, or a value."""
        self._rest.clear()
        with self._rest:
            if self.line.path:
                self._fill_value()
            elif self.line.relation:
                source = things(relation=self.line.relation, place=1)
                Picker("Of which", value=self.line.other, placeholder="Which one", source=source, on_pick=self._pick_other)

    def _fill_value(self) -> None:
        attribute, line = self._attribute(self.line.path), self.line
        orders = ORDERS if line.kind is Kind.NUMBER else ORDERS[:2]
        choices = [Choice(value=order, text=ORDER_WORDS[order], detail=order) for order in orders]
        Picker("How it compares", value=line.order, options=choices, on_pick=self._pick_order).classes("somrs-define-order")
        match line.kind:
            case Kind.ENUMERATION | Kind.TRUTH:
                values = (attribute.values if attribute is not None else ()) or ("TRUE", "FALSE")
                options = [Choice(value=value) for value in values]
                Picker("Value", value=line.value, placeholder="Value", options=options, on_pick=self._pick_value)
            case _:
                field = ui.input(value=line.value, placeholder="Value", on_change=lambda event: self._pick_value(event.value or ""))
                field.props('outlined dense aria-label="Value"').classes("somrs-define-value")
                if attribute is not None and attribute.units:
                    units = [Choice(value=unit) for unit in attribute.units]
                    Picker("Unit", value=line.unit, options=units, on_pick=self._pick_unit).classes("somrs-define-unit")

    def _pick_other(self, name: str) -> None:
        self.line = structs.replace(self.line, other=name)
        self._changed()

    def _pick_order(self, order: str) -> None:
        self.line = structs.replace(self.line, order=order)
        self._changed()

    def _pick_value(self, value: str) -> None:
        self.line = structs.replace(self.line, value=value.replace(",", ".") if self.line.kind is Kind.NUMBER else value)
        self._changed()

    def _pick_unit(self, unit: str) -> None:
        self.line = structs.replace(self.line, unit=unit)
        self._changed()

    def _deny(self) -> None:
        self.line = structs.replace(self.line, denied=not self.line.denied)
        self._show_denied()
        self._changed()

    def _show_denied(self) -> None:
        self._not.props(f'aria-pressed="{str(self.line.denied).lower()}"')
        self._not.classes(**({"add": "somrs-define-denied"} if self.line.denied else {"remove": "somrs-define-denied"}))


def _said(line: Line) -> str:
    return line.relation or (f".{line.path}" if line.path else "")


def _words(name: str) -> str:
    """`isHeldBy`: is held by."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name).lower()


def _now(attribute: SayableAttribute) -> str:
    if attribute.now is None:
        return attribute.doc
    now = {True: "TRUE", False: "FALSE"}[attribute.now] if isinstance(attribute.now, bool) else attribute.now
    shown = f"{now:.6g}" if isinstance(now, float) else str(now)
    return f"now {shown} {attribute.units[0]}" if attribute.units else f"now {shown}"
