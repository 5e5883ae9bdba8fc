"""Whether a vehicle accepts an order: the chart of figure 8, and the rules of 3.0, 6.1.1 (2.1, 6.6.1) for the order itself."""

from __future__ import annotations

import math
from collections.abc import Collection
from itertools import pairwise

import msgspec
from msgspec import Struct

from somrs.adapters.vda5050.messages.factsheets import Factsheet, StringLengths
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.orders import Action, Node, Order
from somrs.adapters.vda5050.messages.states import OperatingMode
from somrs.adapters.vda5050.simulated.problems import Problem

TOLERANCE = 0.25
"""Distance in metres within which a vehicle stands on a node that has no deviation of its own."""

REQUIRED_IN_2 = {"start_node_id", "end_node_id"}
"""Fields that 3.0 does not have."""

ORDERS_ALLOWED = frozenset({OperatingMode.AUTOMATIC, OperatingMode.SEMIAUTOMATIC, OperatingMode.INTERVENED})
CLEARING = frozenset({OperatingMode.MANUAL, OperatingMode.STARTUP, OperatingMode.SERVICE, OperatingMode.TEACH_IN})
"""Modes in which the vehicle drops its order (3.0, table 11)."""


class Situation(Struct, frozen=True, kw_only=True):
    """How a vehicle is when an order comes. `decision_point`: the last node of its base; None: it has had no order. `sheet`:
    what it says that it takes."""

    version: Version
    order: Order | None
    decision_point: Node | None
    is_idle: bool
    is_cancelled: bool
    is_available: bool
    x: float
    y: float
    maps: Collection[str]
    sheet: Factsheet


def objection(order: Order, situation: Situation) -> tuple[Problem, str] | None:
    """Why the vehicle rejects an order. None: it accepts it, or ignores it as one that it has."""
    for problem, words in (
        (Problem.MALFORMED, _malformed(order, situation.version)),
        (Problem.MALFORMED, _unfit_id(order, situation.sheet.protocol_limits.maximum_string_lengths)),
        (Problem.UNSUPPORTED_FIELD, _unsupported_field(order, situation.sheet)),
        (Problem.UNSUPPORTED_ACTION, _unsupported_action(order, situation.sheet)),
        (Problem.UNKNOWN_MAP, _unknown_map(order, situation.maps)),
        (Problem.NOT_AVAILABLE, None if situation.is_available else "the vehicle takes no orders now"),
    ):
        if words is not None:
            return problem, words
    current = situation.order
    if current is None or order.order_id != current.order_id:
        return _objection_to_new(order, situation)
    return _objection_to_update(order, current, situation)


def is_repetition(order: Order, situation: Situation) -> bool:
    """Whether the vehicle has the order already, and ignores it (3.0, 6.1.4.5)."""
    current = situation.order
    return current is not None and (order.order_id, order.order_update_id) == (current.order_id, current.order_update_id)


def _objection_to_new(order: Order, situation: Situation) -> tuple[Problem, str] | None:
    if not situation.is_idle:
        return Problem.ANOTHER_ORDER, "another order is active"
    if situation.version is Version.V3_0 and order.order_update_id != 0:
        return Problem.MALFORMED, "a new order begins with orderUpdateId 0"
    if order.nodes[0].sequence_id != 0:
        return Problem.MALFORMED, "a new order begins with sequenceId 0"
    position = order.nodes[0].node_position
    if position is not None:
        deviation = position.allowed_deviation_xy
        distance = math.hypot(position.x - situation.x, position.y - situation.y)
        if distance > max(TOLERANCE, deviation.b if deviation is not None else 0.0):
            return Problem.OUT_OF_RANGE, f"the first node is {distance:.2f} m away"
    return None


def _objection_to_update(order: Order, current: Order, situation: Situation) -> tuple[Problem, str] | None:
    if order.order_update_id < current.order_update_id:
        return Problem.OUTDATED, f"the vehicle has orderUpdateId {current.order_update_id}"
    if order.order_update_id == current.order_update_id:
        return (Problem.CONTENT_DIFFERS, "the vehicle has another order of this id") if order != current else None
    if situation.is_cancelled:
        return Problem.CANCELLED, "the order was cancelled"
    end, start = situation.decision_point, order.nodes[0]
    if end is None or (start.node_id, start.sequence_id) != (end.node_id, end.sequence_id):
        return Problem.NO_CONTINUATION, "the first node is not the decision point"
    return None


