"""A small room with two robots for tests of simulated robots over TCP, and functions that load and serve such a site."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager

from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.entish.formula import variables
from somrs.entish.parse import parse
from somrs.ontology.files.loaded import LoadedModel
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.truth import formula_holds
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.repository.update import update_outcome
from somrs.service_manager.sdk.device import Device
from somrs.service_manager.sdk.orders import Advance, Halt, Perform, Quote, Undo
from somrs.service_manager.sdk.service_runner import carry_out
from tests.support.building import building
from tests.support.hang import HANG_TIME
from tests.support.virtual_devices import make_ask

SITE = (
    building("Lab", 8, 6, "Wall1: {type: Wall, at: [4, 0.8, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.6, Height: 2.5}}")
    + """
  Table1: {type: Table, at: [1, 4, 0], Shape: {Form: Box, Width: 0.6, Depth: 1, Height: 0.7}}
  Platform1: {type: Platform, at: [6.5, 4, 0], Shape: {Form: Box, Width: 0.8, Depth: 0.8, Height: 0.3}}
  Jar1: {type: Jar, at: [1.15, 4, 0.7]}
  Anvil1: {type: Carton, at: [1.1, 3.65, 0.7], Weight: 4}
  Robot1: {type: PioneerP3DX, at: [2, 1.5, 0], Price: 10 EUR, Speed: 0.8}
  Robot2: {type: PioneerP3DX, at: [6, 1.5, 0], Price: 25 EUR, Speed: 1.0}
facts:
  - Jar1 isOn Table1
  - Anvil1 isOn Table1
"""
)


def site(text: str = SITE) -> tuple[LoadedModel, Map]:
    loaded = load_text(text, base=upper())
    assert loaded.map is not None
    return loaded, loaded.map


def map_after(situation: str | None, text: str = SITE) -> Map:
    """Return the site's map after the situation, in Entish, was reported to its Repository."""
    assert situation is not None
    loaded, map = site(text)
    outcome = update_outcome(map, loaded.ontology, UpdateMap(situation=situation))
    assert not outcome.broken
    formula = parse(situation)
    assert variables(formula) or formula_holds(formula, outcome.map, loaded.ontology)
    return outcome.map


def repository(text: str = SITE) -> Repository:
    loaded, map = site(text)
    return Repository("http://here/repository", Contents(ontology=loaded.ontology, map=map))


async def run_work(device: Device, work: Quote | Perform | Halt | Undo, repository: Repository, advances: list[Advance]) -> object:
    """Let the device do the work as its Service Manager does, and collect what it reports meanwhile."""

    def note_advance(report: object) -> None:
        assert isinstance(report, Advance)
        advances.append(report)

    return await carry_out(device, work, make_ask(repository, lambda: 0.0), note_advance)


@asynccontextmanager
async def simulator(speed: float | None = None, text: str = SITE, world: WorldKind = WorldKind.PHYSICS) -> AsyncIterator[Server]:
    """Serve the site at a free port."""
    loaded, map = site(text)
    server = Server(Simulation(map, loaded.ontology, world), speed=speed)
    await server.start()
    try:
        yield server
    finally:
        await server.stop()


def run(test: Coroutine[object, object, None]) -> None:
    """Run a test's coroutine. Tests take seconds; the limit is for one that hangs, and allows for a busy machine."""
    asyncio.run(asyncio.wait_for(test, HANG_TIME))
