"""Keeps a simulated world in agreement with the Repository's map.

The world is built from the map. It follows objects that are added, removed or renamed, changes of their types, doors that open or
close, and what the map says about where things can be put. Positions come from the physics alone: positions that robots report to the map
do not move objects.

An object that comes to the map may be a thing that is in the world already: a camera saw it where the map did not have it. Two like
things cannot be in one place, so the thing gets the name of the object instead of being built again. It gets its own name back if the
object turns out to be that thing, or is removed.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterable, Mapping

from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.server.traffic_office import ADDRESS
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.devices.simulator.world.recognition import are_alike
from somrs.kernel.component import Effect, Input, Started
from somrs.kernel.replica import Replica
from somrs.ontology.differences import differences
from somrs.ontology.map import Map
from somrs.ontology.modes import closed_passages, hold_reason, modes
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.objects import Change, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import PAUSED, PAUSED_FOR
from somrs.space.solids import Role, solid_of
from somrs.space.zones import zones_of

SAME_PLACE = 0.1
"""Largest distance between a thing of the world and the place that the map states for it, m."""


class Follower:
    """A component that only receives. `simulation` is set when the event `read` is set: when the map has been read.

    `kind`: what moves the world. `traffic`: the address of its traffic.
    """

    def __init__(self, address: str, repository: str, kind: WorldKind = WorldKind.PHYSICS, traffic: str = ADDRESS) -> None:
        self._kind, self._traffic = kind, traffic
        self.replica = Replica(address, repository, own=True)
        self.read = asyncio.Event()
        self.simulation: Simulation | None = None
        self._map = Map()
        self._own_names: dict[str, str] = {}
        """The names that things had before they were seen as new objects, by the names of these objects."""

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Started):
            return self.replica.start(now)
        news = self.replica.handle(event, now)
        if news is None:
            return []
        map_before, self._map = self._map, self.replica.map
        if self.simulation is None and self.replica.ready:
            self.simulation = Simulation(self.replica.map, self.replica.ontology, self._kind, traffic_address=self._traffic)
            for name, object in self.replica.map.objects.items():
                self.simulation.set_paused(name, _is_paused(object))
            self._follow_modes(self.simulation)
            self.read.set()
        elif self.simulation is not None:
            if news.ontology_changed:
                self.simulation.learn(self.replica.ontology)
                for object in self.replica.map.objects.values():  # the default of its type may be another one
                    self.simulation.set_carrying(object)
            # A reloaded map has no list of changes, so they are computed from the difference.
            changes = differences(map_before, self.replica.map) if news.reloaded else news.changes
            renamed = [renaming for renaming in news.renamed if renaming.section is Section.OBJECTS] if not news.reloaded else []
            merged = {merging.name: merging.into for merging in news.merged} if not news.reloaded else {}
            self._follow(self.simulation, changes, renamed, merged)
            self._follow_modes(self.simulation)
        return news.effects

    def _follow(self, simulation: Simulation, changes: Iterable[Change], renamed: list[Renaming], merged: Mapping[str, str]) -> None:
        for change in changes:
            match change:
                case ObjectAdded(object) if renamed and renamed[0].to == object.name:
                    simulation.rename(renamed.pop(0).name, object)
                case ObjectAdded(object) if (thing := self._thing_seen_as(object, simulation)) is not None:
                    self._own_names[object.name] = thing
                    simulation.rename(thing, object)
                case ObjectAdded(object):
                    simulation.add(object)
                    simulation.set_paused(object.name, _is_paused(object))
                case ObjectRemoved(name) if renamed and renamed[0].name == name:
                    pass  # the next addition is the renamed object
                case ObjectRemoved(name):
                    self._remove(simulation, name, merged.get(name))
                case FactAdded() | FactRemoved():
                    simulation.relate(change)
                case ValueSet(name, "Open") if (door := self.replica.map.objects.get(name)) is not None:
                    simulation.renew(door)
                case ValueSet(name, path) if path in (PAUSED, PAUSED_FOR) and (device := self.replica.map.objects.get(name)) is not None:
                    simulation.set_paused(name, _is_paused(device))
                case ValueSet(name, "Supporting") if (support := self.replica.map.objects.get(name)) is not None:
                    simulation.set_carrying(support)

    def _follow_modes(self, simulation: Simulation) -> None:
        simulation.hold(hold_reason(modes(self.replica.map)))
        simulation.close_passages(closed_passages(self.replica.map, self.replica.ontology))
        simulation.set_zones(zones_of(self.replica.map, self.replica.ontology))

    def _remove(self, simulation: Simulation, name: str, into: str | None) -> None:
        """Follow an object that leaves the map. `into`: the object that it turned out to be.

        The thing in the world stays if the map still has it: under its own name, or as the object that it turned out to be.
        """
        solids, objects = simulation.scene.world.solids, self.replica.map.objects
        own_name = self._own_names.pop(name, None)
        kept_name = next((kept_name for kept_name in (own_name, into) if kept_name in objects and kept_name not in solids), None)
        if kept_name is None and into is not None and into in objects and self._stands_for(name, into, simulation):
            simulation.remove(into)
            kept_name = into
        if kept_name is not None and name in solids:
            simulation.rename(name, objects[kept_name])
        else:
            simulation.remove(name)

    def _stands_for(self, name: str, into: str, simulation: Simulation) -> bool:
        """Whether of two things of the world that are one, the first stands where the map has the object."""
        solid = simulation.scene.world.solids.get(name)
        return solid is not None and solid.role is Role.THING and self._is_mapped_at(into, simulation.scene.pose(name)[:3])

    def _thing_seen_as(self, object: Object, simulation: Simulation) -> str | None:
        """The nearest thing of the world that looks like a new object, in its place, if the map does not have that thing there."""
        solids, new = simulation.scene.world.solids, solid_of(object, self.replica.ontology)
        if new is None or new.role is not Role.THING or new.name in solids:
            return None
        place = new.x, new.y, new.z
        distances = {
            thing: math.dist(simulation.scene.pose(thing)[:3], place)
            for thing in simulation.scene.things()
            if simulation.scene.hands.holder(thing) is None and are_alike(solids[thing], new, self.replica.ontology)
        }
        near_things = [thing for thing, distance in distances.items() if distance <= SAME_PLACE and not self._is_mapped_at(thing, place)]
        return min(near_things, key=distances.__getitem__, default=None)

    def _is_mapped_at(self, thing: str, place: tuple[float, float, float]) -> bool:
        object = self.replica.map.objects.get(thing)
        on_map = solid_of(object, self.replica.ontology) if object is not None else None
        return on_map is not None and math.dist((on_map.x, on_map.y, on_map.z), place) <= SAME_PLACE


def _is_paused(device: Object) -> bool:
    """Whether an operator has stopped the device, or a task for which it works."""
    return device.values.get(PAUSED) is True or device.values.get(PAUSED_FOR) is not None
