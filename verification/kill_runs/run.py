"""One run: a task, a kill during the task, and the checks after both."""

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
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.records import ReadRecords
from somrs.protocol.messages.submission import Cancelling, CancelTask, Submit
from somrs.protocol.messages.task_views import TaskView
from verification.kill_runs import checks
from verification.kill_runs.bystanders import CHANGED, Acknowledged, Bystanders
from verification.kill_runs.draw import Case, Victim
from verification.kill_runs.running_system import RunningSystem, Trouble
from verification.kill_runs.scenarios import THINGS, Action, Trigger
from verification.kill_runs.tail import Tail

LOOK = 0.001
"""Seconds between two reads of the messages."""
MOST_TIME = 180.0
"""Seconds within which a task has to end, with the kill."""
PATIENCE = 90.0
"""Seconds for which a client waits for a Task Manager that is down."""
HOME_TIME = 20.0
"""Seconds after the outcome within which every participant has to be released."""
NOTICED = 6.0
"""Seconds for the map to agree with the world, once every participant is released."""


class Result(msgspec.Struct, kw_only=True):
    """The result of a run. `problems`: violated checks. `missed`: why there was no kill during the task, if so."""

    case: str
    seed: int
    attempt: int
    message: str
    victim: str
    scenario: str
    struck: str = ""
    problems: list[str] = []
    missed: str = ""
    outcome: str = ""
    unknown: list[str] = []
    to_progress: float | None = None
    """Seconds from the restart of the victim to the next message of the protocol; 0 if nothing waited for the victim."""
    to_outcome: float | None = None
    to_take_over: float | None = None
    """Seconds from the kill of a host until its standbys lead."""
    acknowledged: int = 0
    lost: list[str] = []
    duration: float = 0.0

    @property
    def recovered(self) -> bool:
        return not self.problems and not self.lost and not self.missed


@dataclass(slots=True)
class _RunState:
    """The course of a run so far."""

    lines: list[Line] = field(default_factory=list)
    transaction: str = ""
    counted: int = 0
    struck_at: float | None = None
    device: str = ""
    cue_at: float = 0.0
    """The time of the message that triggers the kill."""
    ready_at: float | None = None
    cancelled_at: float | None = None
    view: TaskView | None = None
    frozen: str = ""


