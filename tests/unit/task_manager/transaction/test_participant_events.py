"""What comes of what the participants of a task say: news for the client, a report for the map, and what becomes of the work."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from msgspec import structs

from somrs.entish.parse import parse
from somrs.kernel.component import Answered, Ask, DeliveryFailed, Effect, Input, Received, Send, SetTimer, TimerFired
from somrs.kernel.offers import Offers
from somrs.kernel.reservations import Claimant, Reservation
from somrs.ontology.effects import changes
from somrs.ontology.files.loading import load_text
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan
from somrs.protocol.messages import events, frp, submission, task_views
from somrs.protocol.messages.bodies import Body, FrpBody
from somrs.protocol.messages.directory import Offer, ServicesSubscribed, SubscribeServices
from somrs.protocol.messages.envelope import Header, Message, reply
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.protocol.messages.observations import Observation
from somrs.protocol.messages.reservations import ClaimReservations, Release, ReservationMode, Reserve
from somrs.repository.reserving import Reserving
from somrs.repository.state import Contents
from somrs.task_manager.execution.member import Member
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.timers import DeadlineDue, OverdueDue, SilenceDue, StopDue, Timer
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.views import view
from tests.support.virtual_system import SITE

GOAL, INITIAL_SITUATION = "Jar002 isOn Platform001", "Jar002 isOn Cupboard001"
FIRST_SERVICE, SECOND_SERVICE = "Robot1.TransferObject", "Robot2.TransferObject"


class TaskManagerHarness:
    """A Task Manager that knows the map and the services on offer, and whose Repository and planner answer at once; services say what the
    test has them say."""

    def __init__(
        self, *robots: str, rejects: tuple[str, ...] = (), plan_results: Iterable[object] = (), held: bool = False, **options: object
    ) -> None:
        loaded = load_text(SITE, "site.yaml")
        assert loaded.map is not None
        self.manager = TaskManager("tm", repository="repository", registry="registry")
        self.replica = self.manager.state.replica
        self.replica.ontology, self.replica.map, self.replica.version = loaded.ontology, loaded.map, 0
        transfer = loaded.ontology.services["TransferObject"]
        assert self.manager.state.discovery.directory is not None
        self.directory = self.manager.state.discovery.directory
        self.directory.version = 0
        self.offers = tuple(
            Offer(service=f"{name}.TransferObject", provider=name, provider_type="PioneerP3DX", address=name, service_type=transfer)
            for name in robots or ("Robot1",)
        )
        self.answers_version = True
        """Whether the Registry answers which version it has."""
        self.rejects = rejects
        self.held = held
        """Whether the planner's answers wait until the test gives them."""
        self.plan_results = [*plan_results]
        """What the planner answers next, in place of what it would find."""
        self.reports: list[UpdateMap] = []
        """Without the reservations under which they were made."""
        self.contents = Contents(ontology=loaded.ontology, map=loaded.map, address="repository")
        self.reserving, self.reservations = Reserving(self.contents), self.contents.reservations
        self.message_count = 0
        self.client_says(submission.Submit(**{"effect": GOAL, **options}), 0.0)  # type: ignore[arg-type]  # fields of Submit

    @property
    def offers(self) -> tuple[Offer, ...]:
        """What the Registry lists."""
        return tuple(self.directory.offers)

    @offers.setter
    def offers(self, offers: Iterable[Offer]) -> None:
        self.directory.offers = Offers(offers)

    @property
    def task(self) -> TaskState:
        (task,) = self.manager.state.tasks.values()
        return task

    def feed(self, event: Input, now: float) -> list[Effect]:
        """All that comes of it, once everybody has answered, except what is said about reservations."""
        effects = self.manager.handle(event, now)
        for effect in [*effects]:
            match effect:
                case Send(Message(body=Reserve() as request) as message):
                    effects.remove(effect)
                    answer, _ = self.reserving.reserve(request, "tm", now)
                    effects += self.feed(Received(reply(message, answer, "repository")), now)
                case Send(Message(body=Release() as release)):
                    effects.remove(effect)
                    self.reserving.release(release, "tm", now)
                case Send(Message(body=ClaimReservations())):
                    effects.remove(effect)
                case Ask(question, Problem() as problem) if not self.held:
                    effects += self.feed(Answered(question, self.plan_results.pop(0) if self.plan_results else plan(problem)), now)
                case Send(Message(body=SubscribeServices()) as message) if self.answers_version:
                    effects.remove(effect)
                    body = ServicesSubscribed(until=now + 60.0, version=self.directory.version)
                    effects += self.feed(Received(reply(message, body, "registry")), now)
                case Send(Message(body=UpdateMap() as update) as message):
                    effects += self.feed(Received(reply(message, self._update(update), "repository")), now)
        return effects + self.admit(now)

    def admit(self, now: float) -> list[Effect]:
        """What comes of it that tasks which waited are told that their objects are free."""
        notices = [effect.message for effect in self.reserving.admit(now) if isinstance(effect, Send)]
        return [effect for notice in notices if notice.header.recipient == "tm" for effect in self.feed(Received(notice), now)]

    def reserve_elsewhere(self, *objects: str, task: str = "other", goal: str = "") -> None:
        """A task of another Task Manager has these objects."""
        claimant = Claimant(holder="another-tm", goal=goal, priority=0, arrival=0)
        self.reservations.reserve(task, claimant, Reservation(changes=frozenset(objects)), ReservationMode.UNDO, 0.0)

    def take_away(self, *objects: str, goal: str = "") -> None:
        """The task has had to release what it had, and a task of another Task Manager has these objects now."""
        self.task.reservation.clear()
        self.reservations.release(self.task.id)
        self.reserve_elsewhere(*objects, goal=goal)

    def has_reserved(self) -> Reservation:
        """What the task has."""
        assert self.task.reservation.held == self.reservations.claimants[self.task.id].held
        return self.task.reservation.held

    def _update(self, update: UpdateMap) -> Body:
        self.reports.append(structs.replace(update, reservation=None))
        if self.rejects:
            return Rejected(problems=self.rejects)
        situation = update.situation
        map_changes = changes(parse(situation), self.replica.map, self.replica.ontology) if situation is not None else update.changes
        self.replica.map = self.replica.map.changed(map_changes)
        self.replica.version += 1
        return Updated(version=self.replica.version)

    def client_says(self, body: Body, now: float) -> list[Effect]:
        self.message_count += 1
        header = Header(sender="client", recipient="tm", message_id=f"client {self.message_count}", reply_to="client")
        return self.feed(Received(Message(header=header, body=body)), now)

    def member(self, service: str = FIRST_SERVICE) -> Member:
        """The one of that service that was asked last."""
        return [member for member in self.task.members if member.offer.service == service][-1]

    def message(
        self, body: FrpBody, service: str = FIRST_SERVICE, sender: Member | None = None, request_kind: str | None = None
    ) -> Message:
        """What one of them would say; `request_kind`: the kind of message that it answers."""
        self.message_count += 1
        member = sender or self.member(service)
        header = Header(
            sender=member.offer.address,
            recipient="tm",
            message_id=f"said {self.message_count}",
            reply_to=member.offer.address,
            relates_to=member.session.sent_messages[request_kind].id if request_kind is not None else None,
            transaction=self.task.id,
            participant=member.id,
        )
        return Message(header=header, body=body)

    def service_says(
        self, body: FrpBody, now: float, service: str = FIRST_SERVICE, sender: Member | None = None, request_kind: str | None = None
    ) -> list[Effect]:
        return self.feed(Received(self.message(body, service, sender, request_kind)), now)

    def rings(self, timer: Timer, now: float) -> list[Effect]:
        return self.feed(TimerFired(timer), now)

    def offer(self, now: float = 1.0, service: str = FIRST_SERVICE, price: float = 10.0) -> list[Effect]:
        return self.service_says(frp.Terms(effect=GOAL, price=price, duration=60.0), now, service)

    def executing(self) -> list[Effect]:
        """All who were asked have given terms, and the first is at work; what it was told comes back."""
        effects: list[Effect] = []
        for number, offer in enumerate(self.offers):
            effects += self.offer(1.0 + number, offer.service, 10.0 + number)
        assert self.member().state is State.EXECUTING
        return effects

    def news(self, event_count: int) -> list[tuple[Event, str | None, GoalKind | None]]:
        return [(noted.event, noted.step, noted.goal) for noted in self.task.events[event_count:]]


