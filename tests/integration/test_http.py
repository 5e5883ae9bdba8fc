"""The server and the wire over real sockets: what is not a message gets the right answer, and the server goes on serving."""

from __future__ import annotations

import asyncio
import gzip
from collections.abc import AsyncIterator, Awaitable, Callable
from email.utils import parsedate_to_datetime

import aiohttp
import httpx
import pytest
import uvicorn
from msgspec import structs
from starlette.responses import PlainTextResponse
from starlette.types import Receive, Scope, Send

from somrs.errors import RemoteError, UsageError
from somrs.limits import Limits
from somrs.ports import listen_at
from somrs.protocol.messages import directory, frp, knowledge
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id, reply
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES
from somrs.runtime import bounded_http
from somrs.runtime.bounded_http import QuietServer
from somrs.runtime.http import Server
from somrs.runtime.reception import Handler
from somrs.runtime.wire import NONE_ADDRESS, Unanswered, Wire, retry_unanswered
from tests.support.hang import HANG_TIME

TYPE = {"Content-Type": "application/soap+xml; charset=utf-8"}
QUERY = knowledge.QueryMap(formula="Jar1 isOn ?Place")

Scenario = Callable[[Server, aiohttp.ClientSession], Awaitable[None]]


def query(recipient: str) -> Message:
    return Message(header=Header(sender=ANONYMOUS, recipient=recipient, message_id=message_id("q")), body=QUERY)


def session_message(recipient: str) -> Message:
    """A Query of the Failure Recovery Protocol, which is not answered in these tests."""
    return Message(header=structs.replace(query(recipient).header, transaction=message_id("t"), participant="p"), body=frp.Query())


async def answer(message: Message) -> Message | None:
    """A component as the server sees it: one that answers, refuses, is broken, cannot be reached, or just takes messages."""
    match message.body:
        case knowledge.QueryMap():
            return reply(message, knowledge.Rows(rows=(), version=7), "http://here")
        case knowledge.UpdateMap():
            return reply(message, knowledge.Rejected(problems=("no",)), "http://here")
        case knowledge.ReadHistory(object=code):
            return reply(message, frp.Fault(code=code, text="no"), "http://here")
        case knowledge.Define():
            return reply(message, knowledge.History(object="\x00", events=()), "http://here")
        case knowledge.ReadMap():
            raise ZeroDivisionError
        case knowledge.ReadOntology():
            raise RemoteError("too busy")
        case directory.Discover():
            raise UsageError("look again")
        case frp.Query():
            await asyncio.sleep(3600)
            return None
        case _:
            return None


def run_scenario(scenario: Scenario) -> None:
    """Run the scenario against a server, which still answers a query afterwards."""

    async def run() -> None:
        server, wire = Server("127.0.0.1", 0, {"/repository": answer}, bounds=Limits(request_seconds=1)), Wire()
        await server.start()
        try:
            async with aiohttp.ClientSession() as session:
                # Nothing that comes may hang the server. A scenario takes under a second; a busy machine may take its time.
                async with asyncio.timeout(HANG_TIME):
                    await scenario(server, session)
            reply_message = await wire.post(query(f"{server.url}/repository"))
            assert reply_message is not None
            assert reply_message.body == knowledge.Rows(rows=(), version=7)
        finally:
            await wire.close()
            await server.stop()

    asyncio.run(run())


def document(server: Server) -> str:
    return soap.encode(query(f"{server.url}/repository")).decode()


