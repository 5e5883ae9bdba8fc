"""Scenario 5: a mill and a bakery share a yard, and a host that runs the whole bakery is lost for good.

Each organisation has a map, a Registry and Task Managers of its own: the mill one, the bakery two. What each lets the other see and use
is in `neighbours_of`. Each has an authority and a bus of its own, with servers on three hosts. The first host runs the mill, the
second the bakery, and each follows the other's components as standby. The third has servers only. When robots of both carry things, the
second host is killed with its servers, and is not started again: the first one goes on for the bakery.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Collection, Mapping, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path

import msgspec
from msgspec import structs
from rich.console import Console
from rich.text import Text

from somrs.client import terminal
from somrs.client.client import Client
from somrs.client.timeline import Bar, Mark, bars, timeline_table
from somrs.client.trace import Follower, Line
from somrs.demo.hosts import Host, Hosts
from somrs.demo.organisations import (
    BAKERY,
    LEADERS,
    MILL,
    TASK_MANAGERS,
    Organisations,
    component_labels,
    make_authorities,
    name_in_chart,
    task_manager_labels,
)
from somrs.demo.results import Results, are_all_released, without_progress
from somrs.deployment.launcher import Launcher
from somrs.devices.simulator.link.link import OperatorLink
from somrs.errors import SimulationError
from somrs.ontology.qualified_names import home_of, plain_name
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView

HOSTS = ("first host", "second host", "third host")
_FIRST = {
    MILL: ("Flour1 isOn Bakery:Ramp1", "Flour2 isOn Bakery:Ramp2", "Flour3 isOn Loft"),
    BAKERY: ("Mill:Flour4 isOn Counter", "Bread1 isOn Shelf", "Bread2 isOn Mill:Dock"),
}
_LAST = "Flour1 isOn Oven"
"""What the bakery wants when its host has been lost, and the mill has brought the flour."""
_PLACES = {
    "Bakery:Flour1": "Bakery:Oven",
    "Bakery:Flour2": "Bakery:Ramp2",
    "Mill:Flour3": "Mill:Loft",
    "Bakery:Flour4": "Bakery:Counter",
    "Bakery:Bread1": "Bakery:Shelf",
    "Mill:Bread2": "Mill:Dock",
}
"""Where each thing is in the end, under the name of the map that is its home then."""
STEPS = {"A": "robots of both carry things: the second host is lost", "B": "the flour is on the ramp", "C": "all is where it was wanted"}


@dataclass(slots=True)
class _ScenarioRecord:
    """What was observed: the messages of each organisation, the latest view of each task, by its goal, and what happened."""

    lines: dict[str, list[Line]] = field(default_factory=lambda: {MILL: [], BAKERY: []})
    views: dict[str, TaskView] = field(default_factory=dict)
    marks: list[Mark] = field(default_factory=list)
    reigns: list[Bar] = field(default_factory=list)
    """Which host led which Task Manager, and how long."""
    working: set[tuple[str, int]] = field(default_factory=set)
    """The Task Managers that have sent messages: whose they are, and their numbers."""
    lost: tuple[str, ...] = ()
    """The components that the second host led when it was lost."""

    @property
    def all_lines(self) -> list[Line]:
        return sorted((line for lines in self.lines.values() for line in lines), key=lambda line: line.at)


class _ScenarioPlayer:
    """Plays the scenario with organisations that run."""

    def __init__(
        self, organisations: Organisations, clients: Mapping[str, Client], operator: OperatorLink, folder: Path, console: Console
    ) -> None:
        self.record = _ScenarioRecord()
        self._organisations, self._clients, self._operator = organisations, clients, operator
        self._folder, self._console = folder, console
        self._traces = [(name, number, Follower(path)) for name in (MILL, BAKERY) for number, path in organisations.message_files(name)]
        self._watchers: dict[str, asyncio.Task[None]] = {}
        self._reigning: dict[str, tuple[str, float]] = {}
        """Which host leads a Task Manager, and since when, by its label."""
        self._has_pictures = True
        self._printed: set[str] = set()

    async def play(self) -> _ScenarioRecord:
        printing = asyncio.create_task(self._print_messages())
        try:
            await self._act()
        finally:
            for task in (printing, *self._watchers.values()):
                task.cancel()
        await asyncio.sleep(0.5)  # the last End messages are in transit
        self._print()
        return self.record

    async def _act(self) -> None:
        hosts = self._organisations.hosts
        for label in task_manager_labels():
            self._begin_reign(label, hosts.leader(label))
        for name, goals in _FIRST.items():
            self._mark(name, f"states {len(goals)} tasks")
            for goal in goals:
                await self._submit(name, goal)
        await self._both_carry()
        await self._take_picture("A")
        second = hosts.hosts[LEADERS[BAKERY]]
        self.record.lost = tuple(second.leads)
        await second.kill()
        lost_at = time.time()
        self._mark(second.name, "is lost for good, with its servers of both buses")
        for label in [label for label in self._reigning if label in self.record.lost]:
            self._end_reign(label, "lost")
        await self._taken_over(lost_at)
        await self._ended(["Flour1 isOn Bakery:Ramp1"])
        await self._take_picture("B")
        self._mark(BAKERY, "wants the flour that the mill has brought in the oven")
        await self._submit(BAKERY, _LAST)
        await self._ended([*self._watchers])
        await self._operator.idle()
        await self._take_picture("C")
        for label in [*self._reigning]:
            self._end_reign(label, "Completed")

    async def _both_carry(self) -> None:
        """Return when a robot of each organisation carries something."""
        holding: dict[str, str | None] = {}
        async for poses in self._operator.poses():
            holding |= {robot: status.holding for robot, status in poses.robots.items()}
            if {robot.partition(":")[0] for robot, thing in holding.items() if thing} >= {MILL, BAKERY}:
                return

    async def _taken_over(self, lost_at: float) -> None:
        """Note when each of the components goes on at another host."""
        hosts = self._organisations.hosts
        waiting = {*self.record.lost}
        while waiting:
            for label in sorted(waiting):
                if (host := hosts.leader(label)) is not None:
                    waiting.remove(label)
                    if label in task_manager_labels():
                        self._begin_reign(label, host)
                    name, _, component = label.partition("/")
                    self._mark(host.name, f"goes on as the {component} of the {name.lower()}, {time.time() - lost_at:.1f} s after the loss")
            if waiting:
                hosts.change.clear()
                await hosts.change.wait()

    def _begin_reign(self, label: str, host: Host | None) -> None:
        assert host is not None, "each component has a leader"
        self._reigning[label] = host.name, time.time()

    def _end_reign(self, label: str, ending: str) -> None:
        host, start = self._reigning.pop(label)
        self.record.reigns.append(Bar(device=name_in_chart(label), label=host, kind="does", start=start, end=time.time(), ending=ending))

    # Tasks

    async def _submit(self, name: str, goal: str) -> None:
        task = await self._clients[name].submit(Submit(effect=goal))
        self._watchers[goal] = asyncio.create_task(self._watch(name, goal, task))

    async def _watch(self, name: str, goal: str, task: str) -> None:
        async for news in self._clients[name].news(task):
            self.record.views[goal] = news.view
            for event in news.events:
                if event.kind is not EventKind.NEWS:
                    self._console.print(Text(f"{goal:>24} · ", style="dim") + terminal.event(event))

    async def _ended(self, goals: Collection[str]) -> None:
        await asyncio.gather(*(self._watchers[goal] for goal in goals))

    # What is shown

    def _mark(self, actor: str, text: str) -> None:
        self.record.marks.append(Mark(at=time.time(), subject=actor, text=text))
        self._console.print(f"[bold red]{'':>10} ◆ {actor}: {text}[/]")

    async def _print_messages(self) -> None:
        while True:
            self._print()
            await asyncio.sleep(0.05)

    def _print(self) -> None:
        for name, number, trace in self._traces:
            for line in trace.new():
                self.record.working.add((name, number))
                if line.message_id in self._printed:
                    continue  # it was repeated by who took over
                self._printed.add(line.message_id)
                self.record.lines[name].append(line)
                if line.type != "Progress":
                    started = min(lines[0].at for lines in self.record.lines.values() if lines)
                    self._console.print(Text(f"{name:>8} ", style="dim") + terminal.passing(line, started))

    async def _take_picture(self, letter: str) -> None:
        if self._has_pictures:
            try:
                (self._folder / f"{letter}.png").write_bytes(await self._operator.picture())
            except SimulationError as error:
                self._console.print(f"[yellow]no pictures: {error}[/]")
                self._has_pictures = False


async def play(folder: Path, console: Console, launcher: Launcher | None = None) -> int:
    """Play the scenario, and write its results to `folder`. Return the exit code: 0 if all checks pass. Raises UsageError without a bus."""
    started = time.monotonic()
    for name in (MILL, BAKERY):
        source = resources.files("somrs.demo") / "data" / "scenario-5" / f"{name.lower()}.yaml"
        (folder / f"{name.lower()}.yaml").write_bytes(source.read_bytes())
    async with AsyncExitStack() as stack:
        with console.status("starting three hosts, and a mill and a bakery on them ..."):
            hosts = await stack.enter_async_context(Hosts(folder / "run", HOSTS, make_authorities(folder)))
            organisations = Organisations(folder, hosts, launcher)
            await stack.enter_async_context(organisations.running())
            clients = {name: await stack.enter_async_context(Client(system.addresses)) for name, system in organisations.systems.items()}
            operator = await stack.enter_async_context(organisations.operator)
            await _see_each_other(clients)
        goals = [f"{name}: {goal}" for name, goals in _FIRST.items() for goal in goals]
        console.print(f"[bold]Scenario 5[/]: {'; '.join(goals)}; later {BAKERY}: {_LAST}")
        player = _ScenarioPlayer(organisations, clients, operator, folder, console)
        record = await player.play()
        models = {name: (await client.ontology(), await client.map()) for name, client in clients.items()}
        places = {thing: (await operator.observe(thing)).support for thing in _PLACES}
    results = Results(folder, console, "Scenario 5: a mill, a bakery, and a host that is lost for good", STEPS)
    for name, (ontology, map) in models.items():
        results.write_map(ontology, map, name.lower())
    places_at_home = {
        thing: models[home_of(thing)][1].has_fact("isOn", (plain_name(thing), plain_name(place))) for thing, place in _PLACES.items()
    }
    lines = [structs.replace(line, sender=plain_name(line.sender), recipient=plain_name(line.recipient)) for line in record.all_lines]
    results.write_chart(without_progress(lines))
    (folder / "messages.jsonl").write_bytes(b"".join(msgspec.json.encode(line) + b"\n" for line in record.all_lines))
    results.write_timeline(_bars(record), record.marks)
    pictures = results.write_sheet()
    checks = {
        **_checks(record),
        "the map of its owner has each thing where it was wanted": all(places_at_home.values()),
        "in the simulator, each thing is where it was wanted": places == _PLACES,
    }
    console.print()
    console.print(timeline_table(_bars(record), record.marks, console.width))
    for goal, view in record.views.items():
        console.print(f"[bold]{goal}[/]", terminal.outcome(view))
    results.show_pictures(pictures)
    return results.conclude(checks, started)


async def _see_each_other(clients: Mapping[str, Client]) -> None:
    """Return when each organisation has on its map what the other one shows, and lists its services."""
    for name, place in ((MILL, f"{BAKERY}:Ramp1"), (BAKERY, f"{MILL}:Dock")):
        while place not in (await clients[name].map()).objects:
            await asyncio.sleep(0.2)
    while not any(offer.provider == f"{MILL}:MillRobot1" for offer in await clients[BAKERY].services()):
        await asyncio.sleep(0.2)


def _bars(record: _ScenarioRecord) -> list[Bar]:
    """Who led each Task Manager, and the work of the devices, under the names that they have at home."""
    return [*record.reigns, *(replace(bar, device=plain_name(bar.device)) for bar in bars(record.all_lines))]


def _workers(lines: Sequence[Line]) -> set[str]:
    """The devices that were told to work, by their names for who told them."""
    return {line.recipient for line in lines if line.type == "Execute"}


def _checks(record: _ScenarioRecord) -> dict[str, bool]:
    """What happened, each with whether it is so."""
    lines = record.all_lines
    resumed = {mark.subject for mark in record.marks if "goes on as" in mark.text}
    return {
        "the second host led the whole bakery when it was lost": {*record.lost} == {*component_labels(BAKERY)},
        "the first host went on for it": resumed == {HOSTS[0]},
        "three Task Managers had tasks": len(record.working) == 1 + TASK_MANAGERS[BAKERY],
        "a robot of the mill worked for the bakery": any(device.startswith(f"{MILL}:") for device in _workers(record.lines[BAKERY])),
        "the mill used its own robots only": not any(":" in device for device in _workers(record.lines[MILL])),
        "all tasks were accomplished": {view.outcome for view in record.views.values()} == {Outcome.ACCOMPLISHED}
        and len(record.views) == len([*_FIRST[MILL], *_FIRST[BAKERY], _LAST]),
        "no service failed": not any(line.type in ("Failed", "Stopped") for line in lines),
        "each participant with a contract was released": are_all_released(lines),
    }
