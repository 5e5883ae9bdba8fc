"""The components of a site on two hosts: one host is killed for good while a task is under way, and the other one continues it."""

from __future__ import annotations

import asyncio
import contextlib
import re
import signal
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.deployment.bus import find_site
from somrs.deployment.device import DeviceRunner
from somrs.ports import listen_at
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from somrs.runtime.wire import retry_unanswered
from somrs.service_manager.sdk.device import Situation, Task, service
from tests.support.command import program
from tests.support.hang import HANG_TIME
from tests.support.nats_server import NatsServer
from tests.support.small_system import Porter
from tests.support.virtual_system import SITE
from tests.support.warm import Program

pytestmark = pytest.mark.long

COMPONENTS = ("repository", "registry", "task-manager", "scheduler")


class HostOfPrograms:
    """The programs of the components that share a data folder, as on a host."""

    def __init__(self, data: Path, servers: str, site: Path) -> None:
        self.data, self._servers, self._site = data, servers, site
        data.mkdir()
        self.programs: dict[str, Program] = {}

    async def start(self, component: str) -> None:
        """Start a component, and wait until it says that it is ready, as the leader or as a standby."""
        arguments = ["run", component, "--bus", self._servers, "--data", str(self.data)]
        log = self.data / f"{component}.log"
        self.programs[component] = Program([*arguments, *(("--site", str(self._site)) if component == "repository" else ())], log)
        while '"ready"' not in log.read_text():
            assert not self.programs[component].ended, log.read_text()
            await asyncio.sleep(0.02)

    def is_standby(self, component: str) -> bool:
        return "standby" in (self.data / f"{component}.log").read_text().splitlines()[-1]

    def kill(self, components: Sequence[str] = COMPONENTS, number: int = signal.SIGKILL) -> None:
        for component in components:
            if (program := self.programs.pop(component, None)) is not None:
                with contextlib.suppress(ProcessLookupError):  # it has ended by itself
                    program.send_signal(number)
                program.wait()


class TwoHosts:
    """Two hosts and a gateway, with a NATS server that none of them has."""

    def __init__(self, folder: Path, server: NatsServer) -> None:
        site = folder / "site.yaml"
        site.write_text(SITE)
        self.server, self.servers = server, server.address.servers
        self.hosts = [HostOfPrograms(folder / name, self.servers, site) for name in ("first", "second")]
        self.addresses = Addresses(repository="", registry="", task_manager="")

    @property
    def first(self) -> HostOfPrograms:
        return self.hosts[0]

    @property
    def second(self) -> HostOfPrograms:
        return self.hosts[1]


@asynccontextmanager
async def two_hosts(folder: Path) -> AsyncIterator[TwoHosts]:
    with listen_at("127.0.0.1", 0) as free:
        port = free.getsockname()[1]
    with NatsServer(folder, f"http://127.0.0.1:{port}") as server:
        log = folder / "gateway.log"
        gateway = Program(["run", "gateway", "--bus", server.address.servers, "--name", "yard", "--port", str(port)], log)
        system = TwoHosts(folder, server)
        try:
            while '"ready"' not in log.read_text():
                await asyncio.sleep(0.02)
            system.addresses = await find_site(system.servers)
            for host in system.hosts:
                for component in COMPONENTS:
                    await host.start(component)
            yield system
        finally:
            for host in system.hosts:
                host.kill()
            gateway.send_signal(signal.SIGKILL)
            gateway.wait()


def status(system: TwoHosts) -> str:
    """What a user sees of the site's processes."""
    result = program("status", "--bus", system.servers)
    assert result.returncode == 0, result.stderr
    return result.stdout


def elsewhere(system: TwoHosts, *arguments: str) -> str:
    """What a user sees of a command at some computer which has no part of the site."""
    (folder := system.first.data.parent / "elsewhere").mkdir(exist_ok=True)
    result = program(*arguments, cwd=folder, SOMRS_BUS=system.servers)
    assert result.returncode == 0, result.stderr
    return result.stdout


async def ended(client: Client, task: str) -> TaskView:
    return [news.view async for news in client.news(task)][-1]


class WatchedPorter(Porter):
    """A porter whose moments a test can wait for: it `is_asked` for terms, and it `works`."""

    def __init__(self, name: str) -> None:
        super().__init__(name, seconds=1.0)
        self.is_asked, self.works = asyncio.Event(), asyncio.Event()
        self.thinks = 0.3

    async def _able(self, task: Task) -> None:
        self.is_asked.set()
        await super()._able(task)

    @service("TransferObject", price=10.0, duration=1.0, able=lambda self, task: self._able(task))
    async def transfer(self, task: Task) -> Situation:
        self.works.set()
        return await self.carry(task)

    @transfer.compensation
    async def compensate_transfer(self, task: Task, situation: object) -> Situation:
        return str(situation)


