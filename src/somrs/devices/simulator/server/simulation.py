"""The public interface of the simulation: time in control periods, commands to robots and their results, faults, and observations.

Nothing here reads a clock: the caller of `step` determines the speed of simulated time. While nothing is `busy`, no step is necessary.
How robots carry out commands is in `robot_work.py`, and the physics in `world/`.
"""

from __future__ import annotations

from dataclasses import replace

from somrs.devices.simulator.link.commands import Command, CommandDone, Fault, LinkedDevice, ObjectState, RobotState, Scan, Sense, Status
from somrs.devices.simulator.link.roads import Roadmap, TrafficState
from somrs.devices.simulator.motion.door_drive import DoorDrive
from somrs.devices.simulator.motion.lift_drive import LiftDrive
from somrs.devices.simulator.motion.robot import Fleet, Robot
from somrs.devices.simulator.server import traffic_office
from somrs.devices.simulator.server.carrying_robots import put_at, why_no_room
from somrs.devices.simulator.server.free_spaces import FreeSpaces
from somrs.devices.simulator.server.linked_devices import LinkedDevices
from somrs.devices.simulator.server.moved_leaves import MovedLeaves
from somrs.devices.simulator.server.robot_work import RobotWork
from somrs.devices.simulator.server.sensing import sensed
from somrs.devices.simulator.server.simulated_traffic import SimulatedTraffic
from somrs.devices.simulator.server.traffic_view import roadmap_view, traffic_view
from somrs.devices.simulator.world.kinds import WorldKind, make_scene
from somrs.devices.simulator.world.scanning import scanned
from somrs.devices.simulator.world.scene import RESTING
from somrs.devices.simulator.world.stationary import OnEnd
from somrs.errors import UsageError
from somrs.ontology.map import Map
from somrs.ontology.objects import FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import Ontology
from somrs.space.free_space import FreeSpace
from somrs.space.lanes import MapLane, lanes_of
from somrs.space.shafts import LIFT_RELATIONS, shafts_of
from somrs.space.solids import Role, Solid, role_of, solid_of
from somrs.space.storeys import span_of
from somrs.space.zones import Zones, zones_of
from somrs.traffic.ways import Ways


