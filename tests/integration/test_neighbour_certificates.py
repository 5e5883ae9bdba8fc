"""Neighbours with authorities of their own: whose certificate counts as whose, and what comes of messages that are not theirs to send."""

from __future__ import annotations

import asyncio
import re
import ssl
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from msgspec import structs

from somrs.errors import RemoteError
from somrs.protocol.messages import directory, frp, knowledge
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, reply
from somrs.protocol.messages.rights import DENIED
from somrs.protocol.messages.submission import Submit
from somrs.protocol.soap import soap
from somrs.runtime.http import Server
from somrs.runtime.wire import Unanswered, Wire
from somrs.trust import certificates
from somrs.trust.authority import Authority
from somrs.trust.certificates import Issued
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity, Role
from somrs.trust.neighbours import TrustedNeighbour

HERE, BARN, YARD = "127.0.0.1", "127.0.0.2", "127.0.0.3"
REPOSITORY, REGISTRY, MANAGER = (f"https://{BARN}:8500/{name}" for name in ("repository", "registry", "task-manager"))
ROBOT = f"https://{BARN}:8600/devices/BarnRobot"
COMPLETED, STOP, READ = frp.Completed(situation=""), frp.Stop(reason="enough"), knowledge.ReadMap()
PAGE = knowledge.MapPage(objects=(), facts=(), version=1, more=False)

Scenario = Callable[["Place"], Awaitable[None]]


class Place:
    """A program of the own site that takes every message, and two neighbours, the barn and the yard. `is_lax`: the authority of the barn
    allows others below it."""

    def __init__(self, folder: Path, role: Role, *, is_lax: bool = False) -> None:
        self.authorities = {}
        for host, name in ((HERE, "Here"), (BARN, "Barn"), (YARD, "Yard")):
            authority = self.authorities[host] = Authority.of_data(folder / name)
            authority.create("site", datetime.now(UTC))
        self.authority = self.authorities[HERE]
        if is_lax:
            make_lax(self.authorities[BARN])
        self.trust(self.neighbour("Barn", BARN), self.neighbour("Yard", YARD))
        self.taken: list[Message] = []
        self.credentials = self.enrolled(HERE, "part", role)
        self.server = Server(HERE, 0, {"/part": self._take}, credentials=self.credentials)

    def neighbour(self, name: str, host: str) -> TrustedNeighbour:
        return TrustedNeighbour(
            name=name,
            authority=self.authorities[host].public_certificate,
            registries=(f"https://{host}:8500/registry",),
            repository=f"https://{host}:8500/repository",
        )

    def trust(self, *neighbours: TrustedNeighbour) -> None:
        self.authority.trust_neighbours(neighbours, (HERE,))

    def enrolled(self, host: str, name: str, *roles: Role, speaks_for: tuple[str, ...] = ()) -> Credentials:
        """A program of the site at a host. It accepts the own site's as a neighbour."""
        identity = Identity(name=name, roles=frozenset(roles), speaks_for=frozenset(speaks_for))
        authority = self.authorities[host]
        if host != HERE:
            here = TrustedNeighbour(name="Here", authority=self.authority.public_certificate, hosts=(HERE,))
            authority.trust_neighbours((here,), (host,))
        return Credentials(authority.issue_program(identity, (host,), datetime.now(UTC))[0])

    async def _take(self, message: Message) -> Message | None:
        self.taken.append(message)
        return None

    async def send(
        self, credentials: Credentials, body: Body, sender: str, reply_to: str = "", participant: str = "Barn:BarnRobot.Work#s1"
    ) -> str:
        """Send a message. Returns why it was denied; empty if it was taken."""
        wire = Wire(credentials)
        header = Header(
            sender=sender,
            recipient=f"{self.server.url}/part",
            message_id="urn:uuid:1",
            reply_to=reply_to or sender,
            transaction="urn:t",
            participant=participant,
        )
        try:
            answer = await wire.post(Message(header=header, body=body))
        finally:
            await wire.close()
        if answer is None:
            return ""
        assert isinstance(answer.body, frp.Fault)
        assert answer.body.code == DENIED
        return answer.body.text


