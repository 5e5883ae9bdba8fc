"""The scene in three dimensions: what things look like, and, at the WebSocket `poses`, where they are, as the simulator has it."""

from __future__ import annotations

from starlette.websockets import WebSocket

from somrs.app.desk.context import Context


class SceneDesk:
    def __init__(self, context: Context) -> None:
        self._context = context

    async def poses(self, socket: WebSocket) -> None:
        """Send where things are, as they move, until the connection ends."""
        await socket.accept()
        await socket.close(1011, "there is no simulator")
