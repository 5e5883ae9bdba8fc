"""The objects that running tasks have reserved, and the tasks that wait for them.

A task reserves the objects that its plan changes or relies on, until it ends. No other task changes these objects, or relies on an object
that the plan changes. A task that waits holds nothing, so that tasks cannot deadlock. Among waiting tasks, the one with the highest
priority comes first, then the one that asked first; but at most `MOST_OVERTAKINGS` tasks that asked later come before a waiting one, so
that every task gets its turn. A task that holds a reservation is not interrupted, whatever the priority of others.

A reservation has a fencing number: each time a task gets its objects, a new one. A reservation also has a lease: when nothing was heard of
the task's Task Manager for `LEASE`, another task may take the objects.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping

from msgspec import Struct, field

from somrs.protocol.messages.reservations import ReservationMode as Mode
from somrs.protocol.messages.waits import Holder

LEASE = 300.0
"""Seconds without a message of a Task Manager after which another task may take what its tasks have reserved."""

REMEMBERED = 10_000
"""The number of ended tasks that are remembered."""

MOST_OVERTAKINGS = 20
"""The number of later tasks that may get an object before a task that waits for it."""


class Reservation(Struct, frozen=True, kw_only=True):
    """The objects that a plan changes, and the other objects that it relies on."""

    changes: frozenset[str] = frozenset()
    relies_on: frozenset[str] = frozenset()

    def __or__(self, reservation: Reservation) -> Reservation:
        return Reservation(changes=self.changes | reservation.changes, relies_on=self.relies_on | reservation.relies_on)

    def __bool__(self) -> bool:
        return bool(self.changes or self.relies_on)

    def includes(self, reservation: Reservation) -> bool:
        """Whether the other reservation adds nothing to this one."""
        return reservation.changes <= self.changes and reservation.relies_on <= self.changes | self.relies_on

    def renamed(self, names: Mapping[str, str]) -> Reservation:
        """The reservation with new names of objects."""
        return self.with_names(lambda name: names.get(name, name))

    def with_names(self, name_of: Callable[[str], str]) -> Reservation:
        """The reservation with the names that the function gives the objects."""
        changes = frozenset(map(name_of, self.changes))
        return Reservation(changes=changes, relies_on=frozenset(map(name_of, self.relies_on)) - changes)

    def within(self, objects: Container[str]) -> Reservation:
        """The reservation of these objects only. A plan also names outputs, which no map has yet."""
        return Reservation(
            changes=frozenset(name for name in self.changes if name in objects),
            relies_on=frozenset(name for name in self.relies_on if name in objects),
        )

    def without(self, objects: Collection[str]) -> Reservation:
        """The reservation without these objects."""
        return Reservation(changes=self.changes.difference(objects), relies_on=self.relies_on.difference(objects))

    def overlap(self, reservation: Reservation) -> frozenset[str]:
        """The objects on which the two reservations conflict."""
        return self.changes & (reservation.changes | reservation.relies_on) | self.relies_on & reservation.changes


class Claimant(Struct, kw_only=True):
    """A running task that has asked for objects.

    `holder`: the address of its Task Manager. `arrival`: when it asked first, as a number. `serial`: the number of the latest message about
    it that was heeded. `held`: what it has reserved, with the number `fence`. `waiting`: what it waits for; `admitted`: these objects are
    free, and it is making its plan. `overtakings`: how many tasks that asked later were preferred. `had`: all objects that it has had to
    change; `overtaken`: those of them that other tasks have changed after it released them.
    """

    holder: str
    goal: str
    priority: int
    arrival: int
    serial: int = 0
    held: Reservation = Reservation()
    fence: int = 0
    waiting: Reservation | None = None
    admitted: bool = False
    overtakings: int = 0
    had: frozenset[str] = frozenset()
    overtaken: frozenset[str] = frozenset()

    @property
    def precedence(self) -> tuple[bool, int, int]:
        """Its place among tasks that wait; the lowest comes first."""
        return self.overtakings < MOST_OVERTAKINGS, -self.priority if self.overtakings < MOST_OVERTAKINGS else 0, self.arrival


class Granted(Struct, frozen=True, kw_only=True):
    """The task has the objects, except those of the `holders` (only in the mode `UNDO`). `lost`: the tasks that have lost theirs to it,
    with the numbers of their reservations."""

    fence: int
    overtaken: frozenset[str] = frozenset()
    holders: tuple[Holder, ...] = ()
    lost: tuple[tuple[str, int], ...] = ()


class Denied(Struct, frozen=True, kw_only=True):
    """Other tasks have reserved some of the objects, or come first. `waits`: the task waits now, and holds nothing."""

    holders: tuple[Holder, ...]
    waits: bool = False


class Reservations(Struct, kw_only=True):
    """The reservations of all running tasks.

    `ended`: the tasks that ended last, with the number of the message that said so, because earlier messages may arrive later. `heard_at`:
    when the Task Manager at an address was heard of last, in seconds.
    """

    claimants: dict[str, Claimant] = field(default_factory=dict)
    ended: dict[str, int] = {}
    arrivals: int = 0
    fences: int = 0
    heard_at: dict[str, float] = {}
    freed: bool = False
    """Whether anything was freed since `admit_waiting` last checked."""

    # Requests

    def reserve(self, task: str, claimant: Claimant, reservation: Reservation, mode: Mode, now: float) -> Granted | Denied:
        """Reserve the objects for the task, in addition to what it has. `claimant`: what is known of the task, if it is new."""
        known = self.claimants.get(task)
        asking = known if known is not None else claimant
        if known is None:
            self.arrivals += 1
            asking.arrival = self.arrivals
        conflicts = self._conflicts(task, asking, reservation, is_undoing=mode is Mode.UNDO, now=now)
        if mode is Mode.ASK:
            return Denied(holders=self.describe(conflicts)) if conflicts else Granted(fence=0)
        self.claimants[task] = asking
        self.ended.pop(task, None)
        if conflicts and mode is not Mode.UNDO:
            if mode is Mode.WAIT:
                self._release(asking)
                asking.waiting, asking.admitted, self.freed = reservation, False, True
            return Denied(holders=self.describe(conflicts), waits=mode is Mode.WAIT)
        holders = self.describe(conflicts)
        granted = reservation.without({name for holder in holders for name in holder.objects})
        lost = tuple(self._take(task, granted))
        self._hold(asking, granted)
        overtaken, asking.overtaken = asking.overtaken, frozenset()  # what the task does from now on is its own again
        return Granted(fence=asking.fence, overtaken=overtaken, holders=holders, lost=lost)

    def release(self, task: str) -> None:
        """Release what the task holds, and let it wait no longer."""
        claimant = self.claimants.get(task)
        if claimant is not None and (claimant.held or claimant.waiting is not None):
            self._release(claimant)
            claimant.waiting, claimant.admitted, self.freed = None, False, True

    def restrict(self, task: str, reservation: Reservation) -> None:
        """Release what the task holds besides these objects."""
        claimant = self.claimants.get(task)
        if claimant is None or not claimant.held:
            return
        kept = reservation.within(claimant.held.changes | claimant.held.relies_on)
        self.freed = self.freed or kept != claimant.held
        if kept:
            claimant.held = kept
        else:
            self._release(claimant)

    def remove(self, task: str, serial: int = 0) -> None:
        """Forget a task that has ended; `serial`: the number of the message that says so."""
        if self.claimants.pop(task, None) is not None:
            self.freed = True
        self.ended[task] = max(serial, self.ended.pop(task, 0))
        while len(self.ended) > REMEMBERED:
            del self.ended[next(iter(self.ended))]

    def last_serial(self, task: str) -> int:
        """The number of the latest message about the task that was heeded; -1 if there was none."""
        claimant = self.claimants.get(task)
        return claimant.serial if claimant is not None else self.ended.get(task, -1)

    def restore(self, task: str, claimant: Claimant, now: float) -> tuple[Holder, ...]:
        """Let the task have what it says that it has, or wait for what it says. Returns the tasks that have it instead."""
        known = self.claimants.get(task)
        claimant.arrival = known.arrival if known is not None else self.arrivals + 1
        self.arrivals = max(self.arrivals, claimant.arrival)
        if known is not None:
            claimant.overtakings, claimant.had, claimant.overtaken = known.overtakings, known.had, known.overtaken
        claimant.had |= claimant.held.changes
        conflicts = self._conflicts(task, claimant, claimant.held, is_undoing=True, now=now)
        self.fences = max(self.fences, claimant.fence)
        if conflicts:
            self._release(claimant)
        self.claimants[task] = claimant
        self.ended.pop(task, None)
        self.freed = True
        return self.describe(conflicts)

    def admit_waiting(self, now: float) -> Iterator[str]:
        """The waiting tasks that nothing hinders any more, each once. The reservations may change between two of them."""
        while self.freed:
            self.freed = False
            for task in self._waiting_tasks():
                claimant = self.claimants.get(task)
                if claimant is None or claimant.waiting is None or claimant.admitted:
                    continue
                if not self._conflicts(task, claimant, claimant.waiting, is_undoing=False, now=now):
                    claimant.admitted = True
                    yield task

    def _waiting_tasks(self) -> list[str]:
        waiting_tasks = [task for task, claimant in self.claimants.items() if claimant.waiting is not None]
        return sorted(waiting_tasks, key=lambda task: self.claimants[task].precedence)

    def next_lapse(self, now: float) -> float | None:
        """When the next lease ends that may let a waiting task proceed."""
        if not any(claimant.waiting is not None and not claimant.admitted for claimant in self.claimants.values()):
            return None
        ends = (self._lease_end(claimant) for claimant in self.claimants.values() if claimant.held or claimant.waiting is not None)
        return min((end for end in ends if end is not None and end > now), default=None)

    def lapse(self) -> None:
        """A lease has ended: waiting tasks may proceed."""
        self.freed = True

    # Knowledge

    def is_held(self, task: str, fence: int) -> bool:
        """Whether the task has the reservation with this number."""
        claimant = self.claimants.get(task)
        return claimant is not None and bool(claimant.held) and claimant.fence == fence

    def changers(self, objects: Iterable[str], task: str) -> tuple[Holder, ...]:
        """The other tasks that have reserved some of the objects to change them."""
        reservation = Reservation(changes=frozenset(objects))
        conflicts = {
            changing_task: reservation.changes & claimant.held.changes
            for changing_task, claimant in self.claimants.items()
            if changing_task != task
        }
        return self.describe({changing_task: contested for changing_task, contested in conflicts.items() if contested})

    def note_changes(self, task: str, objects: Iterable[str]) -> None:
        """The task has changed objects: to others that had them before, this work of another is not theirs to undo."""
        changing = self.claimants.get(task)
        changed_objects = frozenset(objects) & (changing.held.changes if changing is not None else frozenset())
        for rival_task, claimant in self.claimants.items() if changed_objects else ():
            if rival_task != task:
                claimant.overtaken |= (changed_objects & claimant.had) - claimant.held.changes

    def describe(self, conflicts: Mapping[str, frozenset[str]]) -> tuple[Holder, ...]:
        """The contested objects, by task, for clients."""
        return tuple(
            Holder(
                task=task,
                goal=self.claimants[task].goal if task in self.claimants else "",
                objects=tuple(sorted(objects)),
                waiting=task not in self.claimants or not self.claimants[task].held,
            )
            for task, objects in conflicts.items()
        )

    def rename(self, names: Mapping[str, str]) -> None:
        """Give objects the names that they have now."""
        for claimant in self.claimants.values():
            claimant.held = claimant.held.renamed(names)
            if claimant.waiting is not None:
                claimant.waiting = claimant.waiting.renamed(names)
            claimant.had = frozenset(names.get(name, name) for name in claimant.had)
            claimant.overtaken = frozenset(names.get(name, name) for name in claimant.overtaken)

    # Parts

    def _conflicts(
        self, task: str, claimant: Claimant, reservation: Reservation, *, is_undoing: bool, now: float
    ) -> dict[str, frozenset[str]]:
        """The contested objects, by other task that holds them or waits for them with precedence."""
        conflicts: dict[str, frozenset[str]] = {}
        for rival_task, rival in self.claimants.items():
            if rival_task == task or self._is_lapsed(rival, now):
                continue
            contested = reservation.overlap(rival.held)
            if rival.waiting is not None and not is_undoing and rival.precedence < claimant.precedence:
                contested |= reservation.overlap(rival.waiting)
            if contested:
                conflicts[rival_task] = contested
        return conflicts

    def _take(self, task: str, reservation: Reservation) -> Iterator[tuple[str, int]]:
        """Take the objects from tasks whose leases have ended."""
        for rival_task, rival in self.claimants.items():
            if rival_task != task and reservation.overlap(rival.held):
                yield rival_task, rival.fence
                self._release(rival)

    def _hold(self, claimant: Claimant, reservation: Reservation) -> None:
        if not claimant.held:
            self.fences += 1
            claimant.fence = self.fences
        self._count_overtakings(claimant, reservation)
        claimant.held |= reservation
        claimant.had |= reservation.changes
        claimant.waiting, claimant.admitted = None, False

    def _count_overtakings(self, claimant: Claimant, reservation: Reservation) -> None:
        for rival in self.claimants.values():
            if rival.waiting is not None and rival.arrival < claimant.arrival and reservation.overlap(rival.waiting):
                rival.overtakings += 1

    @staticmethod
    def _release(claimant: Claimant) -> None:
        claimant.held, claimant.fence = Reservation(), 0

    def _lease_end(self, claimant: Claimant) -> float | None:
        heard_at = self.heard_at.get(claimant.holder)
        return heard_at + LEASE if heard_at is not None else None

    def _is_lapsed(self, claimant: Claimant, now: float) -> bool:
        end = self._lease_end(claimant)
        return end is not None and end <= now
