"""The reservations of objects for tasks at the Repository: the requests of Task Managers, and what they are told.

Who gets which objects is in `kernel/reservations.py`.
"""

from __future__ import annotations

from collections.abc import Iterator

from somrs.errors import InputError
from somrs.kernel.component import Effects, Send, SetTimer
from somrs.kernel.reservations import Claimant, Denied, Granted, Reservation
from somrs.ontology.conformance import Violation
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.event_text import holders_text
from somrs.protocol.messages.knowledge import Alteration, UpdateMap
from somrs.protocol.messages.reservations import (
    RESERVED,
    Claim,
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
from somrs.repository.outcome import Outcome
from somrs.repository.state import Contents, ReservationsDue

DELIVERY_TIME = 86_400.0
"""Seconds for which a Task Manager is told of its reservations again: it may be down for long."""


class Reserving:
    """Handles messages about reservations. It has no state of its own."""

    def __init__(self, contents: Contents) -> None:
        self._contents, self._reservations = contents, contents.reservations

    def heard_of(self, sender: str, now: float) -> None:
        """A Task Manager with reservations has sent a message: its leases begin anew."""
        if sender in self._reservations.heard_at:
            self._reservations.heard_at[sender] = now

    def reserve(self, request: Reserve, sender: str, now: float) -> tuple[Reserved | ReservationDenied, list[Send]]:
        """Returns the answer, and what others are told. Raises InputError when another Task Manager has the task."""
        reservations = self._reservations
        known = reservations.claimants.get(request.task)
        if known is not None and known.holder != sender:
            raise InputError(f"the task {request.task} is one of {known.holder}, which reserves for it")
        if request.serial <= reservations.last_serial(request.task):
            return ReservationDenied(task=request.task, holders=()), []  # a later message has come before it
        reservations.heard_at[sender] = now
        claimant = Claimant(holder=sender, goal=request.goal, priority=request.priority, arrival=0)
        reservation = self._reservation(request)
        result = reservations.reserve(request.task, claimant, reservation, request.mode, now)
        if request.mode is not ReservationMode.ASK:
            reservations.claimants[request.task].serial = request.serial
        match result:
            case Granted(fence=fence, overtaken=overtaken, holders=holders, lost=lost):
                taker = reservations.describe({request.task: reservation.changes | reservation.relies_on})
                news = [self._tell_loss(task, lost_fence, taker, now) for task, lost_fence in lost]
                return Reserved(task=request.task, fence=fence, overtaken=tuple(sorted(overtaken)), holders=holders), news
            case Denied(holders=holders, waits=waits):
                return ReservationDenied(task=request.task, holders=holders, waits=waits), []

    def _reservation(self, request: Reserve | Claim) -> Reservation:
        requested = Reservation(changes=frozenset(request.changes), relies_on=frozenset(request.relies_on))
        return requested.with_names(self._contents.provenance.current_name)

    def release(self, release: Release, sender: str, now: float) -> None:
        """A task releases what it has."""
        self.heard_of(sender, now)
        known = self._reservations.claimants.get(release.task)
        if (known is not None and known.holder != sender) or release.serial <= self._reservations.last_serial(release.task):
            return
        if release.ended or known is None:  # the request that it takes back may come later
            self._reservations.remove(release.task, release.serial)
        else:
            known.serial = release.serial
            self._reservations.release(release.task)

    def claim(self, claims: ClaimReservations, sender: str, now: float) -> Iterator[Send]:
        """A Task Manager says all that its tasks have."""
        reservations = self._reservations
        reservations.heard_at[sender] = now
        claimed = {claim.task for claim in claims.claims}
        own_tasks = [task for task, claimant in reservations.claimants.items() if claimant.holder == sender]
        for task in own_tasks:
            if task not in claimed and reservations.last_serial(task) < claims.serial:
                reservations.remove(task, claims.serial)
        for claim in claims.claims:
            known = reservations.claimants.get(claim.task)
            if (known is not None and known.holder != sender) or reservations.last_serial(claim.task) >= claim.serial:
                continue  # the Repository knows as much, or more
            claimant = Claimant(holder=sender, goal=claim.goal, priority=claim.priority, arrival=0, serial=claim.serial, fence=claim.fence)
            if claim.waits:
                claimant.waiting, claimant.fence = self._reservation(claim), 0
            else:
                claimant.held = self._reservation(claim)
            if holders := reservations.restore(claim.task, claimant, now):
                yield self._tell_loss(claim.task, claim.fence, holders, now)

    def _tell_loss(self, task: str, fence: int, holders: tuple[Holder, ...], now: float) -> Send:
        recipient = self._reservations.claimants[task].holder
        return self._send(recipient, ReservationLost(task=task, fence=fence, holders=holders), now)

    def _send(self, recipient: str, body: Body, now: float) -> Send:
        self._contents.notice_count += 1
        identity = message_id(self._contents.address, recipient, type(body).__name__, self._contents.notice_count, now)
        message = Message(header=Header(sender=self._contents.address, recipient=recipient, message_id=identity), body=body)
        return Send(message, now + DELIVERY_TIME)

    def admit(self, now: float) -> Effects:
        """Tell the tasks whose objects are free, and wait for the next lease to end."""
        reservations = self._reservations
        if not reservations.freed:
            return
        for task in reservations.admit_waiting(now):
            yield self._send(reservations.claimants[task].holder, ReservationFree(task=task), now)
        yield SetTimer(ReservationsDue(), reservations.next_lapse(now))


def lost_reservation(alteration: Alteration, outcome: Outcome, contents: Contents) -> Iterator[Violation]:
    """Violations for the objects of a report whose task has lost them to other tasks."""
    if not isinstance(alteration, UpdateMap) or alteration.reservation is None:
        return
    task, reservations = alteration.reservation.task, contents.reservations
    if reservations.is_held(task, alteration.reservation.fence):
        return
    for holder in reservations.changers(outcome.subjects, task):
        for name in holder.objects:
            message = f"is not the task's to change any more: {holders_text([holder])}"
            yield Violation(subject=name, rule=RESERVED, message=message)
