"""Who holds a certificate of the site: the public part of what its authority keeps, in the file `holders.json`.

Where a connection proves only the name of a sender, as on a bus, its identity is looked up here.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import msgspec

from somrs.errors import UsageError
from somrs.trust.identity import Identity, Role
from somrs.trust.neighbours import NEIGHBOURS_FILE, REVOKED_NEIGHBOURS_FILE, TrustedNeighbour, write_trusted
from somrs.trust.neighbours import write_revoked as write_revoked_of_neighbours

HOLDERS_FILE, REVOKED_FILE = "holders.json", "revoked.txt"


class Holder(msgspec.Struct, frozen=True, kw_only=True):
    """A certificate that is not revoked. `begins`, `ends`: seconds since 1970."""

    serial: str
    name: str
    roles: tuple[Role, ...]
    speaks_for: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    begins: float
    ends: float

    @property
    def identity(self) -> Identity:
        speaks_for, topics = frozenset(self.speaks_for), frozenset(self.topics)
        return Identity(name=self.name, roles=frozenset(self.roles), speaks_for=speaks_for, topics=topics)


def read_holders(file: Path) -> tuple[Holder, ...]:
    """The holders in a file; none if it is missing. Raises UsageError if it cannot be read."""
    try:
        return msgspec.json.decode(file.read_bytes(), type=tuple[Holder, ...])
    except FileNotFoundError:
        return ()
    except (msgspec.DecodeError, OSError) as error:
        raise UsageError(f"{file} cannot be read: {error}; any command `somrs trust invite`, `enrol` or `revoke` writes it anew") from None


def write_holders(holders: Iterable[Holder]) -> bytes:
    """The content of the file."""
    return msgspec.json.format(msgspec.json.encode([*holders]))


def holder_named(holders: Iterable[Holder], name: str, now: float) -> Holder:
    """Who has this name. Of several certificates, the one that was issued last counts. Raises UsageError if none holds at this time."""
    holding = [holder for holder in holders if holder.name == name and now < holder.ends]
    if not holding:
        raise UsageError(f"{name} has no certificate that holds: enrol it again, with a new invitation")
    return max(holding, key=lambda holder: holder.begins)


class TrustNews(msgspec.Struct, frozen=True, kw_only=True):
    """What the service of the authority says to programs elsewhere: the serial numbers of what is revoked, who holds a certificate, the
    addresses of the system, if it runs, and the neighbours whose certificates count, with what they have revoked. `version`: changes with
    any of it."""

    version: str
    revoked: tuple[str, ...]
    holders: tuple[Holder, ...]
    system: dict[str, object] | None = None
    neighbours: tuple[TrustedNeighbour, ...] = ()
    revoked_of_neighbours: dict[str, tuple[str, ...]] = {}

    @property
    def files(self) -> dict[str, bytes]:
        """The same as files beside a certificate, by their names."""
        system = {"system.json": msgspec.json.format(msgspec.json.encode(self.system))} if self.system is not None else {}
        return {
            REVOKED_FILE: write_revoked(self.revoked),
            HOLDERS_FILE: write_holders(self.holders),
            NEIGHBOURS_FILE: write_trusted(self.neighbours),
            REVOKED_NEIGHBOURS_FILE: write_revoked_of_neighbours(self.revoked_of_neighbours),
        } | system


def write_revoked(serials: Iterable[str]) -> bytes:
    """The content of the file of serial numbers."""
    return "".join(f"{serial}\n" for serial in sorted(serials)).encode()
