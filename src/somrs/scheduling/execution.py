"""The execution of a run: the task of an order is submitted once for each due time, and followed until it ends.

The id of the message that submits the task derives from the order and the due time. The message can therefore be sent again after a
missing reply or a restart, without creating a second task. With several Task Managers, it is sent to one after the other until one answers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msgspec import structs

from somrs.client.task_report import reasons
from somrs.errors import InputError
from somrs.kernel.component import Effects, Send
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault, Outcome
from somrs.protocol.messages.orders import Run, RunState, StandingOrder
from somrs.protocol.messages.people import client_address
from somrs.protocol.messages.records import ReadRecords, Records
from somrs.protocol.messages.reservations import TaskAssigned
from somrs.protocol.messages.submission import Submit, SubmitOnce, Submitted, TaskRejected
from somrs.protocol.messages.task_news import TaskNews, WatchTask
from somrs.protocol.messages.task_views import Phase
from somrs.scheduling.state import Question, SchedulerState

LATE = 60.0
"""Seconds after a due time within which its task is still submitted, such as after a restart; later, the run is missed."""

WAIT = 10.0
"""Seconds for which a request waits for a task to end."""

ANSWER_TIME = 5.0
"""Additional seconds after which a request without a reply is sent again."""

RETRY_DELAY = 1.0
"""Seconds after which a request that could not be delivered is sent again."""

ALL_EVENTS = 10**9
"""A number of events greater than any task has, so that only the task's end is news."""


Note = Callable[[str, Run], Effects]
"""Stores a run of the order with this id."""


