"""Driving distances of simulated robots, for quotes: the simulation as `find_legs` sees it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from somrs.devices.simulator.link.lines import Legs, Stops
from somrs.devices.simulator.motion import legs
from somrs.devices.simulator.motion.driven_world import Driver
from somrs.devices.simulator.motion.leaves import moving_bases
from somrs.devices.simulator.server.simulation import Simulation
from somrs.errors import UsageError
from somrs.space.clearance import Disc
from somrs.space.distances import Array
from somrs.space.solids import Solid
from somrs.space.zones import Zones


def find_legs(simulation: Simulation, robot: str, stops: Stops, situation: str | None = None) -> Legs:
    """The ways of a simulated robot. Raises UsageError for an unknown robot or object."""
    if robot not in simulation.robots:
        raise UsageError(f"there is no robot {robot}; there are {', '.join(simulation.robots) or 'none'}")
    return legs.find_legs(_SimulatedSurroundings(simulation), simulation.robots[robot], stops, situation)


class _SimulatedSurroundings:
    """What is around the robots of a simulation."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.pose, self.container, self.clearances = simulation.scene.pose, simulation.scene.container, simulation.scene.clearances
        self.ways = simulation.ways

    @property
    def solids(self) -> Mapping[str, Solid]:
        return self._simulation.scene.world.solids

    def has_leaves(self, owner: str) -> bool:
        return bool(self._simulation.scene.leaves(owner))

    def leaf_ways(self, owner: str, is_open: bool) -> tuple[tuple[float, float], ...]:
        scene = self._simulation.scene
        is_as_now = is_open == scene.world.solids[owner].open
        return tuple(
            (round(scene.leaf_position(leaf), 2) if is_as_now else leaf.travel * is_open, leaf.travel * (not is_open))
            for leaf in scene.leaves(owner)
        )

    def leaf_bases(self, driver: Driver, owner: str, ways: Sequence[tuple[float, float]], level: float) -> list[Array]:
        robot = self._simulation.robots[driver.name]
        return [moving_bases(robot, leaf, way, level) for leaf, way in zip(self._simulation.scene.leaves(owner), ways, strict=True)]

    @property
    def doors_for_all(self) -> Collection[str]:
        return {name for name, door in self._simulation.robots.doors.items() if door.is_usable}

    @property
    def unusable_doors(self) -> Collection[str]:
        return {*self._simulation.linked.out_of_order, *self._simulation.robots.doors}

    @property
    def unusable_lifts(self) -> Collection[str]:
        return {lift.name for lift in self._simulation.linked.lifts if not lift.is_usable}

    @property
    def zones(self) -> Zones:
        return self._simulation.robots.zones

    def standing(self, driver: Driver) -> Iterable[tuple[float, Disc]]:
        broken = (robot for robot in self._simulation.robots.values() if robot.name != driver.name and not robot.mobile)
        poses = ((robot, robot.pose()) for robot in broken)
        discs: Iterator[tuple[float, Disc]] = ((robot.level, Disc(x, y, robot.size.radius)) for robot, (x, y, _) in poses)
        foreigners = ((level, disc) for name, level, disc in self._simulation.shared_traffic.fixed_foreigners() if name != driver.name)
        return (*discs, *foreigners)
