"""Passes changes of neighbours' objects on to their homes.

What an update says is worked out here, where its words mean something: which objects it speaks of, and what is news. The changes of objects
that neighbours own go to their homes, one after the other. When the map here has what they have made of it, the rest of the update is done,
and its sender has the answer. If a home refuses its part, the rest is not done; what other homes have done before stays, because a report
says what is true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from msgspec import structs

from somrs.kernel.component import Effects, EffectsReturning, Send
from somrs.ontology.conformance import Violation
from somrs.ontology.homes import renamed_change
from somrs.ontology.objects import Change, Fact, FactAdded, ObjectAdded, objects_of
from somrs.ontology.qualified_names import home_of, translated
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id, normalised_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Alteration, BrokenRule, Rejected, Updated, UpdateMap
from somrs.protocol.messages.neighbours import Neighbour
from somrs.protocol.messages.observations import Observation
from somrs.protocol.messages.reservations import Reserve, UnderReservation
from somrs.repository.neighbour_state import ForwardedUpdate, NeighbourState
from somrs.repository.neighbour_view import View
from somrs.repository.outcome import Outcome
from somrs.repository.state import Contents
from somrs.repository.update import format_change

FORWARDING_TIME = 86_400.0
"""Seconds for which a request is sent to a neighbour, whose host may be down for long."""

HOME = "home"
"""The rule that a change breaks which is not for this Repository to make."""

Answering = Callable[[Message, Rejected], Send]
"""Gives the answer to an update, and remembers it."""


def foreign_parts(outcome: Outcome, alteration: UpdateMap, author: str, contents: Contents) -> dict[str, UpdateMap]:
    """The changes of neighbours' objects as updates for their homes, by map."""
    changes: dict[str, list[Change]] = {}
    for change in outcome.changes:
        if home := _home_of_change(change):
            changes.setdefault(home, []).append(change)
    return {home: _part(home, changes[home], alteration, author, contents) for home in sorted(changes)}


def own_changes(outcome: Outcome) -> tuple[Change, ...]:
    """The changes of objects that have their home here."""
    return tuple(change for change in outcome.changes if not _home_of_change(change))


def superseded_at_homes(outcome: Outcome) -> tuple[str, ...]:
    """The changes of neighbours' objects that are still to be made when their homes have the update: they have newer news."""
    return tuple(format_change(change) for change in outcome.changes if _home_of_change(change))


def _home_of_change(change: Change) -> str:
    return home_of(objects_of(change)[0]) if objects_of(change) else ""


def _part(home: str, changes: list[Change], alteration: UpdateMap, author: str, contents: Contents) -> UpdateMap:
    observed = alteration.observation
    return UpdateMap(
        changes=tuple(renamed_change(change, lambda name: translated(name, contents.map.name, home)) for change in changes),
        author=author,
        observation=Observation(as_of=observed.as_of, caused=observed.caused) if observed is not None else None,
        reservation=reservation_at(home, alteration.reservation, contents),
    )


def reservation_at(home: str, reservation: UnderReservation | None, contents: Contents) -> UnderReservation | None:
    """The reservation under which a task of this Repository reports, as the neighbour has it.

    Its number is 0 if the task has lost it: then the neighbour refuses the report if another task has the objects. None: the task has what
    it reports under, and has reserved nothing of the neighbour.
    """
    if reservation is None:
        return None
    shared = contents.shared_reservations.get(reservation.task)
    fence = shared.fences.get(home) if shared is not None else None
    if fence is None and contents.reservations.is_held(reservation.task, reservation.fence):
        return None
    return structs.replace(reservation, fence=fence or 0)


def refusals(alteration: Alteration, outcome: Outcome, sender: str, contents: Contents) -> Iterator[Violation]:
    """Violations for changes that are not for this Repository, or not for this sender, to make."""
    if (neighbour := contents.neighbour_at(sender)) is not None:
        yield from _overreaching(neighbour.settings, outcome, contents)
    for name in dict.fromkeys(objects_of(change)[0] for change in outcome.changes if objects_of(change)):
        home = home_of(name)
        if home and home not in contents.neighbours:
            yield Violation(subject=name, rule=HOME, message=f"there is no neighbour {home} whose object it could be")
        elif home and not isinstance(alteration, UpdateMap):
            yield Violation(subject=name, rule=HOME, message=f"belongs to the map {home}; change it there")
    yield from hidden_from_homes((change.fact for change in outcome.changes if isinstance(change, FactAdded)), contents)


def hidden_from_homes(facts: Iterable[Fact], contents: Contents) -> Iterator[Violation]:
    """Violations for own objects that the home of another one would have to know, and is not shown."""
    for fact in facts:
        home = home_of(fact.arguments[0]) if fact.arguments else ""
        if home in contents.neighbours:
            view = View(contents.neighbours[home].settings, contents.map, contents.ontology)
            for name in fact.arguments:
                if not home_of(name) and not view.shows(name):
                    advice = f"add it to `shows` of {home} in the file with the neighbours"
                    yield Violation(subject=name, rule=HOME, message=f"is not shown to {home}, which has to know that {fact}; {advice}")


def impossible_request(request: Reserve, sender: str, contents: Contents) -> Iterator[Violation]:
    """Violations for what a plan changes and cannot be told to the homes of objects, or is not for its owner to change."""
    yield from hidden_from_homes(request.facts, contents)
    neighbour = contents.neighbour_at(sender)
    if neighbour is not None and not neighbour.settings.may_change:
        for name in request.changes:
            yield _not_to_change(name, neighbour.settings, contents)


