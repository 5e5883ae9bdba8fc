"""Templates made from tasks: names of things become blanks, which are filled in at each use."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from msgspec import structs

from somrs.entish.formula import names
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.submission import Submit

_LEXEME = re.compile(r'"(?:[^"\\\n]|\\.)*"|#[^\n]*|\?[\w-]+|[^\W\d][\w-]*(?:\.[\w.-]+)?')


def _formula_texts(task: Submit) -> Iterator[str]:
    """Yield the formulas of a task."""
    yield task.effect
    yield task.precondition or ""
    for handler in task.handlers:
        yield handler.effect
        yield handler.when or ""


def mentioned_things(task: Submit, map: Map) -> list[str]:
    """The things on the map that a task names, in order of occurrence."""
    thing_names: dict[str, None] = {}
    for text in _formula_texts(task):
        try:
            thing_names.update(dict.fromkeys(name for name in names(parse(text)) if name in map.objects))
        except FormulaError:
            continue  # not a formula: it names nothing
    return [*thing_names]


def replace_with_blanks(task: Submit, blanks: Mapping[str, str]) -> Submit:
    """The task with blanks, such as `{Thing}`, in place of names."""

    def with_blanks(text: str) -> str:
        return _LEXEME.sub(lambda match: _replace_name(match[0], blanks), text)

    return structs.replace(
        task,
        effect=with_blanks(task.effect),
        precondition=with_blanks(task.precondition) if task.precondition else None,
        handlers=tuple(
            structs.replace(handler, effect=with_blanks(handler.effect), when=with_blanks(handler.when) if handler.when else None)
            for handler in task.handlers
        ),
    )


def _replace_name(word: str, blanks: Mapping[str, str]) -> str:
    name, point, path = word.partition(".")
    return f"{{{blanks[name]}}}{point}{path}" if name in blanks and not word.startswith(("?", '"', "#")) else word


def propose_blank_names(types: Mapping[str, str]) -> dict[str, str]:
    """A name for each thing's blank: its allowed type, numbered where several blanks would have the same name."""
    blank_names: dict[str, str] = {}
    for thing, type_name in types.items():
        count = sum(1 for earlier_thing in blank_names if types[earlier_thing] == type_name)
        blank_names[thing] = f"{type_name}{count + 1}" if count else type_name
    return blank_names


def types_of(thing: str, map: Map, ontology: Ontology) -> list[str]:
    """The types that a thing's blank may allow: the thing's own type and its ancestors."""
    return [*ontology.ancestors(map.objects[thing].type)]
