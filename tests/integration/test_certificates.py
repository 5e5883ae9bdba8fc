"""Components that prove to each other who they are: SOAP over HTTPS with certificates on both sides."""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import aiohttp
import pytest
from msgspec import structs

from somrs.errors import RemoteError
from somrs.protocol.messages import directory, frp, knowledge
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.rights import DENIED
from somrs.runtime.http import Server
from somrs.runtime.wire import Unanswered, Wire
from somrs.storage.audit_log import Actor, AuditLog
from somrs.trust.authority import Authority
from somrs.trust.certificates import CERTIFICATE_DAYS
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity, Role

Scenario = Callable[["Office"], Awaitable[None]]


def enrolled(authority: Authority, name: str, role: Role, *, now: datetime | None = None) -> Credentials:
    identity = Identity(name=name, roles=frozenset({role}))
    now = now if now is not None else datetime.now(UTC)
    return Credentials(authority.issue_program(identity, ("127.0.0.1",), now)[0])


class Office:
    """A Repository that takes everything, and the authority of its site."""

    def __init__(self, folder: Path) -> None:
        self.authority = Authority.of_data(folder)
        self.authority.create("office", datetime.now(UTC))
        self.taken: list[Message] = []
        self.server = Server("127.0.0.1", 0, {"/part": self._take}, credentials=enrolled(self.authority, "part", Role.REPOSITORY))

    async def _take(self, message: Message) -> Message | None:
        self.taken.append(message)
        return None

    def message(self, body: Body, number: int = 1) -> Message:
        header = Header(
            sender=self.server.url,
            recipient=f"{self.server.url}/part",
            message_id=f"urn:uuid:{number}",
            reply_to=f"{self.server.url}/sender",
            transaction="urn:t",
            participant="Robot1.Work#s1",
        )
        return Message(header=header, body=body)

    async def send(self, credentials: Credentials | None, body: Body) -> object:
        """What comes of a message: the body of the answer, or None if it was taken."""
        wire = Wire(credentials)
        try:
            answer = await wire.post(self.message(body))
            return answer.body if answer is not None else None
        finally:
            await wire.close()


def run(folder: Path, scenario: Scenario) -> None:
    async def play() -> None:
        office = Office(folder)
        await office.server.start()
        try:
            await scenario(office)
        finally:
            await office.server.stop()

    asyncio.run(play())


COMPLETED = frp.Completed(situation="")


def test_who_has_the_right_is_heard(tmp_path: Path) -> None:
    async def scenario(office: Office) -> None:
        assert office.server.url.startswith("https://")
        assert await office.send(enrolled(office.authority, "Robot1", Role.DEVICE), COMPLETED) is None
        assert await office.send(enrolled(office.authority, "manager", Role.TASK_MANAGER), frp.Stop(reason="enough")) is None
        assert [message.body for message in office.taken] == [COMPLETED, frp.Stop(reason="enough")]

    run(tmp_path, scenario)


@pytest.mark.parametrize(
    ("name", "role", "body", "text"),
    [
        ("Robot2", Role.DEVICE, COMPLETED, "Robot2 (device) may not speak for Robot1, as this Completed does"),
        ("Robot1", Role.DEVICE, frp.Stop(reason="mine"), "Robot1 (device) may not send Stop: that is for the roles task-manager"),
        ("guest", Role.VIEWER, knowledge.Define(), "guest (viewer) may not send Define"),
        ("Robot2", Role.DEVICE, directory.Retract(provider="Robot1"), "Robot2 (device) may not speak for Robot1"),
    ],
)
def test_who_has_not_reads_what_is_missing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str, role: Role, body: Body, text: str
) -> None:
    async def scenario(office: Office) -> None:
        credentials = enrolled(office.authority, name, role)
        for _ in range(12):
            answer = await office.send(credentials, body)
            assert isinstance(answer, frp.Fault)
            assert (answer.code, text in answer.text) == (DENIED, True), answer.text
        assert office.taken == []

    with caplog.at_level(logging.WARNING):
        run(tmp_path, scenario)
    counts = [record.getMessage().rpartition("(")[2] for record in caplog.records if "denied" in record.getMessage()]
    assert counts == ["1 times)", "10 times)"]
    entries = [*AuditLog(tmp_path).entries()]
    assert [(entry.act, entry.outcome, entry.actor) for entry in entries] == [
        (f"send {type(body).__name__}", "denied", Actor(name=name, address="127.0.0.1"))
    ] * 2
    assert [entry.details["times"] for entry in entries] == [1, 10]


