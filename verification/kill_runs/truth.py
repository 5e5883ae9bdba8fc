"""What has to be so at the end of a run, whoever was killed in it. Each function yields what is not so, in words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

from msgspec import Struct

from somrs.devices.simulator.link.commands import ObjectState, RobotState
from somrs.ontology.objects import Map, ValueSet
from somrs.ontology.types import Ontology
from somrs.ontology.values import value_of
from somrs.protocol.messages.clients import Phase, TaskView
from somrs.protocol.messages.events import ServiceFailure, ServiceRefused
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import Event
from somrs.protocol.messages.records import TaskRecord
from somrs.task_manager.execution.participants import SILENCE
from verification.kill_runs.bystanders import AUTHOR, PATH, Acknowledged
from verification.kill_runs.draw import HOMES, Case, Victim
from verification.kill_runs.plays import ROBOTS

REPORTS = ("Completed", "Failed", "Stopped", "Refuse", "Fault", "Status")
"""What a participant that was told to execute says when it does not work any more; a Status, when it has forgotten its contract."""
SENT_BY_COORDINATOR = frozenset(("Arrange", "Accept", "Cancel", "Execute", "Stop", "Compensate", "Query", "End"))


class Told(Struct, frozen=True, kw_only=True):
    """A message, whoever noted it."""

    at: float
    type: str
    participant: str
    id: str
    body: str = ""

    @property
    def step(self) -> str:
        """What the participant was asked for; the attempt's number does not count."""
        label = self.participant.rpartition("#")[2]
        before, _, number = label.rpartition(".")
        return before if before and number.isdigit() else label


# The outcome


def outcome(case: Case, view: TaskView, kept: Iterable[TaskRecord], struck: str, cancelled_at: float | None) -> Iterator[str]:
    """An outcome that the run could have had without a kill. A device that was killed, or was cut off, may have failed."""
    if view.outcome is None or view.phase is not Phase.ENDED:
        yield f"there is no outcome: the task is {view.phase}"
        return
    if view.outcome in case.play.ends:
        return
    too_late = Outcome.CANCELLED in case.play.ends and (cancelled_at is None or view.ended_at is None or cancelled_at > view.ended_at)
    if too_late and view.outcome is Outcome.ACCOMPLISHED:
        return
    # A Service Manager that is killed at work reports Failed; the other robot may not be able to take over, or have failed, too.
    may_fail = case.victim is Victim.DEVICE and (case.play.one_robot or nobody_left(view)) and struck in given_up(kept)
    if not (may_fail and view.outcome is Outcome.FAILED):
        yield f"the outcome is {view.outcome}, and without the kill it is {' or '.join(case.play.ends)}: {view.explanation}"


def given_up(kept: Iterable[TaskRecord]) -> set[str]:
    """The devices that were given up, or refused, in the task."""
    told = (happened.event for record in kept for happened in record.events)
    return {event.service.partition(".")[0] for event in told if isinstance(event, ServiceFailure | ServiceRefused)}


def nobody_left(view: TaskView) -> bool:
    """Whether all robots that carry things failed in the task. One may, without a kill, when the other stands where it has to."""
    failed = {work.service.partition(".")[0] for work in view.work if work.state in (State.FAILED, State.STRANDED, State.UNREACHABLE)}
    return failed >= set(ROBOTS)


def undone(case: Case, view: TaskView, map: Map) -> Iterator[str]:
    """When the task was cancelled, everything is where it was; unless there was no robot left that could undo it."""
    if view.outcome is Outcome.CANCELLED and case.victim is not Victim.DEVICE and not nobody_left(view):
        for thing, home in HOMES.items():
            if [fact[1] for fact in map.facts_with("isOn", 0, thing)] != [home]:
                yield f"the task was cancelled, and {thing} is not back on {home}: {view.explanation}"


# The protocol


def told(record: TaskRecord) -> list[Told]:
    """The messages of a task, in the order in which the Task Manager had them."""
    return [Told(at=one.at, type=one.type, participant=one.participant, id=one.id, body=one.body) for one in record.messages]