FAULTS: dict[str, tuple[Callable[[str], bytes], int, str]] = {
    "document type": (lambda text: text.replace("<env:Env", "<!DOCTYPE a []><env:Env", 1).encode(), 400, "env:Sender"),
    "billion laughs": (lambda text: b'<!DOCTYPE a [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><a>&b;</a>', 400, "env:Sender"),
    "external entity": (lambda text: b'<!DOCTYPE a [<!ENTITY a SYSTEM "file:///etc/hostname">]><a>&a;</a>', 400, "env:Sender"),
    "nesting": (lambda text: b"<a>" * 60_000, 400, "env:Sender"),
    "no XML": (lambda text: b"\x00\xff", 400, "env:Sender"),
    "nothing": (lambda text: b"", 400, "env:Sender"),
    "repeated": (lambda text: text.replace("</env:Header>", "<wsa:To>x</wsa:To></env:Header>").encode(), 400, "wsa:InvalidCardinality"),
    "must understand": (
        lambda text: text.replace("</env:Header>", '<x xmlns="urn:x" env:mustUnderstand="1"/></env:Header>').encode(),
        500,
        "env:MustUnderstand",
    ),
    "SOAP 1.1": (lambda text: text.replace(soap.ENV, "http://schemas.xmlsoap.org/soap/envelope/").encode(), 500, "env:VersionMismatch"),
    "unknown body": (lambda text: text.replace("m:QueryMap", "m:QuietMap").encode(), 400, "wsa:ActionNotSupported"),
    "no message id": (lambda text: text.replace("wsa:MessageID", "wsa:X").encode(), 400, "wsa:MessageAddressingHeaderRequired"),
    "no action": (lambda text: text.replace("wsa:Action", "wsa:X").encode(), 400, "wsa:MessageAddressingHeaderRequired"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_what_is_no_message_gets_a_fault(case: str) -> None:
    mutate, status, code = FAULTS[case]

    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        async with session.post(f"{server.url}/repository", data=mutate(document(server)), headers=TYPE) as response:
            assert response.status == status
            assert response.content_type == soap.MEDIA_TYPE
            body = soap.decode(await response.read()).body
            assert isinstance(body, frp.Fault)
            assert body.code == code
            assert body.text

    run_scenario(scenario)


@pytest.mark.parametrize(
    ("headers", "path", "status"),
    [
        ({"Content-Type": "text/xml"}, "/repository", 415),
        ({"Content-Type": "application/json"}, "/repository", 415),
        ({"Content-Type": "application/soap+xml; charset=latin-1"}, "/repository", 415),
        ({**TYPE, "Content-Encoding": "deflate"}, "/repository", 415),
        (TYPE, "/", 404),
        (TYPE, "/registry", 404),
        (TYPE, "/repository/../../etc", 404),
        ({"Content-Type": 'application/soap+xml;charset="UTF-8";action="urn:x"'}, "/repository", 200),
        ({"Content-Type": "APPLICATION/SOAP+XML", "Content-Encoding": "identity"}, "/repository", 200),
    ],
)
def test_paths_and_headers(headers: dict[str, str], path: str, status: int) -> None:
    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        async with session.post(f"{server.url}{path}", data=document(server).encode(), headers=headers) as response:
            assert response.status == status

    run_scenario(scenario)


def test_compression_and_other_methods() -> None:
    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        url, bomb = f"{server.url}/repository", gzip.compress(b"<a>" + b" " * 10_000_000)
        async with session.post(url, data=bomb, headers={**TYPE, "Content-Encoding": "gzip"}) as response:
            assert response.status == 415
        async with session.post(url, data=bomb, headers=TYPE) as response:
            assert response.status == 400
        async with session.put(url, data=b"x", headers=TYPE) as response:
            assert response.status == 405

    run_scenario(scenario)


def test_a_body_that_is_too_large_or_never_ends() -> None:
    async def endless() -> AsyncIterator[bytes]:
        while True:
            yield b" " * 16_384

    async def stalled() -> AsyncIterator[bytes]:
        yield b"<a>"
        await asyncio.sleep(10)

    async def drops(server: Server) -> None:
        _, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"POST /repository HTTP/1.1\r\nHost: x\r\nContent-Type: application/soap+xml\r\nContent-Length: 9\r\n\r\n<")
        await writer.drain()
        writer.close()

    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        url = f"{server.url}/repository"
        async with session.post(url, data=b" " * (MOST_BYTES + 1), headers=TYPE) as response:
            assert response.status == 413
        for body, status in ((endless, 413), (stalled, 408)):
            async with session.post(url, data=body(), headers=TYPE) as response:
                assert response.status == status
        await drops(server)

    run_scenario(scenario)


def test_a_body_that_says_it_is_too_large_is_not_waited_for() -> None:
    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        for length in ("300000", "9" * 30, "1" + "0" * 5000):
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            head = f"POST /repository HTTP/1.1\r\nHost: x\r\nContent-Type: application/soap+xml\r\nContent-Length: {length}\r\n\r\n"
            writer.write(head.encode())
            assert b" 413 " in await reader.readline() or len(length) > 20, "a parser of HTTP may refuse such a number itself"
            writer.close()

    run_scenario(scenario)


def test_stopping_while_requests_are_open(caplog: pytest.LogCaptureFixture) -> None:
    async def run() -> bytes:
        server, wire = Server("127.0.0.1", 0, {"/repository": answer}), Wire()
        await server.start()
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"POST /repository HTTP/1.1\r\nHost: x\r\nContent-Type: application/soap+xml\r\nContent-Length: 99\r\n\r\n<")
        waiting = asyncio.create_task(wire.post(session_message(f"{server.url}/repository"), timeout=HANG_TIME))
        while server.open_count < 2:
            await asyncio.sleep(0.01)
        async with asyncio.timeout(HANG_TIME):
            await server.stop()
            with pytest.raises(Unanswered, match="does not answer now: this component is stopping"):
                await waiting
            status = await reader.readline()
        writer.close()
        await wire.close()
        return status

    assert b" 503 " in asyncio.run(run()), "nobody took this message: it is to be sent again"
    assert not caplog.records


