"""Reads values from a building file, and turns what cannot be read into problems with their line."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from somrs.errors import Problem
from somrs.ontology.files.nodes import Path as YamlPath
from somrs.ontology.files.nodes import Source


@dataclass(slots=True)
class Document:
    """A building file, and the problems found in it."""

    source: Source
    problems: list[Problem] = field(default_factory=list)

    @property
    def data(self) -> dict[str, Any]:
        data: dict[str, Any] = self.source.data
        return data

    @contextmanager
    def reading(self, subject: str, path: YamlPath) -> Iterator[None]:
        """Turn errors from missing or wrong values in the file into a problem with its line."""
        try:
            yield
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError, StopIteration) as error:
            message = f"cannot be read: {_reason(error)}; correct it in the traffic editor"
            self.problems.append(
                Problem(file=self.source.file, line=self.source.line(path), subject=subject, rule="structure", message=message)
            )

    def parameter(self, name: str, default: Any = None) -> Any:
        """A parameter of the whole building."""
        return parameter(self.data.get("parameters"), name, default)


def _reason(error: Exception) -> str:
    match error:
        case KeyError(args=(int(),)):
            return f"it refers to vertex {error.args[0]}, which is not there"
        case KeyError():
            return f"{name_text(error.args[0])} is missing"
        case IndexError():
            return "it has too few values, or refers to a vertex that is not there"
        case TypeError() | AttributeError():
            return "it has not the form in which the traffic editor writes it"
        case _:
            return str(error)


def number(value: Any) -> float:
    """The finite number that a value is. Raises ValueError for another one, and TypeError for what is no value."""
    try:
        value_as_number = float(value)
    except ValueError:
        value_as_number = math.nan
    if not math.isfinite(value_as_number):
        raise ValueError(f"{value} is no number")
    return value_as_number


def positive(values: Any, key: str) -> float:
    """The length at a key. Raises ValueError if it is not greater than 0."""
    length = number(values[key])
    if length <= 0:
        raise ValueError(f"{key} is {length:g}, and has to be greater than 0")
    return length


def name_text(value: Any) -> str:
    """A name as the file has it. Names that are numbers are read as such."""
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value).strip()


def parameter(parameters: Any, name: str, default: Any = None) -> Any:
    """The value of a parameter, which the file has as [type code, value], or, if it was written by hand, as the value alone.

    Raises ValueError for another list, and TypeError for parameters that have no names.
    """
    if parameters is None:
        return default
    if not isinstance(parameters, dict):
        raise TypeError(f"{parameters} are no parameters")
    value = parameters.get(name)
    if not isinstance(value, list):
        return default if value is None else value
    if len(value) != 2:
        raise ValueError(f"{name} is {value}; a parameter is [type code, value]")
    return value[1]


def text_of(parameters: Any, name: str) -> str:
    """The text of a parameter; empty if there is none."""
    value = parameter(parameters, name)
    return "" if value is None else name_text(value)


def whole_number(value: Any) -> int:
    """The index that a value is. Raises ValueError for one below 0, which would count from the end, and for a fraction."""
    index = number(value)
    if not index.is_integer() or index < 0:
        raise ValueError(f"{value} is no index")
    return int(index)
