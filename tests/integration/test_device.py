"""A device's program: its journal, its class, and the whole of it on the event loop, beside a Repository and a Registry."""

from __future__ import annotations

import asyncio
import re
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
import uvloop

from somrs.client.addresses import Addresses
from somrs.deployment.device import DeviceRunner, device_journal, listen, load, request
from somrs.errors import DeviceError, UsageError
from somrs.kernel.component import Effect, Input, Received, Send, Started, TimerFired
from somrs.kernel.durability import JournaledComponent
from somrs.ontology.types import AttributeType, Kind
from somrs.ports import Reservation
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.frp.session import CoordinatorBody
from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import Definitions, QueryMap, Rows, UpdateMap
from somrs.protocol.messages.observations import Observation
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.runtime.clock import Clock
from somrs.runtime.host import Host
from somrs.service_manager.participant.job import REMEMBERED, Job, Jobs
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.participant.state import ServiceManagerState
from somrs.service_manager.sdk.device import Device, Situation, Task, service
from somrs.storage.journal import Journal
from tests.support.effects import timeless
from tests.support.hang import HANG_TIME
from tests.support.lab import contents


class Carrier(Device):
    """Carries things, slowly."""

    type = "PioneerP3DX"

    @service("TransferObject", price="1 EUR", duration="1 s")
    async def transfer(self, task: Task) -> Situation:
        jar = await task.map.object(str(task.inputs["Object"]))
        assert jar is not None
        assert jar.type == "Jar"
        await task.progress(0.5)
        await asyncio.sleep(0.05 if task.inputs["Destination"] == "Table2" else 60)
        return None

    @transfer.stopping
    async def lower_object(self, task: Task) -> Situation:
        return f"{task.inputs['Object']} isOn Floor1"


