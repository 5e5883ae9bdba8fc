"""The client of the API: each operation as a request over HTTP, with the same values and the same errors as in the API's own process."""

from __future__ import annotations

import inspect
import os
from collections.abc import Awaitable, Callable, Mapping
from email.message import Message
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, cast
from urllib.parse import quote, urlencode

import aiohttp
import msgspec
from yarl import URL

from somrs.access.identity import sender
from somrs.access.store import local_token
from somrs.client.addresses import Addresses
from somrs.client.operations import Document, Operation, operations
from somrs.client.refusals import ErrorReport, refusal
from somrs.errors import RemoteError, UsageError
from somrs.runtime.http import KEPT_TIME
from somrs.runtime.wire import UNTAKEN, Unanswered

ANSWER_TIME = 100.0
"""Seconds within which the API has to answer."""

JSON = "application/json"

T = TypeVar("T")


TOKEN_VARIABLE = "SOMRS_TOKEN"
"""The environment variable with the token of programs on other computers."""


def token_of_environment() -> str | None:
    return os.environ.get(TOKEN_VARIABLE)


def local_token_reader(data: Path, *, only_sees: bool = False) -> Callable[[], str | None]:
    """Reads the token of the programs on this computer from the data folder, unless the environment has one. A system that starts makes
    another one. `only_sees`: the token has the right to see, and no other."""
    return lambda: token_of_environment() or local_token(data, only_sees=only_sees)


class ApiClient:
    """Carries out operations at the API below `url`. An asynchronous context manager.

    `token`: reads what proves who sends the requests. While a request of somebody else is worked on, it is what that one came with.
    """

    def __init__(self, url: str, token: Callable[[], str | None] = token_of_environment) -> None:
        self.url, self._token = url, token
        self._session: aiohttp.ClientSession | None = None

    @property
    def session(self) -> aiohttp.ClientSession:
        assert self._session is not None, "the context manager has been entered"
        return self._session

    async def __aenter__(self) -> ApiClient:
        timeout = aiohttp.ClientTimeout(total=ANSWER_TIME)
        self._session = aiohttp.ClientSession(timeout=timeout, connector=aiohttp.TCPConnector(limit=0, keepalive_timeout=KEPT_TIME))
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.session.close()

    @property
    def headers(self) -> dict[str, str]:
        """The headers that prove who sends a request made now."""
        identity = sender.get()
        secret = identity.secret if identity is not None else self._token()
        return {"Authorization": f"Bearer {secret}"} if secret else {}

    def part(self, group: str, declared: type[T]) -> T:
        """A part of the API: an object with the operations of the class `declared` as coroutine methods."""
        functions = {operation.name.partition(".")[2]: partial(self._call, operation) for operation in operations(group, declared)}
        return cast(T, _Part(functions))

    async def _call(self, operation: Operation, *args: object, **kwargs: object) -> object:
        values = _bound(operation, args, kwargs)
        places = {parameter.name: parameter.place for parameter in operation.parameters}
        path = operation.path.format(**{name: _segment(value) for name, value in values.items() if places[name] == "path"})
        query = {name: _text(value) for name, value in values.items() if places[name] == "query" and value is not None}
        body = next((msgspec.json.encode(value) for name, value in values.items() if places[name] == "body" and value is not None), None)
        url = f"{self.url}{path}{f'?{urlencode(query)}' if query else ''}"
        try:
            headers = self.headers | ({"Content-Type": JSON} if body is not None else {})
            async with self.session.request(operation.method, URL(url, encoded=True), data=body, headers=headers) as response:
                content = await response.read()
        except (aiohttp.ClientError, TimeoutError) as error:
            raise Unanswered(self.no_answer_text(error)) from None
        if response.status >= 400:
            raise self._refusal(response.status, content)
        return _answer(operation, content, response)

    def no_answer_text(self, error: BaseException) -> str:
        """The error text for a missing answer, with what to do about it."""
        return f"the API at {self.url} does not answer ({str(error) or 'in time'}); `somrs up` starts it and restarts it"

    def _refusal(self, status: int, content: bytes) -> Exception:
        try:
            return refusal(status, msgspec.json.decode(content, type=ErrorReport))
        except msgspec.MsgspecError:
            text = content[:500].decode(errors="replace").strip()  # of the server, before the API has seen the request
            problem = f"the API at {self.url} answered with HTTP {status}{': ' + text if text else ''}"
            return Unanswered(problem) if status in UNTAKEN else RemoteError(problem)


class _Part:
    """An object with the given functions as attributes."""

    def __init__(self, functions: Mapping[str, Callable[..., Awaitable[object]]]) -> None:
        self.__dict__.update(functions)


def address_of(addresses: Addresses) -> str:
    """The address of the system's API. Raises UsageError if the system has none."""
    if addresses.api is None:
        raise UsageError("this system was started without the API; `somrs up SITE` starts it with one, and `somrs run api` adds one")
    return addresses.api


def _bound(operation: Operation, args: tuple[object, ...], kwargs: dict[str, object]) -> dict[str, object]:
    """The values by parameter name. Raises TypeError, like a call with wrong arguments."""
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    signature = inspect.Signature(
        [inspect.Parameter(parameter.name, kind, default=parameter.default) for parameter in operation.parameters]
    )
    return signature.bind(*args, **kwargs).arguments


def _text(value: object) -> str:
    """The value as text for a path or a query string."""
    if isinstance(value, Enum):
        return str(value.value)
    return str(value).lower() if isinstance(value, bool) else str(value)


def _segment(value: object) -> str:
    """The value as a segment of a path. Raises UsageError if it cannot be one."""
    text = _text(value)
    if not text or "/" in text or not text.isprintable():
        raise UsageError(f"{text!r} is not a name: a name is not empty, is on one line, and contains no slash")
    return quote(text, safe="")


def _answer(operation: Operation, content: bytes, response: aiohttp.ClientResponse) -> object:
    if operation.returns is Document:
        disposition = Message()
        disposition["Content-Disposition"] = response.headers.get("Content-Disposition", "")
        return Document(content=content, media_type=response.headers.get("Content-Type", ""), name=disposition.get_filename() or "")
    returns: Any = operation.returns if operation.returns is not None else type(None)
    return msgspec.json.decode(content, type=returns)
