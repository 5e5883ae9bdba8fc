"""The seven properties of the Failure Recovery Protocol, checked in one run: after each input, and at the end.

They are judged from outside: by what devices really do, by the messages, by the Repository's map and by what clients are told. Only
what has happened to a transaction is read from the Task Manager itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import TYPE_CHECKING

from somrs.entish.parse import parse
from somrs.kernel.component import Input, Received
from somrs.kernel.replica import ReplicaDue
from somrs.ontology.truth import formula_holds
from somrs.planner.model.problem import Problem
from somrs.protocol.frp.session import service_of
from somrs.protocol.messages import frp
from somrs.protocol.messages.clients import TaskView, WorkView
from somrs.protocol.messages.envelope import Message, message_id, normalised_id
from somrs.protocol.messages.event_text import sentence
from somrs.protocol.messages.events import GoalKind
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.protocol.messages.records import TaskRecord
from somrs.service_manager.participant.participant import ServiceManager
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.views import view
from verification.fault_runs.client import asked_id
from verification.fault_runs.site import LOOKING
from verification.fault_runs.truth import Deed

if TYPE_CHECKING:
    from verification.fault_runs.hands import Hands, Labour
    from verification.fault_runs.stage import Stage

Pair = tuple[str, str]
"""Transaction and participant."""


class Property(StrEnum):
    """What must hold (FRP, "What must hold")."""

    HANDS = "no double hands"
    CONTRACT = "no work without a contract"
    HOME = "everyone goes home"
    SILENCE = "nothing half-done in silence"
    MAP = "the map tells the truth"
    ORPHAN = "no orphan"
    RESTART = "restart changes nothing"
    BREAKS = "no component breaks"
    """Not among the seven: an input that a component cannot handle at all."""


class Violation(Exception):
    """A property does not hold, and what was seen."""

    def __init__(self, property: Property, seen: str) -> None:
        self.property, self.seen = property, seen
        super().__init__(f"{property}: {seen}")


class Witness:
    """Sees everything that happens on a stage."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._said = 0
        self._terms: dict[Pair, frp.Terms] = {}
        self._accepted: dict[Pair, None] = {}
        self._taken: dict[Pair, float] = {}
        """When the participant took the Accept, or the Execute that says as much."""
        self._released: set[Pair] = set()
        wishes = enumerate(stage.story.wishes)
        self._previews = {message_id("preview", asked_id(number)): wish.effect for number, wish in wishes if wish.previewed}
        """What is only asked for, by transaction."""
        self._managers: dict[str, str] = {}
        """Whose each task is."""
        self._unsaid: dict[str, dict[str, Pair]] = {}
        """What was reported in each transaction and has not come to the Repository yet, by message id: service and situation."""
        self._updates: dict[str, Pair] = {}
        """Service and situation of each request to change the map."""
        self._answered: set[str] = set()
        """Those of them that the Repository answered."""
        self._known: set[str] = set()
        self._reports: dict[str, float] = {}
        """When each report was first said, by message id."""
        self._put: dict[Pair, float] = {}
        """When a service's situation came to the Repository last."""
        self.outcomes: dict[str, TaskView] = {}
        self._endings: dict[str, Outcome] = {}
        """How tasks will end that are being stopped."""
        self._worked: dict[str, set[str | None]] = {}
        """The tasks for which devices worked on each object, whether that changed it or not."""

    # What devices do

    def saw(self, address: str, event: Input) -> None:
        """A Service Manager is about to handle the input, whatever becomes of it then."""
        if isinstance(event, Received) and isinstance(event.message.body, frp.Accept | frp.Execute):
            header = event.message.header
            self._taken.setdefault((header.transaction or "", header.participant or ""), self._stage.world.now)

    def began(self, hands: Hands, labour: Labour) -> None:
        """A device begins to work, or to undo its work."""
        self._hear()
        for other, its in self._stage.working if labour.order.method != LOOKING else ():
            if its is not labour and its.object == labour.object and self._together(its.transaction, labour.transaction):
                mine, others = f"{labour.participant} ({labour.activity.name})", f"{its.participant} ({its.activity.name})"
                text = f"{hands.name} begins {mine} while {other.name} is at {others}"
                tasks = " and ".join(dict.fromkeys((labour.transaction, its.transaction)))
                raise Violation(Property.HANDS, f"{text}; both have their hands on {labour.object} for {tasks}")
        self._contracted(labour)
        self._worked.setdefault(labour.object, set()).add(labour.transaction)

    def _together(self, *tasks: str | None) -> bool:
        """Whether one Task Manager has them all: it knows what each was promised. Of others' it knows nothing."""
        return len({self._managers.get(task or "", task) for task in tasks}) == 1

    def _contracted(self, labour: Labour) -> None:
        """FRP, property 2. A contract is made when its Accept is taken by the participant while its Terms hold; it may begin later. An
        Execute names the Terms, too: it is as good as an Accept that is lost or late."""
        pair = labour.transaction, labour.participant
        terms, taken = self._terms.get(pair), self._taken.get(pair)
        if terms is None or pair not in self._accepted:
            raise Violation(Property.CONTRACT, f"{labour.participant} works, and its terms were never accepted")
        if taken is None or (terms.valid_until is not None and taken > terms.valid_until):
            late = f"{taken - terms.valid_until:.3f} s after its terms ran out" if taken is not None and terms.valid_until else "never"
            raise Violation(Property.CONTRACT, f"{labour.participant} works, and took the Accept {late}")

    # What is said

    def watch(self, address: str, event: Input) -> None:
        """An input was handled, and its effects carried out."""
        self._hear()
        if isinstance(event, Received):
            self._received(address, event.message)
        manager = self._stage.task_manager(address)
        if manager is not None:
            self._follow(manager)

    def _hear(self) -> None:
        messages = self._stage.world.messages
        new, self._said = messages[self._said :], len(messages)
        for message in new:
            pair = message.header.transaction or "", message.header.participant or ""
            match message.body:
                case UpdateMap(author=author, situation=str(situation)):
                    self._updates[normalised_id(message.header.message_id)] = author, situation
                case Updated() | Rejected():
                    self._kept(normalised_id(message.header.relates_to or ""))
                case frp.Terms() as terms:
                    self._terms[pair] = terms
                case frp.Accept() | frp.Execute():
                    if pair[0] in self._previews:
                        raise Violation(Property.CONTRACT, f"{pair[1]} was only asked what it costs, and is to do it")
                    self._accepted[pair] = None
                case frp.End() | frp.Cancel() | frp.Refuse():
                    self._released.add(pair)
                case frp.Completed() | frp.Failed() | frp.Stopped() | frp.Compensated() | frp.Stranded():
                    self._reports.setdefault(message.header.message_id, self._stage.world.now)
                case frp.Arrange():
                    self._managers[pair[0]] = message.header.sender
                    self._nothing_unsaid(pair[0], f"{pair[1]} was asked for terms")

    def _kept(self, request: str) -> None:
        """The Repository answered a request to change the map, so that it is on its disk: no earlier than that can anybody know of it."""
        update = self._updates.get(request)
        if update is None or request in self._answered:
            return
        self._answered.add(request)
        self._put[update] = self._stage.world.now
        for reports in self._unsaid.values():
            for id in [id for id, report in reports.items() if report == update]:
                del reports[id]

    def _nothing_unsaid(self, task: str, what: str) -> None:
        if unsaid := self._unsaid.get(task):
            service, situation = next(iter(unsaid.values()))
            raise Violation(Property.MAP, f"{what} before the Repository knew what {service} reported: {situation}")

    def _received(self, address: str, message: Message) -> None:
        body = message.body
        if isinstance(body, frp.Completed | frp.Failed | frp.Stopped | frp.Compensated | frp.Stranded) and body.situation is not None:
            manager = self._stage.task_manager(address)
            if manager is not None:
                self._reported(manager, message, body.situation)

    def _reported(self, manager: TaskManager, message: Message, situation: str) -> None:
        """Whatever is news to a transaction that goes on has to come to the Repository first."""
        header, kind = message.header, type(message.body).__name__
        transaction = manager.state.tasks.get(header.transaction or "")
        if transaction is None or transaction.outcome is not None or header.message_id in self._known:
            return
        self._known.add(header.message_id)
        member = next((member for member in transaction.members if member.id == header.participant), None)
        if (
            member is not None
            and kind in member.session.received_messages
            and member.session.received_messages[kind].id == header.message_id
        ):
            reports = self._unsaid.setdefault(transaction.id, {})
            report = member.offer.service, situation
            # It may be there already: when the report came first, the Task Manager was killed, and it was said again.
            if self._put.get(report, -1.0) < self._reports[header.message_id]:
                reports[header.message_id] = report

    def planning(self, address: str, problem: Problem) -> None:
        """The planner is asked. Of two transactions that want the same, either may have asked; a preview may ask at any time."""
        manager = self._stage.task_manager(address)
        if manager is None or any(str(parse(effect)) == str(problem.goal) for effect in self._previews.values()):
            return
        wanting = [t for t in manager.state.tasks.values() if t.outcome is None and any(p.goal == str(problem.goal) for p in t.executions)]
        if wanting and all(self._unsaid.get(task.id) for task in wanting):
            self._nothing_unsaid(wanting[0].id, "it was planned")

    # How tasks end

    def _follow(self, manager: TaskManager) -> None:
        for task in manager.state.tasks.values():
            if task.id in self.outcomes:
                known = self.outcomes[task.id]
                if (task.outcome, task.ended_at) != (known.outcome, known.ended_at):
                    raise Violation(Property.HOME, f"{task.id} ended {known.outcome}, and then {task.outcome}")
            elif task.outcome is not None:
                self.outcomes[task.id] = view(task)
                self._ended(task, self.outcomes[task.id], manager)
            elif task.ending is not None:
                self._endings.setdefault(task.id, task.ending)

    def _ended(self, task: TaskState, seen: TaskView, manager: TaskManager) -> None:
        decided = self._endings.get(task.id)
        if decided is not None and decided is not seen.outcome:
            raise Violation(Property.RESTART, f"{task.id} was to end {decided}, and ended {seen.outcome}")
        if seen.outcome is Outcome.ACCOMPLISHED:
            if not formula_holds(parse(seen.effect), manager.state.replica.map, manager.state.replica.ontology):
                raise Violation(Property.MAP, f"{task.id} ended accomplished, and {seen.effect} is not so on the map")
            return
        if not seen.reasons:
            raise Violation(Property.SILENCE, f"{task.id} ended {seen.outcome}, and nothing says why")
        for work in seen.work:
            self._accounted(work, seen)
        self._nothing_left(task, seen)

    def _accounted(self, work: WorkView, seen: TaskView) -> None:
        """FRP, property 4: what was done is undone, or the client is told what it left."""
        if work.state is State.EXECUTING:
            raise Violation(Property.SILENCE, f"{seen.task} ended {seen.outcome}, and {work.service} is still at work for it")
        left = work.situation or "nothing is known"
        if work.state is State.STRANDED and not any(work.service in reason and left in reason for reason in seen.reasons):
            raise Violation(Property.SILENCE, f"{work.service} left {work.situation}, and is not in the explanation: {seen.explanation}")

    def _nothing_left(self, task: TaskState, seen: TaskView) -> None:
        """By the truth: each object that the task's devices moved is as it was before them, or is told of as stranded. What others have
        moved since is theirs to tell of, and of what somebody lied about nothing better can be known."""
        reality = self._stage.reality
        if any(handler.on == "compensation" for handler in task.task.handlers):
            return  # something else than what was before is put up with
        for object in dict.fromkeys(deed.object for deed in reality.deeds if deed.task == task.id):
            deeds = [deed for deed in reality.deeds if deed.object == object]
            first = next(deed for deed in deeds if deed.task == task.id)
            if object in reality.doubtful or deeds[-1].task != task.id or reality.state(object) == first.before:
                continue
            if any(self._meanwhile(deed, task) for deed in deeds):
                continue  # others had a hand in it
            if not any(self._tells_of(work, object) for work in seen.work):
                raise Violation(
                    Property.SILENCE,
                    f"{seen.task} ended {seen.outcome}; {_deeds(deeds)}; and nobody says that {reality.said(object)} "
                    f"is left of it: {seen.explanation}",
                )

    def _meanwhile(self, deed: Deed, task: TaskState) -> bool:
        """Whether somebody else did it while the task was under way, or for a task that was under way then, too: for another Task
        Manager's, or for nobody's. What one of its own has, its Task Manager gives to nobody."""
        if self._together(deed.task, task.id):
            return False
        other = self.outcomes.get(deed.task) if deed.task is not None else None
        over = deed.at if other is None or other.ended_at is None else other.ended_at
        under_way = deed.task is not None and other is None
        return under_way or max(deed.at, over) >= task.submitted_at

    def _tells_of(self, work: WorkView, object: str) -> bool:
        """Whether the client finds out that the object is not as it was: it is stranded, or what undid other work left it so."""
        if object not in work.inputs.values():
            return False
        left_so = work.situation is not None and self._stage.reality.said(object) in work.situation
        return work.state is State.STRANDED or (work.step.startswith(GoalKind.UNDO) and left_so)

    # The end

    def settled(self) -> bool:
        """Whether everything is over."""
        return not self.unsettled()

    def unsettled(self) -> str:
        """What is not over yet."""
        return next(self._unsettled(), "")

    def _unsettled(self) -> Iterator[str]:
        stage = self._stage
        yield from (f"the client was not answered about its wish {number}" for number in stage.client.open)
        yield from (f"the client cannot cancel its wish {number}" for number in stage.client.wants_to_cancel)
        yield from (f"the client does not hear what its wish {number} would cost" for number in stage.client.wants_previews)
        for address in stage.managers:
            manager = stage.task_manager(address)
            if manager is None:
                yield f"{address} is down"
                continue
            yield from (
                f"{task.id} is {task.phase}: {sentence(task.events[-1].event)}" for task in manager.state.tasks.values() if not task.outcome
            )
            if (left := stage.world.timers(address) - {ReplicaDue()}) and all(t.outcome for t in manager.state.tasks.values()):
                yield f"{address} still waits for {sorted(map(str, left))[0]}"
        for transaction, participant in self._terms:
            device = stage.world.components.get(f"devices/{service_of(participant).partition('.')[0]}")
            if isinstance(device, ServiceManager) and (state := device.state_of(transaction, participant)) not in (State.ENDED, State.NEW):
                yield f"{participant} in {transaction} is {state}"
        for hands in stage.hands.values():
            device = stage.world.components.get(hands.character.address)
            if isinstance(device, ServiceManager) and not device.idle:
                yield f"{hands.name} is not idle"

    def finish(self) -> None:
        """What must hold of a whole run."""
        stage = self._stage
        if unsettled := self.unsettled():
            raise Violation(Property.HOME, f"when all was over it began again: {unsettled}")
        for pair in self._accepted:
            if pair not in self._released:
                raise Violation(Property.ORPHAN, f"{pair[1]} in {pair[0]} was committed, and nobody tells it that it is over")
        for message in stage.world.messages:
            if isinstance(message.body, frp.Fault) and message.header.sender in stage.managers and message.header.participant is not None:
                raise Violation(Property.BREAKS, f"{message.header.participant} said what may not be said: {message.body.text}")
        for hands, labour in stage.working:
            raise Violation(Property.ORPHAN, f"{hands.name} is still at {labour.participant}")
        self._map_is_true()
        records: dict[str, TaskRecord] = {}
        for address in stage.managers:
            for entry in stage.world.records[address]:
                if isinstance(entry, TaskRecord) and records.setdefault(entry.task, entry).outcome is not entry.outcome:
                    raise Violation(Property.HOME, f"{entry.task} is on record with two outcomes")
        for number, task in stage.client.tasks.items():
            manager = stage.task_manager(stage.story.wishes[number].to)
            known = manager.state.tasks[task].outcome if manager is not None and task in manager.state.tasks else None
            if known is None or task not in records or records[task].outcome is not known:
                raise Violation(Property.RESTART, f"{task} was taken, and is not on record as it ended")

    def _map_is_true(self) -> None:
        """At the end, when everything that was done has been reported: by whoever did it, or seen since. Only of a device that never
        came back may the map not know better; and of a thing that services worked on for two Task Managers, the later report may be of the
        earlier work: whoever could not be reached for a while hears late how things were then."""
        stage, contents = self._stage, self._stage.contents
        assert contents is not None, "whoever shares the Repository waits for it"
        for deed in {deed.object: deed for deed in stage.reality.deeds}.values():
            tasks = self._worked.get(deed.object, set()) | {one.task for one in stage.reality.deeds if one.object == deed.object}
            apart = len(tasks) > 1 and not self._together(*tasks)
            if deed.object in stage.reality.doubtful or f"devices/{deed.who}" not in stage.world.components or apart:
                continue
            said = parse(stage.reality.said(deed.object))
            known = contents.map.objects[deed.object].values.get("Unknown") is not True
            if known and not formula_holds(said, contents.map, contents.ontology):
                raise Violation(Property.MAP, f"{deed.who} had {deed.object} {deed.after}, and when all is over the map does not know it")


def _deeds(deeds: list[Deed]) -> str:
    return ", ".join(f"{deed.who} had {deed.object} {deed.after}" for deed in deeds)
