"""How a person does a step: the assignment, the replies to it, and what they mean to the Task Manager.

| reply | the Task Manager receives |
|---|---|
| accept | Progress with a note |
| decline, not now | Failed with `tried` FALSE: nothing was begun, and another service does the step |
| done | Completed with the effect, and the values that the person found out |
| could not | Failed with what the person says of what is left |
"""

from __future__ import annotations

import asyncio
from typing import Protocol

from somrs.devices.person.answers import check_situation
from somrs.devices.person.assignments import Assignments, Reply, ReplyKind, Work
from somrs.entish.formula import substitute, variables
from somrs.entish.parse import parse
from somrs.errors import FormulaError, RemoteError
from somrs.ontology.types import WORKING
from somrs.service_manager.sdk.device import Result, Task
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from somrs.service_manager.sdk.values import python_value, term

ACCEPTED = 0.1
"""The fraction of the work that an acceptance counts as."""


class Worker(Protocol):
    """The person's device, as far as it matters here."""

    name: str
    glance: float
    assignments: Assignments

    def observed(self, situation: str) -> None: ...


async def check_available(person: Worker, task: Task) -> None:
    """Raise Refusal if the person is not available, or has declined this step."""
    if await task.map.holds(f"{person.name}.{WORKING} = FALSE"):
        raise Refusal(f"{person.name} is not available now", not_now=True)
    if person.assignments.has_declined(person.name, task.order.transaction, str(task.effect)):
        raise Refusal(f"{person.name} has declined this step")


async def do_work(person: Worker, task: Task, work: Work) -> Result:
    """Have the person do the work. Returns the result with the effect. Raises ServiceFailed as the person replies."""
    assignments = person.assignments
    number = assignments.assign(person.name, work)
    reason = "it is no longer needed"
    try:
        await task.progress(0.0, note=f"assignment {number} to {person.name}: {work.effect}")
        while True:
            assignment = assignments.read(number)
            assert assignment is not None, "assignments are kept"
            if (reply := assignment.reply) is not None:
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
                    assignments.accept(number)
                    await task.progress(ACCEPTED, note=f"{person.name} has accepted assignment {number}")
            await asyncio.sleep(person.glance)
    finally:
        assignments.end(number, reason)


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
    for name in work.open_variables:
        text = reply.values.get(name, "").strip()
        if not text:
            raise FormulaError(work.effect, max(work.effect.find(f"?{name}"), 0), f"the value of ?{name} is missing", "state it")
        for variable in variables(term(text)):
            raise FormulaError(text, 0, f"?{variable} is not a value", "write a number, a quoted text, or the name of an object")
    situation = substitute(parse(work.effect), {name: term(reply.values[name]) for name in work.open_variables})
    await task.map.query(situation, limit=1)
    return Result(outputs={name: python_value(reply.values[name]) for name in work.open_variables}, situation=situation)
