"""A client's connection to the simulator, which reconnects when the connection is lost."""

from __future__ import annotations

import asyncio
import itertools
import logging
import math
from collections.abc import Callable
from types import TracebackType
from typing import Self

from somrs.devices.link_security import SCHEME
from somrs.devices.simulator.link.commands import ObjectState, RobotState
from somrs.devices.simulator.link.lines import (
    Answer,
    Ask,
    ClientLine,
    Hello,
    Legs,
    OrderDone,
    OrderGivenUp,
    Question,
    Refused,
    ServerLine,
    Stops,
    Ways,
    Welcome,
    encode_line,
    read_by_client,
)
from somrs.errors import RemoteError, SimulationError, UsageError, WireError
from somrs.trust.credentials import Credentials

log = logging.getLogger(__name__)

LONGEST = 64 * 1024 * 1024
"""Longest line that a client reads, in bytes: a picture is one line."""
PATIENCE = 10.0
"""Timeout in seconds for a connection to be made, and for commands that wait for a lost connection."""
PAUSES = (0.1, 0.2, 0.5, 1.0, 2.0)
"""Seconds before each attempt to reconnect; the last value repeats."""
FINAL = {"version", "unknown-robot", "hello-first"}
"""Reasons of a refusal after which the client does not reconnect."""


class RobotGaveUp(RemoteError):
    """A command was not carried out. `reason` is a reason of `CommandGivenUp`, or `link-lost`, `silent` or `refused`.

    `state` and `object_states` are the last that the robot reported, or None and empty.
    """

    def __init__(self, reason: str, description: str, state: RobotState | None = None, object_states: tuple[ObjectState, ...] = ()) -> None:
        self.reason, self.description, self.state, self.object_states = reason, description, state, object_states
        super().__init__(reason, description)

    def __str__(self) -> str:
        return self.description


