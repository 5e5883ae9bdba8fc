"""Scenario 6: five worlds in one building. A Pioneer with ARCOS, a robot with ROS 2, vehicles with VDA 5050 2.1 and 3.0, and a door with
MQTT take part in one plan. One of the robots breaks in the way of its kind, and another one takes its work over.

The bodies of all are in the simulator; what is said between them and SO-MRS goes over the wires of their protocols. What a robot can lift
decides who carries what. Where ROS 2 does not run, the simulator drives that robot itself, and the demonstration says so.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import os
import sys
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from rich.console import Console

from somrs.adapters.wires import recorded_wires
from somrs.client import terminal
from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.client.timeline import bars, timeline_table
from somrs.client.trace import Follower, Line, trace_file
from somrs.demo.results import Results, without_progress
from somrs.deployment.launcher import Launcher
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.entish.parse import parse
from somrs.errors import SimulationError
from somrs.ontology.truth import formula_holds
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView

GOALS = {"Jar001": "Shelf001", "Jar002": "Platform001", "Carton001": "Table001", "Carton002": "Shelf001"}
PIONEER, ROS_ROBOT, VEHICLE_21, VEHICLE_30, DOOR = "Pioneer", "RosRobot", "Vehicle21", "Vehicle30", "Door001"
REQUEST = Submit(effect=" AND ".join([*(f"{thing} isOn {support}" for thing, support in GOALS.items()), f"{DOOR}.Open = TRUE"]))
WORLDS = {
    PIONEER: "ARCOS over TCP",
    ROS_ROBOT: "ROS 2: Nav2 and a gripper",
    VEHICLE_21: "VDA 5050 2.1 over MQTT",
    VEHICLE_30: "VDA 5050 3.0 over MQTT",
    DOOR: "sessions over MQTT",
}
BREAKS = (
    (VEHICLE_21, Fault.DRIVE, "reports an error of the level FATAL"),
    (VEHICLE_21, Fault.LINK, "loses its connection, and the broker sends its last will"),
    (PIONEER, Fault.DRIVE, "does not move, and its motors stall"),
    (ROS_ROBOT, Fault.DRIVE, "aborts the goal of its navigation"),
)
"""Who can break, and how that shows. Without a seed, the first does."""
UNDER_WAY = 1.0
"""How far the robot has driven when it breaks, in metres."""
STEPS = {
    "A": "all robots are on their way",
    "B": "one of them is broken",
    "C": "another one has taken over, and everything is where it was to be",
}
"""The pictures, by letter."""
LAST_DOMAIN = 101
"""The domains of ROS go from 0 to 101. Demonstrations that run at the same time do not hear each other's nodes in different ones."""
LONG_WAIT = 30.0
"""Seconds after which it is said who has not joined."""
MOST_TIME = 400.0
"""Longest duration of the scenario, in seconds."""


@dataclass(slots=True)
class _Record:
    """What was observed."""

    lines: list[Line] = field(default_factory=list)
    view: TaskView | None = None
    broken: bool = False
    started: float = 0.0

    def carriers(self, kind: str) -> dict[str, list[str]]:
        """By robot, what its messages of a kind were about: the services of carrying."""
        found: dict[str, list[str]] = {}
        for line in self.lines:
            if line.type == kind and line.sender.endswith(".TransferObject"):
                found.setdefault(line.sender.partition(".")[0], []).append(str(line.body.get("situation", "")))
        return found


def ros_python() -> Path | None:
    """A Python with ROS 2: that of `scripts/ros2` of a checkout, or this one; None if there is none."""
    own = Path(__file__).parents[3] / ".venv-ros2" / "bin" / "python"
    if (own.parents[1] / ".ready").exists():
        return own
    import importlib.util

    return Path(sys.executable) if importlib.util.find_spec("rclpy") is not None else None


