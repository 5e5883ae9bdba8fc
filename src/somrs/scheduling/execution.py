"""What becomes of each time at which an order is due: its task is stated once, and followed until it is over.

The id of the message that states a task is made of the order and the time. So it can be sent again, after an answer that never came, or
after a restart, and is one task.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msgspec import Struct, structs

from somrs.client.task_report import reasons
from somrs.errors import InputError
from somrs.kernel.component import Effect, Send
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.clients import Phase, Submit, Submitted, TaskNews, TaskRejected, WatchTask
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault, Outcome
from somrs.protocol.messages.orders import Run, RunState, StandingOrder
from somrs.protocol.messages.people import client
from somrs.protocol.messages.records import ReadRecords, Records
from somrs.scheduling.book import Book

LATE = 60.0
"""Seconds after which a time is missed: until then a task is stated late, after a restart, say."""

WAIT = 10.0
"""Seconds that a question waits for a task to end."""

ANSWER_TIME = 5.0
"""Seconds, besides, after which a question that nobody answered is asked again."""

AGAIN = 1.0
"""Seconds before a question is asked again that could not be delivered."""

ALL_EVENTS = 10**9
"""More than any task has: only its end is news then."""


class Question(Struct, frozen=True, kw_only=True):
    """What the Task Manager was asked for a time at which an order was due. `about`: a task of a time before, which may still run.
    `until`: when it is asked again, if nobody answered."""

    order: str
    due: float
    body: Submit | WatchTask | ReadRecords
    about: str | None = None
    until: float


Note = Callable[[str, Run], list[Effect]]
"""Notes what came of a time at which the order of this id was due."""


class Execution:
    """All times whose tasks may be under way. `task_of` gives the task of an order, and raises InputError when there is none."""

    def __init__(self, address: str, task_manager: str, book: Book, task_of: Callable[[StandingOrder], Submit], note: Note) -> None:
        self._address, self._task_manager = address, task_manager
        self._book, self._task_of, self._note = book, task_of, note
        self._questions: dict[str, Question] = {}
        """By the id of the message."""
        self._asked = 0

    @property
    def next(self) -> float | None:
        """When a question is to be asked again."""
        return min((one.until for one in self._questions.values()), default=None)

    def resume(self, now: float) -> list[Effect]:
        """Go on with whatever was open in an earlier life."""
        open = [(id, run) for id, runs in self._book.runs.items() for run in runs if run.open]
        return [effect for id, run in open for effect in self._look(id, run, now)]

    def state(self, order: StandingOrder, run: Run, now: float) -> list[Effect]:
        """State the task, unless the one before runs."""
        before = [one for one in self._book.runs_of(order.id) if one.due < run.due and one.open and one.task is not None]
        if order.skip and before:
            return self._ask(order.id, run, WatchTask(task=before[-1].task or "", after=ALL_EVENTS, wait=0.0), now, about=before[-1].task)
        return self._submit(order, run, now)

    def ring(self, now: float) -> list[Effect]:
        """Ask again what nobody answered."""
        silent = [(id, one) for id, one in self._questions.items() if one.until <= now]
        return [effect for id, one in silent for effect in self._unanswered(id, one, now)]

    def undelivered(self, id: str, now: float) -> list[Effect] | None:
        """A message was not delivered; None when it is none of a question."""
        question = self._questions.get(id)
        if question is None:
            return None
        self._questions[id] = structs.replace(question, until=now + AGAIN)
        return []

    def answered(self, id: str, body: Body, now: float) -> list[Effect] | None:
        """An answer to a message; None when it is none to a question."""
        question = self._questions.pop(id, None)
        if question is None:
            return None
        run = self._run(question)
        if run is None:
            return []  # the order was taken back, or it is known already
        if question.about is not None:
            return self._of_before(question, run, body, now)
        match body:
            case Submitted():
                run = structs.replace(run, state=RunState.SUBMITTED)
                return [*self._note(question.order, run), *self._follow(question.order, run, now)]
            case TaskRejected(problem=why):
                return self._refused(question.order, run, why)
            case Fault(text=why) if isinstance(question.body, Submit):
                return self._refused(question.order, run, why)
            case TaskNews(view=view):
                return self._seen(question.order, run, view.phase, view.outcome, view.ended_at, reasons(view), now)
            case Records(records=records) if records:
                kept = records[0]
                return self._seen(question.order, run, Phase.ENDED, kept.outcome, kept.ended_at, reasons(kept), now)
            case Records():
                return self._unknown(question.order, run, now)
            case _ if isinstance(question.body, ReadRecords):
                self._questions[id] = structs.replace(question, until=now + AGAIN)
                return []
            case _:  # nobody has it in mind: it may be over long since
                return self._ask(question.order, run, ReadRecords(task=run.task, brief=True, limit=1), now)

    # What is asked

    def _ask(
        self, order: str, run: Run, body: Submit | WatchTask | ReadRecords, now: float, about: str | None = None, by: str | None = None
    ) -> list[Effect]:
        self._asked += 1
        if isinstance(body, Submit):
            id, until = message_for(order, run.due), max(now + ANSWER_TIME, run.due + LATE)
        else:
            wait = body.wait if isinstance(body, WatchTask) else 0.0
            id, until = message_id(self._address, order, run.due, self._asked, now), now + wait + ANSWER_TIME
        self._questions[id] = Question(order=order, due=run.due, body=body, about=about, until=until)
        sender = client(by) if by is not None else self._address
        header = Header(sender=sender, recipient=self._task_manager, message_id=id, reply_to=self._address)
        return [Send(Message(header=header, body=body), until=until)]

    def _submit(self, order: StandingOrder, run: Run, now: float) -> list[Effect]:
        try:
            task = self._task_of(order)
        except InputError as error:
            return self._refused(order.id, run, str(error))
        return self._ask(order.id, run, task, now, by=f"order {order.name}")

    def _look(self, order: str, run: Run, now: float) -> list[Effect]:
        """It was not heard whether the task was taken, or it was, and may be over."""
        return self._ask(order, run, WatchTask(task=run.task or "", after=ALL_EVENTS, wait=0.0), now)

    def _follow(self, order: str, run: Run, now: float) -> list[Effect]:
        return self._ask(order, run, WatchTask(task=run.task or "", after=ALL_EVENTS, wait=WAIT), now)

    def _unanswered(self, id: str, question: Question, now: float) -> list[Effect]:
        del self._questions[id]
        run = self._run(question)
        if run is None:
            return []
        if question.about is not None:  # as far as is known
            return self._skipped(question.order, run, question.about)
        return self._look(question.order, run, now)

    # What comes of it

    def _run(self, question: Question) -> Run | None:
        return next((run for run in self._book.runs_of(question.order) if run.due == question.due and run.open), None)

    def _seen(
        self, order: str, run: Run, phase: Phase, outcome: Outcome | None, ended_at: float | None, why: Sequence[str], now: float
    ) -> list[Effect]:
        if phase is Phase.ENDED:
            over = structs.replace(run, state=RunState.SUBMITTED, outcome=outcome, ended_at=ended_at or now, note=why[0] if why else "")
            return self._note(order, over)
        if run.state is RunState.SUBMITTED:
            return self._follow(order, run, now)
        run = structs.replace(run, state=RunState.SUBMITTED)
        return [*self._note(order, run), *self._follow(order, run, now)]

    def _unknown(self, id: str, run: Run, now: float) -> list[Effect]:
        """The Task Manager knows nothing of the task."""
        if run.state is RunState.SUBMITTED:
            return self._note(id, structs.replace(run, ended_at=now, note="nothing is known of its task any more"))
        if now - run.due <= LATE and (order := self._book.orders.get(id)) is not None:
            return self.state(order, run, now)
        note = "the Task Manager was not there, and has not taken the task"
        return self._note(id, structs.replace(run, state=RunState.MISSED, task=None, note=note))

    def _of_before(self, question: Question, run: Run, body: Body, now: float) -> list[Effect]:
        """What was asked is whether the task before still runs."""
        assert question.about is not None, "else it is not asked"
        order = self._book.orders.get(question.order)
        if order is None:
            return []
        if isinstance(body, TaskNews) and body.view.phase is not Phase.ENDED:
            return self._skipped(question.order, run, question.about)
        return self._submit(order, run, now)

    def _skipped(self, id: str, run: Run, before: str) -> list[Effect]:
        note = f"the task before ({before}) was still under way"
        return self._note(id, structs.replace(run, state=RunState.SKIPPED, task=None, note=note))

    def _refused(self, id: str, run: Run, why: str) -> list[Effect]:
        return self._note(id, structs.replace(run, state=RunState.REFUSED, task=None, note=why))


def message_for(order: str, due: float) -> str:
    """The id of the message that states the order's task of that time."""
    return message_id("order", order, f"{due:.3f}")


def task_for(order: str, due: float) -> str:
    """As the Task Manager calls it."""
    return message_id("task", message_for(order, due))
