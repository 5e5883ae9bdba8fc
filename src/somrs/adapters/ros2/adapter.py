"""The adapter for robots with ROS 2. One process of it serves a fleet; a second one, the bridge, has `rclpy`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from somrs.adapters.adapter import Fleet
from somrs.adapters.ros2.binding_file import read_binding
from somrs.adapters.ros2.process import BridgeProcess, missing_programs
from somrs.adapters.ros2.robot import Ros2Robot
from somrs.adapters.ros2.settings import read_settings
from somrs.adapters.ros2.simulation import run_simulated
from somrs.errors import Mistake, SettingsError
from somrs.sites.references import Site


class Ros2Adapter:
    """Connects the robots that the settings name, each by its binding file. Raises InputError if settings or bindings are not valid."""

    def __init__(self, settings: Mapping[str, Any], folder: Path) -> None:
        self._settings, self._folder = read_settings(settings), folder
        mistakes = [*missing_programs(self._settings, folder)]
        for name, robot in self._settings.robots.items():
            if not (folder / robot.binding).is_file():
                text = f"there is no file {folder / robot.binding}; correct the path, which is relative to the site file"
                mistakes.append((("robots", name, "binding"), text))
        if mistakes:
            raise SettingsError("ros2", mistakes)
        self._bindings = {name: read_binding(folder / robot.binding) for name, robot in self._settings.robots.items()}

    @property
    def names(self) -> Collection[str]:
        return self._settings.robots.keys()

    def misfits(self, site: Site) -> Iterable[Mistake]:
        """Robots, attributes of them and floors that the map of the site does not have."""
        robots = self._settings.robots
        yield from site.named("robots", robots, "MobileRobot")
        for name, robot in robots.items():
            yield from site.attributes(("robots", name, "binding"), robot.binding, name, self._bindings[name].attributes)
            for index, level in enumerate(robot.levels):
                yield from site.level(("robots", name, "levels", index, "level"), level.level)

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
