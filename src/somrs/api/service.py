"""The desk: all parts of the public API together, in one process that follows the running system."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

from somrs.api.context import Context
from somrs.api.fleet import FleetDesk
from somrs.api.formulas import FormulasDesk
from somrs.api.listener import Listener
from somrs.api.map import MapDesk
from somrs.api.orders import OrdersDesk
from somrs.api.owl import OwlDesk
from somrs.api.questions import QuestionsDesk
from somrs.api.records import RecordsDesk
from somrs.api.scene import SceneDesk
from somrs.api.system import SystemDesk
from somrs.api.tasks import TasksDesk
from somrs.client.client import Addresses, Client
from somrs.client.hub import Hub
from somrs.client.operations import Operation, operations
from somrs.errors import RemoteError
from somrs.runtime.host import Host

MAP_TIME = 60.0
"""Seconds that the map is waited for at the start."""


class Desk:
    """Each attribute is a part of the API; its operations are named after it."""

    def __init__(self, context: Context) -> None:
        self.context = context
        orders = OrdersDesk(context)
        self.ontology = OwlDesk(context, orders)
        self.map = MapDesk(context)
        self.tasks = TasksDesk(context)
        self.fleet = FleetDesk(context)
        self.formulas = FormulasDesk(context)
        self.orders = orders
        self.questions = QuestionsDesk(context)
        self.records = RecordsDesk(context)
        self.scene = SceneDesk(context)
        self.system = SystemDesk(context)

    def operations(self) -> Iterator[Operation]:
        for group, part in vars(self).items():
            if group != "context":
                yield from operations(group, part)


@asynccontextmanager
async def desk_of(addresses: Addresses, data: Path, host: str = "127.0.0.1") -> AsyncIterator[Desk]:
    """The desk of a running system, once the map was read."""
    hub, rim = Hub(), Host(host)
    await rim.start()
    listener = Listener(f"{rim.url}/desk", addresses, hub)
    rim.add("/desk", lambda address: listener)
    try:
        async with Client(addresses) as client:
            async with asyncio.timeout(MAP_TIME):
                await listener.ready.wait()
            yield Desk(Context(addresses=addresses, data=data, client=client, listener=listener, hub=hub))
    except TimeoutError:
        raise RemoteError(f"no map came from {addresses.repository} within {MAP_TIME:.0f} s; is the Repository running?") from None
    finally:
        await hub.close()
        await rim.stop()
