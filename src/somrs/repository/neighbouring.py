"""Who the neighbours are: the settings at the start, and the list for clients."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from somrs.kernel.component import Effects
from somrs.protocol.messages.neighbours import MapNeighbourView, Neighbour, Neighbours
from somrs.repository.importing import Importing
from somrs.repository.neighbour_state import NeighbourCopy, NeighbourState
from somrs.repository.state import Contents


class NeighboursConfigured(Struct, frozen=True, tag=True):
    """The name of the map from now on, by which neighbours know it, and its neighbours."""

    map: str
    neighbours: tuple[Neighbour, ...] = ()


class Neighbouring:
    """Has the neighbours as they are configured. It has no state of its own."""

    def __init__(self, contents: Contents, importing: Importing) -> None:
        self._contents, self._importing = contents, importing

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
                if earlier_state.settings != settings:
                    contents.subscriptions.pop(settings.address, None)  # it sees something else now, and reads it anew
                earlier_state.settings = settings
            else:
                copy = NeighbourCopy(contents.address, settings.address, map_name=map)
                contents.neighbours[map] = neighbour = NeighbourState(settings=settings, copy=copy)
                if earlier_state is not None:
                    neighbour.adopted = earlier_state.adopted
                yield from copy.start(now)

    def views(self) -> Neighbours:
        """The neighbours, for clients."""
        contents = self._contents
        return Neighbours(map=contents.map.name, neighbours=tuple(self._view(neighbour) for neighbour in contents.neighbours.values()))

    def _view(self, neighbour: NeighbourState) -> MapNeighbourView:
        return MapNeighbourView(
            neighbour=neighbour.settings,
            objects=self._contents.map.count_from(neighbour.settings.map),
            heard_at=neighbour.copy.known_since or None,
            problems=tuple(self._problems(neighbour)),
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
