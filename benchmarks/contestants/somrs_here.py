"""SO-MRS with all components in one process: messages do not leave it, and every input is stored."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from contestants.somrs_parts import CARRIERS, Carrier, Lines, map_of, one_step, site_loaded
from somrs.deployment.device import device_journal
from somrs.planner.model.problem import Problem
from somrs.protocol.messages.bodies import Body
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.host import Host
from somrs.runtime.node import CarryOut, Report
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.sdk.orders import Halt, Perform, Quote, Undo
from somrs.service_manager.sdk.service_runner import carry_out
from somrs.storage.journal import Journal
from somrs.storage.repository_store import repository_journal
from somrs.task_manager.manager import SCHEMA, TaskManager


class InProcess:
    """One Host with Repository, Registry, Task Manager and ten Service Managers, whose devices share a file."""

    async def start(self, data: Path) -> None:
        self._host = host = Host()
        await host.start()
        loaded = site_loaded()
        self._map = repository_journal(data / "repository.sqlite")
        contents = Contents(ontology=loaded.ontology, map=map_of(loaded))
        repository = host.add_journaled(
            "/repository", lambda address: Repository(address, contents), self._map, carry_out=self._map.carry_out
        ).address
        registry = host.add("/registry", lambda address: Registry(address, loaded.ontology, repository)).address
        self._device_journal = device_journal(data, "all")
        for name in CARRIERS:
            device = Carrier(name)
            manager = ServiceManager(device.profile(), repository=repository, registry=registry)
            host.add_journaled(
                f"/devices/{name}", _constant_factory(manager), self._device_journal.for_component(name), carry_out=_work(device)
            )
        self._journal = Journal(data / "task-manager.sqlite", SCHEMA)
        task_manager = host.add_journaled(
            "/task-manager",
            lambda address: TaskManager(address, repository=repository, registry=registry),
            self._journal,
            carry_out=_plan,
        ).address
        self._lines = Lines(host.request, task_manager)
        await self._lines.until_offered(registry)

    async def converse(self, line: int) -> None:
        await self._lines.converse(line)

    async def stop(self) -> None:
        await self._host.stop()
        self._device_journal.close()
        self._journal.close()
        self._map.close()


async def _plan(task: object, report: Report) -> object:
    assert isinstance(task, Problem), task
    return one_step(task)


def _constant_factory(manager: ServiceManager) -> Callable[[str], ServiceManager]:
    return lambda address: manager


def _work(device: Carrier) -> CarryOut:
    async def ask(body: Body) -> Body:
        raise AssertionError("a Carrier asks the Repository nothing")

    async def work(task: object, report: Report) -> object:
        return await carry_out(device, task, ask, report) if isinstance(task, Quote | Perform | Halt | Undo) else None

    return work
