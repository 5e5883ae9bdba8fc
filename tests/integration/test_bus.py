"""Components on a bus, with a real NATS server: among each other, and with SOAP participants through the gateway."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs
from nats import errors
from nats.aio.msg import Msg

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.deployment import bus as bus_module
from somrs.deployment.bus import addresses_on, discard_site, find_site, list_number, list_site, run_gateway
from somrs.deployment.device import DeviceRunner
from somrs.errors import DeviceError, InputError, RemoteError, UsageError
from somrs.kernel.component import DeliveryFailed, Effect, Input, Notified, Received, Send
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan
from somrs.ports import Reservation
from somrs.protocol.messages import frp, knowledge
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id, reply
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.runtime.bus import Bus
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.bus_gateway import BusParts
from somrs.runtime.host import Host
from somrs.runtime.http import Server
from somrs.runtime.node import Report
from somrs.runtime.wire import Unanswered, Wire
from somrs.storage.running_component import status_subject
from somrs.storage.stored_copy import CopyInfo
from somrs.storage.stream_log import StreamLog
from somrs.task_manager.manager import TaskManager
from tests.support.hang import HANG_TIME
from tests.support.lab import contents
from tests.support.nats_server import NatsServer
from tests.support.small_system import Porter

ROWS = knowledge.Rows(rows=(), version=7)


class Answerer:
    """Answers questions about the map, and keeps the texts of what it is told."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.reasons: list[str] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case Received(Message(body=knowledge.QueryMap()) as message):
                return [Send(reply(message, ROWS, self.address))]
            case Received(Message(body=knowledge.ReadOntology())):
                raise InputError("there is no such page")
            case Received(Message(body=frp.Stop(reason=reason))):
                self.reasons.append(reason)
        return []


class Teller:
    """Tells the recipient what it is notified of. `failures`: what it could not tell."""

    def __init__(self, address: str, recipient: str) -> None:
        self.address, self.recipient = address, recipient
        self.failures: list[Message] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case Notified(str() as reason):
                header = header_to(self.recipient, reason, self.address)
                return [Send(Message(header=header, body=frp.Stop(reason=reason)), now + HANG_TIME)]
            case DeliveryFailed(message=message):
                self.failures.append(message)
        return []


def header_to(recipient: str, identity: str, sender: str = "http://127.0.0.1:1/somebody") -> Header:
    return Header(sender=sender, recipient=recipient, message_id=message_id(identity), transaction="t1", participant="R#s1")


def question(recipient: str, body: Body | None = None) -> Message:
    return Message(header=header_to(recipient, "question"), body=body if body is not None else knowledge.QueryMap(formula="?X: Jar"))


def on_bus(folder: Path, scenario: Callable[[NatsServer], Coroutine[Any, Any, None]], gateway: str = "http://127.0.0.1:1") -> None:
    async def run() -> None:
        async with asyncio.timeout(HANG_TIME):
            await scenario(server)

    with NatsServer(folder, gateway) as server:
        asyncio.run(run())


def test_a_component_answers_on_the_bus_and_its_refusals_arrive(tmp_path: Path) -> None:
    async def scenario(server: NatsServer) -> None:
        recipient, asker = Host(bus=server.address), Host(bus=server.address)
        await recipient.start()
        await asker.start()
        address = recipient.add("/repository", Answerer).address
        assert address == f"{server.address.gateway}/repository"
        await recipient.listening()
        assert (await asker.request(question(address))).body == ROWS
        refusal = (await asker.request(question(address, knowledge.ReadOntology()))).body
        assert refusal == frp.Fault(code="env:Sender", text="there is no such page")
        with pytest.raises(Unanswered, match=r"nobody on the bus listens to somrs\.yard\.registry"):
            await asker.request(question(f"{server.address.gateway}/registry"))
        await recipient.stop()
        with pytest.raises(Unanswered, match="nobody on the bus listens"):
            await asker.request(question(address))
        await asker.stop()

    on_bus(tmp_path, scenario)


