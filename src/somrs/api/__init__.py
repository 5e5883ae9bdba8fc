"""The public API of a running system: its operations, served over REST and WebSocket, and used by the windows."""
