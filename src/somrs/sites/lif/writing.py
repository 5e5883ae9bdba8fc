"""Exports the lanes of a map as a LIF file: a layout for each storey."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator

import msgspec

from somrs.errors import UsageError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import PART_OF, Ontology, Value
from somrs.sites.lif.layout import (
    Action,
    Edge,
    Layout,
    Layouts,
    MetaInformation,
    Node,
    Position,
    Station,
    VehicleTypeEdgeProperty,
    VehicleTypeNodeProperty,
)
from somrs.sites.lif.reading import CHARGING

VERSION = "1.0.0"
ANY_VEHICLE = "any"
"""The type of vehicle on the lanes of a map that states no NavigationGraph at all."""


def export_layouts(ontology: Ontology, map: Map, *, exported_at: str, creator: str = "SO-MRS") -> bytes:
    """The text of a LIF file. `exported_at`: the time in ISO 8601, UTC. Raises UsageError for a map without lanes."""
    export = _Export(ontology, map)
    if not export.lanes:
        raise UsageError("the map has no lanes to export; a lane is an object of the type Lane that startsAt and endsAt a waypoint")
    meta = MetaInformation(
        project_identification=next(iter(map.roots()), "map"), creator=creator, export_timestamp=exported_at, lif_version=VERSION
    )
    return msgspec.json.format(msgspec.json.encode(Layouts(meta_information=meta, layouts=export.layouts())), indent=2) + b"\n"


class _Export:
    """What is read from the map, and the layouts that are made of it."""

    def __init__(self, ontology: Ontology, map: Map) -> None:
        self.ontology, self.map = ontology, map
        self.wholes = {fact.arguments[0]: fact.arguments[1] for fact in map.facts(PART_OF)}
        starts, ends = ({f.arguments[0]: f.arguments[1] for f in map.facts(relation)} for relation in ("startsAt", "endsAt"))
        self.lanes = [
            (object, starts[name], ends[name])
            for name, object in map.objects.items()
            if ontology.is_subtype(object.type, "Lane") and name in starts and name in ends
        ]
        stated_graphs = sorted({str(graph) for lane, _, _ in self.lanes if (graph := lane.values.get("NavigationGraph")) is not None})
        self.graphs = stated_graphs or [ANY_VEHICLE]
        self.stations: dict[str, list[str]] = defaultdict(list)
        for fact in map.facts("interactsAt"):
            self.stations[fact.arguments[0]].append(fact.arguments[1])
        waypoints = [*(waypoint for _, *ends in self.lanes for waypoint in ends), *itertools.chain(*self.stations.values())]
        self.node_ids = _unique_ids(map.objects[waypoint] for waypoint in dict.fromkeys(waypoints))

    def layouts(self) -> tuple[Layout, ...]:
        nodes, edges, stations = self._nodes(), self._edges(), self._stations()
        storeys = dict.fromkeys([*nodes, *edges, *stations])
        return tuple(
            Layout(
                layout_id=storey,
                layout_version="1",
                layout_level_id=storey,
                nodes=tuple(nodes.get(storey, ())),
                edges=tuple(edges.get(storey, ())),
                stations=tuple(stations.get(storey, ())),
            )
            for storey in storeys
        )

    def _nodes(self) -> dict[str, list[Node]]:
        """The waypoints at which lanes end or robots stand to load, by storey, with the types of vehicles that come there."""
        vehicles: dict[str, set[str]] = defaultdict(set)
        for lane, start, end in self.lanes:
            for waypoint in (start, end):
                vehicles[waypoint].update(self._vehicles(lane))
        for waypoints in self.stations.values():
            for waypoint in waypoints:
                vehicles[waypoint].update(() if vehicles[waypoint] else self.graphs)
        nodes: dict[str, list[Node]] = defaultdict(list)
        for waypoint, graphs in vehicles.items():
            object, storey = self.map.objects[waypoint], self._storey(waypoint)
            label = object.values.get("Label")
            nodes[storey].append(
                Node(
                    node_id=self.node_ids[waypoint],
                    node_name=None if label is None else str(label),
                    map_id=storey,
                    node_position=self._position(object),
                    vehicle_type_node_properties=tuple(self._node_property(object, graph) for graph in sorted(graphs)),
                )
            )
        return nodes

    def _node_property(self, object: Object, graph: str) -> VehicleTypeNodeProperty:
        charging = Action(action_type=CHARGING, requirement_type="OPTIONAL", blocking_type="HARD")
        return VehicleTypeNodeProperty(
            vehicle_type_id=graph,
            theta=self._heading(object),
            actions=(charging,) if self.ontology.is_subtype(object.type, "Charger") else (),
        )

    def _edges(self) -> dict[str, list[Edge]]:
        """The edges by storey. Lanes with one ID and the same ends are one edge for several types of vehicles."""
        drawn: dict[str, tuple[str, str, dict[str, VehicleTypeEdgeProperty]]] = {}
        for lane, start, end in sorted(self.lanes, key=lambda lane: _has_no_external_id(lane[0])):
            directions = [(start, end, "")]
            if self._value(lane, "Bidirectional"):
                directions.append((end, start, "_reverse"))
            for edge_start, edge_end, ending in directions:
                for graph in self._vehicles(lane):
                    for id in _ids(lane, ending):
                        drawn_start, drawn_end, by_vehicle = drawn.setdefault(id, (edge_start, edge_end, {}))
                        if (drawn_start, drawn_end) == (edge_start, edge_end) and graph not in by_vehicle:
                            by_vehicle[graph] = self._edge_property(lane, graph, is_reverse=bool(ending))
                            break
        edges: dict[str, list[Edge]] = defaultdict(list)
        for id, (start, end, by_vehicle) in drawn.items():
            edges[self._storey(start)].append(
                Edge(
                    edge_id=id,
                    start_node_id=self.node_ids[start],
                    end_node_id=self.node_ids[end],
                    vehicle_type_edge_properties=tuple(by_vehicle.values()),
                )
            )
        return edges

    def _edge_property(self, lane: Object, graph: str, *, is_reverse: bool) -> VehicleTypeEdgeProperty:
        travel, limit = self._value(lane, "Travel"), self._value(lane, "SpeedLimit")
        backward = {"Forward": is_reverse, "Backward": not is_reverse}.get(str(travel))
        return VehicleTypeEdgeProperty(
            vehicle_type_id=graph,
            rotation_allowed=travel is None,
            vehicle_orientation=None if backward is None else math.pi if backward else 0.0,
            max_speed=None if limit is None else float(limit),
        )

    def _stations(self) -> dict[str, list[Station]]:
        stations: dict[str, list[Station]] = defaultdict(list)
        ids = _unique_ids(self.map.objects[name] for name in self.stations)
        for name, waypoints in self.stations.items():
            object = self.map.objects[name]
            label = object.values.get("Label")
            stations[self._storey(name, waypoints[0])].append(
                Station(
                    station_id=ids[name],
                    interaction_node_ids=tuple(self.node_ids[waypoint] for waypoint in waypoints),
                    station_name=None if label is None else str(label),
                    station_position=msgspec.structs.replace(self._position(object), theta=self._heading(object)),
                )
            )
        return stations

    def _vehicles(self, lane: Object) -> list[str]:
        graph = lane.values.get("NavigationGraph")
        return self.graphs if graph is None else [str(graph)]

    def _storey(self, *names: str) -> str:
        """The storey that the first of the objects, or else the next one, is a part of; the map's first whole if there is none."""
        for name in names:
            seen = {name}
            whole = self.wholes.get(name)
            while whole is not None and whole not in seen:
                if self.ontology.is_subtype(self.map.objects[whole].type, "Storey"):
                    return whole
                seen.add(whole)
                whole = self.wholes.get(whole)
        return next(iter(self.map.roots()), "map")

    def _position(self, object: Object) -> Position:
        x, y = (float(self._value(object, path) or 0.0) for path in ("PositionX", "PositionY"))
        return Position(x=x, y=y)

    def _heading(self, object: Object) -> float | None:
        """The heading, which the format has from -π to π."""
        turn = object.values.get("RotationZ")
        return None if turn is None else math.remainder(float(turn), math.tau)

    def _value(self, object: Object, path: str) -> Value | None:
        own_value = object.values.get(path)
        return self.ontology.default(object.type, path) if own_value is None else own_value


def _ids(object: Object, ending: str = "") -> Iterator[str]:
    """The IDs that an object may have, the best first: that by which other systems know it, its name, and this with a number."""
    stems = [str(external_id)] if (external_id := object.values.get("ExternalId")) else []
    yield from (f"{stem}{ending}" for stem in (*stems, object.name))
    yield from (f"{object.name}{ending}_{number}" for number in itertools.count(2))


def _unique_ids(objects: Iterable[Object]) -> dict[str, str]:
    """An ID for each object, by its name. The IDs by which other systems know objects come before names that are equal to them."""
    owners: dict[str, str] = {}
    for object in sorted(objects, key=_has_no_external_id):
        owners[next(id for id in _ids(object) if id not in owners)] = object.name
    return {name: id for id, name in owners.items()}


def _has_no_external_id(object: Object) -> bool:
    return not object.values.get("ExternalId")
