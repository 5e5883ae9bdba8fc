"""The table of models: the furniture, things and robots that the names of models in building files stand for."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from somrs.errors import InputError, ModelError, Problem
from somrs.ontology.files.loading import upper
from somrs.ontology.files.nodes import Source

SECTIONS = ("furniture", "words", "things", "scenery", "robots")


class Furniture(Struct, frozen=True, forbid_unknown_fields=True):
    """A model as a box: the parent of its type, and width, depth and height in metres."""

    type: str
    size: tuple[float, float, float]
    color: str = "Grey"


class Robot(Struct, frozen=True, forbid_unknown_fields=True):
    """A robot: its type, and what differs from the defaults of the type, in metres, m/s and kg."""

    type: str
    radius: float | None = None
    height: float | None = None
    speed: float | None = None
    weight: float | None = None


ADVICE = "State what models stand for, and their sizes, in a file: --sizes FILE"
"""What to do about models that the table does not have."""

UNKNOWN = Furniture(type="Obstacle", size=(0.5, 0.5, 0.5))
UNKNOWN_ROBOT = Robot(type="Vehicle")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelTable:
    """What models stand for, by their names."""

    furniture: dict[str, Furniture] = field(default_factory=dict)
    words: dict[str, Furniture] = field(default_factory=dict)
    things: dict[str, str] = field(default_factory=dict)
    scenery: frozenset[str] = frozenset()
    robots: dict[str, Robot] = field(default_factory=dict)

    def by_word(self, model: str) -> tuple[str, Furniture] | None:
        """The last word of the name that the table knows, and what it stands for: `GardenChair2` is a chair."""
        return next(((word, self.words[word]) for word in reversed(_words(model)) if word in self.words), None)

    def extended(self, path: Path) -> ModelTable:
        """The table with the entries of a file, which replace those of the same names. Raises InputError, or ModelError."""
        try:
            text = path.read_text("utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path} cannot be read ({error}); give the path of a YAML file with sizes") from error
        return self.merged(_read(Source(str(path), text)))

    def merged(self, addition: ModelTable) -> ModelTable:
        return replace(
            self,
            furniture={**self.furniture, **addition.furniture},
            words={**self.words, **addition.words},
            things={name: type for name, type in {**self.things, **addition.things}.items() if name not in addition.furniture},
            scenery=(self.scenery | addition.scenery) - addition.furniture.keys(),
            robots={**self.robots, **addition.robots},
        )


@functools.cache
def shipped_models() -> ModelTable:
    """The table that SO-MRS comes with."""
    return _read(Source("models.yaml", resources.files("somrs.sites").joinpath("data/models.yaml").read_text("utf-8")))


def _words(model: str) -> list[str]:
    """The words of a name in lower case: `MetalCabinet_2` has metal and cabinet."""
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", model)]


def _read(source: Source) -> ModelTable:
    problems = list(source.problems)

    def wrong(path: tuple[str, ...], message: str) -> None:
        problems.append(Problem(file=source.file, line=source.line(path), subject=".".join(path) or "file", rule="models", message=message))

    def entries(section: str) -> Iterator[tuple[str, Any]]:
        content = data.get(section) or {}
        if not isinstance(content, dict):
            wrong((section,), "write NAME: {...} for each model")
            return
        yield from content.items()

    def converted(section: str, kind: type[Any], below: str) -> dict[str, Any]:
        table = {}
        for name, value in entries(section):
            try:
                entry = msgspec.convert(value, kind)
            except msgspec.ValidationError as error:
                wrong((section, name), str(error))
                continue
            type_name = entry if isinstance(entry, str) else entry.type
            if not upper().is_subtype(type_name, below):
                wrong((section, name), f"{type_name} is no type below {below} in the upper ontology")
            elif any(size <= 0 for size in _sizes(entry)):
                wrong((section, name), "sizes are greater than 0")
            else:
                table[name] = entry
        return table

    data = source.data if isinstance(source.data, dict) else {}
    if not problems and not isinstance(source.data, dict):
        wrong((), f"a table of models has the keys {', '.join(SECTIONS)}")
    for section in data.keys() - set(SECTIONS):
        wrong((section,), f"the keys are {', '.join(SECTIONS)}")
    scenery = data.get("scenery") or []
    if not isinstance(scenery, list) or not all(isinstance(name, str) for name in scenery):
        wrong(("scenery",), "write a list of models' names")
        scenery = []
    table = ModelTable(
        furniture=converted("furniture", Furniture, "Furniture"),
        words={word.lower(): entry for word, entry in converted("words", Furniture, "Furniture").items()},
        things=converted("things", str, "Graspable"),
        scenery=frozenset(scenery),
        robots=converted("robots", Robot, "MobileRobot"),
    )
    if problems:
        raise ModelError(problems)
    return table


def _sizes(entry: str | Furniture | Robot) -> Iterator[float]:
    match entry:
        case Furniture():
            yield from entry.size
        case Robot():
            yield from (size for size in (entry.radius, entry.height, entry.speed, entry.weight) if size is not None)
