"""Scenario 2: what a transaction survives. Three things are wanted on a platform; one robot's computer dies on the way, the Task
Manager is killed and comes back, a robot that patrols looks what became of the thing that nobody knows of, another robot takes it over,
and then the client changes its mind: what was done is undone.
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
from somrs.client.message_chart import chart
from somrs.client.timeline import Mark, bars, svg, timeline_table
from somrs.client.trace import Follower, Line
from somrs.deployment.system import System
from somrs.devices.simulator.link.link import OperatorLink
from somrs.errors import RemoteError
from somrs.ontology.files.site import dump_site
from somrs.ontology.objects import Map
from somrs.protocol.messages.clients import Policy, Submit, TaskView
from somrs.protocol.messages.events import EventKind
from somrs.protocol.messages.frp import Outcome, State

GOAL = "Platform001"
THINGS = ("Jar002", "Jar003", "Carton001")
WISH = Submit(effect=" AND ".join(f"{thing} isOn {GOAL}" for thing in THINGS), policy=Policy.TIME)
SPEED = "5"
"""Simulated seconds in a second. Limits such as how long one may be silent are in seconds of the clock on the wall."""
DYING, TAKING_OVER, LOOKING = "Robot1", "Robot2", "Patrol1"
AWAY = 1.0
"""Seconds for which the Task Manager is dead."""
UNDER_WAY = 0.4
"""The fraction of the last step at which the client changes its mind: the thing is gripped."""
MOST_TIME = 300.0
"""Seconds that everything may take."""


@dataclass(slots=True)
class Story:
    """What was done to the system so far, and what was seen."""

    marks: list[Mark] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    view: TaskView | None = None
    dead: bool = False
    killed: bool = False
    cancelled: bool = False

    def heard(self, type: str, device: str) -> list[Line]:
        """The messages of a type from or to a device."""
        return [
            line for line in self.lines if line.type == type and device in (line.sender.partition(".")[0], line.recipient.partition(".")[0])
        ]


class Stage:
    """Plays the story in a running system."""

    def __init__(self, system: System, client: Client, console: Console) -> None:
        self.story = Story()
        self._system, self._client, self._console = system, client, console
        self._trace = Follower(system.data / "messages.jsonl")

    async def play(self) -> Story:
        task = await self._client.submit(WISH)
        self._mark("client", WISH.effect)
        watching = asyncio.create_task(self._watch(task))
        try:
            async with asyncio.timeout(MOST_TIME):
                while not watching.done():
                    self._print()
                    await self._strike(task)
                    await asyncio.sleep(0.01)
            await watching
        finally:
            watching.cancel()
        await asyncio.sleep(0.5)  # the last End is on its way to those it concerns
        self._print()
        return self.story

    async def _strike(self, task: str) -> None:
        """Do the next thing of the story, if its moment has come."""
        story = self.story
        if not story.dead and story.heard("Execute", DYING):
            story.dead = True
            self._system.programs[DYING].process.kill()
            self._mark(DYING, "its computer dies, without a word")
        elif story.dead and not story.killed and story.heard("Completed", TAKING_OVER):
            story.killed = True
            self._system.programs["task-manager"].process.kill()
            self._mark("Task Manager", "is killed")
            await asyncio.sleep(AWAY)
            await self._system.restart("task-manager")
            self._mark("Task Manager", "is back, from its journal")
        elif story.killed and not story.cancelled and self._last_step_is_under_way():
            story.cancelled = True
            self._mark("client", "changes its mind")
            await self._client.cancel(task, "the client changed its mind")

    def _last_step_is_under_way(self) -> bool:
        if not self.story.heard("Completed", LOOKING):
            return False
        since = self.story.heard("Completed", LOOKING)[-1].at
        taken = [line for line in self.story.heard("Execute", TAKING_OVER) if line.at > since]
        if not taken:
            return False
        progress = [line for line in self.story.heard("Progress", TAKING_OVER) if line.participant == taken[-1].participant]
        return bool(progress) and float(progress[-1].body.get("fraction", 0)) >= UNDER_WAY

    async def _watch(self, task: str) -> None:
        """Hear what happens to the task, whether or not the Task Manager is there, until it is over."""
        async for news in self._client.news(task):
            self.story.view = news.view
            for event in news.events:
                if event.kind is not EventKind.NEWS:
                    self._console.print(Text(f"{'':>10} · ", style="dim") + terminal.event(event))

    def _mark(self, who: str, text: str) -> None:
        self.story.marks.append(Mark(at=time.time(), subject=who, text=text))
        self._console.print(f"[bold red]{'':>10} ◆ {who}: {text}[/]")

    def _print(self) -> None:
        for line in self._trace.new():
            self.story.lines.append(line)
            if line.type != "Progress":
                self._console.print(terminal.passing(line, self.story.lines[0].at))


async def perform(system: System, out: Path, console: Console) -> int:
    """Play it, and leave everything in `out`. 0 when all went as it has to."""
    assert system.addresses.simulator is not None
    host, _, port = system.addresses.simulator.rpartition(":")
    started = time.monotonic()
    async with Client(system.addresses) as client, OperatorLink(host, int(port)) as operator:
        before = await client.map()
        console.print(f"[bold]Scenario 2[/]: {WISH.effect}")
        stage = Stage(system, client, console)
        story = await stage.play()
        ontology, map = await client.ontology(), await client.map()
        stands = {thing: (await operator.observe(thing)).support for thing in THINGS}
        with contextlib.suppress(RemoteError):
            (out / "end.png").write_bytes(await operator.picture())
    assert story.view is not None, "an accepted task has news"
    (out / "map-after.yaml").write_text(dump_site(ontology, map), encoding="utf-8")
    (out / "messages.jsonl").write_bytes((system.data / "messages.jsonl").read_bytes())
    (out / "messages.svg").write_text(chart([line for line in story.lines if line.type != "Progress"], "Scenario 2"), encoding="utf-8")
    done = bars(story.lines)
    (out / "timeline.svg").write_text(svg(done, story.marks, "Scenario 2: what a transaction survives"), encoding="utf-8")
    console.print()
    console.print(timeline_table(done, story.marks))
    console.print(_work(story.view))
    console.print(terminal.outcome(story.view))
    checks = verdict(story, before, map, stands)
    console.print(terminal.table("Seen to be so", ("", ""), ((what, "yes" if so else "NO") for what, so in checks.items())))
    console.print(f"It took {time.monotonic() - started:.0f} s. Everything is in {out}/")
    return 0 if all(checks.values()) else 1


def _work(view: TaskView) -> Table:
    rows = ((work.step, work.service, work.inputs.get("Object", ""), work.state.value, work.before or "-") for work in view.work)
    return terminal.table("What was done, and what became of it", ("step", "service", "thing", "in the end", "to restore"), rows)


def verdict(story: Story, before: Map, after: Map, stands: dict[str, str | None]) -> dict[str, bool]:
    """What has to be so at the end."""
    assert story.view is not None, "an accepted task has news"
    at_first, now = _places(before), _places(after)
    executed = [line.message_id for line in story.lines if line.type == "Execute"]
    homes = {line.participant for line in story.lines if line.type in ("End", "Cancel")}
    accepted = {line.participant for line in story.lines if line.type == "Accept"}
    return {
        "a robot fell silent, and it was looked at what it left": bool(story.heard("Query", DYING) and story.heard("Completed", LOOKING)),
        "the Task Manager was killed, and the same task went on": story.killed and story.view.outcome is not None,
        "the task was cancelled, as the client wanted": story.view.outcome is Outcome.CANCELLED,
        "each step that was done is undone": bool(story.view.work)
        and all(work.state in (State.COMPENSATED, State.UNREACHABLE) for work in story.view.work if work.before is not None),
        "everything stands where it stood, says the Repository": all(now[thing] == at_first[thing] for thing in THINGS),
        "everything stands where the Repository says, in the physics": all(stands[thing] == now[thing] for thing in THINGS),
        "everyone who had a contract was sent home": accepted <= homes,
        "nothing was told twice": len(set(executed)) == len({line.participant for line in story.lines if line.type == "Execute"}),
    }


def _places(map: Map) -> dict[str, str | None]:
    return {thing: next((arguments[1] for arguments in map.facts_with("isOn", 0, thing)), None) for thing in THINGS}