def protocol(messages: Iterable[Told]) -> Iterator[str]:
    """What can be seen of properties 1, 2 and 6 of the protocol."""
    by_participant: dict[str, list[Told]] = {}
    kept = list(messages)
    for one in kept:
        by_participant.setdefault(one.participant, []).append(one)
    for name, its in by_participant.items():
        types = [one.type for one in its]
        executes = {one.id for one in its if one.type == "Execute"}
        if len(executes) > 1:
            yield f"{name} was told {len(executes)} times to execute"
        if executes and not {"Terms", "Accept"} <= set(types[: types.index("Execute")]):
            yield f"{name} was told to execute without a contract"
        if "Accept" in types and not {"End", "Cancel", "Refuse"} & set(types):
            yield f"{name} was committed, and nobody sent it home"
    for execute in (one for one in kept if one.type == "Execute"):
        for name, its in by_participant.items():
            if name != execute.participant and its[0].step == execute.step and (why := _works(its, execute.at)):
                yield f"{execute.participant} was told to execute while {name} worked at the same step: {why}"


def _works(its: list[Told], at: float) -> str:
    """Why the participant counts as working at that time; nothing if it does not."""
    before = [one for one in its if one.at < at]
    began = next((one for one in before if one.type == "Execute"), None)
    if began is None:
        return ""
    if any(one.type in REPORTS and one.at > began.at for one in before):
        return ""
    heard = [one.at for one in before if one.type not in SENT_BY_COORDINATOR]
    silent = at - max([began.at, *heard])
    given_up = any(one.type == "Query" for one in before) and silent > 2 * SILENCE - 1
    return "" if given_up else f"it said nothing for {silent:.1f} s"


def at_home(states: Mapping[str, State]) -> Iterator[str]:
    """Nobody works, or waits, any more: neither those who did something nor those who were only asked."""
    for participant, state in states.items():
        if state not in (State.ENDED, State.NEW):
            yield f"{participant} is {state} after the end"


# What was acknowledged


def lost_tasks(acknowledged: Acknowledged, found: Mapping[str, Outcome | None]) -> Iterator[str]:
    for task in acknowledged.tasks:
        if task not in found:
            yield f"task {task} was acknowledged, and is not known"
        elif found[task] is not Outcome.ACCOMPLISHED:
            yield f"task {task} was acknowledged, and came to {found[task]}"


def lost_updates(acknowledged: Acknowledged, history: Iterable[Event]) -> Iterator[str]:
    """Each update is in the history under the version that was told, and once."""
    found: dict[str, list[int]] = {}
    versions = []
    for event in history:
        versions.append(event.version)
        for change in event.changes:
            if event.author == AUTHOR and isinstance(change, ValueSet) and change.path == PATH:
                found.setdefault(str(change.value), []).append(event.version)
    oldest = min(versions, default=0)
    for label, version in acknowledged.versions.items():
        if version >= oldest and found.get(label) != [version]:
            yield f"the update {label!r} was acknowledged with version {version}, and is in the history at {found.get(label, 'no version')}"


# The map and the world


def of_things(map: Map, ontology: Ontology, seen: Mapping[str, ObjectState]) -> Iterator[str]:
    """The map says where each thing is; or that it does not know, which `unknown` tells."""
    for name, one in seen.items():
        if map.objects[name].values.get("Unknown") is True:
            continue
        known = {relation: [a[1] for a in map.facts_with(relation, 0, name)] for relation in ("isOn", "isHeldBy")}
        true = {"isOn": [one.support] if one.support and not one.held_by else [], "isHeldBy": [one.held_by] if one.held_by else []}
        if known != true:
            yield f"{name}: the map has {_placed(known)}, and in the world it is {_placed(true)}"
        elif not one.held_by:
            yield from _differences(name, map, ontology, {"PositionX": one.x, "PositionY": one.y, "PositionZ": one.z})


def unknown(map: Map, names: Iterable[str]) -> list[str]:
    return [name for name in names if map.objects[name].values.get("Unknown") is True]


def of_robots(map: Map, ontology: Ontology, robots: Mapping[str, RobotState]) -> Iterator[str]:
    for name, state in robots.items():
        yield from _differences(name, map, ontology, {"PositionX": state.x, "PositionY": state.y, "RotationZ": state.yaw})


def _differences(name: str, map: Map, ontology: Ontology, true: Mapping[str, float]) -> Iterator[str]:
    attributes = ontology.attributes_of(map.objects[name].type)
    for path, value in true.items():
        said = value_of(name, path, map, ontology)
        known = float(said) if said is not None else math.nan
        gap = abs(math.remainder(known - value, math.tau) if path == "RotationZ" else known - value)
        if not gap <= attributes[path].tolerance + 0.0005:  # reports are rounded to the millimetre
            yield f"{name}.{path} is {known:.3f} on the map, and {value:.3f} in the world"


def _placed(facts: Mapping[str, list[str]]) -> str:
    return " and ".join(f"{relation} {where}" for relation, places in facts.items() for where in places) or "nothing"
