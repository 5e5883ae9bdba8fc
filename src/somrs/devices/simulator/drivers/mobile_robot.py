"""The common part of the drivers of simulated mobile robots: driving to places, and charging the battery."""

from __future__ import annotations

import math
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterable, Sequence

from somrs.devices.simulator.battery import charging_time
from somrs.devices.simulator.drivers.charging import ChargingRobot, NamedPlace, least_charge
from somrs.devices.simulator.drivers.looking import describe_things, point_at
from somrs.devices.simulator.link.commands import CommandDone, ObjectState, RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.lines import Legs
from somrs.entish.formula import Formula, Name, Relation, conjuncts
from somrs.errors import RemoteError, UsageError
from somrs.ontology.modes import Mode, hold_reason
from somrs.ontology.qualified_names import home_of, plain_name
from somrs.protocol.messages.observations import Observation
from somrs.service_manager.sdk.device import Result, Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed

LOOKING_TIME = 5.0
"""Time to turn to a place and to look at it, s."""
LOWEST_CHARGE = 5.0
"""Charge in percent below which a robot only accepts to charge its battery."""
ARRIVED = 0.1
"""A robot stands at a place if its middle is at most this far outside of the place's circle, m."""


async def _able(device: MobileRobot, task: Task) -> None:
    await device.check_able(task)


async def _able_to_charge(device: MobileRobot, task: Task) -> None:
    state = await device.check_working()
    if state.charge == 0:
        raise Refusal(f"the battery of {device.name} is empty, so that somebody has to bring it to a charger", not_now=True)


async def _price(device: MobileRobot, task: Task) -> float | str:
    return await device.price(task, (await device.way_to_place(task))[0] if device.price_per_metre else 0.0)


async def _duration(device: MobileRobot, task: Task) -> float:
    return round(await device.driving_time(task, (await device.way_to_place(task))[0]), 1)


async def _charging_price(device: MobileRobot, task: Task) -> float | str:
    return await device.price(task, (await device.way_to_charger(task))[0] if device.price_per_metre else 0.0)


async def _charging_time(device: MobileRobot, task: Task) -> float:
    way, _ = await device.way_to_charger(task)
    charge = (await device.check_working()).charge
    return round(await device.driving_time(task, way) + (charging_time(charge) if charge is not None else 0.0), 1)


async def _looking_price(device: MobileRobot, task: Task) -> float | str:
    return await device.price(task, await device.way_to_view(task) if device.price_per_metre else 0.0)


async def _looking_time(device: MobileRobot, task: Task) -> float:
    return round(LOOKING_TIME + await device.driving_time(task, await device.way_to_view(task)), 1)


