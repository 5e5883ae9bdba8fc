"""Who the neighbours are: the settings at the start, and the list for clients."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from somrs.kernel.component import Effects
from somrs.protocol.messages.neighbours import MapNeighbourView, Neighbour, Neighbours
from somrs.repository.awaiting import waits
from somrs.repository.importing import Importing
from somrs.repository.neighbour_state import NeighbourCopy, NeighbourState
from somrs.repository.publishing import Publishing
from somrs.repository.state import Contents


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
        own_waits = (wait.text for wait in waits(self._contents, now) if wait.map == neighbour.settings.map)
        return MapNeighbourView(
            neighbour=neighbour.settings,
            objects=self._contents.map.count_from(neighbour.settings.map),
            heard_at=neighbour.copy.known_since or None,
            problems=(*own_waits, *self._problems(neighbour)),
        )

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
