"""The ontology's page: what is open in it, and what happens to it."""

from __future__ import annotations

import asyncio
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
from somrs.gui.components.draft_storage import Keeper
from somrs.gui.news import follow
from somrs.gui.pages.ontology import heading, sheet
from somrs.gui.pages.ontology.actions import Actions
from somrs.gui.pages.ontology.drafts import Draft, begun
from somrs.gui.pages.ontology.editor import Editor, Ends
from somrs.gui.pages.ontology.exchange import Import, export_menu
from somrs.gui.pages.ontology.index import Choices, Index
from somrs.gui.pages.ontology.past import Past
from somrs.gui.pages.ontology.pieces import Word, lasting, titled
from somrs.gui.pages.ontology.sections import ATTRIBUTES, SECTION, SECTIONS, TYPES, Section
from somrs.gui.pages.ontology.seen import Seen
from somrs.gui.shell import author, guarded, page, tell
from somrs.ontology.objects import ObjectAdded, ObjectRemoved
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Define
from somrs.protocol.messages.people import person_name

PATH = "/ontology"
BACK = '<script>window.addEventListener("popstate", () => emitEvent("somrs-ontology-back", location.search));</script>'
"""The browser's way back goes through what was open in the page."""
SOON = 5.0
"""Seconds that a change of one's own is waited for."""
NEW = "new"


def register(desk: LiveApi) -> None:
    @ui.page(PATH)
    async def show() -> None:
        ui.add_head_html(BACK)
        with page("Ontology", PATH, desk):
            opened = OntologyPage(desk)
            await opened.begin(ui.context.client.request.url.query)


