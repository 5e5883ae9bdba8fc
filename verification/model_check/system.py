"""A coordinator, one participant and the medium between them: their states, and every move they can make.

One participant's part is a `Link`. Links of one step depend on each other only by moves that are `joint`:
- `claim`: nobody else holds the step (`states.HOLDS`) when this one's terms are accepted, or when it is to undo;
- `cancel`, `fail`, `accomplish`, `end`, `overdue`: the transaction stops or ends, for all of its participants at once.
`pair.py` puts two links together by these rules.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from somrs.protocol.frp.states import WORKING, MessageType
from somrs.protocol.messages.frp import State
from somrs.task_manager.execution.participants import UNREACHED_STATES
from verification.model_check.coordinator import Coordinator, Coordinators, Phase
from verification.model_check.futures import Futures
from verification.model_check.media import EMPTY, Arrival, Channel, Event, Medium, members
from verification.model_check.participant import Participant, Participants
from verification.model_check.sides import Fair, Post, Step, is_late

SURE = frozenset(("Cancel", "End", "Terms", "Refuse", "Completed", "Failed", "Stopped", "Compensated", "Stranded"))
"""What is sent again for a day. Signs of life, questions and Faults are not, and orders only while they are wanted."""

WANTED = {"Arrange": State.ARRANGING, "Accept": State.COMMITTED, "Execute": State.EXECUTING, "Stop": State.STOPPING,
          "Compensate": State.COMPENSATING}  # fmt: skip
"""The coordinator's state in which it sends an order again."""

LinkState = tuple[int, int, int, int]
"""The numbers of the coordinator's state, the participant's, and of the channels to the participant and to the coordinator."""


class Lost(Enum):
    """Whose journal may be lost, once and at any moment."""

    NONE = "nobody's"
    PARTICIPANT = "the participant's"
    COORDINATOR = "the coordinator's"


@dataclass(frozen=True, kw_only=True)
class Model:
    """One configuration. Without `cut_off` and `clocks`, the timing assumption of this package does not hold."""

    medium: Medium
    restarts: bool = True
    """Either side may be killed and started again from its journal at any moment."""
    lost_disk: Lost = Lost.NONE
    lapses: bool = False
    """An order under way may come to be too late at any moment; if not, when its participant is given up."""
    cut_off: bool = True
    """No device moves any more when its participant is given up."""
    clocks: bool = True
    """An order that is under way when a participant is given up is too late by the participant's clock, too."""


Kind = tuple[str, Fair, bool]
"""Of a move: the rule of the transaction for it, whether a fair run has it happen, and whether it is the coordinator's own."""


class Move(NamedTuple):
    """A step of the whole: who does what, and the state then."""

    kind: Kind
    after: LinkState
    who: str
    step: Step | Event
    wrong: str = ""

    @property
    def joint(self) -> str:
        return self.kind[0]


