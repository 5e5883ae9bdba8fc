"""The form for the attributes of one object: editing, validation, saving, and merging with changes of other users."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from nicegui import background_tasks, ui

from somrs.api.remote import LiveApi
from somrs.client.refusals import Refused
from somrs.errors import InputError, SomrsError
from somrs.gui.author import author
from somrs.gui.pages.map.change_text import format_value
from somrs.gui.pages.map.fields import Field, Raw, Spot
from somrs.gui.pages.map.object_drafts import ObjectDrafts
from somrs.gui.pages.map.refusals import overtaken_objects
from somrs.gui.shell import notify
from somrs.ontology.objects import Change, Object, ValueSet
from somrs.ontology.types import Kind, Ontology, Value
from somrs.protocol.messages.knowledge import BrokenRule, UpdateMap
from somrs.protocol.messages.people import person_name

_PLACE = ("Position", "Rotation")
_FORM = "Shape.Form"
SIZES = {"Box": {"Width", "Depth", "Height"}, "Cylinder": {"Radius", "Height"}, "Polygon": {"Outline", "Height"}}
"""The sizes that each form has."""


@dataclass(frozen=True, slots=True)
class _ValueConflict:
    """A value that another user changed while the field was edited."""

    value: Value | None
    author_name: str


class ObjectForm:
    """`drafts` stores the edits, and provides those of an earlier visit. `saved` is called with the version that contains them."""

    def __init__(self, api: LiveApi, object: Object, drafts: ObjectDrafts, saved: Callable[[int], None]) -> None:
        self._api, self._drafts, self._saved = api, drafts, saved
        self._ontology: Ontology = api.context.ontology
        self.name, self.type = object.name, object.type
        self._map_values: dict[str, Value] = dict(object.values)
        self._version = api.context.version
        draft = drafts.draft_of(object.name)
        self.typed: dict[str, Raw] = draft.typed()
        self._conflicts: dict[str, _ValueConflict] = {}
        self._news_values: dict[str, Value | None] = {}
        """Values of other users that replaced what the field showed, until the user edits it."""
        self._fields: dict[str, Field] = {}
        self._is_removed = False
        self._saving = asyncio.Lock()
        """Held during a save: only afterwards is it known what is still to be saved, and on which version of the map."""
        self._news = ui.element("div").classes("somrs-map-news").props('role="alert"')
        form = ui.element("form").classes("somrs-map-form").props(f'aria-label="Attributes of {object.name}" novalidate')
        with form.on("submit.prevent", self.save):
            self._body()
            with ui.element("div").classes("somrs-map-buttons somrs-map-stick") as self._buttons:
                ui.button("Save", icon="check").props("unelevated no-caps dense type=submit")
                ui.button("Discard", on_click=self.discard).props("flat no-caps dense")
                self._unsaved_label = ui.label().classes("somrs-soft")
        self._mark()
        for path, raw in draft.typed().items():
            if path not in self._fields or (raw or None) == (self._fields[path].spot.raw(self._map_values.get(path)) or None):
                self.typed.pop(path)
        clashing = {path: None for path in self.typed if draft.map_values.get(path) != self._map_values.get(path)}
        self._conflicts.update({path: _ValueConflict(self._map_values.get(path), "another user") for path in clashing})
        self._show_conflicts()
        self._changed()

    def _changed(self) -> None:
        self._drafts.save(self.name, self.typed, self._map_values)

    def _body(self) -> None:
        spots = {
            path: Spot(path, attribute, self.type, self._ontology) for path, attribute in self._ontology.attributes_of(self.type).items()
        }
        groups: dict[str, list[Spot]] = {}
        for path, spot in spots.items():
            if spot.attribute.kind is not Kind.COMPLEX:
                groups.setdefault(self._group(path), []).append(spot)
        for title in sorted(groups, key=lambda title: (title != "", title != "Place", title == "More", title)):
            with ui.element("fieldset").classes("somrs-map-group"):
                if title:
                    with ui.element("legend"):
                        ui.label(title)
                for spot in sorted(groups[title], key=lambda form_spot: form_spot.attribute.kind is Kind.TRUTH):
                    field = self._fields[spot.path] = Field(spot, self._edit, partial(self._drafts.mirror, self.name))
                    field.show_value(self._map_values.get(spot.path), edited=self.typed.get(spot.path), is_edited=spot.path in self.typed)
        self._fit_form()

    def _group(self, path: str) -> str:
        first, _, inner = path.partition(".")
        if inner:
            return first
        if first.startswith(_PLACE):
            return "Place"
        object_type = self._ontology.types[self.type]
        inherited = self._ontology.attributes_of("PhysicalObject") if self._ontology.is_subtype(self.type, "PhysicalObject") else {}
        return "" if first in (*object_type.attributes, *object_type.required) or first not in inherited or first == "Label" else "More"

    # Editing

    @property
    def dirty(self) -> bool:
        return bool(self.typed)

    def _edit(self, path: str, raw: Raw) -> None:
        field = self._fields[path]
        if (raw or None) == (field.spot.raw(self._map_values.get(path)) or None) and not (raw is False and path not in self._map_values):
            self.typed.pop(path, None)
            self._conflicts.pop(path, None)
        else:
            self.typed[path] = raw
        field.mark(path in self.typed)
        if path in self._news_values:
            background_tasks.create(self._settle_crossing(path, self._news_values.pop(path), raw), context=self._news)
        if path == _FORM:
            self._fit_form()
        self._mark()
        self._changed()

    def _fit_form(self) -> None:
        """Show only the sizes that the object's form has."""
        if _FORM not in self._fields:
            return
        form = self.typed.get(_FORM, self._map_values.get(_FORM)) or self._fields[_FORM].spot.default
        sizes = SIZES.get(str(form), set().union(*SIZES.values()))
        for path, field in self._fields.items():
            first, _, inner = path.partition(".")
            if first == "Shape" and inner and path != _FORM:
                field.element.visible = inner in sizes or path in self.typed

    def _mark(self) -> None:
        count = len(self.typed)
        self._buttons.visible = count > 0 and not self._is_removed
        self._unsaved_label.text = f"{count} not saved" if count else ""

    def discard(self) -> None:
        """Drop the edits."""
        self.typed.clear()
        self._conflicts.clear()
        for path, field in self._fields.items():
            field.show_value(self._map_values.get(path))
        self._fit_form()
        self._show_conflicts()
        self._mark()
        self._changed()

    def focus(self, path: str) -> None:
        if path in self._fields:
            self._fields[path].focus()

    # Saving

    async def save(self) -> None:
        """Save the edits to the map; errors are shown at their fields."""
        async with self._saving:
            await self._save()

    async def _save(self) -> None:
        if self._is_removed or not self.typed:
            return
        if self._conflicts:
            notify("Other users changed some of the same attributes. Choose a value for each, then save.", bad=True)
            return
        changes = self._changes()
        if changes is None:
            return
        sent_values = dict(self.typed)
        update = UpdateMap(changes=tuple(changes), author=author(), expected_version=self._version)
        try:
            version = (await self._api.map.change(update)).version
        except Refused as error:
            self._refused(error)
            return
        except SomrsError as error:
            notify(f"{error}. Your input is kept.", bad=True)
            return
        for change in changes:
            if change.value is None:
                self._map_values.pop(change.path, None)
            else:
                self._map_values[change.path] = change.value
        self._version = max(self._version, version)
        for path, raw in sent_values.items():
            if self.typed.get(path) == raw:
                self.typed.pop(path, None)
                self._fields[path].show_value(self._map_values.get(path))
        self._mark()
        self._changed()
        notify(f"{self.name} saved")
        self._saved(version)

    def _changes(self) -> list[ValueSet] | None:
        """The edits as changes of the map; None if one is invalid."""
        changes, wrong = [], [path for path in self.typed if not self._fields[path].check()]
        if wrong:
            self._fields[wrong[0]].focus()
            return None
        for path, raw in self.typed.items():
            try:
                changes.append(ValueSet(self.name, path, self._fields[path].spot.read(raw)))
            except InputError as error:
                self._fields[path].show_problem(str(error))
                return None
        return changes

    def _refused(self, error: Refused) -> None:
        if overtaken_objects(error):
            notify(f"Another user changed {self.name} at the same time. Your input is kept: check it and save again.", bad=True)
            return
        messages = [broken_rule.message for broken_rule in error.broken if not self._show_in_field(broken_rule)]
        if messages or not error.broken:
            notify("\n".join(messages) or str(error), bad=True)

    def _show_in_field(self, broken: BrokenRule) -> bool:
        """Show a broken rule at its field. Returns whether there is such a field."""
        field = self._fields.get(broken.path) if broken.subject == self.name else None
        if field is None:
            return False
        field.show_problem(broken.message)
        field.focus()
        return True

    # Changes of other users

    async def apply_changes(self, object: Object | None, changes: tuple[Change, ...], version: int) -> None:
        """Adopt a new state of the object: unedited fields show the new values; edited fields keep their content and show the conflict."""
        if object is None or object.type != self.type:
            await self._mark_removed()
            return
        if self._is_removed:
            self._restore()
        changed_values = {
            path: object.values.get(path)
            for path in {*self._map_values, *object.values}
            if self._map_values.get(path) != object.values.get(path)
        }
        self._map_values, self._version = dict(object.values), max(version, self._version)
        clashing = []
        for path, value in changed_values.items():
            field = self._fields.get(path)
            if field is None:
                continue
            if path not in self.typed:
                field.show_value(value)
                self._news_values[path] = value
            elif (self.typed[path] or None) == (field.spot.raw(value) or None):
                self.typed.pop(path)
                field.show_value(value)
            else:
                clashing.append(path)
        self._fit_form()
        if clashing:
            author_name = await self._last_author(version)
            self._conflicts.update({path: _ValueConflict(object.values.get(path), author_name) for path in clashing})
        self._show_conflicts()
        self._mark()

    async def _settle_crossing(self, path: str, value: Value | None, typed: Raw) -> None:
        """Another user's value and what the user typed crossed on the way between server and browser: keep the typed text, and show the
        conflict."""
        field = self._fields[path]
        if await field.retype(field.spot.raw(value), typed) and path in self.typed:
            self._conflicts[path] = _ValueConflict(value, await self._last_author(self._version))
            self._show_conflicts()

    async def _last_author(self, version: int) -> str:
        try:
            events = (await self._api.map.history(self.name, limit=1)).events
        except SomrsError:
            return "another user"
        return person_name(events[0].author) if events else "another user"

    def _show_conflicts(self) -> None:
        self._news.clear()
        with self._news:
            for path, conflict in self._conflicts.items():
                attribute = self._fields[path].spot.attribute
                theirs = format_value(conflict.value, attribute) if conflict.value is not None else "nothing"
                with ui.element("div").classes("somrs-map-clash"):
                    ui.icon("call_split").props('aria-hidden="true"')
                    ui.label(f"Meanwhile {conflict.author_name} set {path} to {theirs}; you wrote {self.typed.get(path)}.")
                    ui.button("Keep mine", on_click=lambda path=path: self._keep_mine(path)).props("flat dense no-caps")
                    ui.button("Take theirs", on_click=lambda path=path: self._take_theirs(path)).props("flat dense no-caps")

    def _keep_mine(self, path: str) -> None:
        self._conflicts.pop(path, None)
        self._show_conflicts()

    def _take_theirs(self, path: str) -> None:
        self._conflicts.pop(path, None)
        self.typed.pop(path, None)
        self._fields[path].show_value(self._map_values.get(path))
        self._show_conflicts()
        self._mark()
        self._changed()

    async def _mark_removed(self) -> None:
        """Show that the object has been removed from the map."""
        if self._is_removed:
            return
        self._is_removed = True
        author_name = await self._last_author(0)
        self._news.clear()
        with self._news, ui.element("div").classes("somrs-map-clash somrs-map-gone"):
            ui.icon("delete").props('aria-hidden="true"')
            draft_note = " Your input is kept below." if self.typed else ""
            ui.label(f"{self.name} is not on the map any more: {author_name} removed or renamed it.{draft_note}")
        for field in self._fields.values():
            field.enable(False)
        self._mark()

    def _restore(self) -> None:
        self._is_removed = False
        self._news.clear()
        for field in self._fields.values():
            field.enable(True)