def test_messages_arrive_in_order_although_the_server_of_the_bus_is_killed(tmp_path: Path) -> None:
    texts = [f"message {number}" for number in range(300)]

    async def scenario(server: NatsServer) -> None:
        recipient, sender = Host(bus=server.address), Host(bus=server.address)
        await recipient.start()
        await sender.start()
        answerer, tellers = Answerer(""), list[Teller]()
        address = recipient.add("/answerer", lambda address: answerer).address
        tellers.append(teller := Teller("", address))
        node = sender.add("/teller", lambda address: teller)
        await recipient.listening()
        for number, text in enumerate(texts):
            if number == 100:
                server.kill()
            if number == 200:
                await asyncio.to_thread(server.start)
            node.feed(Notified(text))
            await asyncio.sleep(0)
        while len({*answerer.reasons}) < len(texts):
            await asyncio.sleep(0.01)
        assert list(dict.fromkeys(answerer.reasons)) == texts
        assert not teller.failures
        await sender.stop()
        await recipient.stop()

    on_bus(tmp_path, scenario)


class Silent:
    """Takes questions, and never answers them. `asked`: set with the first."""

    def __init__(self, address: str) -> None:
        self.asked = asyncio.Event()

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Received):
            self.asked.set()
        return []


def test_a_device_that_another_program_on_the_bus_serves_is_not_served_twice(tmp_path: Path) -> None:
    """Seen with a simulated robot that an adapter on another host served, too: both did each order."""

    async def scenario(server: NatsServer) -> None:
        opened = []

        class Watched(Porter):
            async def open(self) -> None:
                opened.append(self.name)

        addresses = addresses_on(server.address)
        async with Host(bus=server.address) as elsewhere, Host(bus=server.address) as host:
            serving = elsewhere.add("/devices/Robot1", Answerer)
            await elsewhere.listening()
            runner = DeviceRunner(Watched("Robot1"), addresses, tmp_path, host)
            with pytest.raises(DeviceError, match="another program on the bus serves Robot1, too"):
                await runner.start()
            assert not opened, "its robot has been told nothing"
            await elsewhere.remove(serving)
            while await host.rival("/devices/Robot1") is not None:
                await asyncio.sleep(0.01)
            starting = asyncio.create_task(DeviceRunner(Watched("Robot1"), addresses, tmp_path / "again", host).start())
            while not opened:
                await asyncio.sleep(0.01)
            starting.cancel()

    on_bus(tmp_path, scenario)


def test_of_two_programs_that_begin_at_the_same_time_one_goes_on(tmp_path: Path) -> None:
    async def scenario(server: NatsServer) -> None:
        async with Host(bus=server.address) as one, Host(bus=server.address) as two:
            contested = [host.contested("/devices/Robot1") for host in (one, two)]
            for host in (one, two):
                assert await host.rival("/devices/Robot1") is None
            for host in (one, two):
                host.add("/devices/Robot1", Answerer)
            await asyncio.gather(one.listening(), two.listening())
            while not any(event.is_set() for event in contested):
                await asyncio.sleep(0.01)
            await asyncio.gather(one.listening(), two.listening())  # both have heard of both
            assert [event.is_set() for event in contested].count(True) == 1

    on_bus(tmp_path, scenario)


@pytest.mark.parametrize("cause", ["its process was killed and began anew", "the server of the bus was killed"])
def test_a_request_that_nobody_will_answer_is_given_up_without_waiting(tmp_path: Path, cause: str) -> None:
    async def scenario(server: NatsServer) -> None:
        first, second, asker = (Host(bus=server.address) for _ in range(3))
        for host in (first, second, asker):
            await host.start()
        silent = Silent("")
        address = first.add("/repository", lambda address: silent).address
        await first.listening()
        asking = asyncio.create_task(asker.request(question(address), timeout=HANG_TIME))
        await silent.asked.wait()
        if "began anew" in cause:
            second.add("/repository", Answerer)
            assert (await asking).body == ROWS
        else:
            server.kill()
            with pytest.raises(Unanswered, match="is lost"):
                await asking
            server.start()
        for host in (first, second, asker):
            await host.stop()

    on_bus(tmp_path, scenario)


