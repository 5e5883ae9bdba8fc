"""What a simulated robot does so that it never stands somewhere with an empty battery: the charge that work needs, and the use of chargers.

A robot takes work only if it can then still drive to a charger, with a reserve. A charger is reserved on the map for one robot at a time:
`Charger001 isBookedFor Robot1`.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence

from somrs.devices.simulator.battery import PER_METRE
from somrs.devices.simulator.drivers.outage import Outage
from somrs.devices.simulator.drivers.simulated import SimulatedDevice, format_number
from somrs.devices.simulator.link.commands import RobotState
from somrs.devices.simulator.link.lines import HANDLES, Legs, PathStop, StandAt
from somrs.errors import RemoteError, UsageError
from somrs.ontology.modes import why_closed
from somrs.protocol.messages.knowledge import Rows, UpdateMap
from somrs.protocol.messages.submission import Submit
from somrs.service_manager.sdk.device import Task
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from somrs.service_manager.sdk.values import number_of
from somrs.space.shafts import SAME_FLOOR

RESERVE = 10.0
"""Charge with which a robot plans to arrive at a charger after its work, percent."""
DETOURS = 1.3
"""How much longer than planned a way may become, by other robots on it."""
WORK = 3.0
"""Charge for work other than driving, percent: some ten minutes of handling, turning and waiting."""
CHARGE_STEP = 2.0
"""The charge is reported when it differs from that on the map by this much, percent."""
REMEMBERED = 100
"""The number of quotes for which a robot remembers the charge that they need."""

LOW = 30.0
"""Charge below which an idle robot has itself charged, percent."""
ENOUGH = 90.0
"""Charge that it then wants to have at least, percent."""
LOW_CHECK = 5.0
"""Seconds between two checks of whether the charge is low."""
LONGEST_PAUSE = 600.0
"""The longest time between two tasks to charge that have failed, s."""


class NamedPlace:
    """A place on the map: its name, its middle and its radius in metres. `z`: its height; None if the map does not say it."""

    def __init__(self, name: str, x: float, y: float, radius: float, z: float | None = None) -> None:
        self.name, self.x, self.y, self.radius, self.z = name, x, y, radius, z

    @property
    def stand(self) -> StandAt:
        """Its middle, where a robot stands."""
        return StandAt(self.x, self.y, self.z)

    def is_near(self, place: NamedPlace | RobotState, distance: float = 0.0) -> bool:
        """Whether something is at most that far from the place's circle, on the same floor."""
        is_on_floor = self.z is None or place.z is None or abs(self.z - place.z) < SAME_FLOOR
        return is_on_floor and self.distance(place.x, place.y) <= distance

    def distance(self, x: float, y: float) -> float:
        """Distance of a point from the place's circle, m; negative inside it."""
        return math.dist((self.x, self.y), (x, y)) - self.radius


