"""People who do steps of plans: who they are, whether they are available, what they are asked to do, and their replies."""

from __future__ import annotations

import asyncio

import msgspec

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.client.operations import operation
from somrs.client.people import codes, missed_assignments, open_assignments, put_reply
from somrs.client.refusals import NotFound
from somrs.devices.person.assignments import Assignment, Reply
from somrs.devices.person.offers import OFFERS, read_offers
from somrs.entish.parse import nearest
from somrs.ontology.types import WORKING, Ontology
from somrs.ontology.values import value_of
from somrs.protocol.messages.knowledge import UpdateMap

PERSON = "Person"
"""The type of people (upper ontology)."""
TICK = 0.5
"""Seconds between two checks for assignments while a client follows them."""


class PersonView(msgspec.Struct, frozen=True, kw_only=True):
    """A person. `code`: the code of the person's page, `/person/CODE` in the windows; None until the person's program has started.

    `offers`: the service types that the person offers besides answers to questions, with their terms; `problems`: what is wrong in them.
    `assignments`: what is open, oldest first. `missed`: the assignment to which the person did not reply in time, and is therefore not
    available.
    """

    name: str
    label: str | None = None
    code: str | None = None
    available: bool = True
    offers: str = ""
    problems: tuple[str, ...] = ()
    assignments: tuple[Assignment, ...] = ()
    missed: Assignment | None = None


class People(msgspec.Struct, frozen=True, kw_only=True):
    """All people on the map, by name."""

    people: tuple[PersonView, ...]


class Availability(msgspec.Struct, frozen=True, kw_only=True):
    available: bool


def _unknown_type(service_type: str, ontology: Ontology) -> str:
    return f"the ontology has no service type {service_type}. {nearest(service_type, ontology.services)}".rstrip()


class PeopleService:
    def __init__(self, context: Context) -> None:
        self._context = context
        context.hub.feed("people", self._feed)

    @operation("GET", "/people", Right.SEE)
    async def list(self) -> People:
        """List the people on the map with their open assignments.

        The topic `people` publishes the same list whenever it changes.
        """
        data, map, ontology = self._context.data, self._context.map, self._context.ontology
        page_codes, assignments, missed = await asyncio.to_thread(lambda: (codes(data), open_assignments(data), missed_assignments(data)))
        names = sorted(name for name, object in map.objects.items() if ontology.is_subtype(object.type, PERSON))

        def view(name: str) -> PersonView:
            label = value_of(name, "Label", map, ontology)
            available = value_of(name, WORKING, map, ontology) is not False
            offers = read_offers(map.objects[name])
            unknown = (step.service_type for step in offers.steps if step.service_type not in ontology.services)
            problems = (*offers.problems, *(f"Offers: {_unknown_type(service_type, ontology)}" for service_type in unknown))
            return PersonView(
                name=name,
                label=str(label) if label is not None else None,
                code=page_codes.get(name),
                available=available,
                offers=str(value_of(name, OFFERS, map, ontology) or ""),
                problems=problems,
                assignments=tuple(assignment for assignment in assignments if assignment.person == name),
                missed=None if available else missed.get(name),
            )

        return People(people=tuple(view(name) for name in names))

    @operation("POST", "/people/{name}/availability", Right.OPERATE)
    async def set_availability(self, name: str, body: Availability) -> None:
        """Say whether a person is available. A person who is not refuses further steps, and keeps those accepted."""
        if name not in {person.name for person in (await self.list()).people}:
            raise NotFound(f"there is no person {name} on the map")
        situation = f"{name}.{WORKING} = {'TRUE' if body.available else 'FALSE'}"
        await self._context.client.update(UpdateMap(situation=situation, author=name))

    @operation("POST", "/assignments/{number}/reply", Right.OPERATE)
    async def reply(self, number: int, body: Reply) -> None:
        """Reply to an assignment: accept, decline, not now, done, or could not. An unsuitable reply is refused, and the assignment stays
        open."""
        await asyncio.to_thread(put_reply, number, body, self._context.data)

    async def _feed(self, topic: str) -> None:
        published: People | None = None
        while True:
            if (people := await self.list()) != published:
                published = people
                self._context.hub.publish(topic, people)
            await asyncio.sleep(TICK)
