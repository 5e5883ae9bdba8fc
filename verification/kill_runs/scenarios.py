"""What a run plays, so that a certain type of message comes: a wish, what is broken from the beginning, and what is done on which cue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.lines import Break
from somrs.protocol.messages.frp import Outcome

CHEAP, DEAR, PATROL, CAMERA = "Robot1", "Robot2", "Patrol1", "Camera001"
"""The devices of the site of scenario 2. Of the two robots that carry things, the first is the cheaper, the second the quicker."""

ROBOTS = (CHEAP, DEAR)
DEVICES = (CHEAP, DEAR, PATROL, CAMERA)
THINGS = ("Jar002", "Jar003", "Carton001")
PLACES = ("Platform001", "Table001", "Table002", "Shelf001")


class Action(Enum):
    """What is done to the system besides the kill."""

    CANCEL = "the client changes its mind"
    FREEZE = "the process of the device that works is stopped (SIGSTOP)"
    THAW = "it goes on (SIGCONT)"
    STRAY = "the device that works gets a message that does not belong there"


@dataclass(frozen=True, slots=True, kw_only=True)
class Trigger:
    """The first message of the type, with so much progress if it tells any, is the cue for an act."""

    type: str
    action: Action
    fraction: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """`counts`: how many messages of a type come at least, in a run that nobody disturbs. `counts_per_thing`: so many for each thing
    wanted."""

    name: str
    ends: frozenset[Outcome] = frozenset({Outcome.ACCOMPLISHED})
    counts: Mapping[str, int] = field(default_factory=dict)
    counts_per_thing: Mapping[str, int] = field(default_factory=dict)
    most_things: int = 2
    broken: tuple[tuple[str, Fault], ...] = ()
    """What is broken from the beginning."""
    breaks: tuple[Break, ...] = ()
    """What breaks meanwhile, at a moment of the simulated world, which is the same however busy the machine is."""
    triggers: tuple[Trigger, ...] = ()
    one_robot: bool = False
    """Of the two robots that carry things, one does not come into question, or not any more."""
    possible: bool = True
    """Whether a thing can be where it is wanted."""

    def count(self, message: str, things: int) -> int:
        return self.counts.get(message, 0) + things * self.counts_per_thing.get(message, 0)


_CONTRACT = {"Arrange": 2, "Terms": 2, "Accept": 1, "Cancel": 1, "Execute": 1, "Progress": 3}
_COMPLETION = {"Completed": 1, "End": 1}
_CANCELLED = frozenset({Outcome.CANCELLED})
_CHANGED_MIND = Trigger(type="Progress", action=Action.CANCEL, fraction=0.4)

SCENARIOS = (
    Scenario(name="carry", counts_per_thing={**_CONTRACT, **_COMPLETION}),
    Scenario(
        name="refuse",
        one_robot=True,
        broken=((CHEAP, Fault.GRIPPER),),
        counts_per_thing={"Arrange": 2, "Terms": 1, "Refuse": 1, "Accept": 1, "Execute": 1, **_COMPLETION},
    ),
    Scenario(name="hopeless", ends=frozenset({Outcome.FAILED}), counts={"Arrange": 2, "Refuse": 2}, most_things=1, possible=False),
    Scenario(
        name="break",
        one_robot=True,
        breaks=(Break(robot=CHEAP, fault=Fault.DRIVE, carried=1.0),),
        counts={**_CONTRACT, **_COMPLETION, "Failed": 1},
        most_things=1,
    ),
    Scenario(
        name="cancel",
        ends=_CANCELLED,
        counts={"Stop": 1, "Stopped": 1, "Compensate": 1, "Compensated": 1, "End": 1, "Accept": 1, "Execute": 1},
        triggers=(_CHANGED_MIND,),
    ),
    Scenario(
        name="strand",
        ends=_CANCELLED,
        counts={"Stop": 1, "Stopped": 1, "Compensate": 1, "Stranded": 1, "End": 1},
        most_things=1,
        breaks=tuple(Break(robot=robot, fault=Fault.GRIPPER, released=True) for robot in ROBOTS),
        triggers=(_CHANGED_MIND,),
    ),
    Scenario(
        name="silence",
        one_robot=True,
        counts={"Query": 1, "Status": 1},
        most_things=1,
        triggers=(Trigger(type="Progress", action=Action.FREEZE, fraction=0.4), Trigger(type="Query", action=Action.THAW)),
    ),
    Scenario(
        name="stray",
        counts={**_CONTRACT, **_COMPLETION, "Fault": 1},
        most_things=1,
        triggers=(Trigger(type="Progress", action=Action.STRAY),),
    ),
)

SLOW = frozenset({"silence"})
"""Plays that last for more than a few seconds: they are played only for messages that nothing else brings."""


def scenarios_of(message: str) -> tuple[Scenario, ...]:
    """The plays in which a message of the type comes."""
    bringing = tuple(scenario for scenario in SCENARIOS if scenario.count(message, 1))
    return tuple(scenario for scenario in bringing if scenario.name not in SLOW) or bringing
