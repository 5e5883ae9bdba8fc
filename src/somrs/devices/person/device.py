"""A person who can be asked where a thing is: a device whose service puts a question and waits for the answer, in Entish.

The person lists open questions with `somrs questions`, and answers with `somrs answer`. An answer that does not say what is so,
in words of the ontology and of the map, goes back with a caret under the mistake, and the question stays open.
"""

from __future__ import annotations

import asyncio

from somrs.devices.person.questions import Questions
from somrs.entish.formula import Attribute, Comparison, Formula, Name, Not, Or, Relation, Truth, conjuncts, names, variables
from somrs.entish.parse import read
from somrs.errors import FormulaError, RemoteError
from somrs.ontology.types import UNKNOWN
from somrs.service_manager.sdk.device import Device, Situation, Task, service
from somrs.service_manager.sdk.orders import ServiceFailed

DEFAULT_PRICE = "20 EUR"
"""People are dear: robots and cameras that can look go first."""


async def _price(device: Person, task: Task) -> float | str:
    rows = await task.map.query(f"{device.name}.Price = ?Price")
    return rows[0]["Price"] if rows else DEFAULT_PRICE


class Person(Device):
    """Somebody at a screen."""

    type = "Person"
    capacity = 5
    """Questions that are put at the same time."""
    patience: float = 300.0
    """Seconds that a question stays open."""
    glance: float = 0.3
    """Seconds between two looks whether there is an answer."""

    async def open(self) -> None:
        self._questions = Questions(self.data)
        self._questions.end_all(self.name, f"the program of {self.name} was started anew")

    async def close(self) -> None:
        self._questions.end_all(self.name, f"the program of {self.name} ended")
        self._questions.close()

    @service("RecognizeSituation", price=_price, duration="2 min")
    async def recognize(self, task: Task) -> Situation:
        object = str(task.inputs["Object"])
        number = self._questions.ask(self.name, object, await _question(task, object), self.patience)
        reason = "nobody needs the answer any more"
        try:
            await task.progress(0.0, note=f"question {number} to {self.name}: where is {object}?")
            async with asyncio.timeout(self.patience):
                while True:
                    question = self._questions.read(number)
                    assert question is not None, "questions are kept"
                    if question.answer is not None:
                        try:
                            situation = await _check_answer(task, object, question.answer) if question.answer else ""
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
        """Whoever only looked has nothing to undo."""
        return f"{self.name}.Working = TRUE"


async def _question(task: Task, object: str) -> str:
    """The question, with what the map says."""
    known_facts = [
        f"{object} {relation} {row['It']}" for relation in ("isOn", "isHeldBy") for row in await task.map.query(f"{object} {relation} ?It")
    ]
    return f"Where is {object}, and how is it?" + (
        f" The map says {' and '.join(known_facts)}, which may not be so any more." if known_facts else ""
    )


async def _check_answer(task: Task, object: str, answer: str) -> str:
    """The answer as a situation. Raises FormulaError, or the Repository's RemoteError, with what is wrong with it."""
    reading = read(answer)
    for part in conjuncts(reading.formula):
        if isinstance(part, Or):
            raise FormulaError(answer, 0, "an answer with OR does not say how it is", "say what is so, joined by AND")
        atom = part.atom if isinstance(part, Not) else part
        assert isinstance(atom, Relation | Comparison), "a conjunct has no AND in it"
        for variable in variables(atom).values():
            raise reading.error(atom, variable, f"?{variable.name} is open", "name the object that is meant")
        if isinstance(atom, Comparison) and (isinstance(part, Not) or atom.operator != "=" or not isinstance(atom.left, Attribute)):
            raise reading.error(atom, None, f"{part} does not say how it is", "write Object.Attribute = value")
        if atom == Comparison(Attribute(Name(object), UNKNOWN), "=", Truth(True)):
            raise reading.error(atom, None, f"this says that {object} is unknown", "if you cannot tell, answer with --cannot-tell")
    if not any(object in names(part) for part in conjuncts(reading.formula)):
        raise FormulaError(answer, 0, f"this says nothing of {object}", f"say where it is, such as `{object} isOn Table001`")
    await task.map.query(reading.formula, limit=1)  # the Repository knows all objects, types and units
    known_atom = Comparison(Attribute(Name(object), UNKNOWN), "=", Truth(False))
    return str(reading.formula) if known_atom in conjuncts(reading.formula) else f"{reading.formula} AND {known_atom}"
