"""Orders made of ways: the base is what is released, the horizon the rest; and what a vehicle has been told so far."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import msgspec

from somrs.adapters.vda5050.frames import Frames, Pose, sent_angle
from somrs.adapters.vda5050.messages.factsheets import StringLengths
from somrs.adapters.vda5050.messages.identifiers import fitting_id
from somrs.adapters.vda5050.messages.orders import (
    Action,
    ControlPoint,
    Deviation,
    Edge,
    Node,
    NodePosition,
    Order,
    Trajectory,
)
from somrs.adapters.vda5050.messages.states import State, VehicleError
from somrs.devices.road_robot import Way, Waypoint

NEAR = 0.1
"""Distance in metres within which a vehicle stands at a waypoint."""


USEFUL = frozenset({"theta", "allowedDeviationXY", "maximumSpeed", "orientation", "orientationType"})
"""The optional parameters of orders that are sent to a vehicle that does not say which it takes."""

OPTIONAL = USEFUL | {"trajectory", "length", "retriable"}
"""The optional parameters that are sent to a vehicle that takes them. Positions of nodes are always sent: vehicles know no other places."""

SENT = OPTIONAL | {"nodePosition", "actionParameters"}
"""All optional parameters that are sent if they are of use."""


@dataclass(kw_only=True)
class SentOrder:
    """An order as a vehicle has been told it.

    `first`: the number of the waypoint whose sequenceId is 0. `decision_point`: the last waypoint of the base. `horizon`: what follows it.
    `passed`: the number of the last waypoint that the vehicle has passed. `earlier_errors`: those that the vehicle had when the last
    message was sent. `cleared`: how many states in a row say that the vehicle has dropped the order. `sendings`: how often the last message
    was sent to a vehicle that says how it is.
    """

    message: Order
    first: int
    decision_point: Waypoint
    horizon: Way
    sending_time: float
    passed: int
    action_id: str | None = None
    is_acknowledged: bool = False
    earlier_errors: tuple[VehicleError, ...] = ()
    cleared: int = 0
    sendings: int = 0
    nodes: dict[int, Node] = field(default_factory=dict)

    def waypoint_number(self, sequence_id: int, node_id: str) -> int | None:
        """The number of the waypoint of a node; None if the order has no such node."""
        number = self.first + sequence_id // 2
        node = self.nodes.get(number)
        return number if sequence_id % 2 == 0 and node is not None and node.node_id == node_id else None

    def remember(self) -> None:
        """Note the nodes of the message, by the numbers of their waypoints."""
        self.nodes.update({self.first + node.sequence_id // 2: node for node in self.message.nodes})


def base_end(way: Way) -> Waypoint:
    """The last released waypoint of a way."""
    return [waypoint for waypoint in way if waypoint.released][-1]


def told_base_end(order: SentOrder, state: State) -> int | None:
    """The number of the last waypoint that is released by what the vehicle says of the last message; None: it does not contradict it."""
    if (state.order_id, state.order_update_id) != (order.message.order_id, order.message.order_update_id):
        return None
    nodes = [(order.waypoint_number(node.sequence_id, node.node_id), node.released) for node in state.node_states]
    end = order.decision_point.number
    beyond = [number for number, released in nodes if number is not None and released and number > end]
    refused = [number for number, released in nodes if number is not None and not released and order.first < number <= end]
    return max(beyond, default=min(refused) - 1 if refused else None)


def name_of(waypoint: Waypoint) -> str:
    """The name of a node: that of the Place of the map, if there is one, which vehicles may have been taught; else that of traffic."""
    return waypoint.mark or waypoint.name


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderWriter:
    """Writes the nodes and edges of a vehicle. `map_id`: the map on which it is. `pose`: where it stands; None: not known.
    `parameters`: the optional ones that it takes. With `trajectory`, edges have the straight line between their nodes, for vehicles that
    find paths of their own. `limits`: of its identifiers."""

    frames: Frames
    map_id: str
    pose: Pose | None
    parameters: frozenset[str] = USEFUL
    limits: StringLengths | None = None

    def new_order(self, order_id: str, way: Way, actions: tuple[Action, ...] = ()) -> Order:
        """The order with the waypoints of a way. `actions`: at its first one."""
        first = way[0].number
        nodes = [self._node(waypoint, first, is_end=waypoint is way[-1]) for waypoint in way]
        position = self._reaching_vehicle(way[0], nodes[0].node_position)
        nodes[0] = msgspec.structs.replace(nodes[0], node_position=position, actions=actions)
        return Order(order_id=order_id, order_update_id=0, nodes=tuple(nodes), edges=self._edges(way, first))

    def update(self, order: SentOrder, way: Way) -> Order:
        """The update of an order, from its decision point on, which is the first waypoint of the way, and is not changed (3.0, 6.1.2)."""
        previous = order.message
        nodes = [self._node(waypoint, order.first, is_end=waypoint is way[-1]) for waypoint in way[1:]]
        return Order(
            order_id=previous.order_id,
            order_update_id=previous.order_update_id + 1,
            nodes=(order.nodes[way[0].number], *nodes),
            edges=self._edges(way, order.first),
        )

    def _node(self, waypoint: Waypoint, first: int, *, is_end: bool) -> Node:
        """`is_end`: the vehicle stops there, so that its heading matters."""
        frame = self.frames.frame_at(waypoint.level, self.map_id)
        x, y = frame.from_site(waypoint.x, waypoint.y)
        yaw = waypoint.yaw if is_end and "theta" in self.parameters else None
        theta = sent_angle(yaw - frame.yaw) if yaw is not None else None
        return Node(
            node_id=fitting_id(name_of(waypoint), self.limits),
            sequence_id=2 * (waypoint.number - first),
            released=waypoint.released,
            actions=(),
            node_position=NodePosition(x=round(x, 4), y=round(y, 4), map_id=frame.map_id, theta=theta),
        )

    def _reaching_vehicle(self, waypoint: Waypoint, position: NodePosition | None) -> NodePosition | None:
        """The position of a first node: the vehicle has to be within its deviation, or it rejects the order (3.0, 6.1.3.1). For one that
        knows no deviations, the node is where it stands."""
        if self.pose is None or position is None:
            return position
        distance = math.hypot(self.pose.x - waypoint.x, self.pose.y - waypoint.y)
        if distance <= NEAR:
            return msgspec.structs.replace(position, theta=None)
        if "allowedDeviationXY" not in self.parameters:
            x, y = self.frames.frame(position.map_id).from_site(self.pose.x, self.pose.y)
            return msgspec.structs.replace(position, theta=None, x=round(x, 4), y=round(y, 4))
        radius = math.ceil(10 * (1.2 * distance + NEAR)) / 10
        return msgspec.structs.replace(position, theta=None, allowed_deviation_xy=Deviation(a=radius, b=radius, theta=0.0))

    def _edges(self, way: Way, first: int) -> tuple[Edge, ...]:
        return tuple(self._edge(start, end, first) for start, end in pairwise(way))

    def _edge(self, start: Waypoint, end: Waypoint, first: int) -> Edge:
        turns = {"orientation", "orientationType"} <= self.parameters
        orientation = {"Forward": 0.0, "Backward": sent_angle(math.pi)}.get(end.travel or "") if turns else None
        return Edge(
            edge_id=fitting_id(f"{name_of(start)}-{name_of(end)}", self.limits),
            sequence_id=2 * (end.number - first) - 1,
            released=start.released and end.released,
            start_node_id=fitting_id(name_of(start), self.limits),
            end_node_id=fitting_id(name_of(end), self.limits),
            actions=(),
            maximum_speed=end.speed_limit if "maximumSpeed" in self.parameters else None,
            orientation=orientation,
            orientation_type="TANGENTIAL" if orientation is not None else None,
            trajectory=self._line(start, end) if "trajectory" in self.parameters else None,
            length=round(math.dist((start.x, start.y), (end.x, end.y)), 3) if "length" in self.parameters else None,
        )

    def _line(self, start: Waypoint, end: Waypoint) -> Trajectory | None:
        """The straight line between two waypoints; None if a lift is between them."""
        frame = self.frames.frame_at(start.level, self.map_id)
        if self.frames.frame_at(end.level, self.map_id) != frame:
            return None
        points = [frame.from_site(waypoint.x, waypoint.y) for waypoint in (start, end)]
        control_points = tuple(ControlPoint(x=round(x, 4), y=round(y, 4)) for x, y in points)
        return Trajectory(degree=1, knot_vector=(0.0, 0.0, 1.0, 1.0), control_points=control_points)