class Run:
    """Plays a case in a system that is in its initial state."""

    def __init__(self, running_system: RunningSystem, case: Case) -> None:
        self._running_system, self._case = running_system, case
        self._state = _RunState()
        self._pending_triggers: list[Trigger] = list(case.scenario.triggers)
        self._acts: list[asyncio.Task[None]] = []
        self._addresses: dict[str, str] = {}

    async def play(self) -> Result:
        case = self._case
        started_at = time.monotonic()
        result = Result(
            case=str(case), seed=case.seed, attempt=case.attempt, message=case.message, victim=case.victim, scenario=case.scenario.name
        )
        try:
            await self._running_system.set_right()
            await self._running_system.all_free()
            acknowledged = await self._perform()
            await self._judge(result, acknowledged)
        except (Trouble, SomrsError, TimeoutError, OSError) as error:
            result.problems.append(f"{type(error).__name__}: {error}")
        if result.missed and (result.problems or result.lost):
            result.problems.append(f"there was no kill: {result.missed}")
            result.missed = ""  # a problem without a kill is a failure, too
        result.duration = time.monotonic() - started_at
        return result

    @property
    def lines(self) -> list[Line]:
        return self._state.lines

    @property
    def view(self) -> TaskView | None:
        """The last view of the task that the client received."""
        return self._state.view

    # The course of the run

    async def _perform(self) -> Acknowledged:
        running_system, case = self._running_system, self._case
        self._addresses = await running_system.devices()
        for robot, fault in case.scenario.broken:
            await running_system.operator.fault(robot, fault)
        for breakdown in case.scenario.breaks:
            await running_system.operator.schedule(
                breakdown.robot, breakdown.fault, delay=breakdown.delay, carried=breakdown.carried, released=breakdown.released
            )
        bystanders = Bystanders(running_system.client, f"{case.seed}.{case.attempt}")
        async with contextlib.AsyncExitStack() as opened:
            tail = Tail(running_system.message_files)
            opened.callback(tail.close)
            await opened.enter_async_context(bystanders.at_work())
            client = await opened.enter_async_context(Client(running_system.system.addresses))
            await opened.enter_async_context(self._acting())
            async with asyncio.timeout(MOST_TIME):
                watching = asyncio.create_task(self._watch(client))
                self._acts.append(watching)
                is_finished = False
                while not is_finished:
                    is_finished = all(act.done() for act in self._acts)  # before the last read of the messages
                    self._look(tail, bystanders)
                    for act in (act for act in self._acts if act.done()):
                        act.result()
                    is_finished = is_finished and all(act.done() for act in self._acts)
                    await asyncio.sleep(LOOK)
        return bystanders.acknowledged

    @contextlib.asynccontextmanager
    async def _acting(self) -> AsyncIterator[None]:
        try:
            yield
        finally:
            for act in self._acts:
                act.cancel()
            if self._state.frozen:
                self._running_system.signal(self._state.frozen, signal.SIGCONT)

    async def _watch(self, client: Client) -> None:
        """Submit the task, and follow it to its end, even if the Task Manager restarts."""
        task = await client.submit(Submit(effect=self._case.goal, policy=self._case.policy), patience=PATIENCE)
        async for news in client.news(task):
            self._state.view = news.view

    def _look(self, tail: Tail, bystanders: Bystanders) -> None:
        state, case = self._state, self._case
        for line in tail.new():
            state.transaction = state.transaction or (line.transaction if line.type == "Arrange" else "")
            if line.transaction != state.transaction:
                continue  # a late message of an earlier task
            state.lines.append(line)
            if line.type == case.message:
                state.counted += 1
                if state.counted == case.nth and state.struck_at is None:
                    state.device = self._device(line)
                    state.struck_at = state.cue_at = line.at
                    bystanders.burst()
                    self._acts.append(asyncio.create_task(self._strike()))
            for trigger in [
                trigger
                for trigger in self._pending_triggers
                if trigger.type == line.type and float(line.body.get("fraction", 0)) >= trigger.fraction
            ]:
                self._pending_triggers.remove(trigger)
                self._acts.append(asyncio.create_task(self._act(trigger.action, line)))

    def _device(self, line: Line) -> str:
        """Return the device that is the victim, if the victim is a device."""
        device = _device_of(line)
        other_devices = sorted({_device_of(other_line) for other_line in self.lines} - {device})
        choice = self._case.device_choice
        return (
            device
            if choice < 0.5 or not other_devices
            else other_devices[min(int((choice - 0.5) * 2 * len(other_devices)), len(other_devices) - 1)]
        )

    async def _strike(self) -> None:
        case, state = self._case, self._state
        if case.delay:
            await asyncio.sleep(case.delay)
        state.struck_at = time.time()
        await self._running_system.strike(case.victim, state.device)
        if case.victim is not Victim.HOST:
            await asyncio.sleep(case.pause)
        await self._running_system.revive(case.victim, state.device)
        state.ready_at = time.time()

    async def _act(self, action: Action, line: Line) -> None:
        running_system, device = self._running_system, _device_of(line)
        match action:
            case Action.CANCEL:
                request = CancelTask(task=line.transaction, reason="the client changed its mind")
                await running_system.client.ask(running_system.system.addresses.task_manager, request, Cancelling, patience=PATIENCE)
                self._state.cancelled_at = time.time()
            case Action.FREEZE:
                self._state.frozen = device
                running_system.signal(device, signal.SIGSTOP)
            case Action.THAW:
                running_system.signal(self._state.frozen, signal.SIGCONT)
            case Action.STRAY:
                body = frp.Compensate(situation=self._case.goal) if self._case.device_choice < 0.5 else frp.Stopped()
                coordinator = running_system.system.addresses.task_manager
                with contextlib.suppress(RemoteError):  # the device may be the victim; without its Fault, the kill counts as missed
                    await running_system.send(self._addresses[device], line.transaction, line.participant, body, sender=coordinator)

    # The checks

    async def _judge(self, result: Result, acknowledged: Acknowledged) -> None:
        state, case, running_system = self._state, self._case, self._running_system
        assert state.view is not None, "the task was followed to its end"
        view = state.view
        result.outcome = str(view.outcome)
        result.struck = state.device if case.victim in (Victim.DEVICE, Victim.LINK) else case.victim
        result.missed = self._missed(view)
        self._measure(result, view)
        await running_system.mend()
        states = await self._sent_home(view.task)
        unreleased = list(checks.unreleased(states))
        records = await TaskHistory(running_system.client.records, running_system.client).first(ReadRecords(task=view.task), 2)
        if len(records) != 1:
            result.problems.append(f"there are {len(records)} records of the task, and not one")
        result.problems += checks.outcome(case, view, records, state.device, state.cancelled_at)
        for record in records:
            result.problems += checks.protocol(checks.logged_messages(record))
        result.problems += await self._disagreements(result)
        result.problems += checks.undone(case, view, await running_system.client.map())
        result.lost += unreleased
        result.lost += checks.lost_tasks(acknowledged, await self._outcomes(acknowledged))
        result.lost += checks.lost_updates(acknowledged, (await running_system.client.history(CHANGED, limit=1000)).events)
        order_ids = {line.message_id for line in self.lines if line.type in ("Accept", "Execute", "Stop", "Compensate")}
        result.acknowledged = len(acknowledged.tasks) + len(acknowledged.versions) + len(order_ids) + 1

    def _missed(self, view: TaskView) -> str:
        state, case = self._state, self._case
        if state.struck_at is None:
            return f"there were {state.counted} of {case.nth} {case.message}"
        ended = view.ended_at
        if case.message != "End" and ended is not None and state.struck_at > ended:
            late, delay = state.struck_at - ended, ended - state.cue_at
            return f"the task had ended {late * 1000:.0f} ms before, {delay * 1000:.0f} ms after the message"
        return ""

    def _measure(self, result: Result, view: TaskView) -> None:
        state = self._state
        if state.struck_at is None or state.ready_at is None or view.ended_at is None:
            return
        result.to_outcome = max(0.0, view.ended_at - state.ready_at)
        if self._case.victim is Victim.HOST:
            result.to_take_over = state.ready_at - state.struck_at
        next_times = [line.at for line in self.lines if line.at > state.ready_at]
        result.to_progress = max(0.0, next_times[0] - state.ready_at) if next_times and result.to_outcome else 0.0

    async def _sent_home(self, transaction: str) -> dict[str, State]:
        """Return the states of all participants from their Service Managers, once all are released or the time is up."""
        end = time.monotonic() + HOME_TIME
        participants = sorted({line.participant for line in self.lines})
        while True:
            states: dict[str, State] = {}
            with contextlib.suppress(RemoteError):  # a device may be starting, or may not be registered again
                addresses = await self._running_system.devices()
                missing = {_device_name(participant) for participant in participants} - set(addresses)
                if not missing:
                    for participant in participants:
                        states[participant] = await self._running_system.state(
                            addresses[_device_name(participant)], transaction, participant
                        )
                    if not [*checks.unreleased(states)]:
                        return states
            if time.monotonic() > end:
                if len(states) < len(participants):
                    raise Trouble(f"after {HOME_TIME:.0f} s only {len(states)} of {len(participants)} participants can be queried")
                return states
            await asyncio.sleep(0.05)

    async def _disagreements(self, result: Result) -> list[str]:
        """Return the differences between map and world after all movements have ended and have been reported."""
        running_system = self._running_system
        end = time.monotonic() + NOTICED
        while True:
            await running_system.operator.idle()
            map = await running_system.client.map()
            observed = {thing: await running_system.operator.observe(thing) for thing in THINGS}
            robots = await running_system.operator.robots()
            result.unknown = checks.unknown(map, THINGS)
            wrong = [*checks.of_things(map, running_system.ontology, observed), *checks.of_robots(map, running_system.ontology, robots)]
            if not wrong or time.monotonic() > end:
                return wrong
            await asyncio.sleep(0.2)

    async def _outcomes(self, acknowledged: Acknowledged) -> dict[str, Outcome | None]:
        """Return the outcomes of the bystanders' tasks, waiting for those that have not ended."""
        client, end = self._running_system.client, time.monotonic() + HOME_TIME
        while True:
            known_outcomes = {view.task: view.outcome for view in await client.tasks()}
            outcomes = {task: known_outcomes[task] for task in acknowledged.tasks if task in known_outcomes}
            for task in acknowledged.tasks:
                if task not in known_outcomes:
                    outcomes |= {record.task: record.outcome for record in (await client.records(ReadRecords(task=task))).records}
            if all(outcome is not None for outcome in outcomes.values()) or time.monotonic() > end:
                return outcomes
            await asyncio.sleep(0.2)


def _device_of(line: Line) -> str:
    return _device_name(line.participant) or _device_name(line.recipient if line.sender == TASK_MANAGER else line.sender)


def _device_name(participant: str) -> str:
    """Return the device of a participant's id."""
    return participant.partition(".")[0]
