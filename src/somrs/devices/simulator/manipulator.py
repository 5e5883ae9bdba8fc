"""The Service Manager's side of a simulated mobile robot with a gripper: carries things from one place to another.

All it knows of the robot comes over the robot link, all it knows of the world from the Repository. What it reports is measured,
in metres and radians rounded to three digits.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Coroutine, Iterable
from dataclasses import dataclass

from somrs.devices.simulator.commands import Done, Fault, RobotState, Seen
from somrs.devices.simulator.link import RobotGaveUp, RobotLink
from somrs.entish.formula import Attribute, Comparison, Formula, Name, Number, Relation, conjuncts
from somrs.errors import DeviceError, RemoteError, UsageError
from somrs.ontology.types import Value
from somrs.service_manager.device import Device, Situation, Task, service
from somrs.service_manager.orders import Refusal, ServiceFailed
from somrs.service_manager.values import term

SUPPORTING = ("Support", "Floor", "Place", "StationaryDevice")
"""The types of what things can be put on."""
FEATURES = ("OperationRange", "Payload", "Speed", "Price")
"""What the map says of the robot that its services are offered with."""

DEFAULT_PRICE = "5 EUR"
DEFAULT_SPEED = 0.5
"""Of a robot whose map says nothing of it, m/s."""
HANDLING = 20.0
"""To take a thing and to put it down, s."""
DRIVING = 1.25
"""How much longer a way takes than at full speed, for turning, starting and stopping."""
DISABLING = {Fault.DRIVE: "its drive is dead", Fault.GRIPPER: "its gripper is stuck"}
ANSWERING = 2.0
"""Seconds that the robot has to say how it is, when it is to give a quote."""
REPORTING = 2.0
"""Seconds between two reports while it drives."""


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
    rows = await task.map.query(f"{device.name}.Price = ?Price")
    price = rows[0]["Price"] if rows else DEFAULT_PRICE
    if not device.price_per_metre:
        return price
    amount = term(str(price))
    assert isinstance(amount, Number), "a price is a number"
    return f"{amount.value + device.price_per_metre * sum(await device.legs(task)):.2f} {amount.unit or 'EUR'}"


async def _duration(device: Manipulator, task: Task) -> float:
    rows = await task.map.query(f"{device.name}.Speed = ?Speed")
    speed = term(str(rows[0]["Speed"])) if rows else None
    metres_per_second = speed.value if isinstance(speed, Number) and speed.value > 0 else DEFAULT_SPEED
    return round(HANDLING + DRIVING * sum(await device.legs(task)) / metres_per_second, 1)


async def _is_a(task: Task, object: str, kind: str) -> bool:
    try:
        return await task.map.holds(f"?It: {kind} = {object}")
    except RemoteError:  # a Repository does not take a formula that its types rule out
        return False


class Manipulator(Device):
    """A mobile robot with a gripper in the simulator."""

    type = "MobileManipulator"
    price_per_metre: float = 0.0
    """What it asks for each metre that it drives, besides its Price on the map."""

    async def open(self) -> None:
        host, _, port = (self.simulator or "").rpartition(":")
        if not host or not port.isdigit():
            raise DeviceError(f"{self.name} needs a simulator, given as host:port, and not {self.simulator!r}")
        self._link = RobotLink(host, int(port), self.name)
        self._last_seen: dict[str, Seen] = {}
        self.carrying: str | None = None
        """What it is about to fetch or brings somewhere."""
        await self._link.connect()
        await self._link.status()
        self.attributes = {name: value for name in FEATURES for value in await self._feature(name)}

    async def close(self) -> None:
        await self._link.close()

    async def _feature(self, name: str) -> list[Value]:
        rows = await self.map.query(f"{self.name}.{name} = ?Feature", limit=1)
        said = [term(str(row["Feature"])) for row in rows]
        return [found.value for found in said if isinstance(found, Number)]  # in the attribute's own unit

    async def in_order(self) -> RobotState:
        """Its state now. Raises Refusal when it cannot work."""
        if self._link.silent or not self._link.connected:
            raise Refusal(f"{self.name} does not answer")
        try:
            async with asyncio.timeout(ANSWERING):
                state = (await self._link.status()).state
        except TimeoutError:
            raise Refusal(f"{self.name} does not answer within {ANSWERING:g} s") from None
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}") from None
        if state.faults:
            broken = " and ".join(DISABLING.get(fault, fault) for fault in state.faults)
            raise Refusal(f"{self.name} is out of order: {broken}")
        return state

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
            first, second = await self._link.ways(through, destination)
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}") from None
        except UsageError as error:
            raise Refusal(f"{self.name} does not know the way: {error}") from None
        if first is None or second is None:
            raise Refusal(f"{self.name} finds no way to {object if first is None else destination}")
        if not any([await _is_a(task, destination, kind) for kind in SUPPORTING]):
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
            done = await self._link.stop()
            if done.state.holding is not None:
                done = await self._noting(self._link.put_down())
        except RobotGaveUp as gave:
            raise ServiceFailed(gave.description, self._situation(gave.state or self._link.state, object, gave.seen)) from gave
        return self._situation(done.state, object, done.seen)

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
            state = (await self._link.status()).state
            if state.holding != object:
                await self._driving(task, self._link.approach(object), 0.05, 0.35, f"on the way to {object}")
                state = (await self._noting(self._link.grip(object))).state
            await task.progress(0.4, f"{object} isHeldBy {self.name}", f"{object} is gripped")
            await self._driving(task, self._link.approach(to.on), 0.45, 0.85, f"carries {object} to {to.on}")
            done = await self._noting(self._link.place(to.on, *(to.at or ())))
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

    async def _driving(self, task: Task, drive: Coroutine[object, object, Done], begin: float, end: float, note: str) -> Done:
        """Drive, and report from time to time how far it is: by the time that such ways take."""
        driving = asyncio.ensure_future(self._noting(drive))
        fraction = begin
        try:
            while True:
                await task.progress(fraction, note=note)
                done, _ = await asyncio.wait({driving}, timeout=REPORTING)
                if done:
                    return driving.result()
                fraction += (end - fraction) / 5
        finally:
            driving.cancel()

    async def _noting(self, command: Coroutine[object, object, Done]) -> Done:
        """Carry out a command, and remember where things were seen."""
        done = await command
        self._last_seen.update({seen.object: seen for seen in done.seen})
        return done

    def _situation(self, state: RobotState | None, object: str, seen: Iterable[Seen], *, on_first: bool = False) -> str:
        """What is known to hold: of the thing, and of the robot. `on_first`: on what the thing is matters more than where."""
        self._last_seen.update({one.object: one for one in seen})
        parts: list[str] = []
        thing = self._last_seen.get(object)
        if state is not None and state.holding == object:
            parts.append(f"{object} isHeldBy {self.name}")
        elif thing is not None:
            parts += [f"{object}.Position{axis} = {_plain(value)}" for axis, value in zip("XYZ", (thing.x, thing.y, thing.z), strict=True)]
            if thing.on is not None:
                parts.insert(0 if on_first else 3, f"{object} isOn {thing.on}")
        if state is not None:
            parts += [f"{self.name}.PositionX = {_plain(state.x)}", f"{self.name}.PositionY = {_plain(state.y)}"]
            parts.append(f"{self.name}.RotationZ = {_plain(state.yaw)}")
        if state is None or state.faults or self._link.silent or not self._link.connected:
            parts.append(f"{self.name}.Working = FALSE")
        return " AND ".join(parts)


def where(object: str, formula: Formula | None) -> Spot:
    """What a formula says about where a thing is."""
    on: str | None = None
    found: dict[str, float] = {}
    for part in conjuncts(formula) if formula is not None else ():
        match part:
            case Relation(relation="isOn", arguments=(Name(name=thing), Name(name=support))) if thing == object:
                on = support
            case Comparison(left=Attribute(of=Name(name=thing), path=path), operator="=", right=Number(value=value)) if thing == object:
                found[path] = value
    at = (found["PositionX"], found["PositionY"]) if {"PositionX", "PositionY"} <= found.keys() else None
    return Spot(on=on, at=at)


def _plain(value: float) -> str:
    """To the millimetre, or a thousandth of a radian, as Entish writes numbers."""
    assert math.isfinite(value), "physics that made no sense would have ended"
    return str(Number(round(value, 3) + 0.0))
