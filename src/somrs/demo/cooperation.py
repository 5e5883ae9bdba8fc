"""Scenario 3: a goal that takes several devices and a person, none of which can achieve it alone.

A person is to seal a jar on a table. Nobody knows where the jar is. The patrol robot offers to look for it on the condition that a door is
open, so that a robot opens the door first. The jar is found on a scale. Nobody knows what it weighs, and the robots offer to carry it on
the condition that it is light enough, so that the scale weighs it. It is too heavy for the cheaper robot; the other one carries it. The
last step is done by a person, whose replies this program gives as the person's page would.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console

from somrs.client import people, terminal
from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.client.timeline import bars, timeline_table
from somrs.client.trace import Follower, Line, trace_file
from somrs.demo.results import Results, are_all_released, without_progress
from somrs.deployment.system import System
from somrs.devices.person.assignments import Reply, ReplyKind
from somrs.devices.simulator.link.link import OperatorLink
from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.errors import SimulationError
from somrs.ontology.truth import formula_holds
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView

_JAR, _TABLE, _DOOR, _SCALE, _PERSON = "Jar004", "Table002", "Door001", "Scale001", "Anna"
REQUEST = Submit(effect=f"{_JAR} isSealedBy {_PERSON} AND {_JAR} isOn {_TABLE}")
_WEAK_ROBOT, _STRONG_ROBOT, _PATROL_ROBOT = "Robot1", "Robot2", "Patrol1"
STEPS = {
    "A": "a robot has opened the door",
    "B": "the patrol robot sees the jar through the door",
    "C": "the scale has weighed the jar",
    "D": "robot 2 carries the jar",
    "E": "the jar is on the table",
}
"""The pictures, by letter."""
_LASTING = {
    "A": ("OpenDoor", _DOOR),
    "B": ("RecognizeSituation", _PATROL_ROBOT),
    "C": ("WeighObject", _SCALE),
    "E": ("TransferObject", _JAR),
}
"""For the pictures of situations that last: the service type whose completion leads to them, and the subject."""
_CARRIED = 0.5
"""Distance in metres for which the robot has carried the jar when the picture of its transport is taken."""
_MOST_TIME = 300.0
"""Longest duration of the scenario, in seconds."""


@dataclass(slots=True)
class _ScenarioRecord:
    """The messages that were observed, the latest view of the task, and the replies of the person."""

    lines: list[Line] = field(default_factory=list)
    view: TaskView | None = None
    replies: list[ReplyKind] = field(default_factory=list)

    def completed(self, service_type: str) -> list[str]:
        """The devices that completed a step of a service type, in order."""
        return _devices(line.sender for line in self.lines if line.type == "Completed" and line.sender.endswith(f".{service_type}"))


class _ScenarioPlayer:
    """Plays the scenario in a running system: watches the task, replies as the person, and takes pictures."""

    def __init__(self, system: System, client: Client, operator: OperatorLink, folder: Path, console: Console) -> None:
        self.record = _ScenarioRecord()
        self._data, self._client, self._operator, self._folder, self._console = system.data, client, operator, folder, console
        self._trace = Follower(trace_file(system.data))

    async def play(self) -> _ScenarioRecord:
        task = await self._client.submit(REQUEST)
        watcher, photographer = asyncio.create_task(self._watch(task)), asyncio.create_task(self._take_pictures())
        try:
            async with asyncio.timeout(_MOST_TIME):
                while not watcher.done():
                    self._print()
                    await self._reply()
                    await asyncio.sleep(0.01)
                await watcher
                await self._operator.idle()
                if self.record.completed("TransferObject") == [_STRONG_ROBOT]:  # else there is no picture of its transport
                    await photographer
        finally:
            watcher.cancel()
            photographer.cancel()
        await asyncio.sleep(0.3)  # the last End messages are in transit
        self._print()
        return self.record

    async def _watch(self, task: str) -> None:
        """Follow the events of the task until it ends."""
        async for news in self._client.news(task):
            self.record.view = news.view
            for event in news.events:
                if event.kind is not EventKind.NEWS:
                    self._console.print(terminal.event(event))

    async def _reply(self) -> None:
        """Accept each assignment of the person, and say that it is done."""
        for assignment in await asyncio.to_thread(people.open_assignments, self._data, _PERSON):
            for kind in (ReplyKind.ACCEPT, ReplyKind.DONE):
                await asyncio.to_thread(people.put_reply, assignment.number, Reply(kind=kind), self._data)
                self.record.replies.append(kind)
                self._console.print(f"[bold red]{'':>10} ◆ {_PERSON} replies to assignment {assignment.number}: {kind.value}[/]")

    async def _take_pictures(self) -> None:
        """Take the pictures. Without OpenGL, print a notice and return."""
        try:
            async with asyncio.TaskGroup() as pictures:
                pictures.create_task(self._take_picture("D", _STRONG_ROBOT, robot=_STRONG_ROBOT, carried=_CARRIED))
                for letter, (service_type, subject) in _LASTING.items():
                    while not self.record.completed(service_type):
                        await asyncio.sleep(0.01)
                    await self._take_picture(letter, subject)
        except* SimulationError as errors:
            self._console.print(f"[yellow]no pictures: {errors.exceptions[0]}[/]")

    async def _take_picture(self, letter: str, subject: str, *, robot: str | None = None, carried: float | None = None) -> None:
        (self._folder / f"{letter}.png").write_bytes(await self._operator.picture(subject, robot=robot, carried=carried))

    def _print(self) -> None:
        for line in self._trace.new():
            self.record.lines.append(line)
            if line.type != "Progress":
                self._console.print(terminal.passing(line, self.record.lines[0].at))


async def perform(system: System, folder: Path, console: Console) -> int:
    """Play the scenario, and write its results to `folder`. Return the exit code: 0 if all checks pass."""
    assert system.addresses.simulator is not None
    started = time.monotonic()
    async with Client(system.addresses) as client, operator_link(system.addresses) as operator:
        console.print(f"[bold]Scenario 3[/]: {REQUEST.effect}")
        record = await _ScenarioPlayer(system, client, operator, folder, console).play()
        ontology, map = await client.ontology(), await client.map()
        jar, door = await operator.observe(_JAR), await operator.observe(_DOOR)
    assert record.view is not None, "an accepted task has news"
    timeline_bars = bars(record.lines)
    results = Results(folder, console, "Scenario 3: what nobody can do alone", STEPS)
    results.write_map(ontology, map)
    results.write_messages(system.data, without_progress(record.lines))
    results.write_timeline(timeline_bars)
    checks = {
        "the task was accomplished": record.view.outcome is Outcome.ACCOMPLISHED,
        "the goal holds in the Repository": formula_holds(parse(REQUEST.effect), map, ontology),
        "in the simulator, the jar is on the table and the door is open": jar.support == _TABLE and door.open is True,
        **_checks_of_services(record),
    }
    console.print()
    results.show_pictures(results.write_sheet())
    completed = [line for line in record.lines if line.type == "Completed"]
    console.print(
        terminal.table("Completed steps", ("service", "situation"), ((line.sender, line.body["situation"]) for line in completed))
    )
    console.print(terminal.steps("Steps", record.view.steps))
    console.print(timeline_table(timeline_bars, [], console.width))
    console.print(terminal.outcome(record.view))
    return results.conclude(checks, started)


def _checks_of_services(record: _ScenarioRecord) -> dict[str, bool]:
    """Which services did what, each with whether it is so in the messages."""
    lines = record.lines
    conditions = [line.body.get("condition") for line in lines if line.type == "Terms" and line.sender.startswith(f"{_PATROL_ROBOT}.")]
    refusals = _devices(line.sender for line in lines if line.type == "Refuse" and line.sender.endswith(".TransferObject"))
    conditions_to_carry = [line.body.get("condition") for line in lines if line.type == "Terms" and line.sender.endswith(".TransferObject")]
    demands = {str(part) for condition in conditions_to_carry if condition for part in conjuncts(parse(condition))}
    executions = [line.recipient.partition(".")[2] for line in lines if line.type == "Execute"]
    return {
        "the patrol robot demanded that the door is open, and a robot opened it": f"{_DOOR}.Open = TRUE" in conditions
        and bool(record.completed("OpenDoor")),
        "the patrol robot found the jar": record.completed("RecognizeSituation") == [_PATROL_ROBOT],
        "the robots demanded that the jar is light enough, and the scale weighed it": demands
        >= {f"{_JAR}.Weight <= {robot}.Payload" for robot in (_WEAK_ROBOT, _STRONG_ROBOT)}
        and record.completed("WeighObject") == [_SCALE],
        "the jar is too heavy for one robot, and the other one carried it": _WEAK_ROBOT in refusals
        and record.completed("TransferObject") == [_STRONG_ROBOT],
        "the person was asked, and sealed the jar": record.replies == [ReplyKind.ACCEPT, ReplyKind.DONE]
        and record.completed("SealJar") == [_PERSON],
        "the steps came in the order that their preconditions demand": executions
        == ["OpenDoor", "RecognizeSituation", "WeighObject", "TransferObject", "SealJar"],
        "each participant with a contract was released": are_all_released(lines),
    }


def _devices(services: Iterable[str]) -> list[str]:
    """The devices of services: `Robot1` of `Robot1.OpenDoor`."""
    return [service.partition(".")[0] for service in services]
