"""The driver of a simulated mobile robot with a gripper, which carries things from one place to another.

It gets the robot's state over the robot link, and its knowledge of the world from the Repository. It reports measured values, in metres
and radians, rounded to three digits.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Iterable
from dataclasses import dataclass

from somrs.devices.simulator.drivers.opening import OpeningRobot
from somrs.devices.simulator.drivers.simulated import Pose, format_number, weights_of
from somrs.devices.simulator.link.commands import CommandDone, Fault, ObjectState, RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.entish.formula import Attribute, Comparison, Formula, Name, Number, Relation, conjuncts
from somrs.errors import RemoteError, UsageError
from somrs.service_manager.sdk.device import Result, Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from somrs.service_manager.sdk.values import number_of

HANDLING_TIME = 20.0
"""Time to grip a thing and to put it down, s."""
WEIGHING_TIME = 15.0
"""Time to grip a thing, to lift it a little and to release it, s."""
KEPT_TIME = 30.0
"""Time after which an idle robot tries again to put down what it could not put down where it stands, s."""
KNOWN_WEIGHT = 0.1
"""Difference between the measured weight of a thing and that on the map up to which it is not reported, kg."""
GRIPPED, PLACED = 0.4, 0.95
"""The fraction of a transfer that is done when the thing is gripped, and when it is put down."""


@dataclass(frozen=True, slots=True)
class Spot:
    """The position of a thing, or its destination, as far as a formula states it."""

    support: str | None = None
    container: str | None = None
    position: tuple[float, float] | None = None

    @property
    def name(self) -> str | None:
        """The object on or in which the thing is."""
        return self.support if self.support is not None else self.container

    @property
    def label(self) -> str:
        return f"on {self.support}" if self.support is not None else f"into {self.container}"


async def _able(device: Manipulator, task: Task) -> None:
    """Check that the robot works, and that the thing is not too heavy for it. Raises Refusal.

    Demands that a thing of which nobody knows the weight is light enough, so that it is weighed first.
    """
    object = await _able_to_take(device, task)
    if await task.map.holds(f"{object}.Weight > {device.name}.Payload"):
        (row, *_) = await task.map.query(f"{object}.Weight = ?Weight AND {device.name}.Payload = ?Payload")
        raise Refusal(f"{object} is too heavy for {device.name}: it weighs {row['Weight']}, the payload is {row['Payload']}")
    for row in await task.map.query(f"{object} isIn ?It: Cupboard"):
        task.demand(f"{row['It']}.Open = TRUE", throughout=True)
    if await device.needs_weight(task, object):
        task.demand(f"{object}.Weight <= {device.name}.Payload")


async def _able_to_take(device: Manipulator, task: Task) -> str:
    """The thing that the task is about, after a check that the robot works, and that its gripper is free. Raises Refusal."""
    state = await device.check_able(task)
    object = str(task.inputs["Object"])
    if state.holding not in (None, object, device.carrying):
        raise Refusal(f"{device.name} holds {state.holding}", not_now=True)
    return object


async def _able_to_weigh(device: Manipulator, task: Task) -> None:
    await _able_to_take(device, task)


async def _price(device: Manipulator, task: Task) -> float | str:
    return await device.price(task, sum(await device.legs(task)) if device.price_per_metre else 0.0)


async def _weighing_price(device: Manipulator, task: Task) -> float | str:
    return await device.price(task, await device.way_to_thing(task) if device.price_per_metre else 0.0)


async def _weighing_time(device: Manipulator, task: Task) -> float:
    return round(WEIGHING_TIME + await device.driving_time(task, await device.way_to_thing(task)), 1)


async def _duration(device: Manipulator, task: Task) -> float:
    return round(device.handling_time + await device.driving_time(task, sum(await device.legs(task))), 1)


def _destination(task: Task) -> str:
    return str(task.inputs["Destination"] if "Destination" in task.inputs else task.inputs["Cupboard"])


class Manipulator(OpeningRobot):
    """A mobile robot with a gripper in the simulator."""

    type = "MobileManipulator"

    @property
    def handling_time(self) -> float:
        """Seconds to grip a thing and to put it down."""
        return HANDLING_TIME

    async def open(self) -> None:
        self._last_observations: dict[str, ObjectState] = {}
        self.carrying: str | None = None
        """The thing that it fetches or carries."""
        self._on_way_to: str | None = None
        """The thing that it drives to, and has not touched yet."""
        self._weights: dict[str, float] = {}
        """What the arm has measured of the things that it lifted last, kg."""
        self._kept: tuple[str, Pose, float] | None = None
        """What the idle robot could not put down, where, and when."""
        self._freeing = asyncio.Lock()
        """Held while the idle robot puts down what it holds. Services wait for that: nobody would know where the thing is otherwise."""
        await super().open()
        self._weighs = await self.map.service_type("WeighObject") is not None

    async def legs(self, task: Task) -> tuple[float, float]:
        """Driving distances to the thing, and from there to its destination, m. Raises Refusal when there is no path."""
        object, destination = str(task.inputs["Object"]), _destination(task)
        spot = read_spot(object, task.precondition)
        first_stop: str | tuple[float, float] = object
        if spot.position is not None:
            first_stop = spot.position
        elif spot.support is not None and not await task.map.holds(f"{object} isOn {spot.support}"):
            first_stop = spot.support  # an earlier step puts it there
        try:
            legs = await self.legs_through(task, first_stop, destination)
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}", not_now=True) from None
        except UsageError as error:
            raise Refusal(f"{self.name} cannot determine the path: {error}") from None
        first, second = legs.lengths
        if first is None or second is None:
            raise Refusal(self._no_path(legs, object if first is None else destination))
        if "Destination" in task.inputs and not legs.carries:
            raise Refusal(f"{self.name} cannot put anything on {destination}, only on floors, places, furniture and stationary devices")
        return first, second

    @service("TransferObject", price=_price, duration=_duration, able=_able, inputs=("Object", "Destination"))
    async def transfer(self, task: Task) -> Situation:
        object, destination = str(task.inputs["Object"]), str(task.inputs["Destination"])
        return await self._carry(task, object, Spot(support=destination))

    @service("PutInto", price=_price, duration=_duration, able=_able, inputs=("Object", "Cupboard"))
    async def put_into(self, task: Task) -> Situation:
        return await self._carry(task, str(task.inputs["Object"]), Spot(container=str(task.inputs["Cupboard"])))

    @service("TakeOutOf", price=_price, duration=_duration, able=_able, inputs=("Object", "Destination"))
    async def take_out(self, task: Task) -> Situation:
        return await self._carry(task, str(task.inputs["Object"]), Spot(support=str(task.inputs["Destination"])))

    @service("WeighObject", price=_weighing_price, duration=_weighing_time, able=_able_to_weigh, inputs=("Object",), outputs=("Weight",))
    async def weigh(self, task: Task) -> Result:
        """Lift the thing a little, and leave it where it is."""
        object = str(task.inputs["Object"])
        self._forget(object)
        note = f"lifts {object} a little, to weigh it"
        try:
            command = self.retry_when_link_lost(lambda: self._run_and_record(self._link.weigh(object)))
            done = await self._driving(task, command, 0.05, 0.95, note)
        except RobotGaveUp as failure:
            raise ServiceFailed(failure.description, await self._release_after_failure(failure, object)) from failure
        weight = weights_of(done.object_states)[object]
        situation = " AND ".join([f"{object}.Weight = {format_number(weight)}", *await self.whereabouts(task, done.state)])
        return Result(outputs={"Weight": weight}, situation=situation)

    @weigh.compensation
    async def keep_weight(self, task: Task, situation: Formula) -> Situation:
        """A measurement leaves nothing to undo."""
        return await self._commanded(task, self._link.status)

    async def way_to_thing(self, task: Task) -> float:
        """The driving distance to the thing that is to be weighed, m. Raises Refusal when there is no path."""
        object = str(task.inputs["Object"])
        return await self._way_to(task, object, object)

    async def needs_weight(self, task: Task, object: str) -> bool:
        """Whether nobody knows what the thing weighs, and a service could find out before it is taken."""
        return self._weighs and await task.map.holds(f"{object} isOn ?Place") and not await task.map.holds(f"{object}.Weight = ?Weight")

    @transfer.stopping
    @put_into.stopping
    @take_out.stopping
    @weigh.stopping
    async def stop_and_put_down(self, task: Task) -> Situation:
        """Stop, put down what is held, and report the resulting situation."""
        object = str(task.inputs["Object"])
        try:
            result = await self.retry_when_link_lost(self._stop_and_lay_down)
        except RobotGaveUp as failure:
            raise ServiceFailed(
                failure.description, await self._situation(failure.state or self._link.state, object, failure.object_states)
            ) from failure
        situation = await self._situation(result.state, object, result.object_states)
        is_placed = any(state.object == object for state in result.object_states)
        if self._on_way_to != object or is_placed or result.state.holding is not None:
            return situation
        return " AND ".join([*await self._place_on_map(task, object), situation])

    async def _place_on_map(self, task: Task, object: str) -> list[str]:
        """Where the map says that the thing is, as parts of a formula: there it still is if the robot has not touched it."""
        for relation in ("isOn", "isIn"):
            for row in await task.map.query(f"{object} {relation} ?Place", limit=1):
                return [f"{object} {relation} {row['Place']}"]
        return []

    async def _notice_idle(self, state: RobotState, pose: Pose) -> None:
        await super()._notice_idle(state, pose)
        if state.holding is not None and not state.faults and not self._has_kept(state.holding, pose):
            await self._free_gripper(state.holding, pose)

    def _has_kept(self, object: str, pose: Pose) -> bool:
        """Whether the robot could not put down a thing here, just now."""
        if self._kept is None or self._kept[:2] != (object, pose):
            return False
        return asyncio.get_running_loop().time() < self._kept[2] + KEPT_TIME

    async def _free_gripper(self, object: str, pose: Pose) -> None:
        """Put down what the idle robot holds, such as after a gripper that was stuck: no plan takes a thing out of a hand."""
        async with self._freeing:
            if self._working:
                return
            try:
                result = await self.retry_when_link_lost(lambda: self._run_and_record(self._link.put_down_object()))
            except RobotGaveUp as failure:
                self._kept = object, pose, asyncio.get_running_loop().time()  # there is no room
                if failure.state is not None:
                    self.observed(await self._situation(failure.state, object, failure.object_states))
            else:
                self.observed(await self._situation(result.state, object, result.object_states))

    async def _stop_and_lay_down(self) -> CommandDone:
        result = await self._link.stop()
        return await self._run_and_record(self._link.put_down_object()) if result.state.holding is not None else result

    @transfer.compensation
    @put_into.compensation
    @take_out.compensation
    async def compensate_transfer(self, task: Task, situation: Formula) -> Situation:
        """Put the thing back to where it was."""
        object = str(task.inputs["Object"])
        spot = read_spot(object, situation)
        if spot.name is None:
            raise ServiceFailed(f"{situation} does not say on what, or in what, {object} was")
        return await self._carry(task, object, spot)

    async def _carry(self, task: Task, object: str, target: Spot) -> Situation:
        self._forget(object)
        self.carrying = object
        try:
            result = await self.retry_when_link_lost(lambda: self._carry_out_transfer(task, object, target))
        except RobotGaveUp as failure:
            situation = await self._release_after_failure(failure, object)
            await self._report_weight(task, object, GRIPPED)
            raise ServiceFailed(failure.description, situation) from failure
        finally:
            self.carrying = None
        await self._report_weight(task, object, PLACED)
        object_state = self._last_observations.get(object)
        situation = await self._situation(result.state, object, (), on_first=True)
        seen = Spot() if object_state is None else Spot(support=object_state.support, container=object_state.container)
        if seen.name is None:
            raise ServiceFailed(f"{self.name} put {object} {target.label}, and does not see it there", situation)
        if seen.name != target.name:
            raise ServiceFailed(f"{self.name} put {object} {target.label}, and sees it {seen.label}", situation)
        if await task.map.holds(f"{self.name}.Working = FALSE"):
            return f"{situation} AND {self.name}.Working = TRUE"
        return situation

    async def _carry_out_transfer(self, task: Task, object: str, target: Spot) -> CommandDone:
        """Grip the thing, unless the robot holds it already, and put it on the target."""
        assert target.name is not None, "the callers name a support or a container"
        async with self._freeing:
            state = (await self._link.status()).state
        if state.holding != object:
            self._on_way_to = object
            await self._driving(task, self._run_and_record(self._link.approach(object)), 0.05, 0.35, f"on the way to {object}")
            self._on_way_to = None
            await self._driving(task, self._run_and_record(self._link.grip(object)), 0.35, GRIPPED, f"grips {object}")
        await task.progress(GRIPPED, f"{object} isHeldBy {self.name}", f"{object} is gripped")
        note = f"carries {object} to {target.name}"
        if target.support is None:
            return await self._driving(task, self._run_and_record(self._link.insert(target.name)), GRIPPED, PLACED, note)
        await self._driving(task, self._run_and_record(self._link.approach(target.name)), GRIPPED, 0.85, note)
        placing = self._run_and_record(self._link.place(target.name, *(target.position or ())))
        return await self._driving(task, placing, 0.85, PLACED, f"puts {object} on {target.name}")

    async def _release_after_failure(self, failure: RobotGaveUp, object: str) -> str:
        """The situation after a command was given up. First puts down what the robot still holds, so that others can take it."""
        state, object_states = failure.state, failure.object_states
        if state is not None and state.holding == object and Fault.GRIPPER not in state.faults and self._link.connected:
            try:
                result = await self._run_and_record(self._link.put_down_object())
                state, object_states = result.state, result.object_states
            except RobotGaveUp as second_failure:
                state, object_states = second_failure.state or state, second_failure.object_states
        return await self._situation(state, object, object_states)

    async def _report_weight(self, task: Task, object: str, fraction: float) -> None:
        """Report what the thing weighs, if the arm has lifted it and the map says something else or nothing."""
        weight = self._weights.get(object)
        rows = await task.map.query(f"{object}.Weight = ?Weight", limit=1) if weight is not None else []
        if weight is None or any(abs(number_of(row["Weight"]) - weight) <= KNOWN_WEIGHT for row in rows):
            return
        try:
            await self.report(f"{object}.Weight = {format_number(weight)}")
        except RemoteError as error:  # things of its type cannot weigh as much
            await task.progress(fraction, note=f"{object} weighs {weight:g} kg, which cannot be put on the map: {error}")

    async def _run_and_record(self, command: Coroutine[object, object, CommandDone]) -> CommandDone:
        """Carry out a command, and record the observed positions and weights."""
        result = await command
        self._record(result.object_states)
        return result

    def _forget(self, object: str) -> None:
        self._last_observations.pop(object, None)
        self._weights.pop(object, None)

    def _record(self, object_states: Iterable[ObjectState]) -> None:
        states = {object_state.object: object_state for object_state in object_states}
        self._last_observations.update(states)
        self._weights.update(weights_of(states.values()))

    async def _situation(
        self, state: RobotState | None, object: str, object_states: Iterable[ObjectState], *, on_first: bool = False
    ) -> str:
        """The situation: the known state of the thing and of the robot. `on_first`: the support of the thing comes before its position.

        A silent robot may have continued its work, so earlier observations are left out.
        """
        if self._link.silent:
            return self._out_of_order()
        self._record(object_states)
        parts: list[str] = []
        thing = self._last_observations.get(object)
        if state is not None and state.holding == object:
            parts.append(f"{object} isHeldBy {self.name}")
        elif thing is not None:
            parts += [
                f"{object}.Position{axis} = {format_number(value)}" for axis, value in zip("XYZ", (thing.x, thing.y, thing.z), strict=True)
            ]
            if thing.support is not None:
                parts.insert(0 if on_first else 3, f"{object} isOn {thing.support}")
            if thing.container is not None:
                parts.insert(0 if on_first else 3, f"{object} isIn {thing.container}")
            if thing.support is None and thing.container is None:
                parts.append(f"NOT {object} isHeldBy {self.name}")
        if state is not None:
            try:
                parts += await self.own_position(state)
            except RemoteError:  # what happened to the thing is to be reported all the same
                parts += self.own_pose(state)
        if state is None or state.faults or not self._link.connected:
            parts.append(self._out_of_order())
        return " AND ".join(parts)


def read_spot(object: str, formula: Formula | None) -> Spot:
    """The position of a thing that a formula states."""
    support_name: str | None = None
    container_name: str | None = None
    values: dict[str, float] = {}
    for part in conjuncts(formula) if formula is not None else ():
        match part:
            case Relation(relation="isOn", arguments=(Name(name=thing), Name(name=support))) if thing == object:
                support_name = support
            case Relation(relation="isIn", arguments=(Name(name=thing), Name(name=container))) if thing == object:
                container_name = container
            case Comparison(left=Attribute(owner=Name(name=thing), path=path), operator="=", right=Number(value=value)) if thing == object:
                values[path] = value
    position = (values["PositionX"], values["PositionY"]) if {"PositionX", "PositionY"} <= values.keys() else None
    return Spot(support=support_name, container=container_name, position=position)
