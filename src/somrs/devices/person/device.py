"""A person as a device: one service asks where an object is, and the others have the person do a step of a plan.

Questions are answered with a formula, by `somrs answer` or in the windows. An answer must state facts in terms of the ontology and the
map; other answers are rejected with a caret under the error, and the question stays open. `working.py` has the steps.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from contextlib import ExitStack

from msgspec import structs

from somrs.devices.person.answers import check_answer
from somrs.devices.person.assignments import Assignments
from somrs.devices.person.offers import PersonOffers, read_offers
from somrs.devices.person.questions import Questions
from somrs.devices.person.simulated_hands import put_in_place
from somrs.devices.person.working import check_available, describe_work, do_work, stop_work
from somrs.entish.formula import Formula
from somrs.entish.parse import parse
from somrs.errors import FormulaError, RemoteError
from somrs.service_manager.sdk.device import Device, Result, Service, Situation, Task, service
from somrs.service_manager.sdk.orders import ServiceFailed

log = logging.getLogger(__name__)

RECOGNIZE = "RecognizeSituation"
USUAL_ANSWER_TIME = 120.0
"""Seconds that a person usually takes to answer a question."""
STEP = "do_"
"""The prefix of the methods with which a person does steps; the name of the service type follows."""


async def _able(person: Person, task: Task) -> None:
    """Terms are those that the map states now."""
    await person.refresh_offers()
    await check_available(person, task)


def _price(person: Person, task: Task) -> float | str:
    return person.offers.price_of(task.order.method.removeprefix(STEP) if task.order.method.startswith(STEP) else RECOGNIZE)


def _duration(person: Person, task: Task) -> float:
    stated = person.offers.step(task.order.method.removeprefix(STEP)).duration
    return stated if stated is not None else person.offers.step_time


def _answer_duration(person: Person, task: Task) -> float:
    stated = person.offers.step(RECOGNIZE).duration
    return stated if stated is not None else USUAL_ANSWER_TIME


class Person(Device):
    """A person who answers questions, and does the steps that the attribute `Offers` of the person's object names.

    A person does one step after another, and answers questions meanwhile.
    """

    type = "Person"
    glance: float = 0.3
    """Seconds between two checks for an answer."""
    review: float = 2.0
    """Seconds between two checks of what the map says that the person offers."""
    heartbeat = 5.0

    def __init__(self, name: str, simulator: str | None = None) -> None:
        super().__init__(name, simulator)
        self.offers = PersonOffers()
        self._types: tuple[str, ...] = ()
        self._reviewing: asyncio.Task[None] | None = None
        self._ending = ExitStack()
        """What is to be done with what was opened."""

    async def open(self) -> None:
        self._questions = Questions(self.data)
        self._ending.callback(self._questions.close)
        self.assignments = Assignments(self.data)
        self._ending.callback(self.assignments.close)
        self.assignments.code_of(self.name)
        for end_all in (self._questions.end_all, self.assignments.end_all):
            end_all(self.name, f"the program of {self.name} was restarted")
            self._ending.callback(end_all, self.name, f"the program of {self.name} ended")
        await self.refresh_offers()
        self._reviewing = asyncio.create_task(self._review_offers())

    async def refresh_offers(self) -> None:
        """Read what the map says that the person offers, and offer the service types of which it says so now."""
        offers = read_offers(await self.map.object(self.name))
        if offers == self.offers:
            return
        self.offers = offers
        for problem in offers.problems:
            log.warning("%s: %s", self.name, problem)
        types, self._types = self._types, tuple(step.service_type for step in offers.steps if step.service_type != RECOGNIZE)
        if types != self._types:
            self.services_changed()

    async def _review_offers(self) -> None:
        while True:
            await asyncio.sleep(self.review)
            try:
                await self.refresh_offers()
            except RemoteError as error:
                log.info("%s: the map could not be read: %s", self.name, error)

    def services(self) -> Mapping[str, Service]:
        return {**super().services(), **{STEP + service_type: _step(service_type) for service_type in self._types}}

    def find_service(self, method: str) -> Service | None:
        """A person keeps a contract for a service type that the map no longer names."""
        known = super().find_service(method)
        return _step(method.removeprefix(STEP)) if known is None and method.startswith(STEP) else known

    async def close(self) -> None:
        if self._reviewing is not None:
            self._reviewing.cancel()
        self._ending.close()

    @service(RECOGNIZE, price=_price, duration=_answer_duration, able=_able, occupies=False)
    async def recognize(self, task: Task) -> Situation:
        object = str(task.inputs["Object"])
        number = self._questions.ask(self.name, object, await _question(task, object), self.offers.answer_time)
        reason = "the answer is no longer needed"
        try:
            await task.progress(0.0, note=f"question {number} to {self.name}: where is {object}?")
            async with asyncio.timeout(self.offers.answer_time):
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
            reason = f"there was no answer within {self.offers.answer_time:g} s"
            raise ServiceFailed(f"{self.name} was asked where {object} is: {reason}") from None
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
        result = await do_work(person, task, await describe_work(person, task, service_type, task.effect))
        situation = await put_in_place(person.name, person.simulator, task.map, task.effect, parse(str(result.situation)))
        return structs.replace(result, situation=situation)

    async def undo(person: Person, task: Task, situation: Formula) -> Situation:
        work = await describe_work(person, task, service_type, situation)
        await do_work(person, task, structs.replace(work, undoes=True))
        return await put_in_place(person.name, person.simulator, task.map, situation, situation)

    async def stop(person: Person, task: Task) -> Situation:
        return await stop_work(person, task)

    step = Service(do, service_type, _price, _duration, _able)
    step.compensation(undo)
    step.stopping(stop)
    step.name = STEP + service_type
    return step


async def _question(task: Task, object: str) -> str:
    """The text of the question, with the facts on the map about the object's position."""
    known_facts = [
        f"{object} {relation} {row['It']}" for relation in ("isOn", "isHeldBy") for row in await task.map.query(f"{object} {relation} ?It")
    ]
    return f"Where is {object}, and how is it?" + (
        f" The map says {' and '.join(known_facts)}, which may be outdated." if known_facts else ""
    )
