"""The Task Manager as a component: clients' requests, answers and protocol messages go to the transaction they concern."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from somrs.errors import FormulaError
from somrs.planner.plan import NoPlan, Plan, Step
from somrs.protocol import clients, frp
from somrs.protocol.bodies import Body, FrpBody
from somrs.protocol.clients import Phase, StepView, TaskView
from somrs.protocol.component import Answered, Ask, Effect, Input, Rang, Received, Send, Started, Undelivered, Wake
from somrs.protocol.directory import Discover, Discovered, Offer
from somrs.protocol.envelope import Header, Message, message_id, reply
from somrs.protocol.replica import Replica
from somrs.task_manager.setting import Setting, problem, wrong_with
from somrs.task_manager.transaction import Transaction
from somrs.task_manager.workflow import STEP_STATE, Progress, StepRun

Then = Callable[[Message, float], None]


@dataclass(slots=True, kw_only=True)
class _Watcher:
    """A client that waits for news of a task."""

    request: Message
    task: str
    after: int


class TaskManager:
    """Takes tasks and sees them through. Several at once, each a transaction of its own."""

    def __init__(self, address: str, *, repository: str, registry: str) -> None:
        self.address = address
        self.replica = Replica(address, repository)
        self.transactions: dict[str, Transaction] = {}
        self._effects: list[Effect] = []
        self._incarnation = 0.0
        self._asked = 0
        self._awaited: dict[str, Then] = {}
        self._until_known: list[tuple[int, Callable[[float], None]]] = []
        self._until_ready: list[Message] = []
        self._watchers: list[_Watcher] = []
        self._previews: dict[str, Message] = {}
        self._setting = Setting(
            address=address,
            repository=repository,
            registry=registry,
            replica=self.replica,
            request=self._request,
            when_known=self._when_known,
            busy=self._busy,
        )

    def handle(self, event: Input, now: float) -> list[Effect]:
        news = self.replica.handle(event, now)
        if news is not None:
            self._effects += news.effects
            self._map_moved(now)
        match event:
            case _ if news is not None:
                pass
            case Started():
                self._incarnation = now
                self._effects += self.replica.start(now)
            case Received(message):
                self._receive(message, now)
            case Rang(timer):
                self._ring(timer, now)
            case Answered(question, value):
                self._planned(question, value, now)
            case Undelivered(message, reason):
                self._undelivered(message, reason, now)
        for transaction in self.transactions.values():
            self._effects += transaction.effects
            transaction.effects = []
        self._tell_watchers(now)
        effects, self._effects = self._effects, []
        return effects

    # Messages

    def _receive(self, message: Message, now: float) -> None:
        body = message.body
        if (then := self._awaited.pop(message.header.relates_to or "", None)) is not None:
            then(message, now)
        elif isinstance(body, FrpBody) and message.header.transaction is not None:
            if (transaction := self.transactions.get(message.header.transaction)) is not None:
                transaction.receive(message, now)
        elif not self.replica.ready and isinstance(body, clients.Submit | clients.Preview):
            self._until_ready.append(message)
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
            case clients.ReadTasks(limit=limit):
                newest = sorted(self.transactions.values(), key=lambda t: t.submitted_at, reverse=True)
                self._reply(message, clients.Tasks(tasks=tuple(view(transaction) for transaction in newest[:limit])))
            case clients.WatchTask(task=task, after=after, wait=wait):
                if self._known(message, task) is not None:
                    self._watchers.append(_Watcher(request=message, task=task, after=after))
                    self._effects.append(Wake(f"watch {message.header.message_id}", now + wait))
            case clients.Preview():
                self._preview(message, message.body)
            case frp.Fault():
                pass  # a Fault is never answered
            case body:
                self._reply(message, frp.Fault(code="wsa:ActionNotSupported", text=f"a Task Manager does not take {type(body).__name__}"))

    def _submit(self, message: Message, task: clients.Submit, now: float) -> None:
        id = message_id("task", message.header.message_id)
        if id not in self.transactions:
            if (wrong := wrong_with(task, self.replica)) is not None:
                self._reply(message, clients.TaskRejected(problem=wrong))
                return
            transaction = Transaction(id, task, self._setting, now)
            self.transactions[id] = transaction
            transaction.start(now)
        self._reply(message, clients.Submitted(task=id))

    def _preview(self, message: Message, task: clients.Preview) -> None:
        submit = clients.Submit(effect=task.effect, precondition=task.precondition)
        offers: list[Offer] = []

        def discovered(answer: Message, now: float) -> None:
            if not isinstance(answer.body, Discovered):
                self._reply(message, clients.Previewed(steps=(), explanation=f"the Service Registry answered {type(answer.body).__name__}"))
                return
            offers.extend(answer.body.offers)
            if answer.body.more:
                self._effects.append(self._request(self._setting.registry, Discover(after=offers[-1].service), discovered))
                return
            question = f"preview {message.header.message_id}"
            self._previews[question] = message
            self._effects.append(Ask(question, problem(submit, self.replica, offers)))

        if (wrong := wrong_with(submit, self.replica)) is not None:
            self._reply(message, clients.Previewed(steps=(), explanation=wrong))
        else:
            self._effects.append(self._request(self._setting.registry, Discover(), discovered))

    def _known(self, message: Message, task: str) -> Transaction | None:
        transaction = self.transactions.get(task)
        if transaction is None:
            self._reply(message, frp.Fault(code="env:Sender", text=f"there is no task {task} here"))
        return transaction

    # What the node answers

    def _ring(self, timer: str, now: float) -> None:
        if timer.startswith("watch "):
            id = timer.removeprefix("watch ")
            for watcher in [w for w in self._watchers if w.request.header.message_id == id]:
                self._tell(watcher)
        else:
            id, what, *rest = timer.split("/")
            if (transaction := self.transactions.get(id)) is not None:
                _ring(transaction, what, rest, now)

    def _planned(self, question: str, value: object, now: float) -> None:
        if (asked := self._previews.pop(question, None)) is not None:
            self._reply(asked, previewed(value))
            return
        id, _, attempt = question.split("/")
        transaction = self.transactions.get(id)
        if transaction is not None and transaction.phase is Phase.PLANNING and attempt == str(transaction.replans):
            transaction.planned(value, now)

    def _undelivered(self, message: Message, reason: str, now: float) -> None:
        if (then := self._awaited.pop(message.header.message_id, None)) is not None:
            fault = frp.Fault(code="env:Receiver", text=f"{message.header.recipient} could not be reached: {reason}")
            then(Message(header=message.header, body=fault), now)
        elif (transaction := self.transactions.get(message.header.transaction or "")) is not None:
            transaction.undelivered(message, reason, now)

    # The map

    def _map_moved(self, now: float) -> None:
        if not self.replica.ready:
            return
        waiting, self._until_ready = self._until_ready, []
        for message in waiting:
            self._serve(message, now)
        due = [then for version, then in self._until_known if version <= self.replica.version]
        self._until_known = [(version, then) for version, then in self._until_known if version > self.replica.version]
        for then in due:
            then(now)

    def _when_known(self, version: int, then: Callable[[float], None], now: float) -> None:
        if version <= self.replica.version:
            then(now)
        else:
            self._until_known.append((version, then))

    def _busy(self, provider: str) -> list[tuple[float, float]]:
        return [
            (run.start, run.finish)
            for transaction in self.transactions.values()
            if transaction.workflow is not None and transaction.phase is not Phase.ENDED
            for run in transaction.workflow
            if run.progress in (Progress.ARRANGED, Progress.EXECUTING) and transaction.members[run.member or ""].offer.provider == provider
        ]

    # Speaking

    def _request(self, recipient: str, body: object, then: Then) -> Effect:
        self._asked += 1
        id = message_id(self.address, self._incarnation, self._asked)
        self._awaited[id] = then
        header = Header(sender=self.address, recipient=recipient, message_id=id, reply_to=self.address)
        return Send(Message(header=header, body=body))  # type: ignore[arg-type]  # the signature in Setting is of plain objects

    def _reply(self, to: Message, body: Body) -> None:
        self._effects.append(Send(reply(to, body, self.address)))

    def _tell_watchers(self, now: float) -> None:
        for watcher in [w for w in self._watchers if len(self.transactions[w.task].events) > w.after or self._ended(w.task)]:
            self._effects.append(Wake(f"watch {watcher.request.header.message_id}", None))
            self._tell(watcher)

    def _ended(self, task: str) -> bool:
        return self.transactions[task].phase is Phase.ENDED

    def _tell(self, watcher: _Watcher) -> None:
        self._watchers.remove(watcher)
        transaction = self.transactions[watcher.task]
        self._reply(watcher.request, clients.TaskNews(view=view(transaction), events=tuple(transaction.events[watcher.after :])))


def _ring(transaction: Transaction, what: str, rest: list[str], now: float) -> None:
    match what:
        case "bids":
            transaction.bids_due(rest[0], int(rest[1]), now)
        case "silence":
            transaction.silent("/".join(rest), now)
        case "deadline":
            transaction.give_up(now, f"the deadline of {transaction.task.deadline:g} s is over")
        case "stop":
            transaction.stop_overdue(now)


def view(transaction: Transaction) -> TaskView:
    """A transaction as clients see it."""
    workflow = transaction.workflow
    return TaskView(
        task=transaction.id,
        effect=transaction.task.effect,
        phase=transaction.phase,
        submitted_at=transaction.submitted_at,
        outcome=transaction.outcome,
        ended_at=transaction.ended_at,
        explanation=transaction.explanation,
        steps=tuple(_run_view(transaction, run) for run in workflow) if workflow is not None else (),
    )


def _run_view(transaction: Transaction, run: StepRun) -> StepView:
    assert transaction.workflow is not None
    member = transaction.members.get(run.member or "")
    return step_view(
        run.step,
        transaction.workflow.plan,
        state=STEP_STATE[run.progress],
        service=member.offer.service if member else None,
        price=member.bid.terms.price if member and member.bid else None,
        duration=member.bid.terms.duration if member and member.bid else None,
        fraction=member.fraction if member else 0.0,
    )


def step_view(
    step: Step,
    plan: Plan,
    *,
    state: frp.State = frp.State.NEW,
    service: str | None = None,
    price: float | None = None,
    duration: float | None = None,
    fraction: float = 0.0,
) -> StepView:
    """A step of a plan as clients see it."""
    links = [link for link in plan.links if link.after == step.id]
    return StepView(
        step=step.id,
        service_type=step.service_type,
        inputs={name: str(term) for name, term in step.inputs.items()},
        after=tuple(dict.fromkeys(link.before for link in links)),
        because=tuple(link.fact for link in links),
        state=state,
        service=service,
        price=price,
        duration=duration,
        fraction=fraction,
    )


def previewed(found: object) -> clients.Previewed:
    """What the planner found, for a client that wanted to see only."""
    match found:
        case Plan():
            steps: Iterable[StepView] = (step_view(step, found) for step in found.topological())
            return clients.Previewed(steps=tuple(steps), explanation="" if found.steps else "nothing to do: it is so already")
        case NoPlan():
            return clients.Previewed(steps=(), explanation=found.explanation)
        case FormulaError():
            return clients.Previewed(steps=(), explanation=str(found))
        case _:
            return clients.Previewed(steps=(), explanation=f"planning failed: {found}")