class OntologyPage:
    """One browser's page. Of what is open, `_name` is None for something new; nothing is open while `_section` has no `_open`."""

    def __init__(self, desk: LiveApi) -> None:
        self._desk = desk
        self._seen = Seen()
        self.client = ui.context.client
        self._section: Section = TYPES
        self._name: str | None = None
        self._drafts: dict[str, Draft] = {}
        self._marks: dict[tuple[str, str], str] = {}
        self._wrong: dict[str, dict[tuple[str, str], str]] = {}  # by draft
        self._editor: Editor | None = None
        self._actions = Actions(desk, self._seen, self._there)
        self._past = Past(desk, self._actions)
        self._keeper = Keeper("somrs-ontology", self._found)
        self._frame()
        ui.on("somrs-ontology-back", self._back)
        follow(desk.context.hub, "ontology", self._refresh, self._heard)
        # The Repository takes no change that breaks a rule: what is broken all the same is so from the start.
        follow(desk.context.hub, "map", self._look_for_problems, self._moved)

    def _frame(self) -> None:
        with ui.element("div").classes("somrs-onto"):
            with ui.element("div").classes("somrs-onto-bar"):
                Word("h1", "Ontology", "somrs-title")
                self._said = ui.label().classes("somrs-soft")
                ui.space()
                ui.button("Undo", icon="undo", on_click=self._actions.undo_last).props("flat dense no-caps")
                ui.button("History", icon="history", on_click=lambda: self._past.show()).props("flat dense no-caps")
                ui.button("Import", icon="upload", on_click=lambda: Import(self._desk)).props("flat dense no-caps")
                export_menu()
            choices = Choices(turn=self._turn, pick=self._pick, move=self._actions.move, new=self.new)
            self._index = Index(self._seen, choices)
            with ui.element("div").classes("somrs-onto-right"):
                self._others = ui.element("div")
                self._main = ui.element("article").classes("somrs-sheet somrs-onto-main")

    # Where one is

    async def begin(self, query: str) -> None:
        """Show what the address asks for."""
        await self._read()
        self._take(query)
        self._show()

    def _take(self, query: str) -> None:
        asked = parse_qs(query)
        for section in SECTIONS:
            if named := asked.get(section.word):
                self._section, self._name = section, named[0]
                return
        if (fresh := asked.get(NEW, [""])[0]) in SECTION:
            self._section, self._name = SECTION[fresh], None
            self._drafts.setdefault(f"{fresh}:", begun(self._section, None, self._seen.version))
        else:
            self._section, self._name = TYPES, None

    def go(self, section: Section, name: str | None) -> None:
        """Open a definition; None: what is new in the section, if something is."""
        self._section, self._name = section, name
        ui.navigate.history.push(self._address())
        self._show()

    def _pick(self, section: Section, name: str) -> None:
        if (section, name) != (self._section, self._name):
            self.go(section, name)

    def _address(self) -> str:
        if self._name is not None:
            return f"{PATH}?{self._section.word}={quote(self._name)}"
        return f"{PATH}?{NEW}={self._section.key}" if self._key in self._drafts else PATH

    def _back(self, event: GenericEventArguments) -> None:
        self._take(str(event.args).removeprefix("?"))
        self._show()

    def _turn(self, section: Section) -> None:
        """Another section's definitions on the left; what is open stays."""
        self._index.show(section, self._name if section is self._section else None, self._all_marks(), self._unsaved())

    @property
    def _key(self) -> str:
        return f"{self._section.key}:{self._name or ''}"

    # What is shown

    def _show(self) -> None:
        """Everything anew."""
        self._show_index()
        self._main.clear()
        self._editor = None
        draft = self._drafts.get(self._key)
        definition = self._seen.definition(self._section, self._name) if self._name is not None else None
        with self._main:
            if draft is not None:
                ends = Ends(
                    saved=self._saved,
                    dropped=self._dropped,
                    changed=self._show_unsaved,
                    attribute=self._make_attribute,
                    troubled=self._troubled,
                )
                self._editor = Editor(self._desk, self._seen, draft, self._keeper, ends)
            elif definition is not None:
                ways = heading.Ways(edit=self.edit, below=self.new, rename=self._actions.rename, move=self._actions.ask_move,
                                    remove=self._remove, history=self._past.show, go=self.go)  # fmt: skip
                heading.show(definition, self._seen, self._marks.get((self._section.key, definition.name), ""), ways)
                sheet.show(definition, self._seen, self.go)
            elif self._name is not None:
                heading.gone(self._section, self._name, lambda: self._past.show(self._section, self._name or ""))
            else:
                heading.overview(self._seen, self.go)
        self._show_unsaved()

    def _show_index(self) -> None:
        self._said.text = f"version {self._seen.version}"
        self._index.show(self._section, self._name, self._all_marks(), self._unsaved())

    def _show_unsaved(self) -> None:
        """Ways to what was written elsewhere and not saved."""
        unsaved = [draft for key, draft in self._drafts.items() if key != self._key and draft.dirty]
        self._others.clear()
        if unsaved:
            with self._others, ui.element("div").classes("somrs-onto-banner somrs-onto-unsaved"):
                ui.icon("edit")
                Word("span", "Not saved:")
                for draft in unsaved:
                    label = draft.name or f"new {draft.section.one} {draft.form['name']}".strip()
                    ui.button(label, on_click=lambda _, draft=draft: self.go(draft.section, draft.name)).props("flat dense no-caps")
        self._index.mark_drafts(self._unsaved())

    def _unsaved(self) -> set[str]:
        return {key for key, draft in self._drafts.items() if draft.dirty}

    # Writing

    def edit(self, section: Section, name: str) -> None:
        definition = self._seen.definition(section, name)
        if definition is not None:
            self._drafts.setdefault(f"{section.key}:{name}", begun(section, definition, self._seen.version))
            self._show()

    def new(self, section: Section, parent: str | None = None) -> None:
        """Begin something new, or go on with what was begun."""
        given = {"parent": parent} if parent is not None else {}
        key = f"{section.key}:"
        if key not in self._drafts or not self._drafts[key].dirty:
            self._drafts[key] = begun(section, None, self._seen.version, **given)
        self.go(section, None)

    def _make_attribute(self, made: Callable[[str], None]) -> None:
        """A new attribute in a dialog, so that the type that is to have it stays open."""

        async def saved(draft: Draft, name: str, version: int) -> None:
            await dropped(draft)
            await self._until(version)
            made(name)

        async def dropped(draft: Draft) -> None:
            self._keeper.forget(draft.key)
            draft.form = draft.base
            dialog.close()

        def hidden() -> None:
            if draft.dirty:  # whoever closed the dialog by mistake finds it among what is not saved
                self._drafts[draft.key] = draft
                self._show_unsaved()
            dialog.delete()

        draft = begun(ATTRIBUTES, None, self._seen.version)
        with titled("New attribute") as dialog, ui.card().classes("somrs-onto-dialog somrs-onto"):
            nothing = Ends(saved=saved, dropped=dropped, changed=lambda: None, attribute=lambda _: None, troubled=lambda _, __: None)
            with ui.element("div").classes("somrs-onto-dialog-body"):
                Editor(self._desk, self._seen, draft, self._keeper, nothing)
        dialog.on("hide", hidden)
        dialog.open()

    def _found(self, kept: list[Any]) -> None:
        """What this browser's tab still has of what was written before the page was loaded again."""
        for one in kept:
            try:
                draft = msgspec.convert(one, Draft)
            except msgspec.ValidationError:  # of another version of this program
                continue
            if draft.key not in self._drafts or not self._drafts[draft.key].dirty:
                self._drafts[draft.key] = draft
        if self._key in self._drafts:
            self._show()
        else:
            self._show_unsaved()

    async def _saved(self, draft: Draft, name: str, version: int) -> None:
        self._forget(draft)
        tell(f"{name} is saved, in version {version}")
        await self._there(draft.section, name, version)

    async def _dropped(self, draft: Draft) -> None:
        self._forget(draft)
        self.go(draft.section, draft.name)

    def _forget(self, draft: Draft) -> None:
        self._drafts = {key: one for key, one in self._drafts.items() if one is not draft}
        self._keeper.forget(draft.key)
        self._wrong.pop(draft.key, None)

    @lasting
    async def _remove(self, section: Section, name: str) -> None:
        parent = getattr(self._seen.definition(section, name), "parent", None)
        if await self._actions.remove(section, name):
            self._drafts.pop(f"{section.key}:{name}", None)
            self.go(section, parent)

    async def _there(self, section: Section, name: str, version: int) -> None:
        """Go to what was changed."""
        await self._until(version)
        self.go(section, name)

    async def _until(self, version: int) -> None:
        """Have the version here that has what was just changed."""
        for _ in range(round(SOON / 0.05)):
            await self._read()
            if self._seen.version >= version:
                break
            await asyncio.sleep(0.05)

    # What happens elsewhere

    async def _read(self) -> None:
        found = await self._desk.ontology.read()
        self._seen.ontology, self._seen.version = Ontology(found.definitions.all_definitions()), found.version
        self._seen.relied = frozenset((one.section.value, one.name) for one in found.required_words)
        self._seen.take((await self._desk.map.read()).objects)

    async def _heard(self, news: News) -> None:
        await self._refresh()

    @guarded
    async def _refresh(self) -> None:
        """See what others changed. A form stays as it is, and says what changed beneath it."""
        before = self._seen.ontology
        await self._read()
        await self._follow_renamed(before)
        if self._editor is not None:
            self._show_index()
            self._editor.look()
        elif [*before] != [*self._seen.ontology]:
            self._show()

    async def _follow_renamed(self, before: Ontology) -> None:
        """What is open and has another name since is open by that one."""
        if self._name is None or self._editor is not None or self._name in self._section.among(self._seen.ontology):
            return
        if self._name not in self._section.among(before):
            return
        for event in (await self._desk.ontology.history(limit=5)).events:
            for one in event.renamed:
                if (one.section.value, one.name) == (self._section.key, self._name):
                    if event.author != author():
                        tell(f"{one.name} is called {one.to} now: {person_name(event.author)} renamed it")
                    self.go(self._section, one.to)
                    return

    async def _look_for_problems(self) -> None:
        """What does not conform as things are: at the definition, or at the type of the object, that it is about."""
        try:
            found = await self._desk.ontology.consider(Define())
        except SomrsError:
            return  # problems are marks beside names; whatever is wrong with the connection is told where something is done
        marks = self._seen.marks(found)
        if marks != self._marks:
            self._marks = marks
            self._show_index()
            if self._editor is None:
                self._show()

    def _troubled(self, draft: Draft, found: Consequences | None) -> None:
        """Mark what a draft would break, while it is not mended."""
        self._wrong.pop(draft.key, None)
        if found is not None:
            self._wrong[draft.key] = self._seen.marks(found)
        self._show_index()

    def _all_marks(self) -> dict[tuple[str, str], str]:
        return {at: text for marks in (self._marks, *self._wrong.values()) for at, text in marks.items()}

    async def _moved(self, news: News) -> None:
        """Objects that come and go are counted; where things are is not shown here."""
        value = news.value
        if isinstance(value, MapNews) and not value.read and not any(isinstance(one, ObjectAdded | ObjectRemoved) for one in value.changes):
            return
        self._seen.take((await self._desk.map.read()).objects)
        self._show_index()
        if self._editor is None and self._section is TYPES:
            self._show()