def bodies(effects: list[Effect]) -> list[str]:
    return [type(effect.message.body).__name__ for effect in effects if isinstance(effect, Send)]


STEP = ("step1", GoalKind.TASK)


def test_a_task_from_its_statement_to_its_end() -> None:
    harness = TaskManagerHarness(deadline=500.0)
    harness.executing()
    effects = harness.service_says(frp.Completed(situation=GOAL), 61.0)
    assert harness.news(0) == [
        (events.TaskStated(effect=GOAL), None, None),
        (events.Planned(steps=1), None, None),
        (events.ServicesAsked(services=(FIRST_SERVICE,)), *STEP),
        (events.TermsOffered(service=FIRST_SERVICE, price=10.0, currency="EUR", duration=60.0), *STEP),
        (events.ServiceChosen(service=FIRST_SERVICE, price=10.0, currency="EUR", duration=60.0), *STEP),
        (events.StepStarted(service=FIRST_SERVICE), *STEP),
        (events.StepCompleted(service=FIRST_SERVICE, situation=GOAL), *STEP),
        (events.TaskEnded(outcome=Outcome.ACCOMPLISHED, reasons=()), None, None),
    ]
    assert harness.reports == [UpdateMap(situation=GOAL, author=FIRST_SERVICE)]
    assert bodies(effects) == ["UpdateMap", "End"]
    task_view = view(harness.task)
    (step,), (work,) = task_view.steps, task_view.work
    assert (step.state, step.service, step.price, step.duration, step.fraction) == (State.COMPLETED, FIRST_SERVICE, 10.0, 60.0, 1.0)
    assert (work.state, work.result, work.began, work.ended, work.situation) == (State.COMPLETED, State.COMPLETED, 1.0, 61.0, GOAL)
    assert (work.note, work.before, task_view.outcome, task_view.ended_at) == ("", INITIAL_SITUATION, Outcome.ACCOMPLISHED, 61.0)
    assert {effect.timer: effect.at for effect in effects if isinstance(effect, SetTimer) and not isinstance(effect.timer, SilenceDue)}[
        DeadlineDue(harness.task.id)
    ] is None
    assert (harness.manager.open, harness.task.messages, harness.task.message_count, harness.task.setbacks) == ([], [], 6, 0)


