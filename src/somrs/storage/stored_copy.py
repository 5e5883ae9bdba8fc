"""The copy of a component's file in the object store of NATS JetStream, from which a new standby begins."""

from __future__ import annotations

import asyncio
import base64
import hashlib
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING

from somrs.errors import UsageError
from somrs.storage.nats_connection import made_with_copies, patiently

if TYPE_CHECKING:
    from nats.js import JetStreamContext
    from nats.js.api import ObjectInfo
    from nats.js.object_store import ObjectStore

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
        """Write the stored file to `file`; if it is replaced meanwhile, then the new one.

        Raises UsageError when there is none, or a damaged one.
        """
        from nats.js.errors import NotFoundError

        while (info := await self._info()) is not None:
            try:
                with file.open("wb") as content:
                    digest = await self._read_chunks(info, content)
            except NotFoundError:  # its chunks are deleted when another one is stored
                if (new_info := await self._info()) is not None and new_info.nuid == info.nuid:
                    raise UsageError(f"the copy of {self._key} on the bus is not complete; start the one that leads again") from None
                continue
            if info.digest is not None and base64.urlsafe_b64decode(info.digest.partition("=")[2]) != digest:
                raise UsageError(f"the copy of {self._key} on the bus is damaged; start the one that leads again")
            return
        raise UsageError(f"there is no copy of {self._key} on the bus any more; start it again")

    async def _read_chunks(self, info: ObjectInfo, content: IO[bytes]) -> bytes:
        """Write the chunks to `content`. Returns their SHA-256 digest. Raises NotFoundError when one is not there.

        The library's own `get` waits for ever when the chunks are deleted before it has them.
        """
        digest, place = hashlib.sha256(), 0
        stream, subject = f"OBJ_{COPIES}", f"$O.{COPIES}.C.{info.nuid}"
        for _ in range(info.chunks or 0):
            message = await patiently(partial(self._js.get_msg, stream, seq=place + 1, subject=subject, next=True))
            assert message.seq is not None, "a message of a stream has a place in it"
            chunk, place = message.data or b"", message.seq
            digest.update(chunk)
            await asyncio.to_thread(content.write, chunk)
        return digest.digest()

    async def _info(self) -> ObjectInfo | None:
        from nats.js.errors import NotFoundError

        try:
            return await patiently(lambda: self._store.get_info(self._key))
        except NotFoundError:
            return None
