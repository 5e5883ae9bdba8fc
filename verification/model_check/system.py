"""A coordinator, one participant and the medium between them: their states and all their moves.

One participant's part is a `Link`. Links of one step depend on each other only by moves that are `joint`:
- `claim`: no other participant holds the step (`states.HOLDING_STATES`) when this one is accepted, or receives Compensate;
- `map`: the map says otherwise of the door; `anew`: a new session begins. Both concern only this participant;
- `cancel`, `fail`, `accomplish`, `end`, `overdue`: the transaction stops or ends for all of its participants at once.
`pair.py` composes two links by these rules.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from somrs.protocol.frp.states import UNREACHED_STATES, WORKING, MessageType
from somrs.protocol.messages.frp import State
from verification.model_check.channels import Channels, ChannelUpdate
from verification.model_check.coordinator import Coordinator, Coordinators, Phase
from verification.model_check.futures import Futures
from verification.model_check.media import Arrival, Event, Medium
from verification.model_check.participant import Participant, Participants
from verification.model_check.property import Property
from verification.model_check.sides import Action, Fair, MessageTable, is_late
from verification.model_check.step import StepKind

REPEATED_MESSAGES = frozenset(("Cancel", "End", "Terms", "Refuse", "Completed", "Failed", "Stopped", "Compensated", "Stranded"))
"""The messages that are repeated for a day. Progress, Query, Status and Fault are not, and orders only in the states below."""

REPEATED_ORDERS = {"Arrange": State.ARRANGING, "Accept": State.COMMITTED, "Execute": State.EXECUTING, "Stop": State.STOPPING,
          "Compensate": State.COMPENSATING}  # fmt: skip
"""The coordinator's state in which it repeats an order."""

LinkState = tuple[int, int, int, int]
"""The numbers of the coordinator's state, the participant's state, and the channels to the participant and to the coordinator."""


class LostDisk(Enum):
    """The side that may lose its journal, once and at any moment."""

    NONE = "none"
    PARTICIPANT = "the participant's"
    COORDINATOR = "the coordinator's"


@dataclass(frozen=True, kw_only=True)
class Model:
    """A configuration. Without `cut_off` or `clocks`, the timing assumption of this package does not hold."""

    medium: Medium
    restarts: bool = True
    """Either side may be killed at any moment, and restarts from its journal."""
    lost_disk: LostDisk = LostDisk.NONE
    lapses: bool = False
    """An order in transit may expire at any moment; otherwise when its participant is given up."""
    cut_off: bool = True
    """A device has stopped when its participant is given up."""
    kind: StepKind = StepKind.PLAIN
    reuses_ids: bool = False
    """A new session has the ids of the one before it; otherwise, ids of its own."""
    clocks: bool = True
    """An order in transit has expired by the participant's clock, too, when the participant is given up."""


TransitionKind = tuple[str, Fair, bool]
"""The kind of a move: the transaction's rule for it, its fairness, and whether it is the coordinator's own."""


class Transition(NamedTuple):
    """A step of the whole system: the actor, the action, and the state after it."""

    kind: TransitionKind
    target: LinkState
    actor: str
    action: Action | Event
    wrong: str = ""

    @property
    def violates(self) -> Property:
        """The property that a wrong step violates."""
        return self.action.violates if isinstance(self.action, Action) else Property.VALID_STATE

    @property
    def joint(self) -> str:
        return self.kind[0]


class _LinkAction(NamedTuple):
    """A move, independent of the messages in transit: the new states of both sides, and the update of each channel."""

    kind: TransitionKind
    c: int
    p: int
    down_update: ChannelUpdate
    up_update: ChannelUpdate
    actor: str
    action: Action

    def transition(self, down_channel: int, up_channel: int) -> Transition:
        return Transition(
            self.kind,
            (self.c, self.p, self.down_update[down_channel], self.up_update[up_channel]),
            self.actor,
            self.action,
            self.action.wrong,
        )


