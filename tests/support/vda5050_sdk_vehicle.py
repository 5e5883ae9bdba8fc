"""A vehicle of another make, which speaks VDA 5050 2.1: made with PyPI's `vda5050-sdk`, which holds what it is sent against the schemas.

    python vda5050_sdk_vehicle.py BROKER MANUFACTURER SERIAL_NUMBER

It is at each node of its base a moment after the one before, and performs the actions there.
"""

from __future__ import annotations

import asyncio
import importlib
import sys
from typing import Any

PAUSE = 0.2
"""Seconds from node to node, and for which an action runs."""


class Vehicle:
    def __init__(self, broker: str, manufacturer: str, serial_number: str) -> None:
        self._sdk = importlib.import_module("vda5050")
        configuration = self._sdk.VehicleConfig(
            manufacturer=manufacturer, serial_number=serial_number, broker_url=broker, validate_messages=True
        )
        self.client = self._sdk.VehicleClient(configuration)
        self._orders: asyncio.Queue[Any] = asyncio.Queue()

    async def run(self) -> None:
        async with self.client:
            self._move(0.0, 0.0)
            self.client.on_order(self._orders.put)
            await self.client.publish_state()
            while True:
                await self._carry_out(await self._orders.get())

    def _move(self, x: float, y: float) -> None:
        self.client.update_position(x=x, y=y, theta=0.0, map_id="hall", position_initialized=True)

    async def _carry_out(self, order: Any) -> None:
        edges = {edge.sequence_id: edge for edge in order.edges}
        for node in order.nodes:
            if not node.released:
                break
            await asyncio.sleep(PAUSE)
            self._move(node.node_position.x, node.node_position.y)
            self.client.mark_node_traversed(node.node_id, node.sequence_id)
            if (edge := edges.get(node.sequence_id - 1)) is not None:
                self.client.mark_edge_traversed(edge.edge_id, edge.sequence_id)
            for action in node.actions:
                self.client.report_action(action.action_id, self._sdk.ActionStatus.RUNNING)
                await self.client.publish_state()
                await asyncio.sleep(PAUSE)
                self.client.report_action(action.action_id, self._sdk.ActionStatus.FINISHED)
            await self.client.publish_state()


if __name__ == "__main__":
    asyncio.run(Vehicle(*sys.argv[1:]).run())
