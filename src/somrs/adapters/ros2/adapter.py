"""The adapter for robots with ROS 2. One process of it serves a fleet; a second one, the bridge, has `rclpy`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from somrs.adapters.adapter import Fleet
from somrs.adapters.ros2.binding_file import read_binding
from somrs.adapters.ros2.process import BridgeProcess
from somrs.adapters.ros2.robot import Ros2Robot
from somrs.adapters.ros2.settings import read_settings
from somrs.adapters.ros2.simulation import run_simulated
from somrs.adapters.settings import Mistake, absent
from somrs.ontology.map import Map


class Ros2Adapter:
    """Connects the robots that the settings name, each by its binding file. Raises InputError if settings or bindings are not valid."""

    def __init__(self, settings: Mapping[str, Any], folder: Path) -> None:
        self._settings, self._folder = read_settings(settings), folder
        self._bindings = {name: read_binding(folder / robot.binding) for name, robot in self._settings.robots.items()}

    @property
    def names(self) -> Collection[str]:
        return self._settings.robots.keys()

    def misfits(self, map: Map) -> Iterable[Mistake]:
        """Robots that the map of the site does not have."""
        return absent("robots", self._settings.robots, map)

    @property
    def simulated(self) -> Collection[str]:
        return [name for name, robot in self._settings.robots.items() if robot.simulated]

    async def simulate(self, simulator: str, storeys: Mapping[str, float]) -> None:
        robots = {name: self._settings.robots[name] for name in self.simulated}
        await run_simulated(self._settings, self._folder, robots, simulator)

    async def run(self, fleet: Fleet) -> None:
        bridge = BridgeProcess(self._settings, self._folder)
        for name, robot in self._settings.robots.items():
            fleet.add(Ros2Robot(name, robot, self._bindings[name], bridge.session))
        await bridge.run()
