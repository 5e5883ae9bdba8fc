"""Reads values from a building file, and turns what cannot be read into problems with their line."""

from __future__ import annotations

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
            missing = f"{error.args[0]} is missing" if isinstance(error, KeyError) else str(error)
            message = f"cannot be read: {missing}; correct it in the traffic editor"
            self.problems.append(
                Problem(file=self.source.file, line=self.source.line(path), subject=subject, rule="structure", message=message)
            )

    def parameter(self, name: str, default: Any = None) -> Any:
        """A parameter of the whole building."""
        return parameter(self.data.get("parameters"), name, default)


def parameter(parameters: Any, name: str, default: Any = None) -> Any:
    """The value of a parameter, which the file has as [type code, value]."""
    value = parameters.get(name) if isinstance(parameters, dict) else None
    return value[1] if isinstance(value, list) and len(value) == 2 else default


def text_of(parameters: Any, name: str) -> str:
    """The text of a parameter; empty if there is none."""
    value = parameter(parameters, name)
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return "" if value is None else str(value).strip()


def whole_number(value: Any) -> int:
    """The index that a value is. Raises ValueError for one below 0, which would count from the end, and for a fraction."""
    number = float(value)
    if not number.is_integer() or number < 0:
        raise ValueError(f"{value} is no index")
    return int(number)
