"""The left side of the page: the definitions of a section as a searchable tree."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from somrs.gui.components.fields.tree import Node, Tree
from somrs.gui.pages.ontology.ontology_view import OntologyView
from somrs.gui.pages.ontology.sections import SECTION, SECTIONS, SERVICES, TYPES, Section

Marks = Mapping[tuple[str, str], str]
"""Problems of definitions, by section and name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexCallbacks:
    """Callbacks of the index."""

    switch_section: Callable[[Section], None]
    open_definition: Callable[[Section, str], None]
    move: Callable[[Section, str, str], Awaitable[None]]
    new: Callable[[Section], None]


class Index:
    def __init__(self, view: OntologyView, callbacks: IndexCallbacks) -> None:
        self._view, self._callbacks = view, callbacks
        self.section = TYPES
        self._tree: Tree | None = None
        self._marks: Marks = {}
        self._drafts: set[str] = set()
        with ui.element("aside").classes("somrs-sheet somrs-onto-index").props('aria-label="All definitions"'):
            with ui.tabs(on_change=self._switch_tab).props("dense no-caps inline-label") as self._tabs:
                for section in SECTIONS:
                    ui.tab(section.key, label=section.label)
            self._body = ui.element("div").classes("somrs-onto-index-body")
            self._new = ui.button("", icon="add", on_click=lambda: callbacks.new(self.section)).props("flat no-caps")
            self._new.classes("somrs-onto-new")

    def _switch_tab(self, event: ValueChangeEventArguments[Any]) -> None:
        section = SECTION[str(event.value)]
        if section is not self.section:
            self._callbacks.switch_section(section)

    def render(self, section: Section, name: str | None, marks: Marks, drafts: set[str]) -> None:
        """Show a section and mark the open definition."""
        self._marks = marks
        nodes = self._nodes(section, marks, drafts)
        if section is not self.section or self._tree is None:
            self.section = section
            self._tabs.value = section.key
            self._body.clear()
            with self._body:
                movable = section in (TYPES, SERVICES)
                self._tree = Tree(
                    section.label,
                    f"Find {section.label.lower()}",
                    lambda id: self._callbacks.open_definition(section, id),
                    (lambda id, new_parent: self._callbacks.move(section, id, new_parent)) if movable else None,
                    nodes,
                )
            self._new.text = f"New {section.singular}"
        self._tree.show_nodes(nodes)
        self._tree.select(name)

    def mark_drafts(self, drafts: set[str]) -> None:
        """Mark the definitions with unsaved drafts."""
        if self._tree is not None and drafts != self._drafts:
            self._tree.show_nodes(self._nodes(self.section, self._marks, drafts))

    def _nodes(self, section: Section, marks: Marks, drafts: set[str]) -> list[Node]:
        counts = self._view.counts() if section is TYPES else {}
        self._drafts = set(drafts)
        nodes = []
        for name, definition in sorted(section.definitions_in(self._view.ontology).items()):
            node = Node(id=name, label=name, parent=getattr(definition, "parent", None))
            if count := counts.get(name):
                node["count"] = count
            if problem := marks.get((section.key, name)):
                node["problem"] = problem
            if f"{section.key}:{name}" in drafts:
                node["draft"] = True
            nodes.append(node)
        return nodes
