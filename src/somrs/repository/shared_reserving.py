"""Reserves objects of several maps for a task of this Repository: each map has its objects reserved at their home.

The maps are asked one after the other, in the order of their names, and a task that has to wait at one of them holds nothing at any. So
tasks of different Repositories cannot deadlock. Here, the objects of neighbours are reserved, too, so that tasks of this Repository find
each other without asking. To its neighbours, a Repository is what a Task Manager is to it.

The numbers of messages about reservations (`serial`) are doubled on the way to neighbours, so that there is one for releasing what a
request has got, after the request and before the next.
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import structs

from somrs.kernel.component import Effects, Send
from somrs.kernel.reservations import Reservation
from somrs.ontology.qualified_names import home_of, plain_name, translated
from somrs.protocol.messages.envelope import Message, message_id, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.reservations import (
    ClaimReservations,
    Release,
    ReservationDenied,
    ReservationFree,
    ReservationLost,
    ReservationMode,
    Reserve,
    Reserved,
)
from somrs.protocol.messages.waits import Holder
from somrs.repository.forwarding import notice, request, tell
from somrs.repository.neighbour_state import NeighbourState, SharedReservation
from somrs.repository.reserving import Reserving
from somrs.repository.state import Contents

Answering = Callable[[Message, Reserved | ReservationDenied], Send]
"""Gives the answer to a request, and remembers it."""


class SharedReserving:
    """Reserves at neighbours. It has no state of its own."""

    def __init__(self, contents: Contents, reserving: Reserving, answer: Answering) -> None:
        self._contents, self._reserving, self._answer = contents, reserving, answer

    # Requests of tasks

    def concerns_neighbours(self, request: Reserve) -> bool:
        """Whether some of the objects are those of neighbours, or the task has such objects or waits for them."""
        shared = self._contents.shared_reservations.get(request.task)
        has_some = shared is not None and bool(shared.fences or shared.waiting)
        return has_some or any(home_of(name) for name in (*request.changes, *request.relies_on))

    def begin(self, message: Message, request: Reserve, now: float) -> Effects:
        """Ask the homes of all objects, the first one now."""
        shared = self._contents.shared_reservations.setdefault(request.task, SharedReservation(task_manager=message.header.sender))
        if shared.request is not None and shared.request.serial >= request.serial:
            return  # it is under way, or a later one is
        self._note_homes(request.task, shared)
        homes = {home_of(name) for name in (*request.changes, *request.relies_on)}
        # Where it waited for objects that it does not need any more, it must not hinder others.
        yield from self._release_at({*shared.waiting[:1]} - homes, request.task, 2 * request.serial - 2, False, now)
        if shared.message is not None:  # of the request before it has no more than it had
            self._contents.reservations.restrict(request.task, self._earlier(shared))
            yield self._answer(shared.message, ReservationDenied(task=request.task, holders=()))
        shared.task_manager, shared.message, shared.request = message.header.sender, message, request
        shared.waiting, shared.request_id = sorted({*homes - {""}, self._own_map}), ""
        shared.granted, shared.overtaken, shared.holders, shared.since = None, (), (), now
        claimant = self._contents.reservations.claimants.get(request.task)
        shared.earlier = claimant.held if claimant is not None else Reservation()
        yield from self._ask_next(request.task, now)

    def yield_claimed(self, name: str, home: str) -> None:
        """An object comes from this home to the own map, where tasks that have only asked the home for it do not have it.

        They ask for it here again, after the home has answered: the home may have given it to them in the meantime.
        """
        reservations = self._contents.reservations
        for task, shared in self._contents.shared_reservations.items():
            claimant = reservations.claimants.get(task)
            if shared.request is None or home not in shared.waiting or self._own_map in shared.waiting or claimant is None:
                continue
            earlier = self._earlier(shared)
            if name in claimant.held.changes | claimant.held.relies_on and name not in earlier.changes | earlier.relies_on:
                reservations.restrict(task, earlier)
                claimant.serial = shared.request.serial - 1
                shared.waiting.append(self._own_map)

    @property
    def is_waiting(self) -> bool:
        """Whether an answer of a neighbour is due."""
        return any(shared.request_id for shared in self._contents.shared_reservations.values())

    def repeat(self, now: float) -> Effects:
        """Ask again, in case that an answer was lost."""
        for task, shared in [*self._contents.shared_reservations.items()]:
            if shared.request_id:
                yield from self._ask_next(task, now)

    def release(self, release: Release, sender: str, now: float) -> Effects:
        """A task releases what it has, also of neighbours, unless a later message of the task has come before.

        Another Repository that had some of it does not speak for the task.
        """
        shared = self._contents.shared_reservations.get(release.task)
        if shared is None or shared.task_manager != sender or release.serial < self._latest_serial(release.task, shared):
            return
        self._note_homes(release.task, shared)
        maps = {*shared.fences, *shared.waiting[:1], *(shared.asked if release.ended else ())}
        yield from self._release_at(maps, release.task, 2 * release.serial, release.ended, now)
        if shared.message is not None:
            yield self._answer(shared.message, ReservationDenied(task=release.task, holders=()))
        if release.ended:
            del self._contents.shared_reservations[release.task]
        else:
            kept = SharedReservation(task_manager=shared.task_manager, asked=shared.asked, lost=shared.lost)
            self._contents.shared_reservations[release.task] = kept

    def forget_unclaimed(self, claims: ClaimReservations, sender: str, now: float) -> Effects:
        """A Task Manager has said all that its tasks have: release what others of its tasks have of neighbours."""
        claimed = {claim.task for claim in claims.claims}
        for task, shared in [*self._contents.shared_reservations.items()]:
            if shared.task_manager == sender and task not in claimed:
                yield from self.release(Release(task=task, serial=claims.serial, ended=True), sender, now)

    def _latest_serial(self, task: str, shared: SharedReservation) -> int:
        under_way = shared.request.serial if shared.request is not None else -1
        return max(under_way, self._contents.reservations.last_serial(task))

    def _note_homes(self, task: str, shared: SharedReservation) -> None:
        """What the task has may have got its home at another map, which has the reservation since."""
        claimant = self._contents.reservations.claimants.get(task)
        for name in (*claimant.held.changes, *claimant.held.relies_on) if claimant is not None else ():
            if home := home_of(name):
                shared.fences.setdefault(home, 0)

    # Answers and notices of neighbours

    def concerns(self, message: Message) -> bool:
        """Whether the message is the answer to a request, or a notice, of a neighbour."""
        is_notice = isinstance(message.body, Reserved) and message.header.relates_to is None
        is_notice = is_notice or isinstance(message.body, ReservationFree | ReservationLost)
        return is_notice or self._asking(message.header.relates_to) is not None

    def received(self, message: Message, now: float) -> Effects:
        """Handle an answer or a notice."""
        task = self._asking(message.header.relates_to)
        neighbour = self._contents.neighbour_at(message.header.sender)
        match message.body:
            case Reserved() as reserved if task is not None:
                yield from self._granted(task, reserved, now)
            case ReservationDenied(holders=holders, waits=waits) if task is not None:
                yield from self._denied(task, self._translated(holders, self._waiting_map(task)), waits, now)
            case Fault(text=text) if task is not None:
                yield from self._refused(task, f"{self._waiting_map(task)}: {text}")
            case Reserved(task=task, fence=fence) if neighbour is not None:
                yield from self._moved(task, fence, neighbour, now)
            case ReservationFree(task=task) if neighbour is not None:
                yield from self._freed(task, neighbour, now)
            case ReservationLost(task=task, fence=fence, holders=holders) if neighbour is not None:
                yield from self._lost(task, fence, holders, neighbour, now)

    def undelivered(self, message: Message, reason: str) -> Effects:
        """A neighbour could not be reached for a day."""
        task = self._asking(message.header.message_id)
        if task is not None:
            yield from self._refused(task, f"{self._waiting_map(task)} could not be reached: {reason}")

    # Parts

    @property
    def _own_map(self) -> str:
        return self._contents.map.name

    def _earlier(self, shared: SharedReservation) -> Reservation:
        """What the task had here before its request, under the names of today."""
        return shared.earlier.with_names(self._contents.provenance.current_name)

    def _ask_next(self, task: str, now: float) -> Effects:
        shared = self._contents.shared_reservations[task]
        assert shared.request is not None
        while shared.waiting and shared.waiting[0] == self._own_map:
            answer, notices = self._reserving.reserve(shared.request, shared.task_manager, now)
            yield from notices
            if isinstance(answer, ReservationDenied):
                yield from self._denied(task, answer.holders, answer.waits, now)
                return
            shared.granted = answer
            shared.overtaken, shared.holders = (*shared.overtaken, *answer.overtaken), (*shared.holders, *answer.holders)
            del shared.waiting[0]
        if not shared.waiting:
            yield from self._complete(task)
            return
        home = shared.waiting[0]
        neighbour = self._contents.neighbours.get(home)
        if neighbour is None:
            yield from self._refused(task, f"{home} is no neighbour any more")
            return
        if shared.request.mode is not ReservationMode.ASK:
            shared.asked[home] = None
        body = structs.replace(
            shared.request,
            serial=2 * shared.request.serial,
            changes=tuple(plain_name(name) for name in shared.request.changes if home_of(name) == home),
            relies_on=tuple(plain_name(name) for name in shared.request.relies_on if home_of(name) == home),
            facts=(),
        )
        shared.request_id = message_id("reserve", task, shared.request.serial, home)
        yield request(self._contents, neighbour.settings.address, body, shared.request_id, now)

    def _granted(self, task: str, reserved: Reserved, now: float) -> Effects:
        shared = self._contents.shared_reservations[task]
        if 0 < reserved.fence <= shared.lost.get(shared.waiting[0], 0):
            yield from self._lose(task, shared.waiting[0], (), now)
            return
        home = shared.waiting.pop(0)
        if reserved.fence:
            shared.fences[home] = reserved.fence
        shared.overtaken += tuple(translated(name, home, self._own_map) for name in reserved.overtaken)
        shared.holders += self._translated(reserved.holders, home)
        shared.request_id = ""
        yield from self._ask_next(task, now)

    def _complete(self, task: str) -> Effects:
        shared = self._contents.shared_reservations[task]
        message, granted = shared.message, shared.granted
        assert message is not None
        assert granted is not None
        assert shared.request is not None
        is_hindered = shared.request.mode is ReservationMode.ASK and shared.holders
        if is_hindered:
            yield self._answer(message, ReservationDenied(task=task, holders=shared.holders))
        else:
            yield self._answer(message, structs.replace(granted, overtaken=tuple(dict.fromkeys(shared.overtaken)), holders=shared.holders))
        self._conclude(task)

    def _conclude(self, task: str) -> None:
        """The request has its answer. Who only asked has nothing."""
        shared = self._contents.shared_reservations[task]
        assert shared.request is not None
        if shared.request.mode is ReservationMode.ASK and not shared.asked:
            del self._contents.shared_reservations[task]
        shared.message = shared.request = None

    def _refused(self, task: str, reason: str) -> Effects:
        """The objects of a map cannot be reserved, also not later. The task keeps what it has, until it ends."""
        shared = self._contents.shared_reservations[task]
        assert shared.message is not None
        yield Send(reply(shared.message, Fault(code="Receiver", text=reason), self._contents.address))
        shared.request_id, shared.waiting = "", []
        self._contents.reservations.restrict(task, self._earlier(shared))
        self._conclude(task)

    def _denied(self, task: str, holders: tuple[Holder, ...], waits: bool, now: float) -> Effects:
        """One map has denied its objects. A task that waits for them has nothing at any map, another one has here what it had before."""
        shared = self._contents.shared_reservations[task]
        message, reserve = shared.message, shared.request
        assert message is not None
        assert reserve is not None
        shared.request_id = ""
        if reserve.mode is ReservationMode.ASK and shared.waiting[0] != self._own_map:
            shared.holders += holders
            del shared.waiting[0]
            yield from self._ask_next(task, now)
            return
        if waits:
            yield from self._release_at({*shared.fences} - {shared.waiting[0]}, task, 2 * reserve.serial, False, now)
            if shared.waiting[0] != self._own_map:
                self._contents.reservations.release(task)
        else:
            self._contents.reservations.restrict(task, self._earlier(shared))
        shared.waiting = shared.waiting[:1] if waits else []
        self._conclude(task)
        yield self._answer(message, ReservationDenied(task=task, holders=holders, waits=waits))

    def _release_at(self, maps: set[str], task: str, serial: int, ended: bool, now: float) -> Effects:
        """Release what the task has at neighbours. `serial`: that of the message which does so, doubled."""
        shared = self._contents.shared_reservations[task]
        for home in sorted(maps):
            if shared.fences.pop(home, None) is not None:
                shared.asked[home] = None
            if (neighbour := self._contents.neighbours.get(home)) is not None:
                yield notice(self._contents, neighbour, Release(task=task, serial=serial + 1, ended=ended), now)

    def _freed(self, task: str, neighbour: NeighbourState, now: float) -> Effects:
        shared = self._contents.shared_reservations.get(task)
        if shared is None:
            yield notice(self._contents, neighbour, Release(task=task, serial=2 * int(now * 1000) + 1, ended=True), now)
        else:
            yield tell(self._contents, shared.task_manager, ReservationFree(task=task), now)

    def _moved(self, task: str, fence: int, neighbour: NeighbourState, now: float) -> Effects:
        """What a task has reserved has got its home at this neighbour. A task that has nothing any more releases it there."""
        shared = self._contents.shared_reservations.get(task)
        claimant = self._contents.reservations.claimants.get(task)
        if not fence and claimant is not None:  # it knows that the task had it
            shared = self._contents.shared_reservations.setdefault(task, SharedReservation(task_manager=claimant.holder))
            shared.asked[neighbour.settings.map] = None
        elif shared is not None and (shared.request is not None or (claimant is not None and claimant.held)):
            shared.fences[neighbour.settings.map] = fence
        else:
            serial = 2 * self._contents.reservations.last_serial(task) + 1
            yield notice(self._contents, neighbour, Release(task=task, serial=serial, ended=claimant is None), now)

    def _lost(self, task: str, fence: int, holders: tuple[Holder, ...], neighbour: NeighbourState, now: float) -> Effects:
        """A neighbour has given away what a task had, possibly before it is known here that the task had it."""
        home, shared = neighbour.settings.map, self._contents.shared_reservations.get(task)
        if shared is None:
            return
        shared.lost[home] = max(fence, shared.lost.get(home, 0))
        if shared.fences.get(home) == fence:
            yield from self._lose(task, home, self._translated(holders, home), now)

    def _lose(self, task: str, home: str, holders: tuple[Holder, ...], now: float) -> Effects:
        """A task has lost what it had at a neighbour. It has nothing any more, at no map, and does not get what it has requested."""
        shared, claimant = self._contents.shared_reservations[task], self._contents.reservations.claimants.get(task)
        shared.fences.pop(home, None)
        own_fence = claimant.fence if claimant is not None else 0
        self._contents.reservations.release(task)
        maps = {*shared.fences, *(shared.waiting[:1] if shared.request_id else ())} - {self._own_map}
        yield from self._release_at(maps, task, 2 * self._latest_serial(task, shared), False, now)
        if own_fence:
            yield tell(self._contents, shared.task_manager, ReservationLost(task=task, fence=own_fence, holders=holders), now)
        if shared.message is not None:
            shared.request_id, shared.waiting = "", []
            yield self._answer(shared.message, ReservationDenied(task=task, holders=holders))
            self._conclude(task)

    def _translated(self, holders: tuple[Holder, ...], home: str) -> tuple[Holder, ...]:
        return tuple(
            structs.replace(holder, objects=tuple(translated(name, home, self._own_map) for name in holder.objects)) for holder in holders
        )

    def _asking(self, request_id: str | None) -> str | None:
        """The task whose request has this id."""
        shared_reservations = self._contents.shared_reservations
        return next((task for task, shared in shared_reservations.items() if request_id and shared.request_id == request_id), None)

    def _waiting_map(self, task: str) -> str:
        return self._contents.shared_reservations[task].waiting[0]
