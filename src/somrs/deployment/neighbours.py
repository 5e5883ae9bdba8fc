"""The file of a system's neighbours: the Registries and Repositories of other systems, and what passes between them."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal, TypeVar
from urllib.parse import urlsplit

import msgspec
from msgspec import Struct

from somrs.errors import UsageError
from somrs.ontology.files.nodes import Source
from somrs.protocol.messages.neighbours import Neighbour as NeighbouringMap
from somrs.registry.neighbours import Neighbour, check_neighbours
from somrs.registry.selection import Selection
from somrs.repository.names import is_name

Passing = Literal["all", "nothing"] | Selection
"""What passes, as it is written."""


class _RegistryEntry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the file says of a neighbour's Registry, or of its Registries. `registry`: the address, or the addresses."""

    registry: str | tuple[str, ...]
    takes: Passing
    gives: Passing

    ADVICE: ClassVar[str] = (
        "`registry` is its address, or a list of addresses, and "
        "`takes` and `gives` are all, nothing, or lists of `types`, `providers` and `areas`"
    )


class _RepositoryEntry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the file says of a neighbour's Repository. `repository`: its address; `shows`: which places of the own map it sees; `changes`:
    whether it changes what it sees."""

    repository: str
    shows: Literal["all", "nothing"] | tuple[str, ...]
    changes: bool

    ADVICE: ClassVar[str] = "`repository` is its address, `shows` is all, nothing, or a list of places, and `changes` is true or false"


_E = TypeVar("_E", _RegistryEntry, _RepositoryEntry)


def read_neighbours(file: Path) -> tuple[Neighbour, ...]:
    """The Registries of the neighbours in a file, in its order. Raises UsageError for a file that is not as it should be."""
    neighbours = tuple(
        Neighbour(
            name=name if number == 1 else f"{name}-{number}",
            address=address,
            takes=_selection(entry.takes),
            gives=_selection(entry.gives),
            map=name if number > 1 else "",
        )
        for name, entry in _entries(file, _RegistryEntry).items()
        for number, address in enumerate(_addresses(entry), 1)
    )
    try:
        check_neighbours(neighbours)
    except UsageError as error:
        raise UsageError(f"{file}: {error}") from None
    return neighbours


def read_neighbouring_maps(file: Path, map: str) -> tuple[NeighbouringMap, ...]:
    """The Repositories of the neighbours in a file. `map`: the name of the own map, as far as it is known. Raises UsageError."""
    entries = _entries(file, _RepositoryEntry)
    for name in entries:
        if not is_name(name):
            raise UsageError(f"{file}: {name}: a neighbour with a map has the map's name, with letters, digits, _ and -, such as Harbour")
        if name == map:
            raise UsageError(f"{file}: {name} is the name of the own map; maps of neighbours have different names")
    return tuple(
        NeighbouringMap(
            map=name,
            address=entry.repository,
            shows=entry.shows if isinstance(entry.shows, tuple) else (),
            shows_all=entry.shows == "all",
            may_change=entry.changes,
        )
        for name, entry in entries.items()
    )


def _entries(file: Path, kind: type[_E]) -> dict[str, _E]:
    try:
        source = Source(str(file), file.read_text("utf-8"))
    except UnicodeDecodeError as error:
        raise UsageError(f"{file} is not a text in UTF-8: {error}") from None
    if source.problems:
        raise UsageError("\n".join(map(str, source.problems)))
    if source.data is not None and not isinstance(source.data, dict):
        raise UsageError(f"{file}: the names of neighbours are missing; write NAME: {{registry: http://..., takes: all, gives: all}}")
    entries = ((str(name), _entry(source, str(name), written, kind)) for name, written in (source.data or {}).items())
    return {name: entry for name, entry in entries if entry is not None}


def _entry(source: Source, name: str, written: object, kind: type[_E]) -> _E | None:
    """What is written of a neighbour that concerns this kind; None if nothing is."""
    place = f"{source.file}:{source.line((name,))}: {name}"
    if isinstance(written, dict):
        # The name decides about both; a neighbour may have a Registry only, or a Repository only.
        known_keys = {*_RegistryEntry.__struct_fields__, *_RepositoryEntry.__struct_fields__}
        concerned = {key: value for key, value in written.items() if key in kind.__struct_fields__ or key not in known_keys}
        if not concerned and written:
            return None
        written = concerned
    try:
        entry = msgspec.convert(written, kind)
    except msgspec.ValidationError as error:
        raise UsageError(f"{place}: {error}; {kind.ADVICE}") from None
    field = kind.__struct_fields__[0]
    for address in _addresses(entry) or ("",):
        parts = urlsplit(address)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise UsageError(f"{place}: `{field}` is a URL such as http://HOST:PORT/{field}, not {address!r}")
    if not name.strip():
        raise UsageError(f"{place}: a neighbour has a name")
    return entry


def _addresses(entry: _RegistryEntry | _RepositoryEntry) -> tuple[str, ...]:
    written: str | tuple[str, ...] = getattr(entry, entry.__struct_fields__[0])
    return (written,) if isinstance(written, str) else written


def _selection(passing: Passing) -> Selection | None:
    if isinstance(passing, Selection):
        return passing
    return Selection() if passing == "all" else None
