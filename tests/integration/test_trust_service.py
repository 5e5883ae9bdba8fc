"""The service of an authority, with real servers: enrolment with a word, news of what is revoked, and renewal."""

from __future__ import annotations

import asyncio
import contextlib
import errno
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import aiohttp
import msgspec
import pytest

from somrs.client.addresses import Addresses
from somrs.deployment import trust_service
from somrs.deployment.trust_service import TrustService, run_trust
from somrs.errors import RemoteError, UsageError
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Header, Message
from somrs.runtime.host import Host
from somrs.runtime.http import Server
from somrs.runtime.trust_client import enrol_at, follow
from somrs.runtime.wire import Wire
from somrs.storage.audit_log import AuditLog
from somrs.trust import certificates
from somrs.trust.authority import Authority
from somrs.trust.certificates import CERTIFICATE_DAYS
from somrs.trust.credentials import SERVICE_FILE, Credentials
from somrs.trust.identity import Identity, Role
from tests.support.hang import HANG_TIME

ROBOT = Identity(name="Robot7", roles=frozenset({Role.DEVICE}))


class Site:
    """An authority with its service at `url`."""

    def __init__(self, folder: Path) -> None:
        self.data = folder / "site"
        self.data.mkdir()
        self.authority = Authority.of_data(self.data)
        self.authority.create("office", datetime.now(UTC))
        self.url = ""

    async def enrolled(self, folder: Path, identity: Identity = ROBOT) -> Credentials:
        """A device that enrols itself on another computer, which has this folder."""
        await enrol_at(self.url, self.authority.invite(identity, datetime.now(UTC)), folder)
        return Credentials(folder / f"{identity.name}.pem")

    def aged(self, credentials: Credentials, age: timedelta) -> None:
        """Replace a certificate by one that is older."""
        request = certificates.make_request()
        document = self.authority.issue(ROBOT, request.certificate, ("127.0.0.1",), datetime.now(UTC) - age)
        credentials.certificate.write_bytes(document)
        credentials.key.write_bytes(request.key)
        credentials.renew()


@asynccontextmanager
async def office(folder: Path) -> AsyncIterator[Site]:
    site = Site(folder)
    service = asyncio.create_task(run_trust(site.data, "127.0.0.1", 0))
    file = site.authority.folder / SERVICE_FILE
    while not file.exists():
        assert not service.done(), service
        await asyncio.sleep(0.01)
    site.url = file.read_text().strip()
    try:
        yield site
    finally:
        service.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await service


def run(folder: Path, scenario: Callable[[Site], Awaitable[None]]) -> None:
    async def play() -> None:
        async with asyncio.timeout(HANG_TIME), office(folder) as site:
            await scenario(site)

    asyncio.run(play())


def test_a_device_on_another_computer_enrols_itself_with_a_word(tmp_path: Path) -> None:
    async def scenario(site: Site) -> None:
        addresses = Addresses(repository="https://10.0.0.1:1/repository", registry="", task_manager="", trust="/somewhere")
        addresses.write(site.data)
        word = site.authority.invite(ROBOT, datetime.now(UTC))
        written = await enrol_at(f"{site.url}/", word, tmp_path / "robot")
        of_authority = ["authority.pem", "holders.json", "neighbours-revoked.json", "neighbours.json", "revoked.txt", "service.txt"]
        assert [file.name for file in written] == ["Robot7.key", "Robot7.pem", *of_authority, "system.json"]
        assert {file.stat().st_mode & 0o777 for file in written} == {0o600}
        assert Addresses.read(tmp_path / "robot") == msgspec.structs.replace(addresses, trust=None)
        credentials = Credentials(tmp_path / "robot" / "Robot7.pem")
        assert (credentials.name, credentials.service, credentials.data) == ("Robot7", site.url, None)
        assert site.authority.check(credentials.certificate.read_bytes(), datetime.now(UTC)) == ROBOT
        with pytest.raises(UsageError, match="this invitation is unknown or was used"):
            await enrol_at(site.url, word, tmp_path / "thief")
        assert [
            (entry.act, entry.outcome, entry.actor.name if entry.actor is not None else None) for entry in AuditLog(site.data).entries()
        ] == [
            ("trust.enrol", "done", "Robot7"),
            ("trust.enrol", "denied", ""),
        ]

    run(tmp_path, scenario)