@pytest.mark.parametrize("answer", [True, False])
@pytest.mark.parametrize("cause", ["cancelled", "given up", "given up and cancelled"])
def test_a_request_that_is_ended_when_its_answer_comes_ends_once(tmp_path: Path, cause: str, answer: bool) -> None:

    async def run() -> None:
        bus, subject = Bus(server.address), server.address.subject("/registry")
        await bus.start()
        ask = bus.client.request

        async def request(*arguments: Any, timeout: float) -> Msg:
            task, answered = asyncio.current_task(), asyncio.get_running_loop().create_future()
            assert task is not None

            def end() -> None:
                answered.set_result(Msg(bus.client)) if answer else answered.set_exception(errors.NoRespondersError())
                if "given up" in cause:
                    bus._give_up(subject)
                if "cancelled" in cause:
                    task.cancel()

            asyncio.get_running_loop().call_soon(end)
            return await asyncio.wait_for(answered, timeout)

        bus.client.request = request  # type: ignore[method-assign, assignment]
        asking = asyncio.create_task(bus._request(subject, b"", asyncio.get_running_loop().time() + HANG_TIME))
        await asyncio.wait([asking])
        assert asking.cancelled() == ("cancelled" in cause)
        assert asking.cancelled() or not asking.cancelling()
        bus.client.request = ask  # type: ignore[method-assign]
        await bus.close()

    with NatsServer(tmp_path) as server:
        asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_who_speaks_soap_reaches_the_bus_through_the_gateway(tmp_path: Path) -> None:
    async def run() -> None:
        parts = Server("127.0.0.1", 0)
        await parts.start()
        gateway_url = parts.url
        await parts.stop()
        with NatsServer(tmp_path, gateway_url) as server:
            host, bus, wire = Host(bus=server.address), Bus(server.address), Wire()
            await host.start()
            await bus.start()
            gateway = Server("127.0.0.1", int(gateway_url.rpartition(":")[2]), BusParts(bus, HANG_TIME))
            await gateway.start()
            host.add("/repository", Answerer)
            await host.listening()
            for url in (gateway_url, gateway_url.replace("127.0.0.1", "localhost")):
                answer = await wire.post(question(f"{url}/repository"))
                assert answer is not None
                assert answer.body == ROWS
            assert await wire.post_batch([question(f"{gateway_url}/repository")] * 2, 30) == [answer, answer]
            with pytest.raises(Unanswered, match=r"503.*nobody on the bus listens"):
                await wire.post(question(f"{gateway_url}/registry"))
            with pytest.raises(RemoteError, match="404"):
                await wire.post(question(f"{gateway_url}/"))
            await wire.close()
            await gateway.stop()
            await bus.close()
            await host.stop()

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_a_soap_participant_is_contracted_from_the_bus_without_knowing(tmp_path: Path) -> None:
    """Repository, Registry and Task Manager are on the bus, and the robot has an address of its own and knows nothing of it."""

    async def carry_out(task: object, report: Report) -> object:
        assert isinstance(task, Problem)
        return await asyncio.to_thread(plan, task)

    async def run() -> None:
        listener = Server("127.0.0.1", 0)
        await listener.start()
        url = listener.url
        await listener.stop()
        with NatsServer(tmp_path, url) as server:
            addresses = addresses_on(server.address)
            hosts = [Host(bus=server.address) for _ in range(3)]
            for host in hosts:
                await host.start()
            hosts[0].add("/repository", lambda address: Repository(address, contents()))
            hosts[1].add("/registry", lambda address: Registry(address, repository=addresses.repository))
            hosts[2].add(
                "/task-manager",
                lambda address: TaskManager(address, repository=addresses.repository, registry=addresses.registry),
                carry_out=carry_out,
            )
            bus = Bus(server.address)
            await bus.start()
            gateway = Server("127.0.0.1", int(url.rpartition(":")[2]), BusParts(bus, HANG_TIME))
            await gateway.start()
            outside = Addresses(repository=addresses.repository, registry=addresses.registry, task_manager=addresses.task_manager)
            for host in hosts:
                await host.listening()
            runner = DeviceRunner(Porter("Robot1"), outside, tmp_path)
            assert not (await runner.start()).startswith(f"{url}/")
            async with Client(outside) as client:
                task = await client.submit(Submit(effect="Jar1 isOn Table2"))
                views = [news.view async for news in client.news(task)]
            assert views[-1].outcome is Outcome.ACCOMPLISHED, views[-1].explanation
            await runner.stop()
            await gateway.stop()
            await bus.close()
            for host in hosts:
                await host.stop()

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_a_site_is_found_on_its_bus(tmp_path: Path) -> None:
    async def scenario(server: NatsServer) -> None:
        servers = server.address.servers
        with pytest.raises(UsageError, match="no gateway has been started there"):
            await find_site(servers)
        await list_site(addresses_on(server.address))
        assert await find_site(servers) == addresses_on(server.address)
        barn = BusAddress(servers=servers, site="barn", gateway="http://127.0.0.1:2")
        await list_site(addresses_on(barn))
        assert (await find_site(servers, "barn")).repository == "http://127.0.0.1:2/repository"
        with pytest.raises(UsageError, match=re.escape("the sites there are barn, yard; name one with --name")):
            await find_site(servers)
        with pytest.raises(UsageError, match="there is no site field"):
            await find_site(servers, "field")

    on_bus(tmp_path, scenario)