class _Channels:
    """The states of the channels of one direction by number."""

    def __init__(self, medium: Medium, post: Post) -> None:
        self.medium, self.post = medium, post
        self.all: list[Channel] = [EMPTY]
        self._numbers: dict[Channel, int] = {EMPTY: 0}
        self._put: dict[tuple[int, tuple[int, ...]], int] = {}
        self._arrivals: dict[int, tuple[tuple[Arrival, int], ...]] = {}
        self._events: dict[int, tuple[tuple[Event, int], ...]] = {}
        self._lapsed: dict[int, tuple[tuple[Event, int], ...]] = {}
        self._restarted: dict[int, tuple[int, ...]] = {}

    def number(self, channel: Channel) -> int:
        if channel not in self._numbers:
            self._numbers[channel] = len(self.all)
            self.all.append(channel)
        return self._numbers[channel]

    def put(self, at: int, tokens: tuple[int, ...]) -> int:
        if not tokens:
            return at
        if (at, tokens) not in self._put:
            channel = self.all[at]
            for token in tokens:
                channel = self.medium.put(channel, token)
            self._put[at, tokens] = self.number(channel)
        return self._put[at, tokens]

    def arrivals(self, at: int) -> tuple[tuple[Arrival, int], ...]:
        if at not in self._arrivals:
            self._arrivals[at] = tuple((one, self.number(one.after)) for one in self.medium.arrivals(self.all[at]))
        return self._arrivals[at]

    def events(self, at: int) -> tuple[tuple[Event, int], ...]:
        if at not in self._events:
            self._events[at] = tuple((one, self.number(one.after)) for one in self.medium.events(self.all[at]))
        return self._events[at]

    def lapsed(self, at: int) -> tuple[tuple[Event, int], ...]:
        """What it is when the time of one of the orders in it is over."""
        if at not in self._lapsed:
            channel = self.all[at]
            found = []
            for token in {*channel.queue, *members(channel.unacknowledged | channel.copies)}:
                if (late := self.post.lapsed(token)) != token:
                    after = self.medium.lapsed(channel, token, late)
                    found.append((Event("is too late now", token, after, False), self.number(after)))
            self._lapsed[at] = tuple(found)
        return self._lapsed[at]

    def without(self, at: int, kinds: frozenset[MessageType]) -> int:
        """None of these types arrives any more."""
        return self.number(self.medium.without(self.all[at], self.post.of(kinds))) if at and kinds else at

    def restarted(self, at: int) -> tuple[int, ...]:
        if at not in self._restarted:
            self._restarted[at] = tuple(self.number(channel) for channel in self.medium.restarted(self.all[at]))
        return self._restarted[at]


class _After(dict[int, int]):
    """What becomes of each channel of one direction when these messages are put into it, and then none of these types counts any
    more; worked out once for each."""

    def __init__(self, channels: _Channels, says: tuple[int, ...], past: frozenset[MessageType]) -> None:
        self.channels, self.says, self.past = channels, says, past

    def __missing__(self, at: int) -> int:
        found = self[at] = self.channels.without(self.channels.put(at, self.says), self.past)
        return found


class _Act(NamedTuple):
    """A move, whatever is under way: what it makes of both sides, and of each channel."""

    kind: Kind
    c: int
    p: int
    down: _After
    up: _After
    who: str
    step: Step

    def move(self, down: int, up: int) -> Move:
        return Move(self.kind, (self.c, self.p, self.down[down], self.up[up]), self.who, self.step, self.step.wrong)


class _Pair(NamedTuple):
    """What the two sides can do, each in one state, and what became of what they heard there: a token, and whether it is repeated."""

    acts: tuple[_Act, ...]
    asks: tuple[_Act, ...]
    """Only when nothing is under way to the participant."""
    gives_up: tuple[_Act, ...]
    restarts: tuple[_Act, ...]
    loses_disk: tuple[_Act, ...]
    at_participant: dict[tuple[int, bool], _Act]
    at_coordinator: dict[tuple[int, bool], _Act]
    down: _After
    up: _After


def _fair(event: Event, wanted: bool) -> Fair | None:
    """Whether a fair run has it happen; None when it cannot happen, as the sender's time for what is wanted does not run out."""
    if event.word == "is out of time":
        return None if wanted else Fair.YES
    return _yes((wanted and event.sure) is (event.word == "is sent again"))


def _yes(fair: bool) -> Fair:
    return Fair.YES if fair else Fair.NO


