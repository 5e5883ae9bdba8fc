"""What a Task Manager has asked of the Repository and the Registry, and who waits for the answers.

A question is asked again under its own id until it is answered or out of time; whoever is asked knows it by its id.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from somrs.kernel.component import Effect, Send, Wake
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Discover, Discovered, Offer
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Rejected, UpdateMap

PATIENCE = 10.0
"""Seconds after which a question without an answer is asked again."""

DISCOVERY_TIME = 30.0
"""Seconds that the Registry has to answer: without services there is nothing to plan with."""

UPDATE_TIME = 86_400.0
"""Seconds for which the Repository is told what was reported: it may be down for a while, and has to know."""

Then = Callable[[Message, float], None]
Discovery = Callable[[tuple[Offer, ...] | str, float], None]
"""Called with all that is on offer, or with why that cannot be had."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Question:
    message: Message
    then: Then
    until: float


class Questions:
    """Every answer is given to the function that came with its question; when none comes in time, a Fault."""

    def __init__(self, address: str, repository: str, registry: str, effects: list[Effect]) -> None:
        self.address, self.repository, self.registry = address, repository, registry
        self._effects = effects
        self._open: dict[str, _Question] = {}
        self._incarnation = 0.0
        self._asked = 0

    def start(self, now: float) -> None:
        """The time is part of the ids: what was asked in an earlier life that is forgotten is another question."""
        self._incarnation = self._incarnation or now

    def update(self, body: UpdateMap, then: Then, now: float) -> None:
        """Have the Repository change its map."""
        self._ask(self.repository, body, then, now, UPDATE_TIME)

    def discover(self, then: Discovery, now: float, found: tuple[Offer, ...] = ()) -> None:
        """Read from the Registry, page by page, all that is on offer; or why that cannot be had."""

        discover = Discover(after=found[-1].service if found else "")
        self._ask(self.registry, discover, partial(self._discovered, then, found), now, DISCOVERY_TIME)

    def _discovered(self, then: Discovery, found: tuple[Offer, ...], answer: Message, now: float) -> None:
        if not isinstance(answer.body, Discovered):
            then(f"the Service Registry answered: {said(answer)}", now)
            return
        offers = found + answer.body.offers
        if answer.body.more and answer.body.offers:
            self.discover(then, now, offers)
        else:
            then(offers, now)

    def answered(self, message: Message, now: float) -> bool:
        """Whether the message is the answer to a question."""
        question = self._open.pop(message.header.relates_to or "", None)
        if question is None:
            return False
        self._effects.append(Wake(_timer(question.message), None))
        question.then(message, now)
        return True

    def undelivered(self, message: Message, reason: str, now: float) -> bool:
        """Whether the message that never arrived was a question."""
        return self._again(message.header.message_id, f"{message.header.recipient} could not be reached: {reason}", now)

    def ring(self, timer: str, now: float) -> bool:
        """Whether the timer is that of a question, whose answer is overdue."""
        kind, _, id = timer.partition(" ")
        if kind == "answer" and (question := self._open.get(id)) is not None:
            self._again(id, f"{question.message.header.recipient} does not answer", now)
        return kind == "answer"

    def _ask(self, recipient: str, body: Body, then: Then, now: float, seconds: float) -> None:
        self._asked += 1
        id = message_id(self.address, self._incarnation, self._asked)
        header = Header(sender=self.address, recipient=recipient, message_id=id, reply_to=self.address)
        self._open[id] = _Question(message=Message(header=header, body=body), then=then, until=now + seconds)
        self._say(self._open[id], now)

    def _say(self, question: _Question, now: float) -> None:
        until = min(now + PATIENCE, question.until)
        self._effects += [Send(question.message, until), Wake(_timer(question.message), until + PATIENCE / 2)]

    def _again(self, id: str, trouble: str, now: float) -> bool:
        question = self._open.get(id)
        if question is None:
            return False
        if now < question.until:
            self._say(question, now)
            return True
        del self._open[id]
        self._effects.append(Wake(_timer(question.message), None))
        question.then(Message(header=question.message.header, body=Fault(code="env:Receiver", text=trouble)), now)
        return True


def _timer(message: Message) -> str:
    return f"answer {message.header.message_id}"


def said(answer: Message) -> str:
    """What an answer that is not the wanted one says."""
    match answer.body:
        case Rejected(problems=problems):
            return "; ".join(problems)
        case Fault(text=text):
            return text
        case body:
            return type(body).__name__
