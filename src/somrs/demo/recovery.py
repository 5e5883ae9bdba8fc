"""Scenario 2: what a transaction survives.

The goal is to have three things on a platform. The computer of one robot crashes on the way. The Task Manager is killed and restarted.
A patrol robot finds the thing whose position is unknown, and another robot carries it on. Then the client cancels the task, and the
completed steps are compensated.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from somrs.client import terminal
from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.client.timeline import Mark, bars, timeline_table
from somrs.client.trace import Follower, Line, trace_file
from somrs.demo.results import Results, are_all_released, without_progress
from somrs.deployment.system import System
from somrs.errors import RemoteError
from somrs.ontology.map import Map
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.submission import Policy, Submit
from somrs.protocol.messages.task_views import TaskView

_DESTINATION = "Platform001"
_THINGS = ("Jar002", "Jar003", "Carton001")
_REQUEST = Submit(effect=" AND ".join(f"{thing} isOn {_DESTINATION}" for thing in _THINGS), policy=Policy.TIME)
SPEED = "5"
"""Simulated seconds per second. Timeouts, such as that of heartbeats, are in seconds of real time."""
_FAILING_ROBOT, _SUBSTITUTE_ROBOT, _PATROL_ROBOT = "Robot1", "Robot2", "Patrol1"
DOWNTIME = 1.0
"""Seconds between the kill and the restart of the Task Manager."""
UNDER_WAY = 0.4
"""The fraction of the last step at which the client cancels the task: the thing has been gripped."""
MOST_TIME = 300.0
"""Longest duration of the scenario, in seconds."""


@dataclass(slots=True)
class ScenarioRecord:
    """The actions on the system so far, and the messages and events that were observed."""

    marks: list[Mark] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    view: TaskView | None = None
    dead: bool = False
    killed: bool = False
    cancelled: bool = False

    def find_messages(self, type: str, device: str) -> list[Line]:
        """The messages of a type from or to a device."""
        return [
            line for line in self.lines if line.type == type and device in (line.sender.partition(".")[0], line.recipient.partition(".")[0])
        ]


class _ScenarioPlayer:
    """Plays the scenario in a running system."""

    def __init__(self, system: System, client: Client, console: Console) -> None:
        self.record = ScenarioRecord()
        self._system, self._client, self._console = system, client, console
        self._trace = Follower(trace_file(system.data))

    async def play(self) -> ScenarioRecord:
        task = await self._client.submit(_REQUEST)
        self._mark("client", _REQUEST.effect)
        watcher = asyncio.create_task(self._watch(task))
        try:
            async with asyncio.timeout(MOST_TIME):
                while not watcher.done():
                    self._print()
                    await self._take_next_action(task)
                    await asyncio.sleep(0.01)
            await watcher
        finally:
            watcher.cancel()
        await asyncio.sleep(0.5)  # the last End messages are in transit
        self._print()
        return self.record

    async def _take_next_action(self, task: str) -> None:
        """Take the next action of the scenario if its trigger has occurred."""
        record = self.record
        if not record.dead and record.find_messages("Execute", _FAILING_ROBOT):
            record.dead = True
            self._system.programs[_FAILING_ROBOT].process.kill()
            self._mark(_FAILING_ROBOT, "its computer crashes")
        elif record.dead and not record.killed and record.find_messages("Completed", _SUBSTITUTE_ROBOT):
            record.killed = True
            self._system.programs["task-manager"].process.kill()
            self._mark("Task Manager", "is killed")
            await asyncio.sleep(DOWNTIME)
            await self._system.restart("task-manager")
            self._mark("Task Manager", "restarts from its journal")
        elif record.killed and not record.cancelled and self._last_step_is_under_way():
            record.cancelled = True
            self._mark("client", "cancels the task")
            await self._client.cancel(task, "the client changed its mind")

    def _last_step_is_under_way(self) -> bool:
        if not self.record.find_messages("Completed", _PATROL_ROBOT):
            return False
        observation_time = self.record.find_messages("Completed", _PATROL_ROBOT)[-1].at
        executions = [line for line in self.record.find_messages("Execute", _SUBSTITUTE_ROBOT) if line.at > observation_time]
        if not executions:
            return False
        progress = [
            line for line in self.record.find_messages("Progress", _SUBSTITUTE_ROBOT) if line.participant == executions[-1].participant
        ]
        return bool(progress) and float(progress[-1].body.get("fraction", 0)) >= UNDER_WAY

    async def _watch(self, task: str) -> None:
        """Follow the events of the task until it ends, also while the Task Manager is down."""
        async for news in self._client.news(task):
            self.record.view = news.view
            for event in news.events:
                if event.kind is not EventKind.NEWS:
                    self._console.print(Text(f"{'':>10} · ", style="dim") + terminal.event(event))

    def _mark(self, actor: str, text: str) -> None:
        self.record.marks.append(Mark(at=time.time(), subject=actor, text=text))
        self._console.print(f"[bold red]{'':>10} ◆ {actor}: {text}[/]")

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
        map_before = await client.map()
        console.print(f"[bold]Scenario 2[/]: {_REQUEST.effect}")
        player = _ScenarioPlayer(system, client, console)
        record = await player.play()
        ontology, map = await client.ontology(), await client.map()
        actual_places = {thing: (await operator.observe(thing)).support for thing in _THINGS}
        with contextlib.suppress(RemoteError):
            (folder / "end.png").write_bytes(await operator.picture())
    assert record.view is not None, "an accepted task has news"
    timeline_bars = bars(record.lines)
    results = Results(folder, console, "Scenario 2: what a transaction survives", {})
    results.write_map(ontology, map)
    results.write_messages(system.data, without_progress(record.lines))
    results.write_timeline(timeline_bars, record.marks)
    console.print()
    console.print(timeline_table(timeline_bars, record.marks, console.width))
    console.print(_execution_table(record.view))
    console.print(terminal.outcome(record.view))
    return results.conclude(_verdict(record, map_before, map, actual_places), started)


def _execution_table(view: TaskView) -> Table:
    rows = ((work.step, work.service, work.inputs.get("Object", ""), work.state.value, work.before or "-") for work in view.work)
    return terminal.table("Work and its final state", ("step", "service", "object", "final state", "to restore"), rows)


def _verdict(record: ScenarioRecord, map_before: Map, map_after: Map, actual_places: dict[str, str | None]) -> dict[str, bool]:
    """The checks of the scenario's result, each with whether it passed."""
    assert record.view is not None, "an accepted task has news"
    initial_places, final_places = _places(map_before), _places(map_after)
    executed = [line.message_id for line in record.lines if line.type == "Execute"]
    return {
        "a robot fell silent, and the patrol robot observed what it left": bool(
            record.find_messages("Query", _FAILING_ROBOT) and record.find_messages("Completed", _PATROL_ROBOT)
        ),
        "the Task Manager was killed, and the same task continued": record.killed and record.view.outcome is not None,
        "the task was cancelled, as the client requested": record.view.outcome is Outcome.CANCELLED,
        "each completed step was compensated": bool(record.view.work)
        and all(work.state in (State.COMPENSATED, State.UNREACHABLE) for work in record.view.work if work.before is not None),
        "in the Repository, each thing is where it was at the start": all(
            final_places[thing] == initial_places[thing] for thing in _THINGS
        ),
        "in the simulator, each thing is where the Repository says": all(actual_places[thing] == final_places[thing] for thing in _THINGS),
        "each participant with a contract was released": are_all_released(record.lines),
        "no service was executed twice": len(set(executed)) == len({line.participant for line in record.lines if line.type == "Execute"}),
    }


def _places(map: Map) -> dict[str, str | None]:
    return {thing: next((arguments[1] for arguments in map.facts_with("isOn", 0, thing)), None) for thing in _THINGS}
