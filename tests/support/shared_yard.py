"""A barn and a yard behind it: two maps with the same coordinates, each with a system and a robot, in one simulated world."""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator
from pathlib import Path

from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ports import free_range
from tests.support import warm

HOST = "127.0.0.1"
PORTS = 40
"""How many ports two systems and a simulator need."""
_BUILDING = """
map: {map}
objects:
  {map}Building:
    type: Building
    parts:
      {map}Storey:
        type: Storey
        parts:
          {map}Floor: {{type: Floor, at: [{middle}, 3, -0.1], Shape: {{Form: Box, Width: 8, Depth: 6, Height: 0.1}}}}
  {map}Table: {{type: Platform, at: [{table}, 3, 0], Shape: {{Form: Box, Width: 0.6, Depth: 0.6, Height: 0.3}}}}
  {map}Robot: {{type: PioneerP3DX, at: [{robot}, 1.5, 0], Price: 10 EUR}}
"""
SITES = {
    "Barn": _BUILDING.format(map="Barn", middle=4, table=1.5, robot=3)
    + "  Jar1: {type: Jar, at: [1.5, 3, 0.3]}\nfacts:\n  - Jar1 isOn BarnTable\n",
    "Yard": _BUILDING.format(map="Yard", middle=12, table=14.5, robot=13)
    + "  Ramp: {type: Platform, at: [8.5, 3, 0], Shape: {Form: Box, Width: 0.6, Depth: 0.6, Height: 0.3}}\n",
}


@contextlib.asynccontextmanager
async def barn_and_yard(folder: Path) -> AsyncIterator[tuple[System, System, str]]:
    """The systems of the barn and of the yard, and the address of the simulator."""
    first = free_range(HOST, PORTS)
    ports = {"Barn": first, "Yard": first + 15}
    simulator = f"{HOST}:{first + PORTS - 1}"
    systems: list[System] = []
    for name, site in SITES.items():
        [(neighbour, neighbour_port)] = ((other, port) for other, port in ports.items() if other != name)
        (folder / f"{name}.yaml").write_text(site)
        neighbours = folder / f"neighbours-of-{name}.yaml"
        addresses = f"registry: 'http://{HOST}:{neighbour_port + 1}/registry', repository: 'http://{HOST}:{neighbour_port}/repository'"
        neighbours.write_text(f"{neighbour}: {{{addresses}, takes: nothing, gives: nothing, shows: all, changes: true}}\n")
        systems.append(
            System(
                [folder / f"{name}.yaml"],
                folder / name,
                world=WorldKind.KINEMATIC,
                world_address=simulator,
                neighbours=neighbours,
                first_port=ports[name],
                launcher=warm.launcher(),
                certificates=False,
            )
        )
    repositories = [f"http://{HOST}:{port}/repository" for port in ports.values()]
    async with contextlib.AsyncExitStack() as stack:
        await stack.enter_async_context(_simulator(repositories, simulator, folder / "simulator"))
        await asyncio.gather(*map(stack.enter_async_context, systems))
        yield systems[0], systems[1], simulator


@contextlib.asynccontextmanager
async def _simulator(repositories: list[str], address: str, folder: Path) -> AsyncIterator[None]:
    """A simulator that starts now, and is ready when the Repositories are there."""
    folder.mkdir()
    launcher = warm.launcher()
    options = [option for repository in repositories for option in ("--repository", repository)]
    port = address.rpartition(":")[2]
    arguments = ["run", "simulator", *options, "--port", port, "--world", "kinematic", "--speed", "max", "--data", str(folder)]
    process = await launcher.start(arguments, folder / "simulator.log", dict(os.environ))
    try:
        yield
        assert b"simulator" in await process.stdout.readline(), "it was ready"
    finally:
        process.kill()
        await process.wait()
        await launcher.stop()
