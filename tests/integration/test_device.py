"""A device's program: its journal, its class, and the whole of it on the event loop, beside a Repository and a Registry."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.client.client import Addresses
from somrs.deployment.device import DeviceJournal, DeviceRunner, load
from somrs.errors import DeviceError, UsageError
from somrs.kernel.component import Effect, Input, Rang, Received, Send
from somrs.ontology.types import AttributeType, Kind
from somrs.protocol.frp.session import CoordinatorBody, CoordinatorSession, ParticipantSession
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import State
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.runtime.host import Host
from somrs.service_manager.participant.participant import REMEMBERED
from somrs.service_manager.sdk.device import Device, Situation, Task, service
from somrs.service_manager.sdk.orders import Kept
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
    async def put_down(self, task: Task) -> Situation:
        return f"{task.inputs['Object']} isOn Floor1"


class Desk:
    """A coordinator of one participant, driven by the test."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.session = CoordinatorSession(transaction="t", participant="none", me=address, peer="")
        self.news = asyncio.Event()
        self.effects: list[Effect] = []
        self.last: Message | None = None

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Received):
            self.session.receive(event.message)
            if not isinstance(event.message.body, frp.Progress):
                self.last = event.message
            self.news.set()
        effects, self.effects = self.effects, []
        return effects

    async def until(self, state: State) -> object:
        async with asyncio.timeout(120):
            while self.session.state is not state:
                self.news.clear()
                await self.news.wait()
        assert self.last is not None
        return self.last.body


async def _scenario(data: Path) -> tuple[object, object, list[Kept]]:
    rim = Host()
    await rim.start()
    repository = rim.add("/repository", lambda address: Repository(address, contents()), keep=lambda entry: None)
    registry = rim.add("/registry", lambda address: Registry(address, repository=repository.address))
    addresses = Addresses(repository=repository.address, registry=registry.address, task_manager=f"{rim.url}/desk")
    desks: list[Desk] = []

    def desk(address: str) -> Desk:
        desks.append(Desk(address))
        return desks[0]

    node = rim.add("/desk", desk)
    runner = DeviceRunner(Carrier("Robot1"), addresses, data)
    peer = await runner.start()
    (tm,) = desks

    def tell(body: CoordinatorBody) -> None:
        tm.effects.append(Send(tm.session.accept() if isinstance(body, frp.Accept) else tm.session.send(body)))
        node.feed(Rang("say it"))

    async def execute(step: str, destination: str) -> None:
        tm.session = CoordinatorSession(transaction="t", participant=f"Robot1.TransferObject#{step}", me=node.address, peer=peer)
        inputs = {"Object": "Jar1", "Destination": destination}
        tell(frp.Arrange(service_type="TransferObject", inputs=inputs, effect=f"Jar1 isOn {destination}"))
        await tm.until(State.OFFERED)
        tell(frp.Accept(terms=""))
        tell(frp.Execute(inputs=inputs))

    await execute("s1", "Table2")
    completed = await tm.until(State.COMPLETED)
    await execute("s2", "Table1")
    await asyncio.sleep(0.2)
    tell(frp.Stop(reason="enough"))
    stopped = await tm.until(State.STOPPED)
    await runner.stop()
    await rim.stop()
    journal = DeviceJournal(data / "devices" / "Robot1.sqlite")
    kept = journal.load()
    journal.close()
    return completed, stopped, kept


def test_a_device_at_work(tmp_path: Path) -> None:
    completed, stopped, kept = asyncio.run(_scenario(tmp_path))
    assert completed == frp.Completed(situation="Jar1 isOn Table2")
    assert stopped == frp.Stopped(situation="Jar1 isOn Floor1")
    assert [(one.session.participant, one.session.state) for one in kept] == [
        ("Robot1.TransferObject#s1", State.COMPLETED),
        ("Robot1.TransferObject#s2", State.STOPPED),
    ]


def test_the_journal_gives_the_latest_of_each_participant(tmp_path: Path) -> None:
    path = tmp_path / "devices" / "Robot1.sqlite"
    journal = DeviceJournal(path)
    one, two = (ParticipantSession(transaction="t", participant=name, me="m", peer="p") for name in ("A#1", "B#1"))
    for session in (one, two, one):
        session.number += 1
        journal.keep(Kept(session=session.kept()))
    with pytest.raises(UsageError, match="another program of the same device"):
        DeviceJournal(path)
    journal.close()
    again = DeviceJournal(path)
    assert [(kept.session.participant, kept.session.number) for kept in again.load()] == [("B#1", 1), ("A#1", 2)]
    again.close()


def test_devices_that_share_a_file_get_their_own_back(tmp_path: Path) -> None:
    path = tmp_path / "devices.sqlite"
    journal = DeviceJournal(path, "Robot1")
    sessions = [ParticipantSession(transaction="t", participant=name, me="m", peer="p") for name in ("A#1", "B#1", "A#1")]
    for device, session in zip(("Robot1", "Robot1", "Robot2"), sessions, strict=True):
        session.me = device
        journal.shared_with(device).keep(Kept(session=session))
    journal.close()
    again = DeviceJournal(path, "Robot1")
    assert [(kept.session.participant, kept.session.me) for kept in again.load()] == [("A#1", "Robot1"), ("B#1", "Robot1")]
    assert [(kept.session.participant, kept.session.me) for kept in again.shared_with("Robot2").load()] == [("A#1", "Robot2")]
    again.close()


def test_of_each_device_the_latest_participants_are_remembered(tmp_path: Path) -> None:
    journal = DeviceJournal(tmp_path / "devices.sqlite", "Robot1")
    other = journal.shared_with("Robot2")
    for number in range(REMEMBERED + 2):
        kept = Kept(session=ParticipantSession(transaction="t", participant=f"A#{number}", me="m", peer="p"))
        journal.keep(kept)
        if number < 5:
            other.keep(kept)
    assert [kept.session.participant for kept in journal.load()] == [f"A#{number}" for number in range(2, REMEMBERED + 2)]
    assert len(other.load()) == 5
    journal.close()


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
    assert Odd("Odd1").profile().definitions == (AttributeType(name="Neat", kind=Kind.TRUTH),)