def run(folder: Path, role: Role, scenario: Scenario, *, is_lax: bool = False) -> None:
    async def play() -> None:
        place = Place(folder, role, is_lax=is_lax)
        await place.server.start()
        try:
            await scenario(place)
        finally:
            await place.server.stop()

    asyncio.run(play())


@pytest.mark.parametrize(
    ("recipient", "name", "role", "body", "sender"),
    [
        (Role.REPOSITORY, "repository", Role.REPOSITORY, READ, REPOSITORY),
        (Role.REGISTRY, "registry", Role.REGISTRY, directory.Discover(), REGISTRY),
        (Role.DEVICE, "task-manager", Role.TASK_MANAGER, STOP, MANAGER),
        (Role.TASK_MANAGER, "BarnRobot", Role.DEVICE, COMPLETED, ROBOT),
        (Role.TASK_MANAGER, "BarnRobot", Role.DEVICE, COMPLETED, f"https://{BARN}:9000/a/robot/of/another/make"),
    ],
)
def test_a_neighbour_s_program_is_heard(tmp_path: Path, recipient: Role, name: str, role: Role, body: Body, sender: str) -> None:
    async def scenario(place: Place) -> None:
        assert await place.send(place.enrolled(BARN, name, role), body, sender) == ""
        assert [message.body for message in place.taken] == [body]

    run(tmp_path, recipient, scenario)


def own(address: str) -> str:
    return address.replace(BARN, HERE)


@pytest.mark.parametrize(
    ("recipient", "host", "name", "role", "body", "sender", "reply_to", "text"),
    [
        # A neighbour as another neighbour, or as an own program.
        (Role.REPOSITORY, YARD, "repository", Role.REPOSITORY, READ, REPOSITORY, "", "Yard:repository may not name https://127.0.0.2"),
        (Role.DEVICE, YARD, "task-manager", Role.TASK_MANAGER, STOP, MANAGER, "", "Yard:task-manager may not name https://127.0.0.2"),
        (Role.DEVICE, BARN, "task-manager", Role.TASK_MANAGER, STOP, own(MANAGER), "", "Barn:task-manager may not name https://127.0.0.1"),
        (Role.TASK_MANAGER, BARN, "BarnRobot", Role.DEVICE, COMPLETED, own(ROBOT), "", "may not name https://127.0.0.1"),
        (Role.TASK_MANAGER, BARN, "BarnRobot", Role.DEVICE, COMPLETED, ROBOT, own(ROBOT), "as ReplyTo"),
        (Role.DEVICE, BARN, "task-manager", Role.TASK_MANAGER, STOP, ROBOT, "", "it needs a certificate with which it can listen there"),
        # An own program as a neighbour's.
        (Role.REPOSITORY, HERE, "repository", Role.REPOSITORY, READ, REPOSITORY, "", "at the host of a neighbour"),
        # A neighbour's Repository or Registry at an address that is not in the file would be taken for a program of this system.
        (Role.REPOSITORY, BARN, "repository", Role.REPOSITORY, READ, f"https://{BARN}:1/repository", "", "has another address for Barn"),
        (Role.REPOSITORY, BARN, "repository", Role.REPOSITORY, READ, f"https://{BARN}:1/else", "", "has another address for Barn"),
        (Role.REGISTRY, BARN, "registry", Role.REGISTRY, directory.Discover(), f"{REGISTRY}-2", "", "has another address for Barn"),
        (Role.REPOSITORY, BARN, "simulator", Role.TRAFFIC, READ, f"https://{BARN}:1/simulator", "", "add `simulates: true` to Barn there"),
        (Role.REPOSITORY, BARN, "simulator", Role.TRAFFIC, READ, f"https://{BARN}:1/else", "", "has another address for Barn"),
        # What is not for a neighbour to send.
        (Role.TASK_MANAGER, BARN, "client", Role.CLIENT, Submit(effect="A isOn B"), ROBOT, "", "Barn:client (client) may not send Submit"),
        (Role.TASK_MANAGER, BARN, "BarnRobot", Role.DEVICE, Submit(effect="A isOn B"), ROBOT, "", "it passes not at all"),
        (Role.REPOSITORY, BARN, "api", Role.API, knowledge.UpdateMap(), ROBOT, "", "from a repository to a repository"),
        (Role.REPOSITORY, BARN, "task-manager", Role.TASK_MANAGER, knowledge.UpdateMap(), MANAGER, "", "may not send UpdateMap"),
        (Role.REPOSITORY, BARN, "api", Role.API, knowledge.Define(), ROBOT, "", "may not send Define"),
        (Role.REGISTRY, BARN, "Robot1", Role.DEVICE, directory.Retract(provider="Robot1"), ROBOT, "", "may not send Retract"),
        (Role.TASK_MANAGER, BARN, "repository", Role.REPOSITORY, PAGE, REPOSITORY, "", "may not send MapPage"),
        # A device as another one.
        (Role.TASK_MANAGER, BARN, "OtherRobot", Role.DEVICE, COMPLETED, ROBOT, "", "may not speak for Barn:BarnRobot"),
    ],
)
def test_what_is_not_for_it_is_denied(
    tmp_path: Path, recipient: Role, host: str, name: str, role: Role, body: Body, sender: str, reply_to: str, text: str
) -> None:
    async def scenario(place: Place) -> None:
        assert text in await place.send(place.enrolled(host, name, role), body, sender, reply_to)
        assert place.taken == []

    run(tmp_path, recipient, scenario)


