"""What fleet control sends: orders, instant actions, zone sets, and responses to requests (VDA 5050 3.0, 7.3 to 7.6).

Lengths are in metres, angles in radians, speeds in metres per second.
"""

from __future__ import annotations

from enum import StrEnum
from itertools import chain
from typing import Any

from msgspec import Struct, field


class BlockingType(StrEnum):
    """What an action excludes while it runs (3.0, 6.2.2)."""

    NONE = "NONE"
    SINGLE = "SINGLE"
    SOFT = "SOFT"
    HARD = "HARD"


class ActionParameter(Struct, frozen=True, kw_only=True):
    key: str
    value: Any


class Action(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """`action_type`: by its name in 3.0, such as `pick` or `initializePosition`."""

    action_type: str
    action_id: str
    blocking_type: BlockingType
    action_descriptor: str | None = None
    action_parameters: tuple[ActionParameter, ...] | None = None
    retriable: bool | None = None

    def parameter(self, key: str) -> Any:
        """The value of a parameter; None if there is none of this key."""
        return next((parameter.value for parameter in self.action_parameters or () if parameter.key == key), None)


class Deviation(Struct, frozen=True, kw_only=True):
    """An ellipse around a node: half of its long and of its short axis, and the direction of the long one. In 2.1 it is a circle."""

    a: float
    b: float
    theta: float


class NodePosition(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    x: float
    y: float
    map_id: str
    theta: float | None = None
    allowed_deviation_xy: Deviation | None = field(default=None, name="allowedDeviationXY")
    allowed_deviation_theta: float | None = None


class Node(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    node_id: str
    sequence_id: int
    released: bool
    actions: tuple[Action, ...]
    node_descriptor: str | None = None
    node_position: NodePosition | None = None


class ControlPoint(Struct, frozen=True, kw_only=True, omit_defaults=True):
    x: float
    y: float
    weight: float | None = None


class Trajectory(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    control_points: tuple[ControlPoint, ...]
    degree: int | None = None
    knot_vector: tuple[float, ...] | None = None


class Corridor(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    left_width: float
    right_width: float
    corridor_reference_point: str | None = None
    release_required: bool | None = None
    release_loss_behavior: str | None = None


class Edge(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """`start_node_id`, `end_node_id`: in 2.x only, which requires them."""

    edge_id: str
    sequence_id: int
    released: bool
    actions: tuple[Action, ...]
    start_node_id: str | None = None
    end_node_id: str | None = None
    edge_descriptor: str | None = None
    maximum_speed: float | None = None
    maximum_mobile_robot_height: float | None = None
    minimum_load_handling_device_height: float | None = None
    orientation: float | None = None
    orientation_type: str | None = None
    direction: str | None = None
    reach_orientation_before_entering: bool | None = None
    maximum_rotation_speed: float | None = None
    trajectory: Trajectory | None = None
    length: float | None = None
    corridor: Corridor | None = None


class Order(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """Nodes, and the edges between them: there is one edge less. `sequence_id` runs over both: node, edge, node."""

    order_id: str
    order_update_id: int
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]
    order_description: str | None = None
    zone_set_id: str | None = None

    @property
    def base(self) -> tuple[Node, ...]:
        """The nodes that are released; they come first."""
        return tuple(node for node in self.nodes if node.released)

    @property
    def actions(self) -> tuple[Action, ...]:
        """Those of the nodes, and those of the edges."""
        return tuple(chain.from_iterable([*(node.actions for node in self.nodes), *(edge.actions for edge in self.edges)]))


class InstantActions(Struct, frozen=True, kw_only=True):
    actions: tuple[Action, ...]


class GrantType(StrEnum):
    """What fleet control decides about a request. 3.0, 6.4.3 calls the field `responseType`; the schema and 7.5 say `grantType`."""

    GRANTED = "GRANTED"
    QUEUED = "QUEUED"
    REVOKED = "REVOKED"
    REJECTED = "REJECTED"


class Response(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """`lease_expiry`: the timestamp until which what is granted is."""

    request_id: str
    grant_type: GrantType
    lease_expiry: str | None = None


class Responses(Struct, frozen=True, kw_only=True):
    responses: tuple[Response, ...]


class ZoneType(StrEnum):
    """What vehicles have to heed in a zone (3.0, 6.4.1)."""

    BLOCKED = "BLOCKED"
    LINE_GUIDED = "LINE_GUIDED"
    RELEASE = "RELEASE"
    COORDINATED_REPLANNING = "COORDINATED_REPLANNING"
    SPEED_LIMIT = "SPEED_LIMIT"
    ACTION = "ACTION"
    PRIORITY = "PRIORITY"
    PENALTY = "PENALTY"
    DIRECTED = "DIRECTED"
    BIDIRECTED = "BIDIRECTED"


class Vertex(Struct, frozen=True, kw_only=True):
    x: float
    y: float


class ZoneAction(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """An action that vehicles perform in a zone; each gives it an id by itself."""

    action_type: str
    blocking_type: BlockingType
    action_descriptor: str | None = None
    action_parameters: tuple[ActionParameter, ...] | None = None
    retriable: bool | None = None


class Zone(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """`zone_type`: one of ZoneType. `vertices`: counterclockwise. `maximum_speed`: of a SPEED_LIMIT zone. `release_loss_behavior`: of a
    RELEASE zone. `entry_actions`, `during_actions`, `exit_actions`: of an ACTION zone, which has all three."""

    zone_id: str
    zone_type: str
    vertices: tuple[Vertex, ...]
    zone_descriptor: str | None = None
    maximum_speed: float | None = None
    entry_actions: tuple[ZoneAction, ...] | None = None
    during_actions: tuple[ZoneAction, ...] | None = None
    exit_actions: tuple[ZoneAction, ...] | None = None
    release_loss_behavior: str | None = None
    priority_factor: float | None = None
    penalty_factor: float | None = None
    direction: float | None = None
    directed_limitation: str | None = None
    bidirected_limitation: str | None = None


class ZoneSetContent(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    map_id: str
    zone_set_id: str
    zones: tuple[Zone, ...]
    zone_set_descriptor: str | None = None


class ZoneSet(Struct, frozen=True, kw_only=True, rename="camel"):
    zone_set: ZoneSetContent
