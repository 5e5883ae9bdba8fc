"""The copy of a component's file in the object store of NATS JetStream, from which a new standby begins."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import logging
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING

from somrs.errors import UsageError
from somrs.storage.nats_connection import LONGEST_PAUSE, made_with_copies, patiently

if TYPE_CHECKING:
    from nats.js import JetStreamContext
    from nats.js.api import ObjectInfo
    from nats.js.object_store import ObjectStore

log = logging.getLogger(__name__)

COPIES = "somrs-journals"
"""The bucket of the copies of files."""


class StoredCopy:
    """The copy of the component with this key, in the bucket `store`. All methods wait until the servers answer, however long."""

    def __init__(self, js: JetStreamContext, store: ObjectStore, key: str) -> None:
        self._js, self._store, self._key = js, store, key

    @classmethod
    async def opened(cls, js: JetStreamContext, key: str) -> StoredCopy:
        """The copy with this key. Makes the bucket if there is none."""
        return cls(js, await made_with_copies(lambda copies: js.create_object_store(COPIES, replicas=copies)), key)

    async def write(self, file: Path, headers: dict[str, str]) -> None:
        """Store the file, with headers that say what is in it."""
        from nats.js.api import ObjectMeta

        async def put() -> None:
            with file.open("rb") as content:
                await self._store.put(self._key, content, ObjectMeta(name=self._key, headers=headers))

        await patiently(put)

    async def headers(self) -> dict[str, str] | None:
        """The headers of the stored file; None if there is none."""
        info = await self._info()
        return (info.headers or {}) if info is not None else None

    async def read(self, file: Path) -> None:
        """Write the stored file to `file`; if it is replaced meanwhile, or is damaged, then the next one.

        Raises UsageError when there is none.
        """
        while (info := await self._info()) is not None:
            with file.open("wb") as content:
                if await self._read_chunks(info, content):
                    return
            await self._replaced(info)
        raise UsageError(f"there is no copy of {self._key} on the bus any more; start it again")

    async def _read_chunks(self, info: ObjectInfo, content: IO[bytes]) -> bool:
        """Write the chunks to `content`. Returns whether all are there, with the digest of what was stored.

        The library's own `get` waits for ever when the chunks are deleted before it has them.
        """
        from nats.js.errors import NotFoundError

        digest, place = hashlib.sha256(), 0
        stream, subject = f"OBJ_{COPIES}", f"$O.{COPIES}.C.{info.nuid}"
        for _ in range(info.chunks or 0):
            try:
                message = await patiently(partial(self._js.get_msg, stream, seq=place + 1, subject=subject, next=True))
            except NotFoundError:
                return False
            assert message.seq is not None, "a message of a stream has a place in it"
            chunk, place = message.data or b"", message.seq
            digest.update(chunk)
            await asyncio.to_thread(content.write, chunk)
        return info.digest == f"SHA-256={base64.urlsafe_b64encode(digest.digest()).decode()}"

    async def _replaced(self, info: ObjectInfo) -> None:
        """Return when another file is stored, or none. Chunks of the one before are deleted then, and when its writer was cut off."""
        is_said = False
        while (stored_info := await self._info()) is not None and stored_info.nuid == info.nuid:
            if not is_said:
                log.warning("the copy of %s on the bus is damaged; waiting for the next one of the process that leads", self._key)
                is_said = True
            await asyncio.sleep(LONGEST_PAUSE)

    async def _info(self) -> ObjectInfo | None:
        from nats.js.errors import NotFoundError

        try:
            return await patiently(lambda: self._store.get_info(self._key))
        except NotFoundError:
            return None
