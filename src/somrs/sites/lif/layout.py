"""The structure of a LIF file (LIF 1.0.0, chapter 8.3): the names are those of the format, in snake case."""

from __future__ import annotations

from typing import Any

from msgspec import Struct


class Part(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """A JSON object of the format."""


class MetaInformation(Part, frozen=True):
    project_identification: str
    creator: str
    export_timestamp: str
    lif_version: str


class Position(Part, frozen=True):
    """Metres from the origin, which all layouts of a file share; radians."""

    x: float
    y: float
    theta: float | None = None


class Action(Part, frozen=True):
    action_type: str
    blocking_type: str
    requirement_type: str | None = None
    action_description: str | None = None
    action_parameters: tuple[dict[str, str], ...] = ()


class VehicleTypeNodeProperty(Part, frozen=True):
    vehicle_type_id: str
    theta: float | None = None
    actions: tuple[Action, ...] = ()


class Node(Part, frozen=True):
    node_id: str
    node_position: Position
    vehicle_type_node_properties: tuple[VehicleTypeNodeProperty, ...]
    node_name: str | None = None
    node_description: str | None = None
    map_id: str | None = None


class VehicleTypeEdgeProperty(Part, frozen=True):
    vehicle_type_id: str
    rotation_allowed: bool
    vehicle_orientation: float | None = None
    orientation_type: str | None = None
    rotation_at_start_node_allowed: str | None = None
    rotation_at_end_node_allowed: str | None = None
    max_speed: float | None = None
    max_rotation_speed: float | None = None
    min_height: float | None = None
    max_height: float | None = None
    load_restriction: dict[str, Any] | None = None
    actions: tuple[Action, ...] = ()
    trajectory: dict[str, Any] | None = None
    reentry_allowed: bool | None = None


class Edge(Part, frozen=True):
    edge_id: str
    start_node_id: str
    end_node_id: str
    vehicle_type_edge_properties: tuple[VehicleTypeEdgeProperty, ...]
    edge_name: str | None = None
    edge_description: str | None = None


class Station(Part, frozen=True):
    station_id: str
    interaction_node_ids: tuple[str, ...]
    station_name: str | None = None
    station_description: str | None = None
    station_height: float | None = None
    station_position: Position | None = None


class Layout(Part, frozen=True):
    layout_id: str
    layout_version: str
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]
    stations: tuple[Station, ...] | None = None
    """Optional by the text of the format, and required by its schema."""
    layout_name: str | None = None
    layout_level_id: str | None = None
    layout_description: str | None = None


class Layouts(Struct, frozen=True, kw_only=True, rename="camel"):
    """A whole file."""

    meta_information: MetaInformation
    layouts: tuple[Layout, ...]
