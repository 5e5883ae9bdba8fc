"""The settings of the adapter in a site file: `adapters: vda5050:`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, Strict
from pydantic.alias_generators import to_camel

from somrs.adapters.settings import valid_settings
from somrs.adapters.vda5050.control.policy import Policy
from somrs.adapters.vda5050.control.provision import MapPackage
from somrs.adapters.vda5050.frames import Frame, Frames
from somrs.adapters.vda5050.messages.orders import ActionParameter, BlockingType, ZoneAction
from somrs.adapters.vda5050.mqtt import Certificates
from somrs.adapters.vda5050.topics import VehicleAddress
from somrs.adapters.vda5050.zoning.site import ZoneActions
from somrs.errors import Mistake
from somrs.ontology.files.documents import Entry, Listed, WholeNumber

VERSION = re.compile(r"v\d+")
"""A level of a topic with a version."""

SHORTEST_REST = 10.0
"""Seconds without anything to do, after which vehicles may hibernate at the earliest."""

MAKER = "SOMRS"
"""The manufacturer of simulated vehicles."""


class _CamelEntry(Entry):
    """An entry whose keys are written as VDA 5050 writes its own."""

    model_config = ConfigDict(alias_generator=to_camel)


class VehicleSettings(_CamelEntry):
    """A vehicle. `actions`: what it can do, if it sends no factsheet, such as `[pick, drop, startCharging]`. `simulated`: the version
    that a robot of the simulator with its name speaks, such as `"2.1"`; its serial number is its name."""

    manufacturer: str = MAKER
    serial_number: str = ""
    actions: Listed[str] | None = None
    simulated: Literal["2.0", "2.1", "3.0"] | None = Field(default=None)


class MapSettings(Entry):
    """A map of the vehicles. `level`: the height of its floor in metres. `at`: where its origin lies on the map of the site, in metres.
    `turned`: how it is turned there, in degrees, counterclockwise. `version`: the one that vehicles are to have; None: any. `link`: from
    where they download it. `hash`: of the file."""

    level: float | None = Field(default=None, json_schema_extra={"unit": "m"})
    at: Annotated[tuple[float, float], Strict(False)] = Field(default=(0.0, 0.0), examples=["[12.5, 3]"])
    turned: float = Field(default=0.0, json_schema_extra={"unit": "degrees"})
    version: str | None = None
    link: str | None = None
    hash: str | None = None


class ZoneActionSettings(_CamelEntry):
    """An action in a zone, with its parameters by key."""

    action_type: str
    blocking_type: Literal["NONE", "SINGLE", "SOFT", "HARD"] = "NONE"
    parameters: dict[str, str | float | bool] = {}

    @property
    def action(self) -> ZoneAction:
        parameters = tuple(ActionParameter(key=key, value=value) for key, value in self.parameters.items())
        return ZoneAction(
            action_type=self.action_type, blocking_type=BlockingType(self.blocking_type), action_parameters=parameters or None
        )


class ActionZoneSettings(Entry):
    """What vehicles do when they enter an area of the map, while they are in it, and when they leave it."""

    entry: Listed[ZoneActionSettings] = ()
    during: Listed[ZoneActionSettings] = ()
    exit: Listed[ZoneActionSettings] = ()

    @property
    def actions(self) -> ZoneActions:
        entry, during, exit_ = (tuple(item.action for item in items) for items in (self.entry, self.during, self.exit))
        return ZoneActions(entry=entry, during=during, exit=exit_)


class Settings(_CamelEntry):
    """`broker`: `mqtt://HOST:PORT` or `mqtts://USER@HOST:PORT`. `interface`: the first levels of the topics. `vehicles`: by their names on
    the map; others are named after manufacturer and serial number, unless `named_only`. `maps`: by mapId. `station_type`, `load_type`:
    parameters of `pick` and `drop`; `station_types`: those of some objects, by name or type. `retries`: how often an action is tried again
    that can be. `hibernate_after`: seconds without anything to do. `zone_actions`: by the names of areas on the map."""

    broker: str = Field(examples=["mqtt://HOST:PORT", "own", "bus"])
    interface: Listed[str] | str = ("uagv", "vda5050")
    certificates: Certificates = Certificates()
    vehicles: dict[str, VehicleSettings] = {}
    named_only: bool = False
    maps: dict[str, MapSettings] = {}
    station_type: str | None = None
    station_types: dict[str, str] = {}
    load_type: str | None = None
    retries: WholeNumber = Field(default=1, ge=0)
    hibernate_after: float | None = Field(default=None, ge=SHORTEST_REST, json_schema_extra={"unit": "s"})
    zone_actions: dict[str, ActionZoneSettings] = {}

    @property
    def zones(self) -> dict[str, ZoneActions]:
        """The actions of areas on the map, by the names of these."""
        return {name: zone.actions for name, zone in self.zone_actions.items()}

    @property
    def interfaces(self) -> tuple[str, ...]:
        return (self.interface,) if isinstance(self.interface, str) else self.interface

    def frames(self, storeys: Mapping[str, float]) -> Frames:
        """Where the maps of the vehicles lie. `storeys`: the heights of those of the site, by name, in metres. Without `maps`, a building
        with several storeys has a map of each, with its name."""
        if not self.maps:
            return Frames([Frame(map_id=storey, level=height) for storey, height in storeys.items()] if has_floors(storeys) else [])
        return Frames(
            [
                Frame(
                    map_id=map_id,
                    x=frame.at[0],
                    y=frame.at[1],
                    yaw=math.radians(frame.turned),
                    level=storeys.get(map_id) if frame.level is None else frame.level,
                )
                for map_id, frame in self.maps.items()
            ]
        )

    def floorless(self, storeys: Mapping[str, float]) -> list[str]:
        """The maps of which nobody knows on which floor they are, in a building with several storeys."""
        if not has_floors(storeys):
            return []
        return [map_id for map_id, frame in self.maps.items() if frame.level is None and map_id not in storeys]

    @property
    def policy(self) -> Policy:
        """What the site wants of each vehicle; it is to have the maps whose versions the settings name."""
        packages = tuple(
            MapPackage(map_id=map_id, version=frame.version, link=frame.link, hash=frame.hash)
            for map_id, frame in self.maps.items()
            if frame.version is not None
        )
        return Policy(packages=packages, retries=self.retries, hibernate_after=self.hibernate_after)

    def address(self, vehicle: VehicleSettings) -> VehicleAddress:
        """The address of a simulated vehicle: below the first interface."""
        assert vehicle.simulated is not None, "others have an address of their own"
        return VehicleAddress(
            interface=self.interfaces[0],
            major=int(vehicle.simulated[0]),
            manufacturer=vehicle.manufacturer,
            serial_number=vehicle.serial_number,
        )

    @property
    def addresses(self) -> list[VehicleAddress]:
        """Where the named vehicles may be: below which interface, and in which version, only a vehicle itself says."""
        simulated = [self.address(vehicle) for vehicle in self.vehicles.values() if vehicle.simulated is not None]
        return simulated + [
            VehicleAddress(interface=interface, major=major, manufacturer=vehicle.manufacturer, serial_number=vehicle.serial_number)
            for vehicle in self.vehicles.values()
            if vehicle.simulated is None
            for interface in self.interfaces
            for major in (2, 3)
        ]

    def name(self, address: VehicleAddress) -> str | None:
        """The name of a vehicle on the map; None if it is not served."""
        for name, vehicle in self.vehicles.items():
            if (vehicle.manufacturer, vehicle.serial_number) == (address.manufacturer, address.serial_number):
                return name
        return None if self.named_only else made_name(address)


def has_floors(storeys: Mapping[str, float]) -> bool:
    """Whether storeys are at several heights."""
    return len({*storeys.values()}) > 1


def made_name(address: VehicleAddress) -> str:
    """A name for a vehicle that the settings do not name, such as `Acme0007` for 0007 of acme."""
    word = "".join(
        character for character in f"{address.manufacturer}{address.serial_number}" if character.isascii() and character.isalnum()
    )
    if not word or not word[0].isalpha():
        word = f"Vehicle{word}"
    return word[0].upper() + word[1:]


def read_settings(settings: Mapping[str, Any]) -> Settings:
    """The settings as they are in the site file. Raises SettingsError with all mistakes."""
    read = valid_settings("vda5050", settings, Settings, _mistakes)
    return read.model_copy(update={"vehicles": {name: _named(name, vehicle) for name, vehicle in read.vehicles.items()}})


def _named(name: str, vehicle: VehicleSettings) -> VehicleSettings:
    """A vehicle with its serial number, which is the name of a simulated one."""
    return vehicle.model_copy(update={"manufacturer": MAKER, "serial_number": name}) if vehicle.simulated is not None else vehicle


def _mistakes(settings: Settings) -> Iterator[Mistake]:
    for interface in settings.interfaces:
        if not interface or any(character in interface for character in "+#$") or interface.strip("/") != interface:
            yield ("interface",), f"{interface!r} cannot begin a topic: write it as the vehicles do, such as uagv"
        elif VERSION.fullmatch(interface.rpartition("/")[2]):
            yield ("interface",), f"{interface!r} ends with the version, which follows by itself: leave it out"
    for name, actions in settings.zones.items():
        if not actions.all:
            yield ("zoneActions", name), "say what vehicles do there: entry: [{actionType: ...}], during, or exit"
    for map_id, frame in settings.maps.items():
        if frame.version is None and (frame.link is not None or frame.hash is not None):
            yield ("maps", map_id), "give the `version` of what is to be downloaded"
    serials: dict[tuple[str, str], str] = {}
    for name, vehicle in settings.vehicles.items():
        if vehicle.simulated is not None:
            continue
        if not vehicle.serial_number:
            yield ("vehicles", name), "give its manufacturer and serialNumber, as they are in its topics"
            continue
        for key, text in (("manufacturer", vehicle.manufacturer), ("serialNumber", vehicle.serial_number)):
            if any(character in text for character in "+#/"):
                yield (
                    ("vehicles", name, key),
                    f"{text!r} has one of + # /, which parts of topics cannot have: write it as in the topics",
                )
        twin = serials.setdefault((vehicle.manufacturer, vehicle.serial_number), name)
        if twin != name:
            yield ("vehicles", name), f"is {vehicle.manufacturer} {vehicle.serial_number}, as {twin} is: give each its own serialNumber"