class Link:
    """One participant's part in the transaction, with everything that can happen to it."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.down, self.up = Post(), Post()
        self._futures = Futures(lost_disk=model.lost_disk is not Lost.NONE)
        self._certain = Futures(lost_disk=False, queries=model.lost_disk is Lost.PARTICIPANT)
        self.coordinators = Coordinators(hears=self.up, says=self.down, futures=self._futures)
        self.coordinators.queries = model.lost_disk is Lost.PARTICIPANT
        self.participants = Participants(hears=self.down, says=self.up, futures=self._futures)
        self._to_participant, self._to_coordinator = _Channels(model.medium, self.down), _Channels(model.medium, self.up)
        self._pairs: dict[tuple[int, int], _Pair] = {}
        self._afters: dict[tuple[_Channels, tuple[int, ...], frozenset[MessageType]], _After] = {}
        self._wanted: dict[tuple[int, int], bool] = {}

    @property
    def first(self) -> LinkState:
        return self.coordinators.first(), self.participants.first(), 0, 0

    def coordinator(self, state: LinkState) -> Coordinator:
        return self.coordinators.states[state[0]]

    def participant(self, state: LinkState) -> Participant:
        return self.participants.states[state[1]]

    def moves(self, state: LinkState) -> Iterator[Move]:
        """Everything that can happen next. No channel keeps messages that can have no effect any more."""
        c, p, down, up = state
        pair = self._pairs.get((c, p)) or self._pair(c, p)
        to_participant, to_coordinator = self._to_participant, self._to_coordinator
        for act in pair.acts:
            yield act.move(down, up)
        for act in pair.asks if down == 0 else ():
            yield act.move(down, up)
        for act in pair.gives_up:
            yield act.move(self._too_late(down), up)
        for one, rest in to_participant.arrivals(down):
            yield (pair.at_participant.get((one.token, one.sure)) or self._heard_by_participant(pair, c, p, one)).move(rest, up)
        for one, rest in to_coordinator.arrivals(up):
            yield (pair.at_coordinator.get((one.token, one.sure)) or self._heard_by_coordinator(pair, c, p, one)).move(down, rest)
        for event, rest in to_participant.events(down):
            if (happens := _fair(event, self._is_wanted(c, event.token))) is not None:
                yield Move(("", happens, False), (c, p, pair.down[rest], up), "down", event)
        for event, rest in to_participant.lapsed(down) if self.model.lapses else ():
            yield Move(("", Fair.NO, False), (c, p, pair.down[rest], up), "down", event)
        for event, rest in to_coordinator.events(up):
            if (happens := _fair(event, self._is_repeated(p, event.token))) is not None:
                yield Move(("", happens, False), (c, p, down, pair.up[rest]), "up", event)
        for act in pair.restarts:
            for rest in to_coordinator.restarted(up) if act.who == "sm" else (up,):
                yield act.move(down, rest)
        for act in pair.loses_disk:
            if act.who == "sm":
                yield from (act.move(down, rest) for rest in to_coordinator.restarted(up))
            else:
                yield from (act.move(rest, up) for rest in to_participant.restarted(down))

    def _pair(self, c: int, p: int) -> _Pair:
        coordinator, participant = self.coordinators.states[c], self.participants.states[p]
        # What a lost disk has silenced is over when the timers ring that a fair run does not need otherwise.
        late = self.model.lost_disk is Lost.COORDINATOR and coordinator.phase is Phase.LOST
        asked = self.model.lost_disk is Lost.PARTICIPANT
        waits = asked and coordinator.session.state is State.ARRANGING
        acts: list[_Act] = []
        asks: list[_Act] = []
        gives_up: list[_Act] = []
        for step in self.coordinators.moves(c):
            if step.joint == "give up":
                if not (self.model.cut_off and participant.moving):
                    gives_up.append(self._act(("", Fair.NO, True), step.after, p, "tm", step))
            elif step.joint == "again":
                if participant.session.state in UNREACHED_STATES.get(coordinator.session.state, ()):
                    acts.append(self._act(("", Fair.YES, True), step.after, p, "tm", step))
            else:
                query = step.what == "says Query"
                fair = step.fair or _yes((asked and query) or (waits and step.what == "says Cancel"))
                (asks if query else acts).append(self._act((step.joint, fair, True), step.after, p, "tm", step))
        for step in self.participants.moves(p):
            acts.append(self._act(("", step.fair or _yes(late and step.joint == "timer"), False), c, step.after, "sm", step))
        past_down, past_up = self._without_effect(c, p)
        found = _Pair(
            acts=tuple(acts),
            asks=tuple(asks),
            gives_up=tuple(gives_up),
            restarts=tuple(self._restarts(c, p)) if self.model.restarts else (),
            loses_disk=tuple(self._disk_lost(c, p)),
            at_participant={},
            at_coordinator={},
            down=self._after(self._to_participant, (), past_down),
            up=self._after(self._to_coordinator, (), past_up),
        )
        self._pairs[c, p] = found
        return found

    def _act(self, kind: Kind, c: int, p: int, who: str, step: Step) -> _Act:
        """`c` and `p` are the sides' states then; what is said goes out from the side that does or hears something."""
        past_down, past_up = self._without_effect(c, p)
        from_coordinator = who in ("tm", "to tm")
        down = self._after(self._to_participant, step.says if from_coordinator else (), past_down)
        up = self._after(self._to_coordinator, () if from_coordinator else step.says, past_up)
        return _Act(kind, c, p, down, up, who, step)

    def _after(self, channels: _Channels, says: tuple[int, ...], past: frozenset[MessageType]) -> _After:
        key = channels, says, past
        if key not in self._afters:
            self._afters[key] = _After(channels, says, past)
        return self._afters[key]

    def _without_effect(self, c: int, p: int) -> tuple[frozenset[MessageType], frozenset[MessageType]]:
        """The types of messages to the participant, and of those to the coordinator, that can have no effect any more."""
        coordinator, participant = self.coordinators.states[c], self.participants.states[p]
        done = participant.forgot or coordinator.phase is Phase.LOST
        return (self._certain if done else self._futures).past(coordinator.session.state, participant.session.state)

    def _heard_by_participant(self, pair: _Pair, c: int, p: int, one: Arrival) -> _Act:
        step = self.participants.receive(p, one.token)
        fair = _yes(one.sure and (self.model.medium.reliable or self._is_wanted(c, one.token)))
        act = pair.at_participant[one.token, one.sure] = self._act(("", fair, False), c, step.after, "to sm", step)
        return act

    def _heard_by_coordinator(self, pair: _Pair, c: int, p: int, one: Arrival) -> _Act:
        step = self.coordinators.receive(c, one.token)
        fair = _yes(one.sure and (self.model.medium.reliable or self._is_repeated(p, one.token)))
        act = pair.at_coordinator[one.token, one.sure] = self._act(("", fair, False), step.after, p, "to tm", step)
        return act

    def _too_late(self, down: int) -> int:
        """What is under way to the participant when the coordinator has waited for as long as the timing assumption says."""
        while self.model.clocks and (lapsed := self._to_participant.lapsed(down)):
            down = lapsed[0][1]
        return down

    def _is_wanted(self, c: int, token: int) -> bool:
        """Whether the coordinator's node sends it again until it arrives."""
        if (c, token) not in self._wanted:
            name, late = self.down.name(token), is_late(self.down.messages[token])
            self._wanted[c, token] = name in SURE or (not late and WANTED.get(name) is self.coordinators.states[c].session.state)
        return self._wanted[c, token]

    def _is_repeated(self, p: int, token: int) -> bool:
        """Whether the participant says it until it arrives: a sign of life comes after the other, as long as it works."""
        name = self.up.name(token)
        return name in SURE or (name == "Progress" and self.participants.states[p].session.state in WORKING)

    def _restarts(self, c: int, p: int) -> Iterator[_Act]:
        after, again = self.participants.restarted(p)
        yield self._act(("", Fair.NO, False), c, after, "sm", Step("is killed and restarts", after, again))
        # A Task Manager replays its journal and sends again what it had to send. Where messages are repeated anyhow, or may
        # arrive twice, that adds nothing.
        if self.model.medium.reliable and self.coordinators.states[c].phase is not Phase.LOST:
            for token in self.coordinators.said(c):
                yield self._act(("", Fair.NO, True), c, p, "tm", Step("is killed, restarts and says again", c, (token,)))

    def _disk_lost(self, c: int, p: int) -> Iterator[_Act]:
        participant, coordinator = self.participants.states[p], self.coordinators.states[c]
        whose = self.model.lost_disk
        if whose is Lost.PARTICIPANT and not participant.forgot and participant.session.state is not State.NEW:
            after = self.participants.without_memory(p)
            yield self._act(("", Fair.NO, False), c, after, "sm", Step("loses its disk", after))
        if whose is Lost.COORDINATOR and coordinator.phase is not Phase.LOST and coordinator.session.state is not State.NEW:
            after = self.coordinators.without_memory(c)
            yield self._act(("", Fair.NO, True), after, p, "tm", Step("loses its disk", after))
