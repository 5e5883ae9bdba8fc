"""The devices of the simulated world that have a robot link: which there are, what each says, and which of them stand because somebody
stopped them. What robots do is in `robot_work.py`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.motion.door_drive import DoorDrive
from somrs.devices.simulator.motion.lift_drive import LiftDrive
from somrs.devices.simulator.motion.robot import Fleet, Robot
from somrs.devices.simulator.world.scene import Scene
from somrs.devices.simulator.world.stationary import StationaryDevice
from somrs.devices.simulator.world.vision import StationaryCamera
from somrs.devices.simulator.world.weighing_scale import WeighingScale
from somrs.errors import UsageError
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.space.shafts import shafts_of
from somrs.space.solids import Role, Solid

Linked = Robot | StationaryDevice
"""A device with a robot link."""


class LinkedDevices(Mapping[str, Linked]):
    """By name: the `robots`, and what stands still: cameras, scales, powered doors and lifts."""

    def __init__(self, scene: Scene, robots: Fleet) -> None:
        self._scene, self._robots = scene, robots
        self._stationary: dict[str, StationaryDevice] = {}
        self._paused: set[str] = set()
        """The devices that stand still and that an operator has stopped."""
        self.out_of_order: frozenset[str] = frozenset()
        """The doors and lifts that no robot uses."""

    def __getitem__(self, name: str) -> Linked:
        return self._stationary[name] if name in self._stationary else self._robots[name]

    def __iter__(self) -> Iterator[str]:
        yield from self._robots
        yield from self._stationary

    def __len__(self) -> int:
        return len(self._robots) + len(self._stationary)

    def find(self, name: str) -> Linked:
        """The device of this name. Raises UsageError if there is none."""
        if name not in self:
            raise UsageError(f"{name} is not a robot in the simulated world; there are {', '.join(self) or 'none'}")
        return self[name]

    @property
    def doors(self) -> list[DoorDrive]:
        return [device for device in self._stationary.values() if isinstance(device, DoorDrive)]

    @property
    def lifts(self) -> list[LiftDrive]:
        return [device for device in self._stationary.values() if isinstance(device, LiftDrive)]

    @property
    def are_drives_busy(self) -> bool:
        """Whether a door or a lift moves, or is to move."""
        drives: list[DoorDrive | LiftDrive] = [*self.doors, *self.lifts]
        return any(drive.busy for drive in drives if drive.solid.name not in self._paused)

    def add_stationary(self, solid: Solid, map: Map, ontology: Ontology) -> None:
        """Add the device of a solid that stands still, if it has one."""
        if solid.role is Role.CAMERA:
            self._stationary[solid.name] = StationaryCamera(solid, self._scene)
        elif solid.powered and ontology.driver(solid.type) is not None:
            self._stationary[solid.name] = drive = DoorDrive(solid, self._scene, self._robots)
            if solid.automatic and self._scene.leaves(solid.name):
                self._robots.doors[solid.name] = drive
        elif solid.scale:
            self._stationary[solid.name] = WeighingScale(solid, self._scene)
        elif solid.role is Role.LIFT:
            shaft = next(shaft for shaft in shafts_of(map, ontology) if shaft.name == solid.name)
            self._stationary[solid.name] = self._robots.lifts[solid.name] = LiftDrive(solid, self._scene, self._robots, shaft)

    def remove_stationary(self, name: str) -> None:
        """Remove a device that stands still, if there is one of this name."""
        self._stationary.pop(name, None)
        self._robots.lifts.pop(name, None)
        self._robots.doors.pop(name, None)

    def step_doors(self) -> Iterator[str]:
        """Let the doors move for one control period, one after the other. Yields those whose leaves have moved."""
        for door in self.doors:
            if door.solid.name not in self._paused and door.step():
                yield door.solid.name

    def step_lifts(self) -> None:
        """Let the lifts move for one control period."""
        for lift in self.lifts:
            if lift.name not in self._paused:
                lift.step()

    def set_paused(self, name: str, paused: bool) -> None:
        """Stop a device where it is, or let it go on. Its command waits meanwhile; other objects are ignored."""
        if isinstance(drive := self._stationary.get(name), LiftDrive | DoorDrive):
            drive.is_paused = paused
        if name in self._robots:
            self._robots[name].paused = paused
        elif name in self._stationary and paused:
            self._paused.add(name)
        else:
            self._paused.discard(name)

    def set_out_of_order(self, names: tuple[str, ...]) -> None:
        """Have these doors and lifts be out of order, and only these."""
        self.out_of_order = frozenset(names)
        drives: list[DoorDrive | LiftDrive] = [*self.doors, *self.lifts]
        for drive in drives:
            drive.is_out_of_order = drive.solid.name in names

    def check_fault(self, name: str, fault: Fault) -> None:
        """Raise UsageError if there is no such robot or other device, or if it cannot have the fault."""
        possible_faults = self.find(name).possible_faults
        if fault not in possible_faults:
            raise UsageError(f"{name} cannot have the fault {fault}; it can have {', '.join(possible_faults)}")
