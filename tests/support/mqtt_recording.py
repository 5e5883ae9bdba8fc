"""Conversations over MQTT: each message with its topic and the seconds since the first one, as lines of JSON."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator
from pathlib import Path

import aiomqtt
from msgspec import Struct


class Spoken(Struct, frozen=True, kw_only=True):
    """A message of a conversation."""

    seconds: float
    topic: str
    payload: str


@contextlib.asynccontextmanager
async def recording(port: int, topics: str) -> AsyncIterator[list[Spoken]]:
    """Note what is said at a broker. `topics`: as MQTT subscribes to them, such as `uagv/#`."""
    conversation: list[Spoken] = []
    begun = time.monotonic()

    async def listen(client: aiomqtt.Client) -> None:
        async for message in client.messages:
            payload = message.payload.decode() if isinstance(message.payload, bytes) else str(message.payload)
            seconds = round(time.monotonic() - begun, 3)
            conversation.append(Spoken(seconds=seconds, topic=message.topic.value, payload=payload))

    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe(topics)
        listening = asyncio.create_task(listen(client))
        try:
            yield conversation
        finally:
            listening.cancel()
            await asyncio.wait({listening})


def write_conversation(path: Path, conversation: list[Spoken]) -> None:
    lines = [json.dumps({"seconds": spoken.seconds, "topic": spoken.topic, "payload": spoken.payload}) for spoken in conversation]
    path.write_text("\n".join(lines) + "\n")


def read_conversation(path: Path) -> list[Spoken]:
    return [Spoken(**json.loads(line)) for line in path.read_text().splitlines()]
