"""The journal of a component on the bus: its entries in a stream of NATS JetStream, and copies of its file in another one.

A component on the bus has one leader, which handles its inputs, and standbys, which follow the stream. The leader writes entries to the
stream before they are in its file and before any effect is visible. Each write names the last entry that the leader knows, and is refused
when there is another one: whoever was replaced cannot write any more, and what it cannot write it may not say. No clock decides that; a
lease only says when a standby should try.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import threading
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import msgspec

from somrs.errors import UsageError
from somrs.storage.lease import LEASES, Lease
from somrs.storage.nats_connection import FIRST_PAUSE, INBOXES, LONGEST_PAUSE, connect, end, patiently
from somrs.storage.running_component import RunningComponent, status_subject
from somrs.storage.stored_copy import CopyInfo, Replaced, StoredCopy
from somrs.storage.stores import REQUESTS, Stores, have_made, make_stores
from somrs.trust.credentials import Credentials

if TYPE_CHECKING:
    from nats.aio.client import Client
    from nats.aio.msg import Msg
    from nats.js import JetStreamContext
    from nats.js.api import RawStreamMsg

log = logging.getLogger(__name__)

T = TypeVar("T")

NUMBER, VERSION, WRITER = "Somrs-Number", "Somrs-Version", "Somrs-Writer"
"""The headers of a batch of entries: the number of its last entry, the version of their schema, and who wrote it."""

_BEGINS_ANEW = "Somrs-Begins-Anew"
"""The header of a batch without entries before which nothing counts any more: the next ones follow on the copy that is stored then."""

_EXPECTED = "Nats-Expected-Last-Sequence"
_WRONG_SEQUENCE = 10071
_CLOSE_TIME = 2.0
"""Seconds for connections to be closed."""

_WRITE_TIME = 2.0
"""Seconds after which a write without an answer is repeated. If it was done, the repetition is refused and recognised."""


class Batch(NamedTuple):
    """Entries in the stream: their place, the number of the last one, the version of their schema, and the document."""

    sequence: int
    number: int
    version: int
    document: bytes
    begins_anew: bool = False
    """What is before it does not count any more."""


class StreamLog:
    """The entries of one component. `identity`: of this process with its file; its lease is its own again after a restart. `credentials`:
    with what this process proves who it is; by default, those of the environment.

    Entries are written in the event loop that has opened it. Everything else is done by a thread with a connection of its own, so that the
    lease is renewed when that loop is busy. `last`: the place of the last entry that is known here, and `number` its number. `on_lost` is
    called, in that thread, when another process has become the leader.
    """

    def __init__(self, servers: str, site: str, component: str, identity: str, credentials: Credentials | None = None) -> None:
        self._servers, self._identity = servers, identity
        self._credentials = credentials if credentials is not None else Credentials.of_environment()
        self._stores = Stores(site, component)
        self._key, self._subject, self._stream = self._stores.key, self._stores.journal_subject, self._stores.journal
        self._resignation = f"somrs-resignation.{self._key}"
        self.last = self.number = 0
        self.on_lost: Callable[[], object] = lambda: None
        self.problem = ""
        """Why the bus does not store what is written; empty if it does."""
        self.lacks_copy = False
        """Whether the stream has lost entries, so that the bus needs a copy of the file."""
        self._is_ending = False
        self._client: Client | None = None
        self._writer: Client | None = None
        self._news = asyncio.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name=f"log {component}", daemon=True)
        self._thread.start()

    @property
    def component(self) -> str:
        return self._key.partition(".")[2]

    async def call(self, work: Coroutine[Any, Any, T]) -> T:
        """Do work of this log in its thread."""
        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(work, self._loop))

    # Connection

    async def open(self) -> None:
        """Connect, and have made what the component needs there. However long the bus cannot be reached."""
        await self.call(self._open())
        self._writer = await connect(self._servers, self._credentials)
        self._writing: JetStreamContext = self._writer.jetstream(timeout=_WRITE_TIME)

    async def _open(self) -> None:
        self._client = client = await connect(self._servers, self._credentials)
        self._js: JetStreamContext = client.jetstream(timeout=_WRITE_TIME)
        await self._have_stores()
        self._made_at = (await patiently(lambda: self._js.stream_info(self._stream))).created
        self._copy = StoredCopy(self._js, self._stores)
        self.lease = Lease(await patiently(lambda: self._js.key_value(LEASES)), self._key, self._identity, lambda: self.on_lost())
        self._followed = await client.subscribe(self._subject, cb=self._on_news)
        await client.subscribe(self._resignation, cb=self._on_news)
        await client.subscribe(status_subject(self._key.partition(".")[0]), cb=self._on_question)

    async def _have_stores(self) -> None:
        assert self._client is not None, "it is open"
        subject, by_servers = f"{REQUESTS}.{self._key}", self._credentials is not None
        await have_made(self._client, subject, lambda: make_stores(self._js, self._stores), by_servers=by_servers)

    async def _on_question(self, question: Msg) -> None:
        answer = RunningComponent(
            component=self.component,
            host=socket.gethostname(),
            process=os.getpid(),
            leads=self.lease.is_held,
            number=self.number,
            problem=self.problem,
        )
        if question.reply.startswith(INBOXES):
            await question.respond(msgspec.msgpack.encode(answer))

    async def _on_news(self, message: object) -> None:
        self._news.set()

    async def close(self) -> None:
        """Close the connections, and end the thread."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_CLOSE_TIME):
                await end(self._writer)
                await self.call(self._close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _close(self) -> None:
        await end(self._client)
        unfinished = asyncio.all_tasks() - {asyncio.current_task()}
        for task in unfinished:
            task.cancel()
        await asyncio.gather(*unfinished, return_exceptions=True)

    # Entries

    async def append(self, number: int, version: int, document: bytes) -> None:
        """Write entries, the last of which has this number, and return when the servers have stored them. One call at a time.

        Raises Replaced when another process has written, and UsageError when the servers do not accept messages of this size, or cannot be
        reached after `end_writing`. What passes, such as a bus without room, is waited for: `problem` says it.
        """
        await self._append(document, {NUMBER: str(number), VERSION: str(version)})
        self.number = number

    async def _append(self, document: bytes, headers: dict[str, str]) -> None:
        from nats import errors
        from nats.js.errors import APIError

        pause = FIRST_PAUSE
        while True:
            all_headers = headers | {_EXPECTED: str(self.last), WRITER: self._identity}
            try:
                self.last = (await self._writing.publish(self._subject, document, timeout=_WRITE_TIME, headers=all_headers)).seq
            except errors.MaxPayloadError:
                assert self._writer is not None, "it is open"
                advice = f"raise max_payload of the NATS servers, now {self._writer.max_payload}"
                raise UsageError(f"an input of {self._key} has {len(document)} bytes; {advice}") from None
            except APIError as error:
                if error.err_code == _WRONG_SEQUENCE:
                    writer = await self._writer_of(self.last + 1, document)
                    if writer is not None:
                        self.last += 1
                        if writer:
                            break
                        continue
                    if not await self._begins_at_new_stream():
                        raise Replaced(f"another process continues {self._key}: it has written to its journal on the bus") from None
                    continue
                self._note_problem(f"the bus does not store the inputs of {self._key}: {error.description or error}")
            except (errors.Error, OSError):  # an acknowledgement that is lost is found by the next attempt
                if self.lease.is_held and await self._is_gone():
                    self._note_problem(f"the journal of {self._key} on the bus was deleted")
                    await self.call(self._have_stores())
                    continue
                self._note_problem(f"the bus does not answer {self._key}")
            else:
                break
            if self._is_ending:
                raise UsageError(f"the last inputs of {self._key} are not stored, because the bus cannot be reached")
            await asyncio.sleep(pause)
            pause = min(pause * 2, LONGEST_PAUSE)
        if self.problem:
            log.warning("the bus stores the inputs of %s again", self._key)
            self.problem = ""

    def _note_problem(self, problem: str) -> None:
        if problem != self.problem:
            log.warning("%s; they are sent again until it does, and wait for that", problem)
            self.problem = problem

    async def _is_gone(self) -> bool:
        """Whether the stream was deleted, as far as the servers answer."""
        from nats import errors
        from nats.js.errors import NotFoundError

        try:
            await self._writing.stream_info(self._stream)
        except NotFoundError:
            return True
        except (errors.Error, OSError):
            pass
        return False

    async def _begins_at_new_stream(self) -> bool:
        """Whether the stream was deleted and made anew, so that this process, if it leads, goes on there. Then the bus needs a copy."""
        _, last_place = await self.bounds()
        if last_place >= self.last or not self.lease.is_held:
            return False
        self.last, self.lacks_copy = last_place, True
        return True

    def end_writing(self) -> None:
        """Let writes try only once from here on: a process that ends must not wait until the bus is back."""
        self._is_ending = True

    async def _writer_of(self, sequence: int, document: bytes) -> str | None:
        """Who has written at this place: this process, if it is the document; the empty text, if it is no entry; None otherwise."""
        from nats.js.errors import NotFoundError

        try:
            message = await patiently(lambda: self._writing.get_msg(self._stream, sequence))
        except NotFoundError:
            return None
        writer = (message.headers or {}).get(WRITER, "")
        return writer if not writer or (message.data == document and writer == self._identity) else None

    async def bounds(self) -> tuple[int, int]:
        """The places of the first and the last batch in the stream; the last is before the first if it is empty."""

        async def read() -> tuple[int, int]:
            state = (await patiently(lambda: self._js.stream_info(self._stream))).state
            return state.first_seq or state.last_seq + 1, state.last_seq

        return await self.call(read())

    async def is_made_anew(self) -> bool:
        """Whether the stream was deleted since it was opened, and is there again."""

        async def read() -> bool:
            return (await patiently(lambda: self._js.stream_info(self._stream))).created != self._made_at

        return await self.call(read())

    async def batch(self, sequence: int) -> Batch | None:
        """The batch at a place; None if there is none. What nobody has written as a batch is one without entries."""
        message = await self._message(sequence)
        if message is None:
            return None
        headers, place = message.headers or {}, sequence
        while WRITER not in headers:
            place -= 1
            message_ahead = await self._message(place) if place > 0 else None
            if message_ahead is None:
                copy = await self.copy_info()
                return Batch(sequence, copy.number if copy is not None else 0, 0, b"")
            headers = message_ahead.headers or {}
        number = int(headers.get(NUMBER, 0))
        if place < sequence:
            return Batch(sequence, number, 0, b"")
        return Batch(sequence, number, int(headers.get(VERSION, 0)), message.data or b"", _BEGINS_ANEW in headers)

    async def _message(self, sequence: int) -> RawStreamMsg | None:
        """What the stream has at a place; None if there is nothing."""
        from nats.js.errors import NotFoundError

        async def read() -> RawStreamMsg | None:
            try:
                return await patiently(lambda: self._js.get_msg(self._stream, sequence))
            except NotFoundError:
                return None

        return await self.call(read())

    async def place_after(self, number: int) -> int:
        """The place of the first batch with an entry after the one with this number, or behind the last batch."""
        first, last_place = await self.bounds()
        low, high = first, last_place + 1
        while low < high:
            middle = (low + high) // 2
            batch = await self.batch(middle)
            if batch is None or batch.number <= number:
                low = middle + 1
            else:
                high = middle
        return low

    async def last_number(self) -> int:
        """The number of the last entry that the bus has."""
        first, last_place = await self.bounds()
        batch = await self.batch(last_place) if first <= last_place else None
        if batch is not None and not batch.begins_anew:
            return batch.number
        copy = await self.copy_info()
        return copy.number if copy is not None else 0

    async def begin_writing(self, number: int, *, begins_anew: bool = False) -> bool:
        """Write that this process leads from here on. False if there are entries that are not read yet.

        `number`: that of the last entry on the bus. `begins_anew`: what is there does not count any more.
        """
        try:
            await self._append(b"", {NUMBER: str(number), VERSION: "0"} | ({_BEGINS_ANEW: "1"} if begins_anew else {}))
        except Replaced:
            return False
        await self.call(self._followed.unsubscribe())  # a leader knows what it writes
        await self.call(self._copy.begin_writing())
        return True

    async def wait_for_news(self, seconds: float) -> None:
        """Return when an entry may have been written or the leader has resigned, or after `seconds`."""

        async def wait() -> None:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(seconds):
                    await self._news.wait()
            self._news.clear()

        await self.call(wait())

    async def forget_before(self, sequence: int) -> None:
        """Delete the entries before a place: a copy of the file has them."""
        if sequence > 1:
            await self.call(patiently(lambda: self._js.purge_stream(self._stream, seq=sequence)))

    # The copy of the file

    async def store_copy(self, file: Path, info: CopyInfo) -> None:
        """Store a copy of the file of the component. Raises Replaced when another process leads."""
        await self.call(self._copy.write(file, info, self._leads))

    async def _leads(self) -> bool:
        """Whether nobody else has written to the stream since this process."""
        from nats.js.errors import NotFoundError

        state = (await patiently(lambda: self._js.stream_info(self._stream))).state
        try:
            message = await patiently(lambda: self._js.get_msg(self._stream, state.last_seq))
        except NotFoundError:
            return self.lease.is_held
        return (message.headers or {}).get(WRITER) == self._identity

    async def copy_info(self) -> CopyInfo | None:
        """What the stored copy is of; None if there is no copy."""
        return await self.call(self._copy.info())

    async def fetch_copy(self, file: Path) -> None:
        """Write the stored copy to a file. Raises UsageError when there is none."""
        await self.call(self._copy.read(file))

    # The lease

    async def acquire(self) -> bool:
        """Try to become the leader."""
        return await self.call(self.lease.acquire())

    async def resign(self) -> None:
        """Lead no more, so that a standby takes over at once."""

        async def give_up() -> None:
            from nats import errors

            if await self.lease.resign():
                with contextlib.suppress(errors.Error, OSError):  # standbys look by themselves
                    assert self._client is not None, "it is open"
                    await self._client.publish(self._resignation)

        await self.call(give_up())