def _not_to_change(name: str, neighbour: Neighbour, contents: Contents) -> Violation:
    message = f"is not for {neighbour.map} to change, as the map {contents.map.name} has it"
    return Violation(subject=name, rule=HOME, message=message)


def _overreaching(neighbour: Neighbour, outcome: Outcome, contents: Contents) -> Iterator[Violation]:
    """Violations for what a neighbour may not change."""
    view = View(neighbour, contents.map, contents.ontology)
    added_names = {change.object.name for change in outcome.changes if isinstance(change, ObjectAdded)}
    for name in outcome.subjects:
        if not neighbour.may_change:
            yield _not_to_change(name, neighbour, contents)
        elif name not in added_names and not view.shows(name):
            yield Violation(subject=name, rule=HOME, message=f"is nothing that {neighbour.map} sees of the map {contents.map.name}")


class Forwarding:
    """Passes updates on. It has no state of its own."""

    def __init__(self, contents: Contents, answer: Answering) -> None:
        self._contents, self._answer = contents, answer

    def begin(self, message: Message, parts: dict[str, UpdateMap], now: float) -> Effects:
        """Pass the parts on, the first one now."""
        forwarded = self._contents.forwarded[normalised_id(message.header.message_id)] = ForwardedUpdate(
            message=message, parts=parts, since=now
        )
        yield from self._send_next(forwarded, now)

    @property
    def is_waiting(self) -> bool:
        """Whether an answer of a neighbour is due."""
        return any(forwarded.version is None for forwarded in self._contents.forwarded.values())

    def repeat(self, now: float) -> Effects:
        """Ask again, in case that an answer was lost."""
        for forwarded in [*self._contents.forwarded.values()]:
            if forwarded.version is None:
                yield from self._send_next(forwarded, now)

    def concerns(self, message: Message) -> bool:
        """Whether the message answers a part."""
        return self._find(message.header.relates_to) is not None

    def answered(self, message: Message) -> Effects:
        """Handle the answer to a part."""
        forwarded = self._find(message.header.relates_to)
        assert forwarded is not None, "concerns(message)"
        home = next(iter(forwarded.parts))
        match message.body:
            case Updated(version=version):
                forwarded.version = version
            case Rejected() as rejected:
                yield self._refused(forwarded, rejected_by(home, rejected))
            case Fault(text=text):
                yield self._refused(forwarded, Rejected(problems=(f"{home} answered: {text}",)))

    def undelivered(self, message: Message, reason: str) -> Effects:
        """A part has not reached its home for a day."""
        forwarded = self._find(message.header.message_id)
        if forwarded is not None:
            home = next(iter(forwarded.parts))
            yield self._refused(forwarded, Rejected(problems=(f"{home} could not be reached: {reason}",)))

    def proceed(self, now: float) -> EffectsReturning[list[Message]]:
        """Continue with the updates whose latest part has come back to the map. Returns those of which all parts have."""
        complete: list[Message] = []
        for id, forwarded in [*self._contents.forwarded.items()]:
            if forwarded.version is None:
                continue
            home = next(iter(forwarded.parts))
            neighbour = self._contents.neighbours.get(home)
            if neighbour is not None and neighbour.copy.version < forwarded.version:
                continue
            del forwarded.parts[home]
            forwarded.version = None
            if forwarded.parts:
                yield from self._send_next(forwarded, now)
            else:
                del self._contents.forwarded[id]
                complete.append(forwarded.message)
        return complete

    def _send_next(self, forwarded: ForwardedUpdate, now: float) -> Effects:
        home, part = next(iter(forwarded.parts.items()))
        neighbour = self._contents.neighbours.get(home)
        if neighbour is None:
            yield self._refused(forwarded, Rejected(problems=(f"{home} is no neighbour any more",)))
            return
        forwarded.request = message_id("forward", forwarded.message.header.message_id, home)
        yield request(self._contents, neighbour.settings.address, part, forwarded.request, now)

    def _refused(self, forwarded: ForwardedUpdate, rejected: Rejected) -> Send:
        del self._contents.forwarded[normalised_id(forwarded.message.header.message_id)]
        return self._answer(forwarded.message, rejected)

    def _find(self, request_id: str | None) -> ForwardedUpdate | None:
        return next((forwarded for forwarded in self._contents.forwarded.values() if forwarded.request == request_id), None)


def rejected_by(home: str, rejected: Rejected) -> Rejected:
    """The rejection by a neighbour, for the sender of the update."""
    broken = tuple(structs.replace(rule, subject=_at_home(home, rule)) for rule in rejected.broken)
    return Rejected(problems=tuple(f"{home} refuses: {problem}" for problem in rejected.problems), broken=broken)


def _at_home(home: str, rule: BrokenRule) -> str:
    return f"{home}:{rule.subject}" if rule.section == "objects" else rule.subject


def notice(contents: Contents, neighbour: NeighbourState, body: Body, now: float) -> Send:
    """What a neighbour is told."""
    return tell(contents, neighbour.settings.address, body, now)


def tell(contents: Contents, recipient: str, body: Body, now: float, seconds: float = FORWARDING_TIME) -> Send:
    """A message that has no answer. `seconds`: how long it is of use."""
    contents.notice_count += 1
    id = message_id(contents.address, recipient, type(body).__name__, contents.notice_count, now)
    header = Header(sender=contents.address, recipient=recipient, message_id=id)
    return Send(Message(header=header, body=body), now + seconds)


def request(contents: Contents, address: str, body: Body, id: str, now: float) -> Send:
    """A request to a neighbour."""
    header = Header(sender=contents.address, recipient=address, message_id=id, reply_to=contents.address)
    return Send(Message(header=header, body=body), now + FORWARDING_TIME)