def test_a_server_with_nothing_to_do_sleeps_and_ends_when_it_is_told_to(monkeypatch: pytest.MonkeyPatch) -> None:
    class CountingServer(QuietServer):
        wakes = 0

        async def on_tick(self, counter: int) -> bool:
            self.wakes += 1
            return await super().on_tick(counter)

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await PlainTextResponse("here")(scope, receive, send)

    async def run() -> None:
        listener = listen_at("127.0.0.1", 0)
        server = CountingServer(uvicorn.Config(app, lifespan="off", log_level="warning"))
        serving = asyncio.create_task(server.serve(sockets=[listener]))
        while not server.started:
            await asyncio.sleep(0.01)
        async with asyncio.timeout(HANG_TIME), aiohttp.ClientSession() as session:
            response = await session.get(f"http://127.0.0.1:{listener.getsockname()[1]}/")
            assert await response.text() == "here"
            assert parsedate_to_datetime(response.headers["Date"])
            await asyncio.sleep(0.3)
            assert server.wakes == 1, "when it began"
            server.end()
            await serving

    monkeypatch.setattr(bounded_http, "DATE_TIME", HANG_TIME)
    asyncio.run(run())


def test_many_at_once_beside_one_that_stalls() -> None:
    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"POST /repository HTTP/1.1\r\nHost: x\r\nContent-Type: application/soap+xml\r\nTransfer-Encoding: chunked\r\n\r\n")
        wire = Wire()
        answers = await asyncio.gather(*(wire.post(query(f"{server.url}/repository")) for _ in range(50)))
        assert all(answers)
        await wire.close()
        assert b" 408 " in await reader.readline()
        writer.close()

    run_scenario(scenario)


