"""The Service Manager's side of a simulated mobile robot with a gripper: carries things from one place to another.

All it knows of the robot comes over the robot link, all it knows of the world from the Repository. What it reports is measured,
in metres and radians rounded to three digits.
"""

from __future__ import annotations

from collections.abc import Coroutine, Iterable
from dataclasses import dataclass

from somrs.devices.simulator.drivers.simulated import SimulatedDevice, is_a, plain
from somrs.devices.simulator.link.commands import Done, Fault, RobotState, Seen
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.entish.formula import Attribute, Comparison, Formula, Name, Number, Relation, conjuncts
from somrs.errors import RemoteError, UsageError
from somrs.service_manager.sdk.device import Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed

SUPPORTING = ("Support", "Floor", "Place", "StationaryDevice")
"""The types of what things can be put on."""
HANDLING = 20.0
"""To take a thing and to put it down, s."""


@dataclass(frozen=True, slots=True)
class Spot:
    """Where a thing is or is to be, as far as a formula says."""

    on: str | None = None
    at: tuple[float, float] | None = None


async def _able(device: Manipulator, task: Task) -> None:
    """Whether the robot is in order, and the thing not too heavy for it."""
    state = await device.in_order()
    object = str(task.inputs["Object"])
    if state.holding not in (None, object, device.carrying):
        raise Refusal(f"{device.name} holds {state.holding}")
    if await task.map.holds(f"{object}.Weight > {device.name}.Payload"):
        (row, *_) = await task.map.query(f"{object}.Weight = ?Weight AND {device.name}.Payload = ?Payload")
        raise Refusal(f"{object} is too heavy for {device.name}: {row['Weight']}, and it carries {row['Payload']}")


async def _price(device: Manipulator, task: Task) -> float | str:
    return await device.price(task, sum(await device.legs(task)) if device.price_per_metre else 0.0)


async def _duration(device: Manipulator, task: Task) -> float:
    return round(HANDLING + await device.driving_time(task, sum(await device.legs(task))), 1)