class Simulation:
    """A world built from a map, with its robots and cameras."""

    def __init__(
        self, map: Map, ontology: Ontology, world: WorldKind = WorldKind.PHYSICS, *, traffic_address: str = traffic_office.ADDRESS
    ) -> None:
        self._map, self._ontology = map, ontology
        self.scene = make_scene(world, map, ontology)
        self._free_spaces = self._new_free_spaces()
        self.robots = Fleet()
        self.linked = LinkedDevices(self.scene, self.robots)
        """Everything with a robot link."""
        self._work = RobotWork(self.scene, self.robots)
        self._traffic = SimulatedTraffic(self.scene, self.robots, self._free_space_at, traffic_address)
        self._leaves = MovedLeaves(self.scene, self.robots, self._note_leaves)
        self._last_motion = 0.0
        """Simulated time of the last motion that was observed."""
        for solid in [*self.scene.world.solids.values()]:
            self._add_linked(solid)
        self.set_zones(zones_of(map, ontology))
        self.set_lanes(lanes_of(map, ontology))
        self._traffic.lay_out(self._map, self._ontology)

    @property
    def time(self) -> float:
        """Simulated time since the start, s."""
        return self.scene.time

    @property
    def busy(self) -> bool:
        """Whether anything moves, or work is pending."""
        return self._work.busy or self.linked.are_drives_busy or self._traffic.busy or not self._at_rest()

    def _at_rest(self) -> bool:
        held = set(self.scene.hands.held.values())
        loose = [thing for thing in self.scene.things() if thing not in held]
        return all(robot.stands for robot in self.robots.values()) and (not loose or self.scene.are_at_rest(*loose))

    def rest(self, until_time: float) -> bool:
        """Advance time without physics if nothing has moved for `RESTING` seconds. Returns whether it did."""
        if self.busy:
            self._last_motion = self.time
        if self.time - max(self._last_motion, self.scene.disturbed) < RESTING:
            return False
        resting_time, self.scene.time = until_time - self.time, until_time
        self._traffic.rest(resting_time)
        return True

    def step(self) -> None:
        """Advance by one control period."""
        self.robots.locate()
        for robot in self.robots.values():
            robot.begin_period()
        self._traffic.advance(self._map, self._ontology)
        self._work.advance()
        for robot in self.robots.values():
            self._work.make_room(robot)
            self._traffic.note_mobility(robot, self._work.mobility(robot))
            robot.end_period()
        for door in self.linked.step_doors():
            self._note_leaves(door)
        self.linked.step_lifts()
        self._leaves.advance()
        self.scene.step()

    def _note_leaves(self, owner: str) -> None:
        """Record whether a door or container whose leaf was moved is open, and let the robots plan with where its leaves are."""
        if owner in self.scene.world.solids:
            self._map = self._map.changed([ValueSet(owner, "Open", self.scene.note_leaves(owner))])
            self._renew_free_spaces()

    # Commands

    def command(self, robot: str, command: Command, on_end: OnEnd) -> None:
        """Send a command to a robot or camera. A new command ends the one in progress.

        `on_end` is called once with the result; a silent robot sends none. Raises UsageError for an unknown robot.
        """
        device = self.linked.find(robot)
        if isinstance(command, Status):
            on_end(CommandDone(state=device.state()))
            return
        if Fault.SILENT in device.faults:
            return
        if isinstance(command, Sense):
            on_end(sensed(self.scene, device.state(), robot, command))
            return
        if isinstance(command, Scan) and isinstance(device, Robot):
            on_end(CommandDone(state=device.state(), ranges=scanned(self.scene, robot, command)))
            return
        if not isinstance(device, Robot):
            device.command(command, on_end)
            if isinstance(device, DoorDrive):
                self._note_leaves(robot)
            return
        self._work.begin(device, command, on_end)

    def set_outside(self, robot: str, is_outside: bool) -> None:
        """Let a robot, a lift or a door take part in traffic by messages of a program of its own, or again by the simulation."""
        if robot in self.robots:
            self._traffic.set_outside(self.robots[robot], is_outside)
        elif isinstance(passage := self.linked.find(robot), LiftDrive | DoorDrive):
            passage.is_outside = is_outside
            self._traffic.set_passage_outside(robot, is_outside=is_outside)

    # Observations

    def state(self, robot: str) -> RobotState:
        """The state of a robot or camera. Raises UsageError."""
        return self.linked.find(robot).state()

    def devices(self) -> dict[str, LinkedDevice]:
        """Everything with a robot link, by name."""
        return {name: LinkedDevice(state=device.state(), possible_faults=device.possible_faults) for name, device in self.linked.items()}

    def observe(self, object: str) -> ObjectState:
        """The true state of an object. Raises UsageError if it is not in the simulated world."""
        if object not in self.scene.world.solids:
            raise UsageError(f"{object} is not in the simulated world")
        return self.scene.observe(object)

    def span_of_storey(self, name: str) -> tuple[float, float] | None:
        """The heights between which the undersides of a storey's objects are, m; None if there is no such storey."""
        return span_of(name, self._map, self._ontology)

    def roadmap(self) -> Roadmap:
        """The roadmap of the robots, and what of it is closed."""
        return roadmap_view(self._traffic)

    def traffic(self) -> TrafficState:
        """Where the robots may drive, and whom they wait for."""
        return traffic_view(self._traffic, self.robots, self._work)

    # Faults

    def fault(self, robot: str, fault: Fault) -> None:
        """Inject a fault. Raises UsageError."""
        self.linked.check_fault(robot, fault)
        device = self.linked[robot]
        device.faults.add(fault)
        self._last_motion = self.time
        self._traffic.changed = True
        if isinstance(device, DoorDrive):
            device.fault(fault)
            self._note_leaves(robot)
        if isinstance(device, LiftDrive):
            device.fault(fault)
        if isinstance(device, Robot):
            self._work.fault(device, fault)

    def repair(self, robot: str, fault: Fault) -> None:
        """Repair a fault. Commands that were given up because of it are not resumed."""
        device = self.linked.find(robot)
        device.faults.discard(fault)
        self._traffic.changed = True
        if isinstance(device, Robot):
            self._traffic.return_to_traffic(device)

    # Changes of the map

    def learn(self, ontology: Ontology) -> None:
        """Set the ontology, so that objects of new types can be added."""
        self._ontology = self.scene.world.ontology = ontology

    def add(self, object: Object) -> None:
        """Add an object. If it exists already, its type has changed."""
        if object.name in self._map.objects and self._is_unchanged(object):
            self._map = self._map.changed([ObjectAdded(object)])
            return
        self.remove(object.name)
        solid = self.scene.add(object)
        self._map = self._map.changed([ObjectAdded(object)])
        if solid is None:
            return
        self._add_linked(solid)
        if solid.role is Role.ROBOT:
            self._traffic.join(self.robots[solid.name])
        elif solid.role not in (Role.CAMERA, Role.THING):
            self._renew_free_spaces()
            self._traffic.outdated = True

    def remove(self, name: str) -> None:
        """Remove an object."""
        solid = self.scene.world.solids.get(name)
        self._work.object_removed(name)
        if self.robots.pop(name, None) is not None:
            self._traffic.leave(name)
        self.linked.remove_stationary(name)
        self._leaves.forget(name)
        if solid is not None:
            self.scene.remove(name)
        if name in self._map.objects:
            self._map = self._map.changed([ObjectRemoved(name)])
        if solid is not None and solid.role not in (Role.ROBOT, Role.THING, Role.CAMERA):
            self._renew_free_spaces()
            self._traffic.outdated = True

    def _is_unchanged(self, object: Object) -> bool:
        """Whether an existing object differs at most in its type. If so, sets the new type and leaves the object where it is."""
        old, new = self.scene.world.solids.get(object.name), solid_of(object, self._ontology)
        if old is None or new is None:
            return old is new
        new = replace(new, x=old.x, y=old.y, z=old.z, yaw=old.yaw, weight=old.weight)
        if replace(new, type=old.type) != old:
            return False
        self.scene.world.solids[object.name] = new
        return True

    def relate(self, change: FactAdded | FactRemoved) -> None:
        """Follow at which storeys lifts stop, and which doors they have; other facts are ignored."""
        if change.fact.relation not in LIFT_RELATIONS:
            return
        self._map = self._map.changed([change])
        shafts = {shaft.name: shaft for shaft in shafts_of(self._map, self._ontology)}
        for lift in self.linked.lifts:
            lift.shaft = shafts[lift.name]
        self._renew_free_spaces()
        self._traffic.outdated = True

    def rename(self, name: str, object: Object) -> None:
        """Rename an object. A thing keeps its pose, its weight, and the robot that holds it."""
        solid = self.scene.world.solids.get(name)
        if solid is None or solid.role is not Role.THING:
            self.remove(name)
            self.add(object)
            return
        x, y, z, yaw = self.scene.pose(name)
        holder = self.scene.hands.holder(name)
        self._work.object_renamed(name, object.name)
        self.remove(name)
        self.add(object)
        if object.name in self.scene.things():
            self.scene.place_thing(object.name, x, y, z, yaw)
            self.scene.set_weight(object.name, solid.weight)
            if holder is not None:
                self.scene.hands.hold(holder, object.name)

    def renew(self, object: Object) -> None:
        """Open or close a door or container as the map says, if somebody else than a robot did; other objects are ignored."""
        self._leaves.forget(object.name)
        solid, renewed = self.scene.world.solids.get(object.name), solid_of(object, self._ontology)
        if solid is None or renewed is None or not (solid.role is Role.DOOR or solid.container) or solid.open == renewed.open:
            return
        if not self.scene.leaves(object.name):
            self.remove(object.name)
            self.add(object)
        elif renewed.automatic and isinstance(drive := self.linked.get(object.name), DoorDrive):
            drive.stays_open = renewed.open
        else:
            self._leaves.move(object.name, is_open=bool(renewed.open))

    def set_carrying(self, object: Object) -> None:
        """Let things be put on an object that stands still, or not, as its Supporting is on the map; other objects are ignored."""
        solid, role = self.scene.world.solids.get(object.name), role_of(object, self._ontology)
        if solid is not None and {solid.role, role} == {Role.SUPPORT, Role.STATIC}:
            self.scene.world.solids[object.name] = replace(solid, role=role)

    def hold(self, reason: str) -> None:
        """Let no robot drive on for a reason, such as a fire; or without one let them go on."""
        self._traffic.hold(reason)

    def set_zones(self, zones: Zones) -> None:
        """Let robots keep out of these no-go zones, and drive slowly in these slow zones."""
        self._traffic.set_zones(zones)

    def set_lanes(self, lanes: tuple[MapLane, ...]) -> None:
        """Let robots keep to these lanes."""
        self._traffic.set_lanes(lanes)

    def set_graph(self, robot: str, graph: str | None) -> None:
        """Let a robot use the lanes of another navigation graph; other objects are ignored."""
        if robot in self.robots:
            self.robots[robot].solid = self.scene.world.solids[robot] = replace(self.scene.world.solids[robot], graph=graph)
            self._traffic.outdated = True

    def close_passages(self, names: tuple[str, ...]) -> None:
        """Let no robot use these doors and lifts, which are out of order, and only these."""
        self.linked.set_out_of_order(names)
        self._traffic.close_passages(names)

    def move(self, thing: str, x: float, y: float, z: float, yaw: float = 0.0) -> None:
        """Move a thing to another pose without a robot; or a robot, as somebody would carry it. Raises UsageError."""
        if thing in self.robots:
            self._put_robot(self.robots[thing], x, y, z, yaw)
            return
        solid = self.scene.world.solids.get(thing)
        if solid is None or solid.role is not Role.THING:
            raise UsageError(f"{thing} is not a thing in the simulated world that can be moved")
        self.scene.place_thing(thing, x, y, z, yaw)

    def _put_robot(self, robot: Robot, x: float, y: float, z: float, yaw: float) -> None:
        """Put a robot elsewhere. It gives up what it does. Raises UsageError if it does not fit there."""
        reason = why_no_room(robot, (x, y), z, self._free_space_at(round(z, 1)), self.robots.values())
        if reason is not None:
            raise UsageError(f"{robot.name} cannot be put at ({x:.2f}, {y:.2f}): {reason}")
        self._work.interrupt(robot, f"somebody has carried {robot.name} elsewhere")
        moved = put_at(self._map.objects[robot.name], x, y, z, yaw, robot.battery.charge)
        self.remove(robot.name)
        self.add(moved)
        placed_robot = self.robots[robot.name]
        placed_robot.faults, placed_robot.paused = robot.faults, robot.paused

    def set_weight(self, thing: str, weight: float) -> None:
        """Give a thing another weight in kg, of which the map does not know. Raises UsageError."""
        solid = self.scene.world.solids.get(thing)
        if solid is None or solid.role is not Role.THING:
            raise UsageError(f"{thing} is not a thing in the simulated world")
        self.scene.set_weight(thing, weight)

    def _add_linked(self, solid: Solid) -> None:
        if solid.role is Role.ROBOT:
            self.robots[solid.name] = Robot(solid, self.scene, self._free_space_at, self.robots, self._traffic.user(solid))
        else:
            self.linked.add_stationary(solid, self._map, self._ontology)

    # Robots that are not simulated

    @property
    def shared_traffic(self) -> SimulatedTraffic:
        """The traffic of the building, in which others may take part."""
        return self._traffic

    def ways(self) -> Ways:
        """The ways of robots, for quotes."""
        return self._traffic.current_ways(self._map, self._ontology)

    def _renew_free_spaces(self) -> None:
        self._free_spaces = self._new_free_spaces()
        self._traffic.changed = True

    def _free_space_at(self, level: float) -> FreeSpace:
        """Plans the paths on the floor of a height."""
        return self._free_spaces.free_space(level)

    def _new_free_spaces(self) -> FreeSpaces:
        return FreeSpaces(self._map, self._ontology, self.scene.world.positions)