def test_a_gateway_that_starts_again_lists_all_that_its_site_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async def scenario(server: NatsServer) -> None:
        origin, servers = server.address.gateway, server.address.servers
        await list_site(structs.replace(addresses_on(server.address), api=f"{origin}/api"))
        numbers = [list_number(server.address, task_manager=number) for number in (2, 3, 2, 3)]
        await asyncio.gather(*numbers, list_number(server.address, registry=2))
        expected = structs.replace(
            addresses_on(server.address),
            api=f"{origin}/api",
            further_task_managers=(f"{origin}/task-manager-2", f"{origin}/task-manager-3"),
            further_registries=(f"{origin}/registry-2",),
        )
        assert await find_site(servers) == expected
        gateway = asyncio.create_task(run_gateway(server.address, "127.0.0.1", 0))
        while "gateway" not in capsys.readouterr().out:
            await asyncio.sleep(0.02)
        assert await find_site(servers) == expected
        gateway.cancel()

    on_bus(tmp_path, scenario)


@pytest.mark.long
def test_who_takes_over_while_the_servers_do_not_answer_lists_itself_when_they_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The host that was lost may have had one of the servers."""
    find_bucket = bus_module._sites

    async def scenario(server: NatsServer) -> None:
        async def lose_server(connection: Bus) -> object:
            bucket = await find_bucket(connection)
            server.kill()
            asyncio.get_running_loop().call_later(0.5, server.start)
            monkeypatch.setattr(bus_module, "_sites", find_bucket)
            return bucket

        await list_site(addresses_on(server.address))
        monkeypatch.setattr(bus_module, "_sites", lose_server)
        await list_number(server.address, registry=2)
        assert (await find_site(server.address.servers)).further_registries == (f"{server.address.gateway}/registry-2",)

    on_bus(tmp_path, scenario)


def test_a_gateway_that_starts_after_the_components_lists_all_that_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The bus may have forgotten the site: its data were lost, or it is another one."""

    async def scenario(server: NatsServer) -> None:
        components = ("task-manager", "task-manager-3", "registry-2", "repository")
        logs = [StreamLog(server.address.servers, "yard", component, "first") for component in components]
        for log in logs:
            await log.open()
        await list_number(server.address, task_manager=3)
        gateway = asyncio.create_task(run_gateway(server.address, "127.0.0.1", 0))
        while "gateway" not in capsys.readouterr().out:
            await asyncio.sleep(0.02)
        origin = server.address.gateway
        addresses = await find_site(server.address.servers)
        assert addresses.further_task_managers == (f"{origin}/task-manager-2", f"{origin}/task-manager-3")
        assert addresses.further_registries == (f"{origin}/registry-2",)
        gateway.cancel()
        for log in logs:
            await log.close()

    on_bus(tmp_path, scenario)


