"""Who the neighbours are: the settings at the start, and the list for clients."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from somrs.kernel.component import Effects
from somrs.ontology.objects import objects_of
from somrs.ontology.qualified_names import translated
from somrs.protocol.messages.neighbours import MapNeighbourView, Neighbour, Neighbours
from somrs.repository.importing import Importing
from somrs.repository.neighbour_state import NeighbourCopy, NeighbourState
from somrs.repository.publishing import Publishing
from somrs.repository.state import Contents

ANSWERS_WITHIN = 5.0
"""Seconds within which a neighbour that is there answers."""


class NeighboursConfigured(Struct, frozen=True, tag=True):
    """The name of the map from now on, by which neighbours know it, and its neighbours."""

    map: str
    neighbours: tuple[Neighbour, ...] = ()


class Neighbouring:
    """Has the neighbours as they are configured. It has no state of its own."""

    def __init__(self, contents: Contents, importing: Importing, publishing: Publishing) -> None:
        self._contents, self._importing, self._publishing = contents, importing, publishing

    def start(self, now: float) -> Effects:
        """Follow all neighbours."""
        for neighbour in self._contents.neighbours.values():
            neighbour.copy.owner = self._contents.address
            yield from neighbour.copy.start(now)

    def configure(self, configured: NeighboursConfigured, now: float) -> Effects:
        """Have these neighbours. What the map has of those that stay is kept."""
        contents = self._contents
        if configured.map and configured.map != contents.map.name:
            contents.map = contents.map.named(configured.map)
        settings_by_map = {settings.map: settings for settings in configured.neighbours}
        for map in [*contents.neighbours]:
            # A neighbour to which things are on their way stays until it has answered.
            if map not in settings_by_map and not any(handover.map == map for handover in contents.handovers.values()):
                del contents.neighbours[map]
                yield from self._importing.remove_all(map, now)
        for map, settings in settings_by_map.items():
            earlier_state = contents.neighbours.get(map)
            if earlier_state is not None and earlier_state.settings.address == settings.address:
                sees_other_places = earlier_state.settings != settings
                earlier_state.settings = settings
                if sees_other_places:
                    yield from self._publishing.announce([settings.address], now)
            else:
                copy = NeighbourCopy(contents.address, settings.address, map_name=map)
                contents.neighbours[map] = neighbour = NeighbourState(settings=settings, copy=copy)
                if earlier_state is not None:
                    neighbour.adopted = earlier_state.adopted
                yield from copy.start(now)

    def note_completeness(self, now: float) -> Effects:
        """Let the map, and those who follow it, have the neighbours of which it has all objects."""
        contents = self._contents
        complete = {map for map, neighbour in contents.neighbours.items() if neighbour.is_complete}
        if complete != contents.map.complete:
            contents.map = contents.map.completed(complete)
            neighbours = {neighbour.settings.address for neighbour in contents.neighbours.values()}
            yield from self._publishing.announce((address for address in contents.subscriptions if address not in neighbours), now)

    def views(self, now: float) -> Neighbours:
        """The neighbours, for clients."""
        contents = self._contents
        return Neighbours(map=contents.map.name, neighbours=tuple(self._view(neighbour, now) for neighbour in contents.neighbours.values()))

    def _view(self, neighbour: NeighbourState, now: float) -> MapNeighbourView:
        return MapNeighbourView(
            neighbour=neighbour.settings,
            objects=self._contents.map.count_from(neighbour.settings.map),
            heard_at=neighbour.copy.known_since or None,
            problems=(*self._waits(neighbour.settings.map, now), *self._problems(neighbour)),
        )

    def _waits(self, map: str, now: float) -> Iterator[str]:
        """What has waited for a neighbour for longer than it takes to answer."""
        for handover in self._contents.handovers.values():
            if handover.map == map and handover.adopted is None and now - handover.since >= ANSWERS_WITHIN:
                count = len(handover.deferred)
                updates = f"; {count} {'update of it waits' if count == 1 else 'updates of it wait'} for that" if count else ""
                yield f"{handover.object} gets its home there as soon as {map} answers{updates}"
        updates_on_their_way = [
            forwarded
            for forwarded in self._contents.forwarded.values()
            if next(iter(forwarded.parts)) == map and now - forwarded.since >= ANSWERS_WITHIN
        ]
        for forwarded in updates_on_their_way:
            author = getattr(forwarded.message.body, "author", "") or forwarded.message.header.sender
            names = (objects_of(change)[0] for change in forwarded.parts[map].changes if objects_of(change))
            subjects = dict.fromkeys(translated(name, map, self._contents.map.name) for name in names)
            yield f"an update of {', '.join(subjects)} by {author} waits until {map} answers"
        for shared in self._contents.shared_reservations.values():
            is_late = bool(shared.request_id) and shared.waiting[0] == map and now - shared.since >= ANSWERS_WITHIN
            if is_late and shared.request is not None:
                yield f"the task {shared.request.goal!r} waits until {map} answers whether it may have its objects"

    def _problems(self, neighbour: NeighbourState) -> Iterator[str]:
        copy, settings, contents = neighbour.copy, neighbour.settings, self._contents
        if not contents.map.name:
            yield "the map here has no name by which the neighbour could know it; write `map: NAME` in its file"
        if copy.ready and copy.map.name != settings.map:
            yield f"the map at {settings.address} has the name {copy.map.name or '(none)'}, and not {settings.map}"
        for place in settings.shows:
            if place not in contents.map.objects:
                yield f"there is no place {place} on the map {contents.map.name} that could be shown"
        for name, reason in (*neighbour.omissions.items(), *neighbour.disagreements.items()):
            yield f"{name}: {reason}"
