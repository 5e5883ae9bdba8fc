"""What every part of the desk works with: the system's addresses and data, its replica of the map, and the news."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from somrs.api.listener import Listener
from somrs.client.client import Addresses, Client
from somrs.client.hub import Hub
from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology


@dataclass(frozen=True, slots=True, kw_only=True)
class Context:
    """`data`: the folder of the running system."""

    addresses: Addresses
    data: Path
    client: Client
    listener: Listener
    hub: Hub

    @property
    def map(self) -> Map:
        """The map as it is now, as far as is known here."""
        return self.listener.replica.map

    @property
    def ontology(self) -> Ontology:
        return self.listener.replica.ontology

    @property
    def version(self) -> int:
        """Of the map and the ontology; -1 while they were not read."""
        return self.listener.replica.version
