"""The latest arrivals and departures of devices."""

from __future__ import annotations

from somrs.client.client import Client
from somrs.protocol.messages.directory import PresenceChange


class ServicePresence:
    """The Registry's log of arrivals and departures, newest first."""

    def __init__(self) -> None:
        self.log: tuple[PresenceChange, ...] = ()
        self._version: int | None = None

    async def read(self, client: Client, version: int) -> None:
        """Read the log, unless it was read when the Registry's offers had this version."""
        if version != self._version:
            self.log = await client.presence()
            self._version = version

    def last_departure(self, device: str) -> PresenceChange | None:
        """The latest departure of the device; None if the log has none."""
        return next((change for change in self.log if change.device == device and not change.joined), None)

    def last_arrival(self, device: str) -> PresenceChange | None:
        return next((change for change in self.log if change.device == device and change.joined), None)