def test_who_refuses_is_not_asked_again_and_the_next_is_taken() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.offer(1.0, SECOND_SERVICE)
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Refuse(reason="too heavy"), 2.0)
    assert harness.news(event_count)[0] == (events.ServiceRefused(service=FIRST_SERVICE, reason="too heavy"), *STEP)
    assert bodies(effects) == ["Accept", "Execute"]
    assert harness.member().exit_reason == "too heavy"
    assert [run.excluded for run in harness.task.goal] == [{FIRST_SERVICE: "too heavy"}]


def test_who_could_not_be_reached_is_out() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.offer(1.0, SECOND_SERVICE)
    (arrange_message,) = [entry.message for entry in harness.task.messages if entry.message.header.participant == harness.member().id]
    effects = harness.feed(DeliveryFailed(arrange_message, "no route"), 2.0)
    assert bodies(effects) == ["Cancel", "Accept", "Execute"]
    assert [run.excluded for run in harness.task.goal] == [{FIRST_SERVICE: "could not be reached: no route"}]


def test_what_was_not_begun_leaves_nothing_to_undo() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.executing()
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Failed(description="too late", tried=False), 5.0)
    assert harness.news(event_count)[0] == (events.NotBegun(service=FIRST_SERVICE, description="too late"), *STEP)
    assert (harness.task.log.works, harness.reports) == ([], [])
    assert bodies(effects)[-1] == "Arrange"
    assert harness.member().exit_reason == "too late"


