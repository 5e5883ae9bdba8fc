"""What a neighbour sees of the map: own objects, in places that are shown to it. What is of others, it asks their homes."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from itertools import chain

from msgspec import structs

from somrs.ontology.map import Map
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet, objects_of
from somrs.ontology.qualified_names import home_of
from somrs.ontology.types import PART_OF, Ontology
from somrs.protocol.messages.knowledge import Event, MapChanged, MapPage, OntologyChanged
from somrs.protocol.messages.neighbours import Neighbour
from somrs.protocol.messages.paging import fit_page
from somrs.repository.association import exclusive_relations


class View:
    """A neighbour's view of a map."""

    def __init__(self, neighbour: Neighbour, map: Map, ontology: Ontology) -> None:
        self._neighbour, self._map = neighbour, map
        self._locating = (PART_OF, *exclusive_relations(ontology))

    def shows(self, name: str) -> bool:
        """Whether the neighbour sees the object: where the map is shown to it, and what its own things and devices have."""
        if home_of(name) or name not in self._map.objects:
            return False
        shown_places, map = self._neighbour.shows, self._neighbour.map
        return self._neighbour.shows_all or any(place in shown_places or home_of(place) == map for place in self._whereabouts(name))

    def shows_name(self, name: str) -> bool:
        """Whether it may know the name of an object that it sees, that has left for its own map, or, if it sees all, for another one."""
        return self.shows(name) or (bool(home_of(name)) and (self._neighbour.shows_all or home_of(name) == self._neighbour.map))

    def shows_fact(self, fact: Fact) -> bool:
        """Whether it sees the fact. Whether it sees objects of others in it, it knows from them."""
        return (
            bool(fact.arguments) and self.shows(fact.arguments[0]) and all(home_of(name) or self.shows(name) for name in fact.arguments[1:])
        )

    def facts_from(self, name: str) -> Iterator[Fact]:
        return (fact for fact in self._map.facts_from(name) if self.shows_fact(fact))

    def page(self, version: int, last_name: str, leaving: Container[str]) -> MapPage:
        """The page that follows an object, in the order of names. `leaving`: the objects that the neighbour is getting."""
        names = (name for name in self._map.names_after(last_name) if self.shows(name))
        page = list(fit_page((self._map.objects[name], [*self.facts_from(name)]) for name in names))
        has_next_page = bool(page) and any(self.shows(name) for name in self._map.names_after(page[-1][0].name))
        facts = tuple(chain.from_iterable(facts for _, facts in page))
        return MapPage(
            objects=tuple(object for object, _ in page),
            facts=facts,
            version=version,
            more=has_next_page,
            map=self._map.name,
            leaving=tuple(object.name for object, _ in page if object.name in leaving),
        )

    def within(self, names: Iterable[str]) -> set[str]:
        """The objects, and all that is in or on them, if it depends on the place what the neighbour sees."""
        reached = set(names)
        pending = [*reached] if not self._neighbour.shows_all else []
        while pending:
            place = pending.pop()
            for relation in self._locating:
                for arguments in self._map.facts_with(relation, 1, place):
                    if arguments[0] not in reached:
                        reached.add(arguments[0])
                        pending.append(arguments[0])
        return reached

    def _whereabouts(self, name: str) -> Iterator[str]:
        """The object, what it is in, on or part of, and so on."""
        reached, pending = {name}, [name]
        while pending:
            current = pending.pop()
            yield current
            for relation in self._locating:
                for arguments in self._map.facts_with(relation, 0, current):
                    if len(arguments) == 2 and arguments[1] not in reached:
                        reached.add(arguments[1])
                        pending.append(arguments[1])


def view_of_news(
    news: MapChanged | OntologyChanged, neighbour: Neighbour, map_before: Map, map_after: Map, ontology: Ontology
) -> MapChanged | OntologyChanged:
    """The news as a neighbour is told it, possibly without a change: so it has every version."""
    view_before, view_after = View(neighbour, map_before, ontology), View(neighbour, map_after, ontology)
    event = news.event if isinstance(news, MapChanged) else news
    changes = tuple(_seen_changes(event.changes, view_before, view_after, map_before, map_after))
    renamed = tuple(
        renaming for renaming in event.renamed if renaming.section is not Section.OBJECTS or _is_seen(renaming, view_before, view_after)
    )
    if isinstance(news, OntologyChanged):
        return structs.replace(news, changes=changes, renamed=renamed)
    merged = tuple(merging for merging in news.event.merged if view_before.shows(merging.name) and view_after.shows(merging.into))
    event = Event(version=news.event.version, at=news.event.at, author=news.event.author, changes=changes, renamed=renamed, merged=merged)
    return MapChanged(event=event)


def _is_seen(renaming: Renaming, view_before: View, view_after: View) -> bool:
    return view_before.shows(renaming.name) and (view_after.shows(renaming.to) or bool(home_of(renaming.to)))


def _seen_changes(changes: Sequence[Change], view_before: View, view_after: View, map_before: Map, map_after: Map) -> Iterator[Change]:
    touched = [objects_of(change)[0] for change in changes if objects_of(change)]
    names = sorted(view_before.within(touched) | view_after.within(touched))
    visible_before, visible_after = {name: view_before.shows(name) for name in names}, {name: view_after.shows(name) for name in names}
    yield from (change for change in changes if isinstance(change, FactRemoved) and view_before.shows_fact(change.fact))
    for name in names:
        replaced = visible_before[name] and visible_after[name] and map_before.objects[name].type != map_after.objects[name].type
        if visible_before[name] and (not visible_after[name] or replaced):
            yield ObjectRemoved(name)
    appeared: list[Object] = []
    for name in names:
        if visible_after[name] and (not visible_before[name] or map_before.objects[name].type != map_after.objects[name].type):
            appeared.append(map_after.objects[name])
    yield from map(ObjectAdded, appeared)
    appeared_names = {object.name for object in appeared}
    for change in changes:
        match change:
            case ValueSet(name) if name not in appeared_names and visible_after[name]:
                yield change
            case FactAdded(fact) if fact.arguments and fact.arguments[0] not in appeared_names and view_after.shows_fact(fact):
                yield change
    told_facts = {change.fact for change in changes if isinstance(change, FactAdded)}
    for name in (object.name for object in appeared):
        yield from map(FactAdded, view_after.facts_from(name))
        facts_about = (fact for fact in map_after.facts_about(name) if fact not in told_facts and view_after.shows_fact(fact))
        yield from (FactAdded(fact) for fact in facts_about if fact.arguments[0] not in appeared_names)
