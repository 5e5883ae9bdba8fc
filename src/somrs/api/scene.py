"""The scene in three dimensions: the bodies of objects, and their poses as they move, at the WebSocket `poses`."""

from __future__ import annotations

import asyncio

from starlette.websockets import WebSocket

from somrs.access.rights import Right
from somrs.api.bodies import Scene, scene_of
from somrs.api.context import Context
from somrs.api.poses import PoseFeed
from somrs.client.operations import operation
from somrs.client.refusals import NotFound


class SceneService:
    def __init__(self, context: Context) -> None:
        self._context = context
        self._feed = PoseFeed(context)
        self._whole: Scene | None = None

    @operation("GET", "/scene", Right.SEE)
    async def read(self, version: int | None = None, names: str | None = None) -> Scene:
        """Read the bodies to draw, according to the map as it is now, or as it was at a version.

        With `names`, separated by commas, only these objects. The WebSocket `/api/poses` sends the poses of objects while they move.
        """
        map, now, ontology = self._context.map, self._context.version, self._context.ontology
        if names is not None:
            selected_names = [name for name in names.split(",") if name in map.objects]
            return scene_of(map, now, ontology, (map.objects[name] for name in selected_names))
        if version is not None and version != now:
            if not 0 <= version <= now:
                raise NotFound(f"there is no version {version} of the map; the latest is {now}")
            map, ontology = await asyncio.gather(self._context.client.map(version), self._context.client.ontology(version))
            return scene_of(map, version, ontology, map.objects.values())
        if self._whole is None or self._whole.version != now:
            self._whole = scene_of(map, now, ontology, map.objects.values())
        return self._whole

    async def poses(self, socket: WebSocket) -> None:
        """Send the poses of movable objects until the connection ends. `poses.py` describes the messages."""
        await socket.accept()
        with self._feed.viewing():
            sender = asyncio.create_task(self._send_poses(socket))
            try:
                while (await socket.receive())["type"] != "websocket.disconnect":
                    pass
            finally:
                sender.cancel()

    async def _send_poses(self, socket: WebSocket) -> None:
        """Send the latest tick again and again; a slow viewer skips the ticks in between."""
        last_tick: int | None = None
        while True:
            tick, messages = await self._feed.wait_for_tick(last_tick)
            for message in messages:
                await (socket.send_bytes(message) if isinstance(message, bytes) else socket.send_text(message))
            last_tick = tick
