"""A small room with two robots for tests of simulated robots over TCP, and functions that load and serve such a site."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager

from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.server.simulation import Simulation
from somrs.entish.parse import parse
from somrs.ontology.check import check
from somrs.ontology.effects import changes
from somrs.ontology.files.loading import LoadedModel, load_text, upper
from somrs.ontology.objects import Map
from somrs.ontology.truth import formula_holds
from tests.support.hang import HANG_TIME

SITE = """
map: Lab
objects:
  Building1:
    type: Building
    parts:
      Storey1:
        type: Storey
        parts:
          Floor1: {type: Floor, at: [4, 3, -0.1], Shape: {Form: Box, Width: 8, Depth: 6, Height: 0.1}}
          Wall1: {type: Wall, at: [4, 0.8, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.6, Height: 2.5}}
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


def site(text: str = SITE) -> tuple[LoadedModel, Map]:
    loaded = load_text(text, base=upper())
    assert loaded.map is not None
    return loaded, loaded.map


def map_after(situation: str | None, text: str = SITE) -> Map:
    """Return the site's map after the situation, in Entish, was made to hold."""
    assert situation is not None
    loaded, map = site(text)
    formula = check(parse(situation), loaded.ontology, map)
    changed = map.changed(changes(formula, map, loaded.ontology))
    assert formula_holds(formula, changed, loaded.ontology)
    return changed


@asynccontextmanager
async def simulator(speed: float | None = None, text: str = SITE) -> AsyncIterator[Server]:
    """Serve the site at a free port."""
    loaded, map = site(text)
    server = Server(Simulation(map, loaded.ontology), speed=speed)
    await server.start()
    try:
        yield server
    finally:
        await server.stop()


def run(test: Coroutine[object, object, None]) -> None:
    """Run a test's coroutine. Tests take seconds; the limit is for one that hangs, and allows for a busy machine."""
    asyncio.run(asyncio.wait_for(test, HANG_TIME))
