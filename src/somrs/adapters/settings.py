"""Reads the settings of an adapter into a struct, and names every mistake in them, with what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, TypeVar

import msgspec
from msgspec import Struct, inspect

from somrs.entish.parse import nearest
from somrs.errors import SettingsError
from somrs.ontology.map import Map

S = TypeVar("S", bound=Struct)

Path = tuple[str, ...]
Mistake = tuple[Path, str]
"""Where it is below the name of the adapter, and what to do about it."""

_WRONG = object()


def read_struct(
    adapter: str,
    settings: Mapping[str, Any],
    kind: type[S],
    examples: Mapping[str, str],
    check: Callable[[S], Iterator[Mistake]],
) -> S:
    """The settings of an adapter. Raises SettingsError with all mistakes.

    `examples`: how settings that are required are written, by their names. `check`: what else is wrong with settings that fit the
    struct. It gets what fits of those that do not.
    """
    reader = _Reader(examples)
    info = inspect.type_info(kind)
    assert isinstance(info, inspect.StructType)
    fitting = reader.struct(settings, info, ())
    assert isinstance(fitting, dict), "settings are a mapping"
    for field in info.fields:
        if field.required and field.encode_name not in fitting:
            fitting[field.encode_name] = _PLACEHOLDERS[type(field.type)]
    read = msgspec.convert(fitting, kind)
    further = [mistake for mistake in check(read) if not any(path[: len(mistake[0])] == mistake[0] for path, _ in reader.mistakes)]
    if reader.mistakes or further:
        raise SettingsError(adapter, [*reader.mistakes, *further])
    return read


_PLACEHOLDERS: Mapping[type[inspect.Type], Any] = {inspect.StrType: "", inspect.DictType: {}}
_WORDS: Mapping[type[inspect.Type], str] = {
    inspect.StrType: "a text",
    inspect.FloatType: "a number",
    inspect.IntType: "a whole number",
    inspect.BoolType: "true or false",
}


def absent(section: str, names: Iterable[str], map: Map) -> Iterator[Mistake]:
    """The names in a section that are not those of objects on the map."""
    for name in names:
        if name not in map.objects:
            hint = nearest(name, map.objects) or "put it there, under `objects`, with its type and where it stands"
            yield (section, name), f"there is no {name} on the map; {hint}"


class _Reader:
    """Keeps of a value what fits a type."""

    def __init__(self, examples: Mapping[str, str]) -> None:
        self._examples = examples
        self.mistakes: list[Mistake] = []

    def struct(self, value: Any, info: inspect.StructType, path: Path) -> Any:
        if not isinstance(value, Mapping):
            return self._wrong(path, f"is {_shown(value)}: write keys and values, {{key: value}}")
        fields = {field.encode_name: field for field in info.fields}
        fitting = {}
        meant: set[str] = set()
        for key, item in value.items():
            if key not in fields:
                hint = nearest(str(key), fields)
                meant |= {name for name in fields if name in hint.replace("?", "").split()}
                self._wrong((*path, str(key)), f"there is no such setting; {hint or 'there are ' + ', '.join(fields)}")
            elif (read := self._value(item, fields[key].type, (*path, key))) is not _WRONG:
                fitting[key] = read
        for name, field in fields.items():
            if field.required and name not in value and name not in meant:
                self._wrong(path, f"{name} is missing: write {self._examples.get(name, f'{name}: and its value')}")
        if path and any(field.required and name not in fitting for name, field in fields.items()):
            return _WRONG
        return fitting

    def _value(self, value: Any, expected: inspect.Type, path: Path) -> Any:
        match expected:
            case inspect.StructType():
                return self.struct(value, expected, path)
            case inspect.DictType(value_type=value_type):
                if not isinstance(value, Mapping):
                    return self._wrong(path, f"is {_shown(value)}: write names, each with its settings, {{NAME: ...}}")
                items = {str(key): self._value(item, value_type, (*path, str(key))) for key, item in value.items()}
                return {key: item for key, item in items.items() if item is not _WRONG}
            case inspect.UnionType(types=types):
                return self._value(value, next((kind for kind in types if _is_alike(value, kind)), types[0]), path)
            case inspect.NoneType() if value is None:
                return None
            case inspect.VarTupleType(item_type=item_type) if isinstance(value, list):
                return self._items(value, [item_type] * len(value), path)
            case inspect.TupleType(item_types=item_types) if isinstance(value, list) and len(value) == len(item_types):
                return self._items(value, [*item_types], path)
            case inspect.IntType() if isinstance(value, float) and value.is_integer():
                return int(value)  # YAML files of sites have no other numbers
            case _:
                return value if _fits(value, expected) else self._wrong(path, f"is {_shown(value)}: write {_wanted(value, expected)}")

    def _items(self, values: list[Any], types: list[inspect.Type], path: Path) -> Any:
        pairs = enumerate(zip(values, types, strict=True), 1)
        items = [self._value(value, item_type, (*path, str(number))) for number, (value, item_type) in pairs]
        return items if _WRONG not in items else _WRONG

    def _wrong(self, path: Path, message: str) -> Any:
        self.mistakes.append((path, message))
        return _WRONG


def _is_alike(value: Any, expected: inspect.Type) -> bool:
    """Whether somebody who wrote the value may have meant this type of several."""
    match expected:
        case inspect.NoneType():
            return value is None
        case inspect.VarTupleType() | inspect.TupleType():
            return isinstance(value, list)
        case inspect.StructType() | inspect.DictType():
            return isinstance(value, Mapping)
    return value is not None and not isinstance(value, list | Mapping)


def _fits(value: Any, expected: inspect.Type) -> bool:
    match expected:
        case inspect.LiteralType(values=values):
            return value in values
        case inspect.StrType():
            return isinstance(value, str)
        case inspect.BoolType():
            return isinstance(value, bool)
        case inspect.FloatType():
            return isinstance(value, int | float) and not isinstance(value, bool)
        case inspect.IntType():
            return isinstance(value, int) and not isinstance(value, bool)
    return False


def _shown(value: Any) -> str:
    match value:
        case None:
            return "empty"
        case bool():
            return str(value).lower()
        case float():
            return f"the number {value:g}"
    text = repr(value)
    return text if len(text) < 60 else text[:57] + "..."


def _wanted(value: Any, expected: inspect.Type) -> str:
    match expected:
        case inspect.LiteralType(values=values):
            return " or ".join(f'"{word}"' for word in values)
        case inspect.StrType() if isinstance(value, int | float):
            return 'it in quotes, such as "0001"'
        case inspect.VarTupleType():
            return "a list, [...]"
        case inspect.TupleType(item_types=item_types):
            return f"a list of {len(item_types)} numbers"
    return _WORDS.get(type(expected), "another value")
