"""Writing a definition: the form, what is wrong in it, what others changed meanwhile, and saving."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from datetime import datetime

from nicegui import ui

from somrs.api.ontology import Consequences
from somrs.api.remote import LiveApi
from somrs.errors import RemoteError, SomrsError
from somrs.gui.components.draft_storage import Keeper
from somrs.gui.pages.ontology import forms
from somrs.gui.pages.ontology.changes import FIELDS, differences
from somrs.gui.pages.ontology.consequences import confirmed
from somrs.gui.pages.ontology.drafts import Draft, begun, form_of, merged
from somrs.gui.pages.ontology.fields import Fields
from somrs.gui.pages.ontology.pieces import Word, lasting
from somrs.gui.pages.ontology.reading import Mistakes, definition_of, place
from somrs.gui.pages.ontology.seen import Seen
from somrs.gui.shell import author
from somrs.ontology.naming import Renaming
from somrs.ontology.naming import Section as Naming
from somrs.ontology.types import Definition
from somrs.protocol.messages.knowledge import BrokenRule, Define, Event, by_kind
from somrs.protocol.messages.people import person_name


@dataclass(frozen=True, slots=True, kw_only=True)
class Ends:
    """What the page does when writing ends: `saved` under a name, `dropped`; and when something was written, `changed`."""

    saved: Callable[[Draft, str, int], Awaitable[None]]
    dropped: Callable[[Draft], Awaitable[None]]
    changed: Callable[[], None]
    attribute: Callable[[Callable[[str], None]], None]
    """Have a new attribute made, and hear its name."""
    troubled: Callable[[Draft, Consequences | None], None]
    """The draft would break something, or nothing any more."""


class Editor:
    """The form of one draft, in the element that is current when it is made."""

    def __init__(self, desk: LiveApi, seen: Seen, draft: Draft, keeper: Keeper, ends: Ends) -> None:
        self._desk, self._seen, self.draft, self._keeper, self._ends = desk, seen, draft, keeper, ends
        self._fields = Fields(draft, keeper, self._changed)
        self._saving = False
        self.client = ui.context.client
        what = draft.section.one
        with ui.element("div").classes("somrs-onto-head"):
            ui.icon(draft.section.icon)
            Word("h2", f"Edit {draft.name}" if draft.name is not None else f"New {what}")
        self._news = ui.element("div").classes("somrs-onto-news").props('role="status"')
        self._trouble = ui.element("div").classes("somrs-onto-trouble").props('role="alert"')
        with (
            ui.element("form")
            .classes("somrs-onto-form")
            .props('aria-label="Definition" novalidate')
            .on("submit.prevent", self.save) as form
        ):
            self._body = ui.element("div").classes("somrs-onto-fields")
            with ui.element("div").classes("somrs-onto-buttons somrs-onto-stick"):
                self._save = ui.button("Save", icon="check").props("unelevated no-caps type=submit")
                ui.button("Discard", on_click=self._discard).props("flat no-caps")
                self._said = ui.label().classes("somrs-soft")
        form.on("keydown.ctrl.s.prevent", self.save)
        self._build()
        self._changed()
        self.look()

    def _build(self) -> None:
        self._body.clear()
        self._fields = Fields(self.draft, self._keeper, self._changed)
        with self._body:
            forms.build(self._fields, self._seen, self._ends.attribute)
        self._fields.keep()

    def _changed(self) -> None:
        self._said.text = "Not saved; kept in this browser tab until you save or discard it" if self.draft.dirty else ""
        self._ends.changed()

    @lasting
    async def _discard(self) -> None:
        await self._ends.dropped(self.draft)

    # What others do meanwhile

    def look(self) -> None:
        """See whether the definition is still as it was when this was begun."""
        now = self._now()
        if self.draft.name is None or (now is not None and form_of(now) == self.draft.base):
            self._news.clear()
        else:
            ui.timer(0, self._tell_news, once=True)

    def _now(self) -> Definition | None:
        return self._seen.definition(self.draft.section, self.draft.name) if self.draft.name is not None else None

    async def _tell_news(self) -> None:
        """Say who changed what, and offer what can be done about it."""
        try:
            events = (await self._desk.ontology.history(limit=30)).events
        except SomrsError:
            events = ()  # who it was is not known, but what was changed is
        if self._news.is_deleted:
            return
        now = self._now()
        theirs = [event for event in events if event.version > self.draft.version and self._about(event)]
        self._news.clear()
        with self._news, ui.element("div").classes("somrs-onto-banner"):
            ui.icon("group")
            with ui.element("div"):
                Word(
                    "b", "Somebody else changed this meanwhile." if now is not None else "Somebody else removed or renamed this meanwhile."
                )
                for event in theirs:
                    ui.label(f"{person_name(event.author)}, {datetime.fromtimestamp(event.at):%H:%M:%S}").classes("somrs-soft")
                if now is not None:
                    for one in self._theirs(now):
                        ui.label(one)
                ui.label("What you wrote is still here.").classes("somrs-soft")
                with ui.row().classes("somrs-onto-buttons"):
                    if now is not None:
                        ui.button("Take theirs over where I wrote nothing", on_click=self._merge).props("flat dense no-caps")
                        ui.button("Keep all of mine", on_click=self._keep_mine).props("flat dense no-caps")
                        ui.button("Drop mine, show theirs", on_click=self._discard).props("flat dense no-caps")
                    else:
                        ui.button("Save mine as new", on_click=self._as_new).props("flat dense no-caps")
                        ui.button("Drop mine", on_click=self._discard).props("flat dense no-caps")

    def _about(self, event: Event) -> bool:
        if event.revision is None:
            return False
        touched = [*event.revision.before.all_definitions(), *event.revision.after.all_definitions()]
        return any(isinstance(one, self.draft.section.struct) and one.name == self.draft.name for one in touched)

    def _theirs(self, now: Definition) -> list[str]:
        was = self.draft.original
        return [f"{one.field}: {one.before or 'nothing'} → {one.after or 'nothing'}" for one in differences(was, now)] if was else []

    @lasting
    async def _merge(self) -> None:
        now = self._now()
        if now is None:
            return
        self.draft.form, both = merged(self.draft.base, self.draft.form, form_of(now))
        self._rebased(now)
        if both:
            self._say(f"You both changed {', '.join(_label(one) for one in both)}: yours is in the form", icon="group", bad=False)

    def _keep_mine(self) -> None:
        if (now := self._now()) is not None:
            self._rebased(now)

    def _rebased(self, now: Definition) -> None:
        """What is in the form is a change of the definition as it is now."""
        fresh = begun(self.draft.section, now, self._seen.version)
        self.draft.base, self.draft.was = fresh.base, fresh.was
        self._renewed()

    async def _as_new(self) -> None:
        self._keeper.forget(self.draft.key)
        self.draft.name, self.draft.was = None, None
        self.draft.base = begun(self.draft.section, None, self._seen.version).base
        self._renewed()

    def _renewed(self) -> None:
        self.draft.version = self._seen.version
        self._build()
        self._changed()
        self._news.clear()

    # Saving

    @lasting
    async def save(self) -> None:
        """Check, show what would come of it, and do it. Whatever stands in the way, what was written stays."""
        if self._saving:
            return
        self._saving = True
        self._save.props("loading")
        try:
            await self._try()
        finally:
            self._saving = False
            if not self._save.is_deleted:
                self._save.props(remove="loading")

    async def _try(self) -> None:
        self._fields.no_problems()
        self._trouble.clear()
        try:
            await self._carry_out()
        except SomrsError as error:
            self._say(str(error))

    async def _carry_out(self) -> None:
        try:
            definition = definition_of(self.draft, self._seen.ontology)
        except Mistakes as mistakes:
            self._show([BrokenRule(subject="", rule="", message=message, path=path) for path, message in mistakes.found.items()], own=True)
            return
        section = self.draft.section
        if self.draft.name != definition.name and self._seen.definition(section, definition.name) is not None:
            message = f"{definition.name} is the name of another {section.one}; take another one"
            self._show([BrokenRule(subject=definition.name, rule="duplicate", message=message, path="name")], own=True)
            return
        change = self._change(definition)
        found = await self._desk.ontology.consider(change)
        self._ends.troubled(self.draft, found if found.broken else None)
        own = [one for one in found.broken if one.section == section.key and one.subject == definition.name]
        if own:
            self._show(own, own=True)
            if len(own) == len(found.broken):
                return
        along = len([*found.revision.before.all_definitions()]) > 1 if found.revision is not None else False
        if found.broken or found.offers or found.affected or found.changes or along:
            title = f"Save {definition.name}: what comes of it" if not found.broken else f"{definition.name} cannot be saved like this"
            if not await confirmed(title, "Save", found, change.renamed) or found.broken:
                return
        try:
            done = await self._desk.ontology.change(change)
        except RemoteError:
            self.look()
            raise
        await self._ends.saved(self.draft, definition.name, done.version)

    def _change(self, definition: Definition) -> Define:
        old = self.draft.name
        renamed = (
            (Renaming(section=Naming(self.draft.section_key), name=old, to=definition.name),) if old not in (None, definition.name) else ()
        )
        same = old is not None and {**self.draft.form, "name": old} == self.draft.base
        definitions = by_kind([] if renamed and same else [definition])
        return Define(definitions=definitions, renamed=renamed, author=author(), expected_version=self.draft.version)

    def _show(self, broken: list[BrokenRule], *, own: bool) -> None:
        """What is wrong, in the fields where it is; above the form what is in none of them."""
        homeless = [one for one in broken if not self._fields.problem(place(one.path, self.draft.form), one.message)]
        for one in homeless:
            self._say(one.message)
        if own:
            self._fields.focus_problem()

    def _say(self, text: str, *, icon: str = "error", bad: bool = True) -> None:
        """Above the form, where it is seen and hides nothing."""
        with self._trouble, ui.element("div").classes("somrs-onto-banner" + (" somrs-onto-bad" if bad else "")):
            ui.icon(icon)
            ui.label(text).classes("somrs-onto-pre" if "\n" in text else "")
        self._trouble.run_method("scrollIntoView", {"block": "nearest"})


def _label(path: str) -> str:
    """A field, or a row of one, in words."""
    field, _, name = path.partition(".")
    return f"{FIELDS.get(field, field)} ({name})" if name else FIELDS.get(field, field)