def _malformed(order: Order, version: Version) -> str | None:
    nodes, edges = order.nodes, order.edges
    if not nodes or len(edges) != len(nodes) - 1:
        return "an order has one edge less than nodes"
    first = nodes[0].sequence_id
    if [node.sequence_id for node in nodes] != list(range(first, first + 2 * len(nodes), 2)):
        return "the sequenceIds of the nodes are not continuous"
    if [edge.sequence_id for edge in edges] != list(range(first + 1, first + 2 * len(edges), 2)):
        return "the sequenceIds of the edges are not continuous"
    if not nodes[0].released or any(end.released and not start.released for start, end in pairwise(nodes)):
        return "the base has a gap"
    if any(edge.released != nodes[index + 1].released for index, edge in enumerate(edges)):
        return "an edge is released if and only if its ends are"
    ends = [(edge.start_node_id, edge.end_node_id) for edge in edges]
    if version is not Version.V3_0 and ends != [(start.node_id, end.node_id) for start, end in pairwise(nodes)]:
        return "an edge does not have the ends that the order of the nodes gives it"
    ids = [action.action_id for action in order.actions]
    return "two actions have the same id" if len(ids) != len(set(ids)) else None


def _unfit_id(order: Order, limits: StringLengths) -> str | None:
    """An identifier that the vehicle cannot take (3.0, 7.10)."""
    ids = [order.order_id, *(node.node_id for node in order.nodes), *(edge.edge_id for edge in order.edges)]
    for text in [*ids, *(action.action_id for action in order.actions)]:
        if limits.maximum_id_length and len(text) > limits.maximum_id_length:
            return f"{text} is longer than {limits.maximum_id_length}"
        if limits.id_numerical_only and not (text.isascii() and text.isdigit()):
            return f"{text} is no number"
    return None


def _unsupported_field(order: Order, sheet: Factsheet) -> str | None:
    """An optional parameter that the vehicle does not take (3.0, 6.1.4.2)."""
    if any(action.retriable is not None for action in order.actions) and not sheet.takes("retriable"):
        return "retriable"
    nodes = [part for node in order.nodes for part in (node, node.node_position) if part is not None]
    for part in (*nodes, *order.edges):
        for field in msgspec.structs.fields(part):
            is_sent = not field.required and getattr(part, field.name) is not None and field.name not in REQUIRED_IN_2
            if is_sent and not sheet.takes(field.encode_name):
                return field.encode_name
    return None


def _unsupported_action(order: Order, sheet: Factsheet) -> str | None:
    """An action that the vehicle does not perform there."""
    at_nodes = ((action, "NODE") for node in order.nodes for action in node.actions)
    on_edges = ((action, "EDGE") for edge in order.edges for action in edge.actions)
    return next((action.action_type for action, scope in (*at_nodes, *on_edges) if not _has_scope(action, scope, sheet)), None)


def instant_objection(action: Action, mode: OperatingMode, sheet: Factsheet) -> str | None:
    """Why the vehicle does not carry out an instant action (3.0, 6.2.1 and table 11). None: it does."""
    if mode in CLEARING or (mode is OperatingMode.INTERVENED and action.action_type != "cancelOrder"):
        return f"the vehicle is in the mode {mode}"
    return None if _has_scope(action, "INSTANT", sheet) else f"{action.action_type} is not supported"


def _has_scope(action: Action, scope: str, sheet: Factsheet) -> bool:
    supported = sheet.action(action.action_type)
    return supported is not None and scope in supported.action_scopes


def _unknown_map(order: Order, maps: Collection[str]) -> str | None:
    positions = [node.node_position for node in order.nodes if node.node_position is not None]
    return next((position.map_id for position in positions if position.map_id not in maps), None)
