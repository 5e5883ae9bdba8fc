"""Neighbours whose programs have certificates: each with the authority that has issued them, and the computers on which these programs are.

They are in the file `neighbours.json` beside the certificate of the own authority. A certificate is of the site whose authority has
signed it, whatever it says; an address is of the site whose host it has.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from urllib.parse import urlsplit

import msgspec

from somrs.errors import UsageError

NEIGHBOURS_FILE = "neighbours.json"

REVOKED_NEIGHBOURS_FILE = "neighbours-revoked.json"
"""The file beside it with the serial numbers of what they have revoked, by the fingerprints of their authorities."""

OWN_SITE = ""
"""The name of the own site, among those of neighbours."""


class TrustedNeighbour(msgspec.Struct, frozen=True, kw_only=True):
    """A neighbour. `authority`: the certificate of its authority, in PEM. `registries`, `repository`: the addresses of these components.

    `hosts`: names and IP addresses of the computers of its other programs. `service`: the URL of the service of its authority; empty if it
    is not asked what it has revoked. `simulates`: its simulator has the own map, too, and may read all of it.
    """

    name: str
    authority: str
    registries: tuple[str, ...] = ()
    repository: str = ""
    hosts: tuple[str, ...] = ()
    service: str = ""
    simulates: bool = False

    @property
    def all_hosts(self) -> frozenset[str]:
        """The hosts that addresses of its programs have, in lower case."""
        addresses = (*self.registries, self.repository, self.service)
        return frozenset(host.casefold() for host in (*self.hosts, *map(host_of, addresses)) if host)


class Neighbours:
    """The neighbours of a site. Raises UsageError if two of them have a host in common, or if one has a host of the own site."""

    def __init__(self, neighbours: Iterable[TrustedNeighbour] = (), own_hosts: Iterable[str] = ()) -> None:
        self.all = tuple(neighbours)
        self._by_name = {neighbour.name: neighbour for neighbour in self.all}
        self._by_host: dict[str, str] = dict.fromkeys((host.casefold() for host in own_hosts), OWN_SITE)
        for neighbour in self.all:
            for host in sorted(neighbour.all_hosts):
                if (earlier := self._by_host.setdefault(host, neighbour.name)) != neighbour.name:
                    raise UsageError(
                        f"the neighbour {neighbour.name} is at {host}, and so is {earlier or 'this system'}: with certificates, addresses "
                        "are told apart by their hosts, so give each system a name or an IP address of its own, with --host"
                    )

    def __contains__(self, name: str) -> bool:
        return name in self._by_name

    def __getitem__(self, name: str) -> TrustedNeighbour:
        return self._by_name[name]

    def site_of(self, address: str) -> str:
        """The neighbour at whose hosts an address is; `OWN_SITE` for all others."""
        return self._by_host.get(host_of(address), OWN_SITE) if self.all else OWN_SITE


def host_of(address: str) -> str:
    """The host of an address, in lower case; empty if it has none."""
    try:
        return (urlsplit(address).hostname or "").casefold()
    except ValueError:
        return ""


def read_trusted(file: Path) -> tuple[TrustedNeighbour, ...]:
    """The neighbours in a file; none if it is missing. Raises UsageError if it cannot be read."""
    try:
        return msgspec.json.decode(file.read_bytes(), type=tuple[TrustedNeighbour, ...])
    except FileNotFoundError:
        return ()
    except (msgspec.DecodeError, OSError) as error:
        raise UsageError(f"{file} cannot be read: {error}; `somrs trust neighbours FILE` writes it anew") from None


def read_revoked(file: Path) -> dict[str, tuple[str, ...]]:
    """What neighbours have revoked, as a file has it; nothing if it is missing or spoilt: their authorities are asked again."""
    try:
        return msgspec.json.decode(file.read_bytes(), type=dict[str, tuple[str, ...]])
    except (msgspec.DecodeError, OSError):
        return {}


def write_revoked(serials: Mapping[str, tuple[str, ...]]) -> bytes:
    """The content of that file."""
    return msgspec.json.encode(serials)


def write_trusted(neighbours: Iterable[TrustedNeighbour]) -> bytes:
    """The content of the file."""
    return msgspec.json.format(msgspec.json.encode([*neighbours]))
