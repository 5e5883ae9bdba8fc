"""The adapter for Pioneer robots with ARCOS: a device for each robot of the settings."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from somrs.adapters.adapter import Fleet
from somrs.adapters.arcos.robot import ArcosRobot
from somrs.adapters.arcos.settings import read_settings, robot_parameters
from somrs.adapters.arcos.simulated.link_body import serve_simulated
from somrs.errors import Mistake
from somrs.sites.references import Site


class ArcosAdapter:
    """Connects Pioneer robots, each by a port of its own."""

    def __init__(self, settings: Mapping[str, Any], folder: Path) -> None:
        self._robots = read_settings(settings).robots
        self._parameters = {name: robot_parameters(name, robot, folder) for name, robot in self._robots.items()}

    @property
    def names(self) -> Collection[str]:
        return self._robots.keys()

    def misfits(self, site: Site) -> Iterable[Mistake]:
        """Robots and positions that the map of the site does not have."""
        yield from site.named("robots", self._robots, "MobileRobot")
        for name, robot in self._robots.items():
            if robot.start is not None:
                yield from site.position(("robots", name, "start"), *robot.start[:2])

    @property
    def simulated(self) -> Collection[str]:
        return [name for name, robot in self._robots.items() if robot.simulated]

    async def simulate(self, simulator: str, storeys: Mapping[str, float]) -> None:
        await serve_simulated({name: int(self._robots[name].port.rpartition(":")[2]) for name in self.simulated}, simulator)

    async def run(self, fleet: Fleet) -> None:
        for name, settings in self._robots.items():
            fleet.add(ArcosRobot(name, settings, self._parameters[name]))
        await asyncio.get_running_loop().create_future()
