"""The messages of the session interface of lifts and doors, which are the same over MQTT and HTTP.

A request names the session, the level at which the cabin is to be, and the level to which the ride leads; the doors stay open until the
next request. A state says who has the session, where the cabin stands, and how its doors are.
"""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

Doors = Literal["open", "closed", "moving"]
Mode = Literal["normal", "shared", "fire", "emergency", "out-of-order"]


class SessionRequest(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Have the cabin at `level`, with open doors, for this session, or open the door; `end`: the session is over.

    `destination`: the level to which the ride leads, as far as it is known.
    """

    session: str
    level: str | None = None
    destination: str | None = None
    end: bool = False


class SessionState(Struct, frozen=True, kw_only=True):
    """How the lift or door is. `level`: at which the cabin stands; None while it moves. `session`: who has it.

    `mode` shared: people or other systems use it now.
    """

    doors: Doors
    level: str | None = None
    session: str | None = None
    mode: Mode = "normal"
