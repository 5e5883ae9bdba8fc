"""A whole system on virtual time for tests: Repository, Registry, Task Manager, and devices with scripted work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from somrs.kernel.component import Answered, Effect, Input, Started
from somrs.ontology.files.loading import load_text
from somrs.ontology.map import Map
from somrs.ontology.services import ServiceType
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.knowledge import Definitions, UpdateMap
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord
from somrs.protocol.messages.submission import Submit, Submitted, TaskRejected
from somrs.protocol.messages.task_views import TaskView
from somrs.registry.component import SCHEMA as REGISTRY
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.virtual_network import Medium, promptly
from somrs.runtime.virtual_time import Watch, Work, World
from somrs.service_manager.participant.participant import SCHEMA as SERVICE_MANAGER
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.sdk.device import Device
from somrs.service_manager.sdk.orders import (
    Capability,
    Halt,
    Order,
    Perform,
    Profile,
    Quote,
    Quoted,
    Refusal,
    Report,
    ServiceFailed,
    Undo,
    WorkDone,
)
from somrs.task_manager.manager import SCHEMA, TaskManager
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.views import view
from tests.support.building import wide_building
from tests.support.virtual_devices import in_virtual_time, make_ask

SITE = (
    wide_building("Test")
    + """
  Cupboard001: {type: Cupboard, at: [1, 1, 0], Shape: {Form: Box, Width: 0.5, Depth: 1, Height: 0.8}}
  Cupboard002: {type: Cupboard, at: [1, 4, 0], Shape: {Form: Box, Width: 0.5, Depth: 1, Height: 0.8}}
  Platform001: {type: Platform, at: [8, 2, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.3}}
  Jar001: {type: Jar, at: [1, 3.8, 0.8]}
  Jar002: {type: Jar, at: [1, 1, 0.8]}
  Tin001: {type: Jar, at: [1, 1.3, 0.8]}
  LostJar: {type: Jar, at: [0, 0, 0]}
  Robot1: {type: PioneerP3DX, at: [3, 3]}
  Robot2: {type: PioneerP3DX, at: [5, 3]}
  Robot3: {type: PioneerP3DX, at: [7, 3]}
  Robot4: {type: PioneerP3DX, at: [9, 3]}
facts:
  - Jar001 isOn Cupboard002
  - Jar002 isOn Cupboard001
  - Tin001 isOn Cupboard001
"""
)

Script = Callable[[Order], Work]
"""A device's script for an order: pairs of seconds and the report that follows."""

Undoes = Callable[[Order, str], Work]
"""A device's script that restores a situation."""


@dataclass(slots=True)
class Robot:
    """A scripted device: price, declared duration, and the script of its work (None: the effect, after the duration).

    `refuses`: why it gives no terms, `not_now` or never. `mute`: it does not answer. `halts`: seconds that it takes to stop. `valid_for`:
    seconds for which its terms hold.
    """

    name: str
    price: float
    duration: float
    works: Script | None = None
    refuses: str = ""
    not_now: bool = False
    needs: str | None = None
    """The condition with which it refuses, if it does."""
    mute: bool = False
    halts: float = 1.0
    valid_for: float = 60.0
    lays_down: str | None = None
    """The situation that it reports after a stop; None: no report."""
    penalty: float | None = None
    """The penalty for undoing in its terms."""
    undoes: Undoes | None = None
    """The script of its compensation; None: it cannot compensate."""
    orders: list[Order] = field(default_factory=list)

    def carry_out(self, task: object) -> Work:
        match task:
            case Quote():
                if self.mute:
                    return
                if self.refuses:
                    yield 0.1, Refusal(self.refuses, not_now=self.not_now, condition=self.needs)
                else:
                    yield 0.1, Quoted(price=self.price, duration=self.duration, penalty=self.penalty)
            case Perform(order):
                self.orders.append(order)
                if self.works is not None:
                    yield from self.works(order)
                else:
                    yield self.duration, WorkDone(situation=transfer_effect(order))
            case Undo(order, situation) if self.undoes is not None:
                yield from self.undoes(order, situation)
            case Halt() | Undo():
                yield self.halts, WorkDone(situation=self.lays_down)
            case _:
                yield 0.0, None


