"""The attributes of one object as a form: written, checked, saved; and what others change meanwhile, without losing what was written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.client.refusals import Refused
from somrs.errors import InputError, SomrsError
from somrs.gui.pages.map.fields import Field, Raw, Spot
from somrs.gui.pages.map.words import shown
from somrs.gui.pages.map.writing import Writing
from somrs.gui.shell import author, tell
from somrs.ontology.objects import Change, Object, ValueSet
from somrs.ontology.types import Kind, Ontology, Value
from somrs.protocol.messages.knowledge import BrokenRule, UpdateMap
from somrs.protocol.messages.people import person_name

PLACE = ("Position", "Rotation")
FORM = "Shape.Form"
SIZES = {"Box": {"Width", "Depth", "Height"}, "Cylinder": {"Radius", "Height"}, "Polygon": {"Outline", "Height"}}
"""Which sizes a form has."""
OVERTAKEN = "overtaken"
"""The rule that is broken when somebody else was quicker."""


@dataclass(frozen=True, slots=True)
class Overtaken:
    """A value that was changed by others while somebody wrote another one."""

    value: Value | None
    by: str


class ObjectForm:
    """`writing` keeps what is written, and has what was written before. `saved` hears of the version that it is in."""

    def __init__(self, desk: LiveApi, object: Object, writing: Writing, saved: Callable[[int], None]) -> None:
        self._desk, self._writing, self._saved = desk, writing, saved
        self._ontology: Ontology = desk.context.ontology
        self.name, self.type = object.name, object.type
        self._known: dict[str, Value] = dict(object.values)
        self._version = desk.context.version
        before = writing.of(object.name)
        self.typed: dict[str, Raw] = before.typed()
        self._overtaken: dict[str, Overtaken] = {}
        self._fields: dict[str, Field] = {}
        self._gone = False
        self._news = ui.element("div").classes("somrs-map-news").props('role="alert"')
        form = ui.element("form").classes("somrs-map-form").props(f'aria-label="Attributes of {object.name}" novalidate')
        with form.on("submit.prevent", self.save):
            self._body()
            with ui.element("div").classes("somrs-map-buttons somrs-map-stick") as self._buttons:
                ui.button("Save", icon="check").props("unelevated no-caps dense type=submit")
                ui.button("Discard", on_click=self.discard).props("flat no-caps dense")
                self._said = ui.label().classes("somrs-soft")
        self._mark()
        for path, raw in before.typed().items():
            if path not in self._fields or (raw or None) == (self._fields[path].spot.raw(self._known.get(path)) or None):
                self.typed.pop(path)
        clashing = {path: None for path in self.typed if before.known.get(path) != self._known.get(path)}
        self._overtaken.update({path: Overtaken(self._known.get(path), "somebody") for path in clashing})
        self._tell_overtaken()
        self._changed()

    def _changed(self) -> None:
        self._writing.keep(self.name, self.typed, self._known)

    def _body(self) -> None:
        spots = {path: Spot(path, one, self.type, self._ontology) for path, one in self._ontology.attributes_of(self.type).items()}
        groups: dict[str, list[Spot]] = {}
        for path, spot in spots.items():
            if spot.attribute.kind is not Kind.COMPLEX:
                groups.setdefault(self._group(path), []).append(spot)
        for title in sorted(groups, key=lambda title: (title != "", title != "Place", title == "More", title)):
            with ui.element("fieldset").classes("somrs-map-group"):
                if title:
                    with ui.element("legend"):
                        ui.label(title)
                for spot in sorted(groups[title], key=lambda one: one.attribute.kind is Kind.TRUTH):
                    field = self._fields[spot.path] = Field(spot, self._edit, partial(self._writing.mirror, self.name))
                    field.show(self._known.get(spot.path), edited=self.typed.get(spot.path), is_edited=spot.path in self.typed)
        self._fit_form()

    def _group(self, path: str) -> str:
        first, _, inner = path.partition(".")
        if inner:
            return first
        if first.startswith(PLACE):
            return "Place"
        own = self._ontology.types[self.type]
        inherited = self._ontology.attributes_of("PhysicalObject") if self._ontology.is_subtype(self.type, "PhysicalObject") else {}
        return "" if first in (*own.attributes, *own.required) or first not in inherited or first == "Label" else "More"

    # Writing

    @property
    def dirty(self) -> bool:
        return bool(self.typed)

    def _edit(self, path: str, raw: Raw) -> None:
        field = self._fields[path]
        if (raw or None) == (field.spot.raw(self._known.get(path)) or None) and not (raw is False and path not in self._known):
            self.typed.pop(path, None)
            self._overtaken.pop(path, None)
        else:
            self.typed[path] = raw
        field.mark(path in self.typed)
        if path == FORM:
            self._fit_form()
        self._mark()
        self._changed()

    def _fit_form(self) -> None:
        """Only the sizes that the form has are shown."""
        if FORM not in self._fields:
            return
        form = self.typed.get(FORM, self._known.get(FORM)) or self._fields[FORM].spot.default
        wanted = SIZES.get(str(form), set().union(*SIZES.values()))
        for path, field in self._fields.items():
            first, _, inner = path.partition(".")
            if first == "Shape" and inner and path != FORM:
                field.element.visible = inner in wanted or path in self.typed

    def _mark(self) -> None:
        count = len(self.typed)
        self._buttons.visible = count > 0 and not self._gone
        self._said.text = f"{count} not saved" if count else ""

    def discard(self) -> None:
        """Forget what was written."""
        self.typed.clear()
        self._overtaken.clear()
        for path, field in self._fields.items():
            field.show(self._known.get(path))
        self._fit_form()
        self._tell_overtaken()
        self._mark()
        self._changed()

    def focus(self, path: str) -> None:
        if path in self._fields:
            self._fields[path].focus()

    # Saving

    async def save(self) -> None:
        """Bring what was written onto the map; what is wrong is said where it is."""
        if self._gone or not self.typed:
            return
        if self._overtaken:
            tell("Others changed some of the same attributes. Decide for each which value is to stay, then save.", bad=True)
            return
        changes = self._changes()
        if changes is None:
            return
        sent = dict(self.typed)
        update = UpdateMap(changes=tuple(changes), author=author(), expected_version=self._version)
        try:
            version = (await self._desk.map.change(update)).version
        except Refused as error:
            self._refused(error)
            return
        except SomrsError as error:
            tell(f"{error}. What you wrote is still here.", bad=True)
            return
        for change in changes:
            if change.value is None:
                self._known.pop(change.path, None)
            else:
                self._known[change.path] = change.value
        self._version = max(self._version, version)
        for path, raw in sent.items():
            if self.typed.get(path) == raw:
                self.typed.pop(path, None)
                self._fields[path].show(self._known.get(path))
        self._mark()
        self._changed()
        tell(f"{self.name} was saved")
        self._saved(version)

    def _changes(self) -> list[ValueSet] | None:
        """What was written, as changes; None when something in it is wrong."""
        changes, wrong = [], [path for path in self.typed if not self._fields[path].check()]
        if wrong:
            self._fields[wrong[0]].focus()
            return None
        for path, raw in self.typed.items():
            try:
                changes.append(ValueSet(self.name, path, self._fields[path].spot.read(raw)))
            except InputError as error:
                self._fields[path].problem(str(error))
                return None
        return changes

    def _refused(self, error: Refused) -> None:
        if any(one.rule == OVERTAKEN for one in error.broken):
            tell(f"Somebody changed {self.name} at this moment. What you wrote is still here: look at it, and save again.", bad=True)
            return
        others = [one.message for one in error.broken if not self._shown(one)]
        if others or not error.broken:
            tell("\n".join(others) or str(error), bad=True)

    def _shown(self, broken: BrokenRule) -> bool:
        """Whether there is a field to say it in."""
        field = self._fields.get(broken.path) if broken.subject == self.name else None
        if field is None:
            return False
        field.problem(broken.message)
        field.focus()
        return True

    # What others do

    async def heed(self, object: Object | None, changes: tuple[Change, ...], version: int) -> None:
        """The object is so now: fields in which nothing was written follow; what was written stays, and is told what others wrote."""
        if object is None or object.type != self.type:
            await self.lose()
            return
        if self._gone:
            self._found()
        wanted = {
            path: object.values.get(path) for path in {*self._known, *object.values} if self._known.get(path) != object.values.get(path)
        }
        self._known, self._version = dict(object.values), max(version, self._version)
        clashing = []
        for path, value in wanted.items():
            field = self._fields.get(path)
            if field is None:
                continue
            if path not in self.typed:
                field.show(value)
            elif (self.typed[path] or None) == (field.spot.raw(value) or None):
                self.typed.pop(path)
                field.show(value)
            else:
                clashing.append(path)
        self._fit_form()
        if clashing:
            by = await self._who(version)
            self._overtaken.update({path: Overtaken(object.values.get(path), by) for path in clashing})
        self._tell_overtaken()
        self._mark()

    async def _who(self, version: int) -> str:
        try:
            events = (await self._desk.map.history(self.name, limit=1)).events
        except SomrsError:
            return "somebody"
        return person_name(events[0].author) if events else "somebody"

    def _tell_overtaken(self) -> None:
        self._news.clear()
        with self._news:
            for path, one in self._overtaken.items():
                attribute = self._fields[path].spot.attribute
                theirs = shown(one.value, attribute) if one.value is not None else "nothing"
                with ui.element("div").classes("somrs-map-clash"):
                    ui.icon("call_split").props('aria-hidden="true"')
                    ui.label(f"Meanwhile {one.by} set {path} to {theirs}; you wrote {self.typed.get(path)}.")
                    ui.button("Keep mine", on_click=lambda path=path: self._keep(path)).props("flat dense no-caps")
                    ui.button("Take theirs", on_click=lambda path=path: self._take(path)).props("flat dense no-caps")

    def _keep(self, path: str) -> None:
        self._overtaken.pop(path, None)
        self._tell_overtaken()

    def _take(self, path: str) -> None:
        self._overtaken.pop(path, None)
        self.typed.pop(path, None)
        self._fields[path].show(self._known.get(path))
        self._tell_overtaken()
        self._mark()
        self._changed()

    async def lose(self) -> None:
        """The object is on the map no more."""
        if self._gone:
            return
        self._gone = True
        by = await self._who(0)
        self._news.clear()
        with self._news, ui.element("div").classes("somrs-map-clash somrs-map-gone"):
            ui.icon("delete").props('aria-hidden="true"')
            kept = " What you wrote is still below." if self.typed else ""
            ui.label(f"{self.name} is not on the map any more: {by} removed or renamed it.{kept}")
        for field in self._fields.values():
            field.enable(False)
        self._mark()

    def _found(self) -> None:
        self._gone = False
        self._news.clear()
        for field in self._fields.values():
            field.enable(True)