class Manipulator(SimulatedDevice):
    """A mobile robot with a gripper in the simulator."""

    type = "MobileManipulator"

    async def open(self) -> None:
        self._last_seen: dict[str, Seen] = {}
        self.carrying: str | None = None
        """What it is about to fetch or brings somewhere."""
        await super().open()

    async def legs(self, task: Task) -> tuple[float, float]:
        """How far it is to the thing, and from there to its destination, m. Raises Refusal when there is no way."""
        object, destination = str(task.inputs["Object"]), str(task.inputs["Destination"])
        spot = where(object, task.precondition)
        through: str | tuple[float, float] = object
        if spot.at is not None:
            through = spot.at
        elif spot.on is not None and not await task.map.holds(f"{object} isOn {spot.on}"):
            through = spot.on  # it is going to be there
        try:
            first, second = await self.persistent(lambda: self._link.ways(through, destination))
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}") from None
        except UsageError as error:
            raise Refusal(f"{self.name} does not know the way: {error}") from None
        if first is None or second is None:
            raise Refusal(f"{self.name} finds no way to {object if first is None else destination}")
        if not any([await is_a(task, destination, kind) for kind in SUPPORTING]):
            raise Refusal(f"nothing can be put on {destination}")
        return first, second

    @service("TransferObject", price=_price, duration=_duration, able=_able)
    async def transfer(self, task: Task) -> Situation:
        object, destination = str(task.inputs["Object"]), str(task.inputs["Destination"])
        return await self._carry(task, object, Spot(on=destination))

    @transfer.stopping
    async def put_down(self, task: Task) -> Situation:
        """Stop, put down what is held, and say where everything is now."""
        object = str(task.inputs["Object"])
        try:
            done = await self.persistent(self._laid_down)
        except RobotGaveUp as gave:
            raise ServiceFailed(gave.description, self._situation(gave.state or self._link.state, object, gave.seen)) from gave
        return self._situation(done.state, object, done.seen)

    async def _laid_down(self) -> Done:
        done = await self._link.stop()
        return await self._noting(self._link.put_down()) if done.state.holding is not None else done

    @transfer.compensation
    async def bring_back(self, task: Task, situation: Formula) -> Situation:
        """Put the thing back where it was."""
        object = str(task.inputs["Object"])
        spot = where(object, situation)
        if spot.on is None:
            raise ServiceFailed(f"{situation} does not say on what {object} was")
        return await self._carry(task, object, spot)

    async def _carry(self, task: Task, object: str, to: Spot) -> Situation:
        assert to.on is not None, "things are put on something"
        self._last_seen.pop(object, None)
        self.carrying = object
        try:
            done = await self.persistent(lambda: self._carried(task, object, to))
        except RobotGaveUp as gave:
            raise ServiceFailed(f"{self.name}: {gave.description}", await self._left_free(gave, object)) from gave
        finally:
            self.carrying = None
        seen = self._last_seen.get(object)
        situation = self._situation(done.state, object, (), on_first=True)
        if seen is None or seen.on is None:
            raise ServiceFailed(f"{self.name} put {object} on {to.on}, and does not see it there", situation)
        if seen.on != to.on:
            raise ServiceFailed(f"{self.name} put {object} on {to.on}, and sees it on {seen.on}", situation)
        if await task.map.holds(f"{self.name}.Working = FALSE"):
            return f"{situation} AND {self.name}.Working = TRUE"
        return situation

    async def _carried(self, task: Task, object: str, to: Spot) -> Done:
        """Take the thing, unless it is held already, and put it there."""
        assert to.on is not None, "things are put on something"
        state = (await self._link.status()).state
        if state.holding != object:
            await self._driving(task, self._noting(self._link.approach(object)), 0.05, 0.35, f"on the way to {object}")
            await self._noting(self._link.grip(object))
        await task.progress(0.4, f"{object} isHeldBy {self.name}", f"{object} is gripped")
        await self._driving(task, self._noting(self._link.approach(to.on)), 0.45, 0.85, f"carries {object} to {to.on}")
        return await self._noting(self._link.place(to.on, *(to.at or ())))

    async def _left_free(self, gave: RobotGaveUp, object: str) -> str:
        """What holds after a command was given up. What the robot still holds is put down first, for others to take."""
        state, seen = gave.state, gave.seen
        if state is not None and state.holding == object and Fault.GRIPPER not in state.faults and self._link.connected:
            try:
                done = await self._noting(self._link.put_down())
                state, seen = done.state, done.seen
            except RobotGaveUp as again:
                state, seen = again.state or state, again.seen
        return self._situation(state, object, seen)

    async def _noting(self, command: Coroutine[object, object, Done]) -> Done:
        """Carry out a command, and remember where things were seen."""
        done = await command
        self._last_seen.update({seen.object: seen for seen in done.seen})
        return done

    def _situation(self, state: RobotState | None, object: str, seen: Iterable[Seen], *, on_first: bool = False) -> str:
        """What is known to hold: of the thing, and of the robot. `on_first`: on what the thing is matters more than where.

        Of a silent robot it is not known what it went on doing, so nothing that was known before is told.
        """
        if self._link.silent:
            return self._out_of_order()
        self._last_seen.update({one.object: one for one in seen})
        parts: list[str] = []
        thing = self._last_seen.get(object)
        if state is not None and state.holding == object:
            parts.append(f"{object} isHeldBy {self.name}")
        elif thing is not None:
            parts += [f"{object}.Position{axis} = {plain(value)}" for axis, value in zip("XYZ", (thing.x, thing.y, thing.z), strict=True)]
            if thing.on is not None:
                parts.insert(0 if on_first else 3, f"{object} isOn {thing.on}")
        if state is not None:
            parts += self._own_pose(state)
        if state is None or state.faults or not self._link.connected:
            parts.append(self._out_of_order())
        return " AND ".join(parts)


def where(object: str, formula: Formula | None) -> Spot:
    """What a formula says about where a thing is."""
    on: str | None = None
    found: dict[str, float] = {}
    for part in conjuncts(formula) if formula is not None else ():
        match part:
            case Relation(relation="isOn", arguments=(Name(name=thing), Name(name=support))) if thing == object:
                on = support
            case Comparison(left=Attribute(owner=Name(name=thing), path=path), operator="=", right=Number(value=value)) if thing == object:
                found[path] = value
    at = (found["PositionX"], found["PositionY"]) if {"PositionX", "PositionY"} <= found.keys() else None
    return Spot(on=on, at=at)
