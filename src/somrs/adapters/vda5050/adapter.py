"""The adapter for vehicles with VDA 5050: one connection to the broker, and a device for each vehicle that is heard."""

from __future__ import annotations

import asyncio
import itertools
import logging
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from somrs.adapters.adapter import Fleet
from somrs.adapters.vda5050.control.exchange import Tick
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.mqtt import Connection, Message, broker_address
from somrs.adapters.vda5050.robot import DrivenVda5050Vehicle, Vda5050Vehicle
from somrs.adapters.vda5050.session import VehicleSession
from somrs.adapters.vda5050.settings import read_settings
from somrs.adapters.vda5050.simulated.link_body import serve_simulated
from somrs.adapters.vda5050.topics import VehicleAddress, read_topic
from somrs.adapters.vda5050.zoning.site import ZoneCatalogue
from somrs.entish.parse import nearest
from somrs.errors import Mistake, SettingsError, UsageError
from somrs.ontology.types import ROOT
from somrs.sites.references import Site
from somrs.space.storeys import storey_heights

log = logging.getLogger(__name__)

FROM_VEHICLES = {Topic.CONNECTION: 1, Topic.STATE: 0, Topic.FACTSHEET: 0, Topic.VISUALIZATION: 0}
"""The topics on which vehicles publish, and the quality of service of each (2.1, 6.2)."""

VERSIONS = {"2.0": Version.V2_0, "2.1": Version.V2_1, "3.0": Version.V3_0}
"""As settings name them."""

TICK = 1.0
"""Seconds between two looks at what has to be sent again."""

FACTSHEET_TICKS = 10
"""Looks after which a vehicle that has sent a state and no factsheet is taken for one that only drives."""


ABSENT_TICKS = 6
"""Looks after which people are told why a vehicle that the settings name is not there."""


