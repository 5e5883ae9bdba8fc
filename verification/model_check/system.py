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

from somrs.protocol.frp.states import WORKING, Said
from somrs.protocol.messages.frp import State
from somrs.task_manager.execution.participants import IDLE
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


class Move(NamedTuple):
    """A step of the whole: who does what, and the state then."""

    joint: str
    fair: Fair
    after: LinkState
    who: str
    step: Step | Event
    wrong: str = ""


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
        self._without: dict[tuple[int, frozenset[Said]], int] = {}

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

    def without(self, at: int, kinds: frozenset[Said]) -> int:
        """None of these types arrives any more."""
        if at == 0 or not kinds:
            return at
        if (at, kinds) not in self._without:
            self._without[at, kinds] = self.number(self.medium.without(self.all[at], self.post.of(kinds)))
        return self._without[at, kinds]

    def restarted(self, at: int) -> tuple[int, ...]:
        return tuple(self.number(channel) for channel in self.medium.restarted(self.all[at]))


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
        self._past: dict[tuple[int, int], tuple[frozenset[Said], frozenset[Said]]] = {}
        self._wanted: dict[tuple[int, int], bool] = {}

    @property
    def first(self) -> LinkState:
        return self.coordinators.first(), self.participants.first(), 0, 0

    def coordinator(self, state: LinkState) -> Coordinator:
        return self.coordinators.states[state[0]]

    def participant(self, state: LinkState) -> Participant:
        return self.participants.states[state[1]]

    def moves(self, state: LinkState) -> Iterator[Move]:
        """Everything that can happen next."""
        return (move._replace(after=self._settled(move.after)) for move in self._all_moves(state))

    def _settled(self, state: LinkState) -> LinkState:
        """Without the messages that can have no effect any more."""
        c, p, down, up = state
        if (c, p) not in self._past:
            coordinator, participant = self.coordinators.states[c], self.participants.states[p]
            done = participant.forgot or coordinator.phase is Phase.LOST
            self._past[c, p] = (self._certain if done else self._futures).past(coordinator.session.state, participant.session.state)
        past_down, past_up = self._past[c, p]
        return c, p, self._to_participant.without(down, past_down), self._to_coordinator.without(up, past_up)

    def _all_moves(self, state: LinkState) -> Iterator[Move]:
        c, p, down, up = state
        put_down, put_up = self._to_participant.put, self._to_coordinator.put
        reliable = self.model.medium.reliable
        # What a lost disk has silenced is over when the timers ring that a fair run does not need otherwise.
        late = self.model.lost_disk is Lost.COORDINATOR and self.coordinators.states[c].phase is Phase.LOST
        asks = self.model.lost_disk is Lost.PARTICIPANT
        waits = asks and self.coordinators.states[c].session.state is State.ARRANGING
        for step in self.coordinators.moves(c):
            if step.joint == "give up":
                if (after := self._given_up(state, step)) is not None:
                    yield Move("", Fair.NO, after, "tm", step)
            elif step.joint == "again":
                if self.participants.states[p].session.state in IDLE.get(self.coordinators.states[c].session.state, ()):
                    yield Move("", Fair.YES, (step.after, p, put_down(down, step.says), up), "tm", step, step.wrong)
            elif step.what != "says Query" or down == 0:  # it asks when all is silent
                fair = step.fair or _yes((asks and step.what == "says Query") or (waits and step.what == "says Cancel"))
                yield Move(step.joint, fair, (step.after, p, put_down(down, step.says), up), "tm", step, step.wrong)
        for step in self.participants.moves(p):
            fair = step.fair or _yes(late and step.joint == "timer")
            yield Move("", fair, (c, step.after, down, put_up(up, step.says)), "sm", step, step.wrong)
        for one, rest in self._to_participant.arrivals(down):
            step = self.participants.receive(p, one.token)
            fair = _yes(one.sure and (reliable or self._is_wanted(c, one.token)))
            yield Move("", fair, (c, step.after, rest, put_up(up, step.says)), "to sm", step, step.wrong)
        for one, rest in self._to_coordinator.arrivals(up):
            step = self.coordinators.receive(c, one.token)
            fair = _yes(one.sure and (reliable or self._is_repeated(p, one.token)))
            yield Move("", fair, (step.after, p, put_down(down, step.says), rest), "to tm", step, step.wrong)
        for event, rest in self._to_participant.events(down):
            if (happens := _fair(event, self._is_wanted(c, event.token))) is not None:
                yield Move("", happens, (c, p, rest, up), "down", event)
        for event, rest in self._to_participant.lapsed(down) if self.model.lapses else ():
            yield Move("", Fair.NO, (c, p, rest, up), "down", event)
        for event, rest in self._to_coordinator.events(up):
            if (happens := _fair(event, self._is_repeated(p, event.token))) is not None:
                yield Move("", happens, (c, p, down, rest), "up", event)
        if self.model.restarts:
            yield from self._restarts(state)
        if self.model.lost_disk is not Lost.NONE:
            yield from self._disk_lost(state)

    def _given_up(self, state: LinkState, step: Step) -> LinkState | None:
        """The coordinator has waited as long as the timing assumption says; None when it has to wait for longer."""
        _, p, down, up = state
        if self.model.cut_off and self.participants.states[p].moving:
            return None
        while self.model.clocks and (lapsed := self._to_participant.lapsed(down)):
            down = lapsed[0][1]
        return step.after, p, down, up

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

    def _restarts(self, state: LinkState) -> Iterator[Move]:
        c, p, down, up = state
        after, again = self.participants.restarted(p)
        for rest in self._to_coordinator.restarted(up):
            reached = (c, after, down, self._to_coordinator.put(rest, again))
            if reached != state:
                yield Move("", Fair.NO, reached, "sm", Step("is killed and restarts", after, again))
        # A Task Manager replays its journal and sends again what it had to send. Where messages are repeated anyhow, or may
        # arrive twice, that adds nothing.
        if self.model.medium.reliable and self.coordinators.states[c].phase is not Phase.LOST:
            for token in self.coordinators.said(c):
                reached = (c, p, self._to_participant.put(down, (token,)), up)
                if reached != state:
                    yield Move("", Fair.NO, reached, "tm", Step("is killed, restarts and says again", c, (token,)))

    def _disk_lost(self, state: LinkState) -> Iterator[Move]:
        c, p, down, up = state
        participant, coordinator = self.participants.states[p], self.coordinators.states[c]
        whose = self.model.lost_disk
        if whose is Lost.PARTICIPANT and not participant.forgot and participant.session.state is not State.NEW:
            for rest in self._to_coordinator.restarted(up):
                after = self.participants.without_memory(p)
                yield Move("", Fair.NO, (c, after, down, rest), "sm", Step("loses its disk", after))
        if whose is Lost.COORDINATOR and coordinator.phase is not Phase.LOST and coordinator.session.state is not State.NEW:
            for rest in self._to_participant.restarted(down):
                after = self.coordinators.without_memory(c)
                yield Move("", Fair.NO, (after, p, rest, up), "tm", Step("loses its disk", after))