def test_the_wire_brings_answers_refusals_and_faults() -> None:
    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        wire, header = Wire(), query(f"{server.url}/repository").header

        async def body(request_body: object) -> object:
            reply_message = await wire.post(Message(header=header, body=request_body))  # type: ignore[arg-type]
            assert reply_message is None or reply_message.header.relates_to == header.message_id
            return reply_message and reply_message.body

        assert await body(QUERY) == knowledge.Rows(rows=(), version=7)
        assert await body(knowledge.UpdateMap()) == knowledge.Rejected(problems=("no",))
        assert await body(knowledge.SubscribeMap(lease=1)) is None
        assert await body(knowledge.ReadHistory(object="Sender")) == frp.Fault(code="env:Sender", text="no")
        assert await body(knowledge.ReadOntology()) == frp.Fault(code="env:Receiver", text="too busy")
        unsendable = await body(knowledge.Define(definitions=knowledge.Definitions()))
        assert isinstance(unsendable, frp.Fault)
        assert unsendable.code == "env:Receiver", "it is not the sender's fault"
        assert await body(directory.Discover()) == frp.Fault(code="env:Sender", text="look again"), "who asked can mend it"
        assert await body(knowledge.ReadMap()) == frp.Fault(
            code="env:Receiver", text="an internal error occurred; see the log of this program"
        )
        await wire.close()

    run_scenario(scenario)


@pytest.mark.parametrize(
    ("request_body", "status"),
    [
        (QUERY, 200),
        (knowledge.UpdateMap(), 400),
        (knowledge.SubscribeMap(lease=1), 202),
        (knowledge.ReadHistory(object="env:Sender"), 400),
        (knowledge.ReadHistory(object="frp:NotAllowed"), 400),
        (knowledge.ReadHistory(object="env:Receiver"), 500),
        (directory.Discover(), 400),
        (knowledge.Define(definitions=knowledge.Definitions()), 500),
        (knowledge.ReadMap(), 500),
    ],
)
def test_the_status_of_answers(request_body: Body, status: int) -> None:
    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        url = f"{server.url}/repository"
        message = Message(header=query(url).header, body=request_body)
        async with session.post(url, data=soap.encode(message), headers=TYPE) as response:
            assert response.status == status

    run_scenario(scenario)


def test_what_cannot_be_reached_or_is_no_component() -> None:
    async def babble(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"HTTP/1.1 307 Go\r\nLocation: /elsewhere\r\nContent-Length: 0\r\n\r\n")
        await writer.drain()

    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        wire = Wire()
        strange = await asyncio.start_server(babble, "127.0.0.1", 0)
        port = strange.sockets[0].getsockname()[1]
        for address, message_pattern in {
            f"{server.url}/nothing": "HTTP 404: there is no component at /nothing",
            "http://127.0.0.1:9/x": "cannot be reached",
            "http://[": "cannot be reached",
            "ftp://x": "cannot be reached",
            ANONYMOUS[:4]: "cannot be reached",
            ANONYMOUS: "no connection waits for this QueryMap",
            f"http://127.0.0.1:{port}/": "HTTP 307",
        }.items():
            with pytest.raises(RemoteError, match=message_pattern):
                await wire.post(query(address))
        with pytest.raises(RemoteError, match="QueryMap cannot be sent"):
            await wire.post(Message(header=query(server.url).header, body=knowledge.QueryMap(formula="\x00")))
        assert await wire.post(query(NONE_ADDRESS)) is None, "what is sent there is thrown away"
        with pytest.raises(RemoteError, match=r"did not answer within 0\.2 s"):
            await wire.post(session_message(f"{server.url}/repository"), timeout=0.2)
        strange.close()
        await wire.close()

    run_scenario(scenario)