def test_a_certificate_is_for_the_computer_that_asks_or_for_what_the_invitation_names(tmp_path: Path) -> None:
    async def scenario(site: Site) -> None:
        await site.enrolled(tmp_path / "robot")
        word = site.authority.invite(Identity(name="Robot8", roles=ROBOT.roles), datetime.now(UTC), hosts=("robot8.example",))
        await enrol_at(site.url, word, tmp_path / "robot")
        hosts = {entry.name: entry.hosts for entry in site.authority.read().certificates}
        assert (hosts["Robot7"], hosts["Robot8"]) == (("127.0.0.1", "localhost"), ("robot8.example",))

    run(tmp_path, scenario)


def test_a_word_goes_to_nobody_but_the_authority_that_has_invited(tmp_path: Path) -> None:
    async def scenario(site: Site) -> None:
        (tmp_path / "other").mkdir()
        async with office(tmp_path / "other") as impostor:
            word = site.authority.invite(ROBOT, datetime.now(UTC))
            with pytest.raises(UsageError, match="is not the service of the authority that has invited"):
                await enrol_at(impostor.url, word, tmp_path / "robot")
            with pytest.raises(UsageError, match="this is not a whole word of an invitation"):
                await enrol_at(site.url, word.partition(".")[0], tmp_path / "robot")
            assert [*AuditLog(impostor.data).entries()] == []
        with pytest.raises(RemoteError, match="cannot be reached"):
            await enrol_at("https://127.0.0.1:1", word, tmp_path / "robot")
        with pytest.raises(UsageError, match="is no address"):
            await enrol_at("robots", word, tmp_path / "robot")
        await enrol_at(site.url, word, tmp_path / "robot")

    run(tmp_path, scenario)


def test_only_who_has_a_certificate_that_holds_reads_news_and_renews(tmp_path: Path) -> None:
    async def scenario(site: Site) -> None:
        credentials = await site.enrolled(tmp_path / "robot")

        async def ask(tls: Credentials | None, method: str, path: str, body: bytes = b"") -> tuple[int, str]:
            connector = aiohttp.TCPConnector(ssl=tls.client if tls is not None else False)
            async with (
                aiohttp.ClientSession(connector=connector) as session,
                session.request(method, site.url + path, data=body) as response,
            ):
                return response.status, await response.text()

        request = msgspec.json.encode({"request": certificates.make_request().certificate.decode()})
        assert (await ask(credentials, "GET", "/news"))[0] == 200
        for method, path, body in (("GET", "/news", b""), ("POST", "/renew", request)):
            status, text = await ask(None, method, path, body)
            assert (status, "enrol with the word of an invitation" in text) == (403, True)
        status, text = await ask(credentials, "POST", "/renew", request)
        assert (status, "less than half of its time is over" in text) == (403, True)
        assert (await ask(credentials, "POST", "/enrol", b"{}"))[0] == 400
        assert (await ask(credentials, "POST", "/enrol", b"x" * 100_000))[0] == 413
        site.authority.revoke("Robot7", datetime.now(UTC))
        for method, path, body in (("GET", "/news", b""), ("POST", "/renew", request)):
            status, text = await ask(credentials, method, path, body)
            assert (status, "is revoked" in text) == (403, True)

    run(tmp_path, scenario)


def test_who_is_revoked_is_refused_by_parts_on_other_computers(tmp_path: Path) -> None:
    async def scenario(site: Site) -> None:
        robot = await site.enrolled(tmp_path / "robot")
        manager = await site.enrolled(tmp_path / "manager", Identity(name="manager", roles=frozenset({Role.TASK_MANAGER})))
        orders: list[Message] = []

        async def take(message: Message) -> Message | None:
            orders.append(message)
            return None

        following = asyncio.create_task(follow(robot, site.url))
        server, wire = Server("127.0.0.1", 0, {"/devices/Robot7": take}, credentials=robot), Wire(manager)
        await server.start()

        def order(number: int) -> Message:
            header = Header(
                sender=f"{server.url}/task-manager",
                recipient=f"{server.url}/devices/Robot7",
                message_id=f"urn:uuid:{number}",
                transaction="urn:t",
                participant="Robot7.Work#s1",
            )
            return Message(header=header, body=frp.Stop(reason="enough"))

        assert await wire.post(order(1)) is None
        site.authority.revoke("manager", datetime.now(UTC))
        number = 2
        while not isinstance(answer := await wire.post(order(number)), Message):
            number += 1
            await asyncio.sleep(0.02)
        assert isinstance(answer.body, frp.Fault)
        assert "the certificate of manager" in answer.body.text
        assert "is revoked" in answer.body.text
        assert len(orders) == number - 1
        following.cancel()
        await wire.close()
        await server.stop()

    run(tmp_path, scenario)


