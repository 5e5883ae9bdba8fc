"""A vehicle with VDA 5050 as a device: it drives where traffic lets it, picks and drops loads, and charges."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Sequence

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
from somrs.adapters.vda5050.control.listener import LARGEST
from somrs.adapters.vda5050.messages.factsheets import Factsheet
from somrs.adapters.vda5050.messages.orders import ActionParameter
from somrs.adapters.vda5050.session import VehicleSession
from somrs.adapters.vda5050.settings import Settings
from somrs.adapters.vda5050.stations import FLOOR, Handled, StationTypes, lifting_problem, parameters_of
from somrs.adapters.vda5050.zoning.site import SiteZone, ZoneCatalogue
from somrs.devices.road_robot import CarryingRobot, Motion, RobotFailed, Way
from somrs.devices.simulator.drivers.manipulator import read_spot
from somrs.errors import RemoteError
from somrs.ontology.types import Value
from somrs.service_manager.sdk.device import Task
from somrs.service_manager.sdk.orders import Refusal
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import Point

FASTEST = 50.0
"""No vehicle has this speed, m/s."""
LOOK = 2.0
"""Seconds between two looks at whether the zones of the site have changed."""


class Vda5050Vehicle(CarryingRobot, replaces=("legs",)):
    """A vehicle that carries loads. `actions`: what it can do, of `pick`, `drop` and `startCharging`. `catalogue`: makes the zones of the
    site."""

    type = "MobileManipulator"

    def __init__(
        self, name: str, session: VehicleSession, settings: Settings, actions: frozenset[str], catalogue: ZoneCatalogue | None = None
    ) -> None:
        super().__init__(name)
        self.session, self.settings, self._catalogue = session, settings, catalogue or ZoneCatalogue()
        self._stations = StationTypes(default=settings.station_type, words=settings.station_types)
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
        self.heard(self.session.control.vehicle.is_commanded, self.session.control.vehicle.absence)
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
        height = self._height_of(thing)
        self._check_height(height)
        await self._perform(Perform(action_type="pick", parameters=await self._parameters("pick", thing, support, height)))

    async def drop(self, thing: str, support: str) -> None:
        height = self._height_on(support)
        self._check_height(height)
        await self._perform(Perform(action_type="drop", parameters=await self._parameters("drop", thing, support, height)))

    async def put_down(self, thing: str) -> tuple[float, float, float, str]:
        if (station_type := self._stations.word("", ())) != FLOOR:
            raise RobotFailed(f"{self.name} drops loads at stations of the type {station_type} only")
        x, y = self._load_point()
        if (support := self.building.support_at((x, y), self.road.level)) is not None:
            raise RobotFailed(f"{self.name} carries {thing} before {support}, and would not know whether it ends up on it or beside it")
        await self.drop(thing, "")
        return x, y, self.road.level, ""

    def _load_point(self) -> Point:
        """Where the vehicle carries its load, on the map."""
        pose, (ahead, aside) = self.session.control.vehicle.pose, self._load_offset()
        assert pose is not None, "a vehicle in traffic has said where it is"
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        return pose.x + cos * ahead - sin * aside, pose.y + sin * ahead + cos * aside

    def _load_offset(self) -> tuple[float, float]:
        """How far before its middle, and to the left of it, the vehicle carries its load, m: as its state says, or at its middle."""
        state = self.session.control.vehicle.state
        references = (load.bounding_box_reference for load in (state.loads if state is not None else None) or ())
        return next(((reference.x, reference.y) for reference in references if reference is not None), (0.0, 0.0))

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
            if not self.session.control.vehicle.is_commanded:
                self.session.give(Halt())  # it learns when it is there again that nobody wants this any more
            raise
        if failure is not None:
            raise RobotFailed(f"{self.name} gave up: {failure}")

    async def legs(self, task: Task) -> tuple[float, float]:
        """As of all robots. Raises Refusal also when the vehicle does not handle loads as high as it would have to."""
        legs = await super().legs(task)
        thing = str(task.inputs["Object"])
        support = read_spot(thing, task.precondition).support
        heights = [self._height_on(support) if support is not None else self._height_of(thing)]
        heights += [self._height_on(str(task.inputs["Destination"]))] if "Destination" in task.inputs else []
        for height in heights:
            if (problem := self._lifting_problem(height)) is not None:
                raise Refusal(problem)
        return legs

    def _check_height(self, height: float | None) -> None:
        """Raise RobotFailed if the vehicle does not handle loads at a height."""
        if (problem := self._lifting_problem(height)) is not None:
            raise RobotFailed(problem)

    def _lifting_problem(self, height: float | None) -> str | None:
        factsheet = self.session.control.vehicle.factsheet
        problem = lifting_problem(height, self.settings.load_type, factsheet) if height is not None else None
        return f"{self.name} {problem}" if problem is not None else None

    def _height_of(self, thing: str) -> float | None:
        """The height of the underside of a thing over its floor, m; None: the map does not say it."""
        building = self.building
        return self._over_floor(building.pose(thing)[2]) if thing in building.solids or thing in building.noted else None

    def _height_on(self, support: str) -> float | None:
        """The height over its floor at which things stand on an object, m; on the floor itself for none."""
        if not support:
            return 0.0
        return self._over_floor(self.building.top_of(support)) if support in self.building.solids else None

    def _over_floor(self, height: float) -> float:
        """The height over the floor below it, of a height on the map, m."""
        return height - max((level for level in self.building.ways().levels if level < height + SAME_FLOOR), default=0.0)

    async def _parameters(self, action_type: str, thing: str, support: str, height: float | None) -> tuple[ActionParameter, ...]:
        """The parameters of pick and drop, of a thing at a height over the floor, m."""
        vehicle = self.session.control.vehicle
        handled = Handled(
            action_type=action_type,
            thing=thing,
            station=support,
            station_type=self._stations.word(support, await self._types_of(support)),
            load_type=self.settings.load_type,
            height=height,
            loads=(vehicle.state.loads if vehicle.state is not None else None) or (),
        )
        return parameters_of(handled, vehicle.factsheet)

    async def _types_of(self, support: str) -> Sequence[str]:
        """The type of an object on the map, its parent, and so on; none if the map does not have it."""
        with contextlib.suppress(RemoteError):
            map, ontology = await self.whole_map(is_current=False)
            return ontology.ancestors(map.objects[support].type) if support in map.objects else ()
        return ()

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
                self.heard(is_connected, self.session.control.vehicle.absence)
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
        speed=physical.maximum_speed if 0 < physical.maximum_speed < FASTEST else None,
        acceleration=min(ramps, default=usual.acceleration),
        turning=physical.maximum_angular_speed or usual.turning,
        handling=max(times, default=0.0) or usual.handling,
        rounds_corners=True,
    )


def _measures(factsheet: Factsheet) -> dict[str, Value]:
    """Traffic takes robots for discs: around the length and the width."""
    physical, payload = factsheet.physical_parameters, factsheet.type_specification.maximum_load_mass
    measures: dict[str, Value] = {}
    if all(0 < size < LARGEST for size in (physical.length, physical.width, physical.maximum_height)):
        radius = round(math.hypot(physical.length, physical.width) / 2, 3)
        measures |= {"Shape.Form": "Cylinder", "Shape.Radius": radius, "Shape.Height": physical.maximum_height}
    if 0 < physical.maximum_speed < FASTEST:
        measures["Speed"] = physical.maximum_speed
    if payload > 0:
        measures["Payload"] = payload
    return measures
