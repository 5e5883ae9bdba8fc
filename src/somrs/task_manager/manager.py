"""The Task Manager as a component: it passes clients' requests, answers and protocol messages to the transactions that they concern."""

from __future__ import annotations

from somrs.kernel.admission import check_room
from somrs.kernel.codec import Schema
from somrs.kernel.component import (
    Answered,
    DeliveryFailed,
    Effect,
    Effects,
    ErrorAnswer,
    Input,
    Notified,
    Received,
    Send,
    SetTimer,
    Started,
    TimerFired,
)
from somrs.kernel.service_replica import ServiceUpdate
from somrs.limits import Limits
from somrs.protocol.messages import directory, frp, neighbours, previews, records, reservations, submission, task_news
from somrs.protocol.messages.bodies import REQUESTS, Body, FrpBody
from somrs.protocol.messages.envelope import Message, reply
from somrs.protocol.messages.waits import WaitsForRepository
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.execution.senders import answer_stranger
from somrs.task_manager.migrations import MIGRATIONS
from somrs.task_manager.requests import AssignmentAnswered, ForPlan, ReportAnswered, RequestResult, ReservationAnswered, ServicesKnown
from somrs.task_manager.running_previews import RunningPreviews
from somrs.task_manager.running_tasks import RunningTasks
from somrs.task_manager.state import TaskManagerState, UnsettledReport
from somrs.task_manager.submissions import Submissions, submitted_id
from somrs.task_manager.subscriptions import Replies, TaskSubscriptions
from somrs.task_manager.task_queries import TaskQueries, only_reads
from somrs.task_manager.timers import (
    Answer,
    AnswerDue,
    BidsDue,
    DeadlineDue,
    DiscoveryDue,
    MapDue,
    NewsDue,
    NodeTask,
    OverdueDue,
    PlanWanted,
    PreviewDue,
    Question,
    RecordsWanted,
    RetryDue,
    SilenceDue,
    StartedBefore,
    StopDue,
    Timer,
)
from somrs.task_manager.world_clock import WorldTimePassed

READY_TIME = 30.0
"""Seconds that a task waits for the map after the start. Then its client receives a Fault: the Repository does not answer."""