@pytest.mark.parametrize(
    ("name", "role", "path"),
    [
        ("Robot1", Role.DEVICE, "/devices/Robot2"),
        ("Robot1", Role.DEVICE, "/task-manager"),
        ("task-manager-2", Role.TASK_MANAGER, "/task-manager"),
        ("manager", Role.TASK_MANAGER, "/repository"),
    ],
)
def test_nobody_sends_from_the_address_of_another_one(tmp_path: Path, name: str, role: Role, path: str) -> None:
    async def scenario(office: Office) -> None:
        credentials = enrolled(office.authority, name, role)
        body = COMPLETED if role is Role.DEVICE else frp.Stop(reason="enough")
        message = office.message(body)
        wire = Wire(credentials)
        try:
            for header in (
                structs.replace(message.header, sender=f"{office.server.url}{path}"),
                structs.replace(message.header, reply_to=f"{office.server.url}{path}"),
            ):
                answer = await wire.post(structs.replace(message, header=header))
                assert answer is not None
                assert isinstance(answer.body, frp.Fault)
                assert (answer.body.code, f"{name} may not name {office.server.url}{path}" in answer.body.text) == (DENIED, True)
        finally:
            await wire.close()
        assert office.taken == []

    run(tmp_path, scenario)


def test_nobody_is_heard_without_a_certificate_of_the_site(tmp_path: Path) -> None:
    async def scenario(office: Office) -> None:
        foreign = Authority.of_data(tmp_path / "foreign")
        foreign.create("elsewhere", datetime.now(UTC))
        with pytest.raises(Unanswered, match="the certificate of that program is not accepted here"):
            await office.send(enrolled(foreign, "Robot1", Role.DEVICE), COMPLETED)
        with pytest.raises(Unanswered, match="cannot be reached"):
            await office.send(None, COMPLETED)
        trusting = ssl.create_default_context(cafile=str(office.authority.certificate_file))
        async with aiohttp.ClientSession(connector=aiohttp.TCPConnector(ssl=trusting)) as session:
            with pytest.raises(aiohttp.ClientError):
                await session.post(f"{office.server.url}/part", data=b"")
        url = office.server.url.replace("https", "http")
        async with aiohttp.ClientSession() as session:
            with pytest.raises(aiohttp.ClientError):
                await session.post(f"{url}/part", data=b"")
        assert office.taken == []

    run(tmp_path, scenario)


def test_an_expired_certificate_is_refused_and_said_so(tmp_path: Path) -> None:
    async def scenario(office: Office) -> None:
        past = datetime.now(UTC) - timedelta(days=CERTIFICATE_DAYS + 1)
        with pytest.raises(Unanswered, match=r"the certificate of Robot1 expired at .*: enrol it again, with a new invitation"):
            await office.send(enrolled(office.authority, "Robot1", Role.DEVICE, now=past), COMPLETED)
        assert office.taken == []

    run(tmp_path, scenario)