@pytest.mark.parametrize(
    ("body", "event", "state", "note"),
    [
        (
            frp.Failed(description="stuck", situation=INITIAL_SITUATION),
            events.StepFailed(service=FIRST_SERVICE, description="stuck", situation=INITIAL_SITUATION),
            State.FAILED,
            "failed: stuck",
        ),
        (frp.Stopped(situation=INITIAL_SITUATION), events.StepStopped(service=FIRST_SERVICE), State.STOPPED, "stopped"),
    ],
)
def test_what_a_failure_left_is_on_the_map_before_another_is_asked(body: FrpBody, event: Event, state: State, note: str) -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.executing()
    event_count = len(harness.task.events)
    effects = harness.service_says(body, 5.0)
    assert [logged_event for logged_event, *_ in harness.news(event_count)] == [
        event,
        events.ServiceReplaced(),
        events.ServicesAsked(services=(SECOND_SERVICE,)),
    ]
    assert harness.reports == [UpdateMap(situation=INITIAL_SITUATION, author=FIRST_SERVICE)]
    assert bodies(effects) == ["UpdateMap", "Arrange"]
    (work,) = harness.task.log.works
    assert (work.state, work.result, work.ended, work.situation, work.note) == (state, state, 5.0, INITIAL_SITUATION, note)
    (run,) = harness.task.goal
    assert (run.excluded, str(run.reported), harness.task.services.broken) == (
        {FIRST_SERVICE: note},
        INITIAL_SITUATION,
        {FIRST_SERVICE: note},
    )
    assert harness.task.services.failures == {FIRST_SERVICE: 1}
    assert harness.task.look_queue.unseen == []


def test_who_was_stopped_before_it_began_has_left_nothing_to_observe() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.executing()
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Stopped(tried=False), 5.0)
    assert [event for event, *_ in harness.news(event_count)] == [
        events.NotBegun(service=FIRST_SERVICE, description="it was stopped first"),
        events.ServicesAsked(services=(SECOND_SERVICE,)),
    ]
    assert bodies(effects) == ["Arrange"]
    assert (harness.reports, harness.task.log.works, harness.task.services.failures) == ([], [], {})


def test_a_failure_of_which_nothing_is_known_is_looked_at() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.executing()
    event_count = len(harness.task.events)
    harness.service_says(frp.Failed(description="stuck"), 5.0)
    assert [type(event).__name__ for event, *_ in harness.news(event_count)][:2] == ["StepFailed", "NobodyLooks"]
    (report,) = harness.reports
    assert (report.author, report.situation) == ("nobody could look", None)


def test_what_a_lost_participant_reported_before_does_not_hold_for_sure() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    ordered = harness.member().last_order_time
    held = "Jar002 isHeldBy Robot1"
    for told, counts in ((ordered - 9.0, ordered), (ordered + 2.0, ordered + 2.0), (ordered + 1.0, ordered + 1.0)):
        harness.service_says(frp.Progress(fraction=0.4, situation=held, observation=Observation(as_of=told)), ordered + 3.0)
        assert harness.reports[-1].observation == Observation(as_of=counts, caused=True)
    harness.service_says(frp.Failed(description="stuck"), ordered + 4.0)
    assert (harness.reports[-1].author, harness.reports[-1].observation) == ("nobody could look", Observation(as_of=ordered + 2.0))


def test_what_a_lost_participant_reported_without_a_time_does_not_hold_for_sure() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    ordered = harness.member().last_order_time
    harness.service_says(frp.Progress(fraction=0.4, situation="Jar002 isHeldBy Robot1"), ordered + 3.0)
    harness.service_says(frp.Failed(description="stuck"), ordered + 4.0)
    assert (harness.reports[-1].author, harness.reports[-1].observation) == ("nobody could look", Observation(as_of=ordered + 3.0))


def test_progress_is_told_when_it_is_news_and_put_on_the_map_when_it_changed_something() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    event_count = len(harness.task.events)
    held = "Jar002 isHeldBy Robot1"
    for body in (
        frp.Progress(fraction=0.1),
        frp.Progress(fraction=0.2, note="drives"),
        frp.Progress(fraction=0.3, note="drives"),
        frp.Progress(fraction=0.4, note="carries", situation=held),
        frp.Progress(fraction=0.5),
    ):
        harness.service_says(body, 5.0)
        assert harness.member().fraction == body.fraction
    assert harness.news(event_count) == [
        (events.ProgressNoted(service=FIRST_SERVICE, note="drives"), *STEP),
        (events.ProgressNoted(service=FIRST_SERVICE, note="carries"), *STEP),
    ]
    assert harness.reports == [UpdateMap(situation=held, author=FIRST_SERVICE)]
    (work,) = harness.task.log.works
    assert (work.situation, work.state, harness.member().note) == (held, State.EXECUTING, "carries")


