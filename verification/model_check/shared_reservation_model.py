"""Two Repositories, each with an object, a Task Manager and a task, that are neighbours of each other: their states and all their moves.

Each task changes the object of its own Repository, then that of the other one. The medium is between the Repositories; what a Task Manager
and its Repository tell each other arrives at once, because `reservation_model.py` has the media between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from msgspec import Struct

from somrs.ontology.qualified_names import home_of
from verification.model_check.media import EMPTY, Channel, Medium
from verification.model_check.reservation_model import Move
from verification.model_check.reservation_task import FRESH, TASKS, TRY, ReservingTask, Side
from verification.model_check.shared_reservation_effects import spent_messages, without_answers
from verification.model_check.shared_reservation_ranks import (
    Number,
    Ranking,
    mapped,
    numbers_of_message,
    numbers_of_notices,
    numbers_of_repository,
    numbers_of_side,
    ranked_message,
    ranked_notices,
    ranked_repository,
    ranked_side,
    ranking,
)
from verification.model_check.shared_reservation_repository import NEEDS, ByTask, Event, LeaseEnded, RepositoryPair, TimeToRepeat
from verification.model_check.shared_reservation_state import (
    MAPS,
    REMEMBERED,
    REPOSITORIES,
    RepositoryState,
    State,
    Token,
    frozen,
    read,
    tokens_in,
)


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
        self.repositories = RepositoryPair()
        self.act = lru_cache(REMEMBERED)(_act)
        self._numbers_of_channel = lru_cache(REMEMBERED)(self._find_numbers)
        self._ranked_channel = lru_cache(REMEMBERED)(self._rank_channel)

    @property
    def first(self) -> State:
        state = RepositoryState()
        state.reservations.fences = FRESH
        return State((Side().reduced(), Side().reduced()), (frozen(state), frozen(state)), (EMPTY, EMPTY))

    def has_ended(self, state: State) -> bool:
        """Whether both tasks have ended, no message is repeated, and nothing is reserved or remembered of a task."""
        quiet = all(not channel.queue and not channel.unacknowledged for channel in state.channels)
        repositories = map(read, state.repositories)
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
                step.handle(1 - number, message)
                yield step.move(f"{REPOSITORIES[1 - number]} hears {type(message).__name__}", fair=arrival.is_repeated)
            for event in self.model.medium.events(state.channels[number]):
                if event.word != "is out of time":
                    step = _Step(self, state)
                    step.channels[number] = event.channel_after
                    yield step.move(f"{REPOSITORIES[number]}'s message {event.word}", fair=event.word == "is sent again")

    def _own_moves(self, state: State, number: int) -> Iterator[Move[State]]:
        side = state.sides[number]

        def act(name: str, action: str, *, fair: bool = False) -> Move[State]:
            step = _Step(self, state)
            step.act(number, action)
            return step.move(f"{TASKS[number]} {name}", fair=fair)

        if state.to_managers[number]:
            step = _Step(self, state)
            step.deliver(number)
            yield step.move(f"{TASKS[number]} hears {type(state.to_managers[number][0]).__name__}", fair=True)
        match side.phase:
            case "planning":
                yield act("has a plan", "ask", fair=True)
            case "working":
                yield act("reports", "report", fair=True)
                if self.model.decisions and not side.retried:
                    yield act("waits to try again", "wait_to_retry")
        if self.model.decisions and side.phase not in ("ended", "undoing", "reporting"):
            yield act("is cancelled", "cancel")
        if self.model.restarts and side.phase != "ended":
            yield act("restarts", "claim")
        yield from self._repository_moves(state, number)

    def _repository_moves(self, state: State, number: int) -> Iterator[Move[State]]:
        repository, neighbour = read(state.repositories[number]), REPOSITORIES[1 - number]
        if any(shared.request_id for shared in repository.shared.values()):
            step = _Step(self, state)
            step.handle(number, TimeToRepeat())
            yield step.move(f"{REPOSITORIES[number]} asks again", fair=False)
        if self.model.lapses and not repository.lapsed and neighbour in repository.reservations.heard_at:
            step = _Step(self, state)
            step.handle(number, LeaseEnded())
            yield step.move(f"{neighbour}'s lease ends", fair=False)

    def token(self, message: Token) -> int:
        if message not in self._tokens:
            self._tokens[message] = len(self.messages)
            self.messages.append(message)
        return self._tokens[message]

    # Equal states

    def ranked(self, state: State) -> State:
        """The state, without messages that cannot have an effect any more, with ranks in place of numbers that only grow."""
        sides, channels = (state.sides[0].reduced(), state.sides[1].reduced()), [*state.channels]
        for number in (0, 1):
            for message in spent_messages(self._in_transit(channels[number]), number, sides, state.repositories):
                channels[number] = self.model.medium.drop(channels[number], 1 << self._tokens[message])
        repositories = [without_answers(number, sides, state.repositories) for number in (0, 1)]
        queues = [() if side.phase == "ended" else queue for side, queue in zip(sides, state.to_managers, strict=True)]
        return self._renumbered(State(sides, (repositories[0], repositories[1]), (channels[0], channels[1]), (queues[0], queues[1])))

    def _in_transit(self, channel: Channel) -> tuple[Token, ...]:
        return tuple(self.messages[token] for token in tokens_in(channel))

    def _renumbered(self, state: State) -> State:
        numbers = [
            (numbers_of_side(side, number), numbers_of_repository(repository, number), self._numbers_of_channel(channel, number),
             numbers_of_notices(queue, number))
            for number, (side, repository, channel, queue) in enumerate(zip(*state, strict=True))
        ]  # fmt: skip
        ranks = ranking(frozenset[Number]().union(*numbers[0], *numbers[1]))

        def changes(numbers: frozenset[Number]) -> Ranking:
            return tuple((number, rank) for number, rank in ranks.items() if number in numbers)

        first, second = (
            (ranked_side(side, number, changes(of_side)), ranked_repository(repository, number, changes(of_repository)),
             self._ranked_channel(channel, number, changes(of_channel)), ranked_notices(queue, number, changes(of_queue)))
            for number, (side, repository, channel, queue) in enumerate(zip(*state, strict=True))
            for of_side, of_repository, of_channel, of_queue in [numbers[number]]
        )  # fmt: skip
        return State(*zip(first, second, strict=True))  # type: ignore[arg-type]

    def _find_numbers(self, channel: Channel, number: int) -> frozenset[Number]:
        return frozenset[Number]().union(*(numbers_of_message(message, number) for message in self._in_transit(channel)))

    def _rank_channel(self, channel: Channel, number: int, ranking: Ranking) -> Channel:
        tokens = {token: self.token(ranked_message(self.messages[token], number, ranking)) for token in tokens_in(channel)}
        return mapped(channel, tokens) if ranking else channel


def _act(number: int, side: Side, action: str, message: Struct | None) -> tuple[Side, tuple[Struct, ...]]:
    """Let the task with this number act. Returns its state and what it sends."""
    task = ReservingTask(number, side, NEEDS[number])
    match action:
        case "ask":
            task.ask(TRY)
        case "hear":
            assert message is not None
            task.hear(message)
        case "report" | "wait_to_retry" | "cancel" | "claim":
            getattr(task, action)()
    return task.side(), tuple(task.recorder.sent)


class _Step:
    """A state while it changes."""

    def __init__(self, system: SharedSystem, state: State) -> None:
        self._system = system
        self.sides, self.channels, self.to_managers = [*state.sides], [*state.channels], [*state.to_managers]
        self.repositories = [*state.repositories]
        self.wrong = ""

    def move(self, name: str, *, fair: bool) -> Move[State]:
        a, b = self.sides
        contested = {_full(name, 0) for name in a.held} & {_full(name, 1) for name in b.held} if a.works and b.works else None
        if contested and not self._system.model.lapses:
            self.wrong = f"both tasks work, and both believe that they have {', '.join(sorted(contested))}"
        state = State(
            (a, b),
            (self.repositories[0], self.repositories[1]),
            (self.channels[0], self.channels[1]),
            (self.to_managers[0], self.to_managers[1]),
        )
        return Move(name, self._system.ranked(state), fair, self.wrong)

    def act(self, number: int, action: str, message: Struct | None = None) -> None:
        """Let the task with this number act, and its Repository hear of it."""
        self.sides[number], sent = self._system.act(number, self.sides[number], action, message)
        for body in sent:
            self.handle(number, ByTask(body))  # type: ignore[arg-type]

    def deliver(self, number: int) -> None:
        """Let the task hear what its Repository told it first."""
        body, *remaining = self.to_managers[number]
        self.to_managers[number] = tuple(remaining)
        self.act(number, "hear", body)

    def handle(self, number: int, event: Event) -> None:
        """Let the Repository with this number handle an event, and send what comes of it."""
        handled = self._system.repositories.handle(number, self.repositories[number], event)
        self.repositories[number], self.wrong = handled.state, self.wrong or handled.wrong
        for message in handled.sent:
            self.channels[number] = self._system.model.medium.send(self.channels[number], self._system.token(message))
        for body in handled.told:
            if body not in self.to_managers[number]:  # one copy of a message at a time, as on the media
                self.to_managers[number] += (body,)
            if not self._system.model.delays:
                self.deliver(number)


def _full(name: str, number: int) -> str:
    return name if home_of(name) else f"{MAPS[number]}:{name}"
