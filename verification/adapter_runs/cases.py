"""The cases: what is killed, while a robot does what."""

from __future__ import annotations

import itertools
from enum import StrEnum
from itertools import zip_longest
from random import Random
from typing import NamedTuple


class Phase(StrEnum):
    """What the robot does of which the program is killed."""

    FETCHING = "driving to the thing"
    PICKING = "picking it"
    CARRYING = "carrying it"
    DROPPING = "dropping it"
    CHARGING = "charging"
    PASSING = "passing a door"
    RIDING = "riding in a lift"


class Case(NamedTuple):
    """`kind`: the protocol of the robots, or of the door or the lift. `victims`: the labels of the programs that are killed."""

    kind: str
    phase: Phase
    victims: tuple[str, ...]


CARRYING_PHASES = (Phase.FETCHING, Phase.PICKING, Phase.CARRYING, Phase.DROPPING)


def _cases_of(kind: str, parts: tuple[str, ...], pairs: tuple[tuple[str, str], ...], phases: tuple[Phase, ...]) -> list[Case]:
    """The cases of one protocol, in an order in which they differ soon."""
    cases = [Case(kind, phase, victims) for phase in phases for victims in (*((part,) for part in parts), *pairs)]
    Random(kind).shuffle(cases)
    return cases


VDA5050 = ("vda5050", "vda5050-simulated", "broker"), (("vda5050", "vda5050-simulated"), ("vda5050", "broker"))

KINDS = (
    _cases_of("vda5050 2.1", *VDA5050, (*CARRYING_PHASES, Phase.CHARGING)),
    _cases_of("arcos", ("arcos", "arcos-simulated"), (("arcos", "arcos-simulated"),), CARRYING_PHASES),
    _cases_of("vda5050 3.0", *VDA5050, (*CARRYING_PHASES, Phase.CHARGING)),
    _cases_of("ros2", ("ros2", "ros2-simulated"), (("ros2", "ros2-simulated"),), (*CARRYING_PHASES, Phase.CHARGING)),
    _cases_of("things", ("things", "things-simulated", "broker"), (("things", "broker"),), (Phase.PASSING,)),
)

LIFT = ("things", "things-simulated", "broker"), (("things", "broker"), ("things", "things-simulated"))
VEHICLES_IN_LIFT = ("vda5050", "vda5050-simulated", "broker", "things"), (("vda5050", "things"), ("vda5050-simulated", "things-simulated"))

RIDES = (_cases_of("lift", *LIFT, (Phase.RIDING,)), _cases_of("lift vda5050", *VEHICLES_IN_LIFT, (Phase.RIDING,)))

CASES = (*(case for cases in zip_longest(*KINDS) for case in cases if case is not None), *itertools.chain(*RIDES))
"""All cases, by turns of each protocol, and then those of a lift. The run with a seed plays that of this number, counted on from the
beginning after the last."""

SHORT, LONG = (0.2, 4.0), (35.0, 50.0)
"""For how long a program stays away, in seconds: until it is started again, or longer than leases in traffic last."""
LONG_SHARE = 0.25


class Draw(NamedTuple):
    """What chance decides of a run. `delay`: seconds in the phase until the kill. `outage`: seconds until the
    programs are started again."""

    case: Case
    thing: str
    delay: float
    outage: float


def draw(seed: int) -> Draw:
    """The run with a seed."""
    case, chance = CASES[seed % len(CASES)], Random(seed)
    longest = 5.0 if case.phase in (Phase.FETCHING, Phase.CARRYING) else 3.0
    outage = chance.uniform(*(LONG if chance.random() < LONG_SHARE else SHORT))
    return Draw(case, chance.choice(("Jar1", "Jar2")), chance.uniform(0.0, longest), outage)
