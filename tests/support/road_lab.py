"""Robots of any make in the traffic of a laboratory, all in memory and in virtual time: their links, their programs in traffic, traffic
itself, and bodies that drive from waypoint to waypoint."""

from __future__ import annotations

import asyncio
import math
import selectors
from collections.abc import Callable, Coroutine, Iterable
from functools import lru_cache, wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from random import Random
from typing import Any, TypeVar

from somrs.devices.road.link import RoadLink
from somrs.devices.road_robot import CarryingRobot, RobotFailed, Way, Waypoint
from somrs.kernel.component import Answered, Ask, Effect, Input, Notified, Received, Send, SetTimer, Started, TimerFired
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages import bodies
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.traffic import ReadRoadmap, RoadmapPage
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.repository.update import update_outcome
from somrs.space.solids import solid_of
from somrs.traffic.component import Traffic
from somrs.traffic.layout import OpenBuilding, lay_out
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.roadmap import Roadmap, RobotKind
from somrs.traffic.roadmap_reading import RoadmapReading
from somrs.traffic.robot_program import RobotProgram
from somrs.traffic.robot_tasks import RoadmapRead
from somrs.traffic.state import PlanTraffic
from tests.support.robot_lab import SITE, site
from tests.support.virtual_devices import make_ask

T = TypeVar("T")

REACH = 1.5
"""How far from where it stands a robot takes things, m."""
STEP = 0.1
"""Seconds between two states of a body."""
DELAY = 0.01
"""Seconds that a message takes."""
LONGEST = 3600.0
"""Seconds of virtual time for a test."""


@lru_cache
def _roadmap(text: str) -> Roadmap:
    loaded, map = site(text)
    return lay_out(OpenBuilding(map, loaded.ontology, [0.0]), [RobotKind(0.3)])


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


