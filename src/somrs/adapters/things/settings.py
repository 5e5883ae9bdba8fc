"""The settings of the adapter, as a site file has them under `adapters:` `things:`."""

from __future__ import annotations

from pydantic import Field

from somrs.adapters.things.mapping import Certificates, ConnectionEntry
from somrs.ontology.files.documents import Entry


class HomeAssistantEntry(Entry):
    """A broker at which things announce themselves as Home Assistant expects it."""

    connection: str
    prefix: str = Field(default="homeassistant", description="The discovery prefix")


class Settings(Entry):
    """The settings of the adapter. Paths are relative to the site file."""

    gateway: str = Field(default="Gateway", description="The name on the map of the device that reports what things say")
    mappings: list[str] = Field(default=[], description="Mapping files")
    uses: list[str] = Field(default=[], description="Files with definitions that are used besides")
    broker: str | None = Field(
        default=None,
        description="The address of a broker, as the connection `broker`; own, or own HOST:PORT: one that is started; bus: that of the bus",
    )
    certificates: Certificates = Field(default=Certificates(), description="With which TLS is used at that broker")
    connections: dict[str, ConnectionEntry] = {}
    simulated: dict[str, dict[str, float]] = Field(
        default={},
        description="Doors and lifts of the simulator with a session; of a lift, the heights of its levels, m: {Lift1: {G: 0, U: 4}}",
    )
    home_assistant: list[HomeAssistantEntry] = []
    descriptions: list[str] = Field(default=[], description="Thing Descriptions: files, or addresses with http:// or https://")
