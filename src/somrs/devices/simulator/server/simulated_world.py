"""Keeps a simulated world in agreement with the map of a Repository, or with those of several.

The world is built from the maps. It follows objects that are added, removed or renamed, changes of their types, doors that open or
close, and what a map says about where things can be put. Positions come from the physics alone: positions that robots report to a map
do not move objects.

An object that comes to a map may be a thing that is in the world already: a camera saw it where the map did not have it, or a neighbour's
robot put it there. Two like things cannot be in one place, so the thing gets the name of the object instead of being built again. A thing
of the same map gets its own name back if the object turns out to be that thing, or is removed.

A world of several maps has the names that neighbours use: `Barn:Jar1` (`ontology/qualified_names.py`).
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterable, Mapping

from msgspec import structs

from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.server.traffic_office import ADDRESS
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.devices.simulator.world.recognition import are_alike
from somrs.ontology.map import Map
from somrs.ontology.modes import closed_passages, hold_reason, modes
from somrs.ontology.naming import Renaming
from somrs.ontology.objects import Change, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.qualified_names import home_of
from somrs.ontology.types import PAUSED, PAUSED_FOR, Ontology
from somrs.space.lanes import concerns_lanes, lanes_of
from somrs.space.solids import Role, solid_of
from somrs.space.zones import zones_of

SAME_PLACE = 0.1
"""Largest distance between a thing of the world and the place that the map states for it, m."""


class SimulatedWorld:
    """A world, its `map` and its `ontology`. `simulation` is set when the event `read` is set: when all maps have been read.

    `kind`: what moves the world. `traffic`: the address of its traffic.
    """

    def __init__(self, kind: WorldKind = WorldKind.PHYSICS, traffic: str = ADDRESS) -> None:
        self._kind, self._traffic = kind, traffic
        self.read = asyncio.Event()
        self.simulation: Simulation | None = None
        self.map, self.ontology = Map(), Ontology()
        self._own_names: dict[str, str] = {}
        """The names that things had before they were seen as new objects, by the names of these objects."""

    def build(self, map: Map, ontology: Ontology) -> None:
        """Make the simulation."""
        self.map, self.ontology = map, ontology
        self.simulation = simulation = Simulation(map, ontology, self._kind, traffic_address=self._traffic)
        for name, object in map.objects.items():
            simulation.linked.set_paused(name, _is_paused(object))
        self._follow_modes(simulation)
        self.read.set()

    def learn(self, ontology: Ontology) -> None:
        """Follow a change of the ontology."""
        self.ontology = ontology
        assert self.simulation is not None, "it is built before it changes"
        self.simulation.learn(ontology)
        for object in self.map.objects.values():  # the default of its type may be another one
            self.simulation.set_carrying(object)

    def change(self, map: Map, changes: Iterable[Change], renamed: list[Renaming], merged: Mapping[str, str]) -> None:
        """Follow changes that lead to this map. `renamed`, in order; `merged`: objects that turned out to be others."""
        assert self.simulation is not None, "it is built before it changes"
        map_before, self.map, changes = self.map, map, [*changes]
        self._follow(self.simulation, changes, [*renamed], merged, map_before)
        if any(concerns_lanes(change, map if isinstance(change, ObjectAdded) else map_before, self.ontology) for change in changes):
            self.simulation.set_lanes(lanes_of(map, self.ontology))
        self._follow_modes(self.simulation)

    def _follow(
        self, simulation: Simulation, changes: Iterable[Change], renamed: list[Renaming], merged: Mapping[str, str], map_before: Map
    ) -> None:
        for change in changes:
            match change:
                case ObjectAdded(object) if renamed and renamed[0].to == object.name:
                    simulation.rename(renamed.pop(0).name, object)
                case ObjectAdded(object) if (thing := self._thing_seen_as(object, simulation)) is not None:
                    if home_of(thing) == home_of(object.name):
                        self._own_names[object.name] = thing
                    simulation.rename(thing, object)
                case ObjectAdded(object):
                    simulation.add(object)
                    simulation.linked.set_paused(object.name, _is_paused(object))
                case ObjectRemoved(name) if renamed and renamed[0].name == name and home_of(renamed[0].to) == home_of(name):
                    pass  # the next addition is the renamed object
                case ObjectRemoved(name) if renamed and renamed[0].name == name:
                    self._move_home(simulation, map_before.objects[name], renamed.pop(0).to)
                case ObjectRemoved(name):
                    self._remove(simulation, name, merged.get(name))
                case FactAdded() | FactRemoved():
                    simulation.relate(change)
                case ValueSet(name, "Open") if (door := self.map.objects.get(name)) is not None:
                    simulation.renew(door)
                case ValueSet(name, path) if path in (PAUSED, PAUSED_FOR) and (device := self.map.objects.get(name)) is not None:
                    simulation.linked.set_paused(name, _is_paused(device))
                case ValueSet(name, "NavigationGraph"):
                    simulation.set_graph(name, None if change.value is None else str(change.value))
                case ValueSet(name, "Supporting") if (support := self.map.objects.get(name)) is not None:
                    simulation.set_carrying(support)

    def _follow_modes(self, simulation: Simulation) -> None:
        simulation.hold(hold_reason(modes(self.map)))
        simulation.close_passages(closed_passages(self.map, self.ontology))
        simulation.set_zones(zones_of(self.map, self.ontology))

    def _move_home(self, simulation: Simulation, object: Object, new_name: str) -> None:
        """Follow an object that belongs to another map from now on. It leaves a world that does not have that map."""
        if not home_of(object.name):
            self._remove(simulation, object.name, None)
        elif object.name in simulation.scene.world.solids:  # otherwise the other map has said so before
            simulation.rename(object.name, self.map.objects.get(new_name) or structs.replace(object, name=new_name))

    def _remove(self, simulation: Simulation, name: str, into: str | None) -> None:
        """Follow an object that leaves the map. `into`: the object that it turned out to be.

        The thing in the world stays if the map still has it: under its own name, or as the object that it turned out to be.
        """
        solids, objects = simulation.scene.world.solids, self.map.objects
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
        """The nearest thing of the world that looks like a new object, in its place, if its map does not have that thing there."""
        solids, new = simulation.scene.world.solids, solid_of(object, self.ontology)
        if new is None or new.role is not Role.THING or new.name in solids:
            return None
        place = new.x, new.y, new.z
        distances = {
            thing: math.dist(simulation.scene.pose(thing)[:3], place)
            for thing in simulation.scene.things()
            if simulation.scene.hands.holder(thing) is None and are_alike(solids[thing], new, self.ontology)
        }
        near_things = [thing for thing, distance in distances.items() if distance <= SAME_PLACE and self._may_be(object, thing, place)]
        return min(near_things, key=distances.__getitem__, default=None)

    def _may_be(self, object: Object, thing: str, place: tuple[float, float, float]) -> bool:
        return home_of(thing) != home_of(object.name) or not self._is_mapped_at(thing, place)

    def _is_mapped_at(self, thing: str, place: tuple[float, float, float]) -> bool:
        object = self.map.objects.get(thing)
        on_map = solid_of(object, self.ontology) if object is not None else None
        return on_map is not None and math.dist((on_map.x, on_map.y, on_map.z), place) <= SAME_PLACE


def _is_paused(device: Object) -> bool:
    """Whether an operator has stopped the device, or a task for which it works."""
    return device.values.get(PAUSED) is True or device.values.get(PAUSED_FOR) is not None
