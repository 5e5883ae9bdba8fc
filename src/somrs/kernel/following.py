"""How a component follows another one that publishes changes of what it has, such as the Repository its map and the Registry its services.

The follower subscribes first, and then reads page by page; changes in the meantime arrive as events. Each event has the next version. It
states new values, not differences, so it may be applied to a page that already includes it: the last event wins. A lost message shows as a
gap between versions. If the gap does not close, the follower reads everything again.

What is copied, and the messages, are those of the subclasses: `replica.py` for the map, `service_replica.py` for services.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

from msgspec import Struct, field

from somrs.kernel.component import DeliveryFailed, Effect, Input, Received, Send, SetTimer, TimerFired
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault

LEASE = 60.0
"""Seconds that a subscription lasts; the follower renews it after a third of that time."""

PATIENCE = 5.0
"""Seconds without an answer after which the follower subscribes again."""

GAP_TIME = 1.0
"""Seconds after which a missing message counts as lost, not as out of order."""


class Reading(Struct, kw_only=True):
    """The pages read so far. `first_version` is the publisher's version at the first page, `last_version` that at the latest page."""

    first_version: int | None = field(default=None, name="first")
    last_version: int = field(default=0, name="last")
    complete: bool = False


EventT = TypeVar("EventT")
ReadingT = TypeVar("ReadingT", bound=Reading)


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed(Generic[EventT]):
    """The result of an input: `effects` to carry out, and the `events` to apply. `reloaded`: before that, the copy was read again."""

    effects: list[Effect]
    events: tuple[EventT, ...] = ()
    reloaded: bool = False


