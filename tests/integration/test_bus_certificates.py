"""Components on a bus that prove to each other who they are, with a real NATS server."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import nats
import pytest
from msgspec import structs
from nats.aio.msg import Msg

from somrs.deployment.bus import addresses_on, find_site, list_site, run_gateway
from somrs.protocol.messages import directory, frp, knowledge
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.rights import DENIED
from somrs.runtime.bus import Bus
from somrs.runtime.bus_requests import answer_subject
from somrs.runtime.host import Host
from somrs.runtime.wire import Unanswered, Wire
from somrs.storage.audit_log import Actor, AuditLog
from somrs.storage.nats_connection import connect, end
from somrs.storage.stored_copy import CopyInfo
from somrs.storage.stream_log import StreamLog
from somrs.trust.authority import Authority
from somrs.trust.certificates import CERTIFICATE_DAYS
from somrs.trust.credentials import VARIABLE, Credentials
from somrs.trust.identity import Identity, Role
from somrs.trust.neighbours import TrustedNeighbour
from tests.support.hang import HANG_TIME
from tests.support.secure_bus import SecureBus, free_port, running, secure_bus

COMPLETED = frp.Completed(situation="")


class Place:
    """A Repository that takes everything."""

    def __init__(self, bus: SecureBus) -> None:
        self.bus, self.taken_messages = bus, list[Message]()
        self.listener = Bus(bus.address, bus.enrolled("repository", Role.REPOSITORY))

    async def take(self, message: Message) -> Message | None:
        self.taken_messages.append(message)
        return None

    def message(self, body: Body, sender: str = "/devices/Robot1") -> Message:
        gateway = self.bus.address.gateway
        return Message(
            header=Header(
                sender=f"{gateway}{sender}",
                recipient=f"{gateway}/repository",
                message_id=f"urn:uuid:{len(self.taken_messages)}",
                transaction="urn:t",
                participant="Robot1.Work#s1",
            ),
            body=body,
        )

    async def send(self, credentials: Credentials, message: Message) -> object:
        """What comes of a message: the body of the answer, or None if it was taken_messages."""
        sender = Bus(self.bus.address, credentials)
        await sender.start()
        try:
            answer = await sender.post(message)
            return answer.body if answer is not None else None
        finally:
            await sender.close()


def on_place(folder: Path, scenario: Callable[[Place], Awaitable[None]]) -> None:
    async def play() -> None:
        async with secure_bus(folder) as bus:
            place = Place(bus)
            await place.listener.start()
            place.listener.parts["/repository"] = place.take
            await place.listener.listening()
            await scenario(place)
            await place.listener.stop()
            await place.listener.close()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_a_sender_is_heard_for_what_its_certificate_names(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        first, second = (place.bus.enrolled(name, Role.DEVICE) for name in ("Robot1", "Robot2"))
        assert await place.send(first, place.message(COMPLETED)) is None
        for credentials, body, sender, text in (
            (second, COMPLETED, "/devices/Robot2", "Robot2 (device) may not speak for Robot1, as this Completed does"),
            (second, directory.Retract(provider="Robot1"), "/devices/Robot2", "Robot2 (device) may not speak for Robot1"),
            (first, frp.Stop(reason="mine"), "/devices/Robot1", "Robot1 (device) may not send Stop"),
            (first, COMPLETED, "/task-manager", "Robot1 may not name https://"),
            (first, COMPLETED, "/devices/Robot2", "Robot1 may not name https://"),
        ):
            fault = await place.send(credentials, place.message(body, sender))
            assert isinstance(fault, frp.Fault)
            assert (fault.code, text in fault.text) == (DENIED, True), fault.text
        assert len(place.taken_messages) == 1
        entries = [(entry.act, entry.outcome, entry.actor) for entry in AuditLog(tmp_path).entries()]
        assert (("send Completed", "denied", Actor(name="Robot2", address=""))) in entries

    on_place(tmp_path, scenario)


def test_the_servers_of_the_bus_let_nobody_speak_or_listen_in_the_name_of_others(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        robot, problems, taken_messages = place.bus.enrolled("Robot1", Role.DEVICE), list[str](), list[Msg]()
        await place.bus.known(robot)
        client = await place.bus.connected(robot, problems)

        async def take(message: Msg) -> None:
            taken_messages.append(message)

        subjects = (
            "somrs-from.yard.task-manager.repository",
            "somrs-from.yard.Robot2.repository",
            "somrs.yard.repository",
            "somrs-beginnings.yard.repository",
            "somrs-journal.yard.task-manager",
            "$KV.somrs-leaders.yard.task-manager",
            "$KV.somrs-sites.yard",
            "$JS.API.STREAM.DELETE.KV_somrs-sites",
            "$JS.API.STREAM.MSG.GET.somrs-journal-yard-task-manager",
            "_INBOX.task-manager.1.2",
        )
        for subject in subjects:
            await client.publish(subject, b"forged", reply="_INBOX.Robot1.1")
        patterns = (
            "somrs-from.yard.*.repository",
            "somrs-from.>",
            "_INBOX.>",
            "somrs-from.yard.*.processes.>",
            "somrs-journal.>",
            "somrs-from.*.*.devices.*",
        )
        for pattern in patterns:
            await client.subscribe(pattern, cb=take)
        refusals = [f'"{subject.lower()}"' for subject in (*subjects, *patterns)]
        while not all(any(refusal in problem.lower() for problem in problems) for refusal in refusals):
            await client.flush()
        assert await place.send(robot, place.message(COMPLETED)) is None
        assert [message.body for message in place.taken_messages] == [COMPLETED]
        assert taken_messages == []
        await client.close()

    on_place(tmp_path, scenario)


def test_an_answer_arrives_although_the_certificates_that_hold_change_meanwhile(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        requested, go_on = asyncio.Event(), asyncio.Event()

        async def answer_late(message: Message) -> Message | None:
            requested.set()
            await go_on.wait()
            return await place.take(message)

        place.listener.parts["/repository"] = answer_late
        robot = place.bus.enrolled("Robot1", Role.DEVICE)
        sending = asyncio.create_task(place.send(robot, place.message(COMPLETED)))
        await requested.wait()
        await place.bus.known(place.bus.enrolled("Robot2", Role.DEVICE))
        go_on.set()
        assert await sending is None

    on_place(tmp_path, scenario)


def test_an_answer_of_who_may_not_listen_there_is_dropped(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(place: Place) -> None:
        requested, go_on, requests = asyncio.Event(), asyncio.Event(), list[Msg]()
        take = place.listener._receive

        async def see(request: Msg) -> None:
            requests.append(request)
            requested.set()
            await go_on.wait()
            await take(request)

        place.listener._receive = see  # type: ignore[method-assign]
        del place.listener.parts["/repository"]
        place.listener.parts["/repository"] = place.take
        await place.listener.listening()
        robot, stranger = (place.bus.enrolled(name, Role.DEVICE) for name in ("Robot1", "Robot2"))
        sending = asyncio.create_task(place.send(robot, place.message(COMPLETED)))
        await requested.wait()
        await place.bus.known(stranger)
        client = await place.bus.connected(stranger, [])
        await client.publish(answer_subject(place.bus.address, "Robot2", requests[0].reply), b"forged")
        await client.flush()
        while not any("Robot2 has answered a message to somrs.yard.repository" in text for text in caplog.messages):
            await asyncio.sleep(0.02)
        go_on.set()
        assert await sending is None
        assert len(place.taken_messages) == 1
        await client.close()

    on_place(tmp_path, scenario)


def test_nobody_connects_without_a_certificate_of_the_site(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        foreign = Authority.of_data(tmp_path / "foreign")
        foreign.create("elsewhere", datetime.now(UTC))
        identity = Identity(name="repository", roles=frozenset({Role.REPOSITORY}))
        stranger = Credentials(foreign.issue_program(identity, ("127.0.0.1",), datetime.now(UTC))[0])
        for credentials in (None, stranger):
            with pytest.raises((nats.errors.Error, OSError, TimeoutError)):
                await place.bus.connected(credentials, [])

    on_place(tmp_path, scenario)


def test_where_nobody_listens_nothing_is_waited_for(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        message = place.message(COMPLETED)
        elsewhere = structs.replace(message.header, recipient=f"{place.bus.address.gateway}/registry")
        with pytest.raises(Unanswered, match=r"nobody on the bus listens to somrs\.yard\.registry"):
            await place.send(place.bus.enrolled("Robot1", Role.DEVICE), structs.replace(message, header=elsewhere))

    on_place(tmp_path, scenario)


def test_the_program_that_serves_a_device_is_named(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        fleet = Identity(name="vda.5050", roles=frozenset({Role.DEVICE}), speaks_for=frozenset({"Robot1"}))
        certificate, _ = place.bus.authority.issue_program(fleet, ("127.0.0.1",), datetime.now(UTC))
        adapter, device = (Bus(place.bus.address, held) for held in (Credentials(certificate), place.bus.enrolled("Robot1", Role.DEVICE)))
        for bus in (adapter, device):
            await bus.start()
        assert await device.listener("/devices/Robot1") is None
        adapter.parts["/devices/Robot1"] = place.take
        await adapter.listening()
        assert await device.listener("/devices/Robot1") == "vda.5050"
        assert await adapter.listener("/devices/Robot1") is None, "it is the program itself"
        for bus in (adapter, device):
            await bus.close()

    on_place(tmp_path, scenario)


def test_who_is_revoked_is_refused_at_once_also_when_it_is_enrolled_again(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        robot = place.bus.enrolled("Robot1", Role.DEVICE)
        stolen = tmp_path / "stolen"
        stolen.mkdir()
        for file in (robot.certificate, robot.key, robot.authority):
            (stolen / file.name).write_bytes(file.read_bytes())
        thief, problems = Credentials(stolen / "Robot1.pem"), list[str]()
        await place.bus.known(robot)
        ended = asyncio.Event()
        client = await place.bus.connected(thief, problems)

        async def note_end() -> None:
            ended.set()

        client._closed_cb = note_end
        sender = Bus(place.bus.address, robot)
        await sender.start()
        assert await sender.post(place.message(COMPLETED)) is None
        place.bus.authority.revoke("Robot1", datetime.now(UTC))
        try:
            answer = await sender.post(place.message(COMPLETED))
        except Unanswered:  # the servers were faster than the recipient
            pass
        else:
            assert answer is not None
            assert isinstance(answer.body, frp.Fault)
            assert "Robot1 has no certificate that holds" in answer.body.text
        assert len(place.taken_messages) == 1
        await ended.wait()
        renewed = place.bus.enrolled("Robot1", Role.DEVICE)
        assert await place.send(renewed, place.message(COMPLETED)) is None
        with pytest.raises(nats.errors.Error, match="Authorization Violation"):
            await place.bus.connected(thief, problems)
        await sender.close()

    on_place(tmp_path, scenario)


def test_a_connection_goes_on_with_a_renewed_certificate(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        ends = datetime.now(UTC) + timedelta(seconds=4)
        robot = place.bus.enrolled("Robot1", Role.DEVICE, now=ends - timedelta(days=CERTIFICATE_DAYS))
        sender = Bus(place.bus.address, robot)
        await sender.start()
        assert await sender.post(place.message(COMPLETED)) is None
        place.bus.enrolled("Robot1", Role.DEVICE)
        while datetime.now(UTC) <= ends + timedelta(seconds=1):
            await asyncio.sleep(0.1)
        assert robot.generation == 1
        assert await sender.post(place.message(COMPLETED)) is None
        await sender.close()

    on_place(tmp_path, scenario)


def test_the_gateway_passes_messages_on_in_the_name_of_who_has_sent_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def scenario(place: Place) -> None:
        gateway = place.bus.enrolled("gateway", Role.GATEWAY)
        monkeypatch.setenv(VARIABLE, str(gateway.certificate))
        serving = asyncio.create_task(run_gateway(place.bus.address, "127.0.0.1", place.bus.gateway_port))
        while "gateway" not in capsys.readouterr().out:
            await asyncio.sleep(0.02)
        monkeypatch.delenv(VARIABLE)
        robot, stranger = (Wire(place.bus.enrolled(name, Role.DEVICE)) for name in ("Robot1", "Robot2"))
        assert await robot.post(place.message(COMPLETED)) is None
        for wire, sender, text in (
            (stranger, "/devices/Robot2", "Robot2 (device) may not speak for Robot1"),
            (robot, "/task-manager", "Robot1 may not name"),
        ):
            answer = await wire.post(place.message(COMPLETED, sender))
            assert answer is not None
            assert isinstance(answer.body, frp.Fault)
            assert (answer.body.code, text in answer.body.text) == (DENIED, True), answer.body.text
        assert len(place.taken_messages) == 1
        await robot.close()
        await stranger.close()
        serving.cancel()

    on_place(tmp_path, scenario)


def test_the_gateway_passes_messages_of_a_neighbour_on_and_recipients_check_them_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    barn_authority = Authority.of_data(tmp_path / "barn")
    barn_authority.create("barn", datetime.now(UTC))
    repository_of_barn = "https://127.0.0.2:8500/repository"

    def of_barn(name: str, role: Role) -> Wire:
        identity = Identity(name=name, roles=frozenset({role}))
        return Wire(Credentials(barn_authority.issue_program(identity, ("127.0.0.2",), datetime.now(UTC))[0]))

    async def scenario(place: Place) -> None:
        barn = TrustedNeighbour(name="Barn", authority=barn_authority.public_certificate, repository=repository_of_barn)
        place.bus.authority.trust_neighbours((barn,), ("127.0.0.1",))
        yard = TrustedNeighbour(name="Yard", authority=place.bus.authority.public_certificate, hosts=("127.0.0.1",))
        barn_authority.trust_neighbours((yard,), ("127.0.0.2",))
        monkeypatch.setenv(VARIABLE, str(place.bus.enrolled("gateway", Role.GATEWAY).certificate))
        serving = asyncio.create_task(run_gateway(place.bus.address, "127.0.0.1", place.bus.gateway_port))
        while "gateway" not in capsys.readouterr().out:
            await asyncio.sleep(0.02)
        monkeypatch.delenv(VARIABLE)
        repository, device = of_barn("repository", Role.REPOSITORY), of_barn("Robot1", Role.DEVICE)
        header = structs.replace(place.message(COMPLETED).header, sender=repository_of_barn, reply_to=repository_of_barn)
        assert await repository.post(Message(header=header, body=knowledge.ReadMap())) is None
        assert [message.body for message in place.taken_messages] == [knowledge.ReadMap()]
        of_robot = structs.replace(header, sender="https://127.0.0.2:1/devices/Robot1", reply_to="https://127.0.0.2:1/devices/Robot1")
        for wire, message, text in (
            (device, Message(header=of_robot, body=knowledge.Define()), "Barn:Robot1 (device) may not send Define"),
            # The gateway takes this for some Task Manager; the Repository is none.
            (device, Message(header=of_robot, body=COMPLETED), "Barn:Robot1 (device) may not send Completed"),
            (repository, place.message(knowledge.ReadMap(), "/repository"), "the file with the neighbours has another address for Barn"),
        ):
            answer = await wire.post(message)
            assert answer is not None
            assert isinstance(answer.body, frp.Fault)
            assert (answer.body.code, text in answer.body.text) == (DENIED, True), answer.body.text
        assert len(place.taken_messages) == 1
        # It is a neighbour no more.
        place.bus.authority.trust_neighbours((), ("127.0.0.1",))
        answer = await repository.post(Message(header=header, body=knowledge.ReadMap()))
        assert answer is not None
        assert isinstance(answer.body, frp.Fault)
        for wire in (repository, device):
            await wire.close()
        serving.cancel()

    on_place(tmp_path, scenario)


def test_each_component_has_what_it_needs_of_the_bus(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Listing and finding a site, journals and leases: nothing of it is denied."""

    async def scenario(place: Place) -> None:
        bus = place.bus
        await list_site(addresses_on(bus.address), bus.enrolled("gateway", Role.GATEWAY))
        robot = bus.enrolled("Robot1", Role.DEVICE)
        with pytest.MonkeyPatch.context() as environment:
            environment.setenv(VARIABLE, str(robot.certificate))
            assert await find_site(bus.address.servers) == addresses_on(bus.address)
        manager = bus.enrolled("manager-of-the-second-floor", Role.TASK_MANAGER)
        log = StreamLog(bus.address.servers, "yard", "task-manager-2", "first", manager)
        await log.open()
        assert await log.acquire()
        assert await log.begin_writing(0)
        await log.append(1, 1, b"one")
        (tmp_path / "copy").write_bytes(b"a copy")
        await log.store_copy(tmp_path / "copy", CopyInfo(number=1, address=f"{bus.address.gateway}/task-manager-2"))
        await log.fetch_copy(tmp_path / "fetched")
        await log.forget_before(2)
        batch = await log.batch(2)
        assert batch is not None
        assert ((tmp_path / "fetched").read_bytes(), batch.document) == (b"a copy", b"one")
        await log.resign()
        await log.close()
        host = Host(bus=bus.address, credentials=robot)
        await host.start()
        await host.listening()
        await host.stop()
        assert not [record.getMessage() for record in caplog.records if "denied" in record.getMessage()]

    on_place(tmp_path, scenario)


