"""The Ontology page: its parts, open drafts and navigation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qs, quote

import msgspec
from nicegui import ui
from nicegui.events import GenericEventArguments

from somrs.api.map_news import MapNews
from somrs.api.ontology import Consequences
from somrs.api.remote import LiveApi
from somrs.client.hub import News
from somrs.errors import SomrsError
from somrs.gui.author import author
from somrs.gui.components.draft_storage import DraftStorage
from somrs.gui.components.rebuilt import RebuiltElement
from somrs.gui.news import follow
from somrs.gui.pages.ontology import heading, sheet
from somrs.gui.pages.ontology.actions import Actions
from somrs.gui.pages.ontology.drafts import Draft, start_draft
from somrs.gui.pages.ontology.editor import Editor, EditorCallbacks
from somrs.gui.pages.ontology.elements import TextTag, in_page_context, titled_dialog
from somrs.gui.pages.ontology.history_dialog import HistoryDialog
from somrs.gui.pages.ontology.import_export import Import, export_menu
from somrs.gui.pages.ontology.index import Index, IndexCallbacks
from somrs.gui.pages.ontology.ontology_view import OntologyView
from somrs.gui.pages.ontology.sections import ATTRIBUTES, SECTION, SECTIONS, SERVICES, TYPES, Section
from somrs.gui.shell import guarded, notify, page, page_at
from somrs.ontology.objects import ObjectAdded, ObjectRemoved
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Define
from somrs.protocol.messages.people import person_name

PATH = "/ontology"
BACK_SCRIPT = '<script>window.addEventListener("popstate", () => emitEvent("somrs-ontology-back", location.search));</script>'
"""Reports the browser's back button, which goes through the definitions opened on the page."""
_NEW = "new"


def register(api: LiveApi) -> None:
    @page_at(PATH)
    async def show_page() -> None:
        ui.add_head_html(BACK_SCRIPT)
        with page("Ontology", PATH, api, [*(section.parameter for section in SECTIONS), _NEW]) as address:
            opened = OntologyPage(api)
            query = ui.context.client.request.url.query
            if (fresh := parse_qs(query).get(_NEW, [""])[0]) not in ("", *SECTION):
                address.report(f"There is no kind of definition {fresh}; the kinds are {', '.join(SECTION)}.")
            await opened.begin(query)