class MobileRobot(ChargingRobot):
    """A mobile robot in the simulator."""

    async def check_working(self) -> RobotState:
        """As for every device. Raises Refusal also in a fire or an emergency, in which robots stand still."""
        try:
            buildings = await self.map.query("?It: Building.Mode = ?Mode")
        except RemoteError:  # the ontology of a map that an earlier version made has no modes
            buildings = []
        if reason := hold_reason({str(row["It"]): Mode(str(row["Mode"])) for row in buildings}):
            raise Refusal(reason, not_now=True)
        return await super().check_working()

    async def check_able(self, task: Task) -> RobotState:
        """Return the robot's state. Raises Refusal when it cannot work, also because its battery is almost empty, or because a neighbour
        does not show what the task is about."""
        for name in map(str, task.inputs.values()):
            if home_of(name) and await task.map.object(name) is None:
                raise Refusal(f"the map {home_of(name)} does not show {plain_name(name)} to {self.name}")
        state = await self.check_working()
        charge = await self.available_charge(task, state)
        if charge is not None and charge < LOWEST_CHARGE:
            raise Refusal(
                f"the battery of {self.name} is at {charge:.0f} %; it has to be charged first",
                not_now=True,
                condition=f"{self.name}.Charge >= {least_charge(LOWEST_CHARGE)}",
            )
        return state

    # Driving to a place

    async def way_to_place(self, task: Task) -> tuple[float, NamedPlace]:
        """The driving distance to the place that the task names, m, and the place. Raises Refusal when there is no path."""
        name = str(task.inputs["Place"])
        place = await self.named_place(task.map, name)
        if place is None:
            raise Refusal(f"the map does not say where {name} is")
        return await self._way_to(task, place, name), place

    @service("MoveTo", price=_price, duration=_duration, able=_able, inputs=("Place",))
    async def move_to(self, task: Task) -> Situation:
        try:
            _, place = await self.way_to_place(task)
        except Refusal as refusal:
            raise ServiceFailed(str(refusal)) from None
        return await self._driven_to(task, place)

    @move_to.stopping
    async def stop_moving(self, task: Task) -> Situation:
        return await self._commanded(task, self._link.stop)

    @move_to.compensation
    async def move_back(self, task: Task, situation: Formula) -> Situation:
        """Drive back to the place where the robot was."""
        for name in places_of(self.name, situation):
            place = await self.named_place(task.map, name)
            if place is not None:
                return await self._driven_to(task, place)
        raise ServiceFailed(f"{situation} does not say at which place {self.name} was")

    async def _driving(self, task: Task, drive: Coroutine[object, object, CommandDone], begin: float, end: float, note: str) -> CommandDone:
        try:
            self.check_start(task)
        except ServiceFailed:
            drive.close()
            raise
        return await super()._driving(task, drive, begin, end, note)

    async def _driven_to(self, task: Task, place: NamedPlace) -> str:
        note = f"drives to {place.name}"
        return await self._commanded(task, lambda: self._driving(task, self._link.drive_to(place.x, place.y, z=place.z), 0.0, 0.95, note))

    # The battery

    async def way_to_charger(self, task: Task) -> tuple[float, NamedPlace]:
        """The driving distance to the nearest charger that is free, m, and the charger. Raises Refusal if there is none."""
        return (await self._ways_to_chargers(task, (await self.free_chargers(task))[0]))[0]

    async def _ways_to_chargers(self, task: Task, free: Sequence[NamedPlace]) -> list[tuple[float, NamedPlace]]:
        """The driving distances to the free chargers, m, and the chargers, the nearest first. Raises Refusal if there is no path to any."""
        ways = [await self._legs_to(task, charger, charging=True) for charger in free]
        reachable = [(way, charger) for legs, charger in zip(ways, free, strict=True) for way in legs.lengths if way is not None]
        if not reachable:
            raise Refusal(f"{self.name} finds no path to {' or '.join(charger.name for charger in free)}")
        return sorted(reachable, key=lambda option: option[0])

    @service("ChargeBattery", price=_charging_price, duration=_charging_time, able=_able_to_charge, inputs=())
    async def charge(self, task: Task) -> Situation:
        charger = await self._reserved_charger(task)
        try:
            await self._driven_to(task, charger)
            note = f"charges at {charger.name}"
            return await self._commanded(task, lambda: self._driving(task, self._link.charge(), 0.2, 1.0, note))
        finally:
            self._release(charger.name)

    async def _reserved_charger(self, task: Task) -> NamedPlace:
        """The nearest free charger, which is reserved for this robot now. Raises ServiceFailed."""
        try:
            free, version = await self.free_chargers(task)
            for _, charger in await self._ways_to_chargers(task, free):
                if await self.reserve_charger(charger.name, version):
                    return charger
        except Refusal as refusal:
            raise ServiceFailed(str(refusal), tried=False) from None
        raise ServiceFailed("other robots have just reserved all chargers", tried=False)

    @charge.stopping
    async def stop_charging(self, task: Task) -> Situation:
        return await self._commanded(task, self._link.stop)

    @charge.compensation
    async def keep_charge(self, task: Task, situation: Formula) -> Situation:
        """A charged battery leaves nothing to undo."""
        return await self._commanded(task, self._link.status)

    # Looking

    @service("LookAt", price=_looking_price, duration=_looking_time, able=_able, inputs=("Place",), outputs=("Thing",))
    async def look_at_place(self, task: Task) -> Result:
        return await self._look(task, str(task.inputs["Place"]))

    @service("LookInto", price=_looking_price, duration=_looking_time, able=_able, inputs=("Cupboard",), outputs=("Thing",))
    async def look_into(self, task: Task) -> Result:
        return await self._look(task, str(task.inputs["Cupboard"]))

    @look_at_place.stopping
    @look_into.stopping
    async def stop_looking(self, task: Task) -> Situation:
        return await self._commanded(task, self._link.stop)

    @look_at_place.compensation
    @look_into.compensation
    async def keep_findings(self, task: Task, situation: Formula) -> Situation:
        """An observation leaves nothing to undo."""
        return await self._commanded(task, self._link.status)

    async def _look(self, task: Task, place: str) -> Result:
        """Drive to where the place is in view, and report the things there."""
        try:
            x, y, z = await point_at(task, place)
        except Refusal as refusal:
            raise ServiceFailed(str(refusal)) from None
        note = f"looks at {place}"
        look = await self._result(task, lambda: self._driving(task, self._link.look_at(x, y, z), 0.0, 0.95, note))
        looked_at = time.time()  # the drive ends with the look
        situation = " AND ".join([*describe_things(place, look.sightings), *await self.whereabouts(task, look.state)])
        return Result(situation=situation, observation=Observation(as_of=looked_at))

    async def way_to_view(self, task: Task) -> float:
        """The driving distance to what is to be looked at, m. Raises Refusal when there is no path."""
        place = str(task.inputs["Place"] if "Place" in task.inputs else task.inputs["Cupboard"])
        return await self._way_to(task, place, place)

    async def _way_to(self, task: Task, stop: NamedPlace | str, name: str) -> float:
        """The driving distance to a place or an object, m. Raises Refusal when there is no path to what has this name."""
        legs = await self._legs_to(task, stop)
        (way,) = legs.lengths
        if way is None:
            raise Refusal(self._no_path(legs, name))
        return way

    def _no_path(self, legs: Legs, name: str) -> str:
        """Why there is no path to what has this name."""
        if not legs.out_of_reach:
            return f"{self.name} finds no path to {name}"
        return f"{self.name} can stand nowhere from where it could reach {name}: there is no room for it, or something is in between"

    async def _legs_to(self, task: Task, stop: NamedPlace | str, *, charging: bool = False) -> Legs:
        """The way to a place or an object. Raises Refusal.

        `charging`: the charge may just do, because the robot charges there.
        """
        place = stop.stand if isinstance(stop, NamedPlace) else stop
        try:
            return await (self.legs_to_charger(task, place) if charging else self.legs_through(task, place))
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}", not_now=True) from None
        except UsageError as error:
            raise Refusal(f"{self.name} cannot determine the path: {error}") from None

    async def _commanded(self, task: Task, command: Callable[[], Awaitable[CommandDone]]) -> str:
        """Carry out a command that moves no thing. Return where the robot is then, and whether doors that it moved are open.

        Raises ServiceFailed.
        """
        result = await self._result(task, command)
        return " AND ".join([*describe_doors(result.object_states), *await self.whereabouts(task, result.state)])

    async def _result(self, task: Task, command: Callable[[], Awaitable[CommandDone]]) -> CommandDone:
        try:
            return await self.retry_when_link_lost(command)
        except RobotGaveUp as failure:
            raise ServiceFailed(failure.description, await self._failed_at(task, failure)) from failure

    async def _failed_at(self, task: Task, failure: RobotGaveUp) -> str:
        if failure.state is None or self._link.silent:
            return self._out_of_order()
        parts = [*describe_doors(failure.object_states), *await self.whereabouts(task, failure.state)]
        return " AND ".join([*parts, *([self._out_of_order()] if failure.state.faults or not self._link.connected else [])])

    async def whereabouts(self, task: Task, state: RobotState) -> list[str]:
        """The robot's pose, the charge of its battery, and the place at which it stands, as parts of a formula."""
        places = [place for place in await self.named_places(task, "Place") if place.is_near(state, ARRIVED)]
        if not places:
            return await self.own_position(state)
        nearest = min(places, key=lambda place: math.dist((place.x, place.y), (state.x, state.y)))
        return [*self.own_pose(state), f"{self.name} isAt {nearest.name}"]

    async def own_position(self, state: RobotState) -> list[str]:
        left = await self.left_places(state)
        return [*self.own_pose(state), *left]

    async def left_places(self, state: RobotState) -> list[str]:
        """That the robot is no longer at the place where it is according to the map, as parts of a formula; none if it is there."""
        rows = await self.map.query(f"{self.name} isAt ?Place")
        places = {name: await self.named_place(self.map, name) for name in (str(row["Place"]) for row in rows)}
        left = (name for name, place in places.items() if place is None or not place.is_near(state, ARRIVED))
        return [f"NOT {self.name} isAt {name}" for name in left]


def describe_doors(object_states: Iterable[ObjectState]) -> list[str]:
    """Whether the observed doors and containers are open, as parts of a formula."""
    return [f"{state.object}.Open = {str(state.open).upper()}" for state in object_states if state.open is not None]


def places_of(robot: str, situation: Formula) -> list[str]:
    """The places at which a situation says that the robot is."""
    return [
        part.arguments[1].name
        for part in conjuncts(situation)
        if isinstance(part, Relation)
        and part.relation == "isAt"
        and part.arguments[0] == Name(robot)
        and isinstance(part.arguments[1], Name)
    ]
