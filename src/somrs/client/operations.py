"""Operations: the methods of the public API, each with an HTTP method and a path.

REST, the OpenAPI document and the client (`api_client.py`) are generated from them; the windows use the same operations.

An operation is a coroutine method with typed parameters. Parameters named in the path come from the path, a parameter `body` comes from
the request's JSON, and all others come from the query string. The result is a msgspec value, sent as JSON, or a `Document`.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar, get_type_hints

import msgspec

from somrs.access.rights import Right

_MARK = "__operation__"
_BODY = "body"

F = TypeVar("F", bound=Callable[..., Awaitable[Any]])


class Document(msgspec.Struct, frozen=True, kw_only=True):
    """A file to download: its content, its media type, and a suggested name."""

    content: bytes
    media_type: str
    name: str


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of an operation. `place`: `path`, `query` or `body`."""

    name: str
    place: str
    type: Any
    default: Any = inspect.Parameter.empty

    @property
    def required(self) -> bool:
        return self.default is inspect.Parameter.empty


@dataclass(frozen=True, slots=True)
class Operation:
    """An operation, carried out by `function` for those who have the `required_right`.

    `name`: unique, such as `map.change`; the part before the dot is the group.
    """

    name: str
    method: str
    path: str
    function: Callable[..., Awaitable[Any]]
    parameters: tuple[Parameter, ...]
    returns: Any
    doc: str
    required_right: Right

    @property
    def changes(self) -> bool:
        """Whether it changes something of the site. What changes who has access is recorded where that is stored."""
        return self.method != "GET" and self.required_right not in (Right.SEE, Right.ADMINISTER)

    @property
    def group(self) -> str:
        return self.name.partition(".")[0]


def operation(method: str, path: str, required_right: Right) -> Callable[[F], F]:
    """Mark a coroutine method as an operation: `@operation("GET", "/map/objects/{name}", Right.SEE)`. Its docstring becomes its
    documentation. `required_right`: what its caller has to have."""

    def mark(function: F) -> F:
        setattr(function, _MARK, (method, path, required_right))
        return function

    return mark


def operations(group: str, part: object) -> Iterator[Operation]:
    """The operations among the methods of a part of the API: an object, which carries them out, or a class, which declares them."""
    for name, function in inspect.getmembers(part, inspect.iscoroutinefunction):
        if (marked := getattr(function, _MARK, None)) is not None:
            method, path, required_right = marked
            declared = _declared(getattr(function, "__func__", function), path)
            yield Operation(f"{group}.{name}", method, path, function, *declared, required_right)


@cache
def _declared(function: Callable[..., Awaitable[Any]], path: str) -> tuple[tuple[Parameter, ...], Any, str]:
    """The parameters, return type and docstring of a method, cached since many objects share it."""
    hints = get_type_hints(function)
    in_path = set(re.findall(r"{(\w+)}", path))
    parameters = tuple(
        Parameter(
            parameter.name,
            "path" if parameter.name in in_path else "body" if parameter.name == _BODY else "query",
            hints[parameter.name],
            parameter.default,
        )
        for parameter in inspect.signature(function).parameters.values()
        if parameter.name != "self"
    )
    assert in_path <= {parameter.name for parameter in parameters}, (
        f"{function.__qualname__}: {path} has a parameter that the method does not have"
    )
    return parameters, hints.get("return"), inspect.getdoc(function) or ""
