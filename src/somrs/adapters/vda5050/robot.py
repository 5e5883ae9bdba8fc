"""A vehicle with VDA 5050 as a device: it drives where traffic lets it, picks and drops loads, and charges."""

from __future__ import annotations

import asyncio
import contextlib

from somrs.adapters.vda5050.control.exchange import (
    ActionEnded,
    Broken,
    BuildingChanged,
    Charge,
    Charged,
    Delayed,
    Effect,
    Follow,
    GaveUp,
    Halt,
    Halted,
    Loaded,
    Located,
    Passed,
    Pause,
    Perform,
    Reachable,
    Remarked,
    Resume,
)
from somrs.adapters.vda5050.messages.factsheets import Factsheet
from somrs.adapters.vda5050.messages.orders import ActionParameter
from somrs.adapters.vda5050.session import VehicleSession
from somrs.adapters.vda5050.settings import Settings
from somrs.adapters.vda5050.zoning.site import SiteZone, ZoneCatalogue
from somrs.devices.road_robot import CarryingRobot, Motion, RobotFailed, Way
from somrs.errors import RemoteError
from somrs.ontology.types import Value

FLOOR = "floor"
"""The type of the stations of vehicles that drop loads on any floor (2.1, table 5: "floor location")."""
LOOK = 2.0
"""Seconds between two looks at whether the zones of the site have changed."""


class Vda5050Vehicle(CarryingRobot):
    """A vehicle that carries loads. `actions`: what it can do, of `pick`, `drop` and `startCharging`. `catalogue`: makes the zones of the
    site."""

    type = "MobileManipulator"

    def __init__(
        self, name: str, session: VehicleSession, settings: Settings, actions: frozenset[str], catalogue: ZoneCatalogue | None = None
    ) -> None:
        super().__init__(name)
        self.session, self.settings, self._catalogue = session, settings, catalogue or ZoneCatalogue()
        self.can_carry = {"pick", "drop"} <= actions
        self.can_charge = "startCharging" in actions
        state = session.control.vehicle.state
        self.battery = session.control.vehicle.charge(state) if state is not None else None
        self.values = described(session)
        self._ended: asyncio.Future[str | None] | None = None
        self._halts: list[asyncio.Future[None]] = []

    async def open(self) -> None:
        self.session.on_effect = self._take_effect
        state = self.session.control.vehicle.state
        self.carries = bool(state.loads) if state is not None and state.loads is not None else None
        self.heard(self.session.control.vehicle.is_connected)
        asyncio.get_running_loop().call_soon(self._say_how_it_is)  # after `open` has begun, which waits for it
        await super().open()
        self.keep_doing(self._follow_zones())

    async def _follow_zones(self) -> None:
        """Tell the vehicle the zones of the site, as they are on the map."""
        zones: tuple[SiteZone, ...] | None = None
        while True:
            with contextlib.suppress(RemoteError):
                map, ontology = await self.whole_map(is_current=False)
                if (current_zones := self._catalogue.zones(map, ontology)) is not zones:
                    zones = current_zones
                    self.session.give(BuildingChanged(zones=zones))
            await asyncio.sleep(LOOK)

    def _say_how_it_is(self) -> None:
        vehicle = self.session.control.vehicle
        if vehicle.hindrance is not None:
            self._take_effect(Broken(reason=vehicle.hindrance))
        self._take_effect(Delayed(reason=vehicle.delay))
        self._take_effect(Remarked(text=vehicle.remark))
        if vehicle.pose is not None:
            self._take_effect(Located(pose=vehicle.pose))

    @property
    def motion(self) -> Motion:
        factsheet = self.session.control.vehicle.factsheet
        return _motion(factsheet) if factsheet is not None else Motion(rounds_corners=True)

    # What traffic and the services tell the vehicle

    async def follow(self, way: Way) -> None:
        self.session.give(Follow(way=way))

    async def halt(self) -> None:
        halted: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._halts.append(halted)
        self.session.give(Halt())
        await halted

    async def pause(self) -> None:
        self.session.give(Pause())

    async def resume(self) -> None:
        self.session.give(Resume())

    async def interrupt(self) -> None:
        await self.halt()

    async def pick(self, thing: str, support: str) -> None:
        await self._perform(Perform(action_type="pick", parameters=self._parameters("pick", thing, support)))

    async def drop(self, thing: str, support: str) -> None:
        await self._perform(Perform(action_type="drop", parameters=self._parameters("drop", thing, support)))

    async def put_down(self, thing: str) -> tuple[float, float, float, str]:
        if self.settings.station_type != FLOOR:
            raise RobotFailed(f"{self.name} drops loads at stations of the type {self.settings.station_type} only")
        await self.drop(thing, "")
        pose = self.session.control.vehicle.pose
        assert pose is not None, "a vehicle in traffic has said where it is"
        return pose.x, pose.y, self.road.level, ""

    async def charge_at(self, charger: str) -> None:
        await self._perform(Charge())

    async def _perform(self, command: Perform | Charge) -> None:
        """Have an action performed. Raises RobotFailed with the words of the vehicle."""
        ended: asyncio.Future[str | None] = asyncio.get_running_loop().create_future()
        self._ended = ended
        self.session.give(command)
        try:
            failure = await ended
        except asyncio.CancelledError:
            if not self.session.control.vehicle.is_connected:
                self.session.give(Halt())  # it learns when it is there again that nobody wants this any more
            raise
        if failure is not None:
            raise RobotFailed(f"{self.name} gave up: {failure}")

    def _parameters(self, action_type: str, thing: str, support: str) -> tuple[ActionParameter, ...]:
        """The parameters of pick and drop (3.0, table 4): of those that the factsheet lists, or of all if it lists none."""
        factsheet = self.session.control.vehicle.factsheet
        load_sets = factsheet.load_specification.load_sets if factsheet is not None else None
        load_type = self.settings.load_type or (load_sets[0].load_type if load_sets else "DEFAULT")
        station = {"stationName": support} if support else {}
        values = {"stationType": self.settings.station_type, **station, "loadType": load_type, "loadId": thing}
        supported = factsheet.action(action_type) if factsheet is not None else None
        listed = supported.action_parameters if supported is not None else None
        keys = {parameter.key for parameter in listed} if listed else values.keys()
        return tuple(ActionParameter(key=key, value=value) for key, value in values.items() if key in keys)

    # What the vehicle says

    def _take_effect(self, effect: Effect) -> None:
        match effect:
            case Located(pose=pose):
                self.located(pose.x, pose.y, pose.yaw, pose.level)
            case Passed(number=number):
                self.passed(number)
            case GaveUp(description=description):
                self.gave_up(f"{self.name} does not drive on: {description}")
            case Broken(reason=reason):
                self.broken(reason)
            case Reachable(is_connected=is_connected):
                self.heard(is_connected)
            case Charged(level=level):
                self.battery = level
            case Loaded(count=count):
                self.carries = count > 0
            case Delayed(reason=reason):
                self.hindrance = f"{self.name} {reason}" if reason is not None else None
                self.road.renew_state()  # a silent vehicle sends none
            case Remarked(text=text):
                self.remark = text
            case ActionEnded(failure=failure) if self._ended is not None and not self._ended.done():
                self._ended.set_result(failure)
            case Halted():
                for halted in self._halts:
                    if not halted.done():
                        halted.set_result(None)
                self._halts = []


