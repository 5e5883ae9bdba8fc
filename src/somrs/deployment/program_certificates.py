"""The certificates of a system's own programs: made when a program starts, and renewed while it runs."""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from somrs.client.addresses import Addresses
from somrs.deployment.neighbours import read_trusted_neighbours
from somrs.trust.credentials import FOLDER, VARIABLE, Credentials
from somrs.trust.identity import Identity, Role
from somrs.trust.mqtt_topics import EVERYTHING
from somrs.trust.neighbours import TrustedNeighbour

if TYPE_CHECKING:
    from somrs.trust.authority import Authority

CLIENT = "client"
"""The name of the certificate of those who use the system from its data folder, such as the command line."""

RENEWAL_PAUSE = 3600.0
"""Seconds between two looks whether certificates are due for renewal."""

_ROLES = {
    "bus": Role.BUS,
    "gateway": Role.GATEWAY,
    "repository": Role.REPOSITORY,
    "registry": Role.REGISTRY,
    "task-manager": Role.TASK_MANAGER,
    "traffic": Role.TRAFFIC,
    "simulator": Role.TRAFFIC,
    "devices": Role.DEVICE,
    "adapter": Role.DEVICE,
    "scheduler": Role.SCHEDULER,
    "api": Role.API,
}
"""The roles of programs, by their command. All others only read."""


def certificates_of_programs(
    data: Path,
    host: str,
    site: str,
    choice: bool | None,
    *,
    secure: bool,
    neighbours: Path | None = None,
) -> ProgramCertificates | None:
    """The certificates of the programs of the system with this data folder, at this host; None if they have none.

    `choice`: whether they have, as was asked for; None: nothing was. Then they have, but in a system that is open to anybody, and in one
    that has run without: devices of other makes may rely on that. `neighbours`: the file of its neighbours.
    Raises UsageError if the file does not say by which authority a neighbour is known.
    """
    earlier_addresses = Addresses.of_last_run(data)
    has_run_without = earlier_addresses is not None and earlier_addresses.trust is None
    if not (choice if choice is not None else secure and not has_run_without):
        return None
    from somrs.trust.authority import Authority  # loads libraries that others do without

    trusted = read_trusted_neighbours(neighbours) if neighbours is not None else ()
    return ProgramCertificates(Authority.of_data(data), host, site, trusted)


def give_devices_a_certificate(names: Collection[str], addresses: Addresses, host: str, topics: Collection[str] = ()) -> None:
    """Have this process use a certificate with which it may speak for these devices, if the system has some, this process has none, and it
    may read the data folder. `topics`: of MQTT, that it may use. Raises UsageError if that certificate cannot be made."""
    certificate = certificate_of_devices(names, addresses, host, topics) if VARIABLE not in os.environ else None
    if certificate is not None:
        os.environ[VARIABLE] = str(certificate)


def certificate_of_devices(names: Collection[str], addresses: Addresses, host: str, topics: Collection[str] = ()) -> Path | None:
    """The file of a new certificate with which a program may speak for these devices, and use these topics of MQTT; None if the system has
    none, or if this process may not read the data folder. Raises UsageError if it cannot be made."""
    folder = Path(addresses.trust) if addresses.trust is not None else None
    if folder is None or not os.access(folder / "authority.key", os.R_OK):
        return None
    from somrs.trust.authority import Authority  # as above

    name, *further = names
    return ProgramCertificates(Authority(folder), host, "").of_devices(name, further, topics)


def give_simulator_a_certificate(repositories: Sequence[str], data: Path, host: str) -> None:
    """Have this process use a certificate for a simulator of several maps, if their Repositories have some, this process has none, and it
    may read the data folder of one of the systems. Raises UsageError if that certificate cannot be made."""
    folder = data / FOLDER
    is_secure = any(address.startswith("https:") for address in repositories)
    if not is_secure or VARIABLE in os.environ or not os.access(folder / "authority.key", os.R_OK):
        return
    from somrs.trust.authority import Authority  # as above

    os.environ[VARIABLE] = str(ProgramCertificates(Authority(folder), host, "").of_simulator())


class ProgramCertificates:
    """Gives the programs of a system at this host certificates of an authority, which is made for this site if there is none.

    `neighbours`: those whose certificates count at the system.
    """

    def __init__(self, authority: Authority, host: str, site: str, neighbours: tuple[TrustedNeighbour, ...] = ()) -> None:
        self._authority, self._site, self._hosts = authority, site, tuple(dict.fromkeys((host, "127.0.0.1", "localhost")))
        self._host, self._neighbours = host, neighbours
        self._identities: dict[str, Identity] = {}
        self._renewed_at = time.monotonic()

    @property
    def folder(self) -> Path:
        return self._authority.folder

    def prepare(self) -> None:
        """Make the authority, if there is none, and the certificate of clients.

        Raises UsageError for neighbours that cannot be told apart.
        """
        self._issue(Identity(name=CLIENT, roles=frozenset({Role.CLIENT})))
        self._authority.list_holders()
        self._authority.trust_neighbours(self._neighbours, (self._host,))

    def of_bus(self) -> Credentials:
        """With what the system itself uses its bus: it has all rights there."""
        return Credentials(self._issue(Identity(name="bus", roles=frozenset({Role.BUS}))))

    def of_devices(self, name: str, further: Iterable[str], topics: Iterable[str] = ()) -> Path:
        """The file of the certificate of a process of devices that is not one of the system's own programs."""
        return self._issue(Identity(name=name, roles=frozenset({Role.DEVICE}), speaks_for=frozenset(further), topics=frozenset(topics)))

    def of_simulator(self) -> Path:
        """The file of the certificate of a simulator that is not one of the system's own programs."""
        return self._issue(Identity(name="simulator", roles=frozenset({Role.TRAFFIC})))

    def environment(self, name: str, arguments: Sequence[str]) -> dict[str, str]:
        """What a program needs to prove who it is. A process of devices speaks for each of them: `NAME=DRIVER` of its arguments. An adapter
        uses all topics of MQTT at the bus."""
        role = _ROLES.get(arguments[1], Role.VIEWER)
        devices = [argument.partition("=")[0] for argument in arguments if "=" in argument] if role is Role.DEVICE else []
        topics = frozenset({EVERYTHING} if arguments[1] == "adapter" else ())
        identity = Identity(name=name, roles=frozenset({role}), speaks_for=frozenset(devices), topics=topics)
        return {VARIABLE: str(self._issue(identity))}

    def renew(self) -> None:
        """Renew what is due. Programs go on with their new certificates by themselves."""
        if time.monotonic() - self._renewed_at >= RENEWAL_PAUSE:
            self._renewed_at = time.monotonic()
            for identity in [*self._identities.values()]:
                self._issue(identity)

    def _issue(self, identity: Identity) -> Path:
        if not self._authority.exists:
            self._authority.create(self._site, datetime.now(UTC))
        self._identities[identity.name] = identity
        return self._authority.issue_program(identity, self._hosts, datetime.now(UTC))[0]