def test_a_report_that_is_rejected_counts_as_a_failure() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2", rejects=("there is no such place",))
    harness.executing()
    event_count = len(harness.task.events)
    harness.service_says(frp.Completed(situation=GOAL), 61.0)
    assert harness.news(event_count)[:2] == [
        (events.StepCompleted(service=FIRST_SERVICE, situation=GOAL), *STEP),
        (events.ReportRejected(service=FIRST_SERVICE, problems=("there is no such place",)), *STEP),
    ]
    reason = "reported an impossible situation: there is no such place"
    (work,) = harness.task.log.works
    assert (work.state, work.result, work.note) == (State.FAILED, State.FAILED, reason)
    assert harness.task.services.broken == {FIRST_SERVICE: reason}


def test_one_that_falls_silent_is_lost_and_nothing_is_known_of_what_it_left() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2", waits=False)
    harness.executing()
    member = harness.member()
    harness.replica.version = 4
    event_count = len(harness.task.events)
    harness.rings(SilenceDue(harness.task.id, member.id), 41.0)
    harness.rings(SilenceDue(harness.task.id, member.id), 81.0)
    logged_events = [event for event, *_ in harness.news(event_count)]
    assert logged_events[:2] == [events.ServiceSilent(service=FIRST_SERVICE), events.ServiceLost(service=FIRST_SERVICE, silent=True)]
    (work,) = harness.task.log.works
    assert (work.state, work.result, work.ended) == (State.STRANDED, State.UNREACHABLE, 81.0)
    assert work.note == harness.task.services.broken[FIRST_SERVICE] == "fell silent while it worked"
    assert harness.task.services.failures == {}
    assert harness.reports[0].expected_version == 4


def test_a_participant_that_was_given_up_and_returns_reports_once() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.executing()
    harness.answers_version = False
    for now in (41.0, 81.0):
        harness.rings(SilenceDue(harness.task.id, harness.member().id), now)
    assert harness.member().state is State.UNREACHABLE
    for now in (90.0, 91.0):
        harness.service_says(frp.Completed(situation=INITIAL_SITUATION), now)
    assert [report.situation for report in harness.reports] == [INITIAL_SITUATION]


@pytest.mark.parametrize(
    "late",
    [
        frp.Completed(situation=INITIAL_SITUATION),
        frp.Failed(description="", situation=INITIAL_SITUATION),
        frp.Stopped(situation=INITIAL_SITUATION),
    ],
)
def test_the_report_of_one_that_was_given_up_is_put_on_the_map_after_the_end(late: FrpBody) -> None:
    harness = TaskManagerHarness()
    harness.executing()
    member = harness.member()
    harness.client_says(submission.CancelTask(task=harness.task.id), 10.0)
    harness.rings(StopDue(harness.task.id), 70.0)
    assert harness.task.outcome is Outcome.CANCELLED
    assert [*harness.task.members] == [member]
    lost_at, report_count = member.lost_version, len(harness.reports)
    for _ in range(2):
        harness.service_says(late, 80.0)
    assert harness.reports[report_count:] == [UpdateMap(situation=INITIAL_SITUATION, author=FIRST_SERVICE, expected_version=lost_at)]


def test_one_that_takes_far_too_long_is_stopped_and_then_lost() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.executing()
    timer = OverdueDue(harness.task.id, harness.member().id)
    event_count = len(harness.task.events)
    assert bodies(harness.rings(timer, 700.0)) == ["Stop"]
    harness.rings(timer, 760.0)
    assert [event for event, *_ in harness.news(event_count)][:2] == [
        events.ServiceOverdue(service=FIRST_SERVICE),
        events.ServiceLost(service=FIRST_SERVICE),
    ]


# Ending


