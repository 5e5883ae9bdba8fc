"""Templates made of tasks: things that are named in a task become blanks, which are filled in each time it is used."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from msgspec import structs

from somrs.entish.formula import names
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.clients import Submit

_LEXEME = re.compile(r'"(?:[^"\\\n]|\\.)*"|#[^\n]*|\?[\w-]+|[^\W\d][\w-]*(?:\.[\w.-]+)?')


def texts(task: Submit) -> Iterator[str]:
    """The formulas of a task."""
    yield task.effect
    yield task.precondition or ""
    for handler in task.handlers:
        yield handler.effect
        yield handler.when or ""


def named(task: Submit, map: Map) -> list[str]:
    """The things on the map that a task names, in the order in which it does."""
    found: dict[str, None] = {}
    for text in texts(task):
        try:
            found.update(dict.fromkeys(name for name in names(parse(text)) if name in map.objects))
        except FormulaError:
            continue  # what is empty, or no formula, names nothing
    return [*found]


def blanked(task: Submit, blanks: Mapping[str, str]) -> Submit:
    """The task with blanks, such as `{Thing}`, instead of names."""

    def written(text: str) -> str:
        return _LEXEME.sub(lambda found: _instead(found[0], blanks), text)

    return structs.replace(
        task,
        effect=written(task.effect),
        precondition=written(task.precondition) if task.precondition else None,
        handlers=tuple(
            structs.replace(one, effect=written(one.effect), when=written(one.when) if one.when else None) for one in task.handlers
        ),
    )


def _instead(word: str, blanks: Mapping[str, str]) -> str:
    name, point, path = word.partition(".")
    return f"{{{blanks[name]}}}{point}{path}" if name in blanks and not word.startswith(("?", '"', "#")) else word


def proposed(types: Mapping[str, str]) -> dict[str, str]:
    """A name for the blank of each thing: of the type that may stand there, numbered where that would not tell them apart."""
    found: dict[str, str] = {}
    for thing, type_name in types.items():
        count = sum(1 for other in found if types[other] == type_name)
        found[thing] = f"{type_name}{count + 1}" if count else type_name
    return found


def types_of(thing: str, map: Map, ontology: Ontology) -> list[str]:
    """The types that may stand in the blank of a thing: its own, and those above it."""
    return [*ontology.ancestors(map.objects[thing].type)]