class Following(Struct, Generic[EventT, ReadingT], kw_only=True):
    """`version` is the publisher's as far as received; `ready` becomes true when everything has been read.

    `confirmed`: whether the publisher has stated its version since the owner started, so that it is known how much the copy lacks.

    The owner passes every input to the copy first, and carries out the effects. The copy uses one timer, `timer`.
    """

    SUBSCRIBED: ClassVar[Any]
    """The answer to a subscription. It has the publisher's version. Unasked, it says that news may be missing."""
    QUESTIONS: ClassVar[tuple[type, ...]]
    PAGES: ClassVar[Any]
    EVENTS: ClassVar[Any]

    owner: str
    version: int = -1
    source: str = ""
    """The address that the publisher gives itself. `publisher` may be another name of the same address."""
    events: dict[int, EventT] = {}
    announced_version: int = field(default=-1, name="announced")
    """The latest version that a message mentioned."""
    reading: ReadingT | None = None
    question_count: int = field(default=0, name="asked")
    question: str | None = None
    subscription: str | None = None
    subscribed_at: int = -1
    asked_at: float = 0.0
    """When the latest subscription was sent."""
    known_since: float = 0.0
    """When the latest subscription was sent that was answered: the copy has, or misses and knows it, what the publisher had then."""
    answer_by: float | None = None
    gap_until: float | None = None
    renew_at: float = 0.0
    confirmed: bool = True

    @property
    def ready(self) -> bool:
        return self.version >= 0

    @property
    def is_current(self) -> bool:
        """Whether nothing is known to be missing."""
        return self.ready and self.confirmed and self.announced_version <= self.version

    def start(self, now: float) -> list[Effect]:
        """Subscribe. The reply starts the reading, or tells how much the copy lacks."""
        self.confirmed = False
        return self.ask_version(now)

    def ask_version(self, now: float) -> list[Effect]:
        """Ask the publisher for its version."""
        return [self._subscribe(now), self._next_timer()]

    def follow(self, event: Input, now: float) -> Followed[EventT] | None:
        """Handle an input; None if it does not concern the copy."""
        match event:
            case Received(message):
                effects = self._received(message, now)
            case DeliveryFailed(message):
                effects = self._delivery_failed(message, now)
            case TimerFired(timer) if timer == self.timer:
                effects = self._check_deadlines(now)
            case _:
                effects = None
        return None if effects is None else self._catch_up(effects, now)

    # What is followed

    @property
    def timer(self) -> Any:
        """The timer of this copy. Each copy of a component has its own."""
        raise NotImplementedError

    @property
    def publisher(self) -> str:
        """The address of the component that is followed."""
        raise NotImplementedError

    def _subscription(self) -> Body:
        """The request for changes, for `LEASE` seconds."""
        raise NotImplementedError

    def _new_reading(self) -> ReadingT:
        raise NotImplementedError

    def _first_question(self) -> Body:
        """The request for the first page."""
        raise NotImplementedError

    def _version_of(self, event: Any) -> int:
        raise NotImplementedError

    def _is_out_of_place(self, reading: ReadingT, page: Any) -> bool:
        """Whether the page does not continue the earlier ones, so that the reading begins anew."""
        return False

    def _add_page(self, reading: ReadingT, page: Any) -> Body | None:
        """Add the page to the reading. Returns the request for the next one; None if it was the last."""
        raise NotImplementedError

    def _adopt(self, reading: ReadingT, now: float) -> None:
        """Make the pages the copy."""
        raise NotImplementedError

    # Requests

    def _subscribe(self, now: float) -> Send:
        self.renew_at = now + LEASE / 3
        self.subscribed_at, self.asked_at = self.version, now
        send = self._ask(self._subscription(), now)
        self.subscription = send.message.header.message_id
        return send

    def _read(self, body: Body, now: float) -> Send:
        send = self._ask(body, now)
        self.question = send.message.header.message_id
        return send

    def _ask(self, body: Body, now: float) -> Send:
        # The time is part of the id, so that an owner that lost its state does not use earlier ids again.
        self.question_count += 1
        identity = message_id(self.owner, self.publisher, "replica", self.question_count, now)
        header = Header(sender=self.owner, recipient=self.publisher, message_id=identity, reply_to=self.owner)
        self.answer_by = now + PATIENCE
        return Send(Message(header=header, body=body), expires_at=now + PATIENCE)

    def _begin_reading(self, now: float) -> list[Effect]:
        self.reading = self._new_reading()
        return [self._read(self._first_question(), now)]

    def _give_up_reading(self, now: float) -> list[Effect]:
        """Subscribe again: the reply states the publisher's current version."""
        self.reading = self.question = None
        return [self._subscribe(now)]

    def _check_deadlines(self, now: float) -> list[Effect]:
        if self.answer_by is not None and self.answer_by <= now:
            return self._give_up_reading(now)
        if self.gap_until is not None and self.gap_until <= now:
            return self._begin_reading(now)
        return [self._subscribe(now)] if self.renew_at <= now else []

    def _delivery_failed(self, message: Message, now: float) -> list[Effect] | None:
        ours = isinstance(message.body, self.QUESTIONS) and message.header.recipient == self.publisher
        if ours and message.header.message_id in (self.question, self.subscription):
            self.answer_by = now + GAP_TIME
        return [] if ours else None

    # Messages

    def _received(self, message: Message, now: float) -> list[Effect] | None:
        """The immediate effects of a message; `_catch_up` applies the events that it completes."""
        body: Any = message.body
        request_id = message.header.relates_to
        if request_id is not None and request_id in (self.question, self.subscription):
            if isinstance(body, self.SUBSCRIBED) and request_id == self.subscription:
                self.source = message.header.sender
                return self._subscribed(body, now)
            if isinstance(body, self.PAGES) and request_id == self.question and self.reading is not None:
                return self._page(self.reading, body, now)
            if isinstance(body, Fault):
                return []  # the request is repeated after `PATIENCE`
        if message.header.sender not in (self.source or self.publisher, self.publisher):
            return None
        if isinstance(body, self.EVENTS):
            version = self._version_of(body)
            self.events[version] = body
            self.announced_version = max(self.announced_version, version)
            return []
        if isinstance(body, self.SUBSCRIBED) and request_id is None:
            return [self._subscribe(now)]
        return [] if isinstance(body, (self.SUBSCRIBED, *self.PAGES)) else None  # the reply to an abandoned request

    def _subscribed(self, answer: Any, now: float) -> list[Effect]:
        self.subscription, self.confirmed, self.known_since = None, True, self.asked_at
        if self.reading is None:
            self.answer_by = None
        if answer.version < self.subscribed_at:  # the publisher was restored from a backup or is new: this is a copy of something else
            self._begin_anew()
        self.announced_version = max(self.announced_version, answer.version)
        return self._begin_reading(now) if not self.ready and self.reading is None else []

    def _begin_anew(self) -> None:
        """Read everything again. The copy stays as it is until then."""
        self.version = self.announced_version = -1
        self.events.clear()
        self.reading = None

    def _page(self, reading: ReadingT, page: Any, now: float) -> list[Effect]:
        self.question = self.answer_by = None
        if reading.first_version is None:
            reading.first_version = page.version
        elif page.version < reading.last_version or self._is_out_of_place(reading, page):
            return self._give_up_reading(now)
        reading.last_version = page.version
        if (question := self._add_page(reading, page)) is not None:
            return [self._read(question, now)]
        reading.complete = True
        self.announced_version = max(self.announced_version, reading.last_version)
        return []

    # Events

    def _catch_up(self, effects: list[Effect], now: float) -> Followed[EventT]:
        """Take the received events, up to the first gap."""
        old_version = self.version
        reloaded = self._conclude_reading(now)
        events: list[EventT] = []
        while self.ready and (event := self.events.get(self.version + 1)) is not None:
            self.version += 1
            events.append(event)
        self._forget()
        self._watch_gap(self.version != old_version, now)
        return Followed(effects=[*effects, self._next_timer()], events=tuple(events), reloaded=reloaded)

    def _conclude_reading(self, now: float) -> bool:
        """Make the pages the copy, if all events between the versions of the first and the last page have arrived."""
        reading = self.reading
        if reading is None or not reading.complete or reading.first_version is None:
            return False
        if any(version not in self.events for version in range(reading.first_version + 1, reading.last_version + 1)):
            return False
        self._adopt(reading, now)
        self.version = reading.first_version
        self.reading = None
        return True

    def _forget(self) -> None:
        """Drop the events that neither the copy nor the pages being read need."""
        reached = self.version
        if self.reading is not None:
            reached = min(reached, self.reading.first_version if self.reading.first_version is not None else -1)
        self.events = {version: event for version, event in self.events.items() if version > reached}

    def _watch_gap(self, moved: bool, now: float) -> None:
        is_lagging = self.ready and self.announced_version > self.version
        waiting = is_lagging if self.reading is None else self.reading.complete
        if not waiting:
            self.gap_until = None
        elif moved or self.gap_until is None or self.gap_until <= now:
            self.gap_until = now + GAP_TIME

    def _next_timer(self) -> SetTimer:
        return SetTimer(self.timer, min(time for time in (self.renew_at, self.answer_by, self.gap_until) if time is not None))
