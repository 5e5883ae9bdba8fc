"""Gives objects another home: what a neighbour's place holds belongs to its map, wherever it came from.

The home that an object leaves says so to the new one, again and again until it answers; the new one adds the object to its map, and says
under which name. Both are written down before they are said, so that the object has exactly one home in the end, whichever of the two dies
when. Until the answer, updates of the object wait. Devices stay with their owners, and so does what they hold.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import structs

from somrs.kernel.component import Effects, EffectsReturning
from somrs.kernel.reservations import Claimant, Granted, Reservation
from somrs.ontology.homes import renamed_fact
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved
from somrs.ontology.qualified_names import home_of, translated
from somrs.protocol.messages.envelope import Message, message_id
from somrs.protocol.messages.neighbours import Adopt, Adopted, AdoptionRefused
from somrs.protocol.messages.reservations import Claim, Release, ReservationMode, Reserved
from somrs.repository.committing import Committing
from somrs.repository.forwarding import notice, request, tell
from somrs.repository.importing import Importing
from somrs.repository.neighbour_state import Handover, NeighbourState, SharedReservation
from somrs.repository.outcome import Outcome
from somrs.repository.publishing import Publishing
from somrs.repository.reports import free_name, location_facts, things_at
from somrs.repository.shared_reserving import SharedReserving
from somrs.repository.state import Contents
from somrs.repository.update import changes_outcome


class HandingOver:
    """Gives and takes objects. It has no state of its own."""

    def __init__(
        self, contents: Contents, committing: Committing, publishing: Publishing, importing: Importing, reserving: SharedReserving
    ) -> None:
        self._contents, self._committing, self._publishing = contents, committing, publishing
        self._importing, self._reserving = importing, reserving

    # Giving

    def begin(self, names: Iterable[str], now: float) -> Effects:
        """Hand over those of the objects that are at a place of a neighbour now."""
        contents = self._contents
        for name in names:
            home = self._new_home(name)
            if home and name not in contents.handovers:
                id = message_id("handover", contents.address, name, home, contents.version)
                contents.handovers[name] = handover = Handover(id=id, object=name, map=home, since=now)
                yield from self._ask(handover, now)

    def _new_home(self, name: str) -> str:
        contents = self._contents
        object = contents.map.objects.get(name)
        if object is None or home_of(name) or contents.ontology.is_device(object.type):
            return ""
        for fact in location_facts(name, contents.map, contents.ontology):
            place = contents.map.objects.get(fact.arguments[1]) if len(fact.arguments) == 2 else None
            if place is not None and home_of(place.name) in contents.neighbours and not contents.ontology.is_device(place.type):
                return home_of(place.name)
        return ""

    def _ask(self, handover: Handover, now: float) -> Effects:
        contents = self._contents
        neighbour, name = contents.neighbours[handover.map], handover.object
        claimants = contents.reservations.claimants
        claims = {task: self._claim(task, claimant) for task, claimant in claimants.items()}
        body = Adopt(
            handover=handover.id,
            object=contents.map.objects[name],
            facts=tuple(contents.map.facts_from(name)),
            times=contents.provenance.times.get(name, {}),
            claims=tuple(
                claims[task]
                for task, claimant in claimants.items()
                if name in claimant.held.changes and claimant.holder != neighbour.settings.address
            ),
            had=tuple(claims[task] for task, claimant in claimants.items() if name in claimant.had - claimant.held.changes),
            overtaken=tuple(task for task, claimant in claimants.items() if name in claimant.overtaken),
        )
        yield request(contents, neighbour.settings.address, body, handover.id, now)

    def _claim(self, task: str, claimant: Claimant) -> Claim:
        repository = claimant.holder if self._contents.neighbour_at(claimant.holder) is not None else ""
        return Claim(task=task, serial=claimant.serial, goal=claimant.goal, priority=claimant.priority, repository=repository)

    def defers(self, message: Message, names: Iterable[str]) -> bool:
        """Whether an update of these objects waits for the end of a handover."""
        handover = next((handover for name in names if (handover := self._contents.handovers.get(name)) is not None), None)
        if handover is not None and not any(waiting.header.message_id == message.header.message_id for waiting in handover.deferred):
            handover.deferred.append(message)
        return handover is not None

    def answered(self, message: Message) -> None:
        """The new home has the object, or refuses it."""
        contents = self._contents
        handover = next((pending for pending in contents.handovers.values() if pending.id == message.header.relates_to), None)
        if handover is None or handover.adopted is not None:
            return  # it was answered before
        if isinstance(message.body, Adopted):
            handover.adopted = message.body
        elif isinstance(message.body, AdoptionRefused):
            contents.neighbours[handover.map].omissions[handover.object] = "; ".join(message.body.problems)
            handover.refused = True

    def proceed(self, now: float) -> EffectsReturning[list[Message]]:
        """End the handovers whose objects the new homes have, as the copies of their maps show, or refuse. Returns the updates that have
        waited for that."""
        contents = self._contents
        deferred: list[Message] = []
        for handover in [*contents.handovers.values()]:
            neighbour, adopted = contents.neighbours[handover.map], handover.adopted
            if not handover.refused and (adopted is None or neighbour.copy.version < adopted.version):
                continue
            del contents.handovers[handover.object]
            if adopted is not None:
                yield from self._leave(handover, adopted, now)
            if not any(pending.map == handover.map for pending in contents.handovers.values()):
                yield from self._importing.add_postponed(neighbour, now)
            deferred += handover.deferred
        return deferred

    @property
    def is_waiting(self) -> bool:
        """Whether an answer of a neighbour is due."""
        return any(handover.adopted is None for handover in self._contents.handovers.values())

    def repeat(self, now: float) -> Effects:
        """Ask again, in case that an answer was lost. A home that cannot be reached is asked for ever: it may have the object already."""
        for handover in self._contents.handovers.values():
            if handover.adopted is None:
                yield from self._ask(handover, now)

    def _leave(self, handover: Handover, adopted: Adopted, now: float) -> Effects:
        """The object is not one of this map any more. What the neighbour shows of it stays, under its name there."""
        contents, name, neighbour = self._contents, handover.object, self._contents.neighbours[handover.map]
        new_name = translated(adopted.name, handover.map, contents.map.name)
        contained = [thing for thing in things_at(name, contents.map, contents.ontology) if not home_of(thing)]
        neighbour.adopted.pop(adopted.name, None)
        neighbour.postponed.pop(adopted.name, None)
        if adopted.name in neighbour.copy.map.objects:
            changes = tuple(self._renaming(name, structs.replace(contents.map.objects[name], name=new_name), ()))
            yield from self._commit(changes, name, new_name, handover.map, now)
            yield from self._importing.refresh(neighbour, adopted.name, now)
        else:
            facts = [*contents.map.facts_about(name)]
            yield from self._commit((*map(FactRemoved, facts), ObjectRemoved(name)), "", "", handover.map, now)
        for task, fence in adopted.fences.items():
            claimant = contents.reservations.claimants.get(task)
            if claimant is not None and not claimant.held.changes.isdisjoint((name, new_name)):
                shared = contents.shared_reservations.setdefault(task, SharedReservation(task_manager=claimant.holder))
                shared.fences[handover.map] = fence
            else:  # it has released the object in the meantime
                serial = 2 * contents.reservations.last_serial(task) + 1
                yield notice(contents, neighbour, Release(task=task, serial=serial, ended=claimant is None), now)
        for task, claimant in contents.reservations.claimants.items():
            if {name, new_name} & claimant.had and contents.neighbour_at(claimant.holder) is None:
                # The new home knows of it, too, until it has ended.
                contents.shared_reservations.setdefault(task, SharedReservation(task_manager=claimant.holder)).asked[handover.map] = None
        yield from self.begin(contained, now)

    # Taking

    def adopt(self, message: Message, body: Adopt, now: float) -> EffectsReturning[Adopted | AdoptionRefused]:
        """Give a neighbour's object its home here. Returns the answer."""
        contents, sender = self._contents, message.header.sender
        neighbour = contents.neighbour_at(sender)
        if neighbour is None or not neighbour.settings.may_change:
            problem = f"{sender} is not a neighbour from which the map {contents.map.name} takes objects"
            return AdoptionRefused(handover=body.handover, problems=(problem,))
        old_name = translated(body.object.name, neighbour.settings.map, contents.map.name)
        name = self._free_name(body.object)
        object = structs.replace(body.object, name=name)
        stated = [renamed_fact(fact, lambda n: name if n == body.object.name else self._here(n, neighbour)) for fact in body.facts]
        changes = [*self._renaming(old_name, object, stated)]
        outcome = changes_outcome(contents.map, contents.ontology, changes)
        if outcome.broken:
            return AdoptionRefused(handover=body.handover, problems=tuple(map(str, outcome.broken)))
        yield from self._commit(tuple(changes), old_name, name, neighbour.settings.map, now)
        contents.provenance.times[name] = dict(body.times)
        neighbour.adopted[body.object.name] = None
        self._reserving.yield_claimed(name, neighbour.settings.map)
        fences: dict[str, int] = {}
        for task, fence in self._reserve(name, body.claims, sender, now):
            if (holder := contents.reservations.claimants[task].holder) == sender:
                fences[task] = fence
            else:
                yield tell(contents, holder, Reserved(task=task, fence=fence), now)
        yield from self._note_earlier(name, body, sender, now)
        return Adopted(handover=body.handover, name=name, fences=fences, version=contents.version)

    def _here(self, name: str, neighbour: NeighbourState) -> str:
        return translated(name, neighbour.settings.map, self._contents.map.name)

    def _free_name(self, object: Object) -> str:
        objects = self._contents.map.objects
        return object.name if object.name not in objects else free_name(object.type, objects)

    def _note_earlier(self, name: str, body: Adopt, sender: str, now: float) -> Effects:
        """Know which tasks had reserved the object, and after which of them others have changed it: that is not theirs to undo."""
        contents, reservations = self._contents, self._contents.reservations
        for claim in body.had:
            claimant = reservations.claimants.get(claim.task)
            if claimant is None:
                if claim.task in reservations.ended or claim.repository == contents.address:
                    continue
                holder, serial = self._holder(claim, sender)
                reservations.arrivals += 1
                claimant = Claimant(holder=holder, goal=claim.goal, priority=claim.priority, arrival=reservations.arrivals, serial=serial)
                reservations.claimants[claim.task] = claimant
                if holder != sender:
                    yield tell(contents, holder, Reserved(task=claim.task, fence=0), now)
            claimant.had |= {name}
            if claim.task in body.overtaken:
                claimant.overtaken |= {name}

    def _holder(self, claim: Claim, sender: str) -> tuple[str, int]:
        """Who reserves for a task, and the number of its latest message. A task of a common neighbour goes on reserving for itself."""
        is_known = self._contents.neighbour_at(claim.repository) is not None
        return (claim.repository, claim.serial) if is_known else (sender, 2 * claim.serial)

    def _reserve(self, name: str, claims: Iterable[Claim], sender: str, now: float) -> Iterator[tuple[str, int]]:
        """The tasks of the neighbour that have reserved the object have it here, too."""
        reservations = self._contents.reservations
        for claim in claims:
            holder, serial = self._holder(claim, sender)
            claimant = Claimant(holder=holder, goal=claim.goal, priority=claim.priority, arrival=0)
            reservation = Reservation(changes=frozenset((name,)))
            granted = reservations.reserve(claim.task, claimant, reservation, ReservationMode.UNDO, now)
            if isinstance(granted, Granted):
                task_claimant = reservations.claimants[claim.task]
                task_claimant.serial = max(task_claimant.serial, serial)
                reservations.heard_at[holder] = now
                yield claim.task, granted.fence

    # Both

    def _renaming(self, old_name: str, object: Object, stated: Iterable[Fact]) -> Iterator[Change]:
        """The changes that give an object another name. `stated`: facts of it that are not on the map under the old name."""
        map = self._contents.map
        facts = [*map.facts_about(old_name)]
        yield from (FactRemoved(fact) for fact in facts)
        if old_name in map.objects:
            yield ObjectRemoved(old_name)
        if object.name not in map.objects:
            yield ObjectAdded(object)
        renamed = (renamed_fact(fact, lambda name: object.name if name == old_name else name) for fact in facts)
        if stated or object.name in map.objects:
            renamed = (fact for fact in renamed if fact.arguments[0] != object.name)
        for fact in dict.fromkeys((*renamed, *stated)):
            if all(name in map.objects or name == object.name for name in fact.arguments):
                yield FactAdded(fact)

    def _commit(self, changes: tuple[Change, ...], old_name: str, new_name: str, author: str, now: float) -> Effects:
        contents = self._contents
        is_renamed = old_name in contents.map.objects
        renamed = (Renaming(section=Section.OBJECTS, name=old_name, to=new_name),) if is_renamed else ()
        outcome = Outcome(map=contents.map.changed(changes), ontology=contents.ontology, changes=changes, renamed=renamed)
        news = yield from self._committing.commit(outcome, author, now)
        yield from self._publishing.publish(news, now)
