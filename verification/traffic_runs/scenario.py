"""What happens in a run: the roadmap, the robots with their trips, and what goes wrong when."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from somrs.protocol.messages.traffic import Berth
from somrs.traffic.roadmap import Roadmap


class Trouble(StrEnum):
    BREAKS = "breaks"
    """The robot cannot move any more, and says so."""
    DIES = "dies"
    """The program of the robot is killed, and the robot stops where it is."""
    TRAFFIC_DIES = "traffic dies"
    """Traffic is killed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Incident:
    """Something goes wrong `at` a time, and is mended after `seconds`. `robot`: the number of the robot."""

    trouble: Trouble
    at: float
    seconds: float
    robot: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """Traffic is held, such as in a fire, from a time on, for so many seconds."""

    at: float
    seconds: float


class GateTrouble(StrEnum):
    """What happens to a lift or an automatic door."""

    DIES = "dies"
    """Its program is killed, and the passage stays as it is."""
    FAULT = "fault"
    """It reports that it does not work."""
    SHARED = "shared"
    """People use it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GateIncident:
    """Something happens to a lift or a door `at` a time, for so many seconds."""

    trouble: GateTrouble
    gate: str
    at: float
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """`starts` and `trips`: places, by robot. `berths`: by robot, those of its destinations that are beside the roadmap. `slowness`: by
    robot, the factor of the time for lanes. `work`: the seconds for which a robot works where it has arrived. `worker`: the place of a
    further robot, which works all the time, and is in nobody's way. `holds`: one after the other.
    `gate_incidents`: for lifts and doors with programs."""

    seed: int
    roadmap: Roadmap
    starts: tuple[str, ...]
    trips: tuple[tuple[str, ...], ...]
    berths: tuple[dict[str, Berth], ...]
    slowness: tuple[float, ...]
    work: tuple[float, ...]
    incidents: tuple[Incident, ...]
    worker: str | None = None
    holds: tuple[Hold, ...] = ()
    gate_incidents: tuple[GateIncident, ...] = ()
