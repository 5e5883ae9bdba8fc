"""Operations: methods that are the public API, each at an HTTP method and a path. REST, the OpenAPI document and the clients of both
(`api_client.py`) are all made of them, so that nothing can be done by clicking only.

An operation is a coroutine method with typed parameters. Those that the path names come from the path, one called `body` from the
request's JSON, all others from the query string. What it returns is a msgspec value, sent as JSON, or a `Document`.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar, get_type_hints

import msgspec

MARK = "__operation__"
BODY = "body"

F = TypeVar("F", bound=Callable[..., Awaitable[Any]])


class Document(msgspec.Struct, frozen=True, kw_only=True):
    """A file to keep: what is in it, what it is, and what it may be called."""

    content: bytes
    media_type: str
    name: str


@dataclass(frozen=True, slots=True)
class Parameter:
    """One value that an operation takes. `place`: `path`, `query` or `body`."""

    name: str
    place: str
    type: Any
    default: Any = inspect.Parameter.empty

    @property
    def required(self) -> bool:
        return self.default is inspect.Parameter.empty


@dataclass(frozen=True, slots=True)
class Operation:
    """Something that can be done: `function` does it. `name` is unique, such as `map.change`; the part before the point groups them."""

    name: str
    method: str
    path: str
    function: Callable[..., Awaitable[Any]]
    parameters: tuple[Parameter, ...]
    returns: Any
    doc: str

    @property
    def group(self) -> str:
        return self.name.partition(".")[0]


def operation(method: str, path: str) -> Callable[[F], F]:
    """Make a coroutine method an operation: `@operation("GET", "/map/objects/{name}")`. Its docstring is what people read of it."""

    def mark(function: F) -> F:
        setattr(function, MARK, (method, path))
        return function

    return mark


def operations(group: str, part: object) -> Iterator[Operation]:
    """The operations among the methods of a part of the API: of an object, which does them, or of a class, which says what they are."""
    for name, function in inspect.getmembers(part, inspect.iscoroutinefunction):
        if (marked := getattr(function, MARK, None)) is not None:
            method, path = marked
            declared = _declared(getattr(function, "__func__", function), path)
            yield Operation(f"{group}.{name}", method, path, function, *declared)


@cache
def _declared(function: Callable[..., Awaitable[Any]], path: str) -> tuple[tuple[Parameter, ...], Any, str]:
    """What a method takes and returns, and its docstring: read once, however many objects have it."""
    hints = get_type_hints(function)
    in_path = set(re.findall(r"{(\w+)}", path))
    parameters = tuple(
        Parameter(
            parameter.name,
            "path" if parameter.name in in_path else "body" if parameter.name == BODY else "query",
            hints[parameter.name],
            parameter.default,
        )
        for parameter in inspect.signature(function).parameters.values()
        if parameter.name != "self"
    )
    assert in_path <= {parameter.name for parameter in parameters}, (
        f"{function.__qualname__}: {path} names what the operation does not take"
    )
    return parameters, hints.get("return"), inspect.getdoc(function) or ""
