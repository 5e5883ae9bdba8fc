"""What the drivers of simulated devices have in common: the robot link, how the device is, what it is offered with, what it costs.

All that a driver knows of its device comes over the robot link, all it knows of the world from the Repository.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable, Coroutine
from typing import TypeVar

from somrs.devices.simulator.link.commands import CommandDone, Fault, RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import RobotLink
from somrs.entish.formula import Number
from somrs.errors import DeviceError, RemoteError
from somrs.ontology.types import Value
from somrs.service_manager.sdk.device import Device, Task
from somrs.service_manager.sdk.orders import Refusal
from somrs.service_manager.sdk.values import term

DEFAULT_PRICE = "5 EUR"
DEFAULT_SPEED = 0.5
"""Of a robot whose map says nothing of it, m/s."""
DRIVING_FACTOR = 1.25
"""How much longer a way takes than at full speed, for turning, starting and stopping."""
DISABLING = {Fault.DRIVE: "its drive is dead", Fault.GRIPPER: "its gripper is stuck"}
REPORTING = 2.0
"""Seconds between two reports while it drives."""
NOTICING = 1.0
"""Seconds between two looks at where an idle device is; it has to be at the same place twice."""
STANDING = 0.005
"""What is nearer than this, in m, or twice that in rad, is no other place."""
MOST_LOSSES = 5
"""How often the link may be lost in a piece of work."""

T = TypeVar("T")
Pose = tuple[float, float, float]

log = logging.getLogger(__name__)


class SimulatedDevice(Device):
    """A device at the other end of a robot link."""

    features: tuple[str, ...] = ("OperationRange", "Payload", "Speed", "Price")
    """What the map says of the device that its services are offered with."""
    price_per_metre: float = 0.0
    """What it asks for each metre that it drives, besides its Price on the map."""
    silence: float = 6.0
    """Seconds of the simulator without any word of the device after which it is taken for silent."""
    reconnect_timeout: float = 6.0
    """Seconds for which a link that was lost is waited for; it is tried again every other second."""

    mobile: bool = True
    """Whether it may be elsewhere than it was."""

    async def open(self) -> None:
        host, _, port = (self.simulator or "").rpartition(":")
        if not host or not port.isdigit():
            raise DeviceError(f"{self.name} needs a simulator, given as host:port, and not {self.simulator!r}")
        self._working = 0
        self._reported_pose: Pose | None = None
        self._known_broken = await self.map.holds(f"{self.name}.Working = FALSE")
        self._link = RobotLink(host, int(port), self.name, silence=self.silence, on_state=self._notice_fault)
        await self._link.connect()
        await self._link.status()
        self.attributes = {name: value for name in self.features for value in await self._feature(name)}
        self._noticing = asyncio.create_task(self._notice())

    async def close(self) -> None:
        self._noticing.cancel()
        await asyncio.wait({self._noticing})
        await self._link.close()

    def _notice_fault(self, state: RobotState) -> None:
        """Say at once that it broke."""
        if not self._known_broken and DISABLING.keys() & set(state.faults):
            self.observed(self._out_of_order())

    def _out_of_order(self) -> str:
        """That it does not work, as a part of a formula that will be told."""
        self._known_broken = True
        return f"{self.name}.Working = FALSE"

    async def _notice(self) -> None:
        """Say where the device is when that changed though it did not work: it made way for another, say; and that it works again."""
        last_pose: Pose | None = None
        while True:
            await asyncio.sleep(NOTICING)
            state = self._link.state
            idle = self._link.connected and not self._link.silent and not self._working and state is not None and state.activity is None
            pose = _pose(state) if idle and state is not None else None
            if state is not None and pose is not None and last_pose is not None and _is_same_pose(pose, last_pose):
                try:
                    await self._notice_idle(state, pose)
                except RemoteError as error:
                    log.warning("%s cannot read on the map how it is: %s", self.name, error)
            last_pose = pose

    async def _notice_idle(self, state: RobotState, pose: Pose) -> None:
        if self.mobile and not _is_same_pose(pose, self._reported_pose or await self._pose_on_map()):
            self.observed(" AND ".join(self._own_pose(state)))
        if self._known_broken and not state.faults:
            if await self.map.holds(f"{self.name}.Working = FALSE"):
                self.observed(f"{self.name}.Working = TRUE")
            self._known_broken = False

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
        """Its state now. Raises Refusal when it cannot work."""
        if self._link.silent or not await self._link.wait_reconnected(self.reconnect_timeout):
            raise Refusal(f"{self.name} does not answer")
        try:
            state = (await self.retry_when_link_lost(self._link.status)).state
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}") from None
        if state.faults:
            broken = " and ".join(DISABLING.get(fault, fault) for fault in state.faults)
            raise Refusal(f"{self.name} is out of order: {broken}")
        return state

    async def retry_when_link_lost(self, work: Callable[[], Awaitable[T]]) -> T:
        """Do it; when the link is lost meanwhile, and made again soon, do it again. Robots stop, and keep hold of what they hold, when
        their links are lost; so the work has to begin with how things are. Raises RobotGaveUp."""
        self._working += 1
        try:
            for _ in range(MOST_LOSSES):
                try:
                    return await work()
                except RobotGaveUp as failure:
                    if failure.reason != "link-lost" or not await self._link.wait_reconnected(self.reconnect_timeout):
                        raise
            return await work()
        finally:
            self._working -= 1

    async def price(self, task: Task, way: float) -> float | str:
        """Its Price on the map, and what it asks for a way of so many metres."""
        rows = await task.map.query(f"{self.name}.Price = ?Price")
        price = rows[0]["Price"] if rows else DEFAULT_PRICE
        if not self.price_per_metre:
            return price
        amount = term(str(price))
        assert isinstance(amount, Number), "a price is a number"
        return f"{amount.value + self.price_per_metre * way:.2f} {amount.unit or 'EUR'}"

    async def driving_time(self, task: Task, way: float) -> float:
        """Seconds for a way of so many metres."""
        rows = await task.map.query(f"{self.name}.Speed = ?Speed")
        speed = term(str(rows[0]["Speed"])) if rows else None
        metres_per_second = speed.value if isinstance(speed, Number) and speed.value > 0 else DEFAULT_SPEED
        return DRIVING_FACTOR * way / metres_per_second

    async def _driving(self, task: Task, drive: Coroutine[object, object, CommandDone], begin: float, end: float, note: str) -> CommandDone:
        """Drive, and report from time to time how far it is: by the time that such ways take."""
        driving = asyncio.ensure_future(drive)
        fraction = begin
        try:
            while True:
                await task.progress(fraction, note=note)
                finished, _ = await asyncio.wait({driving}, timeout=REPORTING)
                if finished:
                    return driving.result()
                fraction += (end - fraction) / 5
        finally:
            driving.cancel()

    def _own_pose(self, state: RobotState) -> list[str]:
        """Where the device is, in parts of a formula that will be told."""
        self._reported_pose = _pose(state)
        pose = {"PositionX": state.x, "PositionY": state.y, "RotationZ": state.yaw}
        return [f"{self.name}.{path} = {format_number(value)}" for path, value in pose.items()]


def _pose(state: RobotState) -> Pose:
    return state.x, state.y, state.yaw


def _is_same_pose(first: Pose, second: Pose) -> bool:
    """Whether nobody would call them different places."""
    if not all(map(math.isfinite, second)):
        return False
    return math.dist(first[:2], second[:2]) < STANDING and abs(math.remainder(first[2] - second[2], math.tau)) < 2 * STANDING


async def is_of_type(task: Task, object: str, kind: str) -> bool:
    try:
        return await task.map.holds(f"?It: {kind} = {object}")
    except RemoteError:  # a Repository does not take a formula that its types rule out
        return False


def format_number(value: float) -> str:
    """To the millimetre, or a thousandth of a radian, as Entish writes numbers."""
    assert math.isfinite(value), "physics that made no sense would have ended"
    return str(Number(round(value, 3) + 0.0))
