"""What can be left of a person's work: the situations from which the person chooses, so that nobody has to write a formula on a phone."""

from __future__ import annotations

from somrs.devices.person.assignments import Outcome
from somrs.devices.person.wording import in_words
from somrs.entish.formula import (
    Attribute,
    Comparison,
    Formula,
    Name,
    Not,
    Number,
    Relation,
    Term,
    Variable,
    conjunction,
    conjuncts,
    variables,
)
from somrs.ontology.types import Value
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.values import as_term, term

PLACING = ("isOn", "isIn", "isHeldBy")
"""The relations that say where a thing is; at most one of them holds at a time."""
UNCHANGED, DONE, HELD = "Nothing has changed", "It is done", "I have it with me"


async def present_situation(map: MapReader, effect: Formula) -> Formula | None:
    """What the map says now about everything that the effect would change; None if it says nothing."""
    facts: list[Formula] = []
    for part in conjuncts(effect):
        atom = part.atom if isinstance(part, Not) else part
        match atom:
            case Relation(relation, (Name() as subject, _)):
                group = PLACING if relation in PLACING else (relation,)
                facts += [fact for name in group for fact in await _facts(map, Relation(name, (subject, Variable("What"))))]
            case Comparison(Attribute(Name()) as attribute, "=", _):
                facts += await _facts(map, Comparison(attribute, "=", Variable("What")))
    return conjunction(*dict.fromkeys(facts)) if facts else None


async def _facts(map: MapReader, pattern: Relation | Comparison) -> list[Formula]:
    rows = await map.query(pattern)
    if isinstance(pattern, Relation):
        return [Relation(pattern.relation, (pattern.arguments[0], Name(str(row["What"])))) for row in rows]
    return [Comparison(pattern.left, "=", _value(row["What"])) for row in rows]


def _value(value: Value) -> Term:
    """The term for a value of the map; a number has its unit."""
    quantity = term(value) if isinstance(value, str) and value[:1] in "-0123456789" else None
    return quantity if isinstance(quantity, Number) else as_term(value)


async def possible_outcomes(map: MapReader, person: str, effect: Formula) -> tuple[Outcome, ...]:
    """What can be so when work for this effect has ended early: nothing has changed, it is done, or the person holds the thing."""
    outcomes: list[Outcome] = []
    before = await present_situation(map, effect)
    if before is not None and before != effect:
        outcomes.append(await _outcome(map, UNCHANGED, before))
    if not variables(effect):
        outcomes.append(await _outcome(map, DONE, effect))
    things = [part.arguments[0] for part in conjuncts(effect) if isinstance(part, Relation) and part.relation in PLACING]
    if len(things) == 1 and isinstance(things[0], Name):
        held = Relation("isHeldBy", (things[0], Name(person)))
        if held not in (before, effect):
            outcomes.append(await _outcome(map, HELD, held))
    return tuple(outcomes)


async def _outcome(map: MapReader, text: str, situation: Formula) -> Outcome:
    return Outcome(text=f"{text}: {await in_words(map, situation)}", situation=str(situation))