class DrivenVda5050Vehicle(Vda5050Vehicle):
    """A vehicle that only drives."""

    type = "MobileRobot"


def described(session: VehicleSession) -> dict[str, Value]:
    """The attributes of a vehicle that is not on the map yet: where it is, and what its factsheet says."""
    vehicle = session.control.vehicle
    values: dict[str, Value] = {}
    if vehicle.pose is not None:
        values |= {"PositionX": vehicle.pose.x, "PositionY": vehicle.pose.y, "RotationZ": vehicle.pose.yaw}
        values |= {"PositionZ": vehicle.pose.level} if vehicle.pose.level is not None else {}
    if vehicle.factsheet is not None:
        values |= _measures(vehicle.factsheet)
    return values


def _motion(factsheet: Factsheet) -> Motion:
    """How a vehicle moves by its factsheet; what that leaves open, or has as 0, as most vehicles do."""
    physical, usual = factsheet.physical_parameters, Motion()
    load_sets = factsheet.load_specification.load_sets if factsheet.load_specification is not None else None
    times = [(load.pick_time or 0.0) + (load.drop_time or 0.0) for load in load_sets or ()]
    ramps = [ramp for ramp in (physical.maximum_acceleration, abs(physical.maximum_deceleration)) if ramp > 0]
    return Motion(
        speed=physical.maximum_speed if physical.maximum_speed > 0 else None,
        acceleration=min(ramps, default=usual.acceleration),
        turning=physical.maximum_angular_speed or usual.turning,
        handling=max(times, default=0.0) or usual.handling,
        rounds_corners=True,
    )


def _measures(factsheet: Factsheet) -> dict[str, Value]:
    """Traffic takes robots for discs: around the length and the width."""
    physical, payload = factsheet.physical_parameters, factsheet.type_specification.maximum_load_mass
    measures: dict[str, Value] = {}
    if physical.length > 0 and physical.width > 0 and physical.maximum_height > 0:
        radius = round(((physical.length**2 + physical.width**2) ** 0.5) / 2, 3)
        measures |= {"Shape.Form": "Cylinder", "Shape.Radius": radius, "Shape.Height": physical.maximum_height}
    if physical.maximum_speed > 0:
        measures["Speed"] = physical.maximum_speed
    if payload > 0:
        measures["Payload"] = payload
    return measures