class Vda5050Adapter:
    """Fleet control of all vehicles at a broker."""

    def __init__(self, settings: Mapping[str, Any], folder: Path) -> None:
        self._settings = read_settings(settings)
        try:
            self._address = broker_address(self._settings.broker, self._settings.certificates, folder)
        except UsageError as error:
            raise SettingsError("vda5050", [(("broker",), str(error))]) from None
        self._frames, self._catalogue = self._settings.frames({}), ZoneCatalogue(self._settings.zones)
        self.sessions: dict[VehicleAddress, VehicleSession] = {}
        """All vehicles that were heard, and the addresses at which those may be that the settings name."""
        self._waited: dict[VehicleAddress, int] = {}
        self._owners: dict[str, tuple[str, str]] = {}
        """Manufacturer and serial number of the vehicles that have devices, by name."""
        self._connection: Connection | None = None
        self._has_broker = False
        self._absences: dict[str, str] = {}
        """What was said of the vehicles that the settings name, and that are not there."""

    @property
    def names(self) -> Collection[str]:
        return self._settings.vehicles.keys()

    def misfits(self, site: Site) -> Iterable[Mistake]:
        """Robots, zones and floors that the map of the site does not have, and maps that may be those of any of its storeys."""
        yield from site.named("vehicles", self._settings.vehicles, "MobileRobot")
        yield from site.named("zoneActions", self._settings.zone_actions, ROOT)
        named = {*site.map.objects, *site.ontology.types}
        for name in self._settings.station_types:
            if name not in named:
                hint = nearest(name, named) or "name those at which vehicles pick and drop"
                yield ("stationTypes", name), f"there is no object and no type {name}; {hint}"
        storeys = storey_heights(site.map, site.ontology)
        for map_id in self._settings.floorless(storeys):
            heights = ", ".join(f"{storey} at {height:g} m" for storey, height in storeys.items())
            yield ("maps", map_id), f"give the `level` of its floor, in metres: the building has several storeys, {heights}"
        for map_id, frame in self._settings.maps.items():
            if frame.level is not None:
                yield from site.level(("maps", map_id, "level"), frame.level)

    @property
    def simulated(self) -> Collection[str]:
        return [name for name, vehicle in self._settings.vehicles.items() if vehicle.simulated is not None]

    async def simulate(self, simulator: str, storeys: Mapping[str, float]) -> None:
        vehicles = {name: vehicle for name, vehicle in self._settings.vehicles.items() if vehicle.simulated is not None}
        robots = {name: (self._settings.address(vehicle), VERSIONS[vehicle.simulated or ""]) for name, vehicle in vehicles.items()}
        levels = {frame.map_id: frame.level for frame in self._settings.frames(storeys).all if frame.level is not None}
        await serve_simulated(robots, simulator, self._address, levels)

    async def run(self, fleet: Fleet) -> None:
        self._frames = self._settings.frames(await fleet.storeys())
        topics = [
            (f"{interface}/{major}/+/+/{topic}", quality)
            for interface in self._settings.interfaces
            for major in ("v2", "v3")
            for topic, quality in FROM_VEHICLES.items()
        ]
        self._connection = Connection(self._address, topics, self._receive, self._notice_broker)
        async with asyncio.TaskGroup() as group:
            group.create_task(self._connection.run())
            group.create_task(self._tick(fleet))

    async def _tick(self, fleet: Fleet) -> None:
        for tick in itertools.count():
            await asyncio.sleep(TICK)
            if tick >= ABSENT_TICKS:
                self._report_absences(fleet)
            for session in [*self.sessions.values()]:
                session.give(Tick())
                self._add_when_known(fleet, session)

    def _report_absences(self, fleet: Fleet) -> None:
        """Say why vehicles that the settings name have no devices yet."""
        for name in self._settings.vehicles.keys() - self._owners.keys():
            absence = self._absence(name)
            if absence != self._absences.get(name):
                self._absences[name] = absence
                fleet.report_problem(name, absence)

    def _absence(self, name: str) -> str:
        sessions = [session for session in self.sessions.values() if self._settings.name(session.address) == name]
        if not self._has_broker:
            return "cannot be reached: its broker is not there"
        vehicle = next((session.control.vehicle for session in sessions if session.control.vehicle.was_heard), None)
        if vehicle is None:
            return f"cannot be reached: its broker is there, and nothing has come of {sessions[0].address if sessions else name}"
        return f"cannot drive: {vehicle.hindrance}" if vehicle.hindrance is not None else "has not said yet where it is, and what it can do"

    def _receive(self, text: str, payload: bytes) -> None:
        addressed = read_topic(text)
        if addressed is None:
            return
        address, topic = addressed
        if address in self.sessions or self._settings.name(address) is not None:
            self._session(address).receive(topic, payload)

    def _session(self, address: VehicleAddress) -> VehicleSession:
        session = self.sessions.get(address)
        if session is None:
            session = self.sessions[address] = VehicleSession(address, self._frames, self._send, self._settings.policy)
            self._waited[address] = 0
        return session

    def _send(self, topic: str, payload: bytes) -> None:
        if self._connection is not None:
            self._connection.publish(Message(topic=topic, payload=payload))

    def _notice_broker(self, is_connected: bool) -> None:
        """Without the broker, no vehicle can be reached. With it, each says that it is there; those that the settings name are asked."""
        self._has_broker = is_connected
        if is_connected:
            for address in self._settings.addresses:
                self._session(address)
        for session in self.sessions.values():
            session.notice_broker(is_connected=is_connected)

    def _add_when_known(self, fleet: Fleet, session: VehicleSession) -> None:
        """Add a device when it is known where the vehicle is, and what it can do."""
        waited = self._waited.get(session.address)
        vehicle = session.control.vehicle
        if waited is None or vehicle.pose is None:
            return
        self._waited[session.address] = waited + 1
        name = self._settings.name(session.address)
        assert name is not None, "others have no session"
        identity = session.address.manufacturer, session.address.serial_number
        if self._owners.setdefault(name, identity) != identity:
            del self._waited[session.address]
            log.warning("%s would be %s, as %s %s is: name it in the settings", session.address, name, *self._owners[name])
            return
        named = self._settings.vehicles.get(name)
        actions = named.actions if named is not None else None
        if actions is None and vehicle.factsheet is not None:
            actions = tuple(action.action_type for action in vehicle.factsheet.protocol_features.mobile_robot_actions)
        if actions is None:
            if waited < FACTSHEET_TICKS:
                return
            log.warning("%s: has sent no factsheet, so that it only drives: give its `actions` in the settings", session.address)
            actions = ()
        del self._waited[session.address]
        kind = Vda5050Vehicle if {"pick", "drop"} <= set(actions) else DrivenVda5050Vehicle
        log.info("%s is %s", session.address, name)
        fleet.add(kind(name, session, self._settings, frozenset(actions), self._catalogue))
