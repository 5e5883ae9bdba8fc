"""How a person does a step: the assignment, the replies to it, and what they mean to the Task Manager.

| reply | the Task Manager receives |
|---|---|
| accept | Progress with a note |
| decline, not now, none in time | Failed with `tried` FALSE: nothing was begun, and another service does the step |
| done | Completed with the effect, or with what the person found out |
| could not | Failed with what the person says of what is left |

When the Task Manager stops a person at work, a second assignment says so, and asks what is so now.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Protocol

from msgspec import structs

from somrs.devices.person.answers import check_situation, known, unknown_objects
from somrs.devices.person.assignments import UNANSWERED, Assignments, Reply, ReplyKind, Work
from somrs.devices.person.offers import PersonOffers
from somrs.devices.person.outcomes import PLACING, possible_outcomes, present_situation
from somrs.devices.person.spots import Point, free_spot
from somrs.devices.person.wording import in_words
from somrs.entish.formula import (
    Attribute,
    Comparison,
    Formula,
    Name,
    Number,
    Relation,
    Variable,
    conjunction,
    conjuncts,
    names,
    substitute,
    variables,
)
from somrs.entish.parse import parse
from somrs.errors import FormulaError, RemoteError
from somrs.ontology.types import WORKING
from somrs.protocol.messages.observations import Observation
from somrs.service_manager.sdk.device import Result, Situation, Task
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from somrs.service_manager.sdk.values import python_value, term

ACCEPTED = 0.1
"""The fraction of the work that an acceptance counts as."""


class Worker(Protocol):
    """The person's device, as far as it matters here."""

    name: str
    glance: float
    assignments: Assignments

    @property
    def offers(self) -> PersonOffers: ...

    def observed(self, situation: str) -> None: ...


async def check_available(person: Worker, task: Task) -> None:
    """Raise Refusal if the person is not available, or has declined this step."""
    if await task.map.holds(f"{person.name}.{WORKING} = FALSE"):
        raise Refusal(f"{person.name} is not available now", not_now=True)
    if person.assignments.has_declined(person.name, task.order.transaction, str(task.effect)):
        raise Refusal(f"{person.name} has declined this step")


async def describe_work(person: Worker, task: Task, service_type: str, effect: Formula) -> Work:
    """What the person is to do, in words, too."""
    inputs = [text for text in task.order.inputs.values() if text.isidentifier()]
    present = await present_situation(task.map, effect)
    return Work(
        transaction=task.order.transaction,
        participant=task.order.participant,
        service_type=service_type,
        inputs=dict(task.order.inputs),
        effect=str(effect),
        objects=tuple(dict.fromkeys([*inputs, *names(effect)])),
        open_variables=tuple(variables(effect)),
        aim=await in_words(task.map, effect),
        present=await in_words(task.map, present) if present is not None else "",
        outcomes=await possible_outcomes(task.map, person.name, effect),
    )


async def do_work(person: Worker, task: Task, work: Work) -> Result:
    """Have the person do the work. Returns the result with the effect. Raises ServiceFailed as the person replies."""
    assignments = person.assignments
    number = assignments.assign(person.name, work)
    reason = "it is no longer needed"
    try:
        await task.progress(0.0, note=f"assignment {number} to {person.name}: {work.effect}")
        async with asyncio.timeout(person.offers.answer_time) as answer_time:
            while True:
                reply = await _next_reply(person, number)
                try:
                    result = await _read_reply(person.name, task, work, reply)
                except (FormulaError, RemoteError) as error:
                    assignments.reject(number, str(error))
                except ServiceFailed:
                    reason = reply.kind.value
                    if reply.kind is ReplyKind.NOT_NOW:
                        person.observed(f"{person.name}.{WORKING} = FALSE")
                    raise
                else:
                    if result is not None:
                        reason = reply.kind.value
                        return result
                    answer_time.reschedule(None)
                    assignments.accept(number)
                    await task.progress(ACCEPTED, note=f"{person.name} has accepted assignment {number}")
    except TimeoutError:
        reason = UNANSWERED
        person.observed(f"{person.name}.{WORKING} = FALSE")
        text = f"{person.name} did not answer within {person.offers.answer_time:g} s, and counts as not available"
        raise ServiceFailed(text, tried=False) from None
    finally:
        assignments.end(number, reason)


