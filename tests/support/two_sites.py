"""A barn and a yard behind it, each with a system, a robot and an authority of its own, at hosts of their own."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from pathlib import Path

from somrs.deployment.ports_of_programs import Part
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ports import free_range
from somrs.trust.authority import Authority
from tests.support import warm
from tests.support.shared_yard import SITES as SHARED_SITES

_BENCH = "  BarnBench: {type: Platform, at: [6, 3, 0], Shape: {Form: Box, Width: 0.6, Depth: 0.6, Height: 0.3}}\n"
SITES = SHARED_SITES | {"Barn": SHARED_SITES["Barn"].replace("  Jar1:", f"{_BENCH}  Jar1:")}
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


def write_neighbours(folder: Path, ports: dict[str, int], further: str = "") -> None:
    """Each site's file with the other one as its neighbour. `ports`: their first ports. `further`: what else the files say."""
    for name in SITES:
        [neighbour] = (site for site in SITES if site != name)
        url = f"https://{HOSTS[neighbour]}"
        addresses = f"registry: '{url}:{ports[neighbour] + 1}/registry', repository: '{url}:{ports[neighbour]}/repository'"
        trust = f"trust: '{url}:{ports[neighbour] + Part.TRUST}', authority: {neighbour}.pem{further}"
        passing = "takes: all, gives: all, shows: all, changes: true"
        (folder / f"neighbours-of-{name}.yaml").write_text(f"{neighbour}: {{{addresses}, {passing}, {trust}}}\n")


@contextlib.asynccontextmanager
async def two_sites(folder: Path) -> AsyncIterator[tuple[System, System]]:
    """The systems of the barn and of the yard, as soon as both run."""
    first = free_range(HOSTS["Barn"], 2 * _PORTS)
    ports = {"Barn": first, "Yard": first + _PORTS}
    make_authorities(folder)
    write_neighbours(folder, ports)
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
                neighbours=folder / f"neighbours-of-{name}.yaml",
                first_port=ports[name],
                launcher=warm.launcher(),
            )
        )
    async with contextlib.AsyncExitStack() as stack:
        await asyncio.gather(*map(stack.enter_async_context, systems))
        yield systems[0], systems[1]
