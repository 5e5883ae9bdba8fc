"""Scenario 4: deliveries across the storeys of a hotel, with a lift that breaks while a robot is in it.

Four deliveries begin. The western lift breaks half-way, with a robot and what it carries in the cabin. Traffic leads the others to the
eastern lift. When they have delivered, an operator takes this lift out of order for an inspection, too, and a guest asks for one more
thing: no robot can bring it upstairs, so that the task waits and says why. When the western lift is mended, the robot in it goes on, and
the task that waits does, too.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator, Collection, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console
from rich.text import Text

from somrs.client import terminal
from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.client.timeline import Mark, bars, timeline_table
from somrs.client.trace import Follower, Line, trace_file
from somrs.demo.film import WIDTH, Film, Frame
from somrs.demo.results import Results, are_all_released, without_progress
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.link import OperatorLink
from somrs.entish.parse import parse
from somrs.errors import SimulationError
from somrs.ontology.modes import Mode, closed_passages, out_of_order
from somrs.ontology.objects import ValueSet
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import MODE
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.submission import Policy, Submit
from somrs.protocol.messages.task_views import TaskView

SPEED = "6"
"""Simulated seconds per second: so few that the frames of the film, each of which takes the simulator a moment, are not far apart."""
_LIFT, _OTHER_LIFT = "LiftWest", "LiftEast"
_BREAKS_AT = 1.6
"""For how many metres the lift has carried a robot when it breaks: half-way between the floors."""
_FIRST = {"Bottle001": "Table201", "Jar001": "Table203", "Cup001": "Counter", "Carton001": "Table101"}
_LAST = {"Can001": "Table202"}
_DELIVERIES = _FIRST | _LAST
"""What is delivered, and where to: when the scenario begins, and when no lift works."""
_STOREYS = {"upper floor": "UpperFloor", "ground floor": "GroundFloor"}
STEPS = {
    "A": "the lift breaks half-way, with a robot in it",
    "B": "another robot takes the other lift",
    "C": "upstairs: doors were opened on the way",
    "D": "no lift works: one robot waits in the cabin",
    "E": "after the repair, the robot goes on",
    "F": "upstairs: all is delivered",
}
"""The pictures, by letter."""
FILM, FILM_CAPTION = Path("film.webp"), "both storeys from above"
INTERVAL = 1.0
"""The least time between two frames of the film, in simulated seconds."""
_MOST_TIME = 400.0
"""Longest duration of the scenario, in seconds."""


def _reasons(view: TaskView) -> tuple[str, ...]:
    """Why a delivery waits."""
    return tuple(dict.fromkeys(hindrance.reason for hindrance in view.waiting_to_retry.hindrances)) if view.waiting_to_retry else ()


def _services_at_work(view: TaskView) -> list[str]:
    return [work.service for work in view.work if work.state is State.EXECUTING]


def _goal(thing: str) -> str:
    return f"{thing} isOn {_DELIVERIES[thing]}"


@dataclass(slots=True)
class _ScenarioRecord:
    """What was observed: the messages, the latest view of each delivery, by its thing, and the actions on the system."""

    lines: list[Line] = field(default_factory=list)
    views: dict[str, TaskView] = field(default_factory=dict)
    marks: list[Mark] = field(default_factory=list)
    passenger: str | None = None
    """The robot that was in the lift when it broke."""
    delivery: str | None = None
    """What it delivers, whether it has it already or not."""
    stuck_at: float = 0.0
    """The height at which it was, m."""
    height_before_repair: float = 0.0
    """Its height just before the lift was mended, m."""
    accomplished_before_repair: frozenset[str] = frozenset()
    is_mended: bool = False
    hindrances: tuple[str, ...] = ()
    """Why the last delivery waited."""

    def accomplished(self) -> frozenset[str]:
        """The things that were delivered."""
        return frozenset(thing for thing, view in self.views.items() if view.outcome is Outcome.ACCOMPLISHED)


class _ScenarioPlayer:
    """Plays the scenario in a running system."""

    def __init__(self, system: System, client: Client, operator: OperatorLink, folder: Path, console: Console) -> None:
        self.record, self.film = _ScenarioRecord(), Film()
        self._client, self._operator, self._folder, self._console = client, operator, folder, console
        self._trace = Follower(trace_file(system.data))
        self._watchers: dict[str, asyncio.Task[None]] = {}
        self._is_broken = asyncio.Event()
        self._has_pictures = True

    async def play(self) -> _ScenarioRecord:
        await self._operator.schedule(_LIFT, Fault.DRIVE, carried=_BREAKS_AT)
        try:
            async with asyncio.timeout(_MOST_TIME), _meanwhile(self._print_messages()), _meanwhile(self._watch_world()):
                await self._act()
        finally:
            for watcher in self._watchers.values():
                watcher.cancel()
        await asyncio.sleep(0.3)  # the last End messages are in transit
        self._print()
        return self.record

    # The story

    async def _act(self) -> None:
        await self._mark("guests", "order four deliveries")
        for thing in _FIRST:
            await self._submit(thing)
        await self._lift_breaks()
        async with _meanwhile(self._picture_other_lift()):
            await self._ended(_FIRST.keys() - {self.record.delivery})
        await self._take_picture("C", _STOREYS["upper floor"])
        await self._mark("operator", f"takes {_OTHER_LIFT} out of order, too, for an inspection")
        await self._set_mode(_OTHER_LIFT, Mode.OUT_OF_ORDER)
        await self._guest_orders_what_no_robot_can_bring()
        await self._take_picture("D", _STOREYS["ground floor"])
        await self._lift_is_mended()
        await self._ended(_DELIVERIES)
        await self._operator.idle()
        await self._take_picture("F", _STOREYS["upper floor"])
        await self._set_mode(_OTHER_LIFT, Mode.NORMAL)
        await self._mark("operator", f"{_OTHER_LIFT} is in order again, too")

    async def _lift_breaks(self) -> None:
        """Wait until the lift breaks, and see who is in it."""
        await self._is_broken.wait()
        record, lift = self.record, await self._operator.observe(_LIFT)
        for name, state in (await self._operator.robots()).items():
            if math.dist((state.x, state.y), (lift.x, lift.y)) < 1 and state.z is not None:
                record.passenger, record.stuck_at = name, state.z
        while (delivery := self._delivery_of(record.passenger)) is None:
            await asyncio.sleep(0.02)
        record.delivery = delivery
        await self._mark(_LIFT, f"breaks half-way, with {record.passenger} in it, which delivers {delivery}")
        await self._take_picture("A", _LIFT)

    async def _guest_orders_what_no_robot_can_bring(self) -> None:
        (thing,) = _LAST
        await self._mark("guest", f"orders {thing} upstairs")
        await self._submit(thing)
        while (view := self.record.views.get(thing)) is None or view.waiting_to_retry is None:
            await asyncio.sleep(0.02)
        self.record.hindrances = _reasons(view)
        await self._mark(thing, f"waits, because {' and '.join(self.record.hindrances)}")

    async def _lift_is_mended(self) -> None:
        record = self.record
        while not _reports_of_waiting(record.lines):
            await asyncio.sleep(0.02)
        record.accomplished_before_repair = record.accomplished()
        record.height_before_repair = (await self._operator.observe(_LIFT)).z
        await self._operator.repair(_LIFT, Fault.DRIVE)
        record.is_mended = True
        await self._mark("mechanic", f"repairs {_LIFT}")
        if record.delivery is not None:
            await self._ended([record.delivery])
            await self._take_picture("E", record.delivery)

    async def _set_mode(self, lift: str, mode: Mode) -> None:
        await self._client.update(UpdateMap(changes=(ValueSet(lift, MODE, mode.value),), author="the operator"))

    # Tasks

    async def _submit(self, thing: str) -> None:
        task = await self._client.submit(Submit(effect=_goal(thing), policy=Policy.TIME))
        self._watchers[thing] = asyncio.create_task(self._watch(thing, task))

    async def _watch(self, thing: str, task: str) -> None:
        """Follow the events of a delivery until it ends."""
        async for news in self._client.news(task):
            self.record.views[thing] = news.view
            for event in news.events:
                if event.kind is not EventKind.NEWS:
                    self._console.print(Text(f"{thing:>10} · ", style="dim") + terminal.event(event))

    async def _ended(self, things: Collection[str]) -> None:
        """Wait until the deliveries have ended."""
        await asyncio.gather(*(self._watchers[thing] for thing in things))

    def _delivery_of(self, robot: str | None) -> str | None:
        """What a robot delivers now."""
        deliveries = (thing for thing, view in self.record.views.items() if f"{robot}.TransferObject" in _services_at_work(view))
        return next(deliveries, None)

    # What is shown

    async def _mark(self, actor: str, text: str) -> None:
        self.record.marks.append(Mark(at=time.time(), subject=actor, text=text))
        self._console.print(f"[bold red]{'':>10} ◆ {actor}: {text}[/]")
        await self._add_frame()

    async def _print_messages(self) -> None:
        while True:
            self._print()
            await asyncio.sleep(0.02)

    def _print(self) -> None:
        for line in self._trace.new():
            self.record.lines.append(line)
            if line.type != "Progress":
                self._console.print(terminal.passing(line, self.record.lines[0].at))

    async def _watch_world(self) -> None:
        """Notice when the lift breaks, and add a frame to the film at each interval of simulated time in which something moves."""
        due_time = 0.0
        async for poses in self._operator.poses():
            if (status := poses.robots.get(_LIFT)) is not None and status.faults:
                self._is_broken.set()
            if poses.moved and poses.time >= due_time:
                due_time = poses.time + INTERVAL
                await self._add_frame()

    async def _add_frame(self) -> None:
        if self._has_pictures:
            mark, rows = self.record.marks[-1], tuple((_goal(thing), self._state(thing)) for thing in _DELIVERIES)
            with self._without_opengl():
                pictures = {name: await self._operator.picture(storey, width=WIDTH) for name, storey in _STOREYS.items()}
                self.film.add(Frame(pictures=pictures, caption=f"{mark.subject}: {mark.text}", rows=rows))

    def _state(self, thing: str) -> str:
        """The state of a delivery, for the film."""
        record, view = self.record, self.record.views.get(thing)
        if view is None:
            return "not ordered yet"
        if view.outcome is not None:
            return view.outcome.value
        if view.waiting_to_retry is not None:
            return f"waits: {' and '.join(_reasons(view))}"
        services = _services_at_work(view)
        if not services:
            return "is being arranged"
        robot, _, service_type = services[-1].partition(".")
        if robot == record.passenger and not record.is_mended:
            return f"{robot} waits in {_LIFT}, which does not work"
        return f"{robot} {'opens the door' if service_type == 'OpenDoor' else 'is on its way'}"

    async def _picture_other_lift(self) -> None:
        """Take the picture of the other lift when there is a robot in it."""
        if self._has_pictures:
            with self._without_opengl():
                picture = await self._operator.picture(_OTHER_LIFT, robot=_OTHER_LIFT, carried=_BREAKS_AT)
                (self._folder / "B.png").write_bytes(picture)

    async def _take_picture(self, letter: str, subject: str) -> None:
        if self._has_pictures:
            with self._without_opengl():
                (self._folder / f"{letter}.png").write_bytes(await self._operator.picture(subject))

    @contextmanager
    def _without_opengl(self) -> Iterator[None]:
        """Go on without pictures if none can be taken."""
        try:
            yield
        except SimulationError as error:
            if self._has_pictures:
                self._console.print(f"[yellow]no pictures: {error}[/]")
            self._has_pictures = False


@asynccontextmanager
async def _meanwhile(work: Coroutine[object, object, None]) -> AsyncIterator[None]:
    """Do the work until the block ends; an error of the work comes out there."""
    task = asyncio.create_task(work)
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


async def perform(system: System, folder: Path, console: Console) -> int:
    """Play the scenario, and write its results to `folder`. Return the exit code: 0 if all checks pass."""
    assert system.addresses.simulator is not None
    started = time.monotonic()
    async with Client(system.addresses) as client, operator_link(system.addresses) as operator:
        console.print(
            f"[bold]Scenario 4[/]: {', '.join(_goal(thing) for thing in _FIRST)}; later {', '.join(_goal(thing) for thing in _LAST)}"
        )
        player = _ScenarioPlayer(system, client, operator, folder, console)
        record = await player.play()
        ontology, map = await client.ontology(), await client.map()
        supports = {thing: (await operator.observe(thing)).support for thing in _DELIVERIES}
        robots = await operator.robots()
    timeline_bars = bars(record.lines)
    results = Results(folder, console, "Scenario 4: deliveries in a hotel, and a lift that breaks", STEPS | {FILM.stem: FILM_CAPTION})
    results.write_map(ontology, map)
    results.write_messages(system.data, without_progress(record.lines))
    results.write_timeline(timeline_bars, record.marks)
    pictures = results.write_sheet()
    if player.film.save(folder / FILM):
        pictures.append(FILM)
    checks = {
        **_checks_of_story(record),
        "the goals hold in the Repository": all(formula_holds(parse(_goal(thing)), map, ontology) for thing in _DELIVERIES),
        "in the simulator, each thing is where it was to be brought": supports == _DELIVERIES,
        "both lifts are in order, and no robot is in one": not closed_passages(map, ontology)
        and all(state.z is not None and 0 <= state.x <= 14 and not state.faults for state in robots.values()),
        **_checks_of_messages(record.lines),
    }
    console.print()
    console.print(timeline_table(timeline_bars, record.marks, console.width))
    for thing, view in record.views.items():
        console.print(terminal.steps(f"Plan of {_goal(thing)}", view.steps), terminal.outcome(view))
    results.show_pictures(pictures)
    return results.conclude(checks, started)


def _checks_of_story(record: _ScenarioRecord) -> dict[str, bool]:
    """What happened to the lifts and the deliveries, each with whether it is so."""
    delivery, (last_thing,) = record.delivery, _LAST
    return {
        "the lift broke half-way, with a robot in it that had a delivery": delivery in _FIRST and 0 < record.stuck_at < 3.2,
        "the robot stayed in the cabin, which stood still until the repair": record.height_before_repair == record.stuck_at,
        "the robot said why it waited": {line.sender for line in _reports_of_waiting(record.lines)}
        == {f"{record.passenger}.TransferObject"},
        "the others were delivered meanwhile, also upstairs, by the other lift": record.accomplished_before_repair
        == _FIRST.keys() - {delivery},
        "the delivery for which no lift worked waited, and named the lifts": out_of_order(sorted([_LIFT, _OTHER_LIFT]))
        in record.hindrances,
        "after the repair, the robot in the lift made its delivery itself": delivery is not None
        and [work.service for work in record.views[delivery].work] == [f"{record.passenger}.TransferObject"],
        "after the repair, the delivery that waited went on": record.views[last_thing].outcome is Outcome.ACCOMPLISHED,
        "all deliveries were accomplished": record.accomplished() == _DELIVERIES.keys(),
    }


def _reports_of_waiting(lines: list[Line]) -> list[Line]:
    """The messages that say that the lift keeps the sender from going on."""
    return [
        line
        for line in lines
        if line.type == "Progress" and line.body.get("waits") and line.body.get("note") == f"waits: {_LIFT} does not work"
    ]


def _checks_of_messages(lines: list[Line]) -> dict[str, bool]:
    opened = {line.sender for line in lines if line.type == "Completed" and line.sender.endswith(".OpenDoor")}
    return {
        "a door opened itself, and robots opened two": "Door203.OpenDoor" in opened
        and sum(line.type == "Completed" and line.sender.endswith(".OpenDoor") for line in lines) == 3,
        "no service failed": not any(line.type in ("Failed", "Stopped") for line in lines),
        "each participant with a contract was released": are_all_released(lines),
    }