async def stop_work(person: Worker, task: Task) -> Situation:
    """Tell the person to stop, and return what is so then; None if the person does not say.

    What the person had not accepted has not been begun: then the situation is what it was.
    """
    assignments = person.assignments
    stopped = assignments.latest(person.name, task.order.transaction, task.order.participant)
    if stopped is None:
        return None
    if stopped.accepted is None:
        return await present_situation(task.map, parse(stopped.work.effect)) or f"{person.name}.{WORKING} = TRUE"
    outcomes = await possible_outcomes(task.map, person.name, parse(stopped.work.effect))
    number = assignments.assign(person.name, structs.replace(stopped.work, stops=True, outcomes=outcomes, open_variables=()))
    reason = UNANSWERED
    try:
        async with asyncio.timeout(person.offers.answer_time):
            while True:
                reply = await _next_reply(person, number)
                situation = stopped.work.effect if reply.kind is ReplyKind.DONE else reply.situation
                try:
                    checked = await check_situation(task, situation) if situation else None
                except (FormulaError, RemoteError) as error:
                    assignments.reject(number, str(error))
                else:
                    reason = reply.kind.value
                    return checked
    except TimeoutError:
        return None
    finally:
        assignments.end(number, reason)


async def _next_reply(person: Worker, number: int) -> Reply:
    while True:
        assignment = person.assignments.read(number)
        assert assignment is not None, "assignments are kept"
        if assignment.reply is not None:
            return assignment.reply
        await asyncio.sleep(person.glance)


async def _read_reply(provider: str, task: Task, work: Work, reply: Reply) -> Result | None:
    """The result of the work; None if the person does it now.

    Raises:
        ServiceFailed: the person does not do it, or could not.
        FormulaError, RemoteError: the reply is not suitable.
    """
    because = f": {reply.reason}" if reply.reason else ""
    match reply.kind:
        case ReplyKind.ACCEPT:
            return None
        case ReplyKind.DECLINE:
            raise ServiceFailed(f"{provider} declined{because}", tried=False)
        case ReplyKind.NOT_NOW:
            raise ServiceFailed(f"{provider} has no time now{because}", tried=False)
        case ReplyKind.COULD_NOT:
            situation = str(await check_situation(task, reply.situation)) if reply.situation else None
            raise ServiceFailed(f"{provider} could not do it{because}", situation)
        case ReplyKind.DONE:
            return await _done(task, work, reply)


async def _done(task: Task, work: Work, reply: Reply) -> Result:
    """The result of work that is done: what the person has found out, or else the effect with the values that it leaves open."""
    if reply.situation or reply.searched:
        return await _finding(task, reply)
    for name in unknown_objects(parse(work.effect)):
        problem = f"where {name} is, and how it is, is missing"
        raise FormulaError(work.effect, max(work.effect.find(name), 0), problem, f"state it: `{name} isOn` and the name of an object")
    for name in work.open_variables:
        text = reply.values.get(name, "").strip()
        if not text:
            raise FormulaError(work.effect, max(work.effect.find(f"?{name}"), 0), f"the value of ?{name} is missing", "state it")
        for variable in variables(term(text)):
            raise FormulaError(text, 0, f"?{variable} is not a value", "write a number, a quoted text, or the name of an object")
    situation = substitute(parse(work.effect), {name: term(reply.values[name]) for name in work.open_variables})
    await task.map.query(situation, limit=1)
    return Result(outputs={name: python_value(reply.values[name]) for name in work.open_variables}, situation=situation)


async def _finding(task: Task, reply: Reply) -> Result:
    """What the person has found out, as a report that the Repository matches with the objects that it knows."""
    for name in reply.searched:
        if await task.map.object(name) is None:
            raise FormulaError(name, 0, f"there is no object {name} on the map", "name the support or the space that was seen whole")
    if reply.situation:
        found = await check_situation(task, reply.situation, sightings=True)
        placements = [part for part in conjuncts(found) if isinstance(part, Relation) and part.relation in PLACING]
        known_parts = [known(placement.arguments[0]) for placement in placements]
        situation = conjunction(*dict.fromkeys([*conjuncts(found), *await _positions(task, placements), *known_parts]))
    else:
        situation = parse(f"{task.provider}.{WORKING} = TRUE")
    return Result(situation=situation, observation=Observation(searched=reply.searched) if reply.searched else None)


async def _positions(task: Task, placements: Sequence[Relation]) -> list[Formula]:
    """Where the sighted objects are that have no names: an object of the map has a position."""
    taken: list[Point] = []
    parts: list[Formula] = []
    for placement in placements:
        thing, place = placement.arguments
        if isinstance(thing, Variable) and isinstance(place, Name):
            x, y, z = await free_spot(task.map, task.provider, place.name, taken)
            taken.append((x, y))
            position = zip("XYZ", (x, y, z), strict=True)
            parts += [Comparison(Attribute(thing, f"Position{axis}"), "=", Number(round(value, 3), "m")) for axis, value in position]
    return parts
