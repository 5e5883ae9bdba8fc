"""What a report says besides its situation, and what became of a report.

A variable of a reported situation is a sighted object: `?Seen: Jar isOn Table001 AND ?Seen.Color = Red`. The Repository finds out which
object of the map it is, or adds it.
"""

from __future__ import annotations

import math

from msgspec import Struct, structs


class Observation(Struct, frozen=True, kw_only=True):
    """How a reported situation was observed. Without it, the situation holds at the time when the report arrives.

    `as_of`: when the situation held, in seconds since 1970. News that is newer stays on the map.
    `caused`: the author made it so at that time. What others only saw at the same time was so before.
    `gone`: objects that exist no longer.
    `searched`: supports and spaces that were seen whole; objects that the map has there and the report does not mention become unknown.
    `missed`: objects that are not where the map has them, which was in full view; they become unknown, unless the report mentions them.
    `sought`: objects that may be anywhere, wherever the map has them.
    """

    as_of: float | None = None
    gone: tuple[str, ...] = ()
    searched: tuple[str, ...] = ()
    sought: tuple[str, ...] = ()
    caused: bool = False
    missed: tuple[str, ...] = ()

    def holds_from(self, now: float) -> float:
        """The time that orders this news among other news of the same: seconds since 1970, not in the future.

        A cause comes at the least possible time after everything that was seen at the same time.
        """
        if self.as_of is None:
            return now
        return min(math.nextafter(self.as_of, math.inf) if self.caused else self.as_of, now)


class Reception(Struct, frozen=True, kw_only=True):
    """What became of a report.

    `names`: the objects that were sighted, by the variables of the report. `unidentified`: the other variables, which were left out: they
    may be objects that somebody holds or has moved since, or devices that have not joined; the next report will tell.
    `added`: those of them that are new on the map. `missing`: objects that were not seen where the report had searched.
    `superseded`: parts of the report that are older than what the map has. `as_of`: when the report held.
    """

    as_of: float | None = None
    names: dict[str, str] = {}
    added: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    superseded: tuple[str, ...] = ()
    unidentified: tuple[str, ...] = ()


class Discovery(Struct, frozen=True, kw_only=True):
    """Who put an object on the map by a sighting, and when, in seconds since 1970.

    `confirmed`: a person has named it or said which object it is, so that it is not known from sightings only.
    """

    author: str
    at: float
    confirmed: bool = False


def observed_at(observation: Observation | None, now: float) -> Observation:
    """The observation with the time at which it was made: `now`, if it has none."""
    if observation is None:
        return Observation(as_of=now)
    return observation if observation.as_of is not None else structs.replace(observation, as_of=now)
