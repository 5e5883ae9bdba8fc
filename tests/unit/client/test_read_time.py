"""A reader is told soon that a component does not answer now, whatever is read."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.client.task_managers import READ_TIME
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.knowledge import ReadEvents
from somrs.protocol.messages.records import ReadRecords
from somrs.runtime.wire import Unanswered

READERS: dict[str, Callable[[Client], Awaitable[object]]] = {
    "tasks": lambda client: client.rows(),
    "views of tasks": lambda client: client.tasks(),
    "a task": lambda client: client.read_task("urn:uuid:1"),
    "messages": lambda client: client.all_messages("urn:uuid:1"),
    "records": lambda client: client.records(ReadRecords()),
    "services": lambda client: client.services(),
    "presence": lambda client: client.presence(),
    "ontology": lambda client: client.ontology(),
    "map": lambda client: client.map(),
    "history": lambda client: client.history("Jar1"),
    "events": lambda client: client.read_events(ReadEvents()),
}


@pytest.mark.parametrize("reader", READERS)
def test_a_component_that_does_not_answer(reader: str) -> None:
    async def post(message: Message, seconds: float) -> Message | None:
        assert seconds <= READ_TIME
        raise Unanswered(f"{message.header.recipient} did not answer within {seconds:g} s")

    async def run() -> None:
        addresses = Addresses(repository="http://a/repository", registry="http://a/registry", task_manager="http://a/task-manager")
        async with Client(addresses, post) as client:
            with pytest.raises(Unanswered, match=r"did not answer within .* s; `somrs status` shows what answers; try again$"):
                await READERS[reader](client)

    asyncio.run(run())
