"""How the tasks that a device submits reach the Task Managers of its system."""

from __future__ import annotations

import uuid
from collections.abc import Awaitable, Callable, Mapping
from typing import TypeVar

from somrs.client.task_managers import TaskManagers
from somrs.errors import RemoteError
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.people import client_address
from somrs.protocol.messages.reservations import TaskAssigned
from somrs.protocol.messages.submission import Submit, Submitted
from somrs.protocol.messages.task_news import WatchTask
from somrs.runtime.wire import Unanswered, retry_unanswered

Answer = TypeVar("Answer")


class DeviceTasks:
    """The requests of one device to the Task Managers with these addresses. `request`: sends a message once, and returns the answer;
    `patience`: seconds for which it is sent again while there is none."""

    def __init__(
        self, device: str, addresses: Mapping[str, str], request: Callable[[Message], Awaitable[Message]], patience: float
    ) -> None:
        self._sender, self._request, self._patience = client_address(device), request, patience
        self._managers = TaskManagers(addresses, self._ask)

    async def ask(self, body: Body) -> Body:
        """Return the answer: a Submit goes to any Task Manager, a WatchTask to the one that has the task. Raises RemoteError."""
        if isinstance(body, WatchTask):
            try:
                address = await self._managers.address_of(body.task, self._patience)
            except Unanswered:
                raise
            except RemoteError as error:
                return Fault(code="env:Sender", text=str(error))
            return await self._ask(address, body, Body, patience=self._patience)
        assert isinstance(body, Submit), "a device asks nothing else"
        answer = await self._managers.submit(body, self._patience, None, None)
        assert isinstance(answer, Body)
        return Submitted(task=answer.task) if isinstance(answer, TaskAssigned) else answer

    async def _ask(
        self,
        address: str,
        body: Body,
        expected: type[Answer],
        timeout: float = 30.0,
        patience: float = 0.0,
        id: str | None = None,
        author: str | None = None,
    ) -> Answer:
        message = Message(header=Header(sender=self._sender, recipient=address, message_id=id or uuid.uuid4().urn), body=body)
        answer = (await retry_unanswered(lambda: self._request(message), patience)).body
        if isinstance(answer, expected):
            return answer
        raise RemoteError(
            answer.text if isinstance(answer, Fault) else f"{address} answered {type(body).__name__} with {type(answer).__name__}"
        )
