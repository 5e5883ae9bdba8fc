"""Whether two components are in the same state, whatever became of their objects' identities: one from before a kill, one from after."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from msgspec import Struct

from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology

Leaf = str | int | float | bool | bytes | None


def difference(one: object, other: object, leave_out: Collection[type] = ()) -> str | None:
    """Where they differ, as a path of attributes; None when they are alike. Objects of `leave_out` are not looked into."""
    pairs: list[tuple[str, object, object]] = [("", one, other)]
    seen: dict[int, tuple[object, object]] = {}
    """The first of each pair is kept with the second, so that no other object gets its identity."""
    while pairs:
        path, a, b = pairs.pop()
        if a is b or isinstance(a, tuple(leave_out)):
            continue
        if isinstance(a, int | float) and a == b:
            continue
        if type(a) is not type(b):
            return f"{path}: {type(a).__name__} {a!r:.200} and {type(b).__name__} {b!r:.200}"
        if isinstance(a, Leaf | type):
            if a != b:
                return f"{path}: {a!r:.200} and {b!r:.200}"
            continue
        if _is_value(a):  # values are shared here and there as it happens; nobody can tell
            if a == b:
                continue
        elif id(a) in seen:
            if seen[id(a)][1] is not b:
                return f"{path}: refers to something else of the same kind"
            continue
        else:
            seen[id(a)] = a, b
        mine, its = [*_inside(a)], [*_inside(b)]
        if [name for name, _ in mine] != [name for name, _ in its]:
            return f"{path}: {[name for name, _ in mine]!r:.300} and {[name for name, _ in its]!r:.300}"
        pairs += [(f"{path}.{name}", a_value, b_value) for (name, a_value), (_, b_value) in zip(mine, its, strict=True)]
    return None


def _is_value(it: object) -> bool:
    parameters = getattr(it, "__dataclass_params__", None)
    return isinstance(it, Struct | tuple | frozenset) or (parameters is not None and parameters.frozen)


def _inside(value: object) -> Iterator[tuple[str, object]]:
    """What an object is made of, by name."""
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
        case Ontology():  # here and below, whatever was looked up in it meanwhile
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
            for one in part:
                yield from one.items() if isinstance(one, dict) else ()
        elif isinstance(part, dict):
            yield from part.items()
        else:
            yield f"part{number}", part if not callable(part) else getattr(part, "__qualname__", "")