def transfer_effect(order: Order) -> str:
    """Return the effect of a TransferObject, as arranged."""
    return f"{order.inputs['Object']} isOn {order.inputs['Destination']}"


def drop_object(order: Order) -> Work:
    """A robot's work: what it carries falls on the floor."""
    yield 5.0, ServiceFailed("it slipped", f"{order.inputs['Object']} isOn Floor001")


class Client:
    """Records the answers to clients."""

    def __init__(self) -> None:
        self.received: list[Message] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        if not isinstance(event, Started | Answered) and hasattr(event, "message"):
            self.received.append(event.message)
        return []


class VirtualSystem:
    """The components of a system, each at its address. `submit` starts a task, and `view` returns its state."""

    def __init__(
        self,
        *robots: Robot,
        site: str = SITE,
        medium: Medium = promptly,
        watch: Watch = lambda address, event: None,
        settle: float = 5.0,
        planning: float = 0.0,
    ) -> None:
        self._planning = planning
        self.reports: list[str] = []
        """What the devices reported to the people who run them."""
        loaded = load_text(site, "site.yaml")
        assert loaded.map is not None
        self.world = World(medium=medium, watch=watch)
        self.repository = Repository("repository", Contents(ontology=loaded.ontology, map=loaded.map))
        self.registry = Registry("registry", loaded.ontology, "repository")
        self.client = Client()
        self.world.add("repository", self.repository)
        self.world.add("registry", self.registry, journaled=REGISTRY)
        self.world.add("client", self.client)
        for robot in robots:
            self.join(robot)
        self.problems: list[Problem] = []
        """The problems that the planner received."""
        self.add_manager("tm")
        self.world.run(settle)
        self._question_count = 0

    def join(self, robot: Robot, type: str = "PioneerP3DX", service: str | ServiceType = "TransferObject") -> None:
        capability = Capability(type=service, method="work", stoppable=True, undoable=robot.undoes is not None)
        definitions = Definitions(services=(service,) if isinstance(service, ServiceType) else ())
        self._join(
            robot,
            Profile(
                name=robot.name,
                type=type,
                capabilities=(capability,),
                definitions=definitions,
                valid_for=robot.valid_for,
                lease=3600,
            ),
        )

    def join_device(self, device: Device) -> None:
        """Let an author's device join; its coroutines may wait only with `Pause`."""
        ask = make_ask(self.repository, lambda: self.world.now)
        self.world.add(
            f"devices/{device.name}", self._new_device(device.profile()), in_virtual_time(device, ask), journaled=SERVICE_MANAGER
        )
        self.world.run(5)

    def restart(self, robot: Robot, *, snapshot: bool = False) -> None:
        """Kill and restart the robot's Service Manager, from its journal and, if requested, a snapshot."""
        address = f"devices/{robot.name}"
        if snapshot:
            self.world.snapshot(address)
        self.world.revive(address)

    def device(self, name: str) -> ServiceManager:
        manager = self.world.components[f"devices/{name}"]
        assert isinstance(manager, ServiceManager)
        return manager

    def _join(self, robot: Robot, profile: Profile) -> None:
        def carry_out(task: object) -> Work:
            if isinstance(task, Report):
                self.reports.append(task.text)
            yield from robot.carry_out(task)

        self.world.add(f"devices/{robot.name}", self._new_device(profile), carry_out, journaled=SERVICE_MANAGER)

    @staticmethod
    def _new_device(profile: Profile) -> ServiceManager:
        return ServiceManager(profile, repository="repository", registry="registry")

    def add_manager(self, address: str) -> None:
        """Let another Task Manager join."""

        def carry_out(task: object) -> Work:
            if not isinstance(task, ReadRecords):
                yield from self._plan(task)
                return
            records = (record for record in self.world.records[address] if isinstance(record, TaskRecord))
            yield 0.0, Records(records=tuple(record for record in records if task.task in (None, record.task)))

        self.world.add(address, TaskManager(address, repository="repository", registry="registry"), carry_out, journaled=SCHEMA)

    @property
    def manager(self) -> TaskManager:
        return self.manager_at("tm")

    def manager_at(self, address: str) -> TaskManager:
        manager = self.world.components[address]
        assert isinstance(manager, TaskManager)
        return manager

    def task_state(self, task: str) -> TaskState:
        """The state of a task at its Task Manager."""
        managers = (component for component in self.world.components.values() if isinstance(component, TaskManager))
        return next(manager.state.tasks[task] for manager in managers if task in manager.state.tasks)

    def restart_manager(self, *, snapshot: bool = False) -> None:
        """Kill and restart the Task Manager, from its journal and, if requested, a snapshot."""
        if snapshot:
            self.world.snapshot("tm")
        self.world.revive("tm")

    @property
    def map(self) -> Map:
        return self.repository.contents.map

    def ask(self, body: object, recipient: str = "tm") -> object:
        """Send a client's request, and return the Task Manager's answer."""
        self._question_count += 1
        id = message_id("client", self._question_count)
        header = Header(sender="client", recipient=recipient, message_id=id, reply_to="client")
        self.world.send(Message(header=header, body=body))  # type: ignore[arg-type]  # bodies, as the tests know

        def answers() -> list[Message]:
            return [message for message in self.client.received if message.header.relates_to == id]

        assert self.world.run(60, lambda: bool(answers())), f"no answer to {body}"
        return answers()[0].body

    def change(self, situation: str) -> None:
        """Somebody else makes the situation hold."""
        id = message_id("client", "change", situation, self.world.now)
        header = Header(sender="client", recipient="repository", message_id=id, reply_to="client")
        self.world.send(Message(header=header, body=UpdateMap(situation=situation)))
        self.world.run(1)

    def submit(self, effect: str, /, manager: str = "tm", **options: Any) -> str:
        answer = self.ask(Submit(effect=effect, **options), manager)
        assert isinstance(answer, Submitted), answer
        return answer.task

    def rejected(self, effect: str, **options: object) -> str:
        answer = self.ask(Submit(effect=effect, **options))  # type: ignore[arg-type]  # keyword arguments of Submit
        assert isinstance(answer, TaskRejected), answer
        return answer.problem

    def view(self, task: str) -> TaskView:
        return view(self.task_state(task))

    def finish(self, *tasks: str, seconds: float = 3600) -> list[TaskView]:
        """Let time pass until all tasks have ended."""
        ended = self.world.run(seconds, lambda: all(self.task_state(task).outcome is not None for task in tasks))
        assert ended, [self.task_state(task).events for task in tasks]
        self.world.run(2)
        return [self.view(task) for task in tasks]

    def task_record(self) -> TaskRecord:
        """Return the record of the only task, which has ended."""
        (record,) = [entry for entry in self.world.records["tm"] if isinstance(entry, TaskRecord)]
        return record

    def protocol_messages(self, task: str) -> list[tuple[str, str]]:
        """Return the messages of the protocol in a task, by type and service, without Progress."""
        return [
            (type(message.body).__name__, (message.header.participant or "").partition("#")[0].partition(".")[0])
            for message in self.world.messages
            if message.header.transaction == task and type(message.body).__name__ != "Progress"
        ]

    def _plan(self, task: object) -> Work:
        if not isinstance(task, Problem):
            raise TypeError(f"a Task Manager's only background work is planning, not {task}")
        self.problems.append(task)
        yield self._planning, plan(task)
