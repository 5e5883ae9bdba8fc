"""The bodies about neighbours of a Repository: other Repositories, each with a map of its own.

A Repository follows the maps of its neighbours, and has their objects on its own map, with qualified names (`Barn:Jar9`). What it is asked
to change or to reserve of them, it passes on to their homes.
"""

from __future__ import annotations

from msgspec import Struct

from somrs.ontology.objects import Fact, Object
from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.reservations import Claim


class Neighbour(Struct, frozen=True, kw_only=True):
    """Another Repository, at an address. Its map has the name `map`.

    `shows`: the places that the neighbour sees of this map, with what is in them; `shows_all`: it sees all. `may_change`: whether it may
    change and reserve objects of this map, and give it others.
    """

    map: str
    address: str
    shows: tuple[str, ...] = ()
    shows_all: bool = False
    may_change: bool = True


class ReadNeighbours(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read the neighbours."""


class MapNeighbourView(Struct, frozen=True, kw_only=True):
    """A neighbour, and what there is of it: its `objects` on this map, by number. `heard_at`: when its version was heard last (seconds
    since 1970); None: never. `problems`: what is not on this map, and why."""

    neighbour: Neighbour
    objects: int = 0
    heard_at: float | None = None
    problems: tuple[str, ...] = ()


class Neighbours(MessageBody, frozen=True, kw_only=True, tag=True):
    """The answer to ReadNeighbours: the name of the map, and its neighbours."""

    map: str
    neighbours: tuple[MapNeighbourView, ...] = ()


class NeighbourAwaited(MessageBody, frozen=True, kw_only=True, tag=True):
    """To a Task Manager: its request with the id `request`, for a task, waits until the neighbour with the map `map` answers what is asked
    about these objects, `since` (seconds since 1970)."""

    task: str
    request: str
    map: str
    objects: tuple[str, ...]
    since: float


class Adopt(MessageBody, frozen=True, kw_only=True, tag=True):
    """To a neighbour: an object has come to a place of its map, which becomes its home. `handover` identifies this move.

    `facts`: those that begin with it, as on the map of the sender. `times`: when the latest news about each of its aspects held.
    `claims`: the tasks that have reserved it to change it; `had`: those that had done so before, and have not ended; `overtaken`: those of
    them after which other tasks have changed it.
    """

    handover: str
    object: Object
    facts: tuple[Fact, ...] = ()
    times: dict[str, float] = {}
    claims: tuple[Claim, ...] = ()
    had: tuple[Claim, ...] = ()
    overtaken: tuple[str, ...] = ()


class Adopted(MessageBody, frozen=True, kw_only=True, tag=True):
    """The object has its home here now, under this name. `fences`: the numbers of the reservations, by task for which the sender of
    Adopt reserves. `version`: that of the map with it."""

    handover: str
    name: str
    version: int
    fences: dict[str, int] = {}


class AdoptionRefused(MessageBody, frozen=True, kw_only=True, tag=True):
    """The object does not fit here. It keeps its home."""

    handover: str
    problems: tuple[str, ...]
