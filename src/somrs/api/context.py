"""What all parts of the API service share: the system's addresses and data folder, the replica of the map, and the news."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from somrs.api.listener import Listener
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.client.hub import Hub
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology


@dataclass(frozen=True, slots=True, kw_only=True)
class Context:
    """What all parts of the API service share. `data`: the data folder of the running system."""

    addresses: Addresses
    data: Path
    client: Client
    listener: Listener
    hub: Hub

    @property
    def map(self) -> Map:
        """The current map, according to the replica."""
        return self.listener.replica.map

    @property
    def ontology(self) -> Ontology:
        return self.listener.replica.ontology

    @property
    def version(self) -> int:
        """The version of the map and the ontology; -1 until they have been read."""
        return self.listener.replica.version
