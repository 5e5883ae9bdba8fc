"""The programs of the agents, with the times of their work, and an observer that can report the state of any object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from somrs.devices.symbolic.agent import SymbolicAgent
from somrs.devices.symbolic.world import SymbolicWorld
from somrs.ontology.objects import Object
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Capability, Perform, Profile, Quote, Quoted, WorkDone

STEP_TIME = 4.0
"""Seconds of virtual time that each step takes: much more than its messages take."""


@dataclass(slots=True, kw_only=True)
class TimedAgent:
    """An agent that records the beginning and the end of its work."""

    agent: SymbolicAgent
    now: Callable[[], float]
    times: list[float] = field(default_factory=list)

    def carry_out(self, task: object) -> Work:
        started_at = self.now()
        for seconds, value in self.agent.carry_out(task):
            yield seconds, value
            if isinstance(task, Perform) and isinstance(value, WorkDone):
                break
        if isinstance(task, Perform):
            self.times += [started_at, self.now()]


@dataclass(slots=True, kw_only=True)
class Observer:
    """A cognitive service that reports an object's true state."""

    world: SymbolicWorld
    name: str = "Observer"

    @property
    def person(self) -> Object:
        return Object(name=self.name, type="Person")

    @property
    def profile(self) -> Profile:
        capability = Capability(type="RecognizeSituation", method="look", undoable=True)
        return Profile(name=self.name, type=self.person.type, capabilities=(capability,), lease=1e9, capacity=100)

    def carry_out(self, task: object) -> Work:
        match task:
            case Quote():
                yield 0.0, Quoted(price=1.0, duration=STEP_TIME)
            case Perform(order):
                yield STEP_TIME, WorkDone(situation=self.world.describe_object(order.inputs["Object"]))
            case _:
                yield 0.0, WorkDone()
