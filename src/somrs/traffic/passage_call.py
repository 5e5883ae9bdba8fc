"""What a lift or an automatic door is called for, and how it is: for traffic, for the program of the passage, and for its author."""

from __future__ import annotations

from msgspec import Struct


class PassageCall(Struct, frozen=True, kw_only=True):
    """What a passage is needed for. A lift: at the floor of the height `level`, in metres, for `robots`, whose ride leads to the floor of
    the height `destination`, as far as that is known. A door: nothing else."""

    level: float | None = None
    destination: float | None = None
    robots: tuple[str, ...] = ()


class PassageStatus(Struct, frozen=True, kw_only=True):
    """How a passage is. `level`: the height of the floor at which a cabin stands, in metres; None while it moves, and for a door.
    `working`: it has no fault. `shared`: people or other systems use it now."""

    level: float | None = None
    working: bool = True
    shared: bool = False