class OntologyPage:
    """The page in one browser. `_name` is the open definition, None for a new one or none (a new one has a draft)."""

    def __init__(self, api: LiveApi) -> None:
        self._api = api
        self._view = OntologyView()
        self.client = ui.context.client
        self._section: Section = TYPES
        self._name: str | None = None
        self._drafts: dict[str, Draft] = {}
        self._marks: dict[tuple[str, str], str] = {}
        self._draft_marks: dict[str, dict[tuple[str, str], str]] = {}  # by draft
        self._editor: Editor | None = None
        self._actions = Actions(api, self._view, self._open_changed)
        self._history_dialog = HistoryDialog(api, self._actions)
        self._draft_storage = DraftStorage("somrs-ontology", self._restore_drafts)
        self._frame()
        ui.on("somrs-ontology-back", self._navigate_back)
        follow(api.context.hub, "ontology", self._refresh, self._handle_news)
        # The Repository refuses changes that break a rule, but the initial map or ontology may break one.
        follow(api.context.hub, "map", self._look_for_problems, self._handle_map_news)
        follow(api.context.hub, "services", self._read_services, self._handle_services_news)

    def _frame(self) -> None:
        with ui.element("div").classes("somrs-onto"):
            with ui.element("div").classes("somrs-onto-bar"):
                TextTag("h1", "Ontology", "somrs-title")
                self._version_label = ui.label().classes("somrs-soft")
                ui.space()
                ui.button("Undo", icon="undo", on_click=self._actions.undo_last).props("flat dense no-caps")
                ui.button("History", icon="history", on_click=lambda: self._history_dialog.open_history()).props("flat dense no-caps")
                ui.button("Import", icon="upload", on_click=lambda: Import(self._api)).props("flat dense no-caps")
                export_menu()
            callbacks = IndexCallbacks(
                switch_section=self._switch_section, open_definition=self._open_other, move=self._actions.move, new=self.new
            )
            self._index = Index(self._view, callbacks)
            with ui.element("div").classes("somrs-onto-right"):
                self._unsaved_banner = RebuiltElement()
                with ui.element("article").classes("somrs-sheet somrs-onto-main"):
                    self._heading, self._content = RebuiltElement(), RebuiltElement()

    # Navigation

    async def begin(self, query: str) -> None:
        """Open what the page's address specifies."""
        await self._read()
        self._apply_query(query)
        self._render()

    def _apply_query(self, query: str) -> None:
        query_values = parse_qs(query)
        for section in SECTIONS:
            if named := query_values.get(section.parameter):
                self._section, self._name = section, named[0]
                return
        if (fresh := query_values.get(_NEW, [""])[0]) in SECTION:
            self._section, self._name = SECTION[fresh], None
            self._drafts.setdefault(f"{fresh}:", start_draft(self._section, None, self._view.version))
        else:
            self._section, self._name = TYPES, None

    def open_definition(self, section: Section, name: str | None) -> None:
        """Open a definition; None: the new one of the section, if there is a draft."""
        self._section, self._name = section, name
        ui.navigate.history.push(self._address())
        self._render()

    def _open_other(self, section: Section, name: str) -> None:
        if (section, name) != (self._section, self._name):
            self.open_definition(section, name)

    def _address(self) -> str:
        if self._name is not None:
            return f"{PATH}?{self._section.parameter}={quote(self._name)}"
        return f"{PATH}?{_NEW}={self._section.key}" if self._key in self._drafts else PATH

    def _navigate_back(self, event: GenericEventArguments) -> None:
        self._apply_query(str(event.args).removeprefix("?"))
        self._render()

    def _switch_section(self, section: Section) -> None:
        """Show another section in the index; the open definition stays."""
        self._index.render(section, self._name if section is self._section else None, self._all_marks(), self._unsaved())

    @property
    def _key(self) -> str:
        return f"{self._section.key}:{self._name or ''}"

    # Content

    def _render(self) -> None:
        """Show the index, and the open definition or its draft, as they are now."""
        self._show_index()
        self._show_definition()

    def _show_definition(self) -> None:
        self._editor = None
        view, section, name = self._view, self._section, self._name
        draft = self._drafts.get(self._key)
        definition = view.definition(section, name) if name is not None else None
        if draft is None and definition is not None:
            shown_heading = heading.Heading.of(definition, self._marks.get((section.key, definition.name), ""), view)
            self._heading.show(shown_heading, lambda: shown_heading.build(self._definition_actions()))
            content = (definition, [*view.ontology], view.objects, view.providers, view.withheld)
            self._content.show(content, lambda: sheet.show_definition(definition, view, self.open_definition))
        else:
            self._heading.clear()
            if draft is not None:
                self._content.rebuild(lambda: self._build_editor(draft))
            elif name is not None:
                self._content.show((section.key, name), lambda: self._build_missing(section, name))
            else:
                self._content.show([*view.ontology], lambda: heading.show_overview(view))
        self._show_unsaved()

    def _definition_actions(self) -> heading.DefinitionActions:
        actions = self._actions
        return heading.DefinitionActions(
            edit=self.edit, add_below=self.new, rename=actions.rename, move=actions.ask_move, remove=self._remove,
            history=self._history_dialog.open_history, open_definition=self.open_definition,
        )  # fmt: skip

    def _build_editor(self, draft: Draft) -> None:
        callbacks = EditorCallbacks(
            on_saved=self._saved,
            on_dropped=self._dropped,
            on_changed=self._show_unsaved,
            make_attribute=self._make_attribute,
            on_problems=self._mark_problems,
        )
        self._editor = Editor(self._api, self._view, draft, self._draft_storage, callbacks)

    def _build_missing(self, section: Section, name: str) -> None:
        heading.show_missing(section, name, lambda: self._history_dialog.open_history(section, name))

    def _show_index(self, section: Section | None = None) -> None:
        """Show a section of the index; None: that of the open definition."""
        section = section or self._section
        self._version_label.text = f"version {self._view.version}"
        self._index.render(section, self._name if section is self._section else None, self._all_marks(), self._unsaved())

    def _show_unsaved(self) -> None:
        """Show links to unsaved drafts."""
        drafts = [draft for key, draft in self._drafts.items() if key != self._key and draft.dirty]
        labels = [draft.name or f"new {draft.section.singular} {draft.form['name']}".strip() for draft in drafts]
        if drafts:
            content = [(draft.key, label) for draft, label in zip(drafts, labels, strict=True)]
            self._unsaved_banner.show(content, lambda: self._build_unsaved_banner(drafts, labels))
        else:
            self._unsaved_banner.clear()
        self._index.mark_drafts(self._unsaved())

    def _build_unsaved_banner(self, drafts: list[Draft], labels: list[str]) -> None:
        with ui.element("div").classes("somrs-onto-banner somrs-onto-unsaved"):
            ui.icon("edit")
            TextTag("span", "Not saved:")
            for draft, label in zip(drafts, labels, strict=True):
                ui.button(label, on_click=lambda _, draft=draft: self.open_definition(draft.section, draft.name)).props(
                    "flat dense no-caps"
                )

    def _unsaved(self) -> set[str]:
        return {key for key, draft in self._drafts.items() if draft.dirty}

    # Editing

    def edit(self, section: Section, name: str) -> None:
        definition = self._view.definition(section, name)
        if definition is not None:
            self._drafts.setdefault(f"{section.key}:{name}", start_draft(section, definition, self._view.version))
            self._render()

    def new(self, section: Section, parent: str | None = None) -> None:
        """Open a new definition, or the unsaved draft of one."""
        initial_values = {"parent": parent} if parent is not None else {}
        key = f"{section.key}:"
        if key not in self._drafts or not self._drafts[key].dirty:
            self._drafts[key] = start_draft(section, None, self._view.version, **initial_values)
        self.open_definition(section, None)

    def _make_attribute(self, on_created: Callable[[str], None]) -> None:
        """Create an attribute in a dialog, so that the form of the type stays open."""

        async def saved(draft: Draft, name: str, version: int) -> None:
            await dropped(draft)
            await self._wait_for_version(version)
            on_created(name)

        async def dropped(draft: Draft) -> None:
            self._draft_storage.forget(draft.key)
            draft.form = draft.base
            dialog.close()

        def hidden() -> None:
            if draft.dirty:  # closed by mistake: keep the draft among the unsaved ones
                self._drafts[draft.key] = draft
                self._show_unsaved()
            dialog.delete()

        draft = start_draft(ATTRIBUTES, None, self._view.version)
        with titled_dialog("New attribute") as dialog, ui.card().classes("somrs-onto-dialog somrs-onto"):
            callbacks = EditorCallbacks(
                on_saved=saved, on_dropped=dropped, on_changed=lambda: None, make_attribute=lambda _: None, on_problems=lambda _, __: None
            )
            with ui.element("div").classes("somrs-onto-dialog-body"):
                Editor(self._api, self._view, draft, self._draft_storage, callbacks)
        dialog.on("hide", hidden)
        dialog.open()

    def _restore_drafts(self, stored_drafts: list[Any]) -> None:
        """Restore the drafts that the browser tab stored before a reload."""
        for stored_draft in stored_drafts:
            try:
                draft = msgspec.convert(stored_draft, Draft)
            except msgspec.ValidationError:  # stored by another version of this program
                continue
            if draft.key not in self._drafts or not self._drafts[draft.key].dirty:
                self._drafts[draft.key] = draft
        if self._key in self._drafts:
            self._render()
        else:
            self._show_unsaved()

    async def _saved(self, draft: Draft, name: str, version: int) -> None:
        self._forget(draft)
        notify(f"{name} saved, version {version}")
        await self._open_changed(draft.section, name, version)

    async def _dropped(self, draft: Draft) -> None:
        self._forget(draft)
        self.open_definition(draft.section, draft.name)

    def _forget(self, draft: Draft) -> None:
        self._drafts = {key: other_draft for key, other_draft in self._drafts.items() if other_draft is not draft}
        self._draft_storage.forget(draft.key)
        self._draft_marks.pop(draft.key, None)

    @in_page_context
    async def _remove(self, section: Section, name: str) -> None:
        parent = getattr(self._view.definition(section, name), "parent", None)
        if await self._actions.remove(section, name):
            self._drafts.pop(f"{section.key}:{name}", None)
            self.open_definition(section, parent)

    async def _open_changed(self, section: Section, name: str, version: int) -> None:
        """Open a definition after it was changed."""
        await self._wait_for_version(version)
        self.open_definition(section, name)

    async def _wait_for_version(self, version: int) -> None:
        """Wait until the page's ontology contains a version."""
        self._version_label.text = f"version {self._view.version}; version {version} is on its way …"
        await self._api.context.wait_for_version(version)
        await self._read()

    # News

    async def _read(self) -> None:
        reply = await self._api.ontology.read()
        self._view.ontology, self._view.version = Ontology(reply.definitions.all_definitions()), reply.version
        self._view.system_definitions = frozenset(
            (definition_name.section.value, definition_name.name) for definition_name in reply.required_definition_keys
        )
        self._view.set_objects((await self._api.map.read()).objects)

    async def _read_services(self) -> None:
        self._view.set_services(await self._api.fleet.services())
        if self._editor is None and self._section is SERVICES:
            self._show_definition()  # and not the index, in which the user may have chosen another section

    async def _handle_services_news(self, news: News) -> None:
        await self._read_services()

    async def _handle_news(self, news: News) -> None:
        await self._refresh()

    @guarded
    async def _refresh(self) -> None:
        """Update the page after changes by others. An open form stays and shows the changes."""
        old_ontology = self._view.ontology
        await self._read()
        await self._follow_renamed(old_ontology)
        self._show_index(self._index.section)  # the user may have chosen another section there
        if self._editor is not None:
            self._editor.check_for_changes()
        else:
            self._show_definition()

    async def _follow_renamed(self, old_ontology: Ontology) -> None:
        """If another user renamed the open definition, open it by its new name."""
        if self._name is None or self._editor is not None or self._name in self._section.definitions_in(self._view.ontology):
            return
        if self._name not in self._section.definitions_in(old_ontology):
            return
        for event in (await self._api.ontology.history(limit=5)).events:
            for renaming in event.renamed:
                if (renaming.section.value, renaming.name) == (self._section.key, self._name):
                    if event.author != author():
                        notify(f"{renaming.name} was renamed to {renaming.to} by {person_name(event.author)}")
                    self.open_definition(self._section, renaming.to)
                    return

    async def _look_for_problems(self) -> None:
        """Mark the definitions, or the types of the objects, that currently break a rule."""
        try:
            consequences = await self._api.ontology.consider(Define())
        except SomrsError:
            return  # marks are optional; connection errors are reported by the user's actions
        marks = self._view.marks(consequences)
        if marks != self._marks:
            self._marks = marks
            self._show_index()
            if self._editor is None:
                self._render()

    def _mark_problems(self, draft: Draft, consequences: Consequences | None) -> None:
        """Mark the definitions that would break a rule by a draft."""
        self._draft_marks.pop(draft.key, None)
        if consequences is not None:
            self._draft_marks[draft.key] = self._view.marks(consequences)
        self._show_index()

    def _all_marks(self) -> dict[tuple[str, str], str]:
        return {definition_key: text for marks in (self._marks, *self._draft_marks.values()) for definition_key, text in marks.items()}

    async def _handle_map_news(self, news: News) -> None:
        """Update the counts when objects are added or removed; positions are not shown here."""
        value = news.value
        if (
            isinstance(value, MapNews)
            and not value.read
            and not any(isinstance(change, ObjectAdded | ObjectRemoved) for change in value.changes)
        ):
            return
        self._view.set_objects((await self._api.map.read()).objects)
        self._show_index()
        if self._editor is None and self._section is TYPES:
            self._render()
