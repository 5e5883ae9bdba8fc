"""The checks at the end of a run. Each function yields descriptions of what is wrong."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

from msgspec import Struct

from somrs.devices.simulator.link.commands import ObjectState, RobotState
from somrs.ontology.map import Map
from somrs.ontology.objects import ValueSet
from somrs.ontology.types import Ontology
from somrs.ontology.values import value_of
from somrs.protocol.messages.events import ServiceFailure, ServiceRefused
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import Event
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.task_views import Phase, TaskView
from somrs.task_manager.execution.participants import SILENCE
from verification.kill_runs.bystanders import AUTHOR, PATH, Acknowledged
from verification.kill_runs.draw import HOMES, Case, Victim
from verification.kill_runs.scenarios import ROBOTS

REPORTS = ("Completed", "Failed", "Stopped", "Refuse", "Fault", "Status")
"""Messages after which a participant does not work any more. A Status counts, as a participant that lost its contract sends one."""
SENT_BY_COORDINATOR = frozenset(("Arrange", "Accept", "Cancel", "Execute", "Stop", "Compensate", "Query", "End"))


class LoggedMessage(Struct, frozen=True, kw_only=True):
    """A message, as the Task Manager recorded it."""

    at: float
    type: str
    participant: str
    id: str
    body: str = ""

    @property
    def step(self) -> str:
        """The step of the participant, without the number of the attempt."""
        label = self.participant.rpartition("#")[2]
        prefix, _, number = label.rpartition(".")
        return prefix if prefix and number.isdigit() else label


# The outcome


def outcome(case: Case, view: TaskView, records: Iterable[TaskRecord], struck: str, cancelled_at: float | None) -> Iterator[str]:
    """Check that the outcome is possible without a kill. A device that was killed or cut off may fail."""
    if view.outcome is None or view.phase is not Phase.ENDED:
        yield f"there is no outcome: the task is {view.phase}"
        return
    if view.outcome in case.scenario.ends:
        return
    too_late = Outcome.CANCELLED in case.scenario.ends and (cancelled_at is None or view.ended_at is None or cancelled_at > view.ended_at)
    if too_late and view.outcome is Outcome.ACCOMPLISHED:
        return
    # A Service Manager that is killed during work reports Failed; the other robot may be unable to take over, or may have failed as well.
    may_fail = case.victim is Victim.DEVICE and (case.scenario.one_robot or all_robots_failed(view)) and struck in failed_devices(records)
    if not (may_fail and view.outcome is Outcome.FAILED):
        yield f"the outcome is {view.outcome}; without the kill it is {' or '.join(case.scenario.ends)}: {view.explanation}"


def failed_devices(records: Iterable[TaskRecord]) -> set[str]:
    """Return the devices that were given up, or refused, in the task."""
    events = (task_event.event for record in records for task_event in record.events)
    return {event.service.partition(".")[0] for event in events if isinstance(event, ServiceFailure | ServiceRefused)}


def all_robots_failed(view: TaskView) -> bool:
    """Whether all robots that carry things failed in the task. One robot may fail without a kill, if the other stands in its way."""
    failed = {work.service.partition(".")[0] for work in view.work if work.state in (State.FAILED, State.STRANDED, State.UNREACHABLE)}
    return failed >= set(ROBOTS)


def undone(case: Case, view: TaskView, map: Map) -> Iterator[str]:
    """Check that after a cancelled task everything is where it was, unless no robot was left for the compensation."""
    if view.outcome is Outcome.CANCELLED and case.victim is not Victim.DEVICE and not all_robots_failed(view):
        for thing, home in HOMES.items():
            if [fact[1] for fact in map.facts_with("isOn", 0, thing)] != [home]:
                yield f"the task was cancelled, and {thing} is not back on {home}: {view.explanation}"


# The protocol


def logged_messages(record: TaskRecord) -> list[LoggedMessage]:
    """Return the messages of a task in the order of the Task Manager's record."""
    return [
        LoggedMessage(at=message.at, type=message.type, participant=message.participant, id=message.id, body=message.body)
        for message in record.messages
    ]


def protocol(messages: Iterable[LoggedMessage]) -> Iterator[str]:
    """Check properties 1, 2 and 6 of the protocol, as far as the messages show them."""
    by_participant: dict[str, list[LoggedMessage]] = {}
    message_list = list(messages)
    for message in message_list:
        by_participant.setdefault(message.participant, []).append(message)
    for name, participant_messages in by_participant.items():
        types = [message.type for message in participant_messages]
        executes = {message.id for message in participant_messages if message.type == "Execute"}
        if len(executes) > 1:
            yield f"{name} received Execute {len(executes)} times"
        if executes and not {"Terms", "Accept"} <= set(types[: types.index("Execute")]):
            yield f"{name} received Execute without a contract"
        if "Accept" in types and not {"End", "Cancel", "Refuse"} & set(types):
            yield f"{name} was committed, and was not released"
    for execute in (message for message in message_list if message.type == "Execute"):
        for name, participant_messages in by_participant.items():
            if (
                name != execute.participant
                and participant_messages[0].step == execute.step
                and (reason := _working_reason(participant_messages, execute.at))
            ):
                yield f"{execute.participant} received Execute while {name} worked at the same step: {reason}"


