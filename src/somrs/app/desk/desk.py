"""The desk: all parts of the public API together, in one process that follows the running system."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

from somrs.app.client import Addresses, Client
from somrs.app.desk.context import Context
from somrs.app.desk.fleet import FleetDesk
from somrs.app.desk.formulas import FormulasDesk
from somrs.app.desk.hub import Hub
from somrs.app.desk.listener import Listener
from somrs.app.desk.map import MapDesk
from somrs.app.desk.operations import Operation, operations
from somrs.app.desk.orders import OrdersDesk
from somrs.app.desk.owl import OwlDesk
from somrs.app.desk.questions import QuestionsDesk
from somrs.app.desk.records import RecordsDesk
from somrs.app.desk.scene import SceneDesk
from somrs.app.desk.scheduler import Clock
from somrs.app.desk.system import SystemDesk
from somrs.app.desk.tasks import TasksDesk
from somrs.app.host import Host
from somrs.errors import RemoteError

MAP_TIME = 60.0
"""Seconds that the map is waited for at the start."""


class Desk:
    """Each attribute is a part of the API; its operations are named after it."""

    def __init__(self, context: Context, clock: Clock | None = None) -> None:
        self.context = context
        orders = OrdersDesk(context, clock)
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
async def desk_of(addresses: Addresses, data: Path, host: str = "127.0.0.1", clock: Clock | None = None) -> AsyncIterator[Desk]:
    """The desk of a running system, once the map was read. Orders are kept while `desk.orders.running()`, by one process at a time;
    `clock` is what they go by."""
    hub, rim = Hub(), Host(host)
    await rim.start()
    listener = Listener(f"{rim.url}/desk", addresses.repository, addresses.registry, hub)
    rim.add("/desk", lambda address: listener)
    try:
        async with Client(addresses) as client:
            async with asyncio.timeout(MAP_TIME):
                await listener.ready.wait()
            yield Desk(Context(addresses=addresses, data=data, client=client, listener=listener, hub=hub), clock)
    except TimeoutError:
        raise RemoteError(f"no map came from {addresses.repository} within {MAP_TIME:.0f} s; is the Repository running?") from None
    finally:
        await hub.close()
        await rim.stop()
