"""The relations of an object: list, add, remove."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.components.fields.picker import Choice, Picker, things
from somrs.gui.pages.map.entries import list_note
from somrs.gui.shell import guarded, notify
from somrs.gui.submission import submit_once
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved
from somrs.ontology.types import Ontology, RelationType

MAX_FACTS = 40
"""Limit of facts listed."""

ChangeMap = Callable[[tuple[Change, ...], str], Awaitable[int | None]]
"""Changes the map and notifies the user; returns the new version, None if the change was refused."""


@dataclass(frozen=True, slots=True)
class RelationRole:
    """A relation that objects of a type can be in, and the argument (`place`, counted from 0) that they can be."""

    relation: RelationType
    place: int

    @property
    def key(self) -> str:
        return f"{self.relation.name} {self.place}"

    def text(self) -> str:
        """The relation as a text, with `this` for the object."""
        words = ["this" if n == self.place else type_name for n, type_name in enumerate(self.relation.joins)]
        if len(words) == 2:
            return f"{words[0]} {self.relation.name} {words[1]}"
        return f"{self.relation.name}({', '.join(words)})"

    def fact(self, name: str, other_names: list[str]) -> Fact:
        arguments = [*other_names]
        arguments.insert(self.place, name)
        return Fact(self.relation.name, tuple(arguments))


def relation_roles(type_name: str, ontology: Ontology) -> list[RelationRole]:
    """The roles that objects of the type can have; of a symmetric relation, one."""
    candidates = [
        RelationRole(relation, place)
        for relation in ontology.relations.values()
        for place, joined in enumerate(relation.joins)
        if ontology.is_subtype(type_name, joined) and not (relation.symmetric and place)
    ]
    return sorted(candidates, key=lambda role: (role.place, role.relation.name))


def fact_changes(fact: Fact, map: Map, ontology: Ontology) -> Iterator[Change]:
    """The changes that make a fact hold and remove facts that exclude it."""
    relation = ontology.relations[fact.relation]
    for old_fact in map.facts_about(fact.arguments[0]):
        if old_fact.arguments[0] != fact.arguments[0] or old_fact == fact:
            continue
        rival = ontology.relations.get(old_fact.relation)
        group = rival is not None and relation.excludes is not None and rival.excludes == relation.excludes and rival.name != relation.name
        if group or (relation.functional and old_fact.relation == relation.name):
            yield FactRemoved(old_fact)
    yield FactAdded(fact)


class Relations:
    """The list follows the map; `open_object` opens another object."""

    def __init__(self, api: LiveApi, name: str, change: ChangeMap, open_object: Callable[[str], None]) -> None:
        self._api, self._name, self._change, self._open_object = api, name, change, open_object
        self._shown_facts: list[Fact] | None = None
        self._list = ui.element("ul").classes("somrs-map-facts").props('aria-label="Relations"')
        with ui.element("div").classes("somrs-map-adding") as self._form:
            ui.button("Add a relation", icon="add_link", on_click=self._open).props("flat dense no-caps")
        self.refresh()

    def refresh(self) -> None:
        map = self._api.context.map
        if self._name not in map.objects:
            self._form.visible = False
            return
        self._form.visible = True
        facts = sorted(map.facts_about(self._name), key=lambda fact: (fact.arguments[0] != self._name, fact.relation, fact.arguments))
        if facts == self._shown_facts:
            return
        self._shown_facts = facts
        self._list.clear()
        with self._list:
            for fact in facts[:MAX_FACTS]:
                self._row(fact)
            if len(facts) > MAX_FACTS:
                list_note(f"and {len(facts) - MAX_FACTS} more")
            if not facts:
                list_note("No relations.")

    def _row(self, fact: Fact) -> None:
        with ui.element("li").classes("somrs-map-fact"):
            with ui.element("span").classes("somrs-map-fact-text"):
                if len(fact.arguments) == 2:
                    self._word(fact.arguments[0])
                    ui.label(fact.relation).classes("somrs-map-relation")
                    self._word(fact.arguments[1])
                else:
                    ui.label(fact.relation).classes("somrs-map-relation")
                    for argument in fact.arguments:
                        self._word(argument)
            button = ui.button(icon="link_off", on_click=guarded(lambda: self._remove(fact)))
            button.props(f'flat round dense size=sm aria-label="Delete {fact}"').tooltip("Delete")

    def _word(self, name: str) -> None:
        if name == self._name:
            ui.label("this").classes("somrs-soft")
        else:
            ui.button(name, on_click=lambda: self._open_object(name)).props("flat dense no-caps").classes("somrs-map-link")

    async def _remove(self, fact: Fact) -> None:
        await self._change((FactRemoved(fact),), f"{fact} removed")

    # Adding

    def _open(self) -> None:
        map, ontology = self._api.context.map, self._api.context.ontology
        object = map.objects.get(self._name)
        if object is None:
            return
        options = {role.key: role for role in relation_roles(object.type, ontology)}
        self._form.clear()
        with self._form, ui.element("form").props('aria-label="Add a relation" novalidate') as form:
            pickers: list[Picker] = []

            def chosen(key: str) -> None:
                fields.clear()
                pickers.clear()
                role = options[key]
                with fields:
                    for place, joined in enumerate(role.relation.joins):
                        if place != role.place:
                            pickers.append(Picker(joined, placeholder=joined, source=things(relation=role.relation.name, place=place)))
                pickers[0].focus()

            async def add() -> bool:
                role = options.get(choice.value)
                if role is None or not all(picker.value for picker in pickers):
                    notify("Choose the relation and the other objects.", bad=True)
                    return False
                fact = role.fact(self._name, [picker.value for picker in pickers])
                now = self._api.context
                if await self._change(tuple(fact_changes(fact, now.map, now.ontology)), f"{fact} added") is None:
                    return False
                self._close()
                return True

            choices = [Choice(value=key, text=role.text(), detail=role.relation.doc) for key, role in options.items()]
            choice = Picker("Relation", placeholder="Relation", options=choices, on_pick=chosen)
            fields = ui.element("div").classes("somrs-map-pickers")
            with ui.element("div").classes("somrs-map-buttons"):
                add_button = ui.button("Add", icon="check").props("unelevated dense no-caps type=submit")
                ui.button("Cancel", on_click=self._close).props("flat dense no-caps")
            submit_once(form, add_button, add)
        choice.focus()

    def _close(self) -> None:
        self._form.clear()
        with self._form:
            ui.button("Add a relation", icon="add_link", on_click=self._open).props("flat dense no-caps")