class Execution:
    """The runs whose tasks may be running. `task_of`: returns the task of an order, or raises InputError if it is not valid."""

    def __init__(self, scheduler_state: SchedulerState, task_of: Callable[[StandingOrder], Submit], note: Note) -> None:
        self._scheduler_state, self._task_of, self._note = scheduler_state, task_of, note

    @property
    def next_retry(self) -> float | None:
        """When the next request is to be sent again; None if none is open."""
        return min((question.until for question in self._scheduler_state.questions.values()), default=None)

    def start_run(self, order: StandingOrder, run: Run, now: float) -> Effects:
        """Submit the task; if the order skips runs, first check that the task of the previous run has ended."""
        earlier_runs = [
            earlier_run
            for earlier_run in self._scheduler_state.book.runs_of(order.id)
            if earlier_run.due < run.due and earlier_run.open and earlier_run.task is not None
        ]
        if order.skip and earlier_runs:
            task = earlier_runs[-1].task or ""
            watch, address = WatchTask(task=task, after=ALL_EVENTS, wait=0.0), self._address(earlier_runs[-1])
            yield self._ask(order.id, run, watch, now, address, earlier_task=task)
        else:
            yield from self._submit(order, run, now)

    def ask_again(self, now: float) -> Effects:
        """Repeat the requests whose time for a reply has passed."""
        for id, question in [*self._scheduler_state.questions.items()]:
            if question.until <= now:
                yield from self._unanswered(id, question, now)

    def undelivered(self, id: str, now: float) -> None:
        """Plan the repetition of a request that could not be delivered; ignore other messages."""
        questions = self._scheduler_state.questions
        if (question := questions.get(id)) is not None:
            questions[id] = structs.replace(question, until=now + RETRY_DELAY)

    def answered(self, id: str, body: Body, now: float) -> Effects:
        """Process the reply to an open request. `id`: the id of the request's message."""
        question = self._scheduler_state.questions.pop(id)
        run = self._run(question)
        if run is None:
            return  # the order was removed, or the result of the run is already known
        if question.about is not None:
            yield from self._check_earlier_task(question, run, body, now)
            return
        match body:
            case Submitted() | TaskAssigned():
                address = body.task_manager if isinstance(body, TaskAssigned) else ""
                run = structs.replace(run, state=RunState.SUBMITTED, task_manager=address)
                yield from self._note(question.order, run)
                yield self._follow(question.order, run, now)
            case TaskRejected(problem=reason):
                yield from self._refused(question.order, run, reason)
            case Fault(text=reason) if isinstance(question.body, Submit | SubmitOnce):
                yield from self._refused(question.order, run, reason)
            case TaskNews(view=view):
                run = structs.replace(run, task_manager=question.task_manager)
                yield from self._record_progress(question.order, run, view.phase, view.outcome, view.ended_at, reasons(view), now)
            case Records(records=records) if records:
                record = records[0]
                yield from self._record_progress(question.order, run, Phase.ENDED, record.outcome, record.ended_at, reasons(record), now)
            case Records():
                yield from self._unknown(question, run, now)
            case _ if isinstance(question.body, ReadRecords):
                self._scheduler_state.questions[id] = structs.replace(question, until=now + RETRY_DELAY)
            case _:  # the Task Manager no longer holds the task: it may have ended long ago
                query = ReadRecords(task=run.task, brief=True, limit=1)
                yield self._ask(question.order, run, query, now, question.task_manager or self._address(run), strangers=question.strangers)

    # Requests

    def _ask(
        self,
        order: str,
        run: Run,
        body: Submit | SubmitOnce | WatchTask | ReadRecords,
        now: float,
        task_manager: str,
        earlier_task: str | None = None,
        author: str | None = None,
        strangers: tuple[str, ...] = (),
    ) -> Send:
        address, scheduler_state = self._scheduler_state.address, self._scheduler_state
        scheduler_state.question_count += 1
        if isinstance(body, Submit):
            id, deadline = message_for(order, run.due), max(now + ANSWER_TIME, run.due + LATE)
        elif isinstance(body, SubmitOnce):
            id, deadline = message_for(order, run.due), now + ANSWER_TIME
        else:
            wait = body.wait if isinstance(body, WatchTask) else 0.0
            id, deadline = message_id(address, order, run.due, scheduler_state.question_count, now), now + wait + ANSWER_TIME
        scheduler_state.questions[id] = Question(
            order=order,
            due=run.due,
            body=body,
            about=earlier_task,
            until=deadline,
            task_manager=task_manager if self._several else "",
            strangers=strangers,
        )
        sender = client_address(author) if author is not None else address
        header = Header(sender=sender, recipient=task_manager, message_id=id, reply_to=address)
        return Send(Message(header=header, body=body), expires_at=deadline, strict=isinstance(body, Submit | SubmitOnce))

    def _submit(self, order: StandingOrder, run: Run, now: float, previous_address: str = "") -> Effects:
        """Submit the task, if there are several to the Task Manager after the one that has not answered."""
        try:
            task = self._task_of(order)
        except InputError as error:
            yield from self._refused(order.id, run, str(error))
        else:
            id = message_for(order.id, run.due)
            addresses = sorted(self._scheduler_state.located.task_managers, key=lambda address: message_id(id, address))
            body = SubmitOnce(submission=task) if self._several else task
            yield self._ask(order.id, run, body, now, _next_address(addresses, previous_address), author=f"order {order.name}")

    @property
    def _several(self) -> bool:
        return len(self._scheduler_state.located.task_managers) > 1

    def _address(self, run: Run) -> str:
        """The Task Manager that has the task of the run; if that is not known, the first one."""
        located = self._scheduler_state.located
        return run.task_manager if run.task_manager in located.task_managers else located.task_manager

    def _look(self, question: Question, run: Run, now: float) -> Send:
        """The request for the state of a task that may not have been accepted, or may have ended. If it is not known who has it, all Task
        Managers are asked, one after the other."""
        addresses = self._scheduler_state.located.task_managers
        address = run.task_manager
        if address not in addresses:
            possible = [address for address in addresses if address not in question.strangers or address == question.task_manager]
            address = _next_address(possible, question.task_manager)
        watch = WatchTask(task=run.task or "", after=ALL_EVENTS, wait=0.0)
        return self._ask(question.order, run, watch, now, address, strangers=question.strangers)

    def _follow(self, order: str, run: Run, now: float) -> Send:
        return self._ask(order, run, WatchTask(task=run.task or "", after=ALL_EVENTS, wait=WAIT), now, self._address(run))

    def _unanswered(self, id: str, question: Question, now: float) -> Effects:
        del self._scheduler_state.questions[id]
        run = self._run(question)
        if run is None:
            return
        order = self._scheduler_state.book.orders.get(question.order)
        if question.about is not None:  # without a reply, the earlier task counts as running
            yield from self._skipped(question.order, run, question.about)
        elif isinstance(question.body, SubmitOnce) and order is not None and now - run.due <= LATE:
            yield from self._submit(order, run, now, question.task_manager)
        else:
            yield self._look(question, run, now)

    # Results

    def _run(self, question: Question) -> Run | None:
        runs = self._scheduler_state.book.runs_of(question.order)
        return next((run for run in runs if run.due == question.due and run.open), None)

    def _record_progress(
        self, order: str, run: Run, phase: Phase, outcome: Outcome | None, ended_at: float | None, reason_texts: Sequence[str], now: float
    ) -> Effects:
        if phase is Phase.ENDED:
            ended_run = structs.replace(
                run, state=RunState.SUBMITTED, outcome=outcome, ended_at=ended_at or now, note=reason_texts[0] if reason_texts else ""
            )
            yield from self._note(order, ended_run)
            return
        if run.state is not RunState.SUBMITTED:
            run = structs.replace(run, state=RunState.SUBMITTED)
            yield from self._note(order, run)
        yield self._follow(order, run, now)

    def _unknown(self, question: Question, run: Run, now: float) -> Effects:
        """Process the reply that a Task Manager has neither the task nor a record of it."""
        id, strangers = question.order, (*question.strangers, question.task_manager)
        addresses = self._scheduler_state.located.task_managers
        if self._several and run.task_manager not in addresses and not {*addresses} <= {*strangers}:
            yield self._look(structs.replace(question, strangers=strangers), run, now)
        elif run.state is RunState.SUBMITTED:
            yield from self._note(id, structs.replace(run, ended_at=now, note="the Task Manager no longer has a record of its task"))
        elif now - run.due <= LATE and (order := self._scheduler_state.book.orders.get(id)) is not None:
            yield from self.start_run(order, run, now)
        else:
            note = "the Task Manager did not answer, and has not accepted the task"
            yield from self._note(id, structs.replace(run, state=RunState.MISSED, task=None, note=note))

    def _check_earlier_task(self, question: Question, run: Run, body: Body, now: float) -> Effects:
        """Skip the run if the task of the previous run is still running; submit its task otherwise."""
        assert question.about is not None, "the request is about an earlier task"
        order = self._scheduler_state.book.orders.get(question.order)
        if order is None:
            return
        if isinstance(body, TaskNews) and body.view.phase is not Phase.ENDED:
            yield from self._skipped(question.order, run, question.about)
        else:
            yield from self._submit(order, run, now)

    def _skipped(self, id: str, run: Run, earlier_task: str) -> Effects:
        note = f"the previous task ({earlier_task}) was still running"
        yield from self._note(id, structs.replace(run, state=RunState.SKIPPED, task=None, note=note))

    def _refused(self, id: str, run: Run, reason: str) -> Effects:
        yield from self._note(id, structs.replace(run, state=RunState.REFUSED, task=None, note=reason))


def _next_address(addresses: Sequence[str], previous_address: str) -> str:
    """The address after the previous one, around; the first if that is not among them."""
    index = addresses.index(previous_address) + 1 if previous_address in addresses else 0
    return addresses[index % len(addresses)]


def message_for(order: str, due: float) -> str:
    """The id of the message that submits the order's task for a due time."""
    return message_id("order", order, f"{due:.3f}")


def task_for(order: str, due: float) -> str:
    """The id of that task in the Task Manager."""
    return message_id("task", message_for(order, due))
