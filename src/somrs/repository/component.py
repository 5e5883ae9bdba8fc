"""The Repository: it keeps the ontology and the map, answers queries, applies changes, and publishes them to subscribers; and it
reserves objects for tasks.

Paper, "Repository": a realisation of the common knowledge of the environment's representation, and a storage of its maps.
Elsewhere: the effect of a map update (`update.py`), of a change of the ontology (`definition.py`) and of an undo (`undo.py`);
reading (`reading.py`); history (`history_queries.py`); the stored state (`state.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Self

from somrs.errors import InputError
from somrs.kernel.admission import check_room
from somrs.kernel.codec import Schema
from somrs.kernel.component import (
    Answered,
    Ask,
    DeliveryFailed,
    Effect,
    Effects,
    ErrorAnswer,
    Input,
    Notified,
    Received,
    Send,
    Started,
    TimerFired,
)
from somrs.limits import Limits
from somrs.ontology.conformance import Violation
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Message, normalised_id, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Alteration,
    Consider,
    Define,
    Defined,
    Event,
    MapPage,
    MergeObject,
    OntologyPage,
    QueryMap,
    ReadEvents,
    ReadHistory,
    ReadMap,
    ReadOntology,
    Rejected,
    RenameObject,
    Rows,
    SubscribeMap,
    Undo,
    Updated,
    UpdateMap,
)
from somrs.protocol.messages.neighbours import Adopt, ReadNeighbours
from somrs.protocol.messages.reservations import (
    AssignTask,
    ClaimReservations,
    Release,
    ReservationDenied,
    ReservationMode,
    Reserve,
    Reserved,
    TaskAssigned,
)
from somrs.repository.brought_definitions import brought_outcome
from somrs.repository.committing import Committing
from somrs.repository.definition import define_outcome, rename_outcome
from somrs.repository.forwarding import foreign_parts, impossible_request, own_changes, refusals, superseded_at_homes
from somrs.repository.history_queries import archive_reply, events_query, history_query, undo_query
from somrs.repository.merging import merge_outcome
from somrs.repository.neighbour_state import NeighbourDue
from somrs.repository.neighbourhood import Neighbourhood
from somrs.repository.neighbouring import NeighboursConfigured
from somrs.repository.outcome import VERSION, Outcome, considered, rejected
from somrs.repository.publishing import Publishing
from somrs.repository.reading import Reading
from somrs.repository.reserving import Reserving, lost_reservation
from somrs.repository.state import (
    REMEMBERED,
    Answer,
    ArchivedEvents,
    ArchiveWanted,
    Contents,
    LeasesDue,
    RepetitionDue,
    ReservationsDue,
    Task,
)
from somrs.repository.undo import undo_outcome
from somrs.repository.update import changes_outcome, update_outcome
from somrs.repository.version_conflict import version_conflicts

READS = ReadOntology | ReadMap | QueryMap | Consider | ReadHistory | ReadEvents | ReadNeighbours
"""Requests that change nothing."""


class Repository:
    """The component. It owns `contents`; no other code changes them."""

    def __init__(self, address: str, contents: Contents) -> None:
        contents.address = address
        self.contents = contents
        self._reading, self._reserving, self._publishing = Reading(contents), Reserving(contents), Publishing(contents)
        self._committing = Committing(contents)
        self._neighbours = Neighbourhood(contents, self._reserving, self._committing, self._publishing, self._remember_answer)

    @classmethod
    def restored(cls, contents: Contents) -> Self:
        """The Repository with the contents of a snapshot."""
        return cls(contents.address, contents)

    @property
    def state(self) -> Contents:
        return self.contents

    @property
    def open(self) -> list[str]:
        """Always empty: a Repository completes each request at once."""
        return []

    def check_admitted(self, message: Message, bounds: Limits) -> None:
        if isinstance(message.body, SubscribeMap):
            check_room("subscribers", bounds, self.contents.subscriptions, message.header.sender)

    def handle(self, event: Input, now: float) -> list[Effect]:
        """The effects of an input."""
        imported = self._neighbours.importing.handle(event, now)
        effects = imported if imported is not None else [*self._effects(event, now)]
        return [*effects, *self._continue(now), *self._reserving.admit(now)]

    def _continue(self, now: float) -> Effects:
        """Go on with updates that waited for neighbours."""
        while (continued := (yield from self._neighbours.proceed(now))).passed_on or continued.deferred:
            for message in continued.passed_on:
                yield from self._finish(message, now)
            for message in continued.deferred:
                yield from self._received(message, now)
        yield from self._neighbours.neighbouring.note_completeness(now)
        yield from self._neighbours.set_timer(now)

    def _effects(self, event: Input, now: float) -> Effects:
        match event:
            case Started(address):
                self.contents.address = address
                yield from self._publishing.start(now)
                yield from self._neighbours.neighbouring.start(now)
            case Notified(NeighboursConfigured() as configured):
                yield from self._neighbours.neighbouring.configure(configured, now)
            case Received(message):
                yield from self._received(message, now)
            case TimerFired(LeasesDue()):
                yield from self._publishing.expire(now)
            case TimerFired(RepetitionDue()):
                yield from self._neighbours.repeat(now)
            case TimerFired(ReservationsDue()):
                self.contents.reservations.lapse()
            case Answered(ArchiveWanted(message), value):
                yield from self._answered(message, value, now)
            case DeliveryFailed(message, reason):
                yield from self._publishing.undelivered(message)
                yield from self._neighbours.undelivered(message, reason)

    def _received(self, message: Message, now: float) -> Effects:
        if self._neighbours.concerns(message):
            yield from self._neighbours.received(message, now)
        else:
            try:
                yield from self._serve(message, now)
            except InputError as error:
                yield self._answer(message, Fault(code="Sender", text=str(error)))

    def _serve(self, message: Message, now: float) -> Effects:
        match message.body:
            case ReadOntology() | ReadMap() | QueryMap() as question:
                answer = self._reading.answer(question, message.header.sender)
                yield _ask(message, answer) if isinstance(answer, Task) else self._answer(message, answer)
            case UpdateMap() | Define() | RenameObject() | MergeObject() as alteration:
                yield from self._run_once(message, lambda: self._alter(message, alteration, self._alteration_outcome(alteration, now), now))
            case Undo() as undo:
                yield from self._run_once(message, lambda: iter([_ask(message, undo_query(undo))]))
            case Consider(change=Undo() as undo):
                yield _ask(message, undo_query(undo))
            case Consider(change=UpdateMap() | Define() | RenameObject() | MergeObject() as alteration):
                yield self._consider(message, alteration, self._alteration_outcome(alteration, now))
            case ReadHistory() as question:
                yield _ask(message, history_query(question))
            case ReadEvents() as question:
                yield _ask(message, events_query(question))
            case Reserve() as request:
                yield from self._run_once(message, lambda: self._reserve(message, request, now))
            case AssignTask(task=task):
                assigned = TaskAssigned(task=task, task_manager=message.header.sender)
                yield from self._run_once(message, lambda: iter([self._remember_answer(message, assigned)]))
            case Release() as release:
                yield from self._neighbours.reserving.release(release, message.header.sender, now)
                self._reserving.release(release, message.header.sender, now)
            case ClaimReservations() as claims:
                yield from self._reserving.claim(claims, message.header.sender, now)
                yield from self._neighbours.reserving.forget_unclaimed(claims, message.header.sender, now)
            case SubscribeMap() as subscribe:
                self._reserving.heard_of(message.header.sender, now)
                yield from self._publishing.subscribe(message, subscribe, now)
            case ReadNeighbours():
                yield self._answer(message, self._neighbours.neighbouring.views(now))
            case Adopt() as adopt:
                yield from self._run_once(message, lambda: self._adopt(message, adopt, now))
            case Updated() | Rejected() | Reserved() | ReservationDenied():
                pass  # an answer of a neighbour that is repeated or late
            case Fault():
                pass  # a Fault gets no reply
            case body:
                text = f"a Repository does not understand {type(body).__name__}; it reads, queries, updates and follows maps and ontologies"
                yield self._answer(message, Fault(code="ActionNotSupported", text=text))

    def _answer(self, request: Message, body: Body) -> Send:
        return Send(reply(request, body, self.contents.address))

    def _answered(self, message: Message, value: object, now: float) -> Effects:
        """Handle an answer of the archive."""
        match message.body, value:
            case Undo() as undo, ArchivedEvents(events):
                yield from self._run_once(message, lambda: self._alter(message, undo, self._undo_outcome(undo, events), now))
            case Consider(change=Undo() as undo), ArchivedEvents(events):
                yield self._consider(message, undo, self._undo_outcome(undo, events))
            case _:
                yield self._answer(message, archive_reply(message, value, self.contents))

    # Changes

    def _adopt(self, message: Message, body: Adopt, now: float) -> Effects:
        answer = yield from self._neighbours.handing_over.adopt(message, body, now)
        yield self._remember_answer(message, answer)

    def _reserve(self, message: Message, request: Reserve, now: float) -> Effects:
        if problems := [*impossible_request(request, message.header.sender, self.contents)]:
            raise InputError("; ".join(map(str, problems)))
        if self._neighbours.reserving.concerns_neighbours(request):
            yield from self._neighbours.reserving.begin(message, request, now)
            return
        answer, notices = self._reserving.reserve(request, message.header.sender, now)
        yield self._answer(message, answer) if request.mode is ReservationMode.ASK else self._remember_answer(message, answer)
        yield from notices

    def _run_once(self, message: Message, work: Callable[[], Iterator[Effect]]) -> Effects:
        """Execute a request, or repeat the stored answer if the request was executed before."""
        answer = self.contents.answered.get(normalised_id(message.header.message_id))
        if answer is not None:
            yield self._answer(message, answer)
        elif normalised_id(message.header.message_id) not in self.contents.forwarded:
            yield from work()

    def _alteration_outcome(self, alteration: UpdateMap | Define | RenameObject | MergeObject, now: float) -> Outcome:
        map, ontology, contents = self.contents.map, self.contents.ontology, self.contents
        match alteration:
            case UpdateMap():
                return update_outcome(map, ontology, alteration, contents.provenance, now, contents.changed_at.keys(), contents.neighbours)
            case Define(brought=True):
                return brought_outcome(contents, alteration)
            case Define():
                return define_outcome(map, ontology, alteration)
            case RenameObject():
                return rename_outcome(map, ontology, alteration)
            case MergeObject():
                return merge_outcome(map, ontology, contents.provenance, alteration)

    def _undo_outcome(self, undo: Undo, events: tuple[Event, ...]) -> Outcome:
        contents = self.contents
        if events and events[0].version == undo.version > contents.since:
            return undo_outcome(events[0], contents)
        message = f"there is no version {undo.version} that could be undone; the latest is {contents.version}"
        if 0 < undo.version <= contents.since:
            message = f"version {undo.version} cannot be undone: history is stored only from version {contents.since + 1} on"
        violation = Violation(subject=f"version {undo.version}", rule="unknown-version", message=message, section=VERSION)
        return Outcome(map=contents.map, ontology=contents.ontology, broken=(violation,))

    def _consider(self, message: Message, alteration: Alteration, outcome: Outcome) -> Send:
        return self._answer(message, considered(self._with_conflicts(alteration, outcome, message.header.sender), self.contents.version))

    def _with_conflicts(self, alteration: Alteration, outcome: Outcome, sender: str) -> Outcome:
        contents = self.contents
        late = (
            *version_conflicts(alteration, outcome, contents),
            *lost_reservation(alteration, outcome, contents),
            *refusals(alteration, outcome, sender, contents),
        )
        return replace(outcome, broken=(*late, *outcome.broken)) if late else outcome

    def _alter(self, message: Message, alteration: Alteration, outcome: Outcome, now: float) -> Effects:
        """Apply the change, or reject it if it breaks rules or conflicts with a later change."""
        contents = self.contents
        outcome = self._with_conflicts(alteration, outcome, message.header.sender)
        if outcome.broken:
            yield self._remember_answer(message, rejected(outcome.broken, contents.version))
            return
        if self._neighbours.handing_over.defers(message, outcome.objects):
            return
        author = alteration.author or message.header.sender
        if isinstance(alteration, UpdateMap) and (parts := foreign_parts(outcome, alteration, author, contents)):
            yield from self._neighbours.forwarding.begin(message, parts, now)
            return
        news = yield from self._committing.commit(
            outcome,
            author,
            now,
            task=_task_that_changes(alteration),
            undoes=alteration.version if isinstance(alteration, Undo) else None,
        )
        yield self._remember_answer(message, _answer_to(alteration, outcome, contents.version))
        yield from self._publishing.publish(news, now)
        if contents.neighbours:
            yield from self._neighbours.handing_over.begin(outcome.subjects, now)

    def _finish(self, message: Message, now: float) -> Effects:
        """Do what is left of an update when the changes of neighbours' objects are done."""
        assert isinstance(message.body, UpdateMap)
        contents = self.contents
        outcome = self._alteration_outcome(message.body, now)
        rest = changes_outcome(contents.map, contents.ontology, own_changes(outcome))
        own_outcome = outcome.with_changes_of(rest).with_superseded(superseded_at_homes(outcome))
        yield from self._alter(message, message.body, own_outcome, now)

    def _remember_answer(self, message: Message, answer: Answer) -> Send:
        """Send the answer and store it, for the case that the request arrives again."""
        answered = self.contents.answered
        answered[normalised_id(message.header.message_id)] = answer
        while len(answered) > REMEMBERED:
            del answered[next(iter(answered))]
        return self._answer(message, answer)


