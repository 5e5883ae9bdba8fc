"""Nobody has a component send to a computer that is not the sender's."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable

import aiohttp
import pytest
from msgspec import structs

from somrs.errors import UsageError
from somrs.ontology.services import ServiceType
from somrs.protocol.messages import frp, knowledge
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Offer, Publish
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.people import client_address
from somrs.protocol.soap import soap
from somrs.runtime.batches import MEDIA_TYPE, batch, outcomes_of
from somrs.runtime.bus_format import MSGPACK, decode, encode
from somrs.runtime.http import CONTENT_TYPE, Server
from somrs.runtime.proofs import NO_SOURCE
from somrs.runtime.reception import Reception
from somrs.runtime.reply_hosts import VARIABLE, ReplyHosts

ELSEWHERE = (
    "http://192.0.2.7:80/x",
    "http://169.254.169.254/latest",
    "http://[2001:db8::1]/x",
    "HTTP://192.0.2.7/x",
    "http://user@192.0.2.7:80/",
)
HERE = ("http://127.0.0.1:80/x", "http://[::1]:80/", "http://localhost/x", "http://0.0.0.0:1/x", "http://[::ffff:127.0.0.1]/x")


def header(sender: str = ANONYMOUS, reply_to: str = ANONYMOUS) -> Header:
    return Header(sender=sender, recipient="http://here/part", message_id="urn:uuid:1", reply_to=reply_to)


def publish(address: str) -> Publish:
    offer = Offer(
        service="R.Work",
        provider="R",
        provider_type="Robot",
        address=address,
        service_type=ServiceType(name="Work", effect="a isOn b"),
        attributes={},
    )
    return Publish(provider="R", offers=(offer,), lease=10)


PLACES: dict[str, Callable[[str], tuple[Header, Body]]] = {
    "From": lambda address: (header(sender=address), knowledge.SubscribeMap(lease=10)),
    "ReplyTo": lambda address: (header(reply_to=address), knowledge.ReadMap()),
    "the address of R.Work": lambda address: (header(), publish(address)),
}


@pytest.mark.parametrize("place", PLACES)
def test_addresses_lead_to_the_computer_that_sends(place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    async def check(address: str, peer: str) -> None:
        message_header, body = PLACES[place](address)
        await ReplyHosts().check(Message(header=message_header, body=body), peer)

    async def run() -> None:
        for address in HERE:
            await check(address, "127.0.0.1")
        await check("http://192.0.2.7:1/x", "192.0.2.7")
        await check("http://192.0.2.7:1/x", "::ffff:192.0.2.7")
        for address in (*ELSEWHERE, "http:///x", "http://no-such-host.invalid/x", "http://[::1/x"):
            with pytest.raises(UsageError):
                await check(address, "127.0.0.1")
        for address in HERE:
            with pytest.raises(UsageError, match=f"{place} is .* allow the host where this component runs: {VARIABLE}="):
                await check(address, "192.0.2.7")
        monkeypatch.setenv(VARIABLE, "192.0.2.7 robot.example")
        await check("http://192.0.2.7:1/x", "127.0.0.1")
        await check("http://robot.example:1/x", "127.0.0.1")

    asyncio.run(run())


def test_what_is_no_address_of_a_server_is_no_matter() -> None:
    async def run() -> None:
        for name in (ANONYMOUS, client_address("ada@home"), "urn:uuid:1", "", "http://www.w3.org/2005/08/addressing/anonymous"):
            await ReplyHosts().check(Message(header=header(name, name), body=knowledge.ReadMap()), "192.0.2.7")

    asyncio.run(run())


def test_a_server_refuses_such_messages_alone_and_in_batches() -> None:
    received: list[Message] = []

    async def receive(message: Message) -> Message | None:
        received.append(message)
        return None

    async def run() -> None:
        server = Server("127.0.0.1", 0, {"/part": receive})
        await server.start()
        url = f"{server.url}/part"
        try:
            async with aiohttp.ClientSession() as session:
                good = soap.encode(
                    Message(
                        header=structs.replace(header(f"http://localhost:{server.port}/x"), recipient=url),
                        body=knowledge.SubscribeMap(lease=5),
                    )
                )
                bad = [
                    soap.encode(Message(header=structs.replace(header(reply_to=address), recipient=url), body=knowledge.ReadMap()))
                    for address in ELSEWHERE
                ]
                for document in bad:
                    async with session.post(url, data=document, headers={"Content-Type": CONTENT_TYPE}) as response:
                        assert response.status == 400
                        fault = soap.decode(await response.read()).body
                        assert isinstance(fault, frp.Fault)
                        assert VARIABLE in fault.text
                async with session.post(url, data=batch([good, *bad]), headers={"Content-Type": MEDIA_TYPE}) as response:
                    assert [status for status, _ in outcomes_of(await response.read())] == [202, *[400] * len(bad)]
        finally:
            await server.stop()

    asyncio.run(run())
    assert len(received) == 1


def test_this_computer_has_several_addresses() -> None:
    """A component may listen at one, and reach another component from another."""

    async def run() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.connect(("192.0.2.1", 9))
            except OSError:
                pytest.skip("this computer has no other address")
            own = probe.getsockname()[0]
        await ReplyHosts().check(Message(header=header(f"http://{own}:1/x"), body=knowledge.ReadMap()), "127.0.0.1")

    asyncio.run(run())


@pytest.mark.parametrize("field", ["sender", "recipient", "reply_to"])
def test_an_address_that_cannot_be_read_is_refused_on_a_bus_too(field: str, caplog: pytest.LogCaptureFixture) -> None:
    async def run() -> None:
        plain = Header(sender=ANONYMOUS, recipient="https://127.0.0.1:1/repository", message_id="urn:uuid:1")
        broken = structs.replace(plain, **{field: "https://[127.0.0.1:1/repository"})
        document = encode(Message(header=broken, body=knowledge.ReadMap()))
        [(status, body)] = await Reception(MSGPACK, {}).outcomes([document], NO_SOURCE)
        answer = decode(body)
        assert isinstance(answer.body, frp.Fault)
        assert (status, "https://[127.0.0.1:1/repository is no address" in answer.body.text) == (400, True)

    asyncio.run(run())
    assert caplog.text == ""
