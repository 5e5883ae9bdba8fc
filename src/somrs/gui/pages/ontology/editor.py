"""The editor of a definition: form, errors, concurrent changes of other users, and saving."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from datetime import datetime

from nicegui import ui

from somrs.api.ontology import Consequences
from somrs.api.remote import LiveApi
from somrs.errors import RemoteError, SomrsError
from somrs.gui.author import author
from somrs.gui.components.draft_storage import DraftStorage
from somrs.gui.pages.ontology import forms
from somrs.gui.pages.ontology.changes import FIELDS, differences
from somrs.gui.pages.ontology.consequences import confirm_change
from somrs.gui.pages.ontology.drafts import Draft, form_of, merge_forms, start_draft
from somrs.gui.pages.ontology.elements import TextTag, in_page_context
from somrs.gui.pages.ontology.fields import Fields
from somrs.gui.pages.ontology.form_parser import Mistakes, definition_of, form_path
from somrs.gui.pages.ontology.ontology_view import OntologyView
from somrs.ontology.naming import Renaming
from somrs.ontology.naming import Section as Naming
from somrs.ontology.types import Definition
from somrs.protocol.messages.knowledge import BrokenRule, Define, Event, by_kind
from somrs.protocol.messages.people import person_name


@dataclass(frozen=True, slots=True, kw_only=True)
class EditorCallbacks:
    """Callbacks of the editor: `on_saved` after saving, with the definition's name; `on_dropped` after discarding; `on_changed` after each
    edit."""

    on_saved: Callable[[Draft, str, int], Awaitable[None]]
    on_dropped: Callable[[Draft], Awaitable[None]]
    on_changed: Callable[[], None]
    make_attribute: Callable[[Callable[[str], None]], None]
    """Let the user create an attribute; the argument is called with its name."""
    on_problems: Callable[[Draft, Consequences | None], None]
    """Called with the rules that the draft breaks, None if there are none."""


class Editor:
    """The form of one draft, added to the current element."""

    def __init__(self, api: LiveApi, view: OntologyView, draft: Draft, draft_storage: DraftStorage, callbacks: EditorCallbacks) -> None:
        self._api, self._view, self.draft, self._draft_storage, self._callbacks = api, view, draft, draft_storage, callbacks
        self._fields = Fields(draft, draft_storage, self._changed)
        self._saving = False
        self.client = ui.context.client
        noun = draft.section.singular
        with ui.element("div").classes("somrs-onto-head"):
            ui.icon(draft.section.icon)
            TextTag("h2", f"Edit {draft.name}" if draft.name is not None else f"New {noun}")
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
                self._status_label = ui.label().classes("somrs-soft")
        form.on("keydown.ctrl.s.prevent", self.save)
        self._build()
        self._changed()
        self.check_for_changes()

    def _build(self) -> None:
        self._body.clear()
        self._fields = Fields(self.draft, self._draft_storage, self._changed)
        with self._body:
            forms.build_form(self._fields, self._view, self._callbacks.make_attribute)
        self._fields.store_draft()

    def _changed(self) -> None:
        self._status_label.text = "Not saved; kept in this browser tab until you save or discard it" if self.draft.dirty else ""
        self._callbacks.on_changed()

    @in_page_context
    async def _discard(self) -> None:
        await self._callbacks.on_dropped(self.draft)

    # Changes of other users

    def check_for_changes(self) -> None:
        """Check whether the definition has changed since the draft was begun."""
        current = self._current_definition()
        if self.draft.name is None or (current is not None and form_of(current) == self.draft.base):
            self._news.clear()
        else:
            ui.timer(0, self._show_news, once=True)

    def _current_definition(self) -> Definition | None:
        return self._view.definition(self.draft.section, self.draft.name) if self.draft.name is not None else None

    async def _show_news(self) -> None:
        """Show the changes of other users and the choices."""
        try:
            events = (await self._api.ontology.history(limit=30)).events
        except SomrsError:
            events = ()  # the author is unknown, but the change is shown
        if self._news.is_deleted:
            return
        current = self._current_definition()
        theirs = [event for event in events if event.version > self.draft.version and self._is_about_draft(event)]
        self._news.clear()
        with self._news, ui.element("div").classes("somrs-onto-banner"):
            ui.icon("group")
            with ui.element("div"):
                TextTag(
                    "b",
                    "Another user changed this meanwhile." if current is not None else "Another user removed or renamed this meanwhile.",
                )
                for event in theirs:
                    ui.label(f"{person_name(event.author)}, {datetime.fromtimestamp(event.at):%H:%M:%S}").classes("somrs-soft")
                if current is not None:
                    for line in self._their_changes(current):
                        ui.label(line)
                ui.label("Your input is kept.").classes("somrs-soft")
                with ui.row().classes("somrs-onto-buttons"):
                    if current is not None:
                        ui.button("Merge their changes", on_click=self._merge).props("flat dense no-caps")
                        ui.button("Keep all mine", on_click=self._keep_mine).props("flat dense no-caps")
                        ui.button("Discard mine, show theirs", on_click=self._discard).props("flat dense no-caps")
                    else:
                        ui.button("Save mine as new", on_click=self._as_new).props("flat dense no-caps")
                        ui.button("Discard mine", on_click=self._discard).props("flat dense no-caps")

    def _is_about_draft(self, event: Event) -> bool:
        if event.revision is None:
            return False
        touched = [*event.revision.before.all_definitions(), *event.revision.after.all_definitions()]
        return any(isinstance(definition, self.draft.section.struct) and definition.name == self.draft.name for definition in touched)

    def _their_changes(self, current: Definition) -> list[str]:
        original = self.draft.original
        return (
            [
                f"{difference.field}: {difference.before or 'nothing'} → {difference.after or 'nothing'}"
                for difference in differences(original, current)
            ]
            if original
            else []
        )

    @in_page_context
    async def _merge(self) -> None:
        current = self._current_definition()
        if current is None:
            return
        self.draft.form, conflicts = merge_forms(self.draft.base, self.draft.form, form_of(current))
        self._rebase(current)
        if conflicts:
            self._show_message(
                f"You both changed {', '.join(_label(path) for path in conflicts)}: your values are in the form", icon="group", bad=False
            )

    def _keep_mine(self) -> None:
        if (current := self._current_definition()) is not None:
            self._rebase(current)

    def _rebase(self, current: Definition) -> None:
        """Base the draft on the current definition; the form stays."""
        fresh = start_draft(self.draft.section, current, self._view.version)
        self.draft.base, self.draft.original_data = fresh.base, fresh.original_data
        self._refresh_form()

    async def _as_new(self) -> None:
        self._draft_storage.forget(self.draft.key)
        self.draft.name, self.draft.original_data = None, None
        self.draft.base = start_draft(self.draft.section, None, self._view.version).base
        self._refresh_form()

    def _refresh_form(self) -> None:
        self.draft.version = self._view.version
        self._build()
        self._changed()
        self._news.clear()

    # Saving

    @in_page_context
    async def save(self) -> None:
        """Validate the draft, show its consequences, and save it. The input is kept on any error."""
        if self._saving:
            return
        self._saving = True
        self._save.props("loading")
        try:
            await self._attempt_save()
        finally:
            self._saving = False
            if not self._save.is_deleted:
                self._save.props(remove="loading")

    async def _attempt_save(self) -> None:
        self._fields.clear_problems()
        self._trouble.clear()
        try:
            await self._carry_out()
        except SomrsError as error:
            self._show_message(str(error))

    async def _carry_out(self) -> None:
        try:
            definition = definition_of(self.draft, self._view.ontology)
        except Mistakes as mistakes:
            self._show_problems(
                [BrokenRule(subject="", rule="", message=message, path=path) for path, message in mistakes.messages.items()], focus=True
            )
            return
        section = self.draft.section
        if self.draft.name != definition.name and self._view.definition(section, definition.name) is not None:
            message = f"{definition.name} is the name of another {section.singular}; choose another one"
            self._show_problems([BrokenRule(subject=definition.name, rule="duplicate", message=message, path="name")], focus=True)
            return
        change = self._change(definition)
        consequences = await self._api.ontology.consider(change)
        self._callbacks.on_problems(self.draft, consequences if consequences.broken else None)
        own_problems = [
            broken_rule
            for broken_rule in consequences.broken
            if broken_rule.section == section.key and broken_rule.subject == definition.name
        ]
        if own_problems:
            self._show_problems(own_problems, focus=True)
            if len(own_problems) == len(consequences.broken):
                return
        has_other_changes = len([*consequences.revision.before.all_definitions()]) > 1 if consequences.revision is not None else False
        if consequences.broken or consequences.offers or consequences.affected or consequences.changes or has_other_changes:
            title = f"Save {definition.name}: consequences" if not consequences.broken else f"{definition.name} cannot be saved like this"
            if not await confirm_change(title, "Save", consequences, change.renamed) or consequences.broken:
                return
        try:
            reply = await self._api.ontology.change(change)
        except RemoteError:
            self.check_for_changes()
            raise
        await self._callbacks.on_saved(self.draft, definition.name, reply.version)

    def _change(self, definition: Definition) -> Define:
        old = self.draft.name
        renamed = (
            (Renaming(section=Naming(self.draft.section_key), name=old, to=definition.name),) if old not in (None, definition.name) else ()
        )
        is_unedited = old is not None and {**self.draft.form, "name": old} == self.draft.base
        definitions = by_kind([] if renamed and is_unedited else [definition])
        return Define(definitions=definitions, renamed=renamed, author=author(), expected_version=self.draft.version)

    def _show_problems(self, broken: list[BrokenRule], *, focus: bool) -> None:
        """Show problems at their fields; those without a field above the form."""
        homeless = [
            broken_rule
            for broken_rule in broken
            if not self._fields.show_problem(form_path(broken_rule.path, self.draft.form), broken_rule.message)
        ]
        for broken_rule in homeless:
            self._show_message(broken_rule.message)
        if focus:
            self._fields.focus_problem()

    def _show_message(self, text: str, *, icon: str = "error", bad: bool = True) -> None:
        """Show a message above the form."""
        with self._trouble, ui.element("div").classes("somrs-onto-banner" + (" somrs-onto-bad" if bad else "")):
            ui.icon(icon)
            ui.label(text).classes("somrs-onto-pre" if "\n" in text else "")
        self._trouble.run_method("scrollIntoView", {"block": "nearest"})


def _label(path: str) -> str:
    """The label of a field, or of one of its rows."""
    field, _, name = path.partition(".")
    return f"{FIELDS.get(field, field)} ({name})" if name else FIELDS.get(field, field)