@pytest.mark.parametrize("participant", ["Robot1.Work#s1", "Yard:BarnRobot.Work#s1"])
def test_a_neighbour_s_device_is_no_own_one_and_none_of_another_neighbour(tmp_path: Path, participant: str) -> None:
    async def scenario(place: Place) -> None:
        barn_robot = place.enrolled(BARN, "BarnRobot", Role.DEVICE, speaks_for=("Helper",))
        assert "may not speak for" in await place.send(barn_robot, COMPLETED, ROBOT, participant=participant)
        assert await place.send(barn_robot, COMPLETED, ROBOT, participant="Barn:Helper.Work#s1") == ""
        # It may have the name of an own one; the Task Manager then knows by the address that the contract is not with it.
        same_name = place.enrolled(BARN, "Robot1", Role.DEVICE)
        text = await place.send(same_name, COMPLETED, own(ROBOT).replace("BarnRobot", "Robot1"), participant="Robot1.Work#s1")
        assert "may not name https://127.0.0.1" in text

    run(tmp_path, Role.TASK_MANAGER, scenario)


def test_a_neighbour_s_simulator_reads_the_map_if_its_owner_says_so(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        place.trust(structs.replace(place.neighbour("Barn", BARN), simulates=True))
        simulator, repository = place.enrolled(BARN, "simulator", Role.TRAFFIC), place.enrolled(BARN, "repository", Role.REPOSITORY)
        address = f"https://{BARN}:1/simulator"
        assert await place.send(simulator, READ, address) == ""
        assert "has another address for Barn" in await place.send(repository, READ, address)
        assert "may not send UpdateMap" in await place.send(simulator, knowledge.UpdateMap(), address)

    run(tmp_path, Role.REPOSITORY, scenario)


def test_offers_of_a_neighbour_are_at_its_hosts(tmp_path: Path) -> None:
    from somrs.ontology.services import ServiceType

    work = ServiceType(name="Work", effect="A isOn B")
    offer = directory.Offer(service="R.Work", provider="R", provider_type="Robot", address=ROBOT, service_type=work)

    async def scenario(place: Place) -> None:
        registry = place.enrolled(BARN, "registry", Role.REGISTRY)
        assert await place.send(registry, directory.Discovered(offers=(offer,)), REGISTRY) == ""
        text = await place.send(registry, directory.Discovered(offers=(structs.replace(offer, address=own(ROBOT)),)), REGISTRY)
        assert f"Barn:registry may not name {own(ROBOT)} as the address of R.Work: add its host to `hosts` of Barn" in text

    run(tmp_path, Role.REGISTRY, scenario)


def test_the_file_of_neighbours_may_change_while_programs_run(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        place.trust(place.neighbour("Yard", YARD))
        repository = place.enrolled(BARN, "repository", Role.REPOSITORY)
        assert "neither of the authority of this site nor of that of a neighbour" in await place.send(repository, READ, REPOSITORY)
        place.trust(place.neighbour("Yard", YARD), place.neighbour("Barn", BARN))
        assert await place.send(repository, READ, REPOSITORY) == ""
        # The barn has made its authority anew.
        old_authority, folder = place.authorities[BARN], tmp_path / "new"
        place.authorities[BARN] = Authority.of_data(folder)
        place.authorities[BARN].create("site", datetime.now(UTC))
        place.trust(place.neighbour("Barn", BARN))
        assert "neither of the authority" in await place.send(repository, READ, REPOSITORY)
        place.authorities[BARN] = old_authority

    run(tmp_path, Role.REPOSITORY, scenario)


def test_an_authority_that_nobody_has_given_is_refused(tmp_path: Path) -> None:
    async def scenario(place: Place) -> None:
        stranger = Authority.of_data(tmp_path / "stranger")
        stranger.create("site", datetime.now(UTC))
        repository = place.enrolled(BARN, "repository", Role.REPOSITORY)
        files = stranger.issue_program(repository.identity, (BARN,), datetime.now(UTC))
        (stranger.folder / "neighbours.json").write_bytes((place.authorities[BARN].folder / "neighbours.json").read_bytes())
        with pytest.raises(Unanswered, match="cannot be reached"):
            await place.send(Credentials(files[0]), READ, REPOSITORY)

    run(tmp_path, Role.REPOSITORY, scenario)


def issue_below_intermediate(authority: Authority, own_authority: Authority, identity: Identity) -> tuple[bytes, bytes]:
    """A certificate and its key, issued by an authority in between that has the name of another site's, with its chain."""
    key = ec.generate_private_key(ec.SECP256R1())
    now, name = datetime.now(UTC), certificates.load(own_authority.certificate_file.read_bytes(), "").subject
    issuer = certificates.load(authority.certificate_file.read_bytes(), "")
    builder = certificates._builder(name, issuer.subject, key.public_key(), now, timedelta(days=1), x509.random_serial_number())
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
    signing_key = certificates._private_key((authority.folder / "authority.key").read_bytes())
    builder = builder.add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signing_key.public_key()), critical=False)
    between = builder.sign(signing_key, hashes.SHA256())
    request = certificates.make_request()
    signer = Issued(certificate=certificates.pem(between), key=certificates.key_pem(key))
    issued = certificates.issue(signer, request.certificate, identity, (BARN,), now, timedelta(days=1))
    return certificates.pem(issued) + certificates.pem(between), request.key


