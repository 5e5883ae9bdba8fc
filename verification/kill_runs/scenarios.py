"""The scenarios of runs. Each produces certain messages by its goal, its initial faults, and actions that messages trigger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.lines import Break
from somrs.protocol.messages.frp import Outcome

CHEAP, DEAR, PATROL, CAMERA = "Robot1", "Robot2", "Patrol1", "Camera001"
"""The devices of the site of scenario 2. Of the two robots that carry things, the first is cheaper, the second faster."""

ROBOTS = (CHEAP, DEAR)
DEVICES = (CHEAP, DEAR, PATROL, CAMERA)
THINGS = ("Jar002", "Jar003", "Carton001")
PLACES = ("Platform001", "Table001", "Table002", "Shelf001")


class Action(Enum):
    """An action on the system besides the kill."""

    CANCEL = "the client changes its mind"
    FREEZE = "the process of the device that works is stopped (SIGSTOP)"
    THAW = "the process continues (SIGCONT)"
    STRAY = "the device that works gets a message that its state does not allow"


@dataclass(frozen=True, slots=True, kw_only=True)
class Trigger:
    """The first message of the type, with at least this `fraction` in a Progress, triggers the action."""

    type: str
    action: Action
    fraction: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A scenario. `counts`: the minimum number of messages of each type without a kill. `counts_per_thing`: the same for each thing in the
    goal."""

    name: str
    ends: frozenset[Outcome] = frozenset({Outcome.ACCOMPLISHED})
    counts: Mapping[str, int] = field(default_factory=dict)
    counts_per_thing: Mapping[str, int] = field(default_factory=dict)
    most_things: int = 2
    broken: tuple[tuple[str, Fault], ...] = ()
    """Faults from the beginning."""
    breaks: tuple[Break, ...] = ()
    """Faults at a moment of simulated time, which does not depend on the load of the machine."""
    triggers: tuple[Trigger, ...] = ()
    one_robot: bool = False
    """Only one of the two robots that carry things can do the task."""
    possible: bool = True
    """Whether the goal can be reached."""

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
"""Scenarios that take more than a few seconds. They are played only for messages that no other scenario produces."""


def scenarios_of(message: str) -> tuple[Scenario, ...]:
    """Return the scenarios that produce a message of the type."""
    bringing = tuple(scenario for scenario in SCENARIOS if scenario.count(message, 1))
    return tuple(scenario for scenario in bringing if scenario.name not in SLOW) or bringing
