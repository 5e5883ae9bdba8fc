"""Who the neighbours are: they are set, removed and listed by messages."""

from __future__ import annotations

from collections.abc import Iterator

from somrs.errors import InputError
from somrs.kernel.component import Effects
from somrs.ontology.qualified_names import home_of
from somrs.protocol.messages.neighbours import NameMap, Neighbour, Neighbours, NeighbourView, ReadNeighbours, RemoveNeighbour, SetNeighbour
from somrs.repository.importing import Importing
from somrs.repository.names import is_name
from somrs.repository.neighbour_state import NeighbourCopy, NeighbourState
from somrs.repository.state import Contents


class Neighbouring:
    """Handles the messages about neighbours. It has no state of its own."""

    def __init__(self, contents: Contents, importing: Importing) -> None:
        self._contents, self._importing = contents, importing

    def start(self, now: float) -> Effects:
        """Follow all neighbours."""
        for neighbour in self._contents.neighbours.values():
            yield from neighbour.copy.start(now)

    def serve(self, body: NameMap | SetNeighbour | RemoveNeighbour | ReadNeighbours, now: float) -> Effects:
        """Do what a client asks. Raises InputError."""
        match body:
            case NameMap(name=name):
                self.name_map(name)
            case SetNeighbour(neighbour=neighbour):
                yield from self.set_neighbour(neighbour, now)
            case RemoveNeighbour(map=map):
                yield from self.remove_neighbour(map, now)

    def at(self, address: str) -> Neighbour | None:
        """The neighbour at an address."""
        return next((state.settings for state in self._contents.neighbours.values() if state.settings.address == address), None)

    def name_map(self, name: str) -> None:
        """Raises InputError for what is no name, and while there are neighbours."""
        contents = self._contents
        if not is_name(name):
            raise InputError(f"{name!r} is not a name that formulas can use; use letters, digits, _ and -, and begin with a letter")
        if contents.neighbours and name != contents.map.name:
            knowing = f"{', '.join(contents.neighbours)} know{'s' if len(contents.neighbours) == 1 else ''} the map as {contents.map.name}"
            raise InputError(f"{knowing}; remove the neighbours first, and set them again under the new name")
        contents.map = contents.map.named(name)

    def set_neighbour(self, settings: Neighbour, now: float) -> Effects:
        """Raises InputError for a neighbour that cannot be one."""
        contents = self._contents
        if problem := next(self._problems(settings), None):
            raise InputError(problem)
        earlier_state = contents.neighbours.get(settings.map)
        if earlier_state is not None and earlier_state.settings.address == settings.address:
            earlier_state.settings = settings
        else:
            copy = NeighbourCopy(contents.address, settings.address, map_name=settings.map)
            contents.neighbours[settings.map] = neighbour = NeighbourState(settings=settings, copy=copy)
            if earlier_state is not None:
                neighbour.adopted = earlier_state.adopted
            yield from copy.start(now)

    def _problems(self, settings: Neighbour) -> Iterator[str]:
        contents = self._contents
        if not contents.map.name:
            yield "the map has no name by which a neighbour could know it; name it first: `somrs neighbours name NAME`"
        if not is_name(settings.map):
            yield f"{settings.map!r} is not the name of a map; use letters, digits, _ and -, and begin with a letter"
        if settings.map == contents.map.name:
            yield f"the map itself has the name {settings.map}; maps of neighbours have different names"
        if settings.address == contents.address:
            yield f"{settings.address} is the address of this Repository itself; give that of the neighbour"
        for neighbour in contents.neighbours.values():
            if neighbour.settings.address == settings.address and neighbour.settings.map != settings.map:
                yield f"{settings.address} is the neighbour {neighbour.settings.map} already; remove it first, if its map is renamed"
        for place in settings.shows:
            if place not in contents.map.objects or home_of(place):
                yield f"there is no place {place} on the map {contents.map.name} that could be shown; name objects of this map"

    def remove_neighbour(self, map: str, now: float) -> Effects:
        """Raises InputError if there is no such neighbour."""
        if map not in self._contents.neighbours:
            neighbour_names = ", ".join(self._contents.neighbours) or "none"
            raise InputError(f"there is no neighbour {map}; the neighbours are: {neighbour_names}")
        if leaving := [handover.object for handover in self._contents.handovers.values() if handover.map == map]:
            raise InputError(f"{', '.join(leaving)} is being handed over to {map}; remove the neighbour when it has answered")
        del self._contents.neighbours[map]
        yield from self._importing.remove_all(map, now)

    def views(self) -> Neighbours:
        """The neighbours, for clients."""
        contents = self._contents
        return Neighbours(map=contents.map.name, neighbours=tuple(self._view(neighbour) for neighbour in contents.neighbours.values()))

    def _view(self, neighbour: NeighbourState) -> NeighbourView:
        copy, settings = neighbour.copy, neighbour.settings
        problems = [f"{name}: {reason}" for name, reason in (*neighbour.left_out.items(), *neighbour.disagreements.items())]
        if copy.ready and copy.map.name != settings.map:
            problems.insert(0, f"the map at {settings.address} has the name {copy.map.name or '(none)'}, and not {settings.map}")
        return NeighbourView(
            neighbour=settings,
            objects=self._contents.map.count_from(settings.map),
            heard_at=copy.known_since or None,
            problems=tuple(problems),
        )
