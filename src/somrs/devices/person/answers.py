"""What people state: the check that an answer says what holds now, in terms of the ontology and the map."""

from __future__ import annotations

from somrs.entish.formula import Attribute, Comparison, Formula, Name, Not, Or, Relation, Truth, conjuncts, names, variables
from somrs.entish.parse import ParsedFormula, read
from somrs.errors import FormulaError
from somrs.ontology.types import UNKNOWN
from somrs.service_manager.sdk.device import Task


async def check_situation(task: Task, text: str) -> Formula:
    """Check that the text states facts, and return them. Raises FormulaError, or the Repository's RemoteError, with the problem."""
    reading = read(text)
    for part in conjuncts(reading.formula):
        _check_fact(reading, part, text)
    await task.map.query(reading.formula, limit=1)  # the Repository knows all objects, types and units
    return reading.formula


def _check_fact(reading: ParsedFormula, part: Formula, text: str) -> None:
    if isinstance(part, Or):
        raise FormulaError(text, 0, "an answer with OR does not say which part is true", "state facts, joined by AND")
    atom = part.atom if isinstance(part, Not) else part
    assert isinstance(atom, Relation | Comparison), "a conjunct contains no AND"
    for variable in variables(atom).values():
        raise reading.error(atom, variable, f"?{variable.name} is unbound", "write the name of the object")
    if isinstance(atom, Comparison) and (isinstance(part, Not) or atom.operator != "=" or not isinstance(atom.left, Attribute)):
        raise reading.error(atom, None, f"{part} does not state a value", "write Object.Attribute = value")


async def check_answer(task: Task, object: str, answer: str) -> str:
    """Check an answer to the question where an object is, and return it as a situation. Raises as `check_situation`."""
    reading = read(answer)
    unknown_atom = Comparison(Attribute(Name(object), UNKNOWN), "=", Truth(True))
    for part in conjuncts(reading.formula):
        _check_fact(reading, part, answer)
        if part == unknown_atom:
            raise reading.error(part, None, f"this says that {object} is unknown", "if you cannot tell, answer with --cannot-tell")
    if not any(object in names(part) for part in conjuncts(reading.formula)):
        raise FormulaError(answer, 0, f"this does not mention {object}", f"state where it is: `{object} isOn` and the name of an object")
    await task.map.query(reading.formula, limit=1)
    known_atom = Comparison(Attribute(Name(object), UNKNOWN), "=", Truth(False))
    return str(reading.formula) if known_atom in conjuncts(reading.formula) else f"{reading.formula} AND {known_atom}"
