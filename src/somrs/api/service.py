"""All parts of the public API, in one process that follows the running system."""

from __future__ import annotations

import uuid
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

from somrs.api.access import AccessService
from somrs.api.context import Context
from somrs.api.control import ControlService
from somrs.api.fleet import FleetService
from somrs.api.formulas import FormulaService
from somrs.api.listener import Listener
from somrs.api.map import MapService
from somrs.api.orders import OrderService
from somrs.api.owl import OwlService
from somrs.api.people import PeopleService
from somrs.api.questions import QuestionService
from somrs.api.records import RecordService
from somrs.api.scene import SceneService
from somrs.api.system import SystemService
from somrs.api.tasks import TaskService
from somrs.api.traffic import TrafficService
from somrs.api.trust import TrustService
from somrs.api.zones import ZoneService
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.client.credentials import credentials_for
from somrs.client.hub import Hub
from somrs.client.operations import Operation, operations
from somrs.deployment.programs import others_ready
from somrs.runtime.host import Host


class ApiService:
    """The parts of the API. The name of each attribute is the group of the part's operations: `map.change`."""

    def __init__(self, context: Context) -> None:
        self.context = context
        self.access = AccessService(context)
        orders, traffic = OrderService(context), TrafficService(context)
        self.ontology = OwlService(context, orders)
        self.map = MapService(context)
        self.tasks = TaskService(context)
        self.fleet = FleetService(context)
        self.control = ControlService(context, traffic)
        self.formulas = FormulaService(context)
        self.orders = orders
        self.people = PeopleService(context)
        self.questions = QuestionService(context)
        self.records = RecordService(context)
        self.scene = SceneService(context)
        self.system = SystemService(context)
        self.traffic = traffic
        self.trust = TrustService(context)
        self.zones = ZoneService(context)

    def operations(self) -> Iterator[Operation]:
        for group, part in vars(self).items():
            if group != "context":
                yield from operations(group, part)


@asynccontextmanager
async def open_api_service(addresses: Addresses, data: Path, host: str = "127.0.0.1") -> AsyncIterator[ApiService]:
    """Follow a running system, and yield its API service when the map has been read."""
    hub, runtime = Hub(), Host(host, bus=addresses.bus, credentials=credentials_for(addresses))
    await runtime.start()
    # On a bus, there may be several programs that follow the system.
    path = "/news" if addresses.bus is None else f"/news/{uuid.uuid4().hex}"
    listener = Listener(f"{runtime.url}{path}", addresses, hub)
    runtime.add(path, lambda address: listener)
    try:
        async with Client(addresses, runtime.post) as client:
            await others_ready(listener.ready.wait(), lambda: f"no map came from {addresses.repository} yet; is the Repository running?")
            yield ApiService(Context(addresses=addresses, data=data, client=client, listener=listener, hub=hub))
    finally:
        await hub.close()
        await runtime.stop()
