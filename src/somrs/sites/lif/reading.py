"""Imports a LIF file as a map: a storey for each level, a waypoint for each node, and a lane for each edge and type of vehicle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import msgspec
from msgspec import Struct

from somrs.errors import InputError, ModelError, Problem
from somrs.ontology.types import Value
from somrs.sites.draft import Draft, identifier, pose
from somrs.sites.lif.layout import Edge, Layout, Layouts, Node, Station, VehicleTypeEdgeProperty
from somrs.sites.notes import Rank
from somrs.sites.plan import Box
from somrs.sites.site import ImportOptions, Site

_STOREY_HEIGHT = 4.0
"""The height at which each level is above the one before it, m: the format does not state it."""
_MARGIN = 2.0
"""How far the floor reaches beyond the nodes, m: the format has no floors."""
VERSIONS = ("0", "1")
"""The major versions that are read: drafts of version 1 have the same form."""
CHARGING = "startCharging"
"""The action of VDA 5050 by which a vehicle charges."""
_NOT_KEPT = {
    "trajectory": "the curve of an edge is left out; its lane is straight",
    "load_restriction": "a restriction of the load is left out",
    "max_rotation_speed": "a limit of the rotation speed is left out",
    "min_height": "a limit of the height is left out",
    "max_height": "a limit of the height is left out",
    "actions": "the actions of an edge are left out",
}


class _Meta(Struct, frozen=True, rename="camel"):
    lif_version: str


class _Versioned(Struct, frozen=True, rename="camel"):
    meta_information: _Meta


def import_layouts(path: str | Path, options: ImportOptions | None = None) -> Site:
    """The building in the file. Raises InputError for an unreadable file, and ModelError for wrong content."""
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error}); give the path of a LIF file") from error
    return import_bytes(content, str(path))


def import_bytes(content: bytes, file: str = "layouts.lif.json") -> Site:
    """The building in the text. Raises ModelError for wrong content."""
    version = _version(content)
    if (major := version.partition(".")[0]).isdigit() and major not in VERSIONS:
        message = (
            f"its lifVersion is {version}, and SO-MRS reads {' and '.join(f'{known}.x' for known in VERSIONS)}; export it as one of these"
        )
        raise ModelError([Problem(file=file, line=None, subject="file", rule="structure", message=message)])
    try:
        # Not strict: the examples of the format itself have numbers as text, such as "stationHeight": "1.0".
        layouts = msgspec.json.decode(content.removeprefix(b"\xef\xbb\xbf"), type=Layouts, strict=False)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        message = f"this is no layout in the Layout Interchange Format: {error}"
        raise ModelError([Problem(file=file, line=None, subject="file", rule="structure", message=message)]) from None
    problems = [Problem(file=file, line=None, subject=subject, rule="layout", message=text) for subject, text in _mistakes(layouts)]
    if problems:
        raise ModelError(problems)
    return _Import(layouts).building(file)


def _version(content: bytes) -> str:
    """The version of the format that the file states; empty if it cannot be read."""
    try:
        return msgspec.json.decode(content.removeprefix(b"\xef\xbb\xbf"), type=_Versioned).meta_information.lif_version
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return ""


def _mistakes(layouts: Layouts) -> Iterator[tuple[str, str]]:
    """What the format forbids beyond its structure: the element, and what is wrong with it."""
    nodes: set[str] = set()
    edges: set[str] = set()
    for layout in layouts.layouts:
        for node in layout.nodes:
            if node.node_id in nodes:
                yield f"node {node.node_id}", "is defined twice; node IDs are unique in the whole file"
            nodes.add(node.node_id)
    if not nodes:
        yield "layouts", "have no node, so there is nothing to import"
    for layout in layouts.layouts:
        for edge in layout.edges:
            if edge.edge_id in edges:
                yield f"edge {edge.edge_id}", "is defined twice; edge IDs are unique in the whole file"
            edges.add(edge.edge_id)
            for end in (edge.start_node_id, edge.end_node_id):
                if end not in nodes:
                    yield f"edge {edge.edge_id}", f"there is no node {end}"
        for station in layout.stations or ():
            for end in station.interaction_node_ids:
                if end not in nodes:
                    yield f"station {station.station_id}", f"there is no node {end}"


class _Import:
    """One import: the layouts that are read, and the map that is made of them."""

    def __init__(self, layouts: Layouts) -> None:
        self.layouts, self.draft = layouts.layouts, Draft()
        self.name = identifier(layouts.meta_information.project_identification or "Building")
        self.objects: dict[str, str] = {}
        """By the ID of a node, its object."""

    def building(self, file: str) -> Site:
        building = self.draft.add(self.name, "Building", {})
        levels: dict[str, list[Layout]] = {}
        for layout in self.layouts:
            levels.setdefault(layout.layout_level_id or "", []).append(layout)
        storeys = {level: self._storey(index, level, layouts, building) for index, (level, layouts) in enumerate(levels.items())}
        for level, layouts in levels.items():
            for layout in layouts:
                self._nodes(layout, *storeys[level])
        for level, layouts in levels.items():
            for layout in layouts:
                for edge in layout.edges:
                    self._lanes(edge, storeys[level][0])
                for station in layout.stations or ():
                    self._station(station, *storeys[level])
        return self.draft.site(self.name, file)

    def _storey(self, index: int, level: str, layouts: list[Layout], building: str) -> tuple[str, float]:
        elevation = index * _STOREY_HEIGHT
        label = level or layouts[0].layout_name or layouts[0].layout_id or "Level"
        name = self.draft.fresh(identifier(f"Level {label}" if label[:1].isdigit() else label))
        storey = self.draft.add(name, "Storey", {"Elevation": elevation, "Label": label}, building)
        self.draft.notes.add(Rank.ASSUMED, storey, "the format has no floors; one is laid under all nodes")
        if index:
            self.draft.notes.add(
                Rank.ASSUMED, storey, f"the format has no elevations; each level is {_STOREY_HEIGHT:g} m above the one before"
            )
        positions = [node.node_position for layout in layouts for node in layout.nodes]
        xs, ys = [position.x for position in positions] or [0.0], [position.y for position in positions] or [0.0]
        low, high = (min(xs) - _MARGIN, min(ys) - _MARGIN), (max(xs) + _MARGIN, max(ys) + _MARGIN)
        self.draft.add_floor([low, (high[0], low[1]), high, (low[0], high[1])], elevation, storey)
        return storey, elevation

    def _nodes(self, layout: Layout, storey: str, elevation: float) -> None:
        interactions = {node for station in layout.stations or () for node in station.interaction_node_ids}
        for node in layout.nodes:
            name = self.draft.fresh(identifier(node.node_id))
            position = pose(Box(node.node_position.x, node.node_position.y, 0, 0, self._heading(node)), elevation)
            values: dict[str, Value] = {**position, **_external(node.node_id, name)}
            if node.node_name:
                values["Label"] = node.node_name
            self.objects[node.node_id] = self.draft.add(name, self._type(node, interactions), values, storey)

    def _heading(self, node: Node) -> float:
        """How vehicles stand at the node."""
        headings = {properties.theta for properties in node.vehicle_type_node_properties if properties.theta is not None}
        if len(headings) > 1:
            self.draft.notes.add(Rank.LEFT_OUT, node.node_id, "the headings at a node, which differ by the type of vehicle, are left out")
        return headings.pop() if len(headings) == 1 else 0.0

    def _type(self, node: Node, interactions: set[str]) -> str:
        actions = {action.action_type for properties in node.vehicle_type_node_properties for action in properties.actions}
        for action in sorted(actions - {CHARGING}):
            self.draft.notes.add(Rank.LEFT_OUT, node.node_id, f"the action {action} of a node is left out")
        if CHARGING in actions:
            return "Charger"
        return "Place" if node.node_name or node.node_id in interactions else "Waypoint"

    def _lanes(self, edge: Edge, storey: str) -> None:
        """Add a lane for each type of vehicle that may use the edge."""
        for properties in edge.vehicle_type_edge_properties:
            name = self.draft.fresh(identifier(edge.edge_id))
            values: dict[str, Value] = {"NavigationGraph": properties.vehicle_type_id, **_external(edge.edge_id, name)}
            if properties.max_speed is not None and properties.max_speed > 0:
                values["SpeedLimit"] = properties.max_speed
            if (travel := self._travel(edge, properties)) is not None:
                values["Travel"] = travel
            for key, text in _NOT_KEPT.items():
                if getattr(properties, key):
                    self.draft.notes.add(Rank.LEFT_OUT, edge.edge_id, text)
            self.draft.add(name, "Lane", values, storey)
            self.draft.relate("startsAt", name, self.objects[edge.start_node_id])
            self.draft.relate("endsAt", name, self.objects[edge.end_node_id])

    def _travel(self, edge: Edge, properties: VehicleTypeEdgeProperty) -> str | None:
        orientation = properties.vehicle_orientation
        if orientation is None:
            return None
        if properties.orientation_type != "GLOBAL" and math.isclose(math.cos(orientation), 1, abs_tol=1e-3):
            return "Forward"
        if properties.orientation_type != "GLOBAL" and math.isclose(math.cos(orientation), -1, abs_tol=1e-3):
            return "Backward"
        self.draft.notes.add(Rank.LEFT_OUT, edge.edge_id, "an orientation across the edge, or on the map, is left out")
        return None

    def _station(self, station: Station, storey: str, elevation: float) -> None:
        """Add a station; without a position it is amid its nodes."""
        waypoints = [self.objects[node] for node in station.interaction_node_ids]
        name = self.draft.fresh(identifier(station.station_id))
        if station.station_position is not None:
            place = station.station_position
            box = Box(place.x, place.y, 0, 0, place.theta or 0.0)
        else:
            spots = [self.draft.objects[waypoint].values for waypoint in waypoints] or [{"PositionX": 0.0, "PositionY": 0.0}]
            x, y = (sum(float(spot[path]) for spot in spots) / len(spots) for path in ("PositionX", "PositionY"))
            box = Box(x, y, 0, 0)
        label: dict[str, Value] = {"Label": station.station_name} if station.station_name else {}
        values = {**pose(box, elevation + (station.station_height or 0.0)), **_external(station.station_id, name), **label}
        self.draft.add(name, "Station", values, storey)
        for waypoint in dict.fromkeys(waypoints):
            self.draft.relate("interactsAt", name, waypoint)


def _external(id: str, name: str) -> dict[str, Value]:
    return {"ExternalId": id} if id != name else {}
