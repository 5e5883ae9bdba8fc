"""The Task Manager as a component: clients' requests, answers and protocol messages go to the transaction they concern."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import islice

from somrs.kernel.component import Answered, Ask, Effect, Input, Rang, Received, Send, Started, Undelivered, Wake
from somrs.kernel.replica import Replica
from somrs.protocol.messages import clients, frp
from somrs.protocol.messages.bodies import REQUESTS, Body, FrpBody
from somrs.protocol.messages.envelope import Message, message_id, reply
from somrs.protocol.messages.paging import fitting
from somrs.task_manager.claims import Claims
from somrs.task_manager.participants import sent_home
from somrs.task_manager.preview import Previewing
from somrs.task_manager.questions import Questions
from somrs.task_manager.setting import Setting, wrong_with
from somrs.task_manager.transaction import Transaction
from somrs.task_manager.views import message_view, previewed, view, view_in_parts
from somrs.task_manager.watching import TIMER as WATCH
from somrs.task_manager.watching import Watching

__all__ = ["TaskManager", "view"]

READY_TIME = 30.0
"""Seconds that a task waits for the map to be read, after the start; then its client hears that the Repository is not there."""

REMEMBERED = 200
"""So many tasks are known; beyond that the oldest that are over are forgotten here. They stay readable: they were recorded."""


class TaskManager:
    """Takes tasks and sees them through. Several at once, each a transaction of its own."""

    def __init__(self, address: str, *, repository: str, registry: str) -> None:
        self.address = address
        self.replica = Replica(address, repository)
        self.transactions: dict[str, Transaction] = {}
        self._open: dict[str, Transaction] = {}
        """Those that are not over."""
        self._repository = repository
        self._effects: list[Effect] = []
        self._questions = Questions(address, repository, registry, self._effects)
        self._claims = Claims()
        self._map_version = -1
        self._until_known: list[tuple[int, Callable[[float], None]]] = []
        self._until_ready: dict[str, Message] = {}
        self._previews: dict[str, Previewing] = {}
        self._readers: dict[str, Message] = {}
        touched: dict[str, None] = {}
        self._watching = Watching(transactions=self.transactions, touched=touched, effects=self._effects, reply=self._reply)
        self._setting = Setting(
            address=address,
            effects=self._effects,
            replica=self.replica,
            questions=self._questions,
            when_known=self._when_known,
            claims=self._claims,
            busy=self._busy,
            touched=touched,
        )

    @property
    def open(self) -> list[str]:
        """The tasks that are not over."""
        return [*self._open]

    def handle(self, event: Input, now: float) -> list[Effect]:
        """What to do about the input."""
        news = self.replica.handle(event, now)
        if news is not None:
            self._effects += news.effects
            self._map_moved(news.read, now)
        else:
            self._handle(event, now)
        self._claims.wake(now)
        self._setting.turns.wake(now)
        self._watching.tell()
        for id in [id for id, transaction in self._open.items() if transaction.outcome is not None]:
            del self._open[id]
            self._forget()
        for id in [id for id, preview in self._previews.items() if preview.over]:
            del self._previews[id]
        effects = self._effects[:]
        self._effects.clear()
        return effects

    def _handle(self, event: Input, now: float) -> None:
        match event:
            case Started():
                self._questions.start(now)
                self._watching.start(now)
                self._effects += self.replica.start(now)
            case Received(message):
                self._receive(message, now)
            case Rang(timer):
                self._ring(timer, now)
            case Answered(question, value):
                self._answered(question, value, now)
            case Undelivered(message, reason):
                if not self._questions.undelivered(message, reason, now):
                    self._undelivered(message, reason, now)

    # Messages

    def _receive(self, message: Message, now: float) -> None:
        body, id = message.body, message.header.message_id
        if self._questions.answered(message, now):
            return
        if isinstance(body, FrpBody) and message.header.transaction is not None:
            if (transaction := self.transactions.get(message.header.transaction)) is not None:
                transaction.hearing.receive(message, now)
            elif (preview := self._previews.get(message.header.transaction)) is not None:
                preview.receive(message, now)
            else:
                self._effects += sent_home(message, self.address)
        elif not self.replica.ready and isinstance(body, clients.Submit | clients.Preview):
            self._until_ready[id] = message
            self._effects.append(Wake(f"ready {id}", now + READY_TIME))
        else:
            self._serve(message, now)

    def _serve(self, message: Message, now: float) -> None:
        """A client's request."""
        match message.body:
            case clients.Submit():
                self._submit(message, message.body, now)
            case clients.CancelTask(task=task, reason=reason):
                if (transaction := self._known(message, task)) is not None:
                    transaction.cancel(now, reason)
                    self._reply(message, clients.Cancelling(task=task))
            case clients.ReadTasks():
                self._reply(message, self._tasks(message.body))
            case clients.WatchTask(task=task):
                if self._known(message, task) is not None:
                    self._watching.wait(message, message.body, now)
            case clients.WatchTasks():
                self._watching.wait(message, message.body, now)
            case clients.ReadMessages():
                self._read_messages(message, message.body)
            case clients.Preview():
                self._preview(message, message.body, now)
            case clients.ReadRecords():
                question = f"records {message.header.message_id}"
                self._readers[question] = message
                self._effects.append(Ask(question, message.body))
            case frp.Fault():
                pass  # a Fault is never answered
            case body if type(body) not in REQUESTS and not isinstance(body, FrpBody):
                pass  # an answer that came twice, or too late
            case body:
                self._reply(message, frp.Fault(code="wsa:ActionNotSupported", text=f"a Task Manager does not take {type(body).__name__}"))

    def _submit(self, message: Message, task: clients.Submit, now: float) -> None:
        id = message_id("task", message.header.message_id)
        if id not in self.transactions:
            if (wrong := wrong_with(task, self.replica)) is not None:
                self._reply(message, clients.TaskRejected(problem=wrong))
                return
            transaction = Transaction(id, task, self._setting, now, client=message.header.sender)
            self.transactions[id] = self._open[id] = transaction
            transaction.start(now)
        self._reply(message, clients.Submitted(task=id))

    def _preview(self, message: Message, task: clients.Preview, now: float) -> None:
        id = message_id("preview", message.header.message_id)
        if id not in self._previews:
            preview = Previewing(id, task, self._setting, partial(self._reply, message))
            if (wrong := wrong_with(preview.task, self.replica)) is not None:
                self._reply(message, previewed(wrong))
            else:
                self._previews[id] = preview
                preview.begin(now)

    def _tasks(self, wanted: clients.ReadTasks) -> clients.Tasks:
        found = [each for each in self.transactions.values() if each.outcome is None or not wanted.running]
        newest = sorted(found, key=lambda each: (each.submitted_at, each.id), reverse=True)
        if wanted.behind is not None:
            last = self.transactions.get(wanted.behind)
            newest = [each for each in newest if last is not None and (each.submitted_at, each.id) < (last.submitted_at, last.id)]
        page = tuple(fitting((view_in_parts(each, 0)[0] for each in newest), max(wanted.limit, 0)))
        return clients.Tasks(tasks=page, more=len(page) < len(newest))

    def _read_messages(self, request: Message, wanted: clients.ReadMessages) -> None:
        """Those of a task that is over are in its record."""
        transaction, after = self._open.get(wanted.task), max(wanted.after, 0)
        if transaction is not None:
            page = tuple(fitting(message_view(at, one) for at, one in islice(transaction.messages, after, None)))
            self._reply(request, clients.Messages(messages=page, more=after + len(page) < len(transaction.messages)))
        else:
            question = f"messages {request.header.message_id}"
            self._readers[question] = request
            parts = tuple(name for name in clients.PARTS if name != "messages")
            self._effects.append(Ask(question, clients.ReadRecords(task=wanted.task, limit=1, after=after, without=parts)))

    def _known(self, message: Message, task: str) -> Transaction | None:
        transaction = self.transactions.get(task)
        if transaction is None:
            self._reply(message, frp.Fault(code="env:Sender", text=f"there is no task {task} here"))
        return transaction

    # What the node answers

    def _ring(self, timer: str, now: float) -> None:
        kind, _, id = timer.partition(" ")
        if kind == WATCH:
            self._watching.ring(id)
        elif kind == "ready":
            if (waiting := self._until_ready.pop(id, None)) is not None:
                text = f"the map of the environment is not known yet, because {self._repository} does not answer; try again later"
                self._reply(waiting, frp.Fault(code="env:Receiver", text=text))
        elif not self._questions.ring(timer, now):
            task, _, what = timer.partition("/")
            if (transaction := self.transactions.get(task)) is not None:
                _ring(transaction, what, now)
            elif (preview := self._previews.get(task)) is not None:
                preview.ring(what, now)

    def _answered(self, question: str, value: object, now: float) -> None:
        if (preview := self._previews.get(question.partition("/")[0])) is not None:
            preview.planned(question, value, now)
        elif (reader := self._readers.pop(question, None)) is not None:
            self._reply(reader, _read(reader, value))
        elif (transaction := self.transactions.get(question.partition("/")[0])) is not None:
            transaction.planned(question, value, now)

    def _undelivered(self, message: Message, reason: str, now: float) -> None:
        if (transaction := self.transactions.get(message.header.transaction or "")) is not None:
            transaction.hearing.undelivered(message, reason, now)
        elif (preview := self._previews.get(message.header.transaction or "")) is not None:
            preview.undelivered(message, reason, now)

    # The map

    def _map_moved(self, read: bool, now: float) -> None:
        if not self.replica.ready:
            return
        waiting, self._until_ready = self._until_ready, {}
        for id, message in waiting.items():
            self._effects.append(Wake(f"ready {id}", None))
            self._serve(message, now)
        # A version that goes back belongs to another store: the versions that are awaited will never come.
        begun_anew = read and self.replica.version < self._map_version
        self._map_version = self.replica.version
        due = [then for version, then in self._until_known if begun_anew or version <= self.replica.version]
        self._until_known = [(version, then) for version, then in self._until_known if not begun_anew and version > self.replica.version]
        for then in due:
            then(now)

    def _when_known(self, version: int, then: Callable[[float], None], now: float) -> None:
        if version <= self.replica.version:
            then(now)
        else:
            self._until_known.append((version, then))

    def _busy(self, provider: str) -> list[tuple[float, float]]:
        pursuits = (pursuit for transaction in self._open.values() for pursuit in transaction.pursuits)
        return [time for pursuit in pursuits if pursuit.workflow is not None for time in pursuit.workflow.promised(provider)]

    # Speaking

    def _reply(self, to: Message, body: Body) -> None:
        self._effects.append(Send(reply(to, body, self.address)))

    def _forget(self) -> None:
        """The oldest tasks that are over, beyond so many. Whoever watched them was told."""
        while len(self.transactions) > REMEMBERED and len(self.transactions) > len(self._open):
            oldest = next(id for id in self.transactions if id not in self._open)
            del self.transactions[oldest]
            self._watching.forget(oldest)


def _read(request: Message, found: object) -> Body:
    """What was asked of the records, for the client that asked for it."""
    match found, request.body:
        case clients.Records(), clients.ReadRecords():
            return found
        case clients.Records(records=(record,)), clients.ReadMessages():
            return clients.Messages(messages=record.messages, more=found.rest is not None)
        case clients.Records(), clients.ReadMessages(task=task):
            return frp.Fault(code="env:Sender", text=f"there is no task {task} here")
        case _:
            return frp.Fault(code="env:Receiver", text=f"the records cannot be read: {found}")


def _ring(transaction: Transaction, what: str, now: float) -> None:
    kind, _, participant = what.partition("/")
    match kind:
        case "bids":
            transaction.bids_due(participant, now)
        case "silence":
            transaction.hearing.silent(participant, now)
        case "overdue":
            transaction.hearing.overdue(participant, now)
        case "deadline":
            transaction.give_up(now, f"the deadline of {transaction.task.deadline:g} s is over")
        case "stop":
            transaction.stop_overdue(now)