def test_a_certificate_renews_itself(tmp_path: Path) -> None:
    async def scenario(site: Site) -> None:
        robot = await site.enrolled(tmp_path / "robot")
        site.aged(robot, timedelta(days=CERTIFICATE_DAYS * 0.7))
        former, generation = robot.certificate.read_bytes(), robot.generation
        host = Host(credentials=robot)
        await host.start()
        while robot.generation == generation:
            await asyncio.sleep(0.02)
        assert robot.certificate.read_bytes() != former
        assert len([entry for entry in site.authority.read().certificates if entry.name == "Robot7"]) == 3
        Credentials(robot.certificate)
        await host.stop()

    run(tmp_path, scenario)


def test_the_service_renews_its_own_certificate_when_its_disk_has_room_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    site, issue, issued = Site(tmp_path), Authority.issue_program, 0

    def issue_on_full_disk(authority: Authority, identity: Identity, hosts: tuple[str, ...], now: datetime) -> tuple[Path, Path]:
        nonlocal issued
        issued += 1
        if issued == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        return issue(authority, identity, hosts, now)

    async def run() -> None:
        monkeypatch.setattr(trust_service, "OWN_LOOK_PAUSE", 0.02)
        monkeypatch.setattr(Authority, "issue_program", issue_on_full_disk)
        serving = asyncio.create_task(run_trust(site.data, "127.0.0.1", 0))
        while issued < 4:
            await asyncio.sleep(0.02)
        serving.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await serving

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))
    assert "is not renewed: [Errno 28] No space left on device; that is tried again" in caplog.text


def test_a_program_that_ended_while_it_replaced_its_certificate_has_the_key_of_the_one_it_finds(tmp_path: Path) -> None:
    async def scenario(site: Site) -> None:
        robot = await site.enrolled(tmp_path / "robot")
        request = certificates.make_request()
        document = site.authority.issue(ROBOT, request.certificate, ("127.0.0.1",), datetime.now(UTC))
        later_key = robot.certificate.with_suffix(".next.key")
        later_key.write_bytes(request.key)
        Credentials(robot.certificate)
        assert later_key.exists(), "the certificate is still the former one"
        robot.certificate.write_bytes(document)
        Credentials(robot.certificate)
        assert (later_key.exists(), robot.key.read_bytes()) == (False, request.key)

    run(tmp_path, scenario)


def test_what_was_read_last_counts_while_the_authority_cannot_be_reached(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def play() -> None:
        async with asyncio.timeout(HANG_TIME):
            async with office(tmp_path) as site:
                robot = await site.enrolled(tmp_path / "robot")
                site.authority.revoke("Robot7", datetime.now(UTC))
                robot = await site.enrolled(tmp_path / "robot")
                revoked = robot.revoked
                assert len(revoked) == 1
            following = asyncio.create_task(follow(robot, "https://127.0.0.1:1"))
            while not caplog.messages:
                await asyncio.sleep(0.02)
            assert "what it has said last counts" in caplog.messages[0]
            assert robot.revoked == revoked
            following.cancel()

    asyncio.run(play())


def test_news_change_their_version_only_when_there_are_some(tmp_path: Path) -> None:
    async def scenario(site: Site) -> None:
        credentials = await site.enrolled(tmp_path / "robot")
        service = TrustService(site.authority, Credentials(site.authority.folder / "programs" / "trust.pem"))
        version = service._news().version
        assert service._news().version == version
        assert credentials.holders == service._news().holders
        site.authority.revoke("Robot7", datetime.now(UTC))
        assert service._news().version != version

    run(tmp_path, scenario)
