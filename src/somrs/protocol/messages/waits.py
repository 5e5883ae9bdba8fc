"""The events of a task that waits, for other tasks, for services or for a device, and of one that proceeds after that."""

from __future__ import annotations

from msgspec import Struct


class Holder(Struct, frozen=True, kw_only=True):
    """A task that has reserved objects which another task needs. `waiting`: it waits for them itself, and comes first."""

    task: str
    goal: str
    objects: tuple[str, ...]
    waiting: bool = False


class WaitsForTasks(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Other tasks have reserved objects that the plan needs.

    `tasks`: the goals of these tasks, by their ids. `holders`: the same tasks, with what each has reserved; events of SO-MRS 0.2 have none.
    """

    tasks: dict[str, str]
    objects: tuple[str, ...]
    holders: tuple[Holder, ...] = ()

    @classmethod
    def on(cls, holders: tuple[Holder, ...]) -> WaitsForTasks:
        objects = {name for holder in holders for name in holder.objects}
        return cls(tasks={holder.task: holder.goal for holder in holders}, objects=tuple(sorted(objects)), holders=holders)

    @property
    def known_holders(self) -> tuple[Holder, ...]:
        """The tasks with what each has reserved, as far as the event tells them apart."""
        return self.holders or tuple(Holder(task=task, goal=goal, objects=self.objects) for task, goal in self.tasks.items())


class Hindrance(Struct, frozen=True, kw_only=True):
    """Why a task cannot proceed now. `subject`: a service, a service type that nobody offers, or a component; `since`: s since 1970."""

    subject: str
    reason: str
    since: float


class WaitsToRetry(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """There is no way to do the task now, but for reasons that pass.

    The Task Manager tries again at `next_attempt` (s since 1970), `pause` seconds after the last attempt, or earlier if a device joins or
    is mended. `attempts`: those that failed `since` the task began to wait.
    """

    hindrances: tuple[Hindrance, ...]
    since: float
    next_attempt: float
    pause: float
    attempts: int = 1


class WaitOver(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The task proceeds after it waited to try again. `attempts`: all that failed meanwhile; `seconds`: how long it waited."""

    attempts: int
    seconds: float


class GoesOn(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The objects for which the task waited are free."""


class WaitsForRepository(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """A Repository has not answered since `since` (s since 1970), and the task cannot proceed without its answer.

    `map`: the name of its map, if it is a neighbour, and the `objects` that it is asked about. Without a name, it is the Repository of the
    Task Manager.
    """

    since: float
    map: str = ""
    objects: tuple[str, ...] = ()


class RepositoryAnswered(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The Repository has answered after so many `seconds`."""

    seconds: float
    map: str = ""


class WaitsForDevice(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The device performs other work first."""

    device: str
