"""What people state: the check that an answer says what holds now, in terms of the ontology and the map."""

from __future__ import annotations

from somrs.entish.formula import Attribute, Comparison, Formula, Name, Not, Or, Relation, Truth, Variable, conjuncts, names, variables
from somrs.entish.parse import ParsedFormula, read
from somrs.errors import FormulaError
from somrs.ontology.types import UNKNOWN
from somrs.service_manager.sdk.device import Task


async def check_situation(task: Task, text: str, *, sightings: bool = False) -> Formula:
    """Check that the text states facts, and return them. With `sightings`, typed variables are objects that were seen.

    Raises FormulaError, or the Repository's RemoteError, with the problem.
    """
    reading = read(text)
    for part in conjuncts(reading.formula):
        _check_fact(reading, part, text, sightings=sightings)
    await task.map.query(reading.formula, limit=1)  # the Repository knows all objects, types and units
    return reading.formula


def _check_fact(reading: ParsedFormula, part: Formula, text: str, *, sightings: bool = False) -> None:
    if isinstance(part, Or):
        raise FormulaError(text, 0, "an answer with OR does not say which part is true", "state facts, joined by AND")
    atom = part.atom if isinstance(part, Not) else part
    if not isinstance(atom, Relation | Comparison):
        raise FormulaError(text, 0, f"{atom} does not state a fact", "state facts about single objects, joined by AND")
    for variable in variables(atom).values():
        if not sightings:
            raise reading.error(atom, variable, f"?{variable.name} is unbound", "write the name of the object")
        if variable.type is None and variables(reading.formula)[variable.name].type is None:
            raise reading.error(atom, variable, f"?{variable.name} has no type", f"say what was seen, such as `?{variable.name}: Jar`")
    if isinstance(atom, Comparison) and (isinstance(part, Not) or atom.operator != "=" or not isinstance(atom.left, Attribute)):
        raise reading.error(atom, None, f"{part} does not state a value", "write Object.Attribute = value")


def known(object: Name | Variable) -> Formula:
    """The fact that the place and the state of an object are known."""
    return Comparison(Attribute(object, UNKNOWN), "=", Truth(False))


def unknown_objects(effect: Formula) -> tuple[str, ...]:
    """The objects whose place and state are to be found out for this effect."""
    return tuple(name for part in conjuncts(effect) for name in names(part) if part == known(Name(name)))


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
    fact = known(Name(object))
    return str(reading.formula) if fact in conjuncts(reading.formula) else f"{reading.formula} AND {fact}"
