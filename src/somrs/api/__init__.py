"""All that people and programs can do with a running system, as operations: the public API of the windows, REST and WebSocket."""
