"""What a Repository has of its neighbours, as data."""

from __future__ import annotations

from typing import Any

from msgspec import Struct, field

from somrs.kernel.component import Effect
from somrs.kernel.replica import MapReading, Replica
from somrs.kernel.reservations import Reservation
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.knowledge import MapPage, MapSubscribed, OntologyPage, UpdateMap
from somrs.protocol.messages.neighbours import Adopted, Neighbour
from somrs.protocol.messages.reservations import Reserve, Reserved
from somrs.protocol.messages.waits import Holder


class NeighbourDue(Struct, frozen=True, tag=True):
    """The timer of the copy of a neighbour's map."""

    map: str


class NeighbourCopy(Replica):
    """The copy of a neighbour's map, with the neighbour's names. It has what the neighbour shows.

    `leaving`: the objects that the neighbour was handing over to the owner when it was read. `shown`: the places that it shows, if not all.
    """

    map_name: str = ""
    leaving: dict[str, None] = field(default_factory=dict)
    shown: tuple[str, ...] = ()

    def _subscribed(self, answer: MapSubscribed, now: float) -> list[Effect]:
        if (answer.complete, answer.shown) != (self.complete, self.shown):
            self.shown = answer.shown
            self._begin_anew()
        return super()._subscribed(answer, now)

    def _new_reading(self) -> MapReading:
        self.leaving = {}
        return super()._new_reading()

    def _add_page(self, reading: MapReading, page: OntologyPage | MapPage) -> Body | None:
        if isinstance(page, MapPage):
            self.leaving.update(dict.fromkeys(page.leaving))
        return super()._add_page(reading, page)

    @property
    def is_complete(self) -> bool:
        """Whether it has all objects of the neighbour."""
        return self.ready and self.map_name in self.complete

    @property
    def timer(self) -> Any:
        return NeighbourDue(self.map_name)


class NeighbourState(Struct, kw_only=True):
    """A neighbour.

    `omissions`: its objects that are not on this map, by their names there, and why. `adopted`: its objects that have their home here now,
    by their names there, as long as its copy still has them. `postponed`: its objects that are added when a handover to it has ended.
    `expected`: objects that have their home there now, as another neighbour says, and since when they are on this map (seconds since 1970);
    the copy may not have them yet.
    """

    settings: Neighbour
    copy: NeighbourCopy
    omissions: dict[str, str] = field(default_factory=dict)
    adopted: dict[str, None] = field(default_factory=dict)
    postponed: dict[str, None] = field(default_factory=dict)
    expected: dict[str, float] = field(default_factory=dict)
    disagreements: dict[str, str] = field(default_factory=dict)
    """Definitions of its ontology that have another meaning here, or do not fit, and why."""

    @property
    def is_complete(self) -> bool:
        """Whether all its objects are on this map."""
        return self.copy.is_complete and not self.omissions and not self.postponed


class ForwardedUpdate(Struct, kw_only=True):
    """An update of which `parts` change objects of neighbours, by map. They are passed on in this order, and the rest is done when all are.

    `request`: the id of the latest message. `version`: the version in which the current neighbour has its part; the copy has to reach it.
    `since`: when it was sent (seconds since 1970).
    """

    message: Message
    parts: dict[str, UpdateMap]
    request: str = ""
    version: int | None = None
    since: float = 0.0


class Handover(Struct, kw_only=True):
    """An object that gets its home with the neighbour `map`. `adopted`: it has it; the copy of the map has still to show it. `deferred`:
    updates of it that wait for the end. `since`: when it began (seconds since 1970)."""

    id: str
    object: str
    map: str
    adopted: Adopted | None = None
    refused: bool = False
    deferred: list[Message] = field(default_factory=list)
    since: float = 0.0


class SharedReservation(Struct, kw_only=True):
    """What a task has reserved of neighbours.

    `task_manager`: its address. `fences`: the numbers of its reservations, by map; 0 if not known. `request`: its latest request, while it
    is passed on, with the `message`; `waiting`: the maps that are still to answer, in order, or, without a request, the one at which the
    task waits for its turn; `request_id`: that of the message to the first of them.
    `earlier`: what it had here before the request. `overtaken` and `holders`: from the answers so far. `asked`: the maps that know of the
    task, until it has ended. `lost`: the highest numbers under which maps have given away what the task had. `since`: when the request
    came (seconds since 1970).
    """

    task_manager: str
    fences: dict[str, int] = field(default_factory=dict)
    message: Message | None = None
    request: Reserve | None = None
    waiting: list[str] = field(default_factory=list)
    request_id: str = ""
    granted: Reserved | None = None
    earlier: Reservation = Reservation()
    overtaken: tuple[str, ...] = ()
    holders: tuple[Holder, ...] = ()
    asked: dict[str, None] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    since: float = 0.0
