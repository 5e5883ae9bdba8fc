"""The API of a running system, for its clients: the parts, operations and news of `ApiService`, with a request over the network for each
operation."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import get_type_hints

from somrs.api.access import AccessService
from somrs.api.control import ControlService
from somrs.api.fleet import FleetService
from somrs.api.formulas import FormulaService
from somrs.api.map import MapService
from somrs.api.map_news import MapNews
from somrs.api.orders import OrderService
from somrs.api.owl import OwlService
from somrs.api.people import PeopleService
from somrs.api.questions import QuestionService
from somrs.api.records import RecordService
from somrs.api.scene import SceneService
from somrs.api.system import SystemService
from somrs.api.tasks import TaskService
from somrs.api.topics import TOPICS
from somrs.api.traffic import TrafficService
from somrs.api.trust import TrustService
from somrs.api.zones import ZoneService
from somrs.client.addresses import Addresses
from somrs.client.api_client import ApiClient, address_of, local_token_reader, token_of_environment
from somrs.client.hub import News
from somrs.client.live_news import LiveHub
from somrs.errors import RemoteError
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology

STARTUP_TIMEOUT = 60.0
"""Seconds to wait for the API at the start."""


class Api:
    """The parts of the API. The class of each attribute declares the operations; the API's process carries them out."""

    access: AccessService
    ontology: OwlService
    map: MapService
    tasks: TaskService
    fleet: FleetService
    control: ControlService
    formulas: FormulaService
    orders: OrderService
    people: PeopleService
    questions: QuestionService
    records: RecordService
    scene: SceneService
    system: SystemService
    traffic: TrafficService
    trust: TrustService
    zones: ZoneService

    def __init__(self, client: ApiClient) -> None:
        for group, declared in get_type_hints(Api).items():
            setattr(self, group, client.part(group, declared))


class _LiveContext:
    """A copy of the map and the ontology: read once, and updated with the news of `hub`."""

    def __init__(self, client: ApiClient, api: Api) -> None:
        self._api = api
        self.map, self.ontology = Map(), Ontology()
        self._versions = {"map": -1, "ontology": -1}
        self._updated = asyncio.Event()
        """Set, and replaced, with each update."""
        self.ready = asyncio.Event()
        self.hub = LiveHub(client, TOPICS, self, always=frozenset(self._versions))

    @property
    def version(self) -> int:
        """The version of the map and the ontology; -1 until they have been read."""
        return max(self._versions.values())

    async def read(self) -> None:
        await self._read_ontology()
        await self._read_map()
        self.ready.set()
        self._note_update()

    async def wait_for_version(self, version: int) -> None:
        """Wait until this copy contains a version, also while the connection is interrupted: afterwards, everything is read again."""
        while self.version < version:
            await self._updated.wait()

    def _note_update(self) -> None:
        self._updated.set()
        self._updated = asyncio.Event()

    async def apply_news(self, news: News) -> None:
        match news:
            case News(topic="map", value=MapNews(read=False) as map_news):
                # The map may already contain this change, if it was read after the change; versions arrive in ascending order.
                if map_news.version > self._versions["map"]:
                    self.map, self._versions["map"] = self.map.changed(map_news.changes), map_news.version
            case News(topic="map"):
                await self._read_map()
            case News(topic="ontology", value=value):
                await self._read_ontology()
                if isinstance(value, int):
                    self._versions["ontology"] = value  # the news of later versions, with their changes of the map, follow
        self._note_update()

    async def _read_map(self) -> None:
        map_view = await self._api.map.read()
        self.map, self._versions["map"] = Map(map_view.objects, map_view.facts, map_view.name), map_view.version

    async def _read_ontology(self) -> None:
        ontology_view = await self._api.ontology.read()
        self.ontology, self._versions["ontology"] = Ontology(ontology_view.definitions.all_definitions()), ontology_view.version


class LiveApi(Api):
    """The API and its news, for long-running programs. `context`: the local copy of the map and the ontology."""

    def __init__(self, client: ApiClient) -> None:
        super().__init__(client)
        self.client = client
        self.context = _LiveContext(client, self)


@asynccontextmanager
async def api_of(data: Path) -> AsyncIterator[Api]:
    """The API of the system that runs with this data folder, for short-lived programs. Raises UsageError if none runs, or has no API."""
    async with ApiClient(address_of(Addresses.read(data)), local_token_reader(data)) as client:
        yield Api(client)


@asynccontextmanager
async def live_api(url: str, token: Callable[[], str | None] = token_of_environment) -> AsyncIterator[LiveApi]:
    """The API at `url`, yielded when the map has been read. Later interruptions of the connection are handled. `token`: see `ApiClient`.

    Raises:
        RemoteError: the API did not answer within `STARTUP_TIMEOUT`.
    """
    async with ApiClient(url, token) as client:
        api = LiveApi(client)
        hub_task = asyncio.create_task(api.context.hub.run())
        try:
            try:
                async with asyncio.timeout(STARTUP_TIMEOUT):
                    await api.context.ready.wait()
            except TimeoutError:
                raise RemoteError(f"the API at {url} did not answer within {STARTUP_TIMEOUT:.0f} s; is it running?") from None
            yield api
        finally:
            hub_task.cancel()
            await asyncio.gather(hub_task, return_exceptions=True)
