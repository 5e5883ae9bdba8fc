"""The bus of a site: the messages of SO-MRS as msgpack over NATS.

Components have the same addresses on the bus as for everyone else: URLs below that of the site's gateway, which passes messages of foreign
SOAP participants on to the bus (`bus_gateway.py`). A process on the bus does not go through the gateway: the subject of a message is made
from the path of its recipient's address, `http://robots.example:8600/devices/Robot001` of the site `office` is
`somrs.office.devices.Robot001`. The request is a batch of messages (`batches.py`), and the reply has the outcome of each.

Each process has an inbox as well, a subject of its own that its replies name. Later messages to any component of this process go to the
inbox, together (`bus_processes.py`).

With certificates, the subject of a message has its sender after the site, as `somrs-from.office.SENDER.devices.Robot001`, in which the NATS
servers let only this sender publish (`bus_rights.py`).
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import uuid
from collections.abc import Callable, Sequence
from functools import partial
from itertools import takewhile
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from somrs.errors import RemoteError
from somrs.protocol.messages.envelope import ANONYMOUS, Message
from somrs.runtime import batches
from somrs.runtime.bus_address import ROOT, BusAddress, name_of, token_of
from somrs.runtime.bus_format import MSGPACK, decode, encode
from somrs.runtime.bus_processes import BusProcesses
from somrs.runtime.bus_requests import Requests, answer_subject
from somrs.runtime.bus_rights import may_answer, proof_of_subject, rights_on
from somrs.runtime.outbox import Dispersed
from somrs.runtime.proofs import NO_SOURCE, Denials, Source
from somrs.runtime.reception import Handler, Reception
from somrs.runtime.wire import NONE_ADDRESS, Unanswered, batch_documents, read_outcomes, write_document
from somrs.storage.audit_log import AuditLog
from somrs.storage.nats_connection import INBOXES, connect, end
from somrs.trust.credentials import Credentials

if TYPE_CHECKING:
    from nats.aio.client import Client
    from nats.aio.msg import Msg
    from nats.aio.subscription import Subscription

log = logging.getLogger(__name__)

ANSWER_TIME = 5.0
"""Seconds for which an answer to the question who listens is waited for."""

NO_TOKEN = "-"
"""In place of the token of a program without a certificate."""


class Bus:
    """The connection of a process to the bus: sends messages, and receives those for its `parts`, the handlers by path.

    It has the interfaces of `http.Server` and of `wire.Wire`. Connections are renewed until the bus is closed. `credentials`: with them,
    it connects to servers with TLS only, and checks the rights of the sender of each message; by default, those of the environment.
    """

    def __init__(self, address: BusAddress, credentials: Credentials | None = None) -> None:
        self.address = address
        self._credentials = credentials = credentials if credentials is not None else Credentials.of_environment()
        self._token = token_of(credentials.name) if credentials is not None else NO_TOKEN
        self.parts: dict[str, Handler] = _Parts(self._listen, self._silence)
        data = credentials.data if credentials is not None else None
        audit_log = AuditLog(data) if data is not None else None
        self._reception = Reception(MSGPACK, self.parts, Denials(audit_log, rights_on(address, credentials)))
        self._client: Client | None = None
        self._requests: Requests | None = None
        self._processes = BusProcesses()
        self._inbox = ""
        self._subscriptions: dict[str, asyncio.Task[Subscription]] = {}
        self._contested: dict[str, asyncio.Event] = {}
        self._handling: set[asyncio.Task[None]] = set()
        self._waiting: dict[asyncio.Task[object], str] = {}
        """The tasks that wait for an answer, with its subject."""

    @property
    def url(self) -> str:
        return self.address.gateway

    @property
    def port(self) -> int:
        return urlsplit(self.address.gateway).port or 80

    @property
    def has_certificate(self) -> bool:
        """Whether this process proves who it is."""
        return self._credentials is not None

    @property
    def client(self) -> Client:
        """The connection. Raises Unanswered when `start` was not called."""
        if self._client is None:
            raise Unanswered("there is no connection to the bus")
        return self._client

    async def start(self) -> None:
        """Connect, however long the bus cannot be reached. Raises UsageError as `nats_connection.connect`."""
        self._client = await connect(self.address.servers, self._credentials, disconnected_cb=self._on_disconnect)
        if (credentials := self._credentials) is not None:
            self._requests = Requests(self._client, self.address, self._token, partial(may_answer, credentials, self.address))
            await self._requests.start()
        await self._client.subscribe(self.address.beginning(">"), cb=self._on_begin)
        self._inbox = f"{ROOT}.{self.address.site}.processes.{self._token}.{uuid.uuid4().hex}"
        self._inbox_subscription = await self._client.subscribe(self._heard(self._inbox), cb=self._receive)

    async def listening(self) -> None:
        """Return when the servers know of all components that have been added. Raises Unanswered when they cannot be reached."""
        from nats import errors

        try:
            await asyncio.gather(*self._subscriptions.values())
            await self._flush()
        except (errors.Error, OSError) as error:
            raise Unanswered(f"the bus at {self.address.servers} cannot be reached: {error}") from None

    async def _flush(self) -> None:
        """Return when the servers have everything. The first ping may overtake what the library has not written yet; the second cannot."""
        await self.client.flush()
        await self.client.flush()

    async def stop(self) -> None:
        """Stop receiving. Requests that wait for an answer get a Fault."""
        from nats import errors

        if self._client is not None and self._client.is_connected:
            await asyncio.gather(_drain(self._inbox_subscription), *map(_end, self._subscriptions.values()))
            with contextlib.suppress(errors.Error, OSError):  # the connection is lost just now
                await self._flush()
        self._reception.stop()
        if self._handling:
            await asyncio.wait({*self._handling})

    async def close(self) -> None:
        await end(self._client)

    # Sending

    def covers(self, address: str) -> bool:
        """Whether the address is one of this site."""
        return self.address.covers(address)

    def destination(self, address: str) -> str | None:
        """The inbox of the process with this component, if one of its replies has named it."""
        return self._processes.inbox_of(self.address.subject_of(address))

    def _heard(self, subject: str) -> str:
        """The subject to which a component subscribes to get messages of all senders."""
        return self.address.with_sender(subject, "*") if self._credentials is not None else subject

    async def post(self, message: Message, timeout: float = 30.0) -> Message | None:
        """Send the message, as `Wire.post`."""
        if message.header.recipient == NONE_ADDRESS:
            return None
        return await self.post_to(self.address.subject_of(message.header.recipient), message, timeout)

    async def post_to(self, subject: str, message: Message, timeout: float, sender: str | None = None) -> Message | None:
        """Send the message to who listens to the subject. `sender`: the token of who has proven to a gateway to have sent it."""
        [outcome] = await self._post(subject, [message], [write_document(message, encode)], timeout, sender)
        if isinstance(outcome, RemoteError):
            raise outcome
        return outcome

    async def post_separately(self, messages: Sequence[Message], timeout: float) -> list[Message | None]:
        """Send the first messages to their recipient, up to the first that is rejected, as `Transport.post_separately`."""
        first = messages[0]
        together = takewhile(
            lambda message: message is first or ANONYMOUS not in (message.header.reply_to, first.header.reply_to), messages
        )
        documents = batch_documents([*together], encode)
        outcomes = await self._post(self.address.subject_of(first.header.recipient), messages[: len(documents)], documents, timeout)
        if isinstance(outcomes[0], RemoteError):
            raise outcomes[0]
        accepted: list[Message | None] = []
        for outcome in outcomes:
            if isinstance(outcome, RemoteError):
                break
            accepted.append(outcome)
        return accepted

    async def post_batch(self, messages: Sequence[Message], timeout: float) -> list[Message | RemoteError | None]:
        """Send the first messages, all to components of one process, as `Wire.post_batch`."""
        try:
            documents = batch_documents(messages, encode)
        except RemoteError as error:
            return [error]
        sent_messages = messages[: len(documents)]
        inbox = self.destination(messages[0].header.recipient)
        assert inbox is not None, "the sender has asked for the destination"
        reply = await self._ask_process(inbox, batches.batch(documents), timeout)
        outcomes = _read_reply(reply, sent_messages)
        for message, outcome in zip(sent_messages, outcomes, strict=True):
            if isinstance(outcome, RemoteError):
                self._processes.forget_component(self.address.subject_of(message.header.recipient))
        return outcomes

    async def _ask_process(self, inbox: str, payload: bytes, timeout: float) -> Msg:
        """Send a request to a process. Raises Dispersed when it does not answer: its components may be elsewhere."""
        from nats import errors

        failure = "one of its components has begun anew"
        if not self._processes.has_ended(inbox):
            try:
                if (reply := await self._request(inbox, payload, asyncio.get_running_loop().time() + timeout)) is not None:
                    return reply
            except (errors.Error, OSError, Unanswered) as error:
                failure = str(error)
        self._processes.forget(inbox)
        raise Dispersed(f"a process on the bus did not answer: {failure}")

    async def _post(
        self, subject: str, messages: Sequence[Message], documents: list[bytes], timeout: float, sender: str | None = None
    ) -> list[Message | RemoteError | None]:
        """Send messages for one component to its subject."""
        from nats import errors

        recipient = messages[0].header.recipient
        deadline = asyncio.get_running_loop().time() + timeout
        try:
            while (reply := await self._request(subject, batches.batch(documents), deadline, sender)) is None:
                pass  # the recipient has begun anew
        except errors.NoRespondersError:
            raise Unanswered(f"{recipient} cannot be reached: nobody on the bus listens to {subject}") from None
        except errors.TimeoutError:
            raise Unanswered(f"{recipient} did not answer within {timeout:g} s") from None
        except (errors.Error, OSError) as error:
            raise Unanswered(f"{recipient} cannot be reached on the bus: {error}") from None
        outcomes = _read_reply(reply, messages)
        if reply.reply and not isinstance(outcomes[0], RemoteError):
            self._processes.learn(subject, reply.reply)
        return outcomes

    async def _request(self, subject: str, payload: bytes, deadline: float, sender: str | None = None) -> Msg | None:
        """Send a request, and return the reply; None when nothing will answer it, because the recipient has begun anew meanwhile.

        Raises Unanswered when the connection is lost, and nats.errors.Error.
        """
        task = asyncio.current_task()
        assert task is not None, "messages are sent in tasks"
        cancellations, reply = task.cancelling(), None
        self._waiting[task] = subject
        timeout = max(deadline - asyncio.get_running_loop().time(), 0.0)
        try:
            if self._requests is None:
                reply = await self.client.request(subject, payload, timeout=timeout)
            else:
                target = self.address.with_sender(subject, sender if sender is not None else self._token)
                reply = await self._requests.request(subject, target, payload, timeout)
        except asyncio.CancelledError:
            if task in self._waiting:
                raise
        finally:
            if self._waiting.pop(task, None) is None:
                task.uncancel()
            # It may have been cancelled when it was given up: the two raise one exception.
            if task.cancelling() > cancellations:
                raise asyncio.CancelledError
        if reply is None and not self.client.is_connected:
            raise Unanswered("the connection to the bus is lost")
        return reply

    async def listener(self, path: str) -> str | None:
        """Which other process listens to the messages for a component at a path: the name in its certificate, empty without certificates;
        None: none. Raises Unanswered when it does not say."""
        from nats import errors

        subject = self.address.subject(path)
        try:
            reply = await self._request(subject, batches.batch([]), asyncio.get_running_loop().time() + ANSWER_TIME)
        except errors.NoRespondersError:
            return None
        except (errors.Error, OSError) as error:
            raise Unanswered(f"who listens to {subject} does not answer: {error}") from None
        inbox = reply.reply if reply is not None else ""
        if inbox == self._inbox:
            return None
        tokens = self.address.tokens(inbox)
        return name_of(tokens[1]) if len(tokens) > 1 and tokens[1] != NO_TOKEN else ""

    def contested(self, path: str) -> asyncio.Event:
        """Set when another process begins to listen at a path, too, and is to have it: of two that begin at the same time, one."""
        return self._contested.setdefault(self.address.subject(path), asyncio.Event())

    def _give_up(self, subject: str | None = None) -> None:
        """Give up the requests to the subject, or all."""
        for task, wanted_subject in [*self._waiting.items()]:
            if subject in (None, wanted_subject):
                del self._waiting[task]
                task.cancel()

    async def _on_disconnect(self) -> None:
        self._give_up()

    async def _on_begin(self, notice: Msg) -> None:
        subject = self.address.begun(notice.subject)
        if (contested := self._contested.get(subject)) is not None and notice.data > self._inbox.encode():
            contested.set()
        self._give_up(subject)
        if (inbox := self._processes.begin(subject)) is not None:
            self._give_up(inbox)

    # Receiving

    def _listen(self, path: str) -> None:
        self._subscriptions[path] = asyncio.create_task(self._subscribe(self.address.subject(path)))

    async def _subscribe(self, subject: str) -> Subscription:
        subscription = await self.client.subscribe(self._heard(subject), cb=self._receive)
        # Who waits for an answer of an earlier process would wait in vain.
        await self.client.publish(self.address.beginning(subject), self._inbox.encode())
        return subscription

    def _silence(self, path: str) -> None:
        self._contested.pop(self.address.subject(path), None)
        task = self._subscriptions.pop(path, None)
        if task is not None:
            ending = asyncio.create_task(_end(task))
            self._handling.add(ending)
            ending.add_done_callback(self._handling.discard)

    async def _receive(self, request: Msg) -> None:
        # Each request is handled in a task of its own: a component may be long to answer one. Tasks begin in the order of their requests.
        task = asyncio.create_task(self._handle(request))
        self._handling.add(task)
        task.add_done_callback(self._handling.discard)

    async def _handle(self, request: Msg) -> None:
        from nats import errors

        if not request.reply.startswith(INBOXES):
            log.debug("a request on %s is dropped: its reply subject, %s, is nobody's inbox", request.subject, request.reply)
            return
        try:
            outcomes = await self._reception.outcomes(batches.documents_of(request.data), self._source(request.subject))
        except ValueError as error:
            outcomes = [(404, f"this is not a batch of messages: {error}\n".encode())]
        answered_at = request.reply if self._credentials is None else answer_subject(self.address, self._token, request.reply)
        try:
            await self.client.publish(answered_at, batches.answer(outcomes), reply=self._inbox)
        except (errors.Error, OSError) as error:  # the sender sends its messages again
            log.debug("an answer on %s is lost: %s", request.subject, error)

    def _source(self, subject: str) -> Source:
        """Where a request with this subject comes from."""
        return NO_SOURCE if self._credentials is None else Source(proof=proof_of_subject(self._credentials, subject))


class _Parts(dict[str, Handler]):
    """The handlers of a process by path; `listen` and `silence` are called for those that come and go."""

    def __init__(self, listen: Callable[[str], None], silence: Callable[[str], None]) -> None:
        super().__init__()
        self._listen, self._silence = listen, silence

    def __setitem__(self, path: str, handler: Handler) -> None:
        if path not in self:
            self._listen(path)
        super().__setitem__(path, handler)

    def __delitem__(self, path: str) -> None:
        super().__delitem__(path)
        self._silence(path)


def _read_reply(reply: Msg, messages: Sequence[Message]) -> list[Message | RemoteError | None]:
    """The outcomes of messages: for each the answer, None, or the error for which it was rejected."""
    try:
        outcomes = batches.outcomes_of(reply.data)
        if len(outcomes) != len(messages):
            raise ValueError(f"{len(outcomes)} outcomes for {len(messages)} messages")
    except ValueError as error:
        return [RemoteError(f"{messages[0].header.recipient} sent an answer that cannot be read: {error}")] * len(messages)
    return read_outcomes(outcomes, messages, decode)


async def _end(task: asyncio.Task[Subscription]) -> None:
    """End a subscription that may still be under way."""
    from nats import errors

    try:
        subscription = await task
    except (errors.Error, OSError) as error:
        log.debug("a subscription ends before it has begun: %s", error)
    else:
        await _drain(subscription)


async def _drain(subscription: Subscription) -> None:
    """End a subscription when what has come is handled: its senders would wait."""
    from nats import errors

    try:
        await subscription.drain()  # type: ignore[no-untyped-call]  # nats-py has no annotation there
    except (errors.Error, OSError) as error:  # the server ends it with the connection
        log.debug("a subscription ends with its connection: %s", error)