class Link:
    """A connection that reconnects when it is lost. Requests without an answer then fail with RobotGaveUp. `credentials`: with what this
    program proves who it is; None: the simulator has no certificate."""

    def __init__(self, host: str, port: int, hello: Hello, credentials: Credentials | None = None) -> None:
        self._credentials = credentials
        self._address = f"{host}:{port}"
        self._host, self._port, self._hello = host, port, hello
        self._ids = itertools.count(1)
        self._unanswered: dict[int, asyncio.Future[ServerLine]] = {}
        self._writer: asyncio.StreamWriter | None = None
        self._ready = asyncio.Event()
        self._connection_task: asyncio.Task[None] | None = None
        self._refusal: Refused | None = None
        self._lost_at = -math.inf

    async def connect(self) -> None:
        """Connect. Raises RemoteError when the server refuses, or cannot be reached within `PATIENCE`."""
        self._connection_task = asyncio.create_task(self._keep_connected())
        try:
            await self._wait_connected()
        except BaseException:  # also when cancelled: nothing else closes the connection
            await self.close()
            raise

    async def close(self) -> None:
        if self._connection_task is not None:
            self._connection_task.cancel()
            await asyncio.wait({self._connection_task})
            self._connection_task = None

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        await self.close()

    async def _wait_connected(self) -> None:
        """Wait until the link is connected. Raises UsageError before `connect`, and RobotGaveUp after a refusal or a timeout."""
        if self._connection_task is None:
            raise UsageError("the link is not connected; call connect() first, or use `async with`")
        ready = asyncio.ensure_future(self._ready.wait())
        try:
            await asyncio.wait({ready, self._connection_task}, timeout=PATIENCE, return_when=asyncio.FIRST_COMPLETED)
        finally:
            ready.cancel()
        if self._ready.is_set():
            return
        if self._refusal is not None:
            raise RobotGaveUp("refused", f"{self._address}: {self._refusal.description}")
        raise RobotGaveUp("link-lost", f"there is no connection to {self._address}; is the simulator running?")

    async def _exchange(self, make_line: Callable[[int], ClientLine]) -> ServerLine:
        """Send a line with a new id, and wait for the answer to it."""
        await self._wait_connected()
        assert self._writer is not None, "the link is connected"
        id = next(self._ids)
        answer: asyncio.Future[ServerLine] = asyncio.get_running_loop().create_future()
        self._unanswered[id] = answer
        try:
            self._writer.write(encode_line(make_line(id)))
            return await answer
        finally:
            self._unanswered.pop(id, None)

    async def _ask(self, question: Question) -> Answer:
        """Send a question, and return the answer.

        Raises: UsageError when the simulator refuses the request, SimulationError for a picture without OpenGL.
        """
        match await self._exchange(lambda id: Ask(id=id, question=question)):
            case Answer() as answer:
                return answer
            case Refused(reason="no-graphics", description=description):
                raise SimulationError(description)
            case Refused(description=description):
                raise UsageError(description)
            case reply:
                raise RemoteError(f"a question was answered with {type(reply).__name__}")

    async def _legs(self, robot: str, stops: Stops, situation: str | None) -> Legs:
        answer = await self._ask(Ways(robot=robot, stops=stops, situation=situation))
        return Legs(
            answer.lengths or (),
            answer.shut or (),
            answer.open or (),
            answer.carries is not False,
            answer.out_of_order or (),
            answer.zones or (),
            answer.out_of_reach is True,
        )

    async def _keep_connected(self) -> None:
        """Connect, process lines, and reconnect when the connection is lost."""
        pauses = iter(PAUSES)
        while True:
            try:
                if await self._converse():
                    pauses = iter(PAUSES)
            except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError) as error:
                log.debug("%s: %s", self._address, error)
            except WireError as error:
                log.warning("%s: %s", self._address, error)
            finally:
                was_ready = self._ready.is_set()
                self._ready.clear()
                if was_ready:
                    self._lost_at = asyncio.get_running_loop().time()
                self._fail_all("link-lost", f"the connection to {self._address} was lost")
                if self._writer is not None:
                    self._writer.close()
                    self._writer = None
            if was_ready:
                log.warning("the connection to %s was lost; reconnecting", self._address)
            if self._refusal is not None and self._refusal.reason in FINAL:
                return
            await asyncio.sleep(next(pauses, PAUSES[-1]))

    async def _converse(self) -> bool:
        """Connect and process lines until the connection ends. Return whether the server accepted it."""
        async with asyncio.timeout(PATIENCE):
            tls = self._credentials.client_for(f"{SCHEME}{self._host}") if self._credentials is not None else None
            reader, self._writer = await asyncio.open_connection(self._host, self._port, limit=LONGEST, ssl=tls)
            self._writer.write(encode_line(self._hello))
            first = read_by_client(await reader.readuntil(b"\n"))
        if isinstance(first, Refused):
            self._refusal = first
            return False
        if not isinstance(first, Welcome):
            raise WireError("malformed", f"the first line must be a welcome or an error, not {type(first).__name__}")
        self._refusal = None
        self._ready.set()
        while True:
            try:
                line = await reader.readuntil(b"\n")
            except asyncio.IncompleteReadError:
                return True
            self._hear(read_by_client(line))

    def _hear(self, line: ServerLine) -> None:
        if isinstance(line, OrderDone | OrderGivenUp | Answer | Refused) and line.id is not None:
            waiting = self._unanswered.get(line.id)
            if waiting is not None and not waiting.done():
                waiting.set_result(line)
        elif isinstance(line, Refused):
            self._refusal = line
            log.warning("%s: %s", self._address, line.description)

    def _fail_all(self, reason: str, description: str) -> None:
        for waiting in self._unanswered.values():
            if not waiting.done():
                waiting.set_exception(RobotGaveUp(reason, description, self._last_state()))

    def _last_state(self) -> RobotState | None:
        return None
