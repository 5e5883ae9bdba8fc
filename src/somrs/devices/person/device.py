"""A person as a device: its service asks where an object is, and waits for an answer in Entish.

The person lists open questions with `somrs questions`, and answers with `somrs answer`. An answer must state facts in terms of the
ontology and the map. Other answers are rejected with a caret under the error, and the question stays open.
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
"""The price of an observation. It is high, so that robots and cameras are preferred."""


async def _price(device: Person, task: Task) -> float | str:
    rows = await task.map.query(f"{device.name}.Price = ?Price")
    return rows[0]["Price"] if rows else DEFAULT_PRICE


class Person(Device):
    """A person who answers questions at a screen."""

    type = "Person"
    capacity = 5
    """The number of questions that may be open at the same time."""
    patience: float = 300.0
    """Seconds for which a question stays open."""
    glance: float = 0.3
    """Seconds between two checks for an answer."""

    async def open(self) -> None:
        self._questions = Questions(self.data)
        self._questions.end_all(self.name, f"the program of {self.name} was restarted")

    async def close(self) -> None:
        self._questions.end_all(self.name, f"the program of {self.name} ended")
        self._questions.close()

    @service("RecognizeSituation", price=_price, duration="2 min")
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
        """An observation leaves nothing to undo."""
        return f"{self.name}.Working = TRUE"


async def _question(task: Task, object: str) -> str:
    """The text of the question, with the facts on the map about the object's position."""
    known_facts = [
        f"{object} {relation} {row['It']}" for relation in ("isOn", "isHeldBy") for row in await task.map.query(f"{object} {relation} ?It")
    ]
    return f"Where is {object}, and how is it?" + (
        f" The map says {' and '.join(known_facts)}, which may be outdated." if known_facts else ""
    )


async def _check_answer(task: Task, object: str, answer: str) -> str:
    """Check an answer, and return it as a situation. Raises FormulaError, or the Repository's RemoteError, with the problem."""
    reading = read(answer)
    for part in conjuncts(reading.formula):
        if isinstance(part, Or):
            raise FormulaError(answer, 0, "an answer with OR does not say which part is true", "state facts, joined by AND")
        atom = part.atom if isinstance(part, Not) else part
        assert isinstance(atom, Relation | Comparison), "a conjunct contains no AND"
        for variable in variables(atom).values():
            raise reading.error(atom, variable, f"?{variable.name} is unbound", "write the name of the object")
        if isinstance(atom, Comparison) and (isinstance(part, Not) or atom.operator != "=" or not isinstance(atom.left, Attribute)):
            raise reading.error(atom, None, f"{part} does not state a value", "write Object.Attribute = value")
        if atom == Comparison(Attribute(Name(object), UNKNOWN), "=", Truth(True)):
            raise reading.error(atom, None, f"this says that {object} is unknown", "if you cannot tell, answer with --cannot-tell")
    if not any(object in names(part) for part in conjuncts(reading.formula)):
        raise FormulaError(answer, 0, f"this does not mention {object}", f"state where it is: `{object} isOn` and the name of an object")
    await task.map.query(reading.formula, limit=1)  # the Repository knows all objects, types and units
    known_atom = Comparison(Attribute(Name(object), UNKNOWN), "=", Truth(False))
    return str(reading.formula) if known_atom in conjuncts(reading.formula) else f"{reading.formula} AND {known_atom}"