class ManualCoordinator:
    """A coordinator of one participant, driven by the test."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.session = CoordinatorSession(transaction="t", participant="none", me=address, peer="")
        self.news = asyncio.Event()
        self.effects: list[Effect] = []
        self.last_message: Message | None = None

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Received):
            self.session.receive(event.message)
            if not isinstance(event.message.body, frp.Progress):
                self.last_message = event.message
            self.news.set()
        effects, self.effects = self.effects, []
        return effects

    async def wait_for_state(self, state: State) -> object:
        async with asyncio.timeout(HANG_TIME):
            while self.session.state is not state:
                self.news.clear()
                await self.news.wait()
        assert self.last_message is not None
        return self.last_message.body


async def _scenario(data: Path) -> tuple[object, object, ServiceManagerState]:
    host = Host()
    await host.start()
    repository = host.add("/repository", lambda address: Repository(address, contents()))
    registry = host.add("/registry", lambda address: Registry(address, repository=repository.address))
    addresses = Addresses(repository=repository.address, registry=registry.address, task_manager=f"{host.url}/desk")
    coordinators: list[ManualCoordinator] = []

    def add_coordinator(address: str) -> ManualCoordinator:
        coordinators.append(ManualCoordinator(address))
        return coordinators[0]

    node = host.add("/desk", add_coordinator)
    runner = DeviceRunner(Carrier("Robot1"), addresses, data)
    peer = await runner.start()
    (coordinator,) = coordinators

    def send_body(body: CoordinatorBody) -> None:
        coordinator.effects.append(Send(coordinator.session.accept() if isinstance(body, frp.Accept) else coordinator.session.send(body)))
        node.feed(TimerFired("say it"))

    async def execute(step: str, destination: str) -> None:
        coordinator.session = CoordinatorSession(transaction="t", participant=f"Robot1.TransferObject#{step}", me=node.address, peer=peer)
        inputs = {"Object": "Jar1", "Destination": destination}
        send_body(frp.Arrange(service_type="TransferObject", inputs=inputs, effect=f"Jar1 isOn {destination}"))
        await coordinator.wait_for_state(State.OFFERED)
        send_body(frp.Accept(terms=""))
        send_body(frp.Execute(inputs=inputs))

    await execute("s1", "Table2")
    completed = await coordinator.wait_for_state(State.COMPLETED)
    await execute("s2", "Table1")
    await asyncio.sleep(0.2)
    send_body(frp.Stop(reason="enough"))
    stopped = await coordinator.wait_for_state(State.STOPPED)
    await runner.stop()
    await host.stop()
    return completed, stopped, state_of(data, peer)


def state_of(data: Path, address: str) -> ServiceManagerState:
    """What is in the journal of Robot1, at this address."""
    journal = device_journal(data, "Robot1")
    journaled, is_resumed = journal.begin(address, lambda address: pytest.fail("there is a journal"))
    assert is_resumed
    journal.close()
    assert isinstance(journaled.component, ServiceManager)
    return journaled.component.state


def test_a_device_at_work(tmp_path: Path) -> None:
    completed, stopped, state = asyncio.run(_scenario(tmp_path))
    assert timeless(completed) == frp.Completed(situation="Jar1 isOn Table2")
    assert timeless(stopped) == frp.Stopped(situation="Jar1 isOn Floor1")
    assert [(job.session.participant, job.session.state) for job in state.jobs] == [
        ("Robot1.TransferObject#s1", State.COMPLETED),
        ("Robot1.TransferObject#s2", State.STOPPED),
    ]


class ManualClock(Clock):
    """A clock that the test advances."""

    def __init__(self) -> None:
        self.time = 1_000.0

    def now(self) -> float:
        return self.time

    def advance_to(self, timestamp: float) -> None:
        self.time = max(self.time, timestamp)


async def _reported(data: Path) -> tuple[list[UpdateMap], list[UpdateMap]]:
    """What arrives of a device that sees a jar before it joins and another time later, and what it should be. Each answer takes 50 s."""
    host = Host(clock=ManualClock())
    received: list[UpdateMap] = []
    expected: list[UpdateMap] = []

    def expect(situation: str) -> str:
        expected.append(UpdateMap(situation=situation, author="Robot1", observation=Observation(as_of=host.clock.now())))
        return situation

    class SlowRepository(Repository):
        def handle(self, event: Input, now: float) -> list[Effect]:
            if isinstance(event, Received) and isinstance(event.message.body, UpdateMap) and event.message.body.situation is not None:
                received.append(event.message.body)
            host.clock.advance_to(now + 50.0)
            return super().handle(event, now)

    class Seer(Carrier):
        async def open(self) -> None:
            self.observed(expect("Jar1 isOn Table2"))

    await host.start()
    repository = host.add("/repository", lambda address: SlowRepository(address, contents()))
    registry = host.add("/registry", lambda address: Registry(address, repository=repository.address))
    addresses = Addresses(repository=repository.address, registry=registry.address, task_manager=f"{host.url}/desk")
    runner = DeviceRunner(Seer("Robot1"), addresses, data, host)
    await runner.start()
    await runner.device.report(expect("Jar1 isOn Table1"))
    await runner.stop()
    await host.stop()
    return received, expected


def test_what_a_device_reports_was_so_when_it_reported_it(tmp_path: Path) -> None:
    received, expected = asyncio.run(_reported(tmp_path))
    assert received == expected


async def _asked_for_hours(caplog: pytest.LogCaptureFixture) -> tuple[Body, list[str]]:
    """What a device is answered that asks a Repository which starts an hour later, and the log of the wait."""
    loop = asyncio.get_running_loop()
    time_of_loop, hours = loop.time, 0
    loop.time = lambda: time_of_loop() + 3600 * hours  # type: ignore[method-assign]
    host, core = Host("127.0.0.1"), Host("127.0.0.1")
    await host.start()
    await core.start()
    address = f"{core.url}/repository"
    await core.stop()
    try:
        async with asyncio.timeout(HANG_TIME + 5 * 3600):
            answer = asyncio.create_task(request(host, QueryMap(formula="Jar1 isOn ?Where"), address))
            while not caplog.messages and not answer.done():
                await asyncio.sleep(0.1)
                hours = min(hours + 1, 5)
            core = Host("127.0.0.1", core.port)
            await core.start()
            core.add("/repository", lambda at: Repository(at, contents()))
            return await answer, caplog.messages
    finally:
        await core.stop()
        await host.stop()


def test_a_device_asks_until_the_repository_is_there(caplog: pytest.LogCaptureFixture) -> None:
    answer, messages = asyncio.run(_asked_for_hours(caplog))
    assert isinstance(answer, Rows), answer
    assert re.search(r"/repository cannot be reached: .*; it is asked again until it answers$", messages[0])


async def _ports_of_devices(last_port: int) -> list[int]:
    """The ports of two devices that start at the same time."""
    hosts = await asyncio.gather(*(listen("127.0.0.1", last_port, name) for name in ("Robot1", "Robot2")))
    for host in hosts:
        await host.stop()
    return [host.port for host in hosts]


@pytest.mark.parametrize("loop", [asyncio.run, uvloop.run])
def test_a_device_does_not_take_the_port_of_another_program(loop: Callable[..., list[int]]) -> None:
    """Devices that were on a bus know the port of its gateway as theirs: it may be reserved for a component of the system now, or free."""
    with Reservation("127.0.0.1", 1) as reservation:
        (port,) = reservation.ports
        assert len({port, *loop(_ports_of_devices(port))}) == 3
    assert len({*loop(_ports_of_devices(port))}) == 2


class FaultyHardware(Carrier):
    released = 0
    """How often it was closed."""

    async def open(self) -> None:
        raise DeviceError("nothing answers at its port")

    async def close(self) -> None:
        self.released += 1


class Misdescribed(FaultyHardware):
    type = 7  # type: ignore[assignment]  # what no author's checker would accept


@pytest.mark.parametrize(
    ("kind", "error", "released"), [(FaultyHardware, "nothing answers at its port", 1), (Misdescribed, "has no object type", 0)]
)
def test_a_device_is_closed_if_opening_it_failed_and_not_if_it_was_never_opened(
    tmp_path: Path, kind: type[FaultyHardware], error: str, released: int
) -> None:
    device = kind("Robot1")

    async def scenario() -> None:
        nowhere = "http://127.0.0.1:9"
        runner = DeviceRunner(device, Addresses(repository=nowhere, registry=nowhere, task_manager=nowhere), tmp_path)
        with pytest.raises(DeviceError, match=error):
            await runner.start()
        await runner.stop()

    asyncio.run(scenario())
    assert device.released == released


def arrange_message(device: str, step: str) -> Received:
    header = Header(
        sender="desk",
        recipient=device,
        message_id=f"{device} {step}",
        reply_to="desk",
        transaction="t",
        participant=f"{device}.TransferObject#{step}",
    )
    order = frp.Arrange(service_type="TransferObject", inputs={"Object": "Jar1", "Destination": "Table2"}, effect="Jar1 isOn Table2")
    return Received(Message(header=header, body=order))


def participants(journaled: JournaledComponent) -> list[str]:
    assert isinstance(journaled.component, ServiceManager)
    return [job.session.participant for job in journaled.component.state.jobs]


def manager_factory(name: str) -> Callable[[str], ServiceManager]:
    return lambda address: ServiceManager(Carrier(name).profile(), repository="repository", registry="registry")


def journal_and_handle(journal: Journal, journaled: JournaledComponent, event: Input) -> None:
    entry = journaled.make_entry(event, 1.0)
    journal.append(entry)
    journaled.handle(entry)


def test_a_device_has_its_file_for_itself(tmp_path: Path) -> None:
    journal = device_journal(tmp_path, "Robot1")
    with pytest.raises(UsageError, match="in use by another process"):
        device_journal(tmp_path, "Robot1")
    journal.close()


def test_devices_that_share_a_file_get_their_own_back(tmp_path: Path) -> None:
    shared = device_journal(tmp_path, "all")
    for device, steps in (("Robot1", ("s1", "s2")), ("Robot2", ("s1",))):
        journal = shared.for_component(device)
        journaled, is_resumed = journal.begin(device, manager_factory(device))
        assert not is_resumed
        journal_and_handle(journal, journaled, Started(device))
        for step in steps:
            journal_and_handle(journal, journaled, arrange_message(device, step))
        if device == "Robot1":
            journal.snapshot(journaled)
    shared.close()
    shared = device_journal(tmp_path, "all")
    first, is_resumed = shared.for_component("Robot1").begin("Robot1", manager_factory("Robot1"))
    assert is_resumed
    assert participants(first) == ["Robot1.TransferObject#s1", "Robot1.TransferObject#s2"]
    second, is_resumed = shared.for_component("Robot2").begin("elsewhere", manager_factory("Robot2"))
    assert is_resumed, "a device goes on at another address"
    assert participants(second) == ["Robot2.TransferObject#s1"]
    shared.close()


def test_of_those_that_are_over_the_latest_are_remembered() -> None:
    jobs = Jobs()
    for number in range(REMEMBERED + 2):
        session = ParticipantSession(transaction="t", participant=f"A#{number}", me="m", peer="p", state=State.ENDED)
        jobs.store_job(Job(session=session))
    assert [job.session.participant for job in jobs.all_jobs()] == [f"A#{number}" for number in range(2, REMEMBERED + 2)]


def test_a_file_of_records_becomes_a_journal(tmp_path: Path) -> None:
    (tmp_path / "devices").mkdir()
    with sqlite3.connect(tmp_path / "devices" / "Robot1.sqlite") as db:
        db.executescript("CREATE TABLE kept (number INTEGER); PRAGMA application_id=0x534F4D44; PRAGMA user_version=2;")
    db.close()
    journal = device_journal(tmp_path, "Robot1")
    assert journal.begin("Robot1", manager_factory("Robot1"))[1] is False
    journal.close()
    device_journal(tmp_path, "Robot1").close()


def test_a_driver_is_found_in_a_module_or_a_file(tmp_path: Path) -> None:
    file = tmp_path / "lifter.py"
    file.write_text("from somrs.service_manager.sdk.device import Device\nclass Lifter(Device):\n    type = 'Device'\n")
    assert load(f"{file}:Lifter").__name__ == "Lifter"
    with pytest.raises(DeviceError, match="has no class Lift that is a Device; it has Lifter"):
        load(f"{file}:Lift")
    with pytest.raises(DeviceError, match="write module:Class"):
        load("lifter")
    with pytest.raises(DeviceError, match="cannot be imported"):
        load("no.such.module:Lifter")


def test_what_a_device_brings_has_to_be_well_made() -> None:
    class Odd(Device):
        type = "StationaryDevice"
        types = (AttributeType(name="Neat", kind="thruth"),)  # type: ignore[arg-type]  # what an author may well write

        @service("TransferObject", duration="1 s")
        async def work(self, task: Task) -> Situation:
            return None

    with pytest.raises(DeviceError, match="AttributeType Neat"):
        Odd("Odd1").profile()
    Odd.types = (AttributeType(name="Neat", kind="truth"),)  # type: ignore[arg-type]  # the text of a kind is as good as the kind
    assert Odd("Odd1").profile().definitions == Definitions(attributes=(AttributeType(name="Neat", kind=Kind.TRUTH),))
