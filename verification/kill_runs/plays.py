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


class Act(Enum):
    """What is done to the system besides the kill."""

    CANCEL = "the client changes its mind"
    FREEZE = "the process of the device that works is stopped (SIGSTOP)"
    THAW = "it goes on (SIGCONT)"
    STRAY = "the device that works gets a message that does not belong there"


@dataclass(frozen=True, slots=True, kw_only=True)
class Cue:
    """The first message of the type, with so much progress if it tells any, is the cue for an act."""

    type: str
    act: Act
    fraction: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """`brings`: how many messages of a type come at least, in a run that nobody disturbs. `each`: so many for each thing wanted."""

    name: str
    ends: frozenset[Outcome] = frozenset({Outcome.ACCOMPLISHED})
    brings: Mapping[str, int] = field(default_factory=dict)
    each: Mapping[str, int] = field(default_factory=dict)
    most_things: int = 2
    broken: tuple[tuple[str, Fault], ...] = ()
    """What is broken from the beginning."""
    breaks: tuple[Break, ...] = ()
    """What breaks meanwhile, at a moment of the simulated world, which is the same however busy the machine is."""
    cues: tuple[Cue, ...] = ()
    one_robot: bool = False
    """Of the two robots that carry things, one does not come into question, or not any more."""
    possible: bool = True
    """Whether a thing can be where it is wanted."""

    def count(self, message: str, things: int) -> int:
        return self.brings.get(message, 0) + things * self.each.get(message, 0)


_CONTRACT = {"Arrange": 2, "Terms": 2, "Accept": 1, "Cancel": 1, "Execute": 1, "Progress": 3}
_DONE = {"Completed": 1, "End": 1}
_CANCELLED = frozenset({Outcome.CANCELLED})
_CHANGED_MIND = Cue(type="Progress", act=Act.CANCEL, fraction=0.4)

PLAYS = (
    Play(name="carry", each={**_CONTRACT, **_DONE}),
    Play(
        name="refuse",
        one_robot=True,
        broken=((CHEAP, Fault.GRIPPER),),
        each={"Arrange": 2, "Terms": 1, "Refuse": 1, "Accept": 1, "Execute": 1, **_DONE},
    ),
    Play(name="hopeless", ends=frozenset({Outcome.FAILED}), brings={"Arrange": 2, "Refuse": 2}, most_things=1, possible=False),
    Play(
        name="break",
        one_robot=True,
        breaks=(Break(robot=CHEAP, fault=Fault.DRIVE, carried=1.0),),
        brings={**_CONTRACT, **_DONE, "Failed": 1},
        most_things=1,
    ),
    Play(
        name="cancel",
        ends=_CANCELLED,
        brings={"Stop": 1, "Stopped": 1, "Compensate": 1, "Compensated": 1, "End": 1, "Accept": 1, "Execute": 1},
        cues=(_CHANGED_MIND,),
    ),
    Play(
        name="strand",
        ends=_CANCELLED,
        brings={"Stop": 1, "Stopped": 1, "Compensate": 1, "Stranded": 1, "End": 1},
        most_things=1,
        breaks=tuple(Break(robot=robot, fault=Fault.GRIPPER, released=True) for robot in ROBOTS),
        cues=(_CHANGED_MIND,),
    ),
    Play(
        name="silence",
        one_robot=True,
        brings={"Query": 1, "Status": 1},
        most_things=1,
        cues=(Cue(type="Progress", act=Act.FREEZE, fraction=0.4), Cue(type="Query", act=Act.THAW)),
    ),
    Play(name="stray", brings={**_CONTRACT, **_DONE, "Fault": 1}, most_things=1, cues=(Cue(type="Progress", act=Act.STRAY),)),
)

SLOW = frozenset({"silence"})
"""Plays that last for more than a few seconds: they are played only for messages that nothing else brings."""


def plays_of(message: str) -> tuple[Play, ...]:
    """The plays in which a message of the type comes."""
    bringing = tuple(play for play in PLAYS if play.count(message, 1))
    return tuple(play for play in bringing if play.name not in SLOW) or bringing
