"""A person as a device: one service asks where an object is, and the others have the person do a step of a plan.

Questions are answered with a formula, by `somrs answer` or in the windows. An answer must state facts in terms of the ontology and the
map; other answers are rejected with a caret under the error, and the question stays open. `working.py` has the steps.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from msgspec import structs

from somrs.devices.person.answers import check_answer
from somrs.devices.person.assignments import Assignments, Work
from somrs.devices.person.questions import Questions
from somrs.devices.person.simulated_hands import put_in_place
from somrs.devices.person.working import check_available, do_work
from somrs.entish.formula import Formula, names, variables
from somrs.entish.parse import parse
from somrs.errors import FormulaError, RemoteError
from somrs.service_manager.sdk.device import Device, Result, Service, Situation, Task, service
from somrs.service_manager.sdk.orders import ServiceFailed

DEFAULT_PRICE = "20 EUR"
"""The price of an observation. It is high, so that robots and cameras are preferred."""


RECOGNIZE = "RecognizeSituation"
OFFERS = "Offers"
"""The attribute of a person with the names of the service types that the person offers."""
WORK_TIME = "10 min"
"""The duration that a person's terms state for a step."""


async def _price(device: Person, task: Task) -> float | str:
    rows = await task.map.query(f"{device.name}.Price = ?Price")
    return rows[0]["Price"] if rows else DEFAULT_PRICE


class Person(Device):
    """A person who answers questions, and does the steps that the attribute `Offers` of the person's object names."""

    type = "Person"
    capacity = 5
    """The number of questions and assignments that may be open at the same time."""
    patience: float = 300.0
    """Seconds for which a question stays open."""
    glance: float = 0.3
    """Seconds between two checks for an answer."""
    heartbeat = 5.0

    def __init__(self, name: str, simulator: str | None = None) -> None:
        super().__init__(name, simulator)
        self._offered: dict[str, Service] = {}

    async def open(self) -> None:
        self._questions, self.assignments = Questions(self.data), Assignments(self.data)
        self.assignments.code_of(self.name)
        for end_all in (self._questions.end_all, self.assignments.end_all):
            end_all(self.name, f"the program of {self.name} was restarted")
        self._offered = {f"do_{name}": _step(name) for name in await self._offered_types()}

    async def _offered_types(self) -> list[str]:
        """The service types that the person offers besides RecognizeSituation, as the map says."""
        person = await self.map.object(self.name)
        text = person.values.get(OFFERS) if person is not None else None
        return [name for name in dict.fromkeys(str(text or "").replace(",", " ").split()) if name != RECOGNIZE]

    def services(self) -> Mapping[str, Service]:
        return {**super().services(), **self._offered}

    async def close(self) -> None:
        self._questions.end_all(self.name, f"the program of {self.name} ended")
        self.assignments.end_all(self.name, f"the program of {self.name} ended")
        self._questions.close()
        self.assignments.close()

    @service(RECOGNIZE, price=_price, duration="2 min", able=check_available)
    async def recognize(self, task: Task) -> Situation:
        object = str(task.inputs["Object"])
        number = self._questions.ask(self.name, object, await _question(task, object), self.patience)
        reason = "the answer is no longer needed"
        try:
            await task.progress(0.0, note=f"question {number} to {self.name}: where is {object}?")
            async with asyncio.timeout(self.patience):
                while True:
                    question = self._questions.read(number)
                    assert question is not None, "questions are kept"
                    if question.answer is not None:
                        try:
                            situation = await check_answer(task, object, question.answer) if question.answer else ""
                        except (FormulaError, RemoteError) as error:
                            self._questions.reject(number, str(error))
                        else:
                            reason = "taken"
                            break
                    await asyncio.sleep(self.glance)
        except TimeoutError:
            reason = f"there was no answer within {self.patience:g} s"
            raise ServiceFailed(f"{self.name} was asked where {object} is, and did not answer within {self.patience:g} s") from None
        finally:
            self._questions.end(number, reason)
        if not situation:
            raise ServiceFailed(f"{self.name} cannot tell where {object} is")
        return situation

    @recognize.compensation
    async def compensate_recognition(self, task: Task, situation: Formula) -> Situation:
        """An observation leaves nothing to undo."""
        return f"{self.name}.Working = TRUE"


def _step(service_type: str) -> Service:
    """The service with which a person does the steps of a type."""

    async def do(person: Person, task: Task) -> Result | Situation:
        result = await do_work(person, task, _work(task, service_type, task.effect))
        situation = await put_in_place(person.name, person.simulator, task.map, parse(str(result.situation)))
        return structs.replace(result, situation=situation)

    async def undo(person: Person, task: Task, situation: Formula) -> Situation:
        await do_work(person, task, structs.replace(_work(task, service_type, situation), undoes=True))
        return await put_in_place(person.name, person.simulator, task.map, situation)

    step = Service(do, service_type, _price, WORK_TIME, check_available)
    step.compensation(undo)
    step.name = f"do_{service_type}"
    return step


def _work(task: Task, service_type: str, effect: Formula) -> Work:
    return Work(
        transaction=task.order.transaction,
        service_type=service_type,
        inputs=dict(task.order.inputs),
        effect=str(effect),
        objects=tuple(dict.fromkeys([*(text for text in task.order.inputs.values() if text.isidentifier()), *names(effect)])),
        open_variables=tuple(variables(effect)),
    )


async def _question(task: Task, object: str) -> str:
    """The text of the question, with the facts on the map about the object's position."""
    known_facts = [
        f"{object} {relation} {row['It']}" for relation in ("isOn", "isHeldBy") for row in await task.map.query(f"{object} {relation} ?It")
    ]
    return f"Where is {object}, and how is it?" + (
        f" The map says {' and '.join(known_facts)}, which may be outdated." if known_facts else ""
    )