async def play(folder: Path, seed: int | None, console: Console, launcher: Launcher | None) -> int:
    """Play the scenario, and write its results to `folder`. Return the exit code: 0 if all checks pass."""
    site = _write_site(folder)
    python = ros_python()
    if python is None:
        console.print(
            "[yellow]There is no ROS 2 here: the simulator itself drives the robot that would have it (scripts/ros2 installs it).[/]"
        )
    adapters = {"ros2": _ros_settings(python, site.with_name("robot.yaml"))} if python is not None else {}
    breaks = BREAKS[0 if seed is None else seed % len(BREAKS)]
    wires = folder / "wires"
    system = System([site], folder / "run", speed="1", world=WorldKind.KINEMATIC, launcher=launcher, adapters=adapters, arcos=True)
    try:
        with recorded_wires(wires), console.status("starting the system, the adapters, and the other ends of their wires ..."):
            await system.start()
        async with Client(system.addresses) as client, operator_link(system.addresses) as operator:
            player = _Player(system, client, operator, folder, console, breaks)
            async with _recording(system.addresses.broker or "", wires):
                record = await player.play()
            map, ontology = await client.map(), await client.ontology()
            supports = {thing: (await operator.observe(thing)).support for thing in GOALS}
    finally:
        await system.stop()
    assert record.view is not None, "an accepted task has news"
    results = Results(folder, console, "Scenario 6: five worlds in one building", STEPS)
    results.write_map(ontology, map)
    robot, _, how = breaks
    checks = {
        "the task was accomplished": record.view.outcome is Outcome.ACCOMPLISHED,
        "the goal holds in the Repository": formula_holds(parse(REQUEST.effect), map, ontology),
        "in the simulator, everything is where it was to be": supports == GOALS,
        **{f"{name} took part, by {world}": name in _executed(record) for name, world in WORLDS.items()},
        f"{robot} {how}, and another robot took over": record.broken and robot in record.carriers("Failed"),
        "what was said on each wire is recorded": _wire_names(wires) >= {"arcos", "mqtt", "vda5050", *(["ros2"] if python else [])},
    }
    return _close(record, folder, console, results, checks, wires)


def _write_site(folder: Path) -> Path:
    source = resources.files("somrs.demo") / "data" / "scenario-6"
    target = folder / "site"
    target.mkdir()
    for name in ("site.yaml", "doors.yaml", "robot.yaml"):
        (target / name).write_text((source / name).read_text("utf-8"), encoding="utf-8")
    return target / "site.yaml"


def _ros_settings(python: Path, binding: Path) -> dict[str, object]:
    robot = {"binding": str(binding.resolve()), "namespace": "ros_robot", "simulated": True}
    domain = 1 + os.getpid() % LAST_DOMAIN
    return {"python": str(python), "discovery": "LOCALHOST", "domain": domain, "robots": {ROS_ROBOT: robot}}


def _executed(record: _Record) -> set[str]:
    """Who was told to do something."""
    return {line.recipient.partition(".")[0] for line in record.lines if line.type == "Execute"}


def _wire_names(wires: Path) -> set[str]:
    return {file.stem.partition("-")[0] for file in wires.glob("*.jsonl")} if wires.exists() else set()


@contextlib.asynccontextmanager
async def _recording(broker: str, wires: Path) -> AsyncIterator[None]:
    """Record what is said at the broker."""
    import aiomqtt

    wires.mkdir(parents=True, exist_ok=True)
    host, _, port = broker.removeprefix("mqtt://").rpartition(":")

    async def record() -> None:
        async with aiomqtt.Client(host, int(port)) as client:
            await client.subscribe("#")
            async for message in client.messages:
                topic = str(message.topic)
                name = "mqtt-door" if topic.startswith("doors/") else f"vda5050-{topic.split('/')[3]}"
                text = message.payload.decode(errors="replace") if isinstance(message.payload, bytes) else str(message.payload)
                direction = ">" if topic.endswith(("/order", "/instantActions", "/request")) else "<"
                entry = {"at": round(time.time(), 3), "direction": direction, "topic": topic, "message": text}
                with (wires / f"{name}.jsonl").open("a", encoding="utf-8") as file:
                    file.write(json.dumps(entry, ensure_ascii=False) + "\n")

    recording = asyncio.create_task(record())
    try:
        yield
    finally:
        recording.cancel()
        await asyncio.wait({recording})


