"""The file of a Registry's neighbours: which other Registries it follows, and what passes between them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

import msgspec
from msgspec import Struct

from somrs.errors import UsageError
from somrs.ontology.files.nodes import Source
from somrs.registry.neighbours import Neighbour, check_neighbours
from somrs.registry.selection import Selection

Passing = Literal["all", "nothing"] | Selection
"""What passes, as it is written."""


class _Entry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A neighbour as it is written in the file. `registry`: the address of its Registry."""

    registry: str
    takes: Passing
    gives: Passing


def read_neighbours(file: Path) -> tuple[Neighbour, ...]:
    """The neighbours in a file, in its order. Raises UsageError for a file that is not as it should be."""
    try:
        source = Source(str(file), file.read_text("utf-8"))
    except UnicodeDecodeError as error:
        raise UsageError(f"{file} is not a text in UTF-8: {error}") from None
    if source.problems:
        raise UsageError("\n".join(map(str, source.problems)))
    if source.data is not None and not isinstance(source.data, dict):
        raise UsageError(f"{file}: the names of neighbours are missing; write NAME: {{registry: http://..., takes: all, gives: all}}")
    neighbours = tuple(_neighbour(source, str(name), entry) for name, entry in (source.data or {}).items())
    try:
        check_neighbours(neighbours)
    except UsageError as error:
        raise UsageError(f"{file}: {error}") from None
    return neighbours


def _neighbour(source: Source, name: str, written: object) -> Neighbour:
    place = f"{source.file}:{source.line((name,))}: {name}"
    try:
        entry = msgspec.convert(written, _Entry)
    except msgspec.ValidationError as error:
        advice = "`registry` is its address, and `takes` and `gives` are all, nothing, or lists of `types`, `providers` and `areas`"
        raise UsageError(f"{place}: {error}; {advice}") from None
    parts = urlsplit(entry.registry)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise UsageError(f"{place}: `registry` is a URL such as http://HOST:PORT/registry, not {entry.registry!r}")
    if not name.strip():
        raise UsageError(f"{place}: a neighbour has a name")
    return Neighbour(name=name, address=entry.registry, takes=_selection(entry.takes), gives=_selection(entry.gives))


def _selection(passing: Passing) -> Selection | None:
    if isinstance(passing, Selection):
        return passing
    return Selection() if passing == "all" else None
