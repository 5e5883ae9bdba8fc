"""All that a Repository does with its neighbours: it follows their maps, passes changes and reservations on to the homes of objects, and
gives and takes objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from somrs.kernel.component import Effects, EffectsReturning, Send, SetTimer
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.neighbours import Adopted, AdoptionRefused
from somrs.repository.awaiting import REPETITION_TIME, notices
from somrs.repository.committing import Committing
from somrs.repository.forwarding import Forwarding
from somrs.repository.handing_over import HandingOver
from somrs.repository.importing import Importing
from somrs.repository.neighbouring import Neighbouring
from somrs.repository.publishing import Publishing
from somrs.repository.reserving import Reserving
from somrs.repository.shared_reserving import SharedReserving
from somrs.repository.state import Answer, Contents, RepetitionDue


@dataclass(frozen=True, slots=True)
class Continued:
    """Updates that have waited for neighbours: those of which neighbours have done their parts, and those that can begin now."""

    passed_on: list[Message]
    deferred: list[Message]


class Neighbourhood:
    """It has no state of its own. `answer` gives the answer to a request, and remembers it."""

    def __init__(
        self,
        contents: Contents,
        reserving: Reserving,
        committing: Committing,
        publishing: Publishing,
        answer: Callable[[Message, Answer], Send],
    ) -> None:
        self._contents = contents
        self.importing = Importing(contents, committing, publishing)
        self.neighbouring = Neighbouring(contents, self.importing, publishing)
        self.forwarding = Forwarding(contents, answer)
        self.reserving = SharedReserving(contents, reserving, answer)
        self.handing_over = HandingOver(contents, committing, publishing, self.importing, self.reserving)

    def concerns(self, message: Message) -> bool:
        """Whether the message is an answer or a notice of a neighbour."""
        is_adoption = isinstance(message.body, Adopted | AdoptionRefused)
        return is_adoption or self.forwarding.concerns(message) or self.reserving.concerns(message)

    def received(self, message: Message, now: float) -> Effects:
        """Handle an answer or a notice of a neighbour."""
        if isinstance(message.body, Adopted | AdoptionRefused):
            self.handing_over.answered(message)
        elif self.forwarding.concerns(message):
            yield from self.forwarding.answered(message)
        else:
            yield from self.reserving.received(message, now)

    def undelivered(self, message: Message, reason: str) -> Effects:
        """A request could not be delivered to a neighbour."""
        yield from self.forwarding.undelivered(message, reason)
        yield from self.reserving.undelivered(message, reason)

    def proceed(self, now: float) -> EffectsReturning[Continued]:
        """Go on with what has waited for neighbours, as far as it need not wait any more."""
        passed_on = yield from self.forwarding.proceed(now)
        deferred = yield from self.handing_over.proceed(now)
        return Continued(passed_on, deferred)

    def set_timer(self, now: float) -> Effects:
        """Set the timer for asking again, as long as an answer is due."""
        is_waiting = self.forwarding.is_waiting or self.reserving.is_waiting or self.handing_over.is_waiting
        if is_waiting is not (self._contents.repeats_at is not None):
            self._contents.repeats_at = now + REPETITION_TIME if is_waiting else None
            yield SetTimer(RepetitionDue(), self._contents.repeats_at)

    def repeat(self, now: float) -> Effects:
        """Ask neighbours again: their answers may have been lost, if they or this Repository were down. Who waits for them is told."""
        self._contents.repeats_at = None
        yield from self.forwarding.repeat(now)
        yield from self.reserving.repeat(now)
        yield from self.handing_over.repeat(now)
        yield from notices(self._contents, now)