def make_lax(authority: Authority) -> None:
    """Make the certificate of an authority one that allows authorities below it."""
    now, key = datetime.now(UTC), certificates._private_key((authority.folder / "authority.key").read_bytes())
    subject = certificates.load(authority.certificate_file.read_bytes(), "").subject
    builder = certificates._builder(subject, subject, key.public_key(), now, timedelta(days=9), x509.random_serial_number())
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
    authority.certificate_file.write_bytes(certificates.pem(builder.sign(key, hashes.SHA256())))


def test_who_has_signed_decides_and_no_name_of_an_issuer(tmp_path: Path) -> None:
    """The barn has an authority below its own, which has the name of the authority here."""

    async def scenario(place: Place) -> None:
        repository = place.enrolled(BARN, "repository", Role.REPOSITORY)
        client = Identity(name="client", roles=frozenset({Role.CLIENT}))
        chain, key = issue_below_intermediate(place.authorities[BARN], place.authority, client)
        repository.certificate.write_bytes(chain)
        repository.key.write_bytes(key)
        text = await place.send(Credentials(repository.certificate), Submit(effect="A isOn B"), "anna@home")
        assert "Barn:client (client) may not send Submit" in text

    run(tmp_path, Role.TASK_MANAGER, scenario, is_lax=True)


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_a_session_that_is_resumed_is_of_the_same_site(tmp_path: Path, version: ssl.TLSVersion) -> None:
    async def scenario(place: Place) -> None:
        credentials = place.enrolled(BARN, "client", Role.CLIENT)
        context = credentials.client_for(place.server.url)
        context.maximum_version = version
        header = Header(sender=ROBOT, recipient=f"{place.server.url}/part", message_id="urn:uuid:1", reply_to=ROBOT)
        document = soap.encode(Message(header=header, body=Submit(effect="A isOn B")))
        head = f"POST /part HTTP/1.1\r\nHost: h\r\nContent-Type: application/soap+xml\r\nContent-Length: {len(document)}\r\n\r\n"

        def post(session: ssl.SSLSession | None) -> tuple[bytes, ssl.SSLSession | None, bool | None]:
            import socket

            plain = socket.create_connection((HERE, place.server.port))
            with context.wrap_socket(plain, server_hostname=HERE, session=session) as connection:
                connection.sendall(head.encode() + document)
                content = b""
                while b"Envelope>" not in content:
                    content += connection.recv(65_536)
                return content, connection.session, connection.session_reused

        first, session, _ = await asyncio.to_thread(post, None)
        second, _, is_resumed = await asyncio.to_thread(post, session)
        assert is_resumed
        assert b"Barn:client (client) may not send Submit" in first
        assert b"Barn:client (client) may not send Submit" in second

    run(tmp_path, Role.TASK_MANAGER, scenario)


