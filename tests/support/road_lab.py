"""Robots of any make in the traffic of a laboratory, all in memory and in virtual time: their links, their programs in traffic, traffic
itself, and bodies that drive from waypoint to waypoint."""

from __future__ import annotations

import asyncio
import math
import selectors
from collections.abc import Coroutine, Iterable
from pathlib import Path
from random import Random
from typing import Any, TypeVar

from somrs.devices.road.link import RoadLink
from somrs.devices.road_robot import CarryingRobot, RobotFailed, Way, Waypoint
from somrs.kernel.component import Answered, Ask, Effect, Input, Notified, Received, Send, SetTimer, Started, TimerFired
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.repository.update import update_outcome
from somrs.traffic.component import Traffic
from somrs.traffic.layout import OpenBuilding, lay_out
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.roadmap import RobotKind
from somrs.traffic.robot_program import RobotProgram
from somrs.traffic.state import PlanTraffic
from tests.support.robot_lab import SITE, site

T = TypeVar("T")

STEP = 0.1
"""Seconds between two states of a body."""
DELAY = 0.01
"""Seconds that a message takes."""
LONGEST = 3600.0
"""Seconds of virtual time for a test."""


class _Selector(selectors.DefaultSelector):
    """Waits for nothing: time is moved on."""

    now = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        assert timeout is not None, "nothing will ever happen"
        self.now += max(timeout, 0.0)
        return super().select(0)


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop whose clock goes on when there is nothing to do."""

    def __init__(self) -> None:
        self._clock = _Selector()
        super().__init__(self._clock)

    def time(self) -> float:
        return self._clock.now


def in_virtual_time(test: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end."""

    async def limited() -> T:
        async with asyncio.timeout(LONGEST):
            return await test

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(limited())


class LabRobot(CarryingRobot):
    """A robot that drives at a steady speed, and takes things. `holds`: the thing in its gripper, whatever its program knows.

    `stopping`: the seconds that it takes to stand still. `floor`: whether it can put things down where it stands. `refused`: the supports
    on which it can put nothing. `senses`: whether it has a sensor in its gripper.
    """

    speed, stopping, handling = 0.5, 0.0, 2.0
    floor, senses = True, True
    refused: frozenset[str] = frozenset()

    def __init__(self, lab: RoadLab, name: str) -> None:
        super().__init__(name)
        self.data = lab.folder
        self.lab, self.holds, self._base, self._is_halting = lab, None, dict[int, Waypoint](), False
        solid = lab.map.objects[name].values
        self.x, self.y = (float(solid[f"Position{axis}"]) for axis in "XY")
        self.whole_map = lab.whole_map
        self._drive_task: asyncio.Task[None] | None = None
        self._number = 0
        self.ways_told: list[Way] = []
        self.handled: list[str] = []

    holds: str | None

    @property
    def link(self) -> RoadLink:
        return self._road_link

    def _notice_state(self, state: object) -> None:
        """No services are offered."""

    def say(self) -> None:
        """Say where it is."""
        if self.link.traveller.connected.is_set() or not self.link.traveller._says_whether_heard:
            self.located(self.x, self.y, 0.0, 0.0)

    def cut_off(self) -> None:
        """Lose the connection: it drives on as it was told."""
        self.heard(False)

    def return_back(self) -> None:
        """Be there again, and say where it is."""
        self.heard(True)
        self.say()
        self.passed(self._number)

    async def stand_by(self) -> None:
        while True:
            self.say()
            await asyncio.sleep(STEP)

    async def follow(self, way: Way) -> None:
        """What was released stays released, until it has halted."""
        self.ways_told.append(way)
        self._number = max(self._number, way[0].number)
        released = {waypoint.number: waypoint for waypoint in way if waypoint.released}
        self._base = {number: point for number, point in {**released, **self._base}.items() if number > self._number}
        if self._drive_task is None or self._drive_task.done():
            self._drive_task = asyncio.create_task(self._drive())

    async def _drive(self) -> None:
        while (goal := self._base.get(self._number + 1)) is not None:
            while (distance := math.dist((self.x, self.y), (goal.x, goal.y))) > 1e-6:
                await asyncio.sleep(STEP)
                if self._is_halting:
                    continue
                share = min(1.0, self.speed * STEP / distance)
                self.x, self.y = self.x + share * (goal.x - self.x), self.y + share * (goal.y - self.y)
                self.say()
            self._number = goal.number
            if self.link.connected:
                self.passed(goal.number)

    async def halt(self) -> None:
        self._base, self._is_halting = {}, True
        if self._drive_task is not None:
            self._drive_task.cancel()
            await asyncio.wait({self._drive_task})
        await asyncio.sleep(self.stopping)
        self._is_halting = False

    async def interrupt(self) -> None:
        await asyncio.sleep(self.stopping)

    async def pick(self, thing: str, support: str) -> None:
        await asyncio.sleep(self.handling)
        self.holds = thing
        self.handled.append(f"pick {thing}")

    async def drop(self, thing: str, support: str) -> None:
        await asyncio.sleep(self.handling)
        if support in self.refused:
            raise RobotFailed(f"{support} is full")
        self.holds = None
        self.handled.append(f"drop {thing} on {support}")

    async def put_down(self, thing: str) -> tuple[float, float, float, str]:
        if not self.floor:
            return await super().put_down(thing)
        self.holds = None
        self.handled.append(f"put down {thing}")
        return self.x + 0.4, self.y, 0.0, ""

    async def charge_at(self, charger: str) -> None:
        await asyncio.sleep(self.handling)


