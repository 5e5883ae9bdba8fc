"""ARCOS: the protocol of Pioneer robots, over a serial line or TCP."""
