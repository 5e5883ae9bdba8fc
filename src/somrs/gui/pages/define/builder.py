"""An editor for goals, line by line: each line states a relation or an attribute value of a thing."""

from __future__ import annotations

import re
from collections.abc import Callable

from msgspec import structs
from nicegui import background_tasks, ui
from nicegui.events import ValueChangeEventArguments

from somrs.api.choices import Sayable, SayableAttribute
from somrs.errors import SomrsError
from somrs.gui.components.fields.picker import Choice, Picker, things
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.define.goal_lines import ORDERS, Line, is_same_formula, lines_of, text_of
from somrs.ontology.types import ABSTRACT, Kind

_GROUPS = ("Achievable by services", "Other relations", "Attributes")
_ORDER_WORDS = {"=": "is", "!=": "is not", "<": "is less than", "<=": "is at most", ">": "is more than", ">=": "is at least"}

FIXED = ("BuildingElement", ABSTRACT)
"""Types that a click on the plan does not take as the thing to move."""


class Builder:
    """The lines of the goal. If the formula cannot be written as lines, a note says so and the formula stays unchanged."""

    def __init__(self, form: Form) -> None:
        self._form = form
        self._rows: list[_Row] = []
        self._complex_note = ui.element("div").classes("somrs-define-other").props('role="note"')
        with self._complex_note:
            ui.icon("info").props('aria-hidden="true"')
            ui.label(
                "This formula cannot be shown as lines, e.g. because of OR, FORALL or variables. Edit it above; dragged things are added."
            )
        self._list = ui.element("div").classes("somrs-define-lines").props('role="group" aria-label="Lines of the goal"')
        self._negation_note = ui.label("All lines together are the goal. A line that “must not hold” is a condition to make false.")
        self._negation_note.classes("somrs-soft somrs-define-negation")
        self._add_button = ui.button("Add a line", icon="add", on_click=self._add).props("flat dense no-caps").classes("somrs-define-more")
        self._refresh()
        form.on_change(self._refresh)

    @property
    def lines(self) -> list[Line]:
        return [row.line for row in self._rows]

    def _refresh(self) -> None:
        text = self._form.draft.effect
        goal_lines = lines_of(text, self._form.api.context.ontology) if text.strip() else []
        # While the user types a formula, it is invalid at times; the lines then stay unchanged.
        is_editable = goal_lines is not None or not self._rows
        self._complex_note.visible = goal_lines is None and not _may_become_lines(text)
        self._list.visible = self._add_button.visible = self._negation_note.visible = not self._complex_note.visible
        if is_editable and not is_same_formula(text_of(self.lines), text.strip()):
            self._rebuild(goal_lines or [])
        if not self._rows and not self._complex_note.visible:
            self._rebuild([])

    def _rebuild(self, lines: list[Line]) -> None:
        self._list.clear()
        self._rows = []
        for line in lines or [Line()]:
            self._add_row(line)

    def _add_row(self, line: Line) -> _Row:
        with self._list:
            row = _Row(self._form, line, self._changed, self._remove, first=not self._rows)
        self._rows.append(row)
        return row

    async def point(self, name: str) -> None:
        """Fill the first line that misses a thing with an object that the user clicked on the plan."""
        for row in self._rows:
            if await row.fill(name):
                return

    def _add(self) -> None:
        self._add_row(Line()).focus()

    def _remove(self, row: _Row) -> None:
        self._rows.remove(row)
        lines = self.lines
        self._rebuild(lines)
        self._changed()

    def _changed(self) -> None:
        text = text_of(self.lines)
        if not is_same_formula(text, self._form.draft.effect.strip()):
            self._form.draft.effect = text
            self._form.changed()


def _may_become_lines(text: str) -> bool:
    """Whether the text may become a formula that lines can show."""
    return not re.search(r"\bOR\b|[?(+*]| - ", text)


