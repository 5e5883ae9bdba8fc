"""When simulated vehicles have come to nodes at which they do not stop: those who take a node for passed too early cut its corner."""

from __future__ import annotations

import pytest

from somrs.adapters.vda5050.messages.orders import Node, NodePosition
from somrs.adapters.vda5050.simulated.corners import has_come

AHEAD = [
    Node(node_id=name, sequence_id=number, released=True, actions=(), node_position=NodePosition(x=x, y=y, map_id="map"))
    for number, (name, x, y) in enumerate((("corner", 2.0, 0.0), ("after", 2.0, 2.0)))
]


@pytest.mark.parametrize(
    ("earlier", "place", "expected"),
    [
        ((0.0, 0.0), (1.0, 0.0), False),
        ((1.0, 0.0), (1.8, 0.0), False),  # a fifth of a metre before it, others may stand where the corner would be cut
        ((1.8, 0.0), (1.95, 0.0), True),
        ((1.9, 0.0), (2.0, 0.3), True),  # it was not seen at the node
        ((1.0, 0.0), (2.5, 0.0), False),
        ((2.0, 1.0), (2.0, 0.9), False),  # on the way back to it
    ],
)
def test_a_node_is_passed_where_it_is(earlier: tuple[float, float], place: tuple[float, float], expected: bool) -> None:
    assert has_come(AHEAD, place, earlier) is expected