def run(folder: Path, moment: Callable[[WatchedPorter], asyncio.Event], lost: Sequence[str]) -> None:
    """A task is accomplished although `lost` components of the first host are killed for good at the moment."""

    async def play() -> None:
        async with two_hosts(folder) as system, Client(system.addresses) as client:
            assert not any(map(system.first.is_standby, COMPONENTS))
            assert all(map(system.second.is_standby, COMPONENTS))
            porter = WatchedPorter("Robot1")
            runner = DeviceRunner(porter, system.addresses, folder)
            await runner.start()
            task = await client.submit(Submit(effect="Jar002 isOn Platform001"))
            await moment(porter).wait()
            system.first.kill(lost)
            view = await ended(client, task)
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert porter.delivered == ["Jar002"], "it was done once"
            assert (await client.query("Jar002 isOn Platform001")).rows
            for component in lost:
                while system.second.is_standby(component):  # the task may have needed nothing of it since
                    await asyncio.sleep(0.02)
            done = await asyncio.to_thread(elsewhere, system, "do", "Jar002 isOn Cupboard002")
            assert "accomplished" in done
            next_task, first_task = [view.task for view in await client.tasks()]
            assert first_task == task
            shown = await asyncio.to_thread(elsewhere, system, "tasks", "--history")
            assert shown.count("accomplished") == 2, shown
            assert "TransferObject" in await asyncio.to_thread(elsewhere, system, "task", task)
            assert len((await asyncio.to_thread(elsewhere, system, "export")).splitlines()) == 2
            # The host comes back, as a standby that has missed something.
            for component in lost:
                await system.first.start(component)
                assert system.first.is_standby(component)
            shown = await asyncio.to_thread(status, system)
            for component in COMPONENTS:
                assert re.search(rf"^│ {component} .* leads ", shown, re.MULTILINE), shown
                assert re.search(rf"^│ {component} .* standby .* 0 +│$", shown, re.MULTILINE), shown
            system.second.kill(lost, signal.SIGTERM)  # a planned end: the other one takes over at once
            assert [view.task for view in await retry_unanswered(client.tasks, HANG_TIME)] == [next_task, task]
            assert (await retry_unanswered(lambda: client.query("Jar002 isOn Cupboard002"), HANG_TIME)).rows
            await runner.stop()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_a_whole_host_is_lost_while_a_robot_works(tmp_path: Path) -> None:
    run(tmp_path, lambda porter: porter.works, COMPONENTS)


@pytest.mark.parametrize(
    "component", ["task-manager", pytest.param("repository", marks=pytest.mark.slow), pytest.param("registry", marks=pytest.mark.slow)]
)
def test_a_component_is_lost_while_services_are_arranged(tmp_path: Path, component: str) -> None:
    run(tmp_path, lambda porter: porter.is_asked, [component])


def test_a_leader_that_stood_still_for_too_long_ends_and_changes_nothing(tmp_path: Path) -> None:
    """It has missed that another one leads; a task that it gets first is the other one's."""

    async def play() -> None:
        async with two_hosts(tmp_path) as system, Client(system.addresses) as client:
            stopped = system.first.programs["task-manager"]
            stopped.send_signal(signal.SIGSTOP)
            while system.second.is_standby("task-manager"):
                await asyncio.sleep(0.02)
            stopped.send_signal(signal.SIGCONT)
            task = await client.submit(Submit(effect="Jar002 isOn Platform001"), patience=HANG_TIME)
            while not stopped.ended:
                await asyncio.sleep(0.02)
            assert "another process continues" in (tmp_path / "first" / "task-manager.log").read_text()
            assert [view.task for view in await client.tasks()] == [task]

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_components_end_in_order_when_the_bus_is_away(tmp_path: Path) -> None:
    async def play() -> None:
        async with two_hosts(tmp_path) as system:
            runner = DeviceRunner(porter := WatchedPorter("Robot1"), system.addresses, tmp_path)
            await runner.start()
            async with Client(system.addresses) as client:
                await client.submit(Submit(effect="Jar002 isOn Platform001"))
            await porter.works.wait()
            system.server.kill()
            system.first.kill(COMPONENTS, signal.SIGTERM)
            for component in COMPONENTS:
                text = (tmp_path / "first" / f"{component}.log").read_text()
                assert "Traceback" not in text, text
            system.server.start()
            await runner.stop()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))
