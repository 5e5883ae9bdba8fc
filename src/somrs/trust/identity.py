"""Identities: what a certificate of the site says of who has it.

A certificate has these as URIs in its SubjectAltName (RFC 5280, 4.2.1.6): `somrs:identity:NAME`, `somrs:role:ROLE` for each role, and
`somrs:speaks-for:NAME` for each name in which its owner may speak besides its own. `somrs:certificate:SERIAL` has its serial number, by
which the servers of a bus know it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from urllib.parse import quote, unquote

from somrs.errors import UsageError

_IDENTITY, _ROLE, _SPEAKS_FOR = "somrs:identity:", "somrs:role:", "somrs:speaks-for:"
_CERTIFICATE = "somrs:certificate:"


class Role(StrEnum):
    """What a program is. What it may send follows from it."""

    DEVICE = "device"
    """A device, a host of devices, a gateway to devices, or a robot of another make."""
    TASK_MANAGER = "task-manager"
    REPOSITORY = "repository"
    REGISTRY = "registry"
    SCHEDULER = "scheduler"
    TRAFFIC = "traffic"
    """The traffic of a building; also that of its simulator."""
    GATEWAY = "gateway"
    """The gateway to a bus. It passes messages on for who has proven to it who they are."""
    BUS = "bus"
    """A server of the bus."""
    API = "api"
    """The server of the public API. It acts for people, whose rights it checks itself."""
    CLIENT = "client"
    """A program of a person, such as the command line."""
    VIEWER = "viewer"
    """A program that only reads."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """A proven identity. `speaks_for`: the names besides its own in which it may speak, such as the devices of a gateway.

    `site`: the neighbour whose authority has issued its certificate; empty for those of the own site.
    """

    name: str
    roles: frozenset[Role]
    speaks_for: frozenset[str] = frozenset()
    site: str = ""

    @property
    def full_name(self) -> str:
        """The name, with the neighbour that it is of: `Barn:BarnRobot`."""
        return f"{self.site}:{self.name}" if self.site else self.name

    def may_speak_for(self, name: str) -> bool:
        return name == self.name or name in self.speaks_for

    @property
    def uris(self) -> list[str]:
        """What its certificate says."""
        return [
            f"{_IDENTITY}{quote(self.name, safe='')}",
            *(f"{_ROLE}{role}" for role in sorted(self.roles)),
            *(f"{_SPEAKS_FOR}{quote(name, safe='')}" for name in sorted(self.speaks_for)),
        ]


def certificate_uri(serial: str) -> str:
    """The URI of the certificate with this serial number, in hexadecimal digits."""
    return _CERTIFICATE + serial


def role_uri(role: Role) -> str:
    """The URI of those that have a role."""
    return _ROLE + role


def identity_of_uris(uris: Iterable[str]) -> Identity:
    """The identity in a certificate with these URIs; others are skipped. Raises UsageError if they name none, or an unknown role."""
    names, roles, speaks_for = [], [], []
    for uri in uris:
        if uri.startswith(_IDENTITY):
            names.append(unquote(uri.removeprefix(_IDENTITY)))
        elif uri.startswith(_ROLE):
            roles.append(role_named(uri.removeprefix(_ROLE)))
        elif uri.startswith(_SPEAKS_FOR):
            speaks_for.append(unquote(uri.removeprefix(_SPEAKS_FOR)))
    if len(names) != 1 or not roles:
        raise UsageError("this certificate has no identity of SO-MRS: its SubjectAltName needs one somrs:identity: and a somrs:role:")
    return Identity(name=names[0], roles=frozenset(roles), speaks_for=frozenset(speaks_for))


def role_named(text: str) -> Role:
    """The role with this name. Raises UsageError with the names of all."""
    try:
        return Role(text)
    except ValueError:
        raise UsageError(f"there is no role {text!r}; the roles are {', '.join(Role)}") from None
