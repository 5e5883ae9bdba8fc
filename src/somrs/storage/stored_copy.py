"""The copy of a component's file in a stream of NATS JetStream, from which a new standby begins.

Only the one that leads the component stores copies: each names the copy that it replaces, and is refused if there is another one. What a
writer that was killed or replaced has left half stored is removed with the next copy.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
import logging
import uuid
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING

import msgspec

from somrs.errors import UsageError
from somrs.storage.nats_connection import LONGEST_PAUSE, patiently
from somrs.storage.stores import Stores

if TYPE_CHECKING:
    from nats.js import JetStreamContext
    from nats.js.api import ObjectInfo

log = logging.getLogger(__name__)

_CHUNK_SIZE = 128 * 1024
"""Bytes of the file in one message."""

_EXPECTED = "Nats-Expected-Last-Subject-Sequence"
_WRONG_SEQUENCE = 10071

_NUMBER, _ADDRESS, _HISTORY, _REPLACED = "Somrs-Number", "Somrs-Address", "Somrs-History", "Somrs-Replaced"
"""The headers of a copy."""


class Replaced(UsageError):
    """Another process continues this component."""


class CopyInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What a copy is of: the number of its last entry, the address of its component, and the history on the bus that it belongs to (empty
    for a copy of an earlier program). `replaced`: the histories that a person has given up for it."""

    number: int
    address: str
    history: str = ""
    replaced: tuple[str, ...] = ()

    def headers(self) -> dict[str, str]:
        return {
            _NUMBER: str(self.number),
            _ADDRESS: self.address,
            _HISTORY: self.history,
            _REPLACED: " ".join(self.replaced),
        }

    @classmethod
    def of(cls, headers: dict[str, str]) -> CopyInfo:
        return cls(
            number=int(headers.get(_NUMBER, 0)),
            address=headers.get(_ADDRESS, ""),
            history=headers.get(_HISTORY, ""),
            replaced=tuple(headers.get(_REPLACED, "").split()),
        )


