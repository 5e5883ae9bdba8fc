"""The hands of a person in the simulated world: what a person reports as done is done there, too, so that robots meet it.

In a real building nothing of this runs: the person has moved the thing.
"""

from __future__ import annotations

import logging

from somrs.devices.person.spots import free_spot
from somrs.devices.simulator.link.link import OperatorLink
from somrs.entish.formula import Formula, Name, Relation, conjuncts
from somrs.entish.parse import parse
from somrs.errors import SomrsError
from somrs.service_manager.sdk.map_reader import MapReader

log = logging.getLogger(__name__)

_CLEARANCE = 0.02
"""Height above its support from which a thing is dropped, m."""


async def put_in_place(person: str, simulator: str | None, map: MapReader, effect: Formula, situation: Formula) -> Formula:
    """Move the things that the effect says are on something, in the simulator at `simulator` (host:port), if there is one.

    Returns the situation after the work, with the positions that the things then have.
    """
    moves = [part.arguments for part in conjuncts(effect) if isinstance(part, Relation) and part.relation == "isOn"]
    pairs = [(thing.name, support.name) for thing, support in moves if isinstance(thing, Name) and isinstance(support, Name)]
    if simulator is None or not pairs:
        return situation
    parts = [str(situation)]
    try:
        async with OperatorLink.at(simulator) as operator:
            for thing, support in pairs:
                x, y, z = await free_spot(map, person, support)
                await operator.move(thing, x, y, z + _CLEARANCE)
                await operator.idle()
                state = await operator.observe(thing)
                position = zip("XYZ", (state.x, state.y, state.z), strict=True)
                parts += [f"{thing}.Position{axis} = {value:.3f}" for axis, value in position]
    except (SomrsError, OSError) as error:
        log.info("%s is not moved in a simulated world: %s", pairs[0][0], error)
    return parse(" AND ".join(parts))