@pytest.mark.parametrize("impostor", [HERE, YARD])
def test_only_a_neighbour_s_program_answers_at_its_address(tmp_path: Path, impostor: str) -> None:
    """Its certificate is for the host of the barn, but not of the barn's authority."""

    async def scenario(place: Place) -> None:
        authority = place.authorities[impostor]
        files = authority.issue_program(Identity(name="posing", roles=frozenset({Role.REPOSITORY})), (BARN,), datetime.now(UTC))
        server = Server(BARN, 0, {"/repository": place._take}, credentials=Credentials(files[0]))
        await server.start()
        wire = Wire(place.credentials)
        header = Header(sender=f"{place.server.url}/repository", recipient=f"{server.url}/repository", message_id="urn:uuid:1")
        try:
            with pytest.raises(Unanswered, match="cannot be reached"):
                await wire.post(Message(header=header, body=READ))
        finally:
            await wire.close()
            await server.stop()
        assert place.taken == []

    run(tmp_path, Role.REPOSITORY, scenario)


@pytest.mark.parametrize(
    ("body", "sender", "problem"),
    [
        (PAGE, "", None),
        (knowledge.Rejected(problems=("no",)), "", None),
        (Submit(effect="A isOn B"), "", "Barn:repository (repository) may not send Submit"),
        (PAGE, "https://127.0.0.1:8500/repository", "answered in the name of https://127.0.0.1:8500/repository"),
    ],
)
def test_answers_of_a_neighbour_are_its_own(tmp_path: Path, body: Body, sender: str, problem: str | None) -> None:
    async def scenario(place: Place) -> None:
        async def answer(message: Message) -> Message:
            return reply(message, body, sender or message.header.recipient)

        server = Server(BARN, 0, {"/repository": answer}, credentials=place.enrolled(BARN, "repository", Role.REPOSITORY))
        await server.start()
        wire = Wire(place.credentials)
        address = f"https://{BARN}:{server.port}/repository"
        place.trust(structs.replace(place.neighbour("Barn", BARN), repository=address))
        here = TrustedNeighbour(name="Here", authority=place.authority.public_certificate, repository=f"https://{HERE}:1/repository")
        place.authorities[BARN].trust_neighbours((here,), (BARN,))
        header = Header(sender=f"https://{HERE}:1/repository", recipient=address, message_id="urn:uuid:1")
        try:
            for _ in range(2):  # the second time as a batch, which the first answer has allowed
                if problem is None:
                    answered = await wire.post(Message(header=header, body=READ))
                    assert answered is not None
                    assert answered.body == body
                    continue
                with pytest.raises(RemoteError, match=re.escape(problem)):
                    await wire.post(Message(header=header, body=READ))
                batch = [Message(header=header, body=READ)] * 2
                for outcome in await wire.post_batch(batch, 5.0):
                    assert isinstance(outcome, RemoteError)
                    assert problem in str(outcome)
        finally:
            await wire.close()
            await server.stop()

    run(tmp_path, Role.REPOSITORY, scenario)
