"""The components of one process behind one port, and the delivery of messages to them from outside and from each other."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from urllib.parse import urlsplit

from somrs.errors import RemoteError
from somrs.kernel.component import Component, Received, Stateful
from somrs.kernel.durability import JournaledComponent
from somrs.ports import check_address
from somrs.protocol.messages.envelope import Message
from somrs.runtime.bus import Bus
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.clock import Clock
from somrs.runtime.http import Server
from somrs.runtime.node import CarryOut, Node, Watch, refuse_work
from somrs.runtime.outbox import Outboxes, OutgoingMessage, Transport
from somrs.runtime.reception import Handler
from somrs.runtime.trust_client import following
from somrs.runtime.wire import Wire
from somrs.storage.journal import Journal
from somrs.trust.credentials import Credentials

log = logging.getLogger(__name__)


class Host:
    """The components of one process behind one port, by default at the loopback address: a context manager. `clock` is the clock of all
    components. Raises UsageError for a host that is no address.

    `bus`: where the components are instead, and how they reach those of the same site. `credentials`: with what they prove who they are to
    others, over HTTPS; by default, those of the environment.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        watch: Watch | None = None,
        clock: Clock | None = None,
        bus: BusAddress | None = None,
        credentials: Credentials | None = None,
    ) -> None:
        if bus is None:
            check_address(host)
        credentials = credentials if credentials is not None else Credentials.of_environment()
        self._credentials, self._exits = credentials, contextlib.AsyncExitStack()
        self.clock = clock if clock is not None else Clock()
        self._wire, self._bus = Wire(credentials), Bus(bus, credentials) if bus is not None else None
        self._nodes: dict[str, Node] = {}
        self._parts: dict[str, Handler] = self._bus.parts if self._bus is not None else {}
        self._server = self._bus or Server(host, port, self._parts, credentials=credentials)
        self._watch = watch
        self._local: deque[tuple[Node, OutgoingMessage]] = deque()
        self._outboxes = Outboxes(self._route, self._post_separately, self.clock.now)

    @property
    def url(self) -> str:
        return self._server.url

    @property
    def port(self) -> int:
        return self._server.port

    async def __aenter__(self) -> Host:
        await self.start()
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.stop()

    async def start(self) -> None:
        """Connect, and listen. Raises UsageError when the port is not available."""
        await self._server.start()
        await self._exits.enter_async_context(following(self._credentials))

    async def rival(self, path: str) -> str | None:
        """The other process on the bus that has a component at a path, as of `Bus.listener`; None: there is none."""
        return await self._bus.listener(path) if self._bus is not None else None

    def contested(self, path: str) -> asyncio.Event:
        """Set when another process on the bus is to have the component at a path, as of `Bus.contested`."""
        return self._bus.contested(path) if self._bus is not None else asyncio.Event()

    async def listening(self) -> None:
        """Return when others can reach the components that have been added."""
        if self._bus is not None:
            await self._bus.listening()

    def add(self, path: str, factory: Callable[[str], Component], *, carry_out: CarryOut = refuse_work) -> Node:
        """Add a component without a journal at a path such as `/repository`, and start it. `factory` creates it for its address."""
        address = f"{self.url}{path}"
        return self._start(path, self._node(address, factory(address), carry_out), is_resumed=False)

    def add_journaled(
        self,
        path: str,
        factory: Callable[[str], Stateful],
        journal: Journal,
        *,
        carry_out: CarryOut = refuse_work,
        notices: Sequence[object] = (),
        recovers: bool = False,
    ) -> Node:
        """Add a component with a journal: as the journal has it or, if the journal is new, as `factory` creates it for its address.

        `notices` are passed to the component before its start. `recovers`: as of `Node`.

        Raises:
            UsageError: the journal cannot be continued.
        """
        journaled, is_resumed = journal.begin(f"{self.url}{path}", factory)
        return self.add_continued(path, journaled, journal, is_resumed=is_resumed, carry_out=carry_out, notices=notices, recovers=recovers)

    def add_continued(
        self,
        path: str,
        journaled: JournaledComponent,
        journal: Journal,
        *,
        is_resumed: bool,
        carry_out: CarryOut = refuse_work,
        notices: Sequence[object] = (),
        recovers: bool = False,
    ) -> Node:
        """Add a component as its journal has it. `is_resumed`: whether something may have been under way."""
        self.clock.advance_to(journaled.time)
        address = f"{self.url}{path}"
        node = self._node(address, journaled.component, carry_out, journal=journal, journaled=journaled, recovers=recovers)
        return self._start(path, node, is_resumed=is_resumed, notices=notices)

    def _node(
        self,
        address: str,
        component: Component,
        carry_out: CarryOut,
        *,
        journal: Journal | None = None,
        journaled: JournaledComponent | None = None,
        recovers: bool = False,
    ) -> Node:
        return Node(
            address,
            component,
            carry_out,
            clock=self.clock,
            send=self.send,
            delivered=self.delivered,
            journal=journal,
            journaled=journaled,
            watch=self._watch,
            recovers=recovers,
        )

    def _start(self, path: str, node: Node, *, is_resumed: bool, notices: Sequence[object] = ()) -> Node:
        self._nodes[node.address] = node
        self._parts[path] = node.receive
        node.start(is_resumed=is_resumed, notices=notices)
        return node

    async def remove(self, node: Node) -> None:
        """Stop the component, and free its address."""
        await node.close()
        del self._nodes[node.address], self._parts[urlsplit(node.address).path]

    def _route(self, address: str) -> Transport:
        """What reaches the address: the bus within the site, HTTP outside."""
        return self._bus if self._bus is not None and self._bus.covers(address) else self._wire

    def send(self, outgoing: OutgoingMessage) -> None:
        """Deliver the message to its recipient, in this process or another, after the messages to it that wait already."""
        address = outgoing.message.header.recipient
        local = self._nodes.get(address)
        if local is None or self._outboxes.busy(address):
            self._outboxes.enqueue(outgoing)
            return
        self._local.append((local, outgoing))
        if len(self._local) == 1:
            asyncio.get_running_loop().call_soon(self._hand_over)

    def _hand_over(self) -> None:
        """Deliver the messages that wait now. New messages wait for the next turn, so that sockets and timers are served between."""
        for _ in range(len(self._local)):
            recipient, outgoing = self._local[0]
            try:
                recipient.feed(Received(outgoing.message))
                recipient.output.acknowledge(partial(self._handle_local_delivery, outgoing))
            except RemoteError:
                self._outboxes.enqueue_separately(outgoing)
            except Exception as error:  # a defect in handling one message must not hold back those behind it
                log.exception("%s: a %s could not be handled", recipient.address, type(outgoing.message.body).__name__)
                outgoing.sender.handle_delivery_failure(outgoing, f"{type(error).__name__}: {error}")
            finally:
                self._local.popleft()
        if self._local:
            asyncio.get_running_loop().call_soon(self._hand_over)

    def _handle_local_delivery(self, outgoing: OutgoingMessage, error: RemoteError | None) -> None:
        if error is None:
            outgoing.sender.handle_acknowledgement(outgoing, None)
        else:
            self._outboxes.enqueue_separately(outgoing)

    async def delivered(self, seconds: float) -> None:
        """Return when no message is under way, or after `seconds`."""
        while self._local:
            await asyncio.sleep(0)
        await self._outboxes.flush(seconds)

    async def _post_separately(self, messages: Sequence[Message], seconds: float) -> Sequence[Message | None]:
        recipient = messages[0].header.recipient
        if (local := self._nodes.get(recipient)) is None:
            return await self._route(recipient).post_separately(messages, seconds)
        local.feed(Received(messages[0]))
        await local.output.on_disk()
        return [None]

    async def post(self, message: Message, seconds: float = 30.0) -> Message | None:
        """Send a message to a component of another process, as `Wire.post`: on the bus, or by HTTP."""
        return await self._route(message.header.recipient).post(message, seconds)

    async def request(self, message: Message, timeout: float = 30.0) -> Message:
        """Send a request and return the answer from the same connection. Raises RemoteError."""
        if (local := self._nodes.get(message.header.recipient)) is not None:
            answer = await local.receive(message)
        else:
            answer = await self.post(message, timeout)
        if answer is None:
            raise RemoteError(f"{message.header.recipient} did not answer {type(message.body).__name__}")
        return answer

    async def stop(self) -> None:
        for node in self._nodes.values():
            await node.close()
        await self._outboxes.close()
        with contextlib.suppress(RemoteError):
            await self._server.stop()
        await self._wire.close()
        if self._bus is not None:
            await self._bus.close()
        await self._exits.aclose()
