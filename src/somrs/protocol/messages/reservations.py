"""The bodies with which Task Managers reserve objects at the Repository that owns them.

A Task Manager numbers its messages about reservations (`serial`, growing also over restarts), because messages may overtake each other: of
a task, the Repository heeds only what is newer than what it has heeded.
"""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.ontology.objects import Fact
from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.waits import Holder

RESERVED = "reserved"
"""The rule that a report breaks whose task has lost its reservation to another task."""


class ReservationMode(StrEnum):
    """What a task wants if other tasks have reserved the objects, or come first."""

    TRY = "Try"
    """Keep what it has; it looks for another plan."""
    WAIT = "Wait"
    """Release what it has, and wait."""
    UNDO = "Undo"
    """Reserve those of the objects that no other task has reserved: it undoes work. Tasks that wait do not matter."""
    ASK = "Ask"
    """Reserve nothing; it only wants to know."""


class Reserve(MessageBody, frozen=True, kw_only=True, tag=True):
    """Reserve objects for a task, in addition to what it has: those that its plan `changes`, and others that it `relies_on`.

    `goal` and `priority` are those of the task; the Repository tells other tasks the goal. `facts`: those of the plan's effects that are
    about objects of several maps; the home of the first object has to know the others.
    """

    task: str
    serial: int
    mode: ReservationMode
    goal: str = ""
    priority: int = 0
    changes: tuple[str, ...] = ()
    relies_on: tuple[str, ...] = ()
    facts: tuple[Fact, ...] = ()


class Reserved(MessageBody, frozen=True, kw_only=True, tag=True):
    """The task has the objects, under the fencing number `fence`.

    `overtaken`: objects that other tasks have changed since the task released them; what it had done with them is not there any more, and
    is not undone. `holders`: in the mode UNDO, the tasks that have the rest of the objects.
    """

    task: str
    fence: int
    overtaken: tuple[str, ...] = ()
    holders: tuple[Holder, ...] = ()


class ReservationDenied(MessageBody, frozen=True, kw_only=True, tag=True):
    """Other tasks have reserved some of the objects, or come first. `waits`: the task waits now, and holds nothing."""

    task: str
    holders: tuple[Holder, ...]
    waits: bool = False


class ReservationFree(MessageBody, frozen=True, kw_only=True, tag=True):
    """To a Task Manager: the objects for which the task waits are free. It makes its plan; until it has reserved what that needs, tasks
    behind it still wait."""

    task: str


class ReservationLost(MessageBody, frozen=True, kw_only=True, tag=True):
    """To a Task Manager: the task has no longer what it had under this number, because nothing was heard of the Task Manager for too long,
    and `holders` have taken it."""

    task: str
    fence: int
    holders: tuple[Holder, ...] = ()


class AssignTask(MessageBody, frozen=True, kw_only=True, tag=True):
    """A Task Manager asks whether a task is its to do. The id of the message derives from the task, so that to the
    Repository the requests of all Task Managers are one: the first decides, and each is answered alike."""

    task: str


class TaskAssigned(MessageBody, frozen=True, kw_only=True, tag=True):
    """The task is the one of the Task Manager with this address. The answer to AssignTask, and to SubmitOnce."""

    task: str
    task_manager: str


class Release(MessageBody, frozen=True, kw_only=True, tag=True):
    """The task releases what it holds, and does not wait any more. `ended`: it has ended."""

    task: str
    serial: int
    ended: bool = False


class Claim(Struct, frozen=True, kw_only=True):
    """What a running task has under the number `fence`, or, if it `waits`, what it waits for; possibly nothing.

    `serial`: the number of the latest message about the task whose effect is in this. The answer to a later one may be on its way.
    `repository`: the Repository that reserves for the task, if it is not that of the sender (only in Adopt).
    """

    task: str
    serial: int
    repository: str = ""
    fence: int = 0
    waits: bool = False
    goal: str = ""
    priority: int = 0
    changes: tuple[str, ...] = ()
    relies_on: tuple[str, ...] = ()


class ClaimReservations(MessageBody, frozen=True, kw_only=True, tag=True):
    """All running tasks of the sender that have ever reserved: sent when the Task Manager or the Repository has started. Of a task of which
    the Repository has not heeded as much, what it claims is reserved, if no other task has it; what other tasks of the sender have is
    released."""

    serial: int
    claims: tuple[Claim, ...] = ()


class UnderReservation(Struct, frozen=True, kw_only=True):
    """The reservation under which a task reports: a report is refused if the task has it no longer, and another task has the objects.

    `only_seen`: the task has not worked on what it reports, so that it has changed nothing of it.
    """

    task: str
    fence: int
    only_seen: bool = False