def _answer_to(alteration: Alteration, outcome: Outcome, version: int) -> Updated | Defined:
    return Defined(version=version) if isinstance(alteration, Define) else Updated(version=version, reception=outcome.reception)


def _task_that_changes(alteration: Alteration) -> str | None:
    """The task whose work the change is."""
    reservation = alteration.reservation if isinstance(alteration, UpdateMap) else None
    return reservation.task if reservation is not None and not reservation.only_seen else None


def _ask(message: Message, task: Task) -> Ask:
    return Ask(ArchiveWanted(message), task)


def only_reads(event: Input) -> bool:
    """Whether the input is a read request that is answered on its connection.

    Such a request need not survive a restart, because the connection ends with the process. An answer to an address must survive it.
    """
    match event:
        case Received(message) | Answered(ArchiveWanted(message)):
            return message.header.reply_to == ANONYMOUS and isinstance(message.body, READS)
        case _:
            return False


SCHEMA = Schema(
    component="repository",
    version=1,
    state=Contents,
    timers=LeasesDue | ReservationsDue | NeighbourDue | RepetitionDue,
    questions=ArchiveWanted,
    tasks=Task,
    answers=ArchivedEvents | MapPage | OntologyPage | Rows | ErrorAnswer,
    notices=NeighboursConfigured,
    restore=Repository.restored,
    relocatable=True,
    irreplaceable=True,
    is_read_only=only_reads,
    snapshot_after=500,
)
"""The types in the Repository's journal. An update of a map with 5,000 objects takes two milliseconds."""
