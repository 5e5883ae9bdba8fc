"""How the command line asks the windows of a running system, for what only they keep: by their public API."""

from __future__ import annotations

from typing import Any, TypeVar
from urllib.parse import quote

import aiohttp
import msgspec

from somrs.client.client import Addresses
from somrs.client.refusals import Trouble
from somrs.errors import RemoteError, UsageError

ANSWER_TIME = 60.0
"""Seconds that the windows have to answer."""

T = TypeVar("T")


class Windows:
    """An asynchronous context manager. Raises UsageError when the system has no windows, or what is asked is not right."""

    def __init__(self, addresses: Addresses) -> None:
        if addresses.gui is None:
            raise UsageError(
                "this system has no windows, and they keep templates and orders: install them (pip install 'somrs[gui]'), and start the "
                "system again with `somrs up SITE`"
            )
        self._url = addresses.gui
        self._session: aiohttp.ClientSession | None = None

    async def __aenter__(self) -> Windows:
        self._session = aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(total=ANSWER_TIME))
        return self

    async def __aexit__(self, *exception: object) -> None:
        if self._session is not None:
            await self._session.close()

    async def get(self, expected: type[T], *path: str, **query: object) -> T:
        return await self._ask("GET", expected, path, None, query)

    async def post(self, expected: type[T], *path: str, body: object = None, **query: object) -> T:
        return await self._ask("POST", expected, path, body, query)

    async def put(self, expected: type[T], *path: str, body: object) -> T:
        return await self._ask("PUT", expected, path, body, {})

    async def delete(self, *path: str, **query: object) -> None:
        await self._ask("DELETE", type(None), path, None, query)

    async def _ask(self, method: str, expected: type[T], path: tuple[str, ...], body: object, query: dict[str, object]) -> T:
        assert self._session is not None, "it is entered first"
        url = "/".join((self._url, "api", *(quote(part, safe="") for part in path)))
        asked: dict[str, Any] = {name: str(value) for name, value in query.items() if value is not None}
        content = msgspec.json.encode(body) if body is not None else None
        try:
            async with self._session.request(method, _as_it_is(url), params=asked, data=content) as response:
                said, status = await response.read(), response.status
        except (aiohttp.ClientError, TimeoutError) as error:
            raise RemoteError(
                f"the windows at {self._url} do not answer ({error or 'in time'}); `somrs up` starts them, and starts them again"
            ) from None
        if status >= 400:
            raise _refusal(status, said)
        return msgspec.json.decode(said, type=expected)


def _as_it_is(url: str) -> Any:
    """A name may have any characters, and is quoted already."""
    from yarl import URL

    return URL(url, encoded=True)


def _refusal(status: int, said: bytes) -> Exception:
    try:
        trouble = msgspec.json.decode(said, type=Trouble)
    except msgspec.MsgspecError:
        return RemoteError(f"the windows answered with HTTP {status}")
    told = "\n".join(part for part in (trouble.problem, trouble.hint) if part)
    return UsageError(told) if status in (400, 404) else RemoteError(told)
