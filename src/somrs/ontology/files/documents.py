"""Reads documents into pydantic models. Of what does not fit, it says where it is and what to do, in plain words.

The same words are used for site files, mapping files, bindings, and the settings of adapters.
"""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterator, Mapping
from types import NoneType, UnionType
from typing import Annotated, Any, Generic, TypeVar, Union, get_args, get_origin

from msgspec import Struct
from pydantic import BaseModel, BeforeValidator, ConfigDict, Strict, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from somrs.entish.parse import nearest
from somrs.ontology.files.nodes import Path

M = TypeVar("M", bound=BaseModel)
T = TypeVar("T")

Misfit = tuple[Path, str, str]
"""Where something does not fit, pydantic's kind of the error, and what to do."""

LONGEST = 60
"""Characters of a value that are shown."""


def _whole(value: object) -> object:
    return int(value) if isinstance(value, float) and value.is_integer() else value


Listed = Annotated[tuple[T, ...], Strict(False)]
"""A list in a document."""
WholeNumber = Annotated[int, BeforeValidator(_whole)]
"""YAML documents have no other numbers than floats."""


class Entry(BaseModel):
    """A part of a document: a key that it does not have is a mistake. `examples` of a field are shown where it is wrong or missing."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Document(Struct, Generic[M], frozen=True):
    """A document. `content`: what of it fits the model; None: nothing, because something required at the top does not. `misfits`: what
    does not fit; `incomplete`: what lacks something therefore."""

    content: M | None
    misfits: list[Misfit]
    incomplete: set[Path]


def read_document(data: Mapping[str, Any], model: type[M]) -> Document[M]:
    """Read what of a document fits the model."""
    remains: Any = copy.deepcopy(dict(data))
    misfits = [*model_misfits(remains, model)]
    incomplete: set[Path] = set()
    current = misfits
    while current:
        left_out = {path for place, _, _ in current if (path := _leave_out(remains, place)) is not None}
        if not left_out:
            return Document(None, misfits, incomplete)
        incomplete |= left_out
        current = [*model_misfits(remains, model)]
    return Document(model.model_validate(remains), misfits, incomplete)


def follows(path: Path, document: Document[Any]) -> bool:
    """Whether a mistake there may only follow from what is not complete."""
    return any(path[: len(there)] == there or there[: len(path)] == path for there in document.incomplete)


def _leave_out(data: dict[str, Any], path: Path) -> Path | None:
    """Take out what is at the path, or the innermost entry around it that is there; a list as a whole, so that its items keep their
    places. Returns the path of what was taken out; None: there is nothing."""
    for length in range(len(path), 0, -1):
        container: Any = data
        for step in path[: length - 1]:
            container = container[step] if isinstance(container, dict) and step in container else None
        if isinstance(container, dict) and path[length - 1] in container:
            del container[path[length - 1]]
            return path[:length]
    return None


def model_misfits(data: Any, model: type[BaseModel], further_keys: Collection[str] = ()) -> Iterator[Misfit]:
    """What does not fit the model. `further_keys`: that there are besides those of the model."""
    try:
        model.model_validate(data)
    except ValidationError as error:
        details = error.errors(include_url=False)
    else:
        return
    by_place: dict[Path, list[ErrorDetails]] = {}
    for detail in details:
        by_place.setdefault(_place(data, detail), []).append(detail)  # pydantic tries all alternatives
    meant = {
        (*path[:-1], key)
        for path, alternatives in by_place.items()
        if alternatives[0]["type"] == "extra_forbidden"
        for key in _suggested(str(path[-1]), _keys(model, path[:-1]))
    }
    for path, alternatives in by_place.items():
        follows_from_items = alternatives[0]["type"] == "too_short" and any(path == place[: len(path)] != place for place in by_place)
        if not follows_from_items and (alternatives[0]["type"] != "missing" or path not in meant):
            yield path, alternatives[0]["type"], _message(model, path, alternatives, further_keys)


def _place(data: Any, detail: ErrorDetails) -> Path:
    """Where a mistake is: without the alternatives that pydantic appends."""
    path: Path = tuple(detail["loc"])
    while path and not _leads(data, path) and (detail["type"] != "missing" or isinstance(path[-1], int)):
        path = path[:-1]
    return path


def _leads(data: Any, path: Path) -> bool:
    for step in path:
        has_step = step in data if isinstance(data, dict) else isinstance(data, list) and isinstance(step, int) and step < len(data)
        if not has_step:
            return False
        data = data[step]
    return True


def _suggested(key: str, keys: Collection[str]) -> set[str]:
    return {name for name in keys if name in nearest(key, keys).replace("?", "").split()}


def _keys(model: type[BaseModel], path: Path) -> list[str]:
    """The keys of the entry at the path."""
    kind, _ = _kind(model, path)
    return [field.alias or name for name, field in kind.model_fields.items()] if _is_model(kind) else []


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _kind(model: Any, path: Path) -> tuple[Any, FieldInfo | None]:
    """The type of what is at the path, and the field in which it is."""
    kind, field = model, None
    for step in path:
        if _is_model(kind):
            fields = {entry.alias or name: entry for name, entry in kind.model_fields.items()}
            field = fields.get(str(step))
            kind = field.annotation if field is not None else None
        else:  # the type of the items of a list or a dictionary
            field, kind = None, next((item for item in reversed(get_args(kind)) if item is not Ellipsis), None)
        while get_origin(kind) in (Annotated, Union, UnionType):
            kind = next((item for item in get_args(kind) if item is not NoneType), None)
    return kind, field


_EXPECTED = {
    "string_type": "a text",
    "bool_type": "true or false",
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "list_type": "a list, [...]",
    "tuple_type": "a list, [...]",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "too_short": "a list with at least {min_length} items",
    "string_too_short": "a text that is not empty",
    "too_long": "a list with at most {max_length} items",
    "literal_error": "{expected}",
    "enum": "{expected}",
}
"""What should be there, by pydantic's kinds of errors."""


