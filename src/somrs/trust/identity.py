"""Identities: what a certificate of the site says of who has it.

A certificate has these as URIs in its SubjectAltName (RFC 5280, 4.2.1.6): `somrs:identity:NAME`, `somrs:role:ROLE` for each role, and
`somrs:speaks-for:NAME` for each name in which its owner may speak besides its own. `somrs:certificate:SERIAL` has its serial number, by
which the servers of a bus know it. `somrs:topics:FILTER` is each filter of the topics of MQTT that its owner may use there, and
`somrs:mqtt:SERIAL` is by what the servers know it then.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from urllib.parse import quote, unquote

from somrs.errors import UsageError

_IDENTITY, _ROLE, _SPEAKS_FOR, _TOPICS = "somrs:identity:", "somrs:role:", "somrs:speaks-for:", "somrs:topics:"
_CERTIFICATE, _MQTT = "somrs:certificate:", "somrs:mqtt:"


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
    THING = "thing"
    """A vehicle, a sensor or another thing that speaks MQTT at the bus, on its topics, and nothing else."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """A proven identity. `speaks_for`: the names besides its own in which it may speak, such as the devices of a gateway. `topics`: the
    filters of the topics that it may use at the bus by MQTT (3.1.1, 4.7), such as `uagv/v2/ACME/0001/#`.

    `site`: the neighbour whose authority has issued its certificate; empty for those of the own site.
    """

    name: str
    roles: frozenset[Role]
    speaks_for: frozenset[str] = frozenset()
    topics: frozenset[str] = frozenset()
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
            *(f"{_TOPICS}{quote(topics, safe='')}" for topics in sorted(self.topics)),
        ]


def certificate_uri(serial: str) -> str:
    """The URI of the certificate with this serial number, in hexadecimal digits."""
    return _CERTIFICATE + serial


def mqtt_uri(serial: str) -> str:
    """The URI by which the servers of a bus know who speaks MQTT with the certificate with this serial number."""
    return _MQTT + serial


def role_uri(role: Role) -> str:
    """The URI of those that have a role."""
    return _ROLE + role


def identity_of_uris(uris: Iterable[str]) -> Identity:
    """The identity in a certificate with these URIs; others are skipped. Raises UsageError if they name none, or an unknown role."""
    names, roles, speaks_for, topics = [], [], [], []
    for uri in uris:
        if uri.startswith(_IDENTITY):
            names.append(unquote(uri.removeprefix(_IDENTITY)))
        elif uri.startswith(_ROLE):
            roles.append(role_named(uri.removeprefix(_ROLE)))
        elif uri.startswith(_SPEAKS_FOR):
            speaks_for.append(unquote(uri.removeprefix(_SPEAKS_FOR)))
        elif uri.startswith(_TOPICS):
            topics.append(unquote(uri.removeprefix(_TOPICS)))
    if len(names) != 1 or not roles:
        raise UsageError("this certificate has no identity of SO-MRS: its SubjectAltName needs one somrs:identity: and a somrs:role:")
    return Identity(name=names[0], roles=frozenset(roles), speaks_for=frozenset(speaks_for), topics=frozenset(topics))


def role_named(text: str) -> Role:
    """The role with this name. Raises UsageError with the names of all."""
    try:
        return Role(text)
    except ValueError:
        raise UsageError(f"there is no role {text!r}; the roles are {', '.join(Role)}") from None
