"""The certificates of a system's own programs: made when a program starts, and renewed while it runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from somrs.trust.authority import Authority
from somrs.trust.credentials import VARIABLE
from somrs.trust.identity import Identity, Role

CLIENT = "client"
"""The name of the certificate of those who use the system from its data folder, such as the command line."""

RENEWAL_PAUSE = 3600.0
"""Seconds between two looks whether certificates are due for renewal."""

_ROLES = {
    "repository": Role.REPOSITORY,
    "registry": Role.REGISTRY,
    "task-manager": Role.TASK_MANAGER,
    "traffic": Role.TRAFFIC,
    "simulator": Role.TRAFFIC,
    "devices": Role.DEVICE,
    "scheduler": Role.SCHEDULER,
    "api": Role.API,
}
"""The roles of programs, by their command. All others only read."""


class ProgramCertificates:
    """Gives the programs of the system with this data folder, at this host, certificates of the site's authority."""

    def __init__(self, data: Path, host: str) -> None:
        self._authority, self._hosts = Authority.of_data(data), tuple(dict.fromkeys((host, "127.0.0.1", "localhost")))
        self._identities: dict[str, Identity] = {}
        self._renewed_at = time.monotonic()

    @property
    def folder(self) -> Path:
        return self._authority.folder

    def prepare(self, site: str) -> None:
        """Make the authority, if there is none, and the certificate of clients."""
        if not self._authority.exists:
            self._authority.create(site, datetime.now(UTC))
        self._issue(Identity(name=CLIENT, roles=frozenset({Role.CLIENT})))

    def environment(self, name: str, arguments: Sequence[str]) -> dict[str, str]:
        """What a program needs to prove who it is. A process of devices speaks for each of them: `NAME=DRIVER` of its arguments."""
        role = _ROLES.get(arguments[1], Role.VIEWER)
        devices = [argument.partition("=")[0] for argument in arguments if "=" in argument] if role is Role.DEVICE else []
        return {VARIABLE: str(self._issue(Identity(name=name, roles=frozenset({role}), speaks_for=frozenset(devices))))}

    def renew(self) -> None:
        """Renew what is due. Programs go on with their new certificates by themselves."""
        if time.monotonic() - self._renewed_at >= RENEWAL_PAUSE:
            self._renewed_at = time.monotonic()
            for identity in [*self._identities.values()]:
                self._issue(identity)

    def _issue(self, identity: Identity) -> Path:
        self._identities[identity.name] = identity
        return self._authority.issue_program(identity, self._hosts, datetime.now(UTC))[0]
