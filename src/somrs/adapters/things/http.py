"""The connection to a server whose paths are read again and again."""

from __future__ import annotations

import asyncio

import aiohttp

from somrs.adapters.things.connections import read_password, security
from somrs.adapters.things.connector import FIRST_PAUSE, ConnectionNotes, Listener, Rejection, why_not_there
from somrs.adapters.things.conversion import Raw
from somrs.adapters.things.messages import payload_text
from somrs.adapters.things.model import Command, Connection, Source
from somrs.adapters.things.state import SourceKey

PATIENCE = 10.0
"""Seconds after which a reading without an answer is begun anew."""
MOST_BYTES = 1 << 20
"""Of an answer."""


class HttpConnector:
    """A server."""

    def __init__(self, connection: Connection, listener: Listener) -> None:
        self._connection, self._listener = connection, listener
        self._password = read_password(connection)
        self._notes = ConnectionNotes(connection)
        self._place_notes: dict[str, ConnectionNotes] = {}
        self._sources: dict[str, Source] = {}
        self._pollers: dict[str, asyncio.Task[None]] = {}
        self._session: aiohttp.ClientSession | None = None
        self._opened = asyncio.Event()
        self._prompts: dict[str, asyncio.Event] = {}

    def follow(self, source: Source) -> None:
        if source.place in self._sources and self._sources[source.place].poll <= source.poll:
            return
        self._sources[source.place] = source
        if self._opened.is_set():
            self._poll_again(source)

    def unfollow(self, source: Source) -> None:
        self._sources.pop(source.place, None)
        if (poller := self._pollers.pop(source.place, None)) is not None:
            poller.cancel()

    async def run(self) -> None:
        connection = self._connection
        authorization = aiohttp.BasicAuth(connection.user, self._password or "") if connection.user is not None else None
        headers = {"Authorization": f"Bearer {self._password}"} if authorization is None and self._password is not None else None
        connector = aiohttp.TCPConnector(ssl=security(connection) or True)
        async with aiohttp.ClientSession(auth=authorization, headers=headers, connector=connector) as session:
            self._session = session
            self._opened.set()
            for source in self._sources.values():
                self._poll_again(source)
            try:
                await asyncio.Event().wait()
            finally:
                self._opened.clear()
                for poller in self._pollers.values():
                    poller.cancel()
                await asyncio.gather(*self._pollers.values(), return_exceptions=True)

    async def send(self, command: Command, raw: Raw) -> None:
        await self.request(command.method, command.place, payload_text(raw).encode(), command.content_type)

    async def request(self, method: str, place: str, body: bytes, content_type: str = "application/json") -> None:
        """Send a request. Raises Rejection when the server refuses it, or is not there."""
        await self._opened.wait()
        assert self._session is not None, "an open connection has a session"
        try:
            async with self._session.request(method, self.url(place), data=body, headers={"Content-Type": content_type}) as answer:
                text = (await answer.content.read(MOST_BYTES)).decode("utf-8", "replace")
                if answer.status >= 400:
                    raise Rejection(
                        f"{self.url(place)} answers {answer.status} {answer.reason}: {text[:200]}".rstrip(": "), is_received=True
                    )
        except aiohttp.ClientConnectorError as error:
            raise Rejection(f"{self.url(place)} is not there: {error}", is_received=False) from error
        except aiohttp.ClientError as error:
            raise Rejection(f"{self.url(place)} broke off: {error}", is_received=True) from error
        for prompt in self._prompts.values():
            prompt.set()  # what it did is read at once

    def url(self, place: str) -> str:
        """The address of a path of this server; what is an address already stays so."""
        return place if "://" in place else f"{self._connection}/{place.lstrip('/')}"

    def _poll_again(self, source: Source) -> None:
        if (earlier_poller := self._pollers.get(source.place)) is not None:
            earlier_poller.cancel()
        self._pollers[source.place] = asyncio.create_task(self._poll(source))

    async def _poll(self, source: Source) -> None:
        prompt = self._prompts[source.place] = asyncio.Event()
        while True:
            prompt.clear()
            await self._read(source)
            try:
                async with asyncio.timeout(source.poll):
                    await prompt.wait()
            except TimeoutError:
                continue

    async def _read(self, source: Source) -> None:
        assert self._session is not None, "pollers run while the connection is open"
        key: SourceKey = (self._connection.name, source.place, None)
        place_notes = self._place_notes.setdefault(source.place, ConnectionNotes(self._connection))
        try:
            async with asyncio.timeout(PATIENCE), self._session.get(self.url(source.place)) as answer:
                payload = await answer.content.read(MOST_BYTES)
                status = answer.status
        except TimeoutError:
            place_notes.note(f"does not answer for {source.place}; it is tried again")  # which says nothing of the thing
            return
        except aiohttp.ClientError as error:
            self._notes.note(why_not_there(error, self._connection))
            self._listener.reached(self._connection.name, False)
            await asyncio.sleep(FIRST_PAUSE)
            return
        if status >= 400:
            place_notes.note(f"answers {status} for {source.place}; correct the path, or the rights")
            self._listener.unreadable(key, f"{self.url(source.place)} answers {status}")
            return
        place_notes.forget()
        self._notes.note("answers", is_bad=False)
        self._listener.reached(self._connection.name, True)
        self._listener.received(key, payload)