@pytest.mark.parametrize(("reason", "expected_reason"), [("no more", "no more"), ("", "cancelled by the client")])
def test_a_task_that_is_cancelled_stops_everybody_and_undoes_what_was_done(reason: str, expected_reason: str) -> None:
    harness = TaskManagerHarness(deadline=500.0)
    harness.executing()
    event_count = len(harness.task.events)
    effects = harness.client_says(submission.CancelTask(task=harness.task.id, reason=reason), 10.0)
    assert bodies(effects) == ["Stop", "Cancelling"]
    wakes = {effect.timer: effect.at for effect in effects if isinstance(effect, SetTimer)}
    assert (wakes[DeadlineDue(harness.task.id)], wakes[StopDue(harness.task.id)]) == (None, 70.0)
    assert (harness.task.phase, harness.task.ending, harness.task.reasons) == (
        task_views.Phase.RECOVERING,
        Outcome.CANCELLED,
        (expected_reason,),
    )
    harness.client_says(submission.CancelTask(task=harness.task.id, reason="once more"), 11.0)
    effects = harness.service_says(frp.Stopped(situation=INITIAL_SITUATION), 12.0)
    assert [event for event, *_ in harness.news(event_count)] == [
        events.Stopping(reason=expected_reason),
        events.StepStopped(service=FIRST_SERVICE),
        events.WorkUndone(),
        events.TaskEnded(
            outcome=Outcome.CANCELLED, reasons=(expected_reason, f"TransferObject by {FIRST_SERVICE} changed nothing: {INITIAL_SITUATION}")
        ),
    ]
    assert bodies(effects) == ["UpdateMap", "End"]
    assert [effect.timer for effect in effects if isinstance(effect, SetTimer)].count(StopDue(harness.task.id)) == 2
    assert harness.task.services.broken == {}, "it was called off, and did not fail"
    assert (harness.task.outcome, harness.task.ended_at) == (Outcome.CANCELLED, 12.0)


def test_a_task_whose_deadline_is_over_has_failed() -> None:
    harness = TaskManagerHarness(deadline=500.0)
    effects = harness.rings(DeadlineDue(harness.task.id), 500.0)
    assert bodies(effects) == ["Cancel"]
    assert harness.task.outcome is Outcome.FAILED
    assert harness.task.reasons == ("the deadline of 500 s is over",)
    assert [event for event, *_ in harness.news(-1)] == [events.TaskEnded(outcome=Outcome.FAILED, reasons=harness.task.reasons)]


def test_one_that_does_not_say_that_it_stopped_is_given_up() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    harness.client_says(submission.CancelTask(task=harness.task.id), 10.0)
    event_count = len(harness.task.events)
    effects = harness.rings(StopDue(harness.task.id), 70.0)
    assert harness.news(event_count)[0] == (events.ServiceLost(service=FIRST_SERVICE, stopping=True), *STEP)
    assert "End" in bodies(effects)
    assert harness.task.outcome is Outcome.CANCELLED
    assert harness.rings(StopDue(harness.task.id), 80.0) == []


def test_a_procedure_that_was_laid_down_for_a_failure_is_begun_once_for_a_step() -> None:
    aside = "Jar001 isOn Cupboard002"
    handlers = (Handler(on=Occasion.COMPENSATION, effect="Tin001 isOn Platform001"), Handler(on=Occasion.FAILURE, effect=aside))
    harness = TaskManagerHarness("Robot1", "Robot2", handlers=handlers)
    harness.executing()
    for service, event_names in ((FIRST_SERVICE, ["HandlerBegun", "Planned"]), (SECOND_SERVICE, [])):
        event_count = len(harness.task.events)
        harness.service_says(frp.Failed(description="stuck", situation=INITIAL_SITUATION), 5.0, service)
        logged_events = [event for event, *_ in harness.news(event_count)]
        assert [type(event).__name__ for event in logged_events][1 : len(event_names) + 1] == event_names
        assert (events.HandlerBegun(effect=aside) in logged_events) is bool(event_names)
        if service == FIRST_SERVICE:
            harness.offer(6.0, SECOND_SERVICE)
    assert (harness.task.goal_count, harness.task.side_goals) == (2, [])