class _Pair(NamedTuple):
    """The moves of two sides, each in one state. `at_participant` and `at_coordinator` have arrivals, by token and `is_repeated`."""

    actions: tuple[_LinkAction, ...]
    queries: tuple[_LinkAction, ...]
    """Only when nothing is in transit to the participant."""
    abandonments: tuple[_LinkAction, ...]
    new_sessions: tuple[_LinkAction, ...]
    restarts: tuple[_LinkAction, ...]
    loses_disk: tuple[_LinkAction, ...]
    at_participant: dict[tuple[int, bool], _LinkAction]
    at_coordinator: dict[tuple[int, bool], _LinkAction]
    down_update: ChannelUpdate
    up_update: ChannelUpdate


def _fair(event: Event, is_repeated: bool) -> Fair | None:
    """The fairness of the event; None if it cannot happen, because a message that is still repeated does not run out of time."""
    if event.word == "is out of time":
        return None if is_repeated else Fair.YES
    return _yes((is_repeated and event.is_repeated) is (event.word == "is sent again"))


def _yes(fair: bool) -> Fair:
    return Fair.YES if fair else Fair.NO


class Link:
    """One participant's part of the transaction, with all its moves."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.participant_inbox, self.coordinator_inbox = MessageTable(), MessageTable()
        self._futures = Futures(lost_disk=model.lost_disk is not LostDisk.NONE)
        self._certain = Futures(lost_disk=False, queries=model.lost_disk is LostDisk.PARTICIPANT)
        self.coordinators = Coordinators(
            inbox=self.coordinator_inbox, outbox=self.participant_inbox, futures=self._futures, kind=model.kind
        )
        self.coordinators.queries = model.lost_disk is LostDisk.PARTICIPANT
        self.participants = Participants(
            inbox=self.participant_inbox, outbox=self.coordinator_inbox, futures=self._futures, kind=model.kind
        )
        self._to_participant, self._to_coordinator = (
            Channels(model.medium, self.participant_inbox),
            Channels(model.medium, self.coordinator_inbox),
        )
        self._pairs: dict[tuple[int, int], _Pair] = {}
        self._channel_updates: dict[tuple[Channels, tuple[int, ...], frozenset[MessageType]], ChannelUpdate] = {}
        self._order_repeats: dict[tuple[int, int], bool] = {}

    @property
    def first(self) -> LinkState:
        return self.coordinators.first(), self.participants.first(), 0, 0

    def coordinator(self, state: LinkState) -> Coordinator:
        return self.coordinators.states[state[0]]

    def participant(self, state: LinkState) -> Participant:
        return self.participants.states[state[1]]

    def transitions(self, state: LinkState) -> Iterator[Transition]:
        """Yield all moves from this state. The channels contain no messages that cannot have an effect any more."""
        c, p, down_channel, up_channel = state
        pair = self._pairs.get((c, p)) or self._pair(c, p)
        to_participant, to_coordinator = self._to_participant, self._to_coordinator
        for link_action in pair.actions:
            yield link_action.transition(down_channel, up_channel)
        for link_action in pair.queries if down_channel == 0 else ():
            yield link_action.transition(down_channel, up_channel)
        for link_action in pair.abandonments:
            yield link_action.transition(self._too_late(down_channel), up_channel)
        for link_action in pair.new_sessions:
            yield self._begun_anew(link_action, down_channel, up_channel)
        for arrival, rest in to_participant.arrivals(down_channel):
            yield (
                pair.at_participant.get((arrival.token, arrival.is_repeated)) or self._heard_by_participant(pair, c, p, arrival)
            ).transition(rest, up_channel)
        for arrival, rest in to_coordinator.arrivals(up_channel):
            yield (
                pair.at_coordinator.get((arrival.token, arrival.is_repeated)) or self._heard_by_coordinator(pair, c, p, arrival)
            ).transition(down_channel, rest)
        for event, rest in to_participant.events(down_channel):
            if (fairness := _fair(event, self._is_order_repeated(c, event.token))) is not None:
                yield Transition(("", fairness, False), (c, p, pair.down_update[rest], up_channel), "down", event)
        for event, rest in to_participant.lapsed(down_channel) if self.model.lapses else ():
            yield Transition(("", Fair.NO, False), (c, p, pair.down_update[rest], up_channel), "down", event)
        for event, rest in to_coordinator.events(up_channel):
            if (fairness := _fair(event, self._is_report_repeated(p, event.token))) is not None:
                yield Transition(("", fairness, False), (c, p, down_channel, pair.up_update[rest]), "up", event)
        for link_action in pair.restarts:
            for rest in to_coordinator.restarted(up_channel) if link_action.actor == "sm" else (up_channel,):
                yield link_action.transition(down_channel, rest)
        for link_action in pair.loses_disk:
            if link_action.actor == "sm":
                yield from (link_action.transition(down_channel, rest) for rest in to_coordinator.restarted(up_channel))
            else:
                yield from (link_action.transition(rest, up_channel) for rest in to_participant.restarted(down_channel))

    def _pair(self, c: int, p: int) -> _Pair:
        coordinator, participant = self.coordinators.states[c], self.participants.states[p]
        # After the loss of the coordinator's disk, termination requires the participant's timers; a fair run needs none otherwise.
        late = self.model.lost_disk is LostDisk.COORDINATOR and coordinator.phase is Phase.LOST
        is_queried = self.model.lost_disk is LostDisk.PARTICIPANT
        waits = is_queried and coordinator.session.state is State.ARRANGING
        actions: list[_LinkAction] = []
        queries: list[_LinkAction] = []
        abandonments: list[_LinkAction] = []
        new_sessions: list[_LinkAction] = []
        for action in self.coordinators.actions(c):
            if action.joint == "give up":
                if not (self.model.cut_off and participant.moving):
                    abandonments.append(self._link_action(("", Fair.NO, True), action.target, p, "tm", action))
            elif action.joint == "anew":
                if participant.session.state is State.ENDED and not participant.moving:
                    p_after = p if self.model.reuses_ids else self.participants.first()
                    new_sessions.append(self._link_action(("anew", Fair.YES, True), action.target, p_after, "tm", action))
            elif action.joint == "again":
                if participant.session.state in UNREACHED_STATES.get(coordinator.session.state, ()):
                    actions.append(self._link_action(("", Fair.YES, True), action.target, p, "tm", action))
            else:
                query = action.description == "sends Query"
                fair = action.fair or _yes((is_queried and query) or (waits and action.description == "sends Cancel"))
                (queries if query else actions).append(self._link_action((action.joint, fair, True), action.target, p, "tm", action))
        for action in self.participants.actions(p):
            actions.append(
                self._link_action(("", action.fair or _yes(late and action.joint == "timer"), False), c, action.target, "sm", action)
            )
        ineffective_down, ineffective_up = self._ineffective_messages(c, p)
        pair = _Pair(
            actions=tuple(actions),
            queries=tuple(queries),
            abandonments=tuple(abandonments),
            new_sessions=tuple(new_sessions),
            restarts=tuple(self._restarts(c, p)) if self.model.restarts else (),
            loses_disk=tuple(self._disk_lost(c, p)),
            at_participant={},
            at_coordinator={},
            down_update=self._channel_update(self._to_participant, (), ineffective_down),
            up_update=self._channel_update(self._to_coordinator, (), ineffective_up),
        )
        self._pairs[c, p] = pair
        return pair

    def _link_action(self, kind: TransitionKind, c: int, p: int, actor: str, action: Action) -> _LinkAction:
        """Return a move to the sides' states `c` and `p`. The side that acts or receives sends the action's messages."""
        ineffective_down, ineffective_up = self._ineffective_messages(c, p)
        from_coordinator = actor in ("tm", "to tm")
        down_update = self._channel_update(self._to_participant, action.tokens if from_coordinator else (), ineffective_down)
        up_update = self._channel_update(self._to_coordinator, () if from_coordinator else action.tokens, ineffective_up)
        return _LinkAction(kind, c, p, down_update, up_update, actor, action)

    def _begun_anew(self, link_action: _LinkAction, down_channel: int, up_channel: int) -> Transition:
        """Begin a new session. The one before must have left nothing behind: no message of it can have an effect any more."""
        if self.model.reuses_ids:
            return link_action.transition(down_channel, up_channel)
        transition = link_action.transition(0, 0)
        if down_channel or up_channel:
            wrong = "a message of the session before can still have an effect"
            return transition._replace(wrong=wrong)
        return transition

    def _channel_update(self, channels: Channels, tokens: tuple[int, ...], ineffective: frozenset[MessageType]) -> ChannelUpdate:
        key = channels, tokens, ineffective
        if key not in self._channel_updates:
            self._channel_updates[key] = ChannelUpdate(channels, tokens, ineffective)
        return self._channel_updates[key]

    def _ineffective_messages(self, c: int, p: int) -> tuple[frozenset[MessageType], frozenset[MessageType]]:
        """Return the types of messages to the participant, and of those to the coordinator, that cannot have an effect any more."""
        coordinator, participant = self.coordinators.states[c], self.participants.states[p]
        lost_memory = participant.forgot or coordinator.phase is Phase.LOST
        return (self._certain if lost_memory else self._futures).ineffective_messages(coordinator.session.state, participant.session.state)

    def _heard_by_participant(self, pair: _Pair, c: int, p: int, arrival: Arrival) -> _LinkAction:
        action = self.participants.receive(p, arrival.token)
        fair = _yes(arrival.is_repeated and (self.model.medium.reliable or self._is_order_repeated(c, arrival.token)))
        link_action = pair.at_participant[arrival.token, arrival.is_repeated] = self._link_action(
            ("", fair, False), c, action.target, "to sm", action
        )
        return link_action

    def _heard_by_coordinator(self, pair: _Pair, c: int, p: int, arrival: Arrival) -> _LinkAction:
        action = self.coordinators.receive(c, arrival.token)
        fair = _yes(arrival.is_repeated and (self.model.medium.reliable or self._is_report_repeated(p, arrival.token)))
        link_action = pair.at_coordinator[arrival.token, arrival.is_repeated] = self._link_action(
            ("", fair, False), action.target, p, "to tm", action
        )
        return link_action

    def _too_late(self, down_channel: int) -> int:
        """Return the channel to the participant after the waiting time of the timing assumption: with `clocks`, its orders have expired."""
        while self.model.clocks and (lapsed := self._to_participant.lapsed(down_channel)):
            down_channel = lapsed[0][1]
        return down_channel

    def _is_order_repeated(self, c: int, token: int) -> bool:
        """Whether the coordinator's node repeats the message until it arrives."""
        if (c, token) not in self._order_repeats:
            name, late = self.participant_inbox.name(token), is_late(self.participant_inbox.messages[token])
            self._order_repeats[c, token] = name in REPEATED_MESSAGES or (
                not late and REPEATED_ORDERS.get(name) is self.coordinators.states[c].session.state
            )
        return self._order_repeats[c, token]

    def _is_report_repeated(self, p: int, token: int) -> bool:
        """Whether the participant repeats the message until it arrives. Heartbeats follow each other as long as it works."""
        name = self.coordinator_inbox.name(token)
        return name in REPEATED_MESSAGES or (name == "Progress" and self.participants.states[p].session.state in WORKING)

    def _restarts(self, c: int, p: int) -> Iterator[_LinkAction]:
        target, tokens = self.participants.restarted(p)
        yield self._link_action(("", Fair.NO, False), c, target, "sm", Action("is killed and restarts", target, tokens))
        # A Task Manager replays its journal and sends again what it had to send. On media that repeat or duplicate messages, this adds
        # nothing.
        if self.model.medium.reliable and self.coordinators.states[c].phase is not Phase.LOST:
            for token in self.coordinators.repeatable_tokens(c):
                yield self._link_action(("", Fair.NO, True), c, p, "tm", Action("is killed, restarts and sends again", c, (token,)))

    def _disk_lost(self, c: int, p: int) -> Iterator[_LinkAction]:
        participant, coordinator = self.participants.states[p], self.coordinators.states[c]
        lost_disk = self.model.lost_disk
        if lost_disk is LostDisk.PARTICIPANT and not participant.forgot and participant.session.state is not State.NEW:
            target = self.participants.without_memory(p)
            yield self._link_action(("", Fair.NO, False), c, target, "sm", Action("loses its disk", target))
        if lost_disk is LostDisk.COORDINATOR and coordinator.phase is not Phase.LOST and coordinator.session.state is not State.NEW:
            target = self.coordinators.without_memory(c)
            yield self._link_action(("", Fair.NO, True), target, p, "tm", Action("loses its disk", target))
