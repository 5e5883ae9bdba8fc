"""Two Repositories, each with an object, a Task Manager and a task, that are neighbours of each other: their states and all their moves.

Each task changes the object of its own Repository, then that of the other one. The Repositories are those that run in the system
(`repository/component.py`), with maps that have nothing on them. The medium is between the Repositories; what a Task Manager and its
Repository tell each other arrives at once, because `reservation_model.py` has the media between them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from msgspec import Struct

from somrs.kernel.component import Effect, Received, Send, TimerFired
from somrs.ontology.qualified_names import home_of, plain_name
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.reservations import (
    Release,
    ReservationDenied,
    ReservationFree,
    ReservationLost,
    Reserve,
    Reserved,
    UnderReservation,
)
from somrs.repository.component import Repository
from somrs.repository.forwarding import reservation_at
from somrs.repository.state import RepetitionDue, ReservationsDue
from verification.model_check.media import EMPTY, Channel, Medium
from verification.model_check.reservation_model import Move
from verification.model_check.reservation_task import TASKS, TRY, Answer, Report, ReservingTask, Side
from verification.model_check.shared_reservation_ranks import Ranks
from verification.model_check.shared_reservation_state import (
    LAPSED,
    MANAGERS,
    MAPS,
    REPOSITORIES,
    PassedReport,
    Reply,
    ReportAnswer,
    RepositoryState,
    State,
    Token,
    contents_of,
    frozen,
    request_id,
    state_of,
    task_message,
    thawed,
    tokens_in,
    without_holders,
)

NOW = 1.0
"""The time, in seconds, which is part of the number of some messages: that is then higher than all ranks."""
NEEDS = (("x", "B:y"), ("y", "A:x"))
"""The objects that each task changes, in this order, as its Repository names them."""


@dataclass(frozen=True, kw_only=True)
class SharedReservationModel:
    """A configuration. `decisions`: a task may be cancelled, or release what it has to try again later. `lapses`: each Repository may once
    not be heard of for longer than a lease. `delays`: what a Repository tells its Task Manager arrives later, in order."""

    medium: Medium
    delays: bool = False
    restarts: bool = False
    decisions: bool = False
    lapses: bool = False


class SharedSystem:
    """All moves of a configuration."""

    def __init__(self, model: SharedReservationModel) -> None:
        self.model = model
        self.messages: list[Token] = []
        self._tokens: dict[Token, int] = {}

    @property
    def first(self) -> State:
        empty = frozen(RepositoryState())
        return State((Side(), Side()), (empty, empty), (EMPTY, EMPTY))

    def has_ended(self, state: State) -> bool:
        """Whether both tasks have ended, no message is repeated, and nothing is reserved or remembered of a task."""
        quiet = all(not channel.queue and not channel.unacknowledged for channel in state.channels)
        repositories = map(thawed, state.repositories)
        empty = all(not repository.reservations.claimants and not repository.shared for repository in repositories)
        return quiet and empty and all(side.phase == "ended" for side in state.sides)

    def moves(self, state: State) -> Iterator[Move[State]]:
        """Yield all moves from this state."""
        for number in (0, 1):
            yield from self._own_moves(state, number)
            for arrival in self.model.medium.arrivals(state.channels[number]):
                step = _Step(self, state)
                step.channels[number] = arrival.channel_after
                message = self.messages[arrival.token]
                step.arrive(message, 1 - number)
                yield step.move(f"{REPOSITORIES[1 - number]} hears {type(message).__name__}", fair=arrival.is_repeated)
            for event in self.model.medium.events(state.channels[number]):
                if event.word != "is out of time":
                    step = _Step(self, state)
                    step.channels[number] = event.channel_after
                    yield step.move(f"{REPOSITORIES[number]}'s message {event.word}", fair=event.word == "is sent again")

    def _own_moves(self, state: State, number: int) -> Iterator[Move[State]]:
        side = state.sides[number]

        def act(name: str, action: Callable[[ReservingTask], None], *, fair: bool = False) -> Move[State]:
            step = _Step(self, state)
            step.act(number, action)
            return step.move(f"{TASKS[number]} {name}", fair=fair)

        if state.to_managers[number]:
            step = _Step(self, state)
            step.deliver(number)
            yield step.move(f"{TASKS[number]} hears {type(state.to_managers[number][0]).__name__}", fair=True)
        match side.phase:
            case "planning":
                yield act("has a plan", lambda task: task.ask(TRY), fair=True)
            case "working":
                yield act("reports", lambda task: task.report(), fair=True)
                if self.model.decisions and not side.retried:
                    yield act("waits to try again", lambda task: task.wait_to_retry())
        if self.model.decisions and side.phase not in ("ended", "undoing", "reporting"):
            yield act("is cancelled", lambda task: task.cancel())
        if self.model.restarts and side.phase != "ended":
            yield act("restarts", lambda task: task.claim())
        step = _Step(self, state)
        if step.repositories[number].shared and step.ask_again(number):
            yield step.move(f"{REPOSITORIES[number]} asks again", fair=False)
        neighbour = REPOSITORIES[1 - number]
        step = _Step(self, state)
        if self.model.lapses and not step.repositories[number].lapsed and neighbour in step.repositories[number].reservations.heard_at:
            step.lapse(number, neighbour)
            yield step.move(f"{neighbour}'s lease ends", fair=False)

    def token(self, message: Token) -> int:
        if message not in self._tokens:
            self._tokens[message] = len(self.messages)
            self.messages.append(message)
        return self._tokens[message]

    def ranked(
        self,
        sides: tuple[Side, Side],
        repositories: tuple[RepositoryState, RepositoryState],
        channels: list[Channel],
        queues: list[tuple[Struct, ...]],
    ) -> State:
        """The state, without messages that cannot have an effect any more, with ranks in place of numbers that only grow."""
        for number in (0, 1):
            for token in {*tokens_in(channels[number])}:
                if _is_spent(self.messages[token], number, sides, repositories):
                    channels[number] = self.model.medium.drop(channels[number], 1 << token)
        for number in (0, 1):
            awaited = _awaited_serial(repositories[1 - number], TASKS[1 - number])
            repository = repositories[number]
            repository.replies = {serial: body for serial, body in repository.replies.items() if int(serial) == awaited}
            repository.accepted = {
                step: accepted for step, accepted in repository.accepted.items() if sides[1 - number].awaits[0] == -1 - int(step)
            }
        in_transit = [[self.messages[token] for token in tokens_in(channel)] for channel in channels]
        to_managers = tuple(() if side.phase == "ended" else queue for side, queue in zip(sides, queues, strict=True))
        ranks = Ranks(sides, repositories, (in_transit[0], in_transit[1]), (to_managers[0], to_managers[1]))
        ranked_channels = [ranks.channel(channel, number, self.messages, self.token) for number, channel in enumerate(channels)]
        return State(
            (ranks.side(sides[0], 0), ranks.side(sides[1], 1)),
            (frozen(ranks.repository(repositories[0], 0)), frozen(ranks.repository(repositories[1], 1))),
            (ranked_channels[0], ranked_channels[1]),
            (ranks.queue(to_managers[0], 0), ranks.queue(to_managers[1], 1)),
        )


class _Step:
    """A state while it changes."""

    def __init__(self, system: SharedSystem, state: State) -> None:
        self._system = system
        self.sides, self.channels, self.to_managers = [*state.sides], [*state.channels], [*state.to_managers]
        self.repositories = [*map(thawed, state.repositories)]
        self.wrong = ""

    def move(self, name: str, *, fair: bool) -> Move[State]:
        a, b = self.sides
        contested = {_full(name, 0) for name in a.held} & {_full(name, 1) for name in b.held}
        if a.works and b.works and contested and not self._system.model.lapses:
            self.wrong = f"both tasks work, and both believe that they have {', '.join(sorted(contested))}"
        repositories = (self.repositories[0], self.repositories[1])
        return Move(name, self._system.ranked((a, b), repositories, self.channels, self.to_managers), fair, self.wrong)

    # A task at its Task Manager

    def act(self, number: int, action: Callable[[ReservingTask], None]) -> None:
        """Let the task with this number act, and its Repository hear of it."""
        task = ReservingTask(number, self.sides[number], NEEDS[number])
        action(task)
        self.sides[number] = task.side()
        for message in task.recorder.sent:
            if isinstance(message, Report):
                self._report(number, message)
            else:
                self._handle(number, task_message(number, message))

    def deliver(self, number: int) -> None:
        """Let the task hear what its Repository told it first."""
        body, *remaining = self.to_managers[number]
        self.to_managers[number] = tuple(remaining)
        self.act(number, lambda task: task.hear(body))

    def _hear(self, number: int, body: Struct) -> None:
        self.to_managers[number] += (body,)
        if not self._system.model.delays:
            self.deliver(number)

    def _report(self, number: int, report: Report) -> None:
        name = NEEDS[number][report.step]
        reservation: UnderReservation | None = UnderReservation(task=report.task, fence=report.fence)
        if not home_of(name):
            self._hear(number, Answer(-1 - report.step, self._change(number, name, reservation)))
        elif not self._is_allowed(number, name, reservation):
            self._hear(number, Answer(-1 - report.step, False))
        else:
            contents = contents_of(self.repositories[number], number, NOW)
            reservation = reservation_at(home_of(name), reservation, contents)
            self.repositories[number] = state_of(contents, self.repositories[number], NOW)
            self._send(number, PassedReport(report.task, report.step, reservation))

    def _is_allowed(self, number: int, name: str, reservation: UnderReservation | None) -> bool:
        reservations = self.repositories[number].reservations
        return (
            reservation is None
            or reservations.is_held(reservation.task, reservation.fence)
            or not reservations.changers([name], reservation.task)
        )

    def _change(self, number: int, name: str, reservation: UnderReservation | None) -> bool:
        if not self._is_allowed(number, name, reservation):
            return False
        reservations, changing_task = self.repositories[number].reservations, reservation.task if reservation is not None else ""
        reservations.note_changes(changing_task, [name])
        for task, claimant in reservations.claimants.items():
            if task != changing_task and name in claimant.held.changes:
                self.wrong = f"another task changed {name}, which {task} has reserved"
        return True

    # Repositories

    def arrive(self, message: Token, number: int) -> None:
        """A message of the other Repository arrives at the one with this number."""
        sender = 1 - number
        match message:
            case PassedReport(task=task, step=step, reservation=reservation):
                accepted = self.repositories[number].accepted
                if not accepted.get(str(step)):
                    accepted[str(step)] = self._change(number, plain_name(NEEDS[TASKS.index(task)][step]), reservation)
                self._send(number, ReportAnswer(task, step, accepted[str(step)]))
            case ReportAnswer(step=step, accepted=was_accepted):
                self._hear(number, Answer(-1 - step, was_accepted))
            case Reply(task=task, serial=serial, body=body):
                id = f"{REPOSITORIES[sender]}/reply"
                relates_to = request_id(task, serial // 2, sender)
                self._handle(number, Message(header=_header(sender, id, relates_to), body=body))
            case Reserve(task=task, serial=serial):
                self._handle(number, Message(header=_header(sender, request_id(task, serial // 2, number)), body=message))
            case Release() | ReservationFree() | ReservationLost():
                self._handle(number, Message(header=_header(sender, f"{REPOSITORIES[sender]}/notice"), body=message))

    def ask_again(self, number: int) -> bool:
        """Let the Repository repeat its requests. Returns whether it has any."""
        asks = any(shared.request_id for shared in self.repositories[number].shared.values())
        if asks:
            self._handle(number, TimerFired(RepetitionDue()))
        return asks

    def lapse(self, number: int, neighbour: str) -> None:
        """The Repository with this number has not heard of the neighbour for longer than its lease."""
        self.repositories[number].reservations.heard_at[neighbour] = LAPSED
        self.repositories[number].lapsed = True
        self._handle(number, TimerFired(ReservationsDue()))

    def _handle(self, number: int, event: Message | TimerFired) -> None:
        earlier = self.repositories[number]
        contents = contents_of(earlier, number, NOW)
        effects = Repository(REPOSITORIES[number], contents).handle(Received(event) if isinstance(event, Message) else event, NOW)
        self.repositories[number] = state_of(contents, earlier, NOW)
        for effect in effects:
            self._carry_out(number, effect)

    def _carry_out(self, number: int, effect: Effect) -> None:
        if not isinstance(effect, Send):
            return
        header, body = effect.message.header, effect.message.body
        if header.recipient == MANAGERS[number]:
            if isinstance(body, Reserved | ReservationDenied):
                self._hear(number, Answer(int((header.relates_to or "").rpartition("/")[2]), without_holders(body)))
            else:
                self._hear(number, body)
        elif isinstance(body, Reserved | ReservationDenied):
            self._reply(number, header.relates_to or "", without_holders(body))
        elif isinstance(body, Reserve | Release | ReservationFree | ReservationLost):
            self._send(number, _for_nobody(body))

    def _reply(self, number: int, relates_to: str, body: Reserved | ReservationDenied) -> None:
        task = TASKS[1 - number]
        serial = next(serial for serial in self._serials_of(number) if request_id(task, serial // 2, number) == relates_to)
        self.repositories[number].replies[str(serial)] = body
        self._send(number, Reply(task, serial, body))

    def _serials_of(self, number: int) -> Iterator[int]:
        """The numbers of the requests of the other Repository, of which one is answered."""
        yield from range(0, 2 * self.sides[1 - number].sent + 4, 2)

    def _send(self, number: int, message: Token) -> None:
        self.channels[number] = self._system.model.medium.send(self.channels[number], self._system.token(message))


def _for_nobody(body: Token) -> Token:
    """The message without what only people read."""
    if isinstance(body, ReservationLost):
        return ReservationLost(task=body.task, fence=body.fence)
    return body


def _header(sender: int, id: str, relates_to: str | None = None) -> Header:
    address = REPOSITORIES[sender]
    return Header(sender=address, recipient=REPOSITORIES[1 - sender], message_id=id, reply_to=address, relates_to=relates_to)


def _full(name: str, number: int) -> str:
    return name if home_of(name) else f"{MAPS[number]}:{name}"


def _awaited_serial(state: RepositoryState, task: str) -> int:
    """The number of the request of the task that is passed on; -1 if there is none."""
    shared = state.shared.get(task)
    return 2 * shared.request.serial if shared is not None and shared.request is not None and shared.request_id else -1


def _is_spent(message: Token, number: int, sides: tuple[Side, Side], repositories: tuple[RepositoryState, RepositoryState]) -> bool:
    """Whether a message from the Repository with this number cannot have an effect any more."""
    sender, recipient = repositories[number], repositories[1 - number]
    match message:
        case Reserve(task=task, serial=serial):
            return recipient.reservations.last_serial(task) >= serial != _awaited_serial(sender, task)
        case Release(task=task, serial=serial):
            return recipient.reservations.last_serial(task) >= serial
        case Reply(task=task, serial=serial):
            return serial != _awaited_serial(recipient, task)
        case PassedReport(step=step):
            return sides[number].awaits[0] != -1 - step
        case ReportAnswer(step=step):
            return sides[1 - number].awaits[0] != -1 - step
        case ReservationFree(task=task):
            return task not in recipient.shared and task not in sender.reservations.claimants
        case ReservationLost(task=task, fence=fence):
            shared = recipient.shared.get(task)
            return shared is None or (not shared.request_id and shared.fences.get(MAPS[number]) != fence)
        case _:
            return False
