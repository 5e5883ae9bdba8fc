"""The relations that an object is in: read, added, taken away."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.pages.map.picker import ObjectPicker
from somrs.gui.shell import guarded, tell
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Map
from somrs.ontology.types import Ontology, RelationType

MOST = 40
"""So many facts of an object are listed."""

Change_ = Callable[[tuple[Change, ...], str], Awaitable[int | None]]
"""Changes the map, and says what was done; None when that was refused."""


@dataclass(frozen=True, slots=True)
class Seat:
    """A relation that an object of a type can be in, and as which of its arguments, counted from 0."""

    relation: RelationType
    place: int

    @property
    def key(self) -> str:
        return f"{self.relation.name} {self.place}"

    def text(self) -> str:
        """The relation as one reads it, with the object as `this`."""
        words = ["this" if n == self.place else one for n, one in enumerate(self.relation.joins)]
        if len(words) == 2:
            return f"{words[0]} {self.relation.name} {words[1]}"
        return f"{self.relation.name}({', '.join(words)})"

    def fact(self, name: str, others: list[str]) -> Fact:
        arguments = [*others]
        arguments.insert(self.place, name)
        return Fact(self.relation.name, tuple(arguments))


def seats(type_name: str, ontology: Ontology) -> list[Seat]:
    """All that objects of the type can be in; of a symmetric relation, one way round will do."""
    found = [
        Seat(relation, place)
        for relation in ontology.relations.values()
        for place, joined in enumerate(relation.joins)
        if ontology.is_subtype(type_name, joined) and not (relation.symmetric and place)
    ]
    return sorted(found, key=lambda seat: (seat.place, seat.relation.name))


def added(fact: Fact, map: Map, ontology: Ontology) -> Iterator[Change]:
    """The changes that make a fact hold: what cannot hold along with it goes."""
    relation = ontology.relations[fact.relation]
    for other in map.facts_about(fact.arguments[0]):
        if other.arguments[0] != fact.arguments[0] or other == fact:
            continue
        rival = ontology.relations.get(other.relation)
        group = rival is not None and relation.excludes is not None and rival.excludes == relation.excludes and rival.name != relation.name
        if group or (relation.functional and other.relation == relation.name):
            yield FactRemoved(other)
    yield FactAdded(fact)


class Relations:
    """What is in the list follows the map; `go` opens another object."""

    def __init__(self, desk: LiveApi, name: str, change: Change_, go: Callable[[str], None]) -> None:
        self._desk, self._name, self._change, self._go = desk, name, change, go
        self._shown: list[Fact] | None = None
        self._list = ui.element("ul").classes("somrs-map-facts").props('aria-label="Relations"')
        with ui.element("div").classes("somrs-map-adding") as self._form:
            ui.button("Add a relation", icon="add_link", on_click=self._open).props("flat dense no-caps")
        self.refresh()

    def refresh(self) -> None:
        map = self._desk.context.map
        if self._name not in map.objects:
            self._form.visible = False
            return
        self._form.visible = True
        facts = sorted(map.facts_about(self._name), key=lambda fact: (fact.arguments[0] != self._name, fact.relation, fact.arguments))
        if facts == self._shown:
            return
        self._shown = facts
        self._list.clear()
        with self._list:
            for fact in facts[:MOST]:
                self._row(fact)
            if len(facts) > MOST:
                ui.label(f"and {len(facts) - MOST} more").classes("somrs-soft")
            if not facts:
                ui.label("It is in no relation.").classes("somrs-soft")

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
            button.props(f'flat round dense size=sm aria-label="Take away: {fact}"').tooltip("Take it away")

    def _word(self, name: str) -> None:
        if name == self._name:
            ui.label("this").classes("somrs-soft")
        else:
            ui.button(name, on_click=lambda: self._go(name)).props("flat dense no-caps").classes("somrs-map-link")

    async def _remove(self, fact: Fact) -> None:
        await self._change((FactRemoved(fact),), f"{fact} does not hold any more")

    # Adding

    def _open(self) -> None:
        map, ontology = self._desk.context.map, self._desk.context.ontology
        object = map.objects.get(self._name)
        if object is None:
            return
        options = {seat.key: seat for seat in seats(object.type, ontology)}
        self._form.clear()
        with self._form, ui.element("form").props('aria-label="Add a relation" novalidate') as form:
            choice = ui.select({key: seat.text() for key, seat in options.items()}, label="Relation", with_input=True)
            choice.props("outlined dense options-dense autofocus hide-bottom-space")
            pickers: list[ObjectPicker] = []
            fields = ui.element("div").classes("somrs-map-pickers")

            def chosen() -> None:
                fields.clear()
                pickers.clear()
                seat = options.get(str(choice.value))
                if seat is None:
                    return
                with fields:
                    for place, joined in enumerate(seat.relation.joins):
                        if place != seat.place:
                            pickers.append(ObjectPicker(self._desk, joined, seat.relation.name, place))
                pickers[0].focus()

            async def add() -> None:
                seat = options.get(str(choice.value))
                if seat is None or any(picker.value is None for picker in pickers):
                    tell("Choose the relation, and what it joins this with.", bad=True)
                    return
                fact = seat.fact(self._name, [picker.value or "" for picker in pickers])
                now = self._desk.context
                if await self._change(tuple(added(fact, now.map, now.ontology)), f"{fact} holds now") is not None:
                    self._close()

            choice.on_value_change(chosen)
            form.on("submit.prevent", guarded(add))
            with ui.element("div").classes("somrs-map-buttons"):
                ui.button("Add", icon="check").props("unelevated dense no-caps type=submit")
                ui.button("Not now", on_click=self._close).props("flat dense no-caps")

    def _close(self) -> None:
        self._form.clear()
        with self._form:
            ui.button("Add a relation", icon="add_link", on_click=self._open).props("flat dense no-caps")
