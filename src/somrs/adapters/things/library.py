"""The shipped types, attributes and services of things, on which mappings build."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from importlib import resources
from pathlib import Path

from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.files.nodes import Source
from somrs.ontology.naming import key_of
from somrs.ontology.schema import ENTRIES
from somrs.ontology.types import Definition, Ontology


@lru_cache(maxsize=1)
def library() -> tuple[Definition, ...]:
    """The definitions for things."""
    text = resources.files("somrs.adapters.things").joinpath("data/things.yaml").read_text("utf-8")
    base = upper(1)
    ontology = load_text(text, "things.yaml", base).ontology
    upper_keys = {key_of(definition) for definition in base}
    return tuple(definition for definition in ontology if key_of(definition) not in upper_keys)


def ontology_below(paths: Iterable[Path]) -> Ontology:
    """The upper ontology, on the level of the files, with the definitions for things. Where the files define something of the same name,
    this counts instead."""
    sources = [*_sources(paths, set())]
    level = max((int(source.data.get("upper") or 1) for source in sources), default=1)
    names = {(section, name) for source in sources for section in ENTRIES for name in source.data.get(section) or ()}
    definitions = (definition for definition in library() if (str(key_of(definition).section), definition.name) not in names)
    return upper(level).extended(definitions)


def _sources(paths: Iterable[Path], visited: set[Path]) -> Iterator[Source]:
    """The files that can be read, and those that they use. What is wrong with them is reported when they are loaded."""
    for path in paths:
        if path.resolve() in visited:
            continue
        visited.add(path.resolve())
        try:
            source = Source(str(path), path.read_text("utf-8-sig"))
        except (OSError, UnicodeDecodeError):
            continue
        if isinstance(source.data, dict):
            yield source
            used_files = source.data.get("uses")
            names = used_files if isinstance(used_files, list) else []
            yield from _sources([path.parent / name for name in names if isinstance(name, str)], visited)
