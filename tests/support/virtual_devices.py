"""Runs authors' coroutines on virtual time, for tests that run whole systems in one process."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Coroutine, Generator
from typing import Any

from somrs.errors import RemoteError
from somrs.kernel.component import Component, Received, Send
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.runtime.virtual_time import CarryOut, Work
from somrs.service_manager.sdk.device import Device
from somrs.service_manager.sdk.map_reader import Ask
from somrs.service_manager.sdk.orders import Halt, Perform, Quote, Report, Undo
from somrs.service_manager.sdk.service_runner import carry_out


class Pause:
    """`await Pause(30)`: 30 seconds of virtual time."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds

    def __await__(self) -> Generator[float, None, None]:
        yield self.seconds


def make_ask(component: Component, now: Callable[[], float]) -> Ask:
    """Return a function that asks a component directly."""

    numbers = itertools.count()

    async def ask(body: Body) -> Body:
        header = Header(sender="http://here/device", recipient="http://here", message_id=message_id("ask", next(numbers)))
        effects = component.handle(Received(Message(header=header, body=body)), now())
        return next(effect.message.body for effect in effects if isinstance(effect, Send))

    return ask


async def _no_repository(body: Body) -> Body:
    raise RemoteError("there is no Repository here")


def in_virtual_time(device: Device, ask: Ask = _no_repository, reports: list[Report] | None = None) -> CarryOut:
    """Return a function that carries the device's work out. The author's coroutines may wait only with `Pause`."""

    running: dict[str, Coroutine[Any, Any, object]] = {}

    def work(task: object) -> Work:
        if isinstance(task, Report):
            if reports is not None:
                reports.append(task)
            yield 0.0, None
            return
        assert isinstance(task, Quote | Perform | Halt | Undo)
        if isinstance(task, Halt) and (interrupted := running.pop(task.order.participant, None)) is not None:
            interrupted.close()  # the author's `finally` runs, as it does when asyncio cancels
        advances: list[object] = []
        coroutine = carry_out(device, task, ask, advances.append)
        if isinstance(task, Perform | Undo):
            running[task.order.participant] = coroutine
        yield from _played(coroutine, advances)

    return work


def _played(running: Coroutine[Any, Any, object], advances: list[object]) -> Work:
    waited, pause = 0.0, 0.0
    result: list[object] = []
    while not result:
        try:
            pause = running.send(None)
        except StopIteration as stop:
            result.append(stop.value)
        except Exception as error:  # noqa: BLE001  # any error is an answer, as in runtime/node.py
            result.append(error)
        for advance in advances:
            yield waited, advance
            waited = 0.0
        advances.clear()
        waited += pause
        pause = 0.0
    yield waited, result[0]