def _message(model: type[BaseModel], path: Path, alternatives: list[ErrorDetails], further_keys: Collection[str]) -> str:
    detail = alternatives[0]
    kind, field = _kind(model, path)
    key = str(path[-1]) if path else "the file"
    if isinstance(path[-1] if path else None, int):
        key = f"an item of {next((step for step in reversed(path) if isinstance(step, str)), 'a list')}"
    if detail["type"] == "extra_forbidden":
        keys = [*_keys(model, path[:-1]), *(further_keys if len(path) == 1 else ())]
        return f"unknown key {key}; {nearest(key, keys) or 'there are ' + ', '.join(keys)}"
    if detail["type"] == "missing" and isinstance(detail["loc"][-1], str):
        return f"{key} is missing; write {key}: {_example(field) or 'and its value'}"
    if detail["type"] in ("value_error", "assertion_error"):
        return detail["msg"].partition(", ")[2]
    expected = " or ".join(dict.fromkeys(_expected(key, kind, alternative) for alternative in alternatives))
    value = detail["input"]
    example = f", such as {_example(field)}" if _example(field) else ""
    if value is None:
        return f"{key} is empty; write {expected}{example}"
    return f"{key} should be {expected}{_unit(field, expected)}{example}, not {_shown(value)}{_advice(expected, value)}"


def _expected(key: str, kind: Any, detail: ErrorDetails) -> str:
    if detail["type"] in ("dict_type", "model_type", "mapping_type"):
        return f"keys with values ({key}: {{...}})"
    if detail["type"] == "multiple_of":
        return "a whole number"
    if get_origin(kind) is tuple and Ellipsis not in get_args(kind):
        return f"a list of {len(get_args(kind))} numbers"
    context = detail.get("ctx", {})
    return (
        _EXPECTED.get(detail["type"], detail["msg"].removeprefix("Input should be ").removeprefix("a valid "))
        .format(**context)
        .replace(" 1 items", " 1 item")
    )


def _example(field: FieldInfo | None) -> str:
    return " or ".join(map(str, (field.examples if field is not None else None) or ()))


def _unit(field: FieldInfo | None, expected: str) -> str:
    further = field.json_schema_extra if field is not None else None
    if not isinstance(further, dict) or "unit" not in further:
        return ""
    return f"{' in' if expected.endswith('number') else ''} {further['unit']}"


def _advice(expected: str, value: Any) -> str:
    """How a value is to be written that is almost right."""
    if isinstance(value, int | float) and not isinstance(value, bool) and ("text" in expected or f"'{value:g}'" in expected):
        return "; write it in quotes"
    hint = nearest(value, expected.replace("'", "").replace(",", "").split()) if isinstance(value, str) and "'" in expected else ""
    return f"; {hint}" if hint else ""


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    text = repr(value)
    return text if len(text) < LONGEST else f"{text[: LONGEST - 3]}..."
