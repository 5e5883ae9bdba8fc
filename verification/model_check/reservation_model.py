"""Two Task Managers with a task each, and the Repository at which they reserve objects: their states and all their moves.

The rules are those that run in the system: `kernel/reservations.py`, `repository/reserving.py` and `task_manager/reservations.py`. Each
task changes one object, then the other one, in opposite orders, and reports each change; it may be cancelled, or wait to try again. Numbers
(serials, fences, arrivals) only grow; a state has their ranks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Generic, NamedTuple, TypeVar

from msgspec import Struct, structs

from somrs.kernel.component import Send
from somrs.kernel.reservations import LEASE, Claimant, Reservation, Reservations
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.reservations import (
    ClaimReservations,
    Release,
    ReservationLost,
    Reserve,
)
from somrs.repository.reserving import Reserving as Repository
from somrs.repository.state import Contents
from verification.model_check.media import EMPTY, Channel, Medium, members
from verification.model_check.reservation_task import FRESH, TASKS, TRY, Answer, Report, ReservingTask, Side

MANAGERS = ("tm-a", "tm-b")
NEEDS = (("x", "y"), ("y", "x"))
"""The objects that each task changes, in this order."""
KEPT_CHANNELS = 1 << 16
"""The number of channels whose contents are kept: most moves change one of four."""


class State(NamedTuple):
    """`table`: the Repository's reservations, as a tuple; `answers`: those that may have to be repeated, by task and number;
    `to_repository` and `to_managers`: the channels, one for each Task Manager."""

    sides: tuple[Side, Side]
    table: tuple[Any, ...]
    answers: frozenset[tuple[int, int, Any]]
    to_repository: tuple[Channel, Channel]
    to_managers: tuple[Channel, Channel]


S = TypeVar("S")


class Move(NamedTuple, Generic[S]):
    """A step of the whole system. `wrong`: why it violates mutual exclusion."""

    name: str
    target: S
    fair: bool
    wrong: str = ""


@dataclass(frozen=True, kw_only=True)
class ReservationModel:
    """A configuration. `decisions`: a task may be cancelled, or release what it has to try again later. `lapses`: a Task Manager may be
    silent for longer than its lease."""

    medium: Medium
    restarts: bool = True
    decisions: bool = True
    lapses: bool = False


class System:
    """All moves of a configuration."""

    def __init__(self, model: ReservationModel) -> None:
        self.model = model
        self.messages: list[Struct] = []
        self._tokens: dict[Struct, int] = {}
        self._numbers: list[tuple[set[int], set[int]]] = []
        """By token: the fences and serials in its message."""

    @property
    def first(self) -> State:
        side = Side().reduced()
        return State((side, side), _frozen(Reservations(fences=FRESH)), frozenset(), (EMPTY, EMPTY), (EMPTY, EMPTY))

    def token(self, message: Struct) -> int:
        if message not in self._tokens:
            self._tokens[message] = len(self.messages)
            self.messages.append(message)
            self._numbers.append((_fences_in(message), _serials_in(message)))
        return self._tokens[message]

    def has_ended(self, state: State) -> bool:
        """Whether both tasks have ended, nobody repeats a message, and nothing is reserved."""
        quiet = all(not channel.queue and not channel.unacknowledged for channel in (*state.to_repository, *state.to_managers))
        return quiet and all(side.phase == "ended" for side in state.sides) and not state.table[0]

    def moves(self, state: State) -> Iterator[Move[State]]:
        """Yield all moves from this state."""
        for number in (0, 1):
            yield from self._own_moves(state, number)
            for arrival in self.model.medium.arrivals(state.to_repository[number]):
                after = state._replace(to_repository=_put(state.to_repository, number, arrival.channel_after))
                yield self._at_repository(after, number, self.messages[arrival.token], fair=arrival.is_repeated)
            for arrival in self.model.medium.arrivals(state.to_managers[number]):
                after = state._replace(to_managers=_put(state.to_managers, number, arrival.channel_after))
                yield self._at_manager(after, number, self.messages[arrival.token], fair=arrival.is_repeated)
            for name, channels in (("down", state.to_repository), ("up", state.to_managers)):
                for event in self.model.medium.events(channels[number]):
                    if event.word != "is out of time":
                        changed = _put(channels, number, event.channel_after)
                        after = state._replace(to_repository=changed) if name == "down" else state._replace(to_managers=changed)
                        yield self._move(f"{name} {event.word}", after, fair=event.word == "is sent again")

    # A task at its Task Manager

    def _own_moves(self, state: State, number: int) -> Iterator[Move[State]]:
        side = state.sides[number]
        match side.phase:
            case "planning":
                yield self._act(state, number, "has a plan", lambda task: task.ask(TRY), fair=True)
            case "working":
                yield self._act(state, number, "reports", lambda task: task.report(), fair=True)
                if self.model.decisions and not side.retried:
                    yield self._act(state, number, "waits to try again", lambda task: task.wait_to_retry())
        if self.model.decisions and side.phase not in ("ended", "undoing", "reporting"):
            yield self._act(state, number, "is cancelled", lambda task: task.cancel())
        claims_in_transit = any(isinstance(self.messages[token], ClaimReservations) for token in _tokens(state.to_repository[number]))
        if self.model.restarts and side.phase != "ended" and not claims_in_transit:
            yield self._act(state, number, "restarts", lambda task: task.claim())
        table = _thawed(state.table)
        if self.model.lapses and table.heard_at.get(MANAGERS[number]) == 0.0:
            table.heard_at[MANAGERS[number]] = -LEASE
            table.lapse()
            yield self._repository_move(state, table, f"{MANAGERS[number]}'s lease ends", fair=False)

    def _act(self, state: State, number: int, name: str, act: Callable[[ReservingTask], None], *, fair: bool = False) -> Move[State]:
        task = ReservingTask(number, state.sides[number], NEEDS[number])
        act(task)
        channel = state.to_repository[number]
        for message in task.recorder.sent:
            channel = self.model.medium.send(channel, self.token(message))
        target = state._replace(sides=_put(state.sides, number, task.side()), to_repository=_put(state.to_repository, number, channel))
        return self._move(f"{TASKS[number]} {name}", target, fair=fair)

    def _at_manager(self, state: State, number: int, message: Struct, *, fair: bool) -> Move[State]:
        return self._act(state, number, f"hears {type(message).__name__}", lambda task: task.hear(message), fair=fair)

    # The Repository

    def _at_repository(self, state: State, number: int, message: Struct, *, fair: bool) -> Move[State]:
        table = _thawed(state.table)
        repository, sender, replies = Repository(_contents(table)), MANAGERS[number], list[tuple[int, Struct]]()
        answers, wrong = {(task, serial): body for task, serial, body in state.answers}, ""
        match message:
            case Reserve(serial=serial):
                if (number, serial) not in answers:
                    answers[number, serial], notices = repository.reserve(message, sender, 0.0)
                    replies += [(MANAGERS.index(notice.message.header.recipient), notice.message.body) for notice in notices]
                replies.insert(0, (number, Answer(serial, answers[number, serial])))
            case Report(step=step, fence=fence):
                key = (number, -1 - step)
                if key not in answers or answers[key] is False:
                    changed = NEEDS[number][step]
                    answers[key] = table.is_held(TASKS[number], fence) or not table.changers([changed], TASKS[number])
                    if answers[key]:
                        table.note_changes(TASKS[number], [changed])
                        wrong = self._wrong_change(table, number, changed)
                replies.append((number, Answer(-1 - step, answers[key])))
            case Release():
                repository.release(message, sender, 0.0)
            case ClaimReservations():
                sends = [*repository.claim(message, sender, 0.0)]
                replies += [(number, send.message.body) for send in sends]
        kept = frozenset((task, serial, body) for (task, serial), body in answers.items())
        name = f"the Repository hears {type(message).__name__}"
        move = self._repository_move(state._replace(answers=kept), table, name, replies, fair=fair)
        return move._replace(wrong=wrong or move.wrong)

    def _repository_move(
        self, state: State, table: Reservations, name: str, replies: list[tuple[int, Struct]] | None = None, *, fair: bool
    ) -> Move[State]:
        messages = [*(replies or [])]
        for effect in Repository(_contents(table)).admit(0.0):
            if isinstance(effect, Send):
                messages.append((MANAGERS.index(effect.message.header.recipient), effect.message.body))
        channels = [*state.to_managers]
        for number, message in messages:
            channels[number] = self.model.medium.send(channels[number], self.token(message))
        return self._move(name, state._replace(table=_frozen(table), to_managers=(channels[0], channels[1])), fair=fair)

    @staticmethod
    def _wrong_change(table: Reservations, number: int, name: str) -> str:
        other = table.claimants.get(TASKS[1 - number])
        return f"{TASKS[number]} changed {name}, which {TASKS[1 - number]} has reserved" if other and name in other.held.changes else ""

    def _move(self, name: str, target: State, *, fair: bool) -> Move[State]:
        wrong = ""
        a, b = target.sides
        if a.works and b.works and a.held & b.held and not self.model.lapses:
            wrong = f"both tasks work, and both believe that they have {', '.join(sorted(a.held & b.held))}"
        return Move(name, self._ranked(self._without_ineffective(target)), fair, wrong)

    # Equal states

    def _without_ineffective(self, state: State) -> State:
        """The state without messages that cannot have an effect any more, and without answers that nobody awaits."""
        table, to_repository, to_managers = _thawed(state.table), [*state.to_repository], [*state.to_managers]
        sides = (state.sides[0].reduced(), state.sides[1].reduced())
        for number, side in enumerate(sides):
            last, awaited = table.last_serial(TASKS[number]), side.awaits[0]
            for token in {*_tokens(to_repository[number])}:
                match self.messages[token]:
                    case Reserve(serial=serial):
                        is_spent = last >= serial != awaited
                    case Release(serial=serial):
                        is_spent = last >= serial
                    case ClaimReservations(claims=claims):
                        is_spent = all(last >= claim.serial for claim in claims)
                    case Report(step=step):
                        is_spent = awaited != -1 - step
                    case _:
                        is_spent = False
                if is_spent:
                    to_repository[number] = self.model.medium.drop(to_repository[number], 1 << token)
            for token in {*_tokens(to_managers[number])}:
                message = self.messages[token]
                is_spent = side.phase == "ended" or (isinstance(message, Answer) and message.serial != awaited)
                if is_spent or (isinstance(message, ReservationLost) and message.fence <= side.lost):
                    to_managers[number] = self.model.medium.drop(to_managers[number], 1 << token)
        awaits = [side.awaits[0] for side in sides]
        answers = frozenset(answer for answer in state.answers if awaits[answer[0]] == answer[1])
        channels = (to_repository[0], to_repository[1]), (to_managers[0], to_managers[1])
        return state._replace(sides=sides, to_repository=channels[0], to_managers=channels[1], answers=answers)

    def _ranked(self, state: State) -> State:
        """The state with ranks in place of numbers that only grow."""
        table = _thawed(state.table)
        fences = {0, *(side.fence for side in state.sides), *(side.lost for side in state.sides)}
        fences |= {claimant.fence for claimant in table.claimants.values()}
        serials: list[set[int]] = [{0, side.serial, side.settled, side.awaits[0]} for side in state.sides]
        for number, channel in enumerate((*state.to_repository, *state.to_managers)):
            for token in _tokens(channel):
                fences |= self._numbers[token][0]
                serials[number % 2] |= self._numbers[token][1]
        for number, _, body in state.answers:
            fences |= _fences_in(body)
            serials[number].add(_)
        for number, task in enumerate(TASKS):
            serials[number].add(table.last_serial(task))
        fence_ranks = {fence: rank for rank, fence in enumerate(sorted(fences))}
        serial_ranks = [{serial: rank for rank, serial in enumerate(sorted(serial for serial in used if serial >= 0))} for used in serials]
        for ranks in serial_ranks:
            ranks |= {serial: serial for serial in (-1, -2)}
        renumber = _Renumbering(fence_ranks, serial_ranks, _changed(fence_ranks), [_changed(ranks) for ranks in serial_ranks])
        arrivals = {arrival: rank for rank, arrival in enumerate(sorted(claimant.arrival for claimant in table.claimants.values()), 1)}
        for task, claimant in table.claimants.items():
            claimant.arrival, claimant.fence = arrivals[claimant.arrival], fence_ranks[claimant.fence]
            claimant.serial = serial_ranks[TASKS.index(task)][claimant.serial]
        table.arrivals, table.fences = len(arrivals), FRESH
        table.ended = {task: serial_ranks[TASKS.index(task)][serial] for task, serial in sorted(table.ended.items())}
        sides = [
            side._replace(
                fence=fence_ranks[side.fence],
                lost=fence_ranks[side.lost],
                serial=serial_ranks[number][side.serial],
                settled=serial_ranks[number][side.settled],
                awaits=(serial_ranks[number][side.awaits[0]], side.awaits[1]),
            )
            for number, side in enumerate(state.sides)
        ]
        to_repository = [self._renumbered(channel, number, renumber) for number, channel in enumerate(state.to_repository)]
        to_managers = [self._renumbered(channel, number, renumber) for number, channel in enumerate(state.to_managers)]
        answers = frozenset(
            (number, serial_ranks[number][serial], renumber.message(body, number)) for number, serial, body in state.answers
        )
        return State((sides[0], sides[1]), _frozen(table), answers, (to_repository[0], to_repository[1]), (to_managers[0], to_managers[1]))

    def _renumbered(self, channel: Channel, number: int, renumber: _Renumbering) -> Channel:
        tokens = {token: token for token in _tokens(channel)}
        for token in tokens:
            if renumber.changes(self._numbers[token], number):
                tokens[token] = self.token(renumber.message(self.messages[token], number))
        if all(before == after for before, after in tokens.items()):
            return channel
        masks = (sum(1 << tokens[token] for token in members(mask)) for mask in (channel.unacknowledged, channel.copies))
        return Channel(tuple(tokens[token] for token in channel.queue), *masks)


class _Renumbering(NamedTuple):
    """The ranks of numbers, and the numbers that are not their own ranks."""

    fences: dict[int, int]
    serials: list[dict[int, int]]
    changed_fences: set[int]
    changed_serials: list[set[int]]

    def changes(self, numbers: tuple[set[int], set[int]], number: int) -> bool:
        """Whether a message with these fences and serials becomes another one."""
        fences, serials = numbers
        return not (fences.isdisjoint(self.changed_fences) and serials.isdisjoint(self.changed_serials[number]))

    def message(self, message: Any, number: int) -> Any:
        """The message with ranks in place of its numbers."""
        if not isinstance(message, Struct):
            return message
        changes: dict[str, Any] = {}
        if hasattr(message, "fence"):
            changes["fence"] = self.fences[message.fence]
        if hasattr(message, "serial"):
            changes["serial"] = self.serials[number][message.serial]
        if isinstance(message, Answer):
            changes["body"] = self.message(message.body, number)
        if isinstance(message, ClaimReservations):
            changes["claims"] = tuple(self.message(claim, number) for claim in message.claims)
        return structs.replace(message, **changes)


_ONTOLOGY, _MAP = Ontology(), Map()


def _contents(table: Reservations) -> Contents:
    return Contents(ontology=_ONTOLOGY, map=_MAP, reservations=table)


def _frozen(table: Reservations) -> tuple[Any, ...]:
    claimants = tuple((task, *_frozen_claimant(claimant)) for task, claimant in sorted(table.claimants.items()))
    return claimants, tuple(sorted(table.ended.items())), tuple(sorted(table.heard_at.items())), table.arrivals, table.fences


def _frozen_claimant(claimant: Claimant) -> tuple[Any, ...]:
    waiting = claimant.waiting.changes if claimant.waiting is not None else None
    return (
        claimant.holder, claimant.priority, claimant.arrival, claimant.serial, claimant.held.changes, claimant.fence, waiting,
        claimant.admitted, claimant.overtakings,
    )  # fmt: skip


def _thawed(frozen: tuple[Any, ...]) -> Reservations:
    claimants, ended, heard_at, arrivals, fences = frozen
    by_task = {
        task: Claimant(
            holder=holder, goal="", priority=priority, arrival=arrival, serial=serial, held=Reservation(changes=held), fence=fence,
            waiting=Reservation(changes=waiting) if waiting is not None else None, admitted=admitted, overtakings=overtakings,
        )
        for task, holder, priority, arrival, serial, held, fence, waiting, admitted, overtakings in claimants
    }  # fmt: skip
    return Reservations(claimants=by_task, ended=dict(ended), heard_at=dict(heard_at), arrivals=arrivals, fences=fences)


def _put(pair: tuple[Any, Any], number: int, value: Any) -> tuple[Any, Any]:
    return (value, pair[1]) if number == 0 else (pair[0], value)


@lru_cache(KEPT_CHANNELS)
def _tokens(channel: Channel) -> tuple[int, ...]:
    return tuple(dict.fromkeys((*channel.queue, *members(channel.unacknowledged | channel.copies))))


def _changed(ranks: dict[int, int]) -> set[int]:
    return {number for number, rank in ranks.items() if number != rank}


def _serials_in(message: Any) -> set[int]:
    return {getattr(part, "serial", 0) for part in (message, *getattr(message, "claims", ()))}


def _fences_in(message: Any) -> set[int]:
    match message:
        case Answer(body=body):
            return _fences_in(body)
        case ClaimReservations(claims=claims):
            return {claim.fence for claim in claims}
        case _:
            return {getattr(message, "fence", 0)}