def test_a_site_is_discarded_and_others_on_the_bus_are_not(tmp_path: Path) -> None:
    async def scenario(server: NatsServer) -> None:
        logs = [StreamLog(server.address.servers, site, "registry", "first") for site in ("yard", "yard-2")]
        for log in logs:
            await log.open()
            assert await log.acquire()
            assert await log.begin_writing(0)
            await log.append(1, 1, b"one")
            (tmp_path / "copy").write_bytes(b"a copy")
            await log.store_copy(tmp_path / "copy", CopyInfo(number=0, address="http://127.0.0.1:1/registry"))
        with pytest.raises(UsageError, match="registry of the site yard runs on"):
            await discard_site(server.address.servers, "yard")
        for log in logs:
            await log.resign()
            await log.close()
        await discard_site(server.address.servers, "yard")
        logs = [StreamLog(server.address.servers, site, "registry", "second") for site in ("yard", "yard-2")]
        for log, bounds, number in zip(logs, ((1, 0), (1, 2)), (None, 0), strict=True):
            await log.open()
            assert await log.bounds() == bounds
            copy = await log.copy_info()
            assert (copy.number if copy is not None else None) == number
            assert await log.acquire()
            await log.close()

    on_bus(tmp_path, scenario)


def test_a_site_whose_components_are_too_busy_to_answer_is_not_discarded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus_module, "FIRST_ANSWER_TIME", 0.3)

    async def scenario(server: NatsServer) -> None:
        bus = Bus(server.address)
        await bus.start()
        busy = await bus.client.subscribe(status_subject("yard"))
        await bus.client.flush()
        with pytest.raises(UsageError, match="components of the site yard run, and do not answer; stop them"):
            await discard_site(server.address.servers, "yard")
        await busy.unsubscribe()
        await bus.client.flush()
        await discard_site(server.address.servers, "yard")
        await bus.close()

    on_bus(tmp_path, scenario)


@pytest.mark.parametrize("servers", ["http://127.0.0.1:4222", "nats://127.0.0.1:port", "nats://", "", "nats://127.0.0.1:4222,"])
def test_a_wrong_url_of_a_bus_is_refused(servers: str) -> None:
    async def run() -> None:
        with pytest.raises(UsageError, match="is not the URL of a NATS server"):
            await find_site(servers)

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_a_bus_that_cannot_be_reached_is_reported_once_and_joined_when_it_is_there(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def run() -> None:
        server = NatsServer(tmp_path)
        bus = Bus(server.address)
        starting = asyncio.create_task(bus.start())
        while not caplog.messages:
            await asyncio.sleep(0.02)
        await asyncio.sleep(1.0)
        [text] = caplog.messages
        assert f"the bus at {server.address.servers} cannot be reached" in text
        with server:
            await starting
            await bus.close()
            caplog.clear()
            with Reservation("127.0.0.1", 1) as reserved:
                absent = f"nats://127.0.0.1:{reserved.ports[0]}"
                for servers in (f"{absent},{server.address.servers}",) * 5:  # in an order that is chosen at random
                    bus = Bus(structs.replace(server.address, servers=servers))
                    await bus.start()
                    await bus.close()
            assert not caplog.messages

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_a_name_that_another_site_has_is_refused(tmp_path: Path) -> None:
    async def scenario(server: NatsServer) -> None:
        servers = server.address.servers
        await list_site(addresses_on(server.address))
        rival = BusAddress(servers=servers, site="yard", gateway="http://127.0.0.1:2")
        log = StreamLog(servers, "yard", "registry", "first")
        await log.open()
        assert await log.acquire()
        with pytest.raises(UsageError, match=re.escape("the site yard there is another one, with the gateway http://127.0.0.1:1")):
            await run_gateway(rival, "127.0.0.1", 0)
        assert await find_site(servers) == addresses_on(server.address)
        await log.resign()
        await log.close()

    on_bus(tmp_path, scenario)