def _working_reason(messages: list[LoggedMessage], time: float) -> str:
    """Return why the participant counts as working at that time, or an empty string if it does not."""
    earlier_messages = [message for message in messages if message.at < time]
    execute = next((message for message in earlier_messages if message.type == "Execute"), None)
    if execute is None:
        return ""
    if any(message.type in REPORTS and message.at > execute.at for message in earlier_messages):
        return ""
    report_times = [message.at for message in earlier_messages if message.type not in SENT_BY_COORDINATOR]
    silent = time - max([execute.at, *report_times])
    is_abandoned = any(message.type == "Query" for message in earlier_messages) and silent > 2 * SILENCE - 1
    return "" if is_abandoned else f"it was silent for {silent:.1f} s"


def unreleased(states: Mapping[str, State]) -> Iterator[str]:
    """Yield the participants that still work or wait, whether they had a contract or not."""
    for participant, state in states.items():
        if state not in (State.ENDED, State.NEW):
            yield f"{participant} is {state} after the end"


# What was acknowledged


def lost_tasks(acknowledged: Acknowledged, outcomes: Mapping[str, Outcome | None]) -> Iterator[str]:
    for task in acknowledged.tasks:
        if task not in outcomes:
            yield f"task {task} was acknowledged, but is unknown"
        elif outcomes[task] is not Outcome.ACCOMPLISHED:
            yield f"task {task} was acknowledged, and its outcome is {outcomes[task]}"


def lost_updates(acknowledged: Acknowledged, history: Iterable[Event]) -> Iterator[str]:
    """Check that each update is in the history once, under the acknowledged version."""
    label_versions: dict[str, list[int]] = {}
    versions = []
    for event in history:
        versions.append(event.version)
        for change in event.changes:
            if event.author == AUTHOR and isinstance(change, ValueSet) and change.path == PATH:
                label_versions.setdefault(str(change.value), []).append(event.version)
    oldest = min(versions, default=0)
    for label, version in acknowledged.versions.items():
        if version >= oldest and label_versions.get(label) != [version]:
            kept_versions = label_versions.get(label, "no version")
            yield f"the update {label!r} was acknowledged with version {version}, but is in the history at {kept_versions}"


# The map and the world


def of_things(map: Map, ontology: Ontology, observed: Mapping[str, ObjectState]) -> Iterator[str]:
    """Check that the map has the true place of each thing, or marks the thing as unknown (see `unknown`)."""
    for name, thing in observed.items():
        if map.objects[name].values.get("Unknown") is True:
            continue
        map_facts = {relation: [fact[1] for fact in map.facts_with(relation, 0, name)] for relation in ("isOn", "isHeldBy")}
        true = {
            "isOn": [thing.support] if thing.support and not thing.held_by else [],
            "isHeldBy": [thing.held_by] if thing.held_by else [],
        }
        if map_facts != true:
            yield f"{name}: the map has {_placed(map_facts)}, the world has {_placed(true)}"
        elif not thing.held_by:
            yield from _differences(name, map, ontology, {"PositionX": thing.x, "PositionY": thing.y, "PositionZ": thing.z})


def unknown(map: Map, names: Iterable[str]) -> list[str]:
    return [name for name in names if map.objects[name].values.get("Unknown") is True]


def of_robots(map: Map, ontology: Ontology, robots: Mapping[str, RobotState]) -> Iterator[str]:
    for name, state in robots.items():
        yield from _differences(name, map, ontology, {"PositionX": state.x, "PositionY": state.y, "RotationZ": state.yaw})


def _differences(name: str, map: Map, ontology: Ontology, true: Mapping[str, float]) -> Iterator[str]:
    attributes = ontology.attributes_of(map.objects[name].type)
    for path, value in true.items():
        recorded_value = value_of(name, path, map, ontology)
        recorded_number = float(recorded_value) if recorded_value is not None else math.nan
        gap = abs(math.remainder(recorded_number - value, math.tau) if path == "RotationZ" else recorded_number - value)
        if not gap <= attributes[path].tolerance + 0.0005:  # reports are rounded to the millimetre
            yield f"{name}.{path} is {recorded_number:.3f} on the map, and {value:.3f} in the world"


def _placed(facts: Mapping[str, list[str]]) -> str:
    return " and ".join(f"{relation} {place}" for relation, places in facts.items() for place in places) or "nothing"
