"""The properties of the Failure Recovery Protocol, checked in one run: after each input, and at the end.

The check observes the system from outside: the true actions of devices, the messages, the Repository's map, and what clients receive. Only
the course of a transaction is read from the Task Manager itself. Four files have parts of the check: `recorded_reports.py` (the way of
reports to the map), `own_work.py` (what tasks do to each other), `promises.py` (what tasks and services promise) and `sightings.py` (what
cameras see).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import takewhile
from typing import TYPE_CHECKING

from somrs.entish.parse import parse
from somrs.kernel.component import Input, Received
from somrs.kernel.replica import ReplicaDue
from somrs.kernel.service_replica import ServicesDue
from somrs.ontology.homes import full_name, with_full_names
from somrs.ontology.qualified_names import plain_name
from somrs.ontology.truth import formula_holds
from somrs.planner.model.problem import Problem
from somrs.protocol.frp.session import service_of
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import message_id
from somrs.protocol.messages.event_text import sentence
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.task_views import TaskView, WorkView
from somrs.service_manager.participant.participant import ServiceManager
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.views import view
from verification.fault_runs.client import preview_id
from verification.fault_runs.ground_truth import Action
from verification.fault_runs.names import plain_text
from verification.fault_runs.own_work import OwnWork
from verification.fault_runs.promises import Promises
from verification.fault_runs.recorded_reports import RecordedReports
from verification.fault_runs.sightings import Sightings
from verification.fault_runs.site import TELLING
from verification.fault_runs.violation import Property, Violation

if TYPE_CHECKING:
    from verification.fault_runs.scenario_run import ScenarioRun
    from verification.fault_runs.simulated_device import DeviceWork, SimulatedDevice

Pair = tuple[str, str]
"""A transaction and a participant."""


class Witness:
    """Observes all inputs, messages and device actions of a run, and checks the properties."""

    def __init__(self, scenario_run: ScenarioRun) -> None:
        self._scenario_run = scenario_run
        self._message_count = 0
        self._terms: dict[Pair, frp.Terms] = {}
        self._accepted: dict[Pair, None] = {}
        self._told_to_start: set[Pair] = set()
        self._accepted_at: dict[Pair, float] = {}
        """The time at which each participant received Accept, or the Execute that counts as one."""
        self._released: set[Pair] = set()
        requests = enumerate(scenario_run.scenario.requests)
        self._previews = {message_id("preview", preview_id(number)): request.effect for number, request in requests if request.previewed}
        """The effects of preview requests, by transaction."""
        self.outcomes: dict[str, TaskView] = {}
        self._endings: dict[str, Outcome] = {}
        """The decided outcome of each task that is being stopped."""
        self.sightings, self._promises = Sightings(scenario_run), Promises(scenario_run)
        self._own_work = OwnWork(scenario_run)
        self._recorded_reports = RecordedReports(scenario_run.world)
        self._worked: dict[str, set[str | None]] = {}
        """The tasks for which devices worked on each object, whether or not the work changed it."""

    # Actions of devices

    def observe_input(self, address: str, event: Input) -> None:
        """Note an input before the Service Manager at `address` handles it."""
        if isinstance(event, Received) and isinstance(event.message.body, frp.Accept | frp.Execute):
            header = event.message.header
            self._accepted_at.setdefault((header.transaction or "", header.participant or ""), self._scenario_run.world.now)

    def observe_start(self, simulated_device: SimulatedDevice, device_work: DeviceWork) -> None:
        """Note that a device begins to execute or to compensate, and check properties 1 and 2."""
        self._read_messages()
        for other_device, other_work in self._scenario_run.working if device_work.order.method not in TELLING else ():
            if other_work is not device_work and other_work.object == device_work.object:
                own_label, other_label = (
                    f"{device_work.participant} ({device_work.activity.name})",
                    f"{other_work.participant} ({other_work.activity.name})",
                )
                text = f"{simulated_device.name} begins {own_label} while {other_device.name} is at {other_label}"
                tasks = " and ".join(dict.fromkeys((device_work.transaction, other_work.transaction)))
                raise Violation(Property.MUTUAL_EXCLUSION, f"{text}; both work on {device_work.object} for {tasks}")
        self._own_work.started(device_work)
        self._contracted(device_work)
        self._promises.started(simulated_device, device_work)
        self._worked.setdefault(device_work.object, set()).add(device_work.transaction)

    def _contracted(self, device_work: DeviceWork) -> None:
        """Check property 2. A contract exists if the participant received Accept while its Terms held; execution may begin later. An
        Execute names the Terms, so it counts as an Accept."""
        pair = device_work.transaction, device_work.participant
        terms, accepted_at = self._terms.get(pair), self._accepted_at.get(pair)
        if terms is None or pair not in self._accepted:
            raise Violation(Property.CONTRACT, f"{device_work.participant} works, although its terms were never accepted")
        if accepted_at is None or (terms.valid_until is not None and accepted_at > terms.valid_until):
            late = (
                f"{accepted_at - terms.valid_until:.3f} s after its terms expired"
                if accepted_at is not None and terms.valid_until
                else "never"
            )
            raise Violation(Property.CONTRACT, f"{device_work.participant} works, although it received the Accept {late}")

    # Messages

    def watch(self, address: str, event: Input) -> None:
        """Check an input after it was handled and its effects were carried out."""
        self._read_messages()
        manager = self._scenario_run.task_manager(address)
        if manager is not None:
            if isinstance(event, Received):
                self._recorded_reports.received(manager, event.message)
            self._follow(manager)
            self._promises.follow(manager, address)

    def _read_messages(self) -> None:
        self.sightings.learn_names()
        messages = self._scenario_run.world.messages
        new, self._message_count = messages[self._message_count :], len(messages)
        for message in new:
            pair = message.header.transaction or "", message.header.participant or ""
            self.sightings.read(message)
            self._promises.read(message)
            self._own_work.read(message)
            self._recorded_reports.read(message)
            match message.body:
                case frp.Terms() as terms:
                    self._terms[pair] = terms
                case frp.Accept() | frp.Execute():
                    if pair[0] in self._previews:
                        raise Violation(Property.CONTRACT, f"{pair[1]} was accepted, although it was only asked for a preview")
                    if isinstance(message.body, frp.Execute) and pair not in self._told_to_start:
                        self._told_to_start.add(pair)
                        self._check_condition(pair, message.header.sender)
                    self._accepted[pair] = None
                case frp.End() | frp.Cancel() | frp.Refuse():
                    self._released.add(pair)

    def _check_condition(self, pair: Pair, sender: str) -> None:
        """Check property 2 for conditional terms: what they demand holds on the coordinator's map when it sends the first Execute."""
        terms, manager = self._terms.get(pair), self._scenario_run.task_manager(sender)
        if terms is None or terms.condition is None or manager is None:
            return
        replica = manager.state.replica
        condition = with_full_names(parse(plain_text(terms.condition)), replica.map, replica.ontology)
        if not formula_holds(condition, replica.map, replica.ontology):
            raise Violation(Property.CONTRACT, f"{pair[1]} is told to start, although its terms demand {terms.condition}")

    def planning(self, address: str, problem: Problem) -> None:
        """Check a request to the planner. It may come from any transaction with this goal, or from a preview."""
        manager = self._scenario_run.task_manager(address)
        if manager is None or any(str(parse(effect)) == plain_text(str(problem.goal)) for effect in self._previews.values()):
            return
        self._read_messages()  # those of a component that was killed amid its effects are not read yet
        self._recorded_reports.planned(manager, problem)

    # Outcomes

    def _follow(self, manager: TaskManager) -> None:
        for task in manager.state.tasks.values():
            if task.id in self.outcomes:
                earlier_view = self.outcomes[task.id]
                if (task.outcome, task.ended_at) != (earlier_view.outcome, earlier_view.ended_at):
                    raise Violation(Property.TERMINATION, f"{task.id} ended {earlier_view.outcome}, and then {task.outcome}")
            elif task.outcome is not None:
                self.outcomes[task.id] = view(task)
                self._ended(task, self.outcomes[task.id], manager)
                self._promises.ended(task)
            elif task.ending is not None:
                self._endings.setdefault(task.id, task.ending)

    def _ended(self, task: TaskState, task_view: TaskView, manager: TaskManager) -> None:
        decided = self._endings.get(task.id)
        if decided is not None and decided is not task_view.outcome:
            raise Violation(Property.RESTART, f"{task.id} was to end {decided}, and ended {task_view.outcome}")
        if task_view.recognise:
            self._check_findings(task_view)
        if task_view.outcome is Outcome.ACCOMPLISHED:
            map, ontology = manager.state.replica.map, manager.state.replica.ontology
            if not task_view.recognise and not formula_holds(parse(task_view.effect), map, ontology):
                raise Violation(Property.MAP, f"{task.id} was accomplished, but {task_view.effect} does not hold on the map")
            return
        if not task_view.reasons:
            raise Violation(Property.PARTIAL_RESULT, f"{task.id} ended {task_view.outcome} without a reason")
        for work in task_view.work:
            self._accounted(work, task_view)
        self._check_objects(task, task_view)

    def _check_findings(self, task_view: TaskView) -> None:
        """Check that a task that only asks has changed nothing, and that each sighting is what a service reported."""
        changed = [work.service for work in task_view.work if work.service_type not in TELLING]
        if changed:
            raise Violation(Property.MAP, f"{task_view.task} asks what is so, and {', '.join(changed)} worked for it")
        findings, reports = task_view.findings, {work.situation for work in task_view.work if work.state is State.COMPLETED}
        if findings is None or (task_view.outcome is Outcome.ACCOMPLISHED and not findings.observations):
            raise Violation(Property.PARTIAL_RESULT, f"{task_view.task} was asked, and ended {task_view.outcome} without findings")
        invented = [sighting for answer in findings.answers for sighting in answer.sightings if sighting.situation not in reports]
        if invented:
            raise Violation(Property.PARTIAL_RESULT, f"{task_view.task} was told {invented[0].situation}, which nobody reported")

    def _accounted(self, work: WorkView, task_view: TaskView) -> None:
        """Check property 4: work is compensated, or its result is reported to the client."""
        if work.state is State.EXECUTING:
            raise Violation(Property.PARTIAL_RESULT, f"{task_view.task} ended {task_view.outcome} while {work.service} still works for it")
        situation = work.situation or "it did not say what it left"
        if work.state is State.STRANDED and not any(work.service in reason and situation in reason for reason in task_view.reasons):
            raise Violation(
                Property.PARTIAL_RESULT,
                f"{work.service} left {work.situation}, which the explanation does not name: {task_view.explanation}",
            )

    def _check_objects(self, task: TaskState, task_view: TaskView) -> None:
        """Check property 4 by the true state: each object that the task's devices moved is where it was before, or reported as stranded.
        Where another task moved it while this one waited, it is where that task has left it. Later moves for other tasks are theirs to
        report. Doubtful objects are exempt."""
        reality = self._scenario_run.reality
        if any(handler.on == "compensation" for handler in task.task.handlers):
            return  # a compensation handler allows another situation than the one before
        for object in dict.fromkeys(action.object for action in reality.actions if action.task == task.id):
            actions = [action for action in reality.actions if action.object == object]
            own_last_actions = [*takewhile(lambda action: action.task == task.id, reversed(actions))]
            if object in reality.doubtful or not own_last_actions or reality.state(object) == own_last_actions[-1].state_before:
                continue
            if any(self._meanwhile(action, task) for action in actions):
                continue  # other tasks or people moved it as well
            if not any(self._mentions(work, object) for work in task_view.work):
                raise Violation(
                    Property.PARTIAL_RESULT,
                    f"{task_view.task} ended {task_view.outcome}; {_describe_actions(actions)}; "
                    f"the client has no report that {reality.situation_of(object)} is left: {task_view.explanation}",
                )

    def _meanwhile(self, action: Action, task: TaskState) -> bool:
        """Whether a person acted, during the task. Reservations keep tasks apart."""
        return action.task is None and action.at >= task.submitted_at

    def _mentions(self, work: WorkView, object: str) -> bool:
        """Whether the client learns of the object's new state: the work is stranded, or other work that compensates left it so."""
        if object not in map(plain_name, work.inputs.values()):
            return False
        is_undone = work.situation is not None and self._scenario_run.reality.situation_of(object) in plain_text(work.situation)
        return work.state is State.STRANDED or (work.step.startswith(GoalKind.UNDO) and is_undone)

    # The end of the run

    def settled(self) -> bool:
        """Whether all activity has ended."""
        return not self.unsettled()

    def unsettled(self) -> str:
        """Return a description of some activity that has not ended, or an empty string."""
        return next(self._unsettled(), "")

    def _unsettled(self) -> Iterator[str]:
        scenario_run = self._scenario_run
        yield from scenario_run.organisations.activity()
        yield from (f"the client got no answer to its request {number}" for number in scenario_run.client.open_requests)
        yield from (f"the client cannot cancel the task of its request {number}" for number in scenario_run.client.pending_cancellations)
        yield from (f"the client got no preview for its request {number}" for number in scenario_run.client.pending_previews)
        for address in scenario_run.managers:
            manager = scenario_run.task_manager(address)
            if manager is None:
                yield f"{address} is down"
                continue
            yield from (
                f"{task.id} is {task.phase}: {sentence(task.events[-1].event)}" for task in manager.state.tasks.values() if not task.outcome
            )
            if (timers := scenario_run.world.timers(address) - {ReplicaDue(), ServicesDue()}) and all(
                t.outcome for t in manager.state.tasks.values()
            ):
                yield f"{address} still waits for {sorted(map(str, timers))[0]}"
        for transaction, participant in self._terms:
            device = scenario_run.world.components.get(f"devices/{service_of(plain_name(participant)).partition('.')[0]}")
            if isinstance(device, ServiceManager) and (state := device.state_of(transaction, participant)) not in (State.ENDED, State.NEW):
                yield f"{participant} in {transaction} is {state}"
        for simulated_device in scenario_run.simulated_devices.values():
            device = scenario_run.world.components.get(simulated_device.traits.address)
            if isinstance(device, ServiceManager) and not device.idle:
                yield f"{simulated_device.name} is not idle"

    def finish(self) -> None:
        """Check the properties that concern a whole run."""
        scenario_run = self._scenario_run
        if unsettled := self.unsettled():
            raise Violation(Property.TERMINATION, f"there is activity after the end: {unsettled}")
        for pair in self._accepted:
            if pair not in self._released:
                raise Violation(Property.ORPHAN, f"{pair[1]} in {pair[0]} was committed, and got neither End nor Cancel")
        for message in scenario_run.world.messages:
            if (
                isinstance(message.body, frp.Fault)
                and message.header.sender in scenario_run.managers
                and message.header.participant is not None
            ):
                raise Violation(
                    Property.UNHANDLED_INPUT, f"{message.header.participant} sent a message that is not allowed: {message.body.text}"
                )
        for simulated_device, device_work in scenario_run.working:
            raise Violation(Property.ORPHAN, f"{simulated_device.name} still works for {device_work.participant}")
        for map in scenario_run.organisations.repositories:
            self._check_map(map)
        self._check_copies()
        records: dict[str, TaskRecord] = {}
        for address in scenario_run.managers:
            for entry in scenario_run.world.records[address]:
                if isinstance(entry, TaskRecord) and records.setdefault(entry.task, entry).outcome is not entry.outcome:
                    raise Violation(Property.TERMINATION, f"{entry.task} is on record with two outcomes")
        for number, task in scenario_run.client.tasks.items():
            manager = scenario_run.task_manager(scenario_run.scenario.requests[number].task_manager)
            outcome = manager.state.tasks[task].outcome if manager is not None and task in manager.state.tasks else None
            if outcome is None or task not in records or records[task].outcome is not outcome:
                raise Violation(Property.RESTART, f"{task} was accepted, and its outcome is not on record")

    def _check_copies(self) -> None:
        """Check that Task Managers know the map and the services on offer as they are at the end, when all news has had time to arrive."""
        scenario_run, organisations = self._scenario_run, self._scenario_run.organisations
        for disagreement in organisations.disagreements():
            raise Violation(Property.COPIES, disagreement)
        for thing in scenario_run.reality.places if len(organisations.repositories) > 1 else ():
            if len(homes := organisations.homes(thing)) != 1:
                raise Violation(Property.IDENTITY, f"{thing} is at home on {' and '.join(homes) or 'no map'}")
        for address in scenario_run.managers:
            manager = scenario_run.task_manager(address)
            assert manager is not None, "it has ended all its tasks"
            contents = organisations.contents(scenario_run.scenario.maps[scenario_run.scenario.map_number(address)])
            if contents is None or manager.state.replica.map != contents.map:
                raise Violation(Property.COPIES, f"the map of {address} is not that of the Repository")
            directory = manager.state.discovery.directory
            offers = organisations.offers_at(directory.registry) if directory is not None else None
            if directory is None or directory.offers != offers:
                raise Violation(Property.COPIES, f"{address} knows {directory and directory.offers}, and its Registry lists {offers}")

    def _check_map(self, map: str) -> None:
        """Check property 5 at the end, when every action has been reported or observed. Two cases are exempt: objects last moved by a
        device that never came back, and objects that a person moved, too, as a delayed report may describe the earlier action."""
        scenario_run, contents = self._scenario_run, self._scenario_run.organisations.contents(map)
        assert contents is not None, "the Repository runs at the end of a run"
        for action in {action.object: action for action in scenario_run.reality.actions}.values():
            tasks = self._worked.get(action.object, set()) | {
                other_action.task for other_action in scenario_run.reality.actions if other_action.object == action.object
            }
            touched = len(tasks) > 1 and None in tasks
            if action.object in scenario_run.reality.doubtful or f"devices/{action.actor}" not in scenario_run.world.components or touched:
                continue
            formula = with_full_names(parse(scenario_run.reality.situation_of(action.object)), contents.map, contents.ontology)
            is_certain = contents.map.objects[full_name(action.object, contents.map)].values.get("Unknown") is not True
            if is_certain and not formula_holds(formula, contents.map, contents.ontology):
                raise Violation(
                    Property.MAP, f"{action.actor} had {action.object} {action.state_after}, which the map {map} does not show at the end"
                )


def _describe_actions(actions: list[Action]) -> str:
    return ", ".join(f"{action.actor} had {action.object} {action.state_after}" for action in actions)
