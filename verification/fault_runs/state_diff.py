"""Compares the states of two components by value: one from before a kill, one from after the restart."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from msgspec import Struct

from somrs.ontology.map import Map
from somrs.ontology.types import Ontology

Leaf = str | int | float | bool | bytes | None


def difference(old: object, new: object, ignored_types: Collection[type] = ()) -> str | None:
    """Return the first difference as a path of attributes, or None. Objects of `ignored_types` are skipped."""
    pairs: list[tuple[str, object, object]] = [("", old, new)]
    visited: dict[int, tuple[object, object]] = {}
    """The first object of each pair is kept alive with the second, so that no other object gets its id."""
    while pairs:
        path, old_value, new_value = pairs.pop()
        if old_value is new_value or isinstance(old_value, tuple(ignored_types)):
            continue
        if isinstance(old_value, int | float) and old_value == new_value:
            continue
        if type(old_value) is not type(new_value):
            return f"{path}: {type(old_value).__name__} {old_value!r:.200} and {type(new_value).__name__} {new_value!r:.200}"
        if isinstance(old_value, Leaf | type):
            if old_value != new_value:
                return f"{path}: {old_value!r:.200} and {new_value!r:.200}"
            continue
        if _is_value(old_value):  # identities of values are irrelevant, as values cannot change
            if old_value == new_value:
                continue
        elif id(old_value) in visited:
            if visited[id(old_value)][1] is not new_value:
                return f"{path}: refers to something else of the same kind"
            continue
        else:
            visited[id(old_value)] = old_value, new_value
        old_members, new_members = [*_members(old_value)], [*_members(new_value)]
        if [name for name, _ in old_members] != [name for name, _ in new_members]:
            return f"{path}: {[name for name, _ in old_members]!r:.300} and {[name for name, _ in new_members]!r:.300}"
        pairs += [(f"{path}.{name}", a_value, b_value) for (name, a_value), (_, b_value) in zip(old_members, new_members, strict=True)]
    return None


def _is_value(value: object) -> bool:
    parameters = getattr(value, "__dataclass_params__", None)
    return isinstance(value, Struct | tuple | frozenset) or (parameters is not None and parameters.frozen)


def _members(value: object) -> Iterator[tuple[str, object]]:
    """Yield an object's members by name."""
    match value:
        case dict():
            yield from ((repr(key), item) for key, item in value.items())
            return
        case list():
            yield from ((str(number), item) for number, item in enumerate(value))
            return
        case set() | frozenset():
            yield from ((repr(item), None) for item in sorted(value, key=repr))
            return
        case Ontology():  # for this and the next types, caches of earlier look-ups are skipped
            yield "definitions", [*value]
            return
        case Map():
            yield "objects", value.objects
            yield "facts", {*value.facts()}
            return
        case Struct():
            yield from ((name, getattr(value, name)) for name in value.__struct_fields__)
            return
        case tuple():
            yield from ((str(number), item) for number, item in enumerate(value))
            return
    reduced = value.__reduce_ex__(4)
    if isinstance(reduced, str):
        yield "name", reduced
        return
    for number, part in enumerate(reduced):
        if part is None:
            continue
        if number in (3, 4):  # the items of lists and dicts, as iterators
            yield from ((f"item{count}", item) for count, item in enumerate(part))
        elif number == 1:
            yield from ((f"argument{count}", item) for count, item in enumerate(part))
        elif isinstance(part, tuple) and number == 2:
            for state_part in part:
                yield from state_part.items() if isinstance(state_part, dict) else ()
        elif isinstance(part, dict):
            yield from part.items()
        else:
            yield f"part{number}", part if not callable(part) else getattr(part, "__qualname__", "")
