"""A link to the simulator of a running system, for people's programs."""

from __future__ import annotations

from somrs.client.addresses import Addresses
from somrs.client.credentials import credentials_for
from somrs.devices.simulator.link.link import OperatorLink
from somrs.errors import RemoteError


def operator_link(addresses: Addresses) -> OperatorLink:
    """A link that is not connected yet, with the certificate of this program or of the data folder. Raises RemoteError without a
    simulator."""
    if addresses.simulator is None:
        raise RemoteError("this system has no simulator")
    return OperatorLink.at(addresses.simulator, credentials_for(addresses))
