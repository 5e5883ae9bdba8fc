"""The common part of the drivers of simulated devices: the robot link, the device's state, the attributes of its offers, and its prices.

A driver gets its device's state over the robot link, and its knowledge of the world from the Repository.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from contextlib import AsyncExitStack
from typing import TypeVar

from somrs.devices.link_security import link_credentials
from somrs.devices.simulator.drivers.outage import Outage
from somrs.devices.simulator.link.command_link import CommandLink
from somrs.devices.simulator.link.commands import CommandDone, Fault, ObjectState, RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.lines import Legs, PathStop
from somrs.devices.simulator.link.link import RobotLink, link_address
from somrs.entish.formula import Comparison, Formula, Number, Truth, conjuncts
from somrs.errors import DeviceError, RemoteError, UsageError
from somrs.ontology.types import Value
from somrs.service_manager.sdk.device import Device, Task
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from somrs.service_manager.sdk.values import term

_DEFAULT_PRICE = "5 EUR"
DEFAULT_SPEED = 0.5
"""Speed of a robot for which the map states none, m/s."""
DRIVING_FACTOR = 1.25
"""Ratio of driving time to the time at full speed, for turning, starting and stopping."""
_DISABLING = {Fault.DRIVE: "its drive is dead", Fault.GRIPPER: "its gripper is stuck"}
REPORTING = 2.0
"""Seconds between two progress reports while the robot drives."""
NOTICING = 1.0
"""Seconds between two checks of the pose of an idle device. It is reported if it is the same twice."""
STANDING = 0.005
"""Poses count as equal within this distance in m, and twice this value in rad."""
MOST_LOSSES = 5
"""How often the link may be lost during an operation."""

T = TypeVar("T")
Pose = tuple[float, float, float]


class SimulatedDevice(Device):
    """A device that is controlled over a robot link."""

    features: tuple[str, ...] = ("OperationRange", "Payload", "Speed", "Price")
    """The attributes of the device on the map that its offers state."""
    price_per_metre: float = 0.0
    """Price per metre of driving, in addition to its Price on the map."""
    silence: float = 6.0
    """Seconds, on the simulator's clock, without a message from the device after which it counts as silent."""
    reconnect_timeout: float = 6.0
    """Seconds to wait until a lost link is connected again; attempts are at most 2 s apart."""

    mobile: bool = True
    """Whether the device can change its position."""
    driven_outside: bool = False
    """Whether the robot is only a body in the simulator, which is driven by a program of its own, and not by traffic."""

    def __init__(self, name: str, simulator: str | None = None) -> None:
        super().__init__(name, simulator)
        self._opened = AsyncExitStack()
        """What `close` has to end, the last first; `open` may have failed on the way."""

    async def open(self) -> None:
        link = self._make_link()
        self._working = 0
        self._reported_pose: Pose | None = None
        self._known_broken = await self.map.holds(f"{self.name}.Working = FALSE")
        self._link = link
        await self._opened.enter_async_context(link)
        await self._link.status()
        self.attributes = {name: value for name in self.features for value in await self._feature(name)}
        self.keep_doing(self._notice())

    def _make_link(self) -> CommandLink:
        """The link to the robot. Raises DeviceError."""
        try:
            host, port, map_name = link_address(self.simulator or "")
            credentials = link_credentials(self.simulator or "")
        except UsageError as error:
            raise DeviceError(f"{self.name} needs a simulator: {error}") from None
        return RobotLink(
            host,
            port,
            self.name,
            silence=self.silence,
            on_state=self._notice_state,
            map=map_name,
            credentials=credentials,
            outside=self.driven_outside,
        )

    async def close(self) -> None:
        await self._opened.aclose()

    def keep_doing(self, work: Coroutine[object, object, None]) -> None:
        """Do something beside the services until the device is closed."""
        self._opened.push_async_callback(_end, asyncio.create_task(work))

    @property
    def idle_state(self) -> RobotState | None:
        """The state of the device while it answers and does nothing; None otherwise."""
        state = self._link.state
        is_idle = self._link.connected and not self._link.silent and not self._working
        return state if is_idle and state is not None and state.activity is None else None

    def _notice_state(self, state: RobotState) -> None:
        """Report a disabling fault at once."""
        if not self._known_broken and _DISABLING.keys() & set(state.faults):
            self.observed(self._out_of_order())

    def _out_of_order(self) -> str:
        """The formula that the device does not work; records that it has been reported."""
        self._known_broken = True
        return f"{self.name}.Working = FALSE"

    async def _notice(self) -> None:
        """Report a changed pose of the idle device, for instance after it made way for another robot, and that it works again."""
        last_pose: Pose | None = None
        outage = Outage(self.name, "read its state on the map")
        while True:
            await asyncio.sleep(NOTICING)
            state = self.idle_state
            pose = _pose(state) if state is not None else None
            if state is not None and pose is not None and last_pose is not None and _is_same_pose(pose, last_pose):
                with outage:
                    await self._notice_idle(state, pose)
            last_pose = pose

    async def _notice_idle(self, state: RobotState, pose: Pose) -> None:
        if self.mobile and not _is_same_pose(pose, self._reported_pose or await self._pose_on_map()):
            self.observed(" AND ".join(await self.own_position(state)))
        if self._known_broken and not state.faults:
            if await self.map.holds(f"{self.name}.Working = FALSE"):
                self.observed(f"{self.name}.Working = TRUE")
            self._known_broken = False

    async def own_position(self, state: RobotState) -> list[str]:
        """Where the device is, and where it is no longer, as parts of a formula."""
        return self.own_pose(state)

    async def _pose_on_map(self) -> Pose:
        rows = await self.map.query(f"{self.name}.PositionX = ?X AND {self.name}.PositionY = ?Y AND {self.name}.RotationZ = ?Yaw", limit=1)
        terms = [term(str(row[name])) for row in rows for name in ("X", "Y", "Yaw")]
        x, y, yaw = (number.value if isinstance(number, Number) else math.inf for number in terms or (None, None, None))
        return x, y, yaw

    async def _feature(self, name: str) -> list[Value]:
        rows = await self.map.query(f"{self.name}.{name} = ?Feature", limit=1)
        terms = [term(str(row["Feature"])) for row in rows]
        return [number.value for number in terms if isinstance(number, Number)]  # in the attribute's own unit

    async def check_working(self) -> RobotState:
        """Return the device's state. Raises Refusal when it cannot work."""
        if self._link.silent or not await self._link.wait_reconnected(self.reconnect_timeout):
            raise Refusal(f"{self.name} does not answer", not_now=True)
        try:
            state = (await self.retry_when_link_lost(self._link.status)).state
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}", not_now=True) from None
        if state.faults:
            broken = " and ".join(_DISABLING.get(fault, fault) for fault in state.faults)
            raise Refusal(state.trouble or f"{self.name} is out of order: {broken}", not_now=True)
        return state

    def is_out_of_order(self, failure: RobotGaveUp) -> bool:
        """Whether the device cannot work any more after a command that it gave up."""
        has_faults = failure.state is not None and bool(failure.state.faults)
        return self._link.silent or not self._link.connected or has_faults

    def failure_situation(self, failure: RobotGaveUp) -> str:
        """Where the device is after a command that it gave up, and whether it works."""
        pose = self.own_pose(failure.state) if failure.state is not None and not self._link.silent else []
        is_broken = self.is_out_of_order(failure) or not pose
        return " AND ".join([*pose, *([self._out_of_order()] if is_broken else [])])

    @property
    def lost_link_patience(self) -> float:
        """Seconds after which work fails whose robot cannot be reached."""
        return self.reconnect_timeout

    async def retry_when_link_lost(self, work: Callable[[], Awaitable[T]]) -> T:
        """Run `work`, and run it again if the link is lost and soon connected again. Raises RobotGaveUp.

        When its link is lost, a robot stops and keeps what it holds, so `work` must start from the current state.
        """
        self._working += 1
        try:
            for _ in range(MOST_LOSSES):
                try:
                    return await work()
                except RobotGaveUp as failure:
                    if failure.reason != "link-lost" or not await self._link.wait_reconnected(self.lost_link_patience):
                        raise
            return await work()
        finally:
            self._working -= 1

    async def find_legs(self, task: Task, *stops: PathStop) -> Legs:
        """The way through the stops in the situation in which the service is to start."""
        situation = str(task.situation) if task.situation is not None else None
        return await self.retry_when_link_lost(lambda: self._link.legs(*stops, situation=situation))

    async def legs_through(self, task: Task, *stops: PathStop) -> Legs:
        """The way through the stops in the situation in which the service is to start. Demands that the doors on it are open throughout."""
        legs = await self.find_legs(task, *stops)
        for door in (*legs.shut, *legs.open):
            task.demand(f"{door}.Open = TRUE", throughout=True)
        return legs

    async def price(self, task: Task, way: float = 0.0) -> float | str:
        """The device's Price on the map, plus the price of driving `way` metres."""
        rows = await task.map.query(f"{self.name}.Price = ?Price")
        price = rows[0]["Price"] if rows else _DEFAULT_PRICE
        if not self.price_per_metre:
            return price
        amount = term(str(price))
        assert isinstance(amount, Number), "a price is a number"
        return f"{amount.value + self.price_per_metre * way:.2f} {amount.unit or 'EUR'}"

    async def driving_time(self, task: Task, way: float) -> float:
        """Seconds to drive `way` metres."""
        rows = await task.map.query(f"{self.name}.Speed = ?Speed")
        speed = term(str(rows[0]["Speed"])) if rows else None
        metres_per_second = speed.value if isinstance(speed, Number) and speed.value > 0 else DEFAULT_SPEED
        return DRIVING_FACTOR * way / metres_per_second

    async def _driving(self, task: Task, drive: Coroutine[object, object, CommandDone], begin: float, end: float, note: str) -> CommandDone:
        """Run a drive, and report progress at intervals. The fraction approaches `end` with time; it is not measured."""
        driving = asyncio.ensure_future(drive)
        fraction = begin
        try:
            while True:
                state = self._link.state
                hindrance = state.hindrance if state is not None else None
                words = f"waits: {hindrance}" if hindrance else f"{note}; {state.remark}" if state is not None and state.remark else note
                await task.progress(fraction, note=words, waits=hindrance is not None)
                finished, _ = await asyncio.wait({driving}, timeout=REPORTING)
                if finished:
                    return driving.result()
                if hindrance is None:
                    fraction += (end - fraction) / 5
        finally:
            driving.cancel()

    def own_pose(self, state: RobotState) -> list[str]:
        """The device's pose, and the charge of its battery, as parts of a formula; records that the pose has been reported."""
        self._reported_pose = _pose(state)
        values = {"PositionX": state.x, "PositionY": state.y, "RotationZ": state.yaw}
        if state.z is not None:
            values["PositionZ"] = state.z
        if state.charge is not None:
            values["Charge"] = round(state.charge, 1)
        return [f"{self.name}.{path} = {format_number(value)}" for path, value in values.items()]


