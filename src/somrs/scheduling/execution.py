"""What becomes of each time at which an order is due: its task is stated once, and followed until it is over.

The id of the message that states a task is made of the order and the time. So it can be sent again, after an answer that never came, or
after a restart, and is one task.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msgspec import structs

from somrs.client.task_report import reasons
from somrs.errors import InputError
from somrs.kernel.component import Effects, Send
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.clients import Phase, Submit, Submitted, TaskNews, TaskRejected, WatchTask
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault, Outcome
from somrs.protocol.messages.orders import Run, RunState, StandingOrder
from somrs.protocol.messages.people import client_address
from somrs.protocol.messages.records import ReadRecords, Records
from somrs.scheduling.state import Question, SchedulerState

LATE = 60.0
"""Seconds after which a time is missed: until then a task is stated late, after a restart, say."""

WAIT = 10.0
"""Seconds that a question waits for a task to end."""

ANSWER_TIME = 5.0
"""Seconds, besides, after which a question that nobody answered is asked again."""

RETRY_DELAY = 1.0
"""Seconds before a question is asked again that could not be delivered."""

ALL_EVENTS = 10**9
"""More than any task has: only its end is news then."""


Note = Callable[[str, Run], Effects]
"""Notes what came of a time at which the order of this id was due."""


class Execution:
    """All times whose tasks may be under way. `task_of` gives the task of an order, and raises InputError when there is none."""

    def __init__(self, scheduler_state: SchedulerState, task_of: Callable[[StandingOrder], Submit], note: Note) -> None:
        self._scheduler_state, self._task_of, self._note = scheduler_state, task_of, note

    @property
    def next_retry(self) -> float | None:
        """When a question is to be asked again."""
        return min((question.until for question in self._scheduler_state.questions.values()), default=None)

    def start_run(self, order: StandingOrder, run: Run, now: float) -> Effects:
        """State the task, unless the one before runs."""
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
        """Ask again what nobody answered."""
        for id, question in [*self._scheduler_state.questions.items()]:
            if question.until <= now:
                yield from self._unanswered(id, question, now)

    def undelivered(self, id: str, now: float) -> None:
        """A message was not delivered; if it was a question, it is to be asked again."""
        questions = self._scheduler_state.questions
        if (question := questions.get(id)) is not None:
            questions[id] = structs.replace(question, until=now + RETRY_DELAY)

    def answered(self, id: str, body: Body, now: float) -> Effects:
        """An answer to the question that this message asked, which is open."""
        question = self._scheduler_state.questions.pop(id)
        run = self._run(question)
        if run is None:
            return  # the order was taken back, or it is known already
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
            case _:  # nobody has it in mind: it may be over long since
                yield self._ask(question.order, run, ReadRecords(task=run.task, brief=True, limit=1), now)

    # What is asked

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
        """It was not heard whether the task was taken, or it was, and may be over."""
        return self._ask(order, run, WatchTask(task=run.task or "", after=ALL_EVENTS, wait=0.0), now)

    def _follow(self, order: str, run: Run, now: float) -> Send:
        return self._ask(order, run, WatchTask(task=run.task or "", after=ALL_EVENTS, wait=WAIT), now)

    def _unanswered(self, id: str, question: Question, now: float) -> Effects:
        del self._scheduler_state.questions[id]
        run = self._run(question)
        if run is None:
            return
        if question.about is not None:  # as far as is known
            yield from self._skipped(question.order, run, question.about)
        else:
            yield self._look(question.order, run, now)

    # What comes of it

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
        """The Task Manager knows nothing of the task."""
        if run.state is RunState.SUBMITTED:
            yield from self._note(id, structs.replace(run, ended_at=now, note="nothing is known of its task any more"))
        elif now - run.due <= LATE and (order := self._scheduler_state.book.orders.get(id)) is not None:
            yield from self.start_run(order, run, now)
        else:
            note = "the Task Manager was not there, and has not taken the task"
            yield from self._note(id, structs.replace(run, state=RunState.MISSED, task=None, note=note))

    def _check_earlier_task(self, question: Question, run: Run, body: Body, now: float) -> Effects:
        """What was asked is whether the task before still runs."""
        assert question.about is not None, "else it is not asked"
        order = self._scheduler_state.book.orders.get(question.order)
        if order is None:
            return
        if isinstance(body, TaskNews) and body.view.phase is not Phase.ENDED:
            yield from self._skipped(question.order, run, question.about)
        else:
            yield from self._submit(order, run, now)

    def _skipped(self, id: str, run: Run, earlier_task: str) -> Effects:
        note = f"the task before ({earlier_task}) was still under way"
        yield from self._note(id, structs.replace(run, state=RunState.SKIPPED, task=None, note=note))

    def _refused(self, id: str, run: Run, reason: str) -> Effects:
        yield from self._note(id, structs.replace(run, state=RunState.REFUSED, task=None, note=reason))


def message_for(order: str, due: float) -> str:
    """The id of the message that states the order's task of that time."""
    return message_id("order", order, f"{due:.3f}")


def task_for(order: str, due: float) -> str:
    """As the Task Manager calls it."""
    return message_id("task", message_for(order, due))
