"""The parameters of one robot: those that were given, or those of its type, with what it says of itself; and what it is told of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from msgspec.structs import replace

from somrs.adapters.arcos.messages import Command, Configuration
from somrs.adapters.arcos.parameters import TYPES, Parameters

PLAUSIBLE_WATCHDOG = range(200, 10_001)
"""Times of a watchdog that a robot may have, ms. Of others, it is taken to have the usual one."""


def own_parameters(
    given: Parameters | None, configuration: Configuration | None, identity: Sequence[str], speed_limit: float | None
) -> Parameters | None:
    """Those that were given, or of the type that the robot has said, with what it has said of itself; None if it has said nothing.

    `identity`: as of `Session.identity`. `speed_limit`: m/s; None: as in the parameters.
    """
    subkind = configuration.subkind if configuration is not None else identity[2] if len(identity) > 2 else None
    parameters = given or (TYPES.get(subkind.lower(), Parameters()) if subkind is not None else None)
    if parameters is None:
        return None
    if configuration is not None and configuration.watchdog is not None and configuration.watchdog in PLAUSIBLE_WATCHDOG:
        parameters = replace(parameters, watchdog=configuration.watchdog / 1000)
    return replace(parameters, speed=speed_limit) if speed_limit is not None else parameters


def limits(parameters: Parameters) -> Iterable[tuple[Command, int]]:
    """The commands that set how fast the robot is, and how it accelerates and brakes."""
    acceleration = round(1000 * parameters.acceleration)
    turning_acceleration = round(math.degrees(parameters.turning_acceleration))
    return (
        (Command.SETV, round(1000 * parameters.speed)),
        (Command.SETA, acceleration),
        (Command.SETA, -acceleration),
        (Command.SETRV, math.ceil(math.degrees(parameters.turning))),
        (Command.SETRA, turning_acceleration),
        (Command.SETRA, -turning_acceleration),
    )
