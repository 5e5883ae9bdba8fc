"""How the tasks that a device submits reach the Task Managers of its system."""

from __future__ import annotations

from somrs.client.addresses import Addresses
from somrs.client.client import Client, Post
from somrs.errors import RemoteError
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.reservations import TaskAssigned
from somrs.protocol.messages.submission import Submit, Submitted
from somrs.protocol.messages.task_news import WatchTask
from somrs.runtime.wire import Unanswered


class DeviceTasks:
    """The requests of one device to the Task Managers. `post`: sends a message, and returns the answer; `patience`: seconds for which it is
    sent again while there is none."""

    def __init__(self, device: str, addresses: Addresses, post: Post, patience: float) -> None:
        self._client, self._patience = Client(addresses, post, device), patience

    async def ask(self, body: Body) -> Body:
        """Return the answer: a Submit goes to any Task Manager, a WatchTask to the one that has the task. Raises RemoteError."""
        managers = self._client.task_managers
        if isinstance(body, WatchTask):
            try:
                address = await managers.address_of(body.task, self._patience)
            except Unanswered:
                raise
            except RemoteError as error:
                return Fault(code="env:Sender", text=str(error))
            return await self._client.ask(address, body, Body, patience=self._patience)
        assert isinstance(body, Submit), "a device asks nothing else"
        answer = await managers.submit(body, self._patience, None, None)
        assert isinstance(answer, Body)
        return Submitted(task=answer.task) if isinstance(answer, TaskAssigned) else answer
