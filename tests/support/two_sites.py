"""A barn and a yard behind it: two maps with the same coordinates, each with a system, a robot and an authority of its own, at hosts of
their own."""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from pathlib import Path

from somrs.deployment.ports_of_programs import Part
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ports import free_range
from somrs.trust.authority import Authority
from tests.support import warm

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
    + "  BarnBench: {type: Platform, at: [6, 3, 0], Shape: {Form: Box, Width: 0.6, Depth: 0.6, Height: 0.3}}\n"
    + "  Jar1: {type: Jar, at: [1.5, 3, 0.3]}\nfacts:\n  - Jar1 isOn BarnTable\n",
    "Yard": _BUILDING.format(map="Yard", middle=12, table=14.5, robot=13)
    + "  Ramp: {type: Platform, at: [8.5, 3, 0], Shape: {Form: Box, Width: 0.6, Depth: 0.6, Height: 0.3}}\n",
}
HOSTS = {"Barn": "127.0.0.1", "Yard": "127.0.0.2"}
"""With certificates, the addresses of neighbours are told apart by their hosts."""
_PORTS = 20
"""How many ports a system needs."""


def make_authorities(folder: Path) -> dict[str, Authority]:
    """The authorities of both, each of which has given its certificate to the other one."""
    authorities = {}
    for name in SITES:
        authority = authorities[name] = Authority.of_data(folder / name)
        authority.create("site", datetime.now(UTC))  # of the same name: it is not by this that they are told apart
        (folder / f"{name}.pem").write_text(authority.public_certificate)
    return authorities


def write_neighbours(folder: Path, ports: dict[str, int], *, shares_simulator: bool) -> None:
    """Each site's file with the other one as its neighbour. `ports`: their first ports. In one simulated world, each uses its own robot."""
    for name in SITES:
        [neighbour] = (site for site in SITES if site != name)
        url = f"https://{HOSTS[neighbour]}"
        addresses = f"registry: '{url}:{ports[neighbour] + 1}/registry', repository: '{url}:{ports[neighbour]}/repository'"
        trust = f"trust: '{url}:{ports[neighbour] + Part.TRUST}', authority: {neighbour}.pem"
        offers = "simulates: true, takes: nothing, gives: nothing" if shares_simulator else "takes: all, gives: all"
        passing = f"{offers}, shows: all, changes: true"
        (folder / f"neighbours-of-{name}.yaml").write_text(f"{neighbour}: {{{addresses}, {passing}, {trust}}}\n")


@contextlib.asynccontextmanager
async def two_sites(folder: Path, simulator: str | None = None) -> AsyncIterator[tuple[System, System]]:
    """The systems of the barn and of the yard, as soon as both run. `simulator`: that of both, of which the barn has the certificate."""
    first = free_range(HOSTS["Barn"], 2 * _PORTS)
    ports = {"Barn": first, "Yard": first + _PORTS}
    make_authorities(folder)
    write_neighbours(folder, ports, shares_simulator=simulator is not None)
    systems: list[System] = []
    for name, site in SITES.items():
        (folder / f"{name}.yaml").write_text(site)
        systems.append(
            System(
                [folder / f"{name}.yaml"],
                folder / name,
                host=HOSTS[name],
                world=WorldKind.KINEMATIC,
                speed="max",
                world_address=simulator,
                neighbours=folder / f"neighbours-of-{name}.yaml",
                first_port=ports[name],
                launcher=warm.launcher(),
            )
        )
    async with contextlib.AsyncExitStack() as stack:
        if simulator is not None:
            repositories = [f"https://{HOSTS[name]}:{port}/repository" for name, port in ports.items()]
            await stack.enter_async_context(_simulator(repositories, simulator, folder))
        await asyncio.gather(*map(stack.enter_async_context, systems))
        yield systems[0], systems[1]


@contextlib.asynccontextmanager
async def barn_and_yard(folder: Path) -> AsyncIterator[tuple[System, System, str]]:
    """The systems of the barn and of the yard, and the address of their simulator."""
    simulator = f"{HOSTS['Barn']}:{free_range(HOSTS['Barn'], 3 * _PORTS) + 3 * _PORTS - 1}"
    async with two_sites(folder, simulator) as (barn, yard):
        yield barn, yard, f"tls://{simulator}"


@contextlib.asynccontextmanager
async def _simulator(repositories: list[str], address: str, folder: Path) -> AsyncIterator[None]:
    """A simulator that starts now, and is ready when the Repositories are there."""
    launcher = warm.launcher()
    options = [option for repository in repositories for option in ("--repository", repository)]
    port, data = address.rpartition(":")[2], str(folder / "Barn")
    arguments = ["run", "simulator", *options, "--port", port, "--world", "kinematic", "--speed", "max", "--data", data]
    process = await launcher.start(arguments, folder / "simulator.log", dict(os.environ))
    try:
        yield
        assert b"simulator" in await process.stdout.readline(), "it was ready"
    finally:
        process.kill()
        await process.wait()
        await launcher.stop()
