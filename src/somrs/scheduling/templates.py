"""Templates: named tasks with blanks that are filled in when the template is used."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping

from somrs.entish.parse import nearest
from somrs.errors import FormulaError, UsageError
from somrs.kernel.replica import Replica
from somrs.ontology.check import check as check_formula
from somrs.protocol.messages.orders import BLANK, Blank, Template, fill_blanks, fill_formula
from somrs.protocol.messages.submission import Submit
from somrs.task_manager.context import find_task_error

VALUES = ("number", "text", "truth")
"""The types of blanks for values; the type of any other blank is an object type."""

MOST_NAME = 80

_WORD = re.compile(r"[A-Za-z_]\w*")
_NUMBER = re.compile(r"-?\d+(\.\d+)?([eE][-+]?\d+)?( *[A-Za-z%°/]+)?")


def name_of(text: str) -> str:
    """A name for a template or an order, with whitespace normalized. Raises UsageError if the text cannot be one."""
    name = " ".join(text.split())
    if not name or len(name) > MOST_NAME or "/" in name or not name.isprintable():
        raise UsageError(f"a name has 1 to {MOST_NAME} characters on one line, and no slash; {text!r} is not a name")
    return name


def check(task: Submit, blanks: tuple[Blank, ...], replica: Replica) -> None:
    """Check a task with blanks. Raises UsageError or FormulaError if it is invalid for all values of the blanks."""
    named = {blank.name: blank for blank in blanks}
    for blank in blanks:
        _check_blank(blank, replica)
    if len(named) < len(blanks):
        raise UsageError("two blanks have the same name; rename one of them")
    used_names = dict.fromkeys(_used_names(task))
    for name in used_names:
        if name not in named:
            raise UsageError(f"{{{name}}} is in a formula, but there is no blank with this name; add the blank with its type")
    for name in named:
        if name not in used_names:
            raise UsageError(f"the blank {name} is in no formula; write {{{name}}} where its value belongs, or remove the blank")
    examples = {name: _example(blank, replica) for name, blank in named.items()}
    for formula in (task.effect, task.precondition):
        if formula is not None:
            _check_formula(formula, examples, replica)
    if (wrong := find_task_error(fill_blanks(task, examples), replica)) is not None:
        raise UsageError(str(wrong))


def _check_formula(formula: str, examples: Mapping[str, str], replica: Replica) -> None:
    """Check a formula with blanks. Raises FormulaError, with the position in the formula as written, including its blanks."""
    written = fill_formula(formula, examples)
    try:
        check_formula(written, replica.ontology, replica.map)
    except FormulaError as error:
        position = error.position
        for match in BLANK.finditer(formula):
            if match.start() >= position:
                break
            example = examples[match[1].strip()]
            # Positions after a blank are shifted by the example; a mistake within the example is a mistake of the blank.
            position = max(match.start(), position - len(example) + len(match[0]))
        raise FormulaError(formula, min(position, len(formula)), error.problem, error.hint) from None


def fill_template(template: Template, values: Mapping[str, str], replica: Replica) -> Submit:
    """The task of a template, with the blanks filled in. Raises UsageError for a value that is missing or unsuitable."""
    named = {blank.name: blank for blank in template.blanks}
    for name in values:
        if name not in named:
            hint = nearest(name, named) or (f"it has {', '.join(named)}" if named else "it has no blanks")
            raise UsageError(f"{template.name} has no blank {name}; {hint}")
    return fill_blanks(template.task, {name: _value(blank, values.get(name, ""), replica) for name, blank in named.items()})


def _value(blank: Blank, text: str, replica: Replica) -> str:
    """The value of a blank as Entish text. Raises UsageError for an unsuitable one."""
    value = text.strip() or blank.default.strip()
    blank_text = f"{blank.label or blank.name} ({blank.type})"
    if not value and blank.type != "text":
        raise UsageError(f"fill in {blank_text}")
    match blank.type:
        case "number":
            if _NUMBER.fullmatch(value) is None:
                raise UsageError(f"{blank_text}: {value!r} is not a number; write it as 12.5, or with a unit, as 500 g")
            return value
        case "truth":
            if value.upper() not in ("TRUE", "FALSE"):
                raise UsageError(f"{blank_text}: {value!r} is neither TRUE nor FALSE")
            return value.upper()
        case "text":
            return json.dumps(value, ensure_ascii=False)
    map_object = replica.map.objects.get(value)
    if map_object is None:
        of_type = _objects(blank.type, replica)
        raise UsageError(f"{blank_text}: there is no {value} on the map; {nearest(value, of_type) or 'choose an object of the map'}")
    if not replica.ontology.is_subtype(map_object.type, blank.type):
        raise UsageError(f"{blank_text}: {value} is a {map_object.type}, not a {blank.type}")
    return value


def _check_blank(blank: Blank, replica: Replica) -> None:
    if _WORD.fullmatch(blank.name) is None:
        raise UsageError(f"{blank.name!r} is not a name for a blank; use letters, digits and _, such as Thing")
    if blank.type not in VALUES and blank.type not in replica.ontology.types:
        hint = nearest(blank.type, (*VALUES, *replica.ontology.types)) or "use a type of the ontology, or number, text or truth"
        raise UsageError(f"the blank {blank.name}: there is no type {blank.type}; {hint}")
    if blank.default:
        _value(blank, blank.default, replica)


def _example(blank: Blank, replica: Replica) -> str:
    """An example value for the blank, with which the formulas can be checked."""
    match blank.type:
        case "number":
            return blank.default or "0"
        case "truth":
            return blank.default.upper() or "TRUE"
        case "text":
            return json.dumps(blank.default, ensure_ascii=False)
    return blank.default or next(iter(_objects(blank.type, replica)), f"?{blank.name}")


def _objects(type: str, replica: Replica) -> list[str]:
    return [name for name, object in replica.map.objects.items() if replica.ontology.is_subtype(object.type, type)]


def _formulas(task: Submit) -> Iterator[str]:
    yield from (task.effect, task.precondition or "")
    for handler in task.handlers:
        yield from (handler.effect, handler.when or "")


def _used_names(task: Submit) -> Iterator[str]:
    for formula in _formulas(task):
        for match in BLANK.finditer(formula):
            name = match[1].strip()
            if _WORD.fullmatch(name) is None:
                raise FormulaError(formula, match.start(), "a blank is a name in braces", "such as {Thing}")
            yield name