def test_who_is_revoked_is_refused_at_once_on_an_open_connection(tmp_path: Path) -> None:
    async def scenario(office: Office) -> None:
        wire = Wire(enrolled(office.authority, "Robot1", Role.DEVICE))
        try:
            assert await wire.post(office.message(COMPLETED)) is None
            office.authority.revoke("Robot1", datetime.now(UTC))
            answer = await wire.post(office.message(COMPLETED, 2))
            assert answer is not None
            assert isinstance(answer.body, frp.Fault)
            assert (answer.body.code, "the certificate of Robot1" in answer.body.text, "is revoked" in answer.body.text) == (
                DENIED,
                True,
                True,
            )
        finally:
            await wire.close()
        assert len(office.taken) == 1

    run(tmp_path, scenario)


def test_a_certificate_that_expires_on_an_open_connection_ends_its_rights(tmp_path: Path) -> None:
    async def scenario(office: Office) -> None:
        almost_over = datetime.now(UTC) - timedelta(days=CERTIFICATE_DAYS) + timedelta(seconds=2)
        wire = Wire(enrolled(office.authority, "Robot1", Role.DEVICE, now=almost_over))
        try:
            assert await wire.post(office.message(COMPLETED)) is None
            while not isinstance(answer := await wire.post(office.message(COMPLETED, 2)), Message):
                await asyncio.sleep(0.1)
            assert isinstance(answer.body, frp.Fault)
            assert "the certificate of Robot1 has expired" in answer.body.text
        finally:
            await wire.close()

    run(tmp_path, scenario)


def test_a_program_goes_on_with_a_renewed_certificate(tmp_path: Path) -> None:
    async def scenario(office: Office) -> None:
        due = datetime.now(UTC) - timedelta(days=CERTIFICATE_DAYS - 1)
        credentials = enrolled(office.authority, "Robot1", Role.DEVICE, now=due)
        assert await office.send(credentials, COMPLETED) is None
        enrolled(office.authority, "Robot1", Role.DEVICE)  # somebody has renewed it
        [old, new] = [entry for entry in office.authority.read().certificates if entry.name == "Robot1"]
        serials = office.authority.folder / "revoked.txt"
        serials.write_text(f"{old.serial}\n")
        assert await office.send(credentials, COMPLETED) is None
        serials.write_text(f"{new.serial}\n{old.serial}\n")
        assert isinstance(await office.send(credentials, COMPLETED), frp.Fault)

    run(tmp_path, scenario)


def test_each_message_of_a_batch_needs_its_right(tmp_path: Path) -> None:
    async def scenario(office: Office) -> None:
        wire = Wire(enrolled(office.authority, "Robot1", Role.DEVICE))
        try:
            bodies = (COMPLETED, frp.Stop(reason="mine"), frp.Progress(fraction=0.5))
            messages = [office.message(body, number) for number, body in enumerate(bodies)]
            first, second, third = await wire.post_batch(messages, 10.0)
        finally:
            await wire.close()
        assert (first, third) == (None, None)
        assert isinstance(second, Message)
        assert isinstance(second.body, frp.Fault)
        assert second.body.code == DENIED
        assert [type(message.body) for message in office.taken] == [frp.Completed, frp.Progress]

    run(tmp_path, scenario)


def test_a_server_is_who_it_says(tmp_path: Path) -> None:
    """A program with a certificate for another host is not believed to be the one that is asked."""

    async def scenario(office: Office) -> None:
        identity = Identity(name="elsewhere", roles=frozenset({Role.REPOSITORY}))
        credentials = Credentials(office.authority.issue_program(identity, ("10.9.8.7",), datetime.now(UTC))[0])
        impostor = Server("127.0.0.1", 0, {"/part": office._take}, credentials=credentials)
        await impostor.start()
        wire = Wire(enrolled(office.authority, "manager", Role.TASK_MANAGER))
        header = Header(sender=office.server.url, recipient=f"{impostor.url}/part", message_id="urn:uuid:9")
        try:
            with pytest.raises(RemoteError, match=r"the certificate of that program is not accepted here .*127\.0\.0\.1"):
                await wire.post(Message(header=header, body=frp.Stop(reason="enough")))
        finally:
            await wire.close()
            await impostor.stop()
        assert office.taken == []

    run(tmp_path, scenario)