def test_only_servers_of_the_bus_join_it_as_servers(tmp_path: Path) -> None:
    async def play() -> None:
        bus = SecureBus(tmp_path)
        server, second, robot = bus.enrolled("bus", Role.BUS), bus.enrolled("bus-2", Role.BUS), bus.enrolled("Robot1", Role.DEVICE)
        ports = [free_port() for _ in range(3)]
        routes = [f"127.0.0.1:{port}" for port in ports[:2]]

        async def noted(folder: Path, text: str) -> None:
            log = folder / "bus" / "server.log"
            while not log.exists() or text not in log.read_text():
                await asyncio.sleep(0.05)

        folders = [tmp_path / name for name in ("first", "second", "third")]
        async with (
            running(folders[0], bus.address.servers, server, ports[0], routes),
            running(folders[1], f"tls://127.0.0.1:{free_port()}", second, ports[1], routes),
        ):
            await noted(folders[0], "metadata leader")
            async with running(folders[2], f"tls://127.0.0.1:{free_port()}", robot, ports[2], [*routes, f"127.0.0.1:{ports[2]}"]):
                await noted(folders[2], "Authorization Violation")

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_a_program_ends_in_order_although_the_bus_has_ended_before(tmp_path: Path) -> None:
    async def play() -> None:
        async with secure_bus(tmp_path) as bus:
            manager = bus.enrolled("task-manager", Role.TASK_MANAGER)
            connection, log = Bus(bus.address, manager), StreamLog(bus.address.servers, "yard", "task-manager", "first", manager)
            await connection.start()
            await log.open()
        while connection.client.is_connected:
            await asyncio.sleep(0.02)
        for client in (connection.client, log._client, log._writer):
            assert client is not None
            client._pending.append(b"PING\r\n")  # what a program has written last
            client._pending_data_size += 6
        await connection.close()
        await log.close()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_a_connection_ends_although_the_server_went_away_while_tls_was_agreed_on(tmp_path: Path) -> None:
    async def play() -> None:
        async with secure_bus(tmp_path) as bus:
            client = await connect(bus.address.servers, bus.enrolled("bus", Role.BUS))
        has_refused = asyncio.Event()

        async def refuse(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.close()
            has_refused.set()

        async with await asyncio.start_server(refuse, "127.0.0.1", int(bus.address.servers.rpartition(":")[2])):
            await has_refused.wait()
            await asyncio.sleep(0.05)  # the client notices, and pauses before the next attempt
            await end(client)

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))
