"""How the simulated robots take part in traffic: on a roadmap of their building, which follows what changes there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial

from somrs.devices.simulator.motion.driving import sees, things_on_floor
from somrs.devices.simulator.motion.passages import Lift
from somrs.devices.simulator.motion.road_user import RoadUser
from somrs.devices.simulator.motion.robot import Fleet, Robot
from somrs.devices.simulator.server.simulated_passages import SimulatedPassages
from somrs.devices.simulator.server.traffic_office import RENEWAL, Deliver, TrafficOffice
from somrs.devices.simulator.world.scene import Scene
from somrs.kernel.component import Send
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.traffic import LeaveTraffic, Mobility
from somrs.space.clearance import Disc
from somrs.space.dimensions import dimensions_of
from somrs.space.free_space import FreeSpace
from somrs.space.lanes import MapLane
from somrs.space.solids import Solid
from somrs.space.zones import Zones
from somrs.traffic.component import Traffic
from somrs.traffic.layout import Layout, OpenBuilding, lay_out
from somrs.traffic.obstructions import discs_along
from somrs.traffic.roadmap import Roadmap, RobotKind
from somrs.traffic.state import Position
from somrs.traffic.ways import Ways

LOOK = 1.0
"""The time after which it is looked at what stands on the floor, in simulated seconds."""

StoreForeign = Callable[[Mapping[str, tuple[Position, ...]]], None]
"""Keeps where the robots may be that are not simulated, for a program that is started again."""

UseRoadmap = Callable[[Roadmap | None], None]
Layouter = Callable[[Layout, UseRoadmap], None]
"""Has a roadmap made, and passes it on when it is made; None if it cannot be made."""


class SimulatedTraffic:
    """The traffic of a simulation.

    `changed`: it has to be looked at again what stands in the way, because a door moved. `outdated`: the roadmap has to be made anew,
    because something was built, removed, or added that needs more room.
    """

    def __init__(self, scene: Scene, robots: Fleet, free_space: Callable[[float], FreeSpace], address: str) -> None:
        self._scene, self._robots, self._free_space = scene, robots, free_space
        self._deliver: Deliver = lambda message: None
        self._store: StoreForeign = lambda positions: None
        self._stored_positions: Mapping[str, tuple[Position, ...]] = {}
        traffic = Traffic(address, Roadmap(places=(), lanes=()), edition=int(time.time()))
        self.office = TrafficOffice(traffic, self._send)
        self._passages = SimulatedPassages(robots.lifts, robots.doors)
        self.layouter: Layouter | None = None
        """Makes roadmaps beside the simulation, which goes on meanwhile; without it, the simulation makes them itself."""
        self._under_way: Layout | None = None
        self._made_roadmap: Roadmap | None = None
        """The roadmap of the layout that was under way, until the next period."""
        self._ways = Ways(self.office.roadmap, {}, {})
        self.changed, self.outdated = True, False
        self._look_time = self._join_time = 0.0
        self._rested = 0.0
        """Seconds in which nothing moved: no periods passed in which leases were renewed, so they do not count for traffic."""
        self._lanes: tuple[MapLane, ...] = ()
        self._standing: dict[float, list[Disc]] = {}
        self._hold = ""
        self._out_of_order: tuple[str, ...] = ()
        self._shut: tuple[str, ...] = ()
        """The doors and lifts that are out of order, or do not work."""

    @property
    def busy(self) -> bool:
        """Whether a plan is being made, a roadmap has come in, or a robot that is not simulated is under way."""
        return self.office.is_planning or self._made_roadmap is not None or self.office.is_foreign_trip_open

    def serve(self, deliver: Deliver, store: StoreForeign, stored: Mapping[str, tuple[Position, ...]]) -> None:
        """Let robots take part that are not simulated. `deliver`: sends a message to its recipient. `store`: keeps where such robots may
        be, before they are told; `stored`: what an earlier program has kept. Until they enter anew, they are there."""
        self._deliver, self._store, self._stored_positions = deliver, store, stored
        self.office.component.state.astray |= {name: positions for name, positions in stored.items() if name not in self._robots}
        self.changed = True

    def _send(self, message: Message) -> None:
        traffic = self.office.component
        positions = traffic.state.astray | {name: traffic.positions(name) for name in self.office.foreign}
        if positions != self._stored_positions:
            self._stored_positions = positions
            self._store(positions)
        self._deliver(message)

    @property
    def _now(self) -> float:
        """The time of traffic."""
        return self._scene.time - self._rested

    def rest(self, seconds: float) -> None:
        """Let time pass in which nothing moves. Call it when the time of the scene has been put forward."""
        self._rested += seconds

    def receive(self, message: Message) -> None:
        """A message from outside the simulation."""
        foreign, astray = self.office.foreign, {*self.office.component.state.astray}
        self.office.receive(message, self._now)
        self.changed |= (foreign, astray) != (self.office.foreign, {*self.office.component.state.astray})
        self._passages.advance(self.office)  # the simulation rests until a door has to move

    def fixed_foreigners(self) -> Iterator[tuple[str, float, Disc]]:
        """Where robots that are not simulated stand, or may be, which cannot move, are silent, or have not entered anew; with their names,
        and the heights of their floors."""
        traffic = self.office.component
        for name in self.office.foreign:
            record = traffic.state.robots[name]
            if record.silent or record.mobility is Mobility.IMMOBILE:
                yield from ((name, level, disc) for level, disc in discs_along(traffic.positions(name)))
        yield from self._astray_discs()

    def _astray_discs(self) -> Iterator[tuple[str, float, Disc]]:
        for name, positions in self.office.component.state.astray.items():
            yield from ((name, level, disc) for level, disc in discs_along(positions))

    @property
    def lifts(self) -> Mapping[str, Lift]:
        """The lifts by name."""
        return self._robots.lifts

    def user(self, solid: Solid) -> RoadUser:
        """The part in traffic of a robot that is added. It enters with the next `advance`."""
        return self._user(solid, is_outside=False)

    def _user(self, solid: Solid, *, is_outside: bool) -> RoadUser:
        user = RoadUser(solid.name, RobotKind(dimensions_of(solid).radius, solid.graph), round(solid.z, 1), self.office)
        if not is_outside:
            self.office.join(user)
        return user

    def join(self, robot: Robot) -> None:
        """A robot was added. The roadmap may have no room for it."""
        self.outdated |= not self.office.serves(robot.kind, _level(robot))
        self._join()

    def leave(self, robot: str) -> None:
        """A robot was removed."""
        self.office.tell(robot, LeaveTraffic(robot=robot))
        self.office.leave(robot)

    def set_outside(self, robot: Robot, is_outside: bool) -> None:
        """Let a robot take part by messages of a program of its own, or again by the simulation."""
        if is_outside != robot.is_outside:
            self.leave(robot.name)
            robot.is_outside, robot.road = is_outside, self._user(robot.solid, is_outside=is_outside)
            robot.road.level = _level(robot)
            self._join()
            self.changed = True

    def set_passage_outside(self, name: str, *, is_outside: bool) -> None:
        """Let a lift or an automatic door take part by messages of a program of its own, or again by the simulation."""
        self._passages.set_outside(name, self.office, is_outside=is_outside)

    def return_to_traffic(self, robot: Robot) -> None:
        """A robot was repaired."""
        if not (robot.is_mute or robot.is_outside):
            robot.road.enter_again()

    def lay_out(self, map: Map, ontology: Ontology) -> None:
        """Make the roadmap, and let all robots enter."""
        layout = self._layout(map, ontology)
        building = layout.building
        self._use(building, lay_out(building, layout.kinds))

    def _layout(self, map: Map, ontology: Ontology) -> Layout:
        robots = self._robots.values()
        levels, kinds = tuple(robot.solid.z for robot in robots), tuple(robot.kind for robot in robots)
        return Layout(map=map, ontology=ontology, levels=levels, kinds=kinds, lanes=self._lanes)

    def _renew(self, map: Map, ontology: Ontology) -> None:
        """Make the roadmap anew, or have it made. Until it is there, the robots drive on the old one, and around what was built."""
        if self.layouter is None:
            self.lay_out(map, ontology)
        elif self._under_way is None:
            self.outdated, self._under_way = False, self._layout(map, ontology)
            self.layouter(self._under_way, self._note_roadmap)

    def _note_roadmap(self, roadmap: Roadmap | None) -> None:
        self._made_roadmap = roadmap
        if roadmap is None:
            self._under_way = None

    def _use_made(self) -> None:
        """Use the roadmap that has come in. It may be outdated already: then the next one is made."""
        if self._made_roadmap is not None and self._under_way is not None:
            layout, roadmap, outdated = self._under_way, self._made_roadmap, self.outdated
            self._under_way = self._made_roadmap = None
            self._use(layout.building, roadmap)
            self.outdated = outdated

    def _use(self, building: OpenBuilding, roadmap: Roadmap) -> None:
        self._replace(roadmap)
        self._ways = Ways(self.office.roadmap, building.spaces, building.doors)
        self.office.hold(self._hold)
        for robot in self._robots.values():
            robot.road = self._user(robot.solid, is_outside=robot.is_outside)
            robot.road.level = _level(robot)
        self.changed, self.outdated = True, False
        self._join()
        self._close()

    def _replace(self, roadmap: Roadmap) -> None:
        """Have traffic on another roadmap. Robots that are not simulated are where they were, until they enter anew."""
        traffic = Traffic.restored(self.office.component.state)
        effects = [*traffic.renew(roadmap, int(time.time()), [name for name, robot in self._robots.items() if not robot.is_outside])]
        passages = self.office.passages
        self.office = TrafficOffice(traffic, self._send)
        self.office.passages = passages
        for effect in effects:
            if isinstance(effect, Send) and effect.message.header.recipient not in self._robots:
                self._send(effect.message)

    def current_ways(self, map: Map, ontology: Ontology) -> Ways:
        """The ways of robots in the building as it is now, or as it was before a roadmap that is being made."""
        if self.outdated:
            self._renew(map, ontology)
        return self._ways

    def hold(self, reason: str) -> None:
        """Let no robot drive on for a reason, such as a fire; or without one let them go on."""
        self._hold = reason
        self.office.hold(reason)

    def close_passages(self, names: tuple[str, ...]) -> None:
        """Let no robot use these doors and lifts, which are out of order, and only these."""
        self.changed |= names != self._out_of_order
        self._out_of_order = names

    def set_zones(self, zones: Zones) -> None:
        """Let robots keep out of these no-go zones, and drive slowly in these slow zones."""
        self.changed |= zones != self._robots.zones
        self._robots.zones = zones

    def set_lanes(self, lanes: tuple[MapLane, ...]) -> None:
        """Let robots keep to these lanes."""
        self.outdated |= lanes != self._lanes
        self._lanes = lanes

    def advance(self, map: Map, ontology: Ontology) -> None:
        """Let time pass."""
        now = self._now
        self._use_made()
        if self.outdated:
            self._renew(map, ontology)
        if self.changed or now >= self._look_time + LOOK:
            self._close()
        if now >= self._join_time + RENEWAL:
            self._join()
        renews = now >= self.office.renewed_at + RENEWAL
        self.office.advance(now, lambda name: self._robots[name].is_mute)
        self._passages.advance(self.office, renews=renews)

    def note_mobility(self, robot: Robot, mobility: Mobility) -> None:
        """Say whether a robot can make room, unless it is mute."""
        if robot.is_mute or robot.is_outside:
            return
        if mobility is Mobility.IMMOBILE and robot.road.mobility is not mobility and robot.stands and not _is_riding(robot):
            robot.road.level = _level(robot)
            robot.road.stay(robot.pose()[:2], partial(sees, robot))
        elif mobility is not Mobility.IMMOBILE:
            robot.road.set_mobility(mobility)

    def _join(self) -> None:
        """Let robots enter that do not take part, and those say where exactly they are that have got stuck between two places."""
        self._join_time = self._now
        for robot in self._robots.values():
            if robot.is_mute or robot.is_outside:
                continue
            if not robot.road.takes_part:
                robot.road.level = _level(robot)
                robot.road.enter(robot.pose()[:2], partial(sees, robot))
            elif robot.road.mobility is Mobility.IMMOBILE and robot.road.is_on_its_way and not _is_riding(robot):
                robot.road.stay(robot.pose()[:2], partial(sees, robot))

    def _close(self) -> None:
        """Close what is blocked by things on the floor, doors, and robots that do not take part."""
        self._look_time = self._now
        self._robots.levels |= {_level(robot) for robot in self._robots.values()}
        if self.office.foreign:
            self._robots.levels |= {*self.office.levels}
        standing = {level: things_on_floor(self._scene, level) for level in self._robots.levels}
        present = self.office.component.state.robots.keys() | self.office.component.state.astray.keys()
        for robot in self._robots.values():
            if not (robot.road.takes_part or (robot.is_outside and robot.name in present)):
                x, y, _ = robot.pose()
                standing[_level(robot)].append(Disc(x, y, robot.size.radius))
        astray = self.office.component.state.astray
        for _, level, disc in self._astray_discs():
            standing.setdefault(level, []).append(disc)
        occupied_lifts = {position.zone for positions in astray.values() for position in positions if position.zone is not None}
        rounded = {level: [Disc(round(disc.x, 2), round(disc.y, 2), disc.radius) for disc in discs] for level, discs in standing.items()}
        broken_lifts = (name for name, lift in self._robots.lifts.items() if not lift.is_usable)
        broken_doors = (name for name, door in self._robots.doors.items() if not door.is_usable)
        shut = tuple(sorted({*self._out_of_order, *broken_lifts, *broken_doors}))
        if self.changed or (rounded, shut) != (self._standing, self._shut):
            self.changed, self._standing, self._shut = False, rounded, shut
            solids = self._scene.world.solids
            free_spaces = {level: self._free_space(level) for level in self._robots.levels}
            shut_solids = [solids[name] for name in shut if name in solids]
            self.office.close(free_spaces, rounded, shut_solids, self._robots.zones.forbidden, occupied_lifts)


def _is_riding(robot: Robot) -> bool:
    """Whether a lift takes the robot to another floor."""
    return robot.road.is_on_its_way and robot.road.next_level != robot.road.level


def _level(robot: Robot) -> float:
    """The height of a robot's floor, as the roadmap has it."""
    return round(robot.level, 1)