class RoadLab:
    """A site with robots of any make. `robots`: their names."""

    def __init__(self, folder: Path, text: str = SITE, robots: Iterable[str] = ("Robot1", "Robot2")) -> None:
        loaded, self.map = site(text)
        self.ontology: Ontology = loaded.ontology
        self.folder = folder
        roadmap = lay_out(OpenBuilding(self.map, self.ontology, [0.0]), [RobotKind(0.3)])
        self.traffic, self._planner = Traffic("traffic", roadmap), TrafficPlanner(roadmap, Random(0))
        self.robots = {name: LabRobot(self, name) for name in robots}
        self.programs: dict[str, RobotProgram] = {}
        self._timers: dict[tuple[str, object], asyncio.TimerHandle] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    async def whole_map(self, *, is_current: bool = True) -> tuple[Map, Ontology]:
        await asyncio.sleep(0)
        return self.map, self.ontology

    def report(self, situation: str) -> None:
        """Put something on the map."""
        outcome = update_outcome(self.map, self.ontology, UpdateMap(situation=situation))
        assert not outcome.broken, outcome.broken
        self.map = outcome.map

    async def start(self) -> None:
        """Begin, and return when all robots take part in traffic."""
        self.handle("traffic", Started("traffic"))
        for name in self.robots:
            await self.start_robot(name)
        while not all(name in self.traffic.state.robots for name in self.robots):
            await asyncio.sleep(STEP)

    async def start_robot(self, name: str) -> LabRobot:
        robot = self.robots[name]
        self.programs[name] = RobotProgram(name, name, "traffic", f"life-{robot.road.new_name()}")
        robot.road.tell = lambda notice: self.handle(name, Notified(notice))
        self._keep(robot.stand_by())
        self.handle(name, Started(name))
        await robot.link.__aenter__()
        return robot

    def handle(self, address: str, event: Input) -> None:
        component = self.traffic if address == "traffic" else self.programs[address]
        for effect in component.handle(event, asyncio.get_running_loop().time()):
            self._perform(address, effect)

    def _perform(self, address: str, effect: Effect) -> None:
        loop = asyncio.get_running_loop()
        match effect:
            case Send(message):
                loop.call_later(DELAY, self.handle, message.header.recipient, Received(message))
            case SetTimer(timer, due):
                if (earlier := self._timers.pop((address, timer), None)) is not None:
                    earlier.cancel()
                if due is not None:
                    self._timers[address, timer] = loop.call_at(due, self.handle, address, TimerFired(timer))
            case Ask(question=question, task=PlanTraffic() as problem):
                loop.call_soon(self.handle, address, Answered(question, self._planner.plan(problem)))
            case Ask(question=question, task=task):
                self._keep(self._carry_out(address, question, task))

    async def _carry_out(self, name: str, question: Any, task: object) -> None:
        self.handle(name, Answered(question, await self.robots[name].road.carry_out(task)))

    def _keep(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def held(self, name: str) -> tuple[str, ...]:
        """The places that traffic has given to a robot."""
        view = self.traffic._schedule.held(name)
        return tuple(self.traffic._berths.name(place) for place in view)
