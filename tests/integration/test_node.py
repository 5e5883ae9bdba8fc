"""What a node answers on the connection that a message came on: reports for a coordinator that has no address, and its own troubles."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from somrs.client.addresses import Addresses
from somrs.deployment.device import DeviceRunner
from somrs.entish.formula import Formula
from somrs.protocol.messages import frp, knowledge
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.runtime.host import Host
from somrs.runtime.wire import Wire
from somrs.service_manager.sdk.device import Device, Situation, Task, service
from somrs.storage.repository_store import repository_journal
from tests.support.effects import timeless
from tests.support.hang import HANG_TIME
from tests.support.lab import contents

INPUTS = {"Object": "Jar1", "Destination": "Table2"}
ARRANGE = frp.Arrange(service_type="TransferObject", inputs=INPUTS, effect="Jar1 isOn Table2")
EXECUTE = frp.Execute(inputs=INPUTS)

PostBody = Callable[..., Awaitable[Message | None]]


class Carrier(Device):
    """Carries things once it is let."""

    type = "PioneerP3DX"

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.release_event = asyncio.Event()

    @service("TransferObject", price="1 EUR", duration="1 s")
    async def transfer(self, task: Task) -> Situation:
        await task.progress(0.5)
        await self.release_event.wait()
        return None

    @transfer.stopping
    async def lower_object(self, task: Task) -> Situation:
        return "Jar1 isOn Floor1"

    @transfer.compensation
    async def return_object(self, task: Task, situation: Formula) -> Situation:
        return situation


def header(recipient: str, identity: str, relates_to: str | None = None) -> Header:
    return Header(
        sender=ANONYMOUS, recipient=recipient, message_id=identity, relates_to=relates_to, transaction=message_id("t"), participant="R#s1"
    )


def run_with_carrier(scenario: Callable[[Carrier, PostBody], Awaitable[None]], data: Path) -> None:
    """Run the scenario beside a device; `tell` posts without From and ReplyTo, by default under an id made of the type."""

    async def run() -> None:
        host, wire = Host(), Wire()
        await host.start()
        repository = host.add("/repository", lambda address: Repository(address, contents()))
        registry = host.add("/registry", lambda address: Registry(address, repository=repository.address))
        carrier = Carrier("Robot1")
        addresses = Addresses(repository=repository.address, registry=registry.address, task_manager=f"{host.url}/task-manager")
        runner = DeviceRunner(carrier, addresses, data)
        peer = await runner.start()

        async def post_body(body: Body, relates_to: str | None = None, number: int = 0) -> Message | None:
            return await wire.post(Message(header=header(peer, message_id(type(body).__name__, number), relates_to), body=body))

        async with asyncio.timeout(HANG_TIME):  # nothing here takes a second; it must not wait for ever
            await scenario(carrier, post_body)
        await wire.close()
        await runner.stop()
        await host.stop()

    asyncio.run(run())


async def executing(post_body: PostBody, number: int = 0) -> asyncio.Task[Message | None]:
    terms = await post_body(ARRANGE)
    assert terms is not None
    assert isinstance(terms.body, frp.Terms)
    assert await post_body(frp.Accept(terms=terms.header.message_id)) is None
    work = asyncio.ensure_future(post_body(EXECUTE, terms.header.message_id, number))
    while (status := await post_body(frp.Query())) is None or status.body != frp.Status(
        state=frp.State.EXECUTING, last_message=terms.header.message_id
    ):
        await asyncio.sleep(0.01)
    return work


def test_a_coordinator_without_an_address_gets_reports_on_its_connections(tmp_path: Path) -> None:
    async def scenario(carrier: Carrier, post_body: PostBody) -> None:
        work = await executing(post_body)
        assert not work.done(), "a sign of life is no report"
        carrier.release_event.set()
        completed = await work
        assert completed is not None
        assert timeless(completed.body) == frp.Completed(situation="Jar1 isOn Table2")
        assert completed.header.relates_to == message_id("Execute", 0)
        assert await post_body(EXECUTE) == completed, "whoever missed it asks again"
        assert await post_body(frp.Stop(reason="too late")) == completed
        compensated = await post_body(frp.Compensate(situation="Jar1 isOn Table1"))
        assert compensated is not None
        assert timeless(compensated.body) == frp.Compensated(situation="Jar1 isOn Table1")
        assert await post_body(frp.End(outcome=frp.Outcome.CANCELLED)) is None

    run_with_carrier(scenario, tmp_path)


def test_who_waits_for_the_work_hears_that_it_was_stopped(tmp_path: Path) -> None:
    async def scenario(carrier: Carrier, post_body: PostBody) -> None:
        work = await executing(post_body)
        stopped = await post_body(frp.Stop(reason="enough"))
        assert stopped is not None
        assert timeless(stopped.body) == frp.Stopped(situation="Jar1 isOn Floor1")
        assert await work == stopped

    run_with_carrier(scenario, tmp_path)


def test_what_is_wrong_is_said_at_once(tmp_path: Path) -> None:
    async def scenario(carrier: Carrier, post_body: PostBody) -> None:
        await post_body(ARRANGE)
        wrong = await post_body(frp.Accept(terms="urn:other"))
        assert wrong is not None
        assert isinstance(wrong.body, frp.Fault)
        assert wrong.body.code == "frp:NotAllowed"

    run_with_carrier(scenario, tmp_path)


def test_a_disk_that_is_full_is_not_the_senders_fault(tmp_path: Path) -> None:
    async def run() -> list[object]:
        host, wire = Host(), Wire()
        await host.start()
        journal = repository_journal(tmp_path / "repository.sqlite")
        address = host.add_journaled("/repository", lambda address: Repository(address, contents()), journal).address
        journal.disk.write_and_wait(lambda db: db.execute("PRAGMA max_page_count = 1").fetchone())
        journal.disk.write(lambda db: db.execute("INSERT INTO entries VALUES ('', -1, zeroblob(100000))"))
        update = knowledge.UpdateMap(situation="Jar1 isOn Table2")
        answers = [await wire.post(Message(header=header(address, message_id(n)), body=update)) for n in range(2)]
        await wire.close()
        await host.stop()
        journal.close()
        return [answer and answer.body for answer in answers]

    first, second = asyncio.run(run())
    assert isinstance(first, frp.Fault)
    assert isinstance(second, frp.Fault)
    assert first.code == second.code == "env:Receiver"
    assert "could not store one" in first.text
    assert "is full" in first.text
