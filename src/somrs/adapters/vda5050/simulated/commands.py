"""What the body of a simulated vehicle is told for an action, and for a leg of its way."""

from __future__ import annotations

import math
from collections.abc import Sequence

from somrs.adapters.vda5050.messages.orders import Action, Edge, Node
from somrs.adapters.vda5050.simulated.body import Charge, Command, Drive, Drop, Pick, Rest

BODILY = frozenset({"pick", "drop", "startCharging", "stopCharging"})
"""The actions that are something for the body."""


def command_for(action: Action, load: str | None) -> Command:
    """What carries out an action of `BODILY`. `load`: what the vehicle carries."""
    named, station = str(action.parameter("loadId") or "load"), str(action.parameter("stationName") or "")
    match action.action_type:
        case "pick":
            return Pick(load=named, station=station)
        case "drop":
            return Drop(load=load or named, station=station)
        case "startCharging":
            return Charge()
        case _:
            return Rest()


def drive_command(nodes: Sequence[Node], edges: Sequence[Edge], map_id: str, limit: float) -> Drive:
    """To drive to nodes, along edges of the same speed and direction. `limit`: the highest speed besides, m/s."""
    positions = [node.node_position for node in nodes if node.node_position is not None]
    speed = min(edges[0].maximum_speed or math.inf, limit)
    return Drive(
        points=tuple((position.x, position.y) for position in positions),
        map_id=map_id,
        speed=speed if math.isfinite(speed) else None,
        backward=edges[0].orientation is not None and abs(edges[0].orientation) > math.pi / 2,
        yaw=nodes[-1].node_position.theta if nodes[-1].node_position is not None else None,
    )
