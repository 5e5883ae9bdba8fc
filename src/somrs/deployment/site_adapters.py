"""Which programs a system starts for the adapters of its site."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from somrs.errors import InputError, ModelError, UsageError
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.ports import Reservation, host_and_port

if TYPE_CHECKING:
    from somrs.adapters.adapter import Adapter
    from somrs.ontology.files.loaded import AdapterEntry, LoadedModel

PIONEER = "PioneerP3DX"
"""The type of the robots that the simulator drives by ARCOS, if it is to."""


class SiteAdapters:
    """The adapters of a system. `chosen`: settings by name, besides those of the files. `with_arcos`: the Pioneer robots of the map are
    driven by ARCOS."""

    def __init__(self, site: Sequence[Path], data: Path, host: str, chosen: Mapping[str, Mapping[str, Any]], *, with_arcos: bool) -> None:
        self._site, self._data, self._host, self._chosen, self._with_arcos = site, data, host, chosen, with_arcos
        self._entries: Mapping[str, AdapterEntry] | None = None
        """The adapters of the files, when they have been checked."""
        self._adapters: dict[str, Adapter] = {}
        self._labels: dict[str, str] = {}
        self._reservation: Reservation | None = None
        self.needs_broker = False
        """Whether a broker is to be started."""
        self.broker_place = (host, 0)
        """The host and the port at which it listens."""

    def check(self, *, is_fresh: bool) -> None:
        """Read the settings of the files. `is_fresh`: the map will be made of the files, too. Raises ModelError with all mistakes."""
        from somrs.deployment.adapter_checks import adapter_problems
        from somrs.sites.references import Site

        loaded = self._read()
        entries = loaded.adapters if loaded is not None else {}
        site = Site(loaded.map, loaded.ontology) if is_fresh and loaded is not None and loaded.map is not None else None
        merged = {name: replace(entry, settings={**entry.settings, **self._chosen.get(name, {})}) for name, entry in entries.items()}
        problems = adapter_problems(merged, site)
        if problems:
            raise ModelError(problems)
        self._entries = entries

    def _read(self) -> LoadedModel | None:
        """The content of the files; None: there are none, or they cannot be read."""
        from somrs.ontology.files.loading import load

        try:
            return load(self._site) if self._site else None
        except InputError:  # the map of an earlier run needs the files no more; for another one, the Repository says what is wrong
            return None

    def prepare(self, map: Map, ontology: Ontology, mqtt: str | None) -> set[str]:
        """Read the settings, and make what the programs read. Returns the objects of the map that adapters serve. Raises InputError.

        `mqtt`: the URL at which the bus is a broker, if there is one.
        """
        from somrs.deployment.adapters import OWN_BROKER, adapters_of, store_adapters

        chosen = dict(self._chosen)
        pioneers = [name for name, object in sorted(map.objects.items()) if ontology.is_subtype(object.type, PIONEER)]
        if self._with_arcos and pioneers:
            self._reservation = Reservation(self._host, len(pioneers) + 1, self._preferred_ports)
            ports = dict(zip(pioneers, self._reservation.ports[1:], strict=True))
            robots = {name: {"port": f"tcp://{self._host}:{port}", "simulated": True} for name, port in ports.items()}
            chosen["arcos"] = {**chosen.get("arcos", {}), "robots": robots}
        entries = adapters_of(self._file_entries(), chosen)
        broker_places = {place for entry in entries if (place := entry.own_broker()) is not None}
        self.needs_broker = bool(broker_places)
        if self.needs_broker:
            self._place_broker(sorted(broker_places - {""}))
            entries = [entry.with_broker(OWN_BROKER, self.broker) for entry in entries]
        store_adapters(entries, self._data)
        self._labels = {entry.name: entry.label for entry in entries}
        self._adapters = {entry.name: entry.at_bus(mqtt).make() for entry in entries}
        return {name for adapter in self._adapters.values() for name in adapter.names}

    def _file_entries(self) -> Mapping[str, AdapterEntry]:
        if self._entries is not None:
            return self._entries
        loaded = self._read()
        return loaded.adapters if loaded is not None else {}

    @property
    def _preferred_ports(self) -> Sequence[int]:
        """The port of the broker of the last run: things may have it as their setting."""
        from somrs.deployment.mqtt_broker import earlier_port

        port = earlier_port(self._data)
        return [port] if port else []

    def _place_broker(self, places: Sequence[str]) -> None:
        """Choose where the broker listens. `places`: those that settings name. Raises UsageError."""
        if len(places) > 1:
            raise UsageError(f"adapters: broker: own: there is one broker, and not one at {' and one at '.join(places)}; write one of them")
        if places:
            self.broker_place = host_and_port(places[0])
            return
        self._reservation = self._reservation or Reservation(self._host, 1, self._preferred_ports)
        self.broker_place = (self._host, self._reservation.ports[0])
        self._reservation.release(self._reservation.ports[0])

    def misfits(self, map: Map, ontology: Ontology) -> list[str]:
        """What of the settings does not fit the map as it is now, for people."""
        from somrs.deployment.adapter_checks import misfits_of
        from somrs.sites.references import Site

        site = Site(map, ontology)
        return [str(error) for name, adapter in self._adapters.items() if (error := misfits_of(name, adapter, site)) is not None]

    def programs(self) -> Iterator[tuple[str, list[str]]]:
        """The labels of the programs to start, and their arguments: the other ends first."""
        for name, adapter in self._adapters.items():
            if adapter.simulated:
                yield f"{self._labels[name]}-simulated", [name, "--simulated", *(f"{robot}=adapter" for robot in adapter.simulated)]
        for name, adapter in self._adapters.items():
            yield self._labels[name], [name, *(f"{robot}=adapter" for robot in adapter.names)]

    @property
    def broker(self) -> str:
        """The address of the system's own broker; empty if there is none."""
        host, port = self.broker_place
        return f"mqtt://{f'[{host}]' if ':' in host else host}:{port}" if self.needs_broker else ""

    @property
    def ports(self) -> Sequence[int]:
        """The ports that are reserved for these programs."""
        return self._reservation.ports if self._reservation is not None else ()

    def close(self) -> None:
        if self._reservation is not None:
            self._reservation.close()
