"""The server's part of WebSockets: uvicorn's, which also answers handshakes that the parser of WebSockets refuses (RFC 6455, 4.2.2)."""

from __future__ import annotations

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol


class WebSocketProtocol(WebSocketsSansIOProtocol):
    """A WebSocket of a server.

    uvicorn neither answers nor ends a connection whose handshake has a line that is too long for the parser: it would stay open, and be one
    of those that the server serves, as long as its client likes.
    """

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self.conn.handshake_exc is not None and not self.handshake_initiated:
            self.transport.write(b"".join(self.conn.data_to_send()))
            self.transport.close()
