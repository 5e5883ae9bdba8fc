"""A body in the simulator of SO-MRS: it drives and grips by the robot link, and senses what the link reports."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from typing import Any

from somrs.adapters.arcos.simulated.body import Place, point_range
from somrs.adapters.arcos.simulated.firmware import Firmware
from somrs.adapters.arcos.simulated.server import SimulatedRobot, serving_tcp
from somrs.devices.link_security import link_credentials
from somrs.devices.simulator.link.commands import CommandDone, Fault, RobotState, Scan
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.lines import Mover
from somrs.devices.simulator.link.link import OperatorLink, RobotLink, link_address
from somrs.devices.simulator.link.reaching import put_ahead, things_ahead

log = logging.getLogger(__name__)

WATCHDOG = 0.5
"""The watchdog of these robots, s: they stop sooner than from the factory, and so may drive faster."""
PERIOD = 0.1
"""Seconds between two velocities that are sent."""
LASTS = 0.5
"""Seconds for which a velocity holds: the simulated wheels stop when this program does."""
SCAN = Scan(rays=90, range=2.5)
"""What sonar would hear: the nearest things around."""
SCAN_PERIOD = 0.2
"""Seconds between two scans."""
TURNING_BACK = 0.3
"""Seconds until the simulator has heard that the robot drives the other way: what it says until then is of the way before."""
STILL_BLOCKED = 0.5
"""Seconds for which the wheels count as blocked after the simulator said that something is in the way."""


class World:
    """Where the things are, as the simulator tells its operator: what the beams of grippers sense."""

    def __init__(self, link: OperatorLink) -> None:
        self._link = link
        self._movers: tuple[Mover, ...] = ()
        self.things: dict[str, tuple[float, float]] = {}
        """Their points, by name."""

    async def run(self) -> None:
        """Follow the poses, until cancelled."""
        while True:
            try:
                async for poses in self._link.poses(rate=10):
                    if poses.movers is not None:
                        self._movers, self.things = poses.movers, {}
                    values = iter(poses.values)
                    for index in poses.moved:
                        mover = self._movers[index]
                        pose = [next(values) for _ in range(mover.numbers)]
                        if mover.is_thing:
                            self.things[mover.name] = pose[0], pose[1]
            except RobotGaveUp as failure:
                log.info("the simulator is gone, and is waited for: %s", failure)
                await asyncio.sleep(1.0)


class LinkBody:
    """The body of a robot of the simulator, which takes part in traffic from outside of it."""

    def __init__(self, link: RobotLink, world: World, state: RobotState) -> None:
        self._link, self._world = link, world
        self._velocities = (0.0, 0.0)
        self._direction = 0.0
        """1: it drives ahead, or did last; -1: back."""
        self._sent_velocities = (0.0, 0.0)
        self._velocity_age = 0.0
        self._blocked_for = self._turning_back = 0.0
        self._first_state = state
        self._handling: asyncio.Task[None] | None = None
        self._charging: asyncio.Task[None] | None = None
        self._driving: set[asyncio.Task[None]] = set()
        self._echoes: tuple[tuple[float, float], ...] = ()
        """The points of the last scan."""
        self.contact: str | None = None
        self._was_dead = False
        self.on_mended: Callable[[], None] = _nothing
        """Is called when somebody has mended the drive."""

    @property
    def _state(self) -> RobotState:
        return self._link.state or self._first_state

    @property
    def place(self) -> Place:
        return Place(x=self._state.x, y=self._state.y, yaw=self._state.yaw)

    def has_contact(self) -> bool:
        """Whether its radio works."""
        return self._link.connected and not self._link.silent

    @property
    def is_blocked(self) -> bool:
        return self._blocked_for > 0 or Fault.DRIVE in self._state.faults

    @property
    def charge(self) -> float:
        return (self._state.charge if self._state.charge is not None else 100.0) / 100

    @property
    def has_charger(self) -> bool:
        return self._charging is not None and not self._charging.done()

    @property
    def is_holding(self) -> bool:
        return self._state.holding is not None

    @property
    def is_handling(self) -> bool:
        return self._handling is not None and not self._handling.done()

    @property
    def has_thing(self) -> bool:
        return self._state.holding is not None or bool(things_ahead(self._state, self._world.things))

    def drive(self, forward: float, turning: float) -> None:
        if forward * self._direction < 0:
            self._blocked_for, self._turning_back = 0.0, TURNING_BACK
        self._direction = math.copysign(1.0, forward) if forward else self._direction
        self._velocities = forward, turning

    def echo(self, x: float, y: float, heading: float) -> float:
        place = self.place
        cosine, sine = math.cos(place.yaw), math.sin(place.yaw)
        start = place.x + x * cosine - y * sine, place.y + x * sine + y * cosine
        return min((point_range(start, place.yaw + heading, point) for point in self._echoes), default=math.inf)

    async def listen(self) -> None:
        """Keep measuring what is around, until cancelled."""
        while True:
            with contextlib.suppress(RobotGaveUp):
                done = await self._link.scan(SCAN)
                pose, rays = done.state, enumerate(done.ranges)
                bearings = ((pose.yaw + (number + 0.5) * math.tau / SCAN.rays - math.pi, distance) for number, distance in rays)
                self._echoes = tuple(
                    (pose.x + distance * math.cos(bearing), pose.y + distance * math.sin(bearing))
                    for bearing, distance in bearings
                    if distance is not None
                )
            await asyncio.sleep(SCAN_PERIOD)

    def grip(self) -> None:
        things = things_ahead(self._state, self._world.things)
        if things and self._state.holding is None:
            self._handling = asyncio.create_task(self._try(self._link.grip(things[0])))

    def release(self) -> None:
        if self._state.holding is not None:
            self._handling = asyncio.create_task(self._try(put_ahead(self._link)))

    def set_charging(self, is_charging: bool) -> None:
        if is_charging and not self.has_charger:
            self._charging = asyncio.create_task(self._try(self._link.charge()))
        elif not is_charging and self._charging is not None:
            self._charging.cancel()

    def advance(self, duration: float) -> None:
        self._velocity_age += duration
        was_dead, self._was_dead = self._was_dead, Fault.DRIVE in self._state.faults
        if was_dead and not self._was_dead:
            self.on_mended()
        self._turning_back = max(0.0, self._turning_back - duration)
        is_obstructed = self._state.obstructed and not self._turning_back
        self._blocked_for = STILL_BLOCKED if is_obstructed else max(0.0, self._blocked_for - duration)
        if self.is_handling or self.has_charger or self._velocity_age < PERIOD:
            return
        if self._velocities != (0.0, 0.0) or self._sent_velocities != (0.0, 0.0):
            self._velocity_age, self._sent_velocities = 0.0, self._velocities
            task = asyncio.create_task(self._try(self._link.set_velocity(*self._velocities, LASTS)))
            self._driving.add(task)
            task.add_done_callback(self._driving.discard)

    async def _try(self, command: Coroutine[Any, Any, CommandDone]) -> None:
        try:
            await command
        except RobotGaveUp as failure:
            if failure.reason != "stopped":
                log.info("%s: %s", self._link.robot, failure)


def _nothing() -> None:
    """Do nothing."""


@contextlib.asynccontextmanager
async def simulated_robots(robots: Mapping[str, int], simulator: str) -> AsyncIterator[dict[str, str]]:
    """Give robots of the simulator at an address ARCOS controllers, each behind a TCP port of this computer; port 0: any. Yields the
    addresses of the ports, by robot, for the settings of the adapter."""
    host, port, map = link_address(simulator)
    credentials = link_credentials(simulator, None)
    async with contextlib.AsyncExitStack() as stack:
        operator = await stack.enter_async_context(OperatorLink(host, port, map, credentials))
        world = World(operator)
        following = asyncio.create_task(world.run())
        stack.callback(following.cancel)
        addresses = {}
        for name, tcp_port in robots.items():
            link = RobotLink(host, port, name, rate=20, map=map, outside=True, credentials=credentials)
            await stack.enter_async_context(link)
            body = LinkBody(link, world, (await link.status()).state)
            listening = asyncio.create_task(body.listen())
            stack.callback(listening.cancel)
            robot = SimulatedRobot(Firmware(body, name=name, watchdog=WATCHDOG), has_contact=body.has_contact)
            body.on_mended = robot.firmware.switch_motors_on
            addresses[name] = await stack.enter_async_context(serving_tcp(robot, tcp_port))
        yield addresses


async def serve_simulated(robots: Mapping[str, int], simulator: str) -> None:
    """Run `simulated_robots` until cancelled."""
    async with simulated_robots(robots, simulator) as addresses:
        for name, address in addresses.items():
            log.info("%s: ARCOS at %s", name, address)
        await asyncio.get_running_loop().create_future()
