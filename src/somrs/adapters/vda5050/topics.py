"""The topics of vehicles: `interfaceName/majorVersion/manufacturer/serialNumber/topic` (2.1, 6.3)."""

from __future__ import annotations

from msgspec import Struct

from somrs.adapters.vda5050.messages.header import Header, Topic, Version, timestamp_of

PARTS = 5

NAMES = frozenset(topic.value for topic in Topic)


class VehicleAddress(Struct, frozen=True, kw_only=True):
    """What tells a vehicle from all others. `major`: the major version, 2 or 3."""

    interface: str
    major: int
    manufacturer: str
    serial_number: str

    def topic(self, topic: Topic) -> str:
        return f"{self.interface}/v{self.major}/{self.manufacturer}/{self.serial_number}/{topic}"

    def __str__(self) -> str:
        return f"{self.manufacturer} {self.serial_number}"


def read_topic(text: str) -> tuple[VehicleAddress, Topic] | None:
    """The vehicle and the topic of an MQTT topic; None if it is of something else. An interface may have several levels."""
    parts = text.split("/")
    if len(parts) < PARTS or parts[-4] not in ("v2", "v3") or parts[-1] not in NAMES:
        return None
    address = VehicleAddress(interface="/".join(parts[:-4]), major=int(parts[-4][1:]), manufacturer=parts[-3], serial_number=parts[-2])
    return address, Topic(parts[-1])


class HeaderWriter:
    """Writes the headers of the messages to or from a vehicle, with a counter for each topic."""

    def __init__(self, address: VehicleAddress) -> None:
        self._address = address
        self._counters: dict[Topic, int] = {}

    def header(self, topic: Topic, version: Version, now: float) -> Header:
        """The header of the next message of a topic. `now`: in seconds since 1970."""
        count = self._counters.get(topic, 0)
        self._counters[topic] = (count + 1) % 2**32
        return Header(
            header_id=count,
            timestamp=timestamp_of(now),
            version=version.value,
            manufacturer=self._address.manufacturer,
            serial_number=self._address.serial_number,
        )