class _Row:
    """One line with its fields."""

    def __init__(self, form: Form, line: Line, changed: Callable[[], None], remove: Callable[[_Row], None], *, first: bool) -> None:
        self._form, self.line, self._changed = form, line, changed
        self._sayable: Sayable | None = None
        with ui.element("div").classes("somrs-define-line") as self.element:
            ui.label("" if first else "and").classes("somrs-define-and").props('aria-hidden="true"')
            self._thing_picker = Picker("Thing", value=line.thing, placeholder="Thing", source=things(), on_pick=self._pick_thing)
            self._predicate_picker = Picker(
                "Property", value=_predicate_of(line), placeholder="Relation or attribute", options=[], on_pick=self._pick_predicate
            )
            self._rest = ui.element("div").classes("somrs-define-rest")
            with ui.element("div").classes("somrs-define-line-ways"):
                self._negation = shown_at_once(ui.checkbox("Must not hold", value=line.denied, on_change=self._deny)).props("dense size=sm")
                self._negation.classes("somrs-define-not").tooltip("Negation: the goal is that this condition is false (NOT in a formula)")
                remove_button = ui.button(icon="close", on_click=lambda: remove(self)).props("flat dense round size=sm")
                remove_button.props('aria-label="Remove this line"')
        self._fill()
        if line.thing:
            background_tasks.create(self._learn(), context=self.element)

    def focus(self) -> None:
        self._thing_picker.focus()

    async def fill(self, name: str) -> bool:
        """Use an object that the user clicked, if the line misses a thing and the object fits. Returns whether the line used the click."""
        context = self._form.api.context
        object = context.map.objects.get(name)
        if object is None or (self.line.thing and (not self.line.relation or self.line.related_thing)):
            return False
        if self.line.thing:
            fits = context.ontology.is_subtype(object.type, context.ontology.relations[self.line.relation].joins[1])
            if fits and name != self.line.thing:
                self._pick_related_thing(name)
                self._fill()
            return True
        if any(context.ontology.is_subtype(object.type, fixed) for fixed in FIXED):
            return False
        self._thing_picker.choose(name)
        await self._pick_thing(name)
        return True

    # Choices

    async def _pick_thing(self, name: str) -> None:
        self.line = structs.replace(self.line, thing=name)
        await self._learn()
        self._changed()

    async def _learn(self) -> None:
        """Load the relations and attributes of the thing; clear a choice that the thing does not have."""
        try:
            sayable = await self._form.api.formulas.sayable(self.line.thing)
        except SomrsError as error:
            self._thing_picker.blame(str(error))
            return
        self._thing_picker.blame("")
        self._sayable = sayable
        relations = [
            Choice(
                value=relation.name,
                text=_words(relation.name),
                detail=relation.doc,
                symbol="link",
                group=_GROUPS[0 if relation.achievable else 1],
            )
            for relation in sayable.relations
        ]
        attributes = [
            Choice(value=f".{attribute.path}", text=attribute.path, detail=_current_value_text(attribute), symbol="tune", group=_GROUPS[2])
            for attribute in sayable.attributes
        ]
        self._predicate_picker.offer(options=[*relations, *attributes])
        if not self.line.relation and not self.line.path and relations:
            self._choose(relations[0]["value"])
        elif (self.line.relation or f".{self.line.path}") not in {choice["value"] for choice in (*relations, *attributes)}:
            self._choose("")
        elif self.line.path:
            self._fill()

    def _pick_predicate(self, predicate: str) -> None:
        self._choose(predicate)
        self._changed()

    def _choose(self, predicate: str) -> None:
        thing, denied = self.line.thing, self.line.denied
        if predicate.startswith("."):
            attribute = self._attribute(predicate[1:])
            kind = attribute.kind if attribute is not None else Kind.TEXT
            unit = attribute.units[0] if attribute is not None and attribute.units else ""
            self.line = Line(thing=thing, path=predicate[1:], kind=kind, unit=unit, denied=denied)
        else:
            self.line = Line(thing=thing, relation=predicate, related_thing=self.line.related_thing if predicate else "", denied=denied)
        self._predicate_picker.choose(predicate)
        self._fill()

    def _attribute(self, path: str) -> SayableAttribute | None:
        return (
            next((attribute for attribute in self._sayable.attributes if attribute.path == path), None)
            if self._sayable is not None
            else None
        )

    def _fill(self) -> None:
        """Rebuild the fields for the rest of the line: a related thing, or a value."""
        self._rest.clear()
        with self._rest:
            if self.line.path:
                self._fill_value()
            elif self.line.relation:
                source = things(relation=self.line.relation, place=1)
                Picker(
                    "Related object", value=self.line.related_thing, placeholder="Object", source=source, on_pick=self._pick_related_thing
                )

    def _fill_value(self) -> None:
        attribute, line = self._attribute(self.line.path), self.line
        orders = ORDERS if line.kind is Kind.NUMBER else ORDERS[:2]
        choices = [Choice(value=order, text=_ORDER_WORDS[order], detail=order) for order in orders]
        Picker("Comparison", value=line.order, options=choices, on_pick=self._pick_order).classes("somrs-define-order")
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

    def _pick_related_thing(self, name: str) -> None:
        self.line = structs.replace(self.line, related_thing=name)
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

    def _deny(self, event: ValueChangeEventArguments[bool | None]) -> None:
        self.line = structs.replace(self.line, denied=bool(event.value))
        self._changed()


def _predicate_of(line: Line) -> str:
    return line.relation or (f".{line.path}" if line.path else "")


def _words(name: str) -> str:
    """Split a name in camel case: `isHeldBy` gives "is held by"."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name).lower()


def _current_value_text(attribute: SayableAttribute) -> str:
    if attribute.now is None:
        return attribute.doc
    now = {True: "TRUE", False: "FALSE"}[attribute.now] if isinstance(attribute.now, bool) else attribute.now
    value_text = f"{now:.6g}" if isinstance(now, float) else str(now)
    return f"now {value_text} {attribute.units[0]}" if attribute.units else f"now {value_text}"