@pytest.mark.parametrize("status", [200, 201, 202, 204, 299])
@pytest.mark.parametrize(
    "page",
    [
        b"",
        b"Content-Type: text/html|<p>Thank you!</p>",
        b"Content-Type: text/xml|<ok/>",
        b'Content-Type: application/soap+xml|<e:Envelope xmlns:e="http://www.w3.org/2003/05/soap-envelope"><e:Body/></e:Envelope>',
    ],
    ids=["nothing", "page", "XML", "empty envelope"],
)
def test_any_success_says_that_a_message_was_delivered(status: int, page: bytes) -> None:
    head, _, content = page.partition(b"|")
    content = b"" if status == 204 else content

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        lines = [
            b"HTTP/1.1 %d Yes" % status,
            b"Content-Length: %d" % len(content),
            b"Connection: close",
            *filter(None, [head]),
            b"",
            content,
        ]
        writer.write(b"\r\n".join(lines))
        await writer.drain()
        writer.close()

    async def play() -> None:
        foreign = await asyncio.start_server(accept, "127.0.0.1", 0)
        wire, address = Wire(), f"http://127.0.0.1:{foreign.sockets[0].getsockname()[1]}/robot"
        asked = query(address)
        elsewhere = Message(header=structs.replace(asked.header, sender="http://here/", reply_to="http://here/"), body=QUERY)
        report = Message(header=session_message(address).header, body=frp.End(outcome=frp.Outcome.CANCELLED))
        assert [await wire.post(elsewhere), await wire.post(report)] == [None, None]
        if status != 202:
            with pytest.raises(RemoteError, match=f"HTTP {status}|sent an answer that cannot be read"):
                await wire.post(asked)
        foreign.close()
        await wire.close()

    asyncio.run(play())


def test_a_port_that_is_taken() -> None:
    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        with pytest.raises(UsageError, match=f"cannot listen at 127.0.0.1:{server.port}"):
            await Server("127.0.0.1", server.port, {}).start()

    run_scenario(scenario)


def test_who_comes_while_a_process_starts_comes_again() -> None:
    """Between listening and the first part, which is read from its journal, somebody who knows the address may be there already."""

    async def play() -> None:
        parts: dict[str, Handler] = {}
        server, wire = Server("127.0.0.1", 0, parts), Wire()
        await server.start()
        try:
            message_pattern = "HTTP 503: no component is available yet; this process is starting"
            with pytest.raises(Unanswered, match=message_pattern):
                await wire.post(query(f"{server.url}/repository"))
            with pytest.raises(Unanswered, match=message_pattern):
                await wire.post_batch([query(f"{server.url}/repository")] * 2, 30)
            async with httpx.AsyncClient() as plain_client:
                headers = {"Content-Type": "application/soap+xml"}
                refused = await plain_client.post(f"{server.url}/repository", content=b"<x/>", headers=headers)
            assert (refused.status_code, refused.headers["content-type"].partition(";")[0]) == (503, "application/soap+xml")
            fault = soap.decode(refused.content).body
            assert fault == frp.Fault(code="env:Receiver", text="no component is available yet; this process is starting")
            pending_reply = asyncio.create_task(retry_unanswered(lambda: wire.post(query(f"{server.url}/repository")), 60))
            await asyncio.sleep(0.05)
            assert not pending_reply.done()
            parts["/repository"] = answer
            reply_message = await pending_reply
            assert reply_message is not None
            assert reply_message.body == knowledge.Rows(rows=(), version=7)
        finally:
            await wire.close()
            await server.stop()

    asyncio.run(play())


def test_pages_and_descriptions() -> None:
    async def scenario(server: Server, session: aiohttp.ClientSession) -> None:
        async def page(path: str) -> tuple[int, str]:
            async with session.get(f"{server.url}{path}", headers={"Host": "evil.example"}) as response:
                return response.status, await response.text()

        assert await page("/repository") == (200, "a SOAP 1.2 endpoint of SO-MRS; its description is at /repository?wsdl\n")
        status, wsdl = await page("/repository?wsdl")
        assert (status, f'location="{server.url}/repository"' in wsdl) == (200, True), "not where whoever asks says that it is"
        assert "evil.example" not in wsdl
        assert (await page("/repository?xsd=knowledge"))[0] == 200
        assert (await page("/repository?xsd=../x"))[0] == 404
        assert (await page("/nothing?wsdl")) == (404, "there is no component at /nothing; available: /repository\n")

    run_scenario(scenario)