class _Player:
    """Plays the scenario in a running system: watches the task, breaks a robot, and takes pictures."""

    def __init__(
        self, system: System, client: Client, operator: OperatorLink, folder: Path, console: Console, breaks: tuple[str, Fault, str]
    ) -> None:
        self.record = _Record()
        self._client, self._operator, self._folder, self._console, self._breaks = client, operator, folder, console, breaks
        self._trace = Follower(trace_file(system.data))

    async def play(self) -> _Record:
        with self._console.status("the robots join as they are heard on their wires ..."):
            await self._joined()
        self._console.print(terminal.table("Worlds", ("device", "protocol"), WORLDS.items()))
        self._console.print(f"[bold]Scenario 6[/]: {REQUEST.effect}")
        self.record.started = time.monotonic()
        task = await self._client.submit(REQUEST)
        watcher, breaker = asyncio.create_task(self._watch(task)), asyncio.create_task(self._break())
        try:
            async with asyncio.timeout(MOST_TIME):
                while not watcher.done():
                    self._print()
                    await asyncio.sleep(0.02)
                await watcher
        finally:
            watcher.cancel()
            breaker.cancel()
        await asyncio.sleep(1.0)  # the last End messages are in transit, and the last robot draws its arm in
        await self._picture("C")
        self._print()
        return self.record

    async def _joined(self) -> None:
        """Wait until all devices offer their services."""
        notice_time = time.monotonic() + LONG_WAIT
        while missing := WORLDS.keys() - {offer.service.partition(".")[0] for offer in await self._client.services()}:
            if time.monotonic() > notice_time:
                names = " and ".join(sorted(missing))
                self._console.print(f"[yellow]{names} cannot be heard yet; {self._folder}/run/logs may say why.[/]")
                notice_time = math.inf
            await asyncio.sleep(0.5)

    async def _watch(self, task: str) -> None:
        async for news in self._client.news(task):
            self.record.view = news.view
            for event in news.events:
                if event.kind is not EventKind.NEWS:
                    self._console.print(terminal.event(event))

    async def _break(self) -> None:
        """Break the robot when it is under way to what it is to carry."""
        robot, fault, how = self._breaks
        start = (await self._operator.robots())[robot]
        while True:
            state = (await self._operator.robots())[robot]
            if max(abs(state.x - start.x), abs(state.y - start.y)) > UNDER_WAY and state.holding is None:
                break
            await asyncio.sleep(0.05)
        await self._picture("A")
        await self._operator.fault(robot, fault)
        self.record.broken = True
        self._console.print(f"[bold red]{'':>10} ◆ {robot} breaks: it {how}[/]")
        await asyncio.sleep(2.0)
        await self._picture("B", robot)

    async def _picture(self, letter: str, subject: str | None = None) -> None:
        try:
            (self._folder / f"{letter}.png").write_bytes(await self._operator.picture(subject))
        except SimulationError as error:
            self._console.print(f"[yellow]no picture: {error}[/]")

    def _print(self) -> None:
        for line in self._trace.new():
            self.record.lines.append(line)


def _close(record: _Record, folder: Path, console: Console, results: Results, checks: dict[str, bool], wires: Path) -> int:
    assert record.view is not None, "an accepted task has news"
    timeline_bars = bars(record.lines)
    results.write_messages(folder / "run", without_progress(record.lines))
    results.write_timeline(timeline_bars)
    console.print()
    results.show_pictures(results.write_sheet())
    counts = ((file.name, str(sum(1 for _ in file.open()))) for file in sorted(wires.glob("*.jsonl")))
    console.print(terminal.table("Wires", ("file", "messages"), counts))
    console.print(terminal.steps("Steps", record.view.steps))
    console.print(timeline_table(timeline_bars, [], console.width))
    console.print(terminal.outcome(record.view))
    return results.conclude(checks, record.started)
