"""The order that a simulated vehicle carries out: which nodes and edges are to come, and how its actions are."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import chain

import msgspec

from somrs.adapters.vda5050.messages.orders import Action, BlockingType, Edge, Node, Order
from somrs.adapters.vda5050.messages.states import ActionState, ActionStatus, EdgeState, NodeState
from somrs.adapters.vda5050.simulated.acceptance import TOLERANCE
from somrs.adapters.vda5050.simulated.corners import Point, has_come


@dataclass(kw_only=True)
class Progress:
    """`order`: the last message; None: there was none. `nodes`, `edges`: those to come. `queue`: the actions that were triggered and have
    not ended, in their order (3.0, figure 11). `decision_point`: the last node of the base."""

    order: Order | None = None
    nodes: list[Node] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)
    decision_point: Node | None = None
    last_node_id: str = ""
    last_sequence_id: int = 0
    actions: dict[str, Action] = field(default_factory=dict)
    states: dict[str, ActionState] = field(default_factory=dict)
    queue: list[Action] = field(default_factory=list)
    is_cancelled: bool = False

    @property
    def is_idle(self) -> bool:
        """3.0, 6.6.8."""
        return not self.nodes and not self.edges and all(state.action_status.is_final for state in self.states.values())

    def begin(self, order: Order) -> None:
        """Take over a new order: its first node counts as traversed (3.0, 6.1.1)."""
        self.order, self.is_cancelled = order, False
        self.actions, self.states, self.queue = {}, {}, []
        self.nodes, self.edges = list(order.nodes), list(order.edges)
        self._note_actions(order)
        self.decision_point = order.base[-1]
        self.traverse()

    def continue_with(self, order: Order) -> None:
        """Take over an update: the horizon gives way, and the decision point is not repeated (3.0, 6.1.2)."""
        self.order = order
        dropped = [node.actions for node in self.nodes if not node.released] + [edge.actions for edge in self.edges if not edge.released]
        for action in chain.from_iterable(dropped):
            self.states.pop(action.action_id, None)
        self.nodes = [node for node in self.nodes if node.released] + list(order.nodes[1:])
        self.edges = [edge for edge in self.edges if edge.released] + list(order.edges)
        self.decision_point = order.base[-1]
        self._note_actions(msgspec.structs.replace(order, nodes=order.nodes[1:]))

    def traverse(self) -> None:
        """The vehicle has come to the next node."""
        node = self.nodes.pop(0)
        if self.edges and self.edges[0].sequence_id < node.sequence_id:
            edge = self.edges.pop(0)
            for action in edge.actions:
                self.set_status(action.action_id, ActionStatus.FINISHED)
                self.queue = [queued for queued in self.queue if queued.action_id != action.action_id]
        self.last_node_id, self.last_sequence_id = node.node_id, node.sequence_id
        self.queue.extend(node.actions)

    def leg(self, map_id: str) -> tuple[list[Node], list[Edge]]:
        """The released nodes that can be driven to without a stop, and the edges to them: up to one with an action for which the vehicle
        has to stand, an edge of another speed or direction, or a node on another map than the vehicle, to which a lift takes it."""
        nodes: list[Node] = []
        edges: list[Edge] = []
        for node, edge in zip(self.nodes, self.edges, strict=False):
            if not node.released or not edge.released:
                break
            if node.node_position is not None and node.node_position.map_id != map_id:
                break
            if edges and (edge.maximum_speed, edge.orientation) != (edges[0].maximum_speed, edges[0].orientation):
                break
            nodes.append(node)
            edges.append(edge)
            if any(action.blocking_type in (BlockingType.SOFT, BlockingType.HARD) for action in node.actions):
                break
        return nodes, edges

    def pass_nodes(self, map_id: str, place: Point, earlier: Point) -> None:
        """Traverse the nodes that are passed on the way; where the vehicle has to stop, it comes to the end of its leg at first.
        `earlier`: where it was when this was looked at before."""
        nodes, _ = self.leg(map_id)
        while len(nodes) > 1 and has_come(nodes, place, earlier):
            self.traverse()
            del nodes[0]

    def arrive_by_lift(self, map_id: str, place: Point) -> None:
        """The vehicle leaves the map of a floor, and is at the node of the lift on the map of another one (3.0, 7.3)."""
        node = self.nodes[0] if self.nodes and self.nodes[0].released else None
        if node is not None and node.node_position is not None and node.node_position.map_id == map_id and _is_at(node, place):
            self.traverse()

    def must_stand(self) -> bool:
        """Whether an action in the queue does not let the vehicle drive."""
        return any(action.blocking_type in (BlockingType.SOFT, BlockingType.HARD) for action in self.queue)

    def startable(self) -> list[Action]:
        """The actions that may begin now (3.0, 6.2.2)."""
        running = [action for action in self.queue if self.states[action.action_id].action_status is not ActionStatus.WAITING]
        ready: list[Action] = []
        for action in self.queue:
            excludes_parallel = action.blocking_type in (BlockingType.HARD, BlockingType.SINGLE)
            if action in running:
                if excludes_parallel:
                    break
                continue
            if excludes_parallel and (running or ready):
                break
            ready.append(action)
            if excludes_parallel:
                break
        return ready

    def set_status(self, action_id: str, status: ActionStatus, words: str | None = None) -> None:
        state = self.states.get(action_id)
        if state is not None and not state.action_status.is_final:
            self.states[action_id] = msgspec.structs.replace(state, action_status=status, action_result=words)
            if status.is_final:
                self.queue = [action for action in self.queue if action.action_id != action_id]

    def retriable(self, action_id: str) -> Action | None:
        """The action of this id, if it has failed and can be tried again."""
        state = self.states.get(action_id)
        return self.actions[action_id] if state is not None and state.action_status is ActionStatus.RETRIABLE else None

    def trigger(self) -> None:
        """What the vehicle waits for has happened."""
        for action in [action for action in self.queue if action.action_type == "waitForTrigger"]:
            self.set_status(action.action_id, ActionStatus.FINISHED)

    def clear(self) -> None:
        """Drop the order (3.0, 6.6.7): its ids are kept."""
        self.nodes, self.edges = [], []
        for action_id in list(self.states):
            self.set_status(action_id, ActionStatus.FAILED)
        self.is_cancelled = True

    def node_states(self) -> tuple[NodeState, ...]:
        return tuple(NodeState(node_id=node.node_id, sequence_id=node.sequence_id, released=node.released) for node in self.nodes)

    def edge_states(self) -> tuple[EdgeState, ...]:
        return tuple(EdgeState(edge_id=edge.edge_id, sequence_id=edge.sequence_id, released=edge.released) for edge in self.edges)

    def _note_actions(self, order: Order) -> None:
        for action in order.actions:
            self.actions[action.action_id] = action
            self.states[action.action_id] = ActionState(
                action_id=action.action_id, action_type=action.action_type, action_status=ActionStatus.WAITING
            )


def _is_at(node: Node, place: Point) -> bool:
    position = node.node_position
    return position is not None and math.dist((position.x, position.y), place) <= TOLERANCE
