"""With what the clients of a system with certificates prove who they are."""

from __future__ import annotations

from pathlib import Path

from somrs.client.addresses import Addresses
from somrs.trust.credentials import FOLDER, Credentials


def credentials_in(data: Path, servers: str) -> Credentials | None:
    """Those of this program; or else, for servers with TLS, those of clients of the system with this data folder, if it has some.

    A folder whose programs have no certificates any more still has the files.
    """
    if (credentials := Credentials.of_environment()) is not None or not servers.startswith(("tls:", "wss:")):
        return credentials
    certificate = data / FOLDER / "programs" / "client.pem"
    return Credentials(certificate) if certificate.exists() else None


def credentials_for(addresses: Addresses) -> Credentials | None:
    """Those of this program; or else those of clients, for who may read the data folder of a system with certificates."""
    if (credentials := Credentials.of_environment()) is not None or addresses.trust is None:
        return credentials
    return Credentials(Path(addresses.trust) / "programs" / "client.pem")