class TaskManager:
    """Accepts tasks and carries them out, several at once, each as a transaction of its own."""

    def __init__(self, address: str, *, repository: str, registry: str) -> None:
        self._adopt(TaskManagerState.new(address, repository, registry))

    @classmethod
    def restored(cls, state: TaskManagerState) -> TaskManager:
        """Create a Task Manager from its state."""
        manager = cls.__new__(cls)
        manager._adopt(state)
        return manager

    def _adopt(self, state: TaskManagerState) -> None:
        self.state = state
        self.address = state.requests.address
        self._context = TaskManagerContext(
            replica=state.replica,
            requests=state.requests,
            local_reservations=state.local_reservations,
            discovery=state.discovery,
            queues=state.queues,
            quotes=state.quotes,
            pace=state.pace,
            clock=state.clock,
            touched=state.touched,
            commitments=state.commitments,
            still_at_work=state.still_at_work,
            reserved_elsewhere=state.reserved_elsewhere,
            may_ask=state.may_ask,
        )
        self._tasks = RunningTasks(state, self._context)
        self._subscriptions = TaskSubscriptions(state.subscriptions, state.tasks)
        self._queries = TaskQueries(state)
        self._submissions = Submissions(state)
        self._previews = RunningPreviews(state, self._context, self._plan_quoted)

    @property
    def open(self) -> list[str]:
        """The ids of the tasks that have not ended."""
        return [*self.state.running]

    def check_admitted(self, message: Message, bounds: Limits) -> None:
        match message.body:
            case submission.Submit() | submission.SubmitOnce() if submitted_id(message) not in self.state.tasks:
                check_room("tasks", bounds, self.state.running)
            case task_news.WatchTask() | task_news.WatchTasks():
                check_room("subscribers", bounds, self.state.subscriptions.watchers, message.header.message_id)

    def handle(self, event: Input, now: float) -> list[Effect]:
        """Handle an input and return its effects."""
        if isinstance(event, Received) and only_reads(event):
            return [*self._serve(event.message, now)]
        return [*self._effects(event, now)]

    def _effects(self, event: Input, now: float) -> Effects:
        state = self.state
        news = state.replica.handle(event, now)
        if news is not None:
            yield from news.effects
            if state.replica.is_current:
                yield from self._serve_awaiting_map(now)
            yield from self._tasks.map_changed(news, now)
        elif (update := self._follow_registry(event, now)) is not None:
            yield from update.effects
            yield from self._tasks.services_joined(update.joined, now)
        else:
            yield from self._handle(event, now)
        yield from self._answer_discoveries(now)
        yield from self._tasks.admit_waiting(now)
        yield from self._previews.quote_plans(now)
        if state.touched:
            yield from self._replies(self._subscriptions.notify_watchers(state.touched))
        self._tasks.forget_ended()
        self._previews.forget_ended()

    def _handle(self, event: Input, now: float) -> Effects:
        state = self.state
        match event:
            case Started():
                yield from state.discovery.start(self.address, state.requests.registry, now)
                yield from self._start(now)
                self._context.local_reservations = state.local_reservations = None
                yield from state.requests.claim(tuple(state.claims()), now)
            case Notified(StartedBefore()):
                yield from self._start(now)
            case Received(message):
                yield from self._receive(message, now)
            case TimerFired(timer):
                yield from self._timer_fired(timer, now)  # type: ignore[arg-type]  # only its own timers fire
            case Answered(question, value):
                yield from self._answered(question, value, now)
            case Notified(WorldTimePassed() as notice):
                state.clock.adjust(notice, now)
                yield from self._tasks.clock_adjusted(now)
            case DeliveryFailed(message, reason) if message.header.message_id in state.requests.pending:
                yield from self._request_answered((yield from state.requests.delivery_failed(message, reason, now)), now)
                self._tasks.note_overdue(message.header.message_id, now)
            case DeliveryFailed(message, reason):
                yield from self._delivery_failed(message, reason, now)

    def _start(self, now: float) -> Effects:
        state = self.state
        state.requests.start(now)
        state.subscriptions.start(now)
        yield from state.replica.start(now)
        yield from self._tasks.restarted(now)

    # Services

    def _follow_registry(self, event: Input, now: float) -> ServiceUpdate | None:
        return self.state.discovery.handle(event, now) if not self.state.requests.concerns(event) else None

    def _answer_discoveries(self, now: float) -> Effects:
        """Tell tasks and previews the services on offer, as soon as they are known."""
        discovery = self.state.discovery
        if discovery.waiting:
            while (known := discovery.next_answer(self.state.replica.ontology, now)) is not None:
                yield from self._request_answered(known, now)
            yield from discovery.confirm(now)
            yield from discovery.set_timer(now)

    # Messages

    def _receive(self, message: Message, now: float) -> Effects:
        state, body, id = self.state, message.body, message.header.message_id
        if state.requests.is_answer(message):
            yield from self._request_answered((yield from state.requests.answered(message, state.replica.ontology, now)), now)
        elif isinstance(body, FrpBody) and message.header.transaction is not None:
            if message.header.transaction in state.tasks:
                yield from self._tasks.transaction(message.header.transaction).receive(message, now)
            elif message.header.transaction in state.previews:
                yield from self._previews.advance(message.header.transaction, now, lambda preview: preview.receive(message, now))
            else:
                yield from answer_stranger(message, self.address)
        elif not state.replica.is_current and isinstance(body, submission.Submit | submission.SubmitOnce | previews.Preview):
            state.awaiting_map[id] = message
            yield SetTimer(MapDue(id), now + READY_TIME)
        else:
            yield from self._serve(message, now)

    def _serve(self, message: Message, now: float) -> Effects:
        """Handle a client's request."""
        state = self.state
        match message.body:
            case submission.Submit() | submission.SubmitOnce():
                yield from self._start_task((yield from self._submissions.receive(message, now)), now)
            case submission.CancelTask(task=task) | submission.PauseTask(task=task) | task_news.WatchTask(task=task) if (
                task not in state.tasks
            ):
                yield self._reply(message, frp.Fault(code="env:Sender", text=f"there is no task {task} here"))
            case submission.CancelTask(task=task, reason=reason):
                yield from self._tasks.transaction(task).cancel(now, reason)
                yield self._reply(message, submission.Cancelling(task=task))
            case submission.PauseTask(task=task, resume=resumes, author=author):
                transaction = self._tasks.transaction(task)
                yield from (transaction.resume if resumes else transaction.pause)(author or message.header.sender, now)
                yield self._reply(message, submission.TaskPaused(task=task, paused=state.tasks[task].pause is not None))
            case task_news.ReadTasks():
                yield self._queries.read_tasks(message, message.body)
            case task_news.WatchTask() | task_news.WatchTasks():
                yield from self._replies(self._subscriptions.wait(message, message.body, now))
            case task_news.ReadMessages():
                yield self._queries.read_messages(message, message.body)
            case previews.Preview():
                yield from self._previews.begin(message, message.body, now)
            case records.ReadRecords():
                yield self._queries.read_records(message, message.body)
            case directory.ServicesJoined(offers=offers):
                yield from self._tasks.services_joined([offer.service for offer in offers], now)
            case reservations.ReservationFree(task=task) | reservations.ReservationLost(task=task) if task not in state.running:
                yield from state.requests.release_ended(task, now)
            case reservations.ReservationFree(task=task):
                yield from self._tasks.transaction(task).freed(now)
            case reservations.ReservationLost(task=task) as lost:
                yield from self._tasks.transaction(task).lost_reservation(lost, now)
            case neighbours.NeighbourAwaited(task=task, request=request) as awaited:
                if task in state.running and request in state.requests.pending:
                    wait = WaitsForRepository(since=awaited.since, map=awaited.map, objects=awaited.objects)
                    self._tasks.repository_wait(task).begin(request, wait, now)
            case frp.Fault():
                pass  # a Fault is never answered
            case body if type(body) not in REQUESTS and not isinstance(body, FrpBody):
                pass  # a repeated or late answer
            case body:
                fault = frp.Fault(code="wsa:ActionNotSupported", text=f"a Task Manager does not understand {type(body).__name__}")
                yield self._reply(message, fault)

    def _start_task(self, submission: Message | None, now: float) -> Effects:
        if submission is not None:
            yield from self._tasks.transaction(submitted_id(submission)).start(now)
            yield self._submissions.acceptance(submission)

    # Timers and answers

    def _timer_fired(self, timer: Timer, now: float) -> Effects:
        state = self.state
        match timer:
            case NewsDue(request):
                yield from self._replies(self._subscriptions.timer_fired(request))
            case MapDue(request):
                if (waiting := state.awaiting_map.pop(request, None)) is not None and state.replica.ready:
                    yield from self._serve(waiting, now)  # the map as it was is better than none
                elif waiting is not None:
                    repository = state.requests.repository
                    text = f"the map of the environment is not known yet, because {repository} does not answer; try again later"
                    yield self._reply(waiting, frp.Fault(code="env:Receiver", text=text))
            case DiscoveryDue():
                state.discovery.timer_at = None
            case AnswerDue() as timer:
                yield from self._request_answered((yield from state.requests.timer_fired(timer, now)), now)
                self._tasks.note_overdue(timer.request, now)
            case BidsDue() | SilenceDue() | OverdueDue() | DeadlineDue() | RetryDue() | StopDue() if timer.owner in state.tasks:
                yield from self._tasks.transaction(timer.owner).timer_fired(timer, now)
            case BidsDue() | PreviewDue() if timer.owner in state.previews:
                yield from self._previews.advance(timer.owner, now, lambda preview: preview.timer_fired(timer, now))

    def _answered(self, question: object, value: object, now: float) -> Effects:
        state = self.state
        answer: Answer = value if isinstance(value, Answer) else ErrorAnswer(str(value) or type(value).__name__)
        match question:
            case PlanWanted(owner=owner) if owner in state.tasks:
                yield from self._tasks.transaction(owner).planned(question, answer, now)
            case PlanWanted(owner=owner) if owner in state.previews:
                yield from self._previews.advance(owner, now, lambda preview: preview.planned(question, answer, now))
            case RecordsWanted(request):
                yield from self._queries.records_read(request, answer)

    def _delivery_failed(self, message: Message, reason: str, now: float) -> Effects:
        transaction = message.header.transaction or ""
        if transaction in self.state.tasks:
            yield from self._tasks.transaction(transaction).delivery_failed(message, reason, now)
        elif transaction in self.state.previews:
            yield from self._previews.advance(transaction, now, lambda preview: preview.delivery_failed(message, reason, now))

    def _request_answered(self, result: RequestResult | None, now: float) -> Effects:
        """Handle the result of a request to the Repository or the Registry."""
        state = self.state
        if result is not None and result.purpose.owner in state.running:
            self._tasks.repository_wait(result.purpose.owner).end(now)
        match result:
            case ServicesKnown(purpose, offers) if purpose.owner in state.tasks:
                yield from self._tasks.transaction(purpose.owner).discovered(purpose, offers, now)
            case ServicesKnown(ForPlan(owner=owner), offers) if owner in state.previews:
                yield from self._previews.advance(owner, now, lambda preview: preview.discovered(offers, now))
            case ReportAnswered(purpose, answer) if purpose.owner in state.tasks:
                unsettled = yield from self._tasks.transaction(purpose.owner).report_answered(answer, now)
                if unsettled is not None:
                    version, reported = unsettled
                    state.unsettled.append(UnsettledReport.of(version, purpose.owner, reported))
            case AssignmentAnswered(purpose, assigned):
                yield from self._start_task((yield from self._submissions.assigned(purpose.owner, assigned, now)), now)
            case ReservationAnswered(purpose, answer) if purpose.owner in state.running:
                yield from self._tasks.transaction(purpose.owner).reserved(purpose, answer, now)
            case ReservationAnswered() as answered if answered.purpose.owner in state.previews:
                yield from self._previews.advance(answered.purpose.owner, now, lambda preview: preview.reserved(answered, now))
            case ReservationAnswered(purpose):
                yield from state.requests.release_ended(purpose.owner, now)  # the request came after the release of the task that had ended

    def _serve_awaiting_map(self, now: float) -> Effects:
        """Handle the requests that waited for the map."""
        waiting, self.state.awaiting_map = self.state.awaiting_map, {}
        for id, message in waiting.items():
            yield SetTimer(MapDue(id), None)
            yield from self._serve(message, now)

    def _plan_quoted(self, task: str, preview: str, answer: previews.Previewed, now: float) -> Effects:
        yield from self._tasks.transaction(task).plan_quoted(preview, answer, now)

    # Replies

    def _reply(self, request: Message, body: Body) -> Send:
        return Send(reply(request, body, self.address))

    def _replies(self, replies: Replies) -> Effects:
        for effect in replies:
            if isinstance(effect, tuple):
                yield self._reply(*effect)
            else:
                yield effect


SCHEMA = Schema(
    component="task-manager",
    version=3,
    state=TaskManagerState,
    timers=Timer,
    questions=Question,
    tasks=NodeTask,
    answers=Answer,
    notices=WorldTimePassed | StartedBefore,
    restore=TaskManager.restored,
    is_read_only=only_reads,
    migrations=MIGRATIONS,
)
"""The types in the journal of a Task Manager."""
