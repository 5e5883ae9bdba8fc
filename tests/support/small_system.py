"""A whole system in one process with real sockets and files: Repository, Registry, Task Manager, devices and the API service.

It starts quickly, for tests of pages and programs that use the API; the devices' work takes the time that they declare.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from msgspec.structs import replace

from somrs.access.store import AccessStore
from somrs.api.program import served
from somrs.api.remote import LiveApi, live_api
from somrs.api.service import open_api_service
from somrs.client.addresses import Addresses, task_manager_name
from somrs.client.api_client import local_token_reader
from somrs.deployment.device import DeviceRunner
from somrs.kernel.component import TimerFired
from somrs.ontology.files.loading import load_text
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan
from somrs.ports import Reservation, listen_at
from somrs.protocol.messages.orders import RunState
from somrs.protocol.messages.records import ReadRecords
from somrs.registry.component import Registry
from somrs.registry.neighbours import Neighbour
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.clock import Clock, TimeOfDay
from somrs.runtime.host import Host
from somrs.runtime.node import Node, Report
from somrs.scheduling.component import Scheduler
from somrs.scheduling.program import add_scheduler
from somrs.scheduling.state import OrdersDue
from somrs.scheduling.store import FILE as ORDERS
from somrs.scheduling.store import orders_journal
from somrs.service_manager.sdk.device import Device, Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from somrs.storage.archive import archive_file
from somrs.storage.journal import Journal
from somrs.storage.repository_store import repository_journal
from somrs.task_manager.manager import SCHEMA, TaskManager
from tests.support.virtual_system import SITE

LOOPBACK = "127.0.0.1"


class Porter(Device):
    """Carries things in `seconds`, except those that it `drops`. `steps`: the number of its progress reports."""

    type = "PioneerP3DX"

    def __init__(self, name: str, price: float = 10.0, seconds: float = 0.2, *, drops: bool = False, steps: int = 2) -> None:
        super().__init__(name)
        self.price, self.seconds, self.drops, self.steps = price, seconds, drops, steps
        self.refuses = ""
        """The reason with which it refuses terms; empty if it gives terms."""
        self.thinks = 0.0
        """Seconds that it takes to give terms."""
        self.delivered: list[str] = []

    async def _able(self, task: Task) -> None:
        await asyncio.sleep(self.thinks)
        if self.refuses:
            raise Refusal(self.refuses)

    @service(
        "TransferObject",
        price=lambda self, task: self.price,
        duration=lambda self, task: self.seconds,
        able=lambda self, task: self._able(task),
    )
    async def transfer(self, task: Task) -> Situation:
        return await self.carry(task)

    @transfer.compensation
    async def compensate_transfer(self, task: Task, situation: object) -> Situation:
        return str(situation)

    async def carry(self, task: Task) -> Situation:
        thing, place = str(task.inputs["Object"]), str(task.inputs["Destination"])
        for number in range(self.steps):
            await asyncio.sleep(self.seconds / self.steps)
            await task.progress((number + 1) / self.steps)
        if self.drops:
            raise ServiceFailed("it slipped out of the hand", f"{thing} isOn Floor001")
        self.delivered.append(thing)
        return f"{thing} isOn {place}"


class SmallSystem:
    """The components of a running system. A Task Manager can be stopped and started again from its journal, and the Registry without one.

    `neighbours`: those of the Registry at its start; `site`: the first map.
    """

    def __init__(self, data: Path, porters: Sequence[Porter], managers: int = 1) -> None:
        self.data, self.porters = data, porters
        self._reservation = Reservation(LOOPBACK, 2 + managers)
        ports = self._reservation.ports
        url, self.scheduler_port, self._ports = f"http://{LOOPBACK}:{ports[0]}", ports[1], ports[2:]
        task_manager, *further = (f"http://{LOOPBACK}:{port}/task-manager" for port in self._ports)
        self.addresses = Addresses(
            repository=f"{url}/repository", registry=f"{url}/registry", task_manager=task_manager, further_task_managers=tuple(further)
        )
        self._host = Host(LOOPBACK, ports[0])
        self._devices: list[DeviceRunner] = []
        self._managers: dict[int, tuple[Host, Journal]] = {}
        self._repository_journal: Journal | None = None
        self._registry: Node | None = None
        self.neighbours: Sequence[Neighbour] = ()
        self.site = SITE

    @property
    def manager(self) -> TaskManager:
        return self.manager_at(1)

    def manager_at(self, number: int) -> TaskManager:
        address = self.addresses.task_managers[task_manager_name(number)]
        component = self._managers[number][0]._nodes[address].component
        assert isinstance(component, TaskManager)
        return component

    async def start(self) -> None:
        self.data.mkdir(exist_ok=True)
        loaded = load_text(self.site, "site.yaml")
        assert loaded.map is not None
        contents = Contents(ontology=loaded.ontology, map=loaded.map)
        self._repository_journal = journal = repository_journal(self.data / "repository.sqlite")
        await self._host.start()
        self._host.add_journaled("/repository", lambda address: Repository(address, contents), journal, carry_out=journal.carry_out)
        self.start_registry()
        for number in range(1, len(self._ports) + 1):
            await self.start_manager(number)
        for porter in self.porters:
            runner = DeviceRunner(porter, self.addresses, self.data)
            await runner.start()
            self._devices.append(runner)

    def start_registry(self) -> None:
        def make_registry(address: str) -> Registry:
            return Registry(address, repository=self.addresses.repository, neighbours=self.neighbours)

        self._registry = self._host.add("/registry", make_registry)

    async def stop_registry(self) -> None:
        assert self._registry is not None, "it was started"
        await self._host.remove(self._registry)

    async def start_manager(self, number: int = 1) -> None:
        journal, host = Journal(archive_file(self.data, number), SCHEMA, "here"), Host(LOOPBACK, self._ports[number - 1])
        await host.start()

        async def carry_out(task: object, report: Report) -> object:
            if isinstance(task, ReadRecords):
                return await journal.carry_out(task, report)
            assert isinstance(task, Problem), "a Task Manager's only other background work is planning"
            return await asyncio.to_thread(plan, task)

        def make_manager(address: str) -> TaskManager:
            return TaskManager(address, repository=self.addresses.repository, registry=self.addresses.registry)

        host.add_journaled("/task-manager", make_manager, journal, carry_out=carry_out)
        self._managers[number] = host, journal

    async def stop_manager(self, number: int = 1) -> None:
        host, journal = self._managers.pop(number)
        await host.stop()
        journal.close()

    async def stop(self) -> None:
        for runner in self._devices:
            await runner.stop()
        for number in [*self._managers]:
            await self.stop_manager(number)
        await self._host.stop()
        if self._repository_journal is not None:
            self._repository_journal.close()
        self._reservation.close()


@asynccontextmanager
async def running(
    data: Path, *porters: Porter, clock: Clock | None = None, managers: int = 1, access: AccessStore | None = None
) -> AsyncIterator[tuple[SmallSystem, LiveApi]]:
    """Run the system with the API service. `clock` is the Scheduler's clock, `managers` the number of Task Managers, `access` who has
    access to the API; None: anybody."""
    system = SmallSystem(data, porters, managers)
    async with AsyncExitStack() as stack:
        stack.push_async_callback(system.stop)
        await system.start()
        yield system, await stack.enter_async_context(live_api_at(system, clock, access))


@asynccontextmanager
async def live_api_at(system: SmallSystem, clock: Clock | None = None, access: AccessStore | None = None) -> AsyncIterator[LiveApi]:
    """Serve the API at a port, and connect to it as clients do."""
    if access is not None:
        access.renew_local_token()
    async with api_at(system, clock, access) as url, live_api(url, local_token_reader(system.data)) as api:
        yield api


@asynccontextmanager
async def api_at(system: SmallSystem, clock: Clock | None = None, access: AccessStore | None = None) -> AsyncIterator[str]:
    """Serve the API, with a Scheduler on this clock, and yield its address. `access`: who has access; None: anybody."""
    async with (
        scheduler_at(system, clock),
        open_api_service(system.addresses, system.data) as api_service,
        served(api_service, listen_at(LOOPBACK, 0), access=access) as url,
    ):
        yield url


@asynccontextmanager
async def scheduler_at(system: SmallSystem, clock: Clock | None = None) -> AsyncIterator[Node]:
    journal = orders_journal(system.data / ORDERS)
    host = Host(LOOPBACK, system.scheduler_port, clock=clock or TimeOfDay())
    try:
        await host.start()
        node = add_scheduler(host, journal, system.addresses)
        if isinstance(clock, Time):
            clock.drive(node)
        system.addresses = replace(system.addresses, scheduler=node.address)
        while isinstance(node.component, Scheduler) and not node.component.replica.ready:
            await asyncio.sleep(0.01)
        yield node
    finally:
        await host.stop()
        journal.close()


class Time(Clock):
    """A clock that tests advance. It wakes the Scheduler that uses it when something is due."""

    def __init__(self, start_time: float) -> None:
        super().__init__()
        self._now = start_time
        self._node: Node | None = None

    def drive(self, node: Node) -> None:
        self._node = node

    def now(self) -> float:
        return self._now

    async def pass_by(self, seconds: float) -> None:
        end_time = self._now + seconds
        assert self._node is not None
        assert isinstance(self._node.component, Scheduler)
        while (due := self._node.component.next_due) is not None and due <= end_time:
            self._now = max(self._now, due)
            self._node.feed(TimerFired(OrdersDue()))
            await self._wait_answered(self._node.component)
        self._now = end_time

    async def _wait_answered(self, scheduler: Scheduler) -> None:
        """Wait until the Task Manager has answered, if it is up: the delay of a message must not become hours."""
        deadline = asyncio.get_running_loop().time() + 5.0
        while asyncio.get_running_loop().time() < deadline:
            await asyncio.sleep(0.01)
            if not any(run.state is RunState.SUBMITTING for runs in scheduler.book.runs.values() for run in runs):
                return

    def add(self, seconds: float) -> None:
        """Advance the clock while no Scheduler uses it."""
        self._now += seconds

    async def jump(self, seconds: float) -> None:
        """Advance the clock at once, as after a suspend of the machine."""
        self._now += seconds
        assert self._node is not None
        self._node.feed(TimerFired(OrdersDue()))
        await asyncio.sleep(0)
