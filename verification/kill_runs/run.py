"""One run: a task, a kill in the middle of it, and what came of both."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field

import msgspec

from somrs.client.client import Client
from somrs.client.task_history import TaskHistory
from somrs.client.trace import TASK_MANAGER, Line
from somrs.errors import RemoteError, SomrsError
from somrs.protocol.messages import frp
from somrs.protocol.messages.clients import Cancelling, CancelTask, Submit, TaskView
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.records import ReadRecords
from verification.kill_runs import truth
from verification.kill_runs.bystanders import CHANGED, Acknowledged, Bystanders
from verification.kill_runs.draw import Case, Victim
from verification.kill_runs.plays import THINGS, Act, Cue
from verification.kill_runs.stage import Stage, Trouble
from verification.kill_runs.tail import Tail

LOOK = 0.001
"""Seconds between two looks at the messages."""
MOST_TIME = 180.0
"""Seconds that a task may take, with its kill."""
PATIENCE = 90.0
"""Seconds for which a client waits for a Task Manager that is away."""
HOME_TIME = 20.0
"""Seconds after the outcome in which everyone has to be at home."""
NOTICED = 6.0
"""Seconds that the map may take to agree with the world, once everyone is at home."""


class Result(msgspec.Struct, kw_only=True):
    """What came of a run. `problems`: what is not as it has to be. `missed`: the kill came when all was over, or never."""

    case: str
    seed: int
    attempt: int
    message: str
    victim: str
    play: str
    struck: str = ""
    problems: list[str] = []
    missed: str = ""
    outcome: str = ""
    unknown: list[str] = []
    to_progress: float | None = None
    """Seconds from when the victim was ready again to the next message of the protocol; 0 when nothing had waited for it."""
    to_outcome: float | None = None
    acknowledged: int = 0
    lost: list[str] = []
    took: float = 0.0

    @property
    def recovered(self) -> bool:
        return not self.problems and not self.lost and not self.missed


@dataclass(slots=True)
class _Story:
    """What happened so far."""

    lines: list[Line] = field(default_factory=list)
    transaction: str = ""
    counted: int = 0
    struck_at: float | None = None
    device: str = ""
    cue_at: float = 0.0
    """When the message passed at which somebody is struck."""
    ready_at: float | None = None
    cancelled_at: float | None = None
    view: TaskView | None = None
    frozen: str = ""


class Run:
    """Plays a case in a system that was set right."""

    def __init__(self, stage: Stage, case: Case) -> None:
        self._stage, self._case = stage, case
        self._story = _Story()
        self._todo: list[Cue] = list(case.play.cues)
        self._acts: list[asyncio.Task[None]] = []
        self._addresses: dict[str, str] = {}

    async def play(self) -> Result:
        case = self._case
        began = time.monotonic()
        result = Result(case=str(case), seed=case.seed, attempt=case.attempt, message=case.message, victim=case.victim, play=case.play.name)
        try:
            await self._stage.set_right()
            await self._stage.all_free()
            acknowledged = await self._perform()
            await self._judge(result, acknowledged)
        except (Trouble, SomrsError, TimeoutError, OSError) as error:
            result.problems.append(f"{type(error).__name__}: {error}")
        if result.missed and (result.problems or result.lost):
            result.problems.append(f"and there was no kill: {result.missed}")
            result.missed = ""  # what is wrong is wrong without a kill, too
        result.took = time.monotonic() - began
        return result

    @property
    def lines(self) -> list[Line]:
        return self._story.lines

    @property
    def view(self) -> TaskView | None:
        """The task as its client heard of it last."""
        return self._story.view

    # The play

    async def _perform(self) -> Acknowledged:
        stage, case = self._stage, self._case
        self._addresses = await stage.devices()
        for robot, fault in case.play.broken:
            await stage.operator.fault(robot, fault)
        for one in case.play.breaks:
            await stage.operator.schedule(one.robot, one.fault, delay=one.delay, carried=one.carried, released=one.released)
        bystanders = Bystanders(stage.client, f"{case.seed}.{case.attempt}")
        async with contextlib.AsyncExitStack() as opened:
            tail = Tail(stage.data / "messages.jsonl")
            opened.callback(tail.close)
            await opened.enter_async_context(bystanders.at_work())
            client = await opened.enter_async_context(Client(stage.system.addresses))
            await opened.enter_async_context(self._acting())
            async with asyncio.timeout(MOST_TIME):
                watching = asyncio.create_task(self._watch(client))
                self._acts.append(watching)
                over = False
                while not over:
                    over = all(act.done() for act in self._acts)  # and then one more look
                    self._look(tail, bystanders)
                    for act in (act for act in self._acts if act.done()):
                        act.result()
                    over = over and all(act.done() for act in self._acts)
                    await asyncio.sleep(LOOK)
        return bystanders.acknowledged

    @contextlib.asynccontextmanager
    async def _acting(self) -> AsyncIterator[None]:
        try:
            yield
        finally:
            for act in self._acts:
                act.cancel()
            if self._story.frozen:
                self._stage.signal(self._story.frozen, signal.SIGCONT)

    async def _watch(self, client: Client) -> None:
        """Submit the task, and hear of it until it is over, whether or not the Task Manager is there."""
        task = await client.submit(Submit(effect=self._case.wish, policy=self._case.policy), patience=PATIENCE)
        async for news in client.news(task):
            self._story.view = news.view

    def _look(self, tail: Tail, bystanders: Bystanders) -> None:
        story, case = self._story, self._case
        for line in tail.new():
            story.transaction = story.transaction or (line.transaction if line.type == "Arrange" else "")
            if line.transaction != story.transaction:
                continue  # somebody was late to say something about an earlier task
            story.lines.append(line)
            if line.type == case.message:
                story.counted += 1
                if story.counted == case.nth and story.struck_at is None:
                    story.device = self._device(line)
                    story.struck_at = story.cue_at = line.at
                    bystanders.burst()
                    self._acts.append(asyncio.create_task(self._strike()))
            for cue in [cue for cue in self._todo if cue.type == line.type and float(line.body.get("fraction", 0)) >= cue.fraction]:
                self._todo.remove(cue)
                self._acts.append(asyncio.create_task(self._act(cue.act, line)))

    def _device(self, line: Line) -> str:
        """Which device it is that is struck, if one is."""
        here = _device_of(line)
        others = sorted({_device_of(other) for other in self.lines} - {here})
        which = self._case.which
        return here if which < 0.5 or not others else others[min(int((which - 0.5) * 2 * len(others)), len(others) - 1)]

    async def _strike(self) -> None:
        case, story = self._case, self._story
        if case.delay:
            await asyncio.sleep(case.delay)
        story.struck_at = time.time()
        await self._stage.strike(case.victim, story.device)
        await asyncio.sleep(case.pause)
        await self._stage.revive(case.victim, story.device)
        story.ready_at = time.time()

    async def _act(self, act: Act, line: Line) -> None:
        stage, device = self._stage, _device_of(line)
        match act:
            case Act.CANCEL:
                wanted = CancelTask(task=line.transaction, reason="the client changed its mind")
                await stage.client.ask(stage.system.addresses.task_manager, wanted, Cancelling, patience=PATIENCE)
                self._story.cancelled_at = time.time()
            case Act.FREEZE:
                self._story.frozen = device
                stage.signal(device, signal.SIGSTOP)
            case Act.THAW:
                stage.signal(self._story.frozen, signal.SIGCONT)
            case Act.STRAY:
                body = frp.Compensate(situation=self._case.wish) if self._case.which < 0.5 else frp.Stopped()
                coordinator = stage.system.addresses.task_manager
                with contextlib.suppress(RemoteError):  # it may be just what is struck; without its Fault, the kill counts as missed
                    await stage.say(self._addresses[device], line.transaction, line.participant, body, sender=coordinator)

    # The judgement

    async def _judge(self, result: Result, acknowledged: Acknowledged) -> None:
        story, case, stage = self._story, self._case, self._stage
        assert story.view is not None, "the task was watched to its end"
        view = story.view
        result.outcome = str(view.outcome)
        result.struck = story.device if case.victim in (Victim.DEVICE, Victim.LINK) else case.victim
        result.missed = self._missed(view)
        self._measure(result, view)
        await stage.mend()
        states = await self._sent_home(view.task)
        homeless = list(truth.at_home(states))
        records = await TaskHistory(stage.client.records, stage.client).first(ReadRecords(task=view.task), 2)
        if len(records) != 1:
            result.problems.append(f"{len(records)} records of the task are kept, and not one")
        result.problems += truth.outcome(case, view, records, story.device, story.cancelled_at)
        for record in records:
            result.problems += truth.protocol(truth.told(record))
        result.problems += await self._disagreements(result)
        result.problems += truth.undone(case, view, await stage.client.map())
        result.lost += homeless
        result.lost += truth.lost_tasks(acknowledged, await self._outcomes(acknowledged))
        result.lost += truth.lost_updates(acknowledged, (await stage.client.history(CHANGED, limit=1000)).events)
        sent = {line.message_id for line in self.lines if line.type in ("Accept", "Execute", "Stop", "Compensate")}
        result.acknowledged = len(acknowledged.tasks) + len(acknowledged.versions) + len(sent) + 1

    def _missed(self, view: TaskView) -> str:
        story, case = self._story, self._case
        if story.struck_at is None:
            return f"there were {story.counted} of {case.nth} {case.message}"
        ended = view.ended_at
        if case.message != "End" and ended is not None and story.struck_at > ended:
            late, after = story.struck_at - ended, ended - story.cue_at
            return f"the task was over {late * 1000:.0f} ms before, {after * 1000:.0f} ms after the message"
        return ""

    def _measure(self, result: Result, view: TaskView) -> None:
        story = self._story
        if story.struck_at is None or story.ready_at is None or view.ended_at is None:
            return
        result.to_outcome = max(0.0, view.ended_at - story.ready_at)
        later = [line.at for line in self.lines if line.at > story.ready_at]
        result.to_progress = max(0.0, later[0] - story.ready_at) if later and result.to_outcome else 0.0

    async def _sent_home(self, transaction: str) -> dict[str, State]:
        """The states of all that took part, as their Service Managers tell; once all are at home, or it has taken too long."""
        end = time.monotonic() + HOME_TIME
        participants = sorted({line.participant for line in self.lines})
        while True:
            found: dict[str, State] = {}
            with contextlib.suppress(RemoteError):  # one of them may be starting, or not registered again
                addresses = await self._stage.devices()
                missing = {_of(one) for one in participants} - set(addresses)
                if not missing:
                    for one in participants:
                        found[one] = await self._stage.state(addresses[_of(one)], transaction, one)
                    if not [*truth.at_home(found)]:
                        return found
            if time.monotonic() > end:
                if len(found) < len(participants):
                    raise Trouble(f"after {HOME_TIME:.0f} s only {len(found)} of {len(participants)} participants can be asked")
                return found
            await asyncio.sleep(0.05)

    async def _disagreements(self, result: Result) -> list[str]:
        """Where the map and the world differ once nothing moves any more, and those who made way have said where they are."""
        stage = self._stage
        end = time.monotonic() + NOTICED
        while True:
            await stage.operator.idle()
            map = await stage.client.map()
            seen = {thing: await stage.operator.observe(thing) for thing in THINGS}
            robots = await stage.operator.robots()
            result.unknown = truth.unknown(map, THINGS)
            wrong = [*truth.of_things(map, stage.ontology, seen), *truth.of_robots(map, stage.ontology, robots)]
            if not wrong or time.monotonic() > end:
                return wrong
            await asyncio.sleep(0.2)

    async def _outcomes(self, acknowledged: Acknowledged) -> dict[str, Outcome | None]:
        """What became of the bystanders' tasks: those that are not over yet have some time left."""
        client, end = self._stage.client, time.monotonic() + HOME_TIME
        while True:
            known = {view.task: view.outcome for view in await client.tasks()}
            found = {task: known[task] for task in acknowledged.tasks if task in known}
            for task in acknowledged.tasks:
                if task not in known:
                    found |= {one.task: one.outcome for one in (await client.records(ReadRecords(task=task))).records}
            if all(outcome is not None for outcome in found.values()) or time.monotonic() > end:
                return found
            await asyncio.sleep(0.2)


def _device_of(line: Line) -> str:
    return _of(line.participant) or _of(line.recipient if line.sender == TASK_MANAGER else line.sender)


def _of(participant: str) -> str:
    """The device in a participant's id."""
    return participant.partition(".")[0]
