"""The running system as a whole: its components, and whether each of them answers."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from functools import partial

import msgspec
from msgspec.structs import replace

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.client.addresses import Addresses
from somrs.client.client import NOBODY
from somrs.client.operations import operation
from somrs.client.simulator_link import operator_link
from somrs.deployment.incidents import Incident, read_incidents
from somrs.errors import SomrsError
from somrs.ontology.types import ABSTRACT
from somrs.protocol.messages.directory import Discover, Discovered, NeighbourView
from somrs.protocol.messages.neighbours import MapNeighbourView
from somrs.protocol.messages.orders import ReadTemplates, TemplatesPage
from somrs.protocol.messages.task_news import ReadTasks, Tasks
from somrs.protocol.messages.traffic import ReadRoadmap, RoadmapPage
from somrs.version import __version__

PATIENCE = 2.0
"""Seconds within which a component has to answer."""

OFFSET_BEYOND_ALL = 1_000_000
"""An offset greater than the number of definitions, and of places: the Repository and traffic return an empty page quickly."""

NAME_BEYOND_ALL = "\U0010fffd"
"""A name that sorts after all others: the Scheduler returns an empty page quickly."""

TASK_MANAGER, REGISTRY = "Task Manager", "Service Registry"
"""The name of the Task Manager, and of the Registry, or the kind of each if there are several."""

TICK = 5.0
"""Seconds between two checks of the components while a client follows them."""


class PartView(msgspec.Struct, frozen=True, kw_only=True):
    """A component of the system. `milliseconds`: its response time; None if it did not answer: `problem` says why. `kind`: the name of its
    kind, if there are several."""

    name: str
    address: str
    milliseconds: float | None = None
    problem: str = ""
    kind: str = ""


class SystemView(msgspec.Struct, frozen=True, kw_only=True):
    """The running system. `site`: the label of its site; `data`: its data folder; `neighbours`: those of its Registry; `map`: the name of
    its map; `neighbouring_maps`: those of neighbours whose objects are on it; `incidents`: the latest programs that ended or hung."""

    version: str
    site: str
    data: str
    objects: int
    types: int
    map_version: int
    parts: tuple[PartView, ...]
    neighbours: tuple[NeighbourView, ...] = ()
    map: str = ""
    neighbouring_maps: tuple[MapNeighbourView, ...] = ()
    incidents: tuple[Incident, ...] = ()


class SystemService:
    def __init__(self, context: Context) -> None:
        self._context = context
        context.hub.feed("system", self._feed)

    @operation("GET", "/system", Right.SEE)
    async def read(self) -> SystemView:
        """Read the version and the size of the system, and check whether each component answers.

        The topic `system` publishes the same every few seconds.
        """
        context, addresses = self._context, self._context.addresses
        neighbouring_maps: list[MapNeighbourView] = []

        async def ask_repository() -> None:
            neighbouring_maps.extend((await context.client.map_neighbours()).neighbours)

        probes: list[tuple[str, str, Callable[[], Awaitable[object]]]] = [("Repository", addresses.repository, ask_repository)]
        registries = addresses.registries
        for name, address in registries.items():
            asking = partial(context.client.ask, address, Discover(provider=NOBODY), Discovered)
            probes.append((name if len(registries) > 1 else REGISTRY, address, asking))
        managers = context.client.task_managers
        for name, address in managers.addresses.items():
            probes.append(
                (name if managers.several else TASK_MANAGER, address, partial(context.client.ask, address, ReadTasks(limit=0), Tasks))
            )
        if (scheduler := addresses.scheduler) is not None:
            probes.append(
                ("Scheduler", scheduler, lambda: context.client.ask(scheduler, ReadTemplates(after=NAME_BEYOND_ALL), TemplatesPage))
            )
        if (simulator := addresses.simulator) is not None:
            probes.append(("Simulator", simulator, lambda: _clock(addresses)))
        if (traffic := addresses.traffic) is not None:
            probes.append(("Traffic", traffic, lambda: context.client.ask(traffic, ReadRoadmap(after=OFFSET_BEYOND_ALL), RoadmapPage)))
        parts = await asyncio.gather(*(_probe_part(*probe) for probe in probes))
        kinds = dict.fromkeys(registries, REGISTRY) | dict.fromkeys(managers.addresses, TASK_MANAGER)
        parts = [replace(part, kind=kinds.get(part.name, "")) for part in parts]
        if addresses.api is not None:
            parts.append(PartView(name="API", address=addresses.api, milliseconds=0.0))  # this response proves that it answers
        map, ontology = context.map, context.ontology
        site = next((name for name in map.roots() if ontology.is_subtype(map.objects[name].type, ABSTRACT)), "")
        return SystemView(
            version=__version__,
            site=str(map.objects[site].values.get("Label", site)) if site else "",
            data=str(context.data),
            objects=len(map.objects),
            types=len(ontology.types),
            map_version=context.version,
            parts=tuple(parts),
            neighbours=await self._neighbours(),
            map=map.name,
            neighbouring_maps=tuple(neighbouring_maps),
            incidents=await asyncio.to_thread(read_incidents, context.data),
        )

    async def _neighbours(self) -> tuple[NeighbourView, ...]:
        """The neighbours of the Registry; none if it does not answer."""
        try:
            async with asyncio.timeout(PATIENCE):
                return await self._context.client.neighbours()
        except (TimeoutError, SomrsError):
            return ()

    async def _feed(self, topic: str) -> None:
        while True:
            self._context.hub.publish(topic, await self.read())
            await asyncio.sleep(TICK)


async def _probe_part(name: str, address: str, ask: Callable[[], Awaitable[object]]) -> PartView:
    start_time = time.perf_counter()
    try:
        async with asyncio.timeout(PATIENCE):
            await ask()
    except TimeoutError:
        return PartView(name=name, address=address, problem=f"no answer within {PATIENCE:g} s")
    except SomrsError as error:
        return PartView(name=name, address=address, problem=str(error))
    return PartView(name=name, address=address, milliseconds=round(1000 * (time.perf_counter() - start_time), 1))


async def _clock(addresses: Addresses) -> object:
    async with operator_link(addresses) as operator:
        return await operator.clock()
