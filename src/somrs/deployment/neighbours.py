"""The file of a system's neighbours: the Registries and Repositories of other systems, what passes between them, and by which authority
programs of a neighbour are known."""

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
from somrs.trust.neighbours import TrustedNeighbour

Passing = Literal["all", "nothing"] | Selection
"""What passes, as it is written."""


class _RegistryEntry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the file says of a neighbour's Registry, or of its Registries. `registry`: the address, or the addresses."""

    registry: str | tuple[str, ...]
    takes: Passing
    gives: Passing

    URLS: ClassVar[tuple[str, ...]] = ("registry",)
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

    URLS: ClassVar[tuple[str, ...]] = ("repository",)
    ADVICE: ClassVar[str] = "`repository` is its address, `shows` is all, nothing, or a list of places, and `changes` is true or false"


class _TrustEntry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the file says of a neighbour's certificates. `authority`: the file with that of its authority. `hosts`, `trust`, `simulates`:
    `hosts`, `service` and `simulates` of `TrustedNeighbour`."""

    authority: str
    hosts: tuple[str, ...] = ()
    trust: str = ""
    simulates: bool = False

    URLS: ClassVar[tuple[str, ...]] = ("trust",)
    ADVICE: ClassVar[str] = (
        "`authority` is the file with the certificate of its authority, `hosts` is a list of names and addresses of its computers, and "
        "`trust` is the URL of the service of its authority, and `simulates` is true or false"
    )


_E = TypeVar("_E", _RegistryEntry, _RepositoryEntry, _TrustEntry)


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


def read_trusted_neighbours(file: Path) -> tuple[TrustedNeighbour, ...]:
    """By what the programs of the neighbours in a file are known. Raises UsageError, also if it does not say that of each of them."""
    registries, maps, trusted = _entries(file, _RegistryEntry), _entries(file, _RepositoryEntry), _entries(file, _TrustEntry)
    return tuple(
        _trusted(file, name, registries.get(name), maps.get(name), trusted.get(name))
        for name in dict.fromkeys((*registries, *maps, *trusted))
    )


def _trusted(
    file: Path, name: str, registry: _RegistryEntry | None, map: _RepositoryEntry | None, entry: _TrustEntry | None
) -> TrustedNeighbour:
    if entry is None:
        raise UsageError(
            f"{file}: {name} has no `authority`, by which its programs would be known here. Its owner prints the certificate with "
            f"`somrs trust authority > {name.lower()}.pem`; put it beside this file, and add `authority: {name.lower()}.pem`. Or "
            "start with --no-certificates, if all programs that reach the ports of this system are trusted"
        )
    registries, repository = _addresses(registry) if registry is not None else (), map.repository if map is not None else ""
    for address in (*registries, repository, entry.trust):
        if address and not address.startswith("https://"):
            raise UsageError(f"{file}: {name}: with certificates, addresses begin with https://, and this is {address}")
    certificate = file.parent / entry.authority
    try:
        authority = certificate.read_text("ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{file}: {name}: {certificate} cannot be read: {error}; `authority` is a certificate in PEM") from None
    return TrustedNeighbour(
        name=name,
        authority=authority,
        registries=registries,
        repository=repository,
        hosts=entry.hosts,
        service=entry.trust.rstrip("/"),
        simulates=entry.simulates,
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
        known_keys = {field for each in (_RegistryEntry, _RepositoryEntry, _TrustEntry) for field in each.__struct_fields__}
        concerned = {key: value for key, value in written.items() if key in kind.__struct_fields__ or key not in known_keys}
        if not concerned and written:
            return None
        written = concerned
    try:
        entry = msgspec.convert(written, kind)
    except msgspec.ValidationError as error:
        raise UsageError(f"{place}: {error}; {kind.ADVICE}") from None
    [field] = kind.URLS
    for address in _addresses(entry) or ("",):
        parts = urlsplit(address)
        is_left_out = not address and kind is _TrustEntry
        if not is_left_out and (parts.scheme not in ("http", "https") or not parts.hostname):
            raise UsageError(f"{place}: `{field}` is a URL such as http://HOST:PORT/{field}, not {address!r}")
    if not name.strip():
        raise UsageError(f"{place}: a neighbour has a name")
    return entry


def _addresses(entry: _RegistryEntry | _RepositoryEntry | _TrustEntry) -> tuple[str, ...]:
    written: str | tuple[str, ...] = getattr(entry, entry.URLS[0])
    return (written,) if isinstance(written, str) else written


def _selection(passing: Passing) -> Selection | None:
    if isinstance(passing, Selection):
        return passing
    return Selection() if passing == "all" else None