def _pose(state: RobotState) -> Pose:
    return state.x, state.y, state.yaw


def _is_same_pose(first: Pose, second: Pose) -> bool:
    """Whether two poses are equal within `STANDING`."""
    if not all(map(math.isfinite, second)):
        return False
    return math.dist(first[:2], second[:2]) < STANDING and abs(math.remainder(first[2] - second[2], math.tau)) < 2 * STANDING


async def _end(work: asyncio.Task[None]) -> None:
    work.cancel()
    await asyncio.wait({work})


async def is_of_type(task: Task, object: str, kind: str) -> bool:
    try:
        return await task.map.holds(f"?It: {kind} = {object}")
    except RemoteError:  # the Repository rejects a formula that contradicts its types
        return False


def weights_of(object_states: Iterable[ObjectState]) -> dict[str, float]:
    """The weights that were measured, kg, by the names of the things."""
    return {state.object: round(state.weight, 3) for state in object_states if state.weight is not None}


def format_number(value: float) -> str:
    """Format a number in Entish, rounded to three digits: a millimetre, or a thousandth of a radian."""
    assert math.isfinite(value), "the simulation ends when its physics diverges"
    return str(Number(round(value, 3) + 0.0))


def was_open(name: str, situation: Formula) -> bool:
    """Whether a door or container was open in a situation that is to be restored. Raises ServiceFailed if the situation does not say so."""
    values = [part.right.value for part in conjuncts(situation) if isinstance(part, Comparison) and isinstance(part.right, Truth)]
    if not values:
        raise ServiceFailed(f"{situation} does not say whether {name} was open")
    return values[0]