def in_lab(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """A test with a laboratory and its first robot, which takes part in traffic when the test begins, in virtual time."""

    @wraps(test)
    def run(tmp_path: Path, **arguments: object) -> None:
        async def play() -> None:
            lab = RoadLab(tmp_path)
            await lab.start()
            await test(lab, lab.robots["Robot1"], **arguments)

        in_virtual_time(play())

    _, _, *parameters = signature(test).parameters.values()
    folder = Parameter("tmp_path", Parameter.POSITIONAL_OR_KEYWORD, annotation=Path)
    run.__signature__ = Signature([folder, *parameters])  # type: ignore[attr-defined]  # what pytest has to pass
    return run


class Body:
    """What a robot does by itself, whatever becomes of its program. `held_thing`: that in its gripper."""

    speed, handling = 0.5, 2.0

    def __init__(self, lab: RoadLab, x: float, y: float) -> None:
        self.lab, self.x, self.y, self.held_thing = lab, x, y, None
        self.base: dict[int, Waypoint] = {}
        """The waypoints to which it was told to drive, by number: also those that it has passed."""
        self.passed = 0
        self.is_halting = False

    held_thing: str | None

    async def drive(self) -> None:
        """Drive to the end of the base."""
        while (goal := self.base.get(self.passed + 1)) is not None:
            while (distance := math.dist((self.x, self.y), (goal.x, goal.y))) > 1e-6:
                await asyncio.sleep(STEP)
                if not self.is_halting:
                    share = min(1.0, self.speed * STEP / distance)
                    self.x, self.y = self.x + share * (goal.x - self.x), self.y + share * (goal.y - self.y)
            self.passed = goal.number

    async def take(self, thing: str) -> str | None:
        """Take a thing. Returns why it failed."""
        await asyncio.sleep(self.handling / 2)
        place = self.lab.places.get(thing)
        if self.held_thing is not None or place is None or self.lab.distance(place, self.x, self.y) > REACH:
            return "there is nothing to take"
        self.held_thing = thing
        self.lab.places[thing] = None
        await asyncio.sleep(self.handling / 2)
        return None

    async def put(self, place: str) -> str | None:
        """Put what it held_thing somewhere. Returns why it failed."""
        await asyncio.sleep(self.handling / 2)
        if self.held_thing is None or place in self.lab.full:
            return "there is nothing to put, or no room for it"
        self.lab.places[self.held_thing], self.held_thing = place, None
        await asyncio.sleep(self.handling / 2)
        return None


class LabRobot(CarryingRobot, replaces=("_notice_state", "data", "whole_map", "problem_observer")):
    """The program of a robot. `stopping`: the seconds that it takes to stand still. `reach`: how far along the x axis it puts things
    down, in metres; `floor`: whether it can. `senses`: whether it has a sensor in its gripper. `ends_at`: of what it picks or drops, the
    share after which the program of its gripper has ended; None: it does not end."""

    stopping, reach = 0.0, 0.0
    floor, senses = True, True
    ends_at: float | None = None

    def __init__(self, lab: RoadLab, name: str, body: Body) -> None:
        super().__init__(name)
        self.data, self.lab, self.body = lab.folder, lab, body
        self.whole_map = lab.whole_map
        self.ways_told: list[Way] = []
        self.problems: list[str | None] = []
        """What people were told."""
        self.problem_observer = self.problems.append
        self.is_unreachable = False
        self._drive_task: asyncio.Task[None] | None = None
        self._reported_number = 0

    @property
    def link(self) -> RoadLink:
        return self._road_link

    def _notice_state(self, state: object) -> None:
        """No services are offered."""

    def say(self) -> None:
        """Say where it is, and what it has passed."""
        if not self.is_unreachable:
            self.carries = self.body.held_thing is not None if self.senses else None
            self.located(self.body.x, self.body.y, 0.0, 0.0)
            if self.body.passed > self._reported_number:
                self._reported_number = self.body.passed
                self.passed(self._reported_number)

    async def stand_by(self) -> None:
        while True:
            self.say()
            await asyncio.sleep(STEP)

    def go_away(self) -> None:
        """Lose the connection: it does on what it was told."""
        self.is_unreachable = True
        self.heard(False)

    def return_back(self) -> None:
        """Be there again, and say how it is."""
        self.is_unreachable = False
        self.heard(True)
        self.say()

    async def follow(self, way: Way) -> None:
        """What was released stays released, until it has halted."""
        self.ways_told.append(way)
        body = self.body
        if way[0].number > body.passed:
            body.passed = self._reported_number = way[0].number
        body.base.update({waypoint.number: waypoint for waypoint in way if waypoint.released})
        if self._drive_task is None or self._drive_task.done():
            self._drive_task = asyncio.create_task(body.drive())

    async def halt(self) -> None:
        self.body.base, self.body.is_halting = {}, True
        if self._drive_task is not None:
            self._drive_task.cancel()
            await asyncio.wait({self._drive_task})
        await asyncio.sleep(self.stopping)
        self.body.is_halting = False

    async def interrupt(self) -> None:
        await asyncio.sleep(self.body.handling)

    async def pick(self, thing: str, support: str) -> None:
        await self._act(self.body.take(thing))

    async def drop(self, thing: str, support: str) -> None:
        await self._act(self.body.put(support))

    async def put_down(self, thing: str) -> tuple[float, float, float, str]:
        if not self.floor:
            return await super().put_down(thing)
        await self._act(self.body.put("Floor1"))
        return self.body.x + self.reach, self.body.y, 0.0, ""

    async def _act(self, action: Coroutine[Any, Any, str | None]) -> None:
        """Have the body do something, which it ends also when nobody waits for it."""
        work = asyncio.create_task(action)
        if self.ends_at is not None:
            await asyncio.sleep(self.ends_at * self.body.handling)
            work.cancel()
            raise RobotFailed("its gripper has ended", is_unsure=True)
        failure = await asyncio.shield(work)
        self.say()
        if failure is not None:
            raise RobotFailed(failure)

    async def charge_at(self, charger: str) -> None:
        await asyncio.sleep(self.body.handling)


class RoadLab:
    """A site with robots of any make. `robots`: their names."""

    def __init__(self, folder: Path, text: str = SITE, robots: Iterable[str] = ("Robot1", "Robot2")) -> None:
        loaded, self.map = site(text)
        self.ontology: Ontology = loaded.ontology
        self.folder = folder
        roadmap = _roadmap(text)
        self.traffic, self._planner = Traffic("traffic", roadmap), TrafficPlanner(roadmap, Random(0))
        self.places: dict[str, str | None] = {"Jar1": "Table1", "Anvil1": "Table1"}
        """On what the things are; None: they are in a gripper."""
        self.full: set[str] = set()
        """The places at which nothing can be put any more."""
        self.robots = {name: self._robot(name) for name in robots}
        self.programs: dict[str, RobotProgram] = {}
        self._timers: dict[tuple[str, object], asyncio.TimerHandle] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def _robot(self, name: str) -> LabRobot:
        values = self.map.objects[name].values
        return LabRobot(self, name, Body(self, float(str(values["PositionX"])), float(str(values["PositionY"]))))

    async def whole_map(self, *, is_current: bool = True) -> tuple[Map, Ontology]:
        await asyncio.sleep(0)
        return self.map, self.ontology

    async def answer(self, question: bodies.Body) -> bodies.Body:
        """What the Repository answers to a question about the map."""
        repository = Repository("repository", Contents(ontology=self.ontology, map=self.map))
        return await make_ask(repository, asyncio.get_running_loop().time)(question)

    def distance(self, place: str, x: float, y: float) -> float:
        """How far a point is from an object, m."""
        solid = solid_of(self.map.objects[place], self.ontology)
        assert solid is not None, "places have a position"
        return solid.distance(x, y)

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

    async def start_robot(self, name: str) -> LabRobot:
        """Start the program of a robot, and return when it takes part in traffic."""
        robot = self.robots[name]
        self.programs[name] = RobotProgram(name, name, "traffic", f"life-{robot.road.new_name()}")
        robot.road.tell = lambda notice: self.handle(name, Notified(notice))
        self._keep(robot.stand_by())
        self.handle(name, Started(name))
        await robot.link.__aenter__()
        robot.link.gripper.load([])
        while not robot.ways_told:
            await asyncio.sleep(STEP)
        return robot

    async def restart(self, name: str) -> LabRobot:
        """Kill the program of a robot, and start another one."""
        killed = self.robots[name]
        killed.road.tell = lambda notice: None
        killed.go_away()
        await killed.halt()  # as the next program does with what it finds
        killed.body.passed = 0
        self.robots[name] = robot = LabRobot(self, name, killed.body)
        robot.floor, robot.senses, robot.stopping = killed.floor, killed.senses, killed.stopping
        return await self.start_robot(name)

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

    def read_roadmap(self) -> RoadmapRead:
        """The roadmap of traffic."""
        reading = RoadmapReading()
        request: ReadRoadmap | None = reading.begin(0.0)
        while request is not None:
            page = self.traffic._read(request)
            assert isinstance(page, RoadmapPage), "that is how it is read"
            request = reading.take(page, request, 0.0)
        assert reading.roadmap is not None, "all was read"
        return reading.roadmap

    def held(self, name: str) -> tuple[str, ...]:
        """The places that traffic has given to a robot."""
        view = self.traffic._schedule.held(name)
        return tuple(self.traffic._berths.name(place) for place in view)
