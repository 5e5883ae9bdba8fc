"""All components of one process, behind one port: how messages reach them from outside, and each other without leaving it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import Callable
from functools import partial

from somrs.app.disk import Disk
from somrs.app.http import Server, Wire
from somrs.app.journal import Journal
from somrs.app.node import CarryOut, Keep, Node, Report, Watch, no_disk
from somrs.app.outbox import Letter
from somrs.errors import RemoteError
from somrs.protocol.component import Component, Received
from somrs.protocol.envelope import Message

log = logging.getLogger(__name__)


class Clock:
    """Seconds since 1970 that never go back while the process lives, nor before what a journal holds."""

    def __init__(self) -> None:
        self._offset = time.time() - time.monotonic()

    def now(self) -> float:
        return time.monotonic() + self._offset

    def not_before(self, at: float) -> None:
        """Go on from there at least: the machine's clock was put back since."""
        self._offset += max(0.0, at - self.now())


async def _nothing_to_do(task: object, report: Report) -> object:
    raise RemoteError(f"this node cannot do {type(task).__name__}")


class Host:
    """The components of one process behind one port. Binds the loopback address unless told otherwise."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0, watch: Watch | None = None) -> None:
        self.clock = Clock()
        self.wire = Wire()
        self._nodes: dict[str, Node] = {}
        self._server = Server(host, port, {})
        self._watch = watch
        self._local: deque[tuple[Node, Node, Letter]] = deque()

    @property
    def url(self) -> str:
        return self._server.url

    async def start(self) -> None:
        await self._server.start()

    def add(
        self,
        path: str,
        make: Callable[[str], Component],
        *,
        carry_out: CarryOut = _nothing_to_do,
        keep: Keep = no_disk,
        disk: Disk | None = None,
    ) -> Node:
        """Put a component, made for its address, at a path such as `/repository`, and start it. `disk`: what `keep` writes to, if
        it does not wait for that."""
        address = f"{self.url}{path}"
        return self._start(path, Node(self, address, make(address), carry_out, keep=keep, disk=disk, watch=self._watch), again=False)

    def add_journaled(self, path: str, make: Callable[[str], Component], journal: Journal, *, carry_out: CarryOut = _nothing_to_do) -> Node:
        """Put a component there whose inputs are kept: as its journal has it, or, if it has none, made for its address.

        Raises UsageError when the journal cannot be gone on with.
        """
        address = f"{self.url}{path}"
        journaled, again = journal.begin(address, make)
        self.clock.not_before(journaled.at)
        node = Node(
            self,
            address,
            journaled.component,
            carry_out,
            keep=journal.keep,
            disk=journal.disk,
            journal=journal,
            journaled=journaled,
            watch=self._watch,
        )
        return self._start(path, node, again=again)

    def _start(self, path: str, node: Node, *, again: bool) -> Node:
        self._nodes[node.address] = node
        self._server.parts[path] = node.receive
        node.start(again=again)
        return node

    def local(self, address: str) -> Node | None:
        """The node at the address, if it is in this process."""
        return self._nodes.get(address)

    def hand_over(self, sender: Node, recipient: Node, letter: Letter) -> None:
        """Hand a message from one node of this process to another, soon: behind those that are being handed over already."""
        self._local.append((sender, recipient, letter))
        if len(self._local) == 1:
            asyncio.get_running_loop().call_soon(self._hand_over)

    def _hand_over(self) -> None:
        """Hand over what waits by now; what comes of it waits for the next time, so that sockets and timers have their turn."""
        for _ in range(len(self._local)):
            sender, recipient, letter = self._local[0]
            try:
                recipient.feed(Received(letter.message))
                recipient.output.acknowledge(partial(_handed, sender, letter))
            except RemoteError:
                sender.post_again(letter)
            except Exception as error:  # a defect in handling one message must not hold back those behind it
                log.exception("%s: a %s could not be handled", recipient.address, type(letter.message.body).__name__)
                sender.given_up(letter, f"{type(error).__name__}: {error}")
            finally:
                self._local.popleft()
        if self._local:
            asyncio.get_running_loop().call_soon(self._hand_over)

    async def delivered(self) -> None:
        """Return when no message is on its way from one node of this process to another."""
        while self._local:
            await asyncio.sleep(0)

    async def post(self, message: Message, seconds: float) -> Message | None:
        """Hand a message to whoever is at its recipient's address, in this process or another; what came back at once."""
        if (local := self._nodes.get(message.header.recipient)) is None:
            return await self.wire.post(message, timeout=seconds)
        local.feed(Received(message))
        await local.output.on_disk()
        return None

    async def request(self, message: Message, timeout: float = 30.0) -> Message:
        """Ask and wait for the answer on the same connection. Raises RemoteError."""
        if (local := self._nodes.get(message.header.recipient)) is not None:
            answer = await local.receive(message)
        else:
            answer = await self.wire.post(message, timeout=timeout)
        if answer is None:
            raise RemoteError(f"{message.header.recipient} did not answer {type(message.body).__name__}")
        return answer

    async def stop(self) -> None:
        for node in self._nodes.values():
            await node.close()
        with contextlib.suppress(RemoteError):
            await self._server.stop()
        await self.wire.close()


def _handed(sender: Node, letter: Letter, error: RemoteError | None) -> None:
    if error is None:
        sender.taken(letter)
    else:
        sender.post_again(letter)