class ChargingRobot(SimulatedDevice):
    """A simulated robot with a battery."""

    async def open(self) -> None:
        self._reported_charge: float | None = None
        """The charge on the map; None until it has been read."""
        self._needed_charges: dict[tuple[str, str], float] = {}
        """The charge that quoted work needs, by transaction and participant."""
        await super().open()
        try:
            own_reservations = await self.map.query(f"?Charger: Charger isBookedFor {self.name}")
        except RemoteError:  # the ontology of a map that an earlier version made has no reservations
            self._reserves = False
        else:
            self._reserves = True
            for row in own_reservations:  # of a life that has ended
                self._release(str(row["Charger"]))
        rows = await self.map.query(f"{self.name}.Charge = ?Charge", limit=1)
        self._reported_charge = number_of(rows[0]["Charge"]) if rows else -math.inf
        if self._link.state is not None:
            self._note_charge(self._link.state)
        self.keep_doing(self._keep_charged())

    async def _keep_charged(self) -> None:
        """Submit a task to charge the battery when the robot is idle and its charge is low, one at a time."""
        outage, pause, task = Outage(self.name, "ask for its battery to be charged"), LOW_CHECK, ""
        while True:
            await asyncio.sleep(pause)
            with outage:
                if not self._needs_charge or (task and await self.tasks.is_running(task)):
                    pause = LOW_CHECK
                elif await self.map.holds("?It: Charger = ?It"):
                    pause = min(2 * pause, LONGEST_PAUSE)  # also after a task that has failed
                    task = await self.tasks.submit(Submit(effect=f"{self.name}.Charge >= {ENOUGH:g}"))

    @property
    def _needs_charge(self) -> bool:
        state = self.idle_state
        return state is not None and state.charge is not None and 0 < state.charge < LOW

    # The charge on the map

    def _notice_state(self, state: RobotState) -> None:
        super()._notice_state(state)
        self._note_charge(state)

    def _note_charge(self, state: RobotState) -> None:
        """Report the charge if it differs much from that on the map, or if the battery is empty."""
        reported_charge = self._reported_charge
        if state.charge is None or reported_charge is None:
            return
        if abs(state.charge - reported_charge) >= CHARGE_STEP or state.charge == 0 < reported_charge:
            self._reported_charge = state.charge
            self.observed(f"{self.name}.Charge = {format_number(round(state.charge, 1))}")

    def own_pose(self, state: RobotState) -> list[str]:
        self._reported_charge = state.charge
        return super().own_pose(state)

    # The charge that work needs

    async def legs_through(self, task: Task, *stops: PathStop) -> Legs:
        """As for every device. Raises Refusal if a door or a lift on the only way is out of order, if a no-go zone closes it, and if the
        charge is not enough for the way, the work, and the way to the nearest charger."""
        legs = await super().legs_through(task, *stops)
        if closed := why_closed(legs.out_of_order, legs.zones):
            raise Refusal(closed, not_now=True)
        if None not in legs.lengths:
            await self._check_charge(task, sum(length or 0.0 for length in legs.lengths), stops)
        return legs

    async def legs_to_charger(self, task: Task, *stops: PathStop) -> Legs:
        """The way to a charger, for which the charge may just do."""
        return await super().legs_through(task, *stops)

    async def available_charge(self, task: Task, state: RobotState) -> float | None:
        """The charge when the service starts, percent; None for a robot without a battery.

        An earlier step of the plan may charge it. Otherwise the robot knows its charge better than the map.
        """
        if state.charge is None or task.situation is None or f"{self.name}.Charge" not in str(task.situation):
            return state.charge
        rows = await task.map.query(f"{self.name}.Charge = ?Charge", limit=1)
        return number_of(rows[0]["Charge"]) if rows else state.charge

    async def _check_charge(self, task: Task, way: float, stops: Sequence[PathStop]) -> None:
        state = self._link.state
        charge = await self.available_charge(task, state) if state is not None else None
        if charge is None:
            return
        charger, way_back = await self._nearest_charger(task, stops)
        needed = WORK + DETOURS * PER_METRE * (way + way_back)
        self._remember_need(task, needed)
        if charge >= needed + RESERVE:
            return
        addition = f", and for the way to {charger} after it" if charger is not None else ""
        least = least_charge(needed + RESERVE)
        if least > 100:
            raise Refusal(f"{self.name} needs more than a full battery for this{addition}")
        raise Refusal(
            f"{self.name} needs {needed + RESERVE:.0f} % of charge for this{addition}, and has {charge:.0f} %",
            not_now=True,
            condition=f"{self.name}.Charge >= {least}",
        )

    def check_start(self, task: Task) -> None:
        """Check, when the robot sets off, that it still has the charge that the work needed when it was quoted. Raises ServiceFailed."""
        needed, state = self._needed_charges.pop(_key(task), None), self._link.state
        if needed is not None and state is not None and state.charge is not None and state.charge < needed:
            reason = f"{self.name} needs {needed:.0f} % of charge for this, and has only {state.charge:.0f} % left"
            raise ServiceFailed(reason, tried=False)

    def _remember_need(self, task: Task, charge: float) -> None:
        self._needed_charges.pop(_key(task), None)
        self._needed_charges[_key(task)] = charge
        if len(self._needed_charges) > REMEMBERED:
            del self._needed_charges[next(iter(self._needed_charges))]

    async def _nearest_charger(self, task: Task, stops: Sequence[PathStop]) -> tuple[str | None, float]:
        """The nearest charger to the last stop, and the distance to it, m; None and 0 if none can be reached from there."""
        chargers = await self.named_places(task, "Charger")
        point = await self._point_of(task, stops[-1]) if chargers else None
        if point is not None:
            chargers = sorted(chargers, key=lambda charger: charger.distance(*point))
        for charger in chargers:
            try:
                way = (await self.find_legs(task, *stops, charger.stand)).lengths[-1]
            except (RemoteError, UsageError):
                return None, 0.0
            if way is not None:
                return charger.name, way
        return None, 0.0

    async def _point_of(self, task: Task, stop: PathStop) -> tuple[float, float] | None:
        match stop:
            case StandAt(x, y):
                return x, y
            case tuple():
                return stop[0], stop[1]
        name = stop.removesuffix(HANDLES)
        rows = await task.map.query(f"{name}.PositionX = ?X AND {name}.PositionY = ?Y", limit=1)
        return (number_of(rows[0]["X"]), number_of(rows[0]["Y"])) if rows else None

    # Chargers

    async def free_chargers(self, task: Task) -> tuple[list[NamedPlace], int]:
        """The chargers that no other robot uses, those at which no robot stands first, and the version of the map in which they are free.

        Raises Refusal if there is none. A broken robot keeps the charger at which it stands, and no other. An idle robot makes way for one
        that has reserved the charger.
        """
        chargers = await self.named_places(task, "Charger")
        if not chargers:
            raise Refusal("there is no charger on the map")
        reservations = await self.map.rows("?It: Charger isBookedFor ?Robot") if self._reserves else Rows(rows=(), version=0)
        robots = [robot for robot in await self.named_places(task, "MobileRobot") if robot.name != self.name]
        standing = {charger.name: {robot.name for robot in robots if charger.is_near(robot)} for charger in chargers}
        if self._reserves:
            broken = {str(row["It"]) for row in await task.map.query("?It: MobileRobot.Working = FALSE")}
            holders = {row.bindings["It"]: row.bindings["Robot"] for row in reservations.rows}
            used = {name for name, holder in holders.items() if holder not in {self.name, *(broken - standing.get(name, set()))}}
            used |= {name for name, names in standing.items() if names & broken}
        else:
            used = {name for name, names in standing.items() if names}
        free = [charger for charger in chargers if charger.name not in used]
        if not free:
            raise Refusal("all chargers are in use", not_now=True)
        return sorted(free, key=lambda charger: bool(standing[charger.name])), reservations.version

    async def reserve_charger(self, name: str, version: int) -> bool:
        """Reserve a charger that was free in this version of the map. Returns False if another robot was faster."""
        if not self._reserves:
            return True
        situation = f"{name} isBookedFor {self.name}"
        return await self.map.update(UpdateMap(situation=situation, author=self.name, expected_version=version))

    def _release(self, charger: str) -> None:
        if self._reserves:
            self.observed(f"NOT {charger} isBookedFor {self.name}")

    # The map

    async def named_place(self, map: MapReader, name: str) -> NamedPlace | None:
        """An object as a place; None if the map does not say where it is."""
        positions = await map.query(f"{name}.PositionX = ?X AND {name}.PositionY = ?Y", limit=1)
        if not positions:
            return None
        x, y = (number_of(positions[0][variable]) for variable in ("X", "Y"))
        radii = [number_of(row["Radius"]) for row in await map.query(f"{name}.Shape.Radius = ?Radius", limit=1)]
        heights = [number_of(row["Z"]) for row in await map.query(f"{name}.PositionZ = ?Z", limit=1)]
        return NamedPlace(name, x, y, radii[0] if radii else 0.0, heights[0] if heights else None)

    async def named_places(self, task: Task, kind: str) -> list[NamedPlace]:
        """The objects of a type with a position; their radius is 0 if the map states none."""
        position = "?It.PositionX = ?X AND ?It.PositionY = ?Y"
        rows = await task.map.query(f"?It: {kind} = ?It AND {position}")
        radii = {str(row["It"]): number_of(row["Radius"]) for row in await task.map.query(f"?It: {kind}.Shape.Radius = ?Radius")}
        heights = {str(row["It"]): number_of(row["Z"]) for row in await task.map.query(f"?It: {kind}.PositionZ = ?Z")}
        names = [str(row["It"]) for row in rows]
        return [
            NamedPlace(name, number_of(row["X"]), number_of(row["Y"]), radii.get(name, 0.0), heights.get(name))
            for name, row in zip(names, rows, strict=True)
        ]


def least_charge(needed_charge: float) -> int:
    """The charge to demand on the map, percent: the map may say up to a step more than the robot has."""
    return math.ceil(needed_charge + CHARGE_STEP)


def _key(task: Task) -> tuple[str, str]:
    return task.order.transaction, task.order.participant
