"""Ports for servers that bind them by themselves, so that nobody can hold them meanwhile.

They are below those that Linux gives to connections (ip(7)), and each process has ports of its own, one after the other: a port that is
chosen, and not bound yet, is not chosen by another test.
"""

from __future__ import annotations

import itertools
import os
import socket

FIRST, BLOCKS, SIZE = 12_000, 160, 50
"""The first port, and the numbers of blocks and of ports in each: a process has a block."""

_offsets = itertools.cycle(range(SIZE))


def free_port() -> int:
    """A free port of 127.0.0.1 that this process has not got lately."""
    for _ in range(SIZE):
        port = FIRST + os.getpid() % BLOCKS * SIZE + next(_offsets)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port
    raise AssertionError(f"none of the {SIZE} ports of this process is free")
