"""The execution of a run: the task of an order is submitted once for each due time, and followed until it ends.

The id of the message that submits the task derives from the order and the due time. The message can therefore be sent again after a
missing reply or a restart, without creating a second task.
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
from somrs.protocol.messages.submission import Submit, Submitted, TaskRejected
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
        earlier_tasks = [
            earlier_run.task
            for earlier_run in self._scheduler_state.book.runs_of(order.id)
            if earlier_run.due < run.due and earlier_run.open and earlier_run.task is not None
        ]
        if order.skip and earlier_tasks:
            yield self._ask(
                order.id, run, WatchTask(task=earlier_tasks[-1], after=ALL_EVENTS, wait=0.0), now, earlier_task=earlier_tasks[-1]
            )
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
            case Submitted():
                run = structs.replace(run, state=RunState.SUBMITTED)
                yield from self._note(question.order, run)
                yield self._follow(question.order, run, now)
            case TaskRejected(problem=reason):
                yield from self._refused(question.order, run, reason)
            case Fault(text=reason) if isinstance(question.body, Submit):
                yield from self._refused(question.order, run, reason)
            case TaskNews(view=view):
                yield from self._record_progress(question.order, run, view.phase, view.outcome, view.ended_at, reasons(view), now)
            case Records(records=records) if records:
                record = records[0]
                yield from self._record_progress(question.order, run, Phase.ENDED, record.outcome, record.ended_at, reasons(record), now)
            case Records():
                yield from self._unknown(question.order, run, now)
            case _ if isinstance(question.body, ReadRecords):
                self._scheduler_state.questions[id] = structs.replace(question, until=now + RETRY_DELAY)
            case _:  # the Task Manager no longer holds the task: it may have ended long ago
                yield self._ask(question.order, run, ReadRecords(task=run.task, brief=True, limit=1), now)

    # Requests

    def _ask(
        self,
        order: str,
        run: Run,
        body: Submit | WatchTask | ReadRecords,
        now: float,
        earlier_task: str | None = None,
        author: str | None = None,
    ) -> Send:
        address, scheduler_state = self._scheduler_state.address, self._scheduler_state
        scheduler_state.question_count += 1
        if isinstance(body, Submit):
            id, deadline = message_for(order, run.due), max(now + ANSWER_TIME, run.due + LATE)
        else:
            wait = body.wait if isinstance(body, WatchTask) else 0.0
            id, deadline = message_id(address, order, run.due, scheduler_state.question_count, now), now + wait + ANSWER_TIME
        scheduler_state.questions[id] = Question(order=order, due=run.due, body=body, about=earlier_task, until=deadline)
        sender = client_address(author) if author is not None else address
        header = Header(sender=sender, recipient=scheduler_state.located.task_manager, message_id=id, reply_to=address)
        return Send(Message(header=header, body=body), expires_at=deadline, strict=isinstance(body, Submit))

    def _submit(self, order: StandingOrder, run: Run, now: float) -> Effects:
        try:
            task = self._task_of(order)
        except InputError as error:
            yield from self._refused(order.id, run, str(error))
        else:
            yield self._ask(order.id, run, task, now, author=f"order {order.name}")

    def _look(self, order: str, run: Run, now: float) -> Send:
        """The request for the state of a task that may not have been accepted, or may have ended."""
        return self._ask(order, run, WatchTask(task=run.task or "", after=ALL_EVENTS, wait=0.0), now)

    def _follow(self, order: str, run: Run, now: float) -> Send:
        return self._ask(order, run, WatchTask(task=run.task or "", after=ALL_EVENTS, wait=WAIT), now)

    def _unanswered(self, id: str, question: Question, now: float) -> Effects:
        del self._scheduler_state.questions[id]
        run = self._run(question)
        if run is None:
            return
        if question.about is not None:  # without a reply, the earlier task counts as running
            yield from self._skipped(question.order, run, question.about)
        else:
            yield self._look(question.order, run, now)

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

    def _unknown(self, id: str, run: Run, now: float) -> Effects:
        """Process the reply that the Task Manager has neither the task nor a record of it."""
        if run.state is RunState.SUBMITTED:
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


def message_for(order: str, due: float) -> str:
    """The id of the message that submits the order's task for a due time."""
    return message_id("order", order, f"{due:.3f}")


def task_for(order: str, due: float) -> str:
    """The id of that task in the Task Manager."""
    return message_id("task", message_for(order, due))