class StoredCopy:
    """The copy of a component. All methods wait until the servers answer, however long."""

    def __init__(self, js: JetStreamContext, stores: Stores) -> None:
        self._js, self._key, self._stream = js, stores.key, stores.copies
        self._subject, self._chunks = f"{stores.copies_subject}.info", f"{stores.copies_subject}.chunks"
        self._replaces: int | None = None
        """The place of the copy that this process knows as the latest one."""

    async def begin_writing(self) -> None:
        """This process leads from here on, and replaces the copy that is there now."""
        self._replaces, _ = await self._latest()
        await self._remove_others()

    async def write(self, file: Path, info: CopyInfo, leads: Callable[[], Awaitable[bool]]) -> None:
        """Store the file. `leads`: whether this process still leads, if somebody else has stored a copy meanwhile.

        Raises Replaced if it does not.
        """
        from nats.js.errors import APIError

        has_warned = False
        while True:
            try:
                await patiently(partial(self._put, file, info, leads))
            except APIError as error:
                if not has_warned:
                    log.warning("the bus does not store a copy of %s: %s; it is tried again", self._key, error.description or error)
                    has_warned = True
            else:
                break
            finally:
                await self._remove_others()
            await asyncio.sleep(LONGEST_PAUSE)

    async def _put(self, file: Path, info: CopyInfo, leads: Callable[[], Awaitable[bool]]) -> None:
        from nats.js.api import ObjectInfo, ObjectMetaOptions

        id, digest, size, count = uuid.uuid4().hex, hashlib.sha256(), 0, 0
        with file.open("rb") as content:
            while chunk := await asyncio.to_thread(content.read, _CHUNK_SIZE):
                await self._js.publish(f"{self._chunks}.{id}", chunk)
                digest.update(chunk)
                size, count = size + len(chunk), count + 1
        stored_info = ObjectInfo(
            name=self._key,
            headers=info.headers(),
            options=ObjectMetaOptions(max_chunk_size=_CHUNK_SIZE),
            bucket=self._stream,
            nuid=id,
            size=size,
            chunks=count,
            digest=_digest_text(digest.digest()),
        )
        await self._put_info(stored_info, leads)

    async def _put_info(self, info: ObjectInfo, leads: Callable[[], Awaitable[bool]]) -> None:
        """Make the copy the latest one."""
        from nats.js.errors import APIError

        document = json.dumps(info.as_dict()).encode()
        if self._replaces is None:
            self._replaces, _ = await self._latest()
        while True:
            headers = {"Nats-Rollup": "sub", _EXPECTED: str(self._replaces)}
            try:
                self._replaces = (await self._js.publish(self._subject, document, headers=headers)).seq
            except APIError as error:
                if error.err_code != _WRONG_SEQUENCE:
                    raise
                place, latest_info = await self._latest()
                if latest_info is None or latest_info.nuid != info.nuid:
                    if not await leads():
                        raise Replaced(f"another process continues {self._key}: it has stored a copy of its file on the bus") from None
                    self._replaces = place
                    continue
                self._replaces = place
            return

    async def _remove_others(self) -> None:
        """Remove all chunks but those of the latest copy."""
        _, info = await self._latest()
        stream = await patiently(lambda: self._js.stream_info(self._stream, subjects_filter=f"{self._chunks}.>"))
        for subject in stream.state.subjects or {}:
            if info is None or subject != f"{self._chunks}.{info.nuid}":
                await patiently(partial(self._js.purge_stream, self._stream, subject=subject))

    async def info(self) -> CopyInfo | None:
        """What the stored file is; None if there is none."""
        _, info = await self._latest()
        return CopyInfo.of(info.headers or {}) if info is not None else None

    async def read(self, file: Path) -> None:
        """Write the stored file to `file`; if it is replaced meanwhile, or is damaged, then the next one.

        Raises UsageError when there is none.
        """
        while True:
            _, info = await self._latest()
            if info is None:
                raise UsageError(f"there is no copy of {self._key} on the bus any more; start it again")
            with file.open("wb") as content:
                if await self._read_chunks(info, content):
                    return
            await self._wait_for_next(info)

    async def _read_chunks(self, info: ObjectInfo, content: IO[bytes]) -> bool:
        """Write the chunks to `content`. Returns whether all are there, with the digest of what was stored.

        The library's own `get` waits for ever when the chunks are deleted before it has them.
        """
        from nats.js.errors import NotFoundError

        digest, place = hashlib.sha256(), 0
        subject = f"{self._chunks}.{info.nuid}"
        for _ in range(info.chunks or 0):
            try:
                message = await patiently(partial(self._js.get_msg, self._stream, seq=place + 1, subject=subject, next=True))
            except NotFoundError:
                return False
            assert message.seq is not None, "a message of a stream has a place in it"
            chunk, place = message.data or b"", message.seq
            digest.update(chunk)
            await asyncio.to_thread(content.write, chunk)
        return info.digest == _digest_text(digest.digest())

    async def _wait_for_next(self, info: ObjectInfo) -> None:
        """Return when another file is stored, or none. Chunks of the one before are deleted then, and when its writer was cut off."""
        has_warned = False
        while (latest_info := (await self._latest())[1]) is not None and latest_info.nuid == info.nuid:
            if not has_warned:
                log.warning("the copy of %s on the bus is damaged; waiting for the next one of the process that leads", self._key)
                has_warned = True
            await asyncio.sleep(LONGEST_PAUSE)

    async def _latest(self) -> tuple[int, ObjectInfo | None]:
        """The place of what was said last about the file, 0 if nothing was, and what is stored; None if nothing is."""
        from nats.js.api import ObjectInfo
        from nats.js.errors import NotFoundError

        try:
            message = await patiently(lambda: self._js.get_last_msg(self._stream, self._subject))
        except NotFoundError:
            return 0, None
        info = ObjectInfo.from_response(json.loads(message.data or b"{}"))
        return message.seq or 0, info if not info.deleted else None


def _digest_text(digest: bytes) -> str:
    return f"SHA-256={base64.urlsafe_b64encode(digest).decode()}"
