"""What comes of what the participants of a task say: news for the client, a report for the map, and what becomes of the work."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from somrs.entish.parse import parse
from somrs.kernel.component import Answered, Ask, DeliveryFailed, Effect, Input, Received, Send, SetTimer, TimerFired
from somrs.ontology.effects import changes
from somrs.ontology.files.loading import load_text
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan
from somrs.protocol.messages import clients, events, frp
from somrs.protocol.messages.bodies import Body, FrpBody
from somrs.protocol.messages.directory import Discover, Discovered, Offer
from somrs.protocol.messages.envelope import Header, Message, reply
from somrs.protocol.messages.events import Event, GoalKind
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.task_manager.execution.member import Member
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.timers import DeadlineDue, OverdueDue, SilenceDue, StopDue, Timer
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.views import view
from tests.support.virtual_system import SITE

WISH, BEFORE = "Jar002 isOn Platform001", "Jar002 isOn Cupboard001"
ONE, TWO = "Robot1.TransferObject", "Robot2.TransferObject"


class Desk:
    """A Task Manager whose Repository, Registry and planner answer at once; services say what the test has them say."""

    def __init__(
        self, *robots: str, rejects: tuple[str, ...] = (), found: Iterable[object] = (), held: bool = False, **wanted: object
    ) -> None:
        loaded = load_text(SITE, "site.yaml")
        assert loaded.map is not None
        self.manager = TaskManager("tm", repository="repository", registry="registry")
        self.replica = self.manager.state.replica
        self.replica.ontology, self.replica.map, self.replica.version = loaded.ontology, loaded.map, 0
        transfer = loaded.ontology.services["TransferObject"]
        self.offers = tuple(
            Offer(service=f"{name}.TransferObject", provider=name, provider_type="PioneerP3DX", address=name, service_type=transfer)
            for name in robots or ("Robot1",)
        )
        self.rejects = rejects
        self.registry: Body | None = None
        """What the Registry answers instead of what is on offer."""
        self.held = held
        """Whether the planner's answers wait until the test gives them."""
        self.found = [*found]
        """What the planner answers next, in place of what it would find."""
        self.reports: list[UpdateMap] = []
        self.said = 0
        self.says_client(clients.Submit(**{"effect": WISH, **wanted}), 0.0)  # type: ignore[arg-type]  # fields of Submit

    @property
    def task(self) -> TaskState:
        (task,) = self.manager.state.tasks.values()
        return task

    def give(self, event: Input, now: float) -> list[Effect]:
        """All that comes of it, once everybody has answered."""
        effects = self.manager.handle(event, now)
        for effect in [*effects]:
            match effect:
                case Ask(question, Problem() as problem) if not self.held:
                    effects += self.give(Answered(question, self.found.pop(0) if self.found else plan(problem)), now)
                case Send(Message(body=Discover()) as message):
                    body = self.registry or Discovered(offers=self.offers)
                    effects += self.give(Received(reply(message, body, "registry")), now)
                case Send(Message(body=UpdateMap() as update) as message):
                    effects += self.give(Received(reply(message, self._update(update), "repository")), now)
        return effects

    def _update(self, update: UpdateMap) -> Body:
        self.reports.append(update)
        if self.rejects:
            return Rejected(problems=self.rejects)
        situation = update.situation
        made = changes(parse(situation), self.replica.map, self.replica.ontology) if situation is not None else update.changes
        self.replica.map = self.replica.map.changed(made)
        self.replica.version += 1
        return Updated(version=self.replica.version)

    def says_client(self, body: Body, now: float) -> list[Effect]:
        self.said += 1
        header = Header(sender="client", recipient="tm", message_id=f"client {self.said}", reply_to="client")
        return self.give(Received(Message(header=header, body=body)), now)

    def member(self, service: str = ONE) -> Member:
        """The one of that service that was asked last."""
        return [member for member in self.task.members if member.offer.service == service][-1]

    def message(self, body: FrpBody, service: str = ONE, by: Member | None = None, about: str | None = None) -> Message:
        """What one of them would say; `about`: the kind of message that it answers."""
        self.said += 1
        member = by or self.member(service)
        header = Header(
            sender=member.offer.address,
            recipient="tm",
            message_id=f"said {self.said}",
            reply_to=member.offer.address,
            relates_to=member.session.sent_messages[about].id if about is not None else None,
            transaction=self.task.id,
            participant=member.id,
        )
        return Message(header=header, body=body)

    def says(self, body: FrpBody, now: float, service: str = ONE, by: Member | None = None, about: str | None = None) -> list[Effect]:
        return self.give(Received(self.message(body, service, by, about)), now)

    def rings(self, timer: Timer, now: float) -> list[Effect]:
        return self.give(TimerFired(timer), now)

    def offer(self, now: float = 1.0, service: str = ONE, price: float = 10.0) -> list[Effect]:
        return self.says(frp.Terms(effect=WISH, price=price, duration=60.0), now, service)

    def executing(self) -> list[Effect]:
        """All who were asked have given terms, and the first is at work; what it was told comes back."""
        effects: list[Effect] = []
        for number, offer in enumerate(self.offers):
            effects += self.offer(1.0 + number, offer.service, 10.0 + number)
        assert self.member().state is State.EXECUTING
        return effects

    def news(self, since: int) -> list[tuple[Event, str | None, GoalKind | None]]:
        return [(noted.event, noted.step, noted.goal) for noted in self.task.events[since:]]


def bodies(effects: list[Effect]) -> list[str]:
    return [type(effect.message.body).__name__ for effect in effects if isinstance(effect, Send)]


STEP = ("step1", GoalKind.TASK)


def test_a_task_from_its_statement_to_its_end() -> None:
    desk = Desk(deadline=500.0)
    desk.executing()
    effects = desk.says(frp.Completed(situation=WISH), 61.0)
    assert desk.news(0) == [
        (events.TaskStated(effect=WISH), None, None),
        (events.Planned(steps=1), None, None),
        (events.ServicesAsked(services=(ONE,)), *STEP),
        (events.TermsOffered(service=ONE, price=10.0, currency="EUR", duration=60.0), *STEP),
        (events.ServiceChosen(service=ONE, price=10.0, currency="EUR", duration=60.0), *STEP),
        (events.StepStarted(service=ONE), *STEP),
        (events.StepCompleted(service=ONE, situation=WISH), *STEP),
        (events.TaskEnded(outcome=Outcome.ACCOMPLISHED, reasons=()), None, None),
    ]
    assert desk.reports == [UpdateMap(situation=WISH, author=ONE)]
    assert bodies(effects) == ["UpdateMap", "End"]
    seen = view(desk.task)
    (step,), (work,) = seen.steps, seen.work
    assert (step.state, step.service, step.price, step.duration, step.fraction) == (State.COMPLETED, ONE, 10.0, 60.0, 1.0)
    assert (work.state, work.result, work.began, work.ended, work.situation) == (State.COMPLETED, State.COMPLETED, 1.0, 61.0, WISH)
    assert (work.note, work.before, seen.outcome, seen.ended_at) == ("", BEFORE, Outcome.ACCOMPLISHED, 61.0)
    assert {effect.timer: effect.at for effect in effects if isinstance(effect, SetTimer) and not isinstance(effect.timer, SilenceDue)}[
        DeadlineDue(desk.task.id)
    ] is None
    assert (desk.manager.open, desk.task.messages, desk.task.message_count, desk.task.setbacks) == ([], [], 6, 0)


def test_who_refuses_is_not_asked_again_and_the_next_is_taken() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.offer(1.0, TWO)
    since = len(desk.task.events)
    effects = desk.says(frp.Refuse(reason="too heavy"), 2.0)
    assert desk.news(since)[0] == (events.ServiceRefused(service=ONE, reason="too heavy"), *STEP)
    assert bodies(effects) == ["Accept", "Execute"]
    assert desk.member().exit_reason == "too heavy"
    assert [run.excluded for run in desk.task.goal] == [{ONE: "too heavy"}]


def test_who_could_not_be_reached_is_out() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.offer(1.0, TWO)
    (asked,) = [one.message for one in desk.task.messages if one.message.header.participant == desk.member().id]
    effects = desk.give(DeliveryFailed(asked, "no route"), 2.0)
    assert bodies(effects) == ["Cancel", "Accept", "Execute"]
    assert [run.excluded for run in desk.task.goal] == [{ONE: "could not be reached: no route"}]


def test_what_was_not_begun_leaves_nothing_to_undo() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.executing()
    since = len(desk.task.events)
    effects = desk.says(frp.Failed(description="too late", tried=False), 5.0)
    assert desk.news(since)[0] == (events.NotBegun(service=ONE, description="too late"), *STEP)
    assert (desk.task.log.works, desk.reports) == ([], [])
    assert bodies(effects)[-1] == "Arrange"
    assert desk.member().exit_reason == "too late"


@pytest.mark.parametrize(
    ("body", "event", "state", "note"),
    [
        (
            frp.Failed(description="stuck", situation=BEFORE),
            events.StepFailed(service=ONE, description="stuck", situation=BEFORE),
            State.FAILED,
            "failed: stuck",
        ),
        (frp.Stopped(situation=BEFORE), events.StepStopped(service=ONE), State.STOPPED, "stopped"),
    ],
)
def test_what_a_failure_left_is_on_the_map_before_another_is_asked(body: FrpBody, event: Event, state: State, note: str) -> None:
    desk = Desk("Robot1", "Robot2")
    desk.executing()
    since = len(desk.task.events)
    effects = desk.says(body, 5.0)
    assert [one for one, *_ in desk.news(since)] == [event, events.ServiceReplaced(), events.ServicesAsked(services=(TWO,))]
    assert desk.reports == [UpdateMap(situation=BEFORE, author=ONE)]
    assert bodies(effects) == ["UpdateMap", "Arrange"]
    (work,) = desk.task.log.works
    assert (work.state, work.result, work.ended, work.situation, work.note) == (state, state, 5.0, BEFORE, note)
    (run,) = desk.task.goal
    assert (run.excluded, str(run.reported), desk.task.services.broken) == ({ONE: note}, BEFORE, {ONE: note})
    assert desk.task.services.failures == {ONE: 1}
    assert desk.task.look_queue.unseen == []


def test_a_failure_of_which_nothing_is_known_is_looked_at() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.executing()
    since = len(desk.task.events)
    desk.says(frp.Failed(description="stuck"), 5.0)
    assert [type(one).__name__ for one, *_ in desk.news(since)][:2] == ["StepFailed", "NobodyLooks"]
    (report,) = desk.reports
    assert (report.author, report.situation) == ("nobody could look", None)


def test_progress_is_told_when_it_is_news_and_put_on_the_map_when_it_changed_something() -> None:
    desk = Desk()
    desk.executing()
    since = len(desk.task.events)
    held = "Jar002 isHeldBy Robot1"
    for body in (
        frp.Progress(fraction=0.1),
        frp.Progress(fraction=0.2, note="drives"),
        frp.Progress(fraction=0.3, note="drives"),
        frp.Progress(fraction=0.4, note="carries", situation=held),
        frp.Progress(fraction=0.5),
    ):
        desk.says(body, 5.0)
        assert desk.member().fraction == body.fraction
    assert desk.news(since) == [
        (events.ProgressNoted(service=ONE, note="drives"), *STEP),
        (events.ProgressNoted(service=ONE, note="carries"), *STEP),
    ]
    assert desk.reports == [UpdateMap(situation=held, author=ONE)]
    (work,) = desk.task.log.works
    assert (work.situation, work.state, desk.member().note) == (held, State.EXECUTING, "carries")


def test_a_report_that_is_rejected_counts_as_a_failure() -> None:
    desk = Desk("Robot1", "Robot2", rejects=("there is no such place",))
    desk.executing()
    since = len(desk.task.events)
    desk.says(frp.Completed(situation=WISH), 61.0)
    assert desk.news(since)[:2] == [
        (events.StepCompleted(service=ONE, situation=WISH), *STEP),
        (events.ReportRejected(service=ONE, problems=("there is no such place",)), *STEP),
    ]
    why = "reported an impossible situation: there is no such place"
    (work,) = desk.task.log.works
    assert (work.state, work.result, work.note) == (State.FAILED, State.FAILED, why)
    assert desk.task.services.broken == {ONE: why}


def test_one_that_falls_silent_is_lost_and_nothing_is_known_of_what_it_left() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.executing()
    member = desk.member()
    desk.replica.version = 4
    since = len(desk.task.events)
    desk.rings(SilenceDue(desk.task.id, member.id), 41.0)
    desk.rings(SilenceDue(desk.task.id, member.id), 81.0)
    told = [one for one, *_ in desk.news(since)]
    assert told[:2] == [events.ServiceSilent(service=ONE), events.ServiceLost(service=ONE, silent=True)]
    (work,) = desk.task.log.works
    assert (work.state, work.result, work.ended) == (State.STRANDED, State.UNREACHABLE, 81.0)
    assert work.note == desk.task.services.broken[ONE] == "fell silent while it worked"
    assert desk.task.services.failures == {}
    assert desk.reports[0].expected_version == 4


@pytest.mark.parametrize(
    "late",
    [frp.Completed(situation=BEFORE), frp.Failed(description="", situation=BEFORE), frp.Stopped(situation=BEFORE)],
)
def test_the_report_of_one_that_was_given_up_is_put_on_the_map_after_the_end(late: FrpBody) -> None:
    desk = Desk()
    desk.executing()
    member = desk.member()
    desk.says_client(clients.CancelTask(task=desk.task.id), 10.0)
    desk.rings(StopDue(desk.task.id), 70.0)
    assert desk.task.outcome is Outcome.CANCELLED
    assert [*desk.task.members] == [member]
    lost_at, before = member.lost_version, len(desk.reports)
    for _ in range(2):
        desk.says(late, 80.0)
    assert desk.reports[before:] == [UpdateMap(situation=BEFORE, author=ONE, expected_version=lost_at)]


def test_one_that_takes_far_too_long_is_stopped_and_then_lost() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.executing()
    timer = OverdueDue(desk.task.id, desk.member().id)
    since = len(desk.task.events)
    assert bodies(desk.rings(timer, 700.0)) == ["Stop"]
    desk.rings(timer, 760.0)
    assert [one for one, *_ in desk.news(since)][:2] == [events.ServiceOverdue(service=ONE), events.ServiceLost(service=ONE)]


# Ending


@pytest.mark.parametrize(("reason", "said"), [("no more", "no more"), ("", "cancelled by the client")])
def test_a_task_that_is_cancelled_stops_everybody_and_undoes_what_was_done(reason: str, said: str) -> None:
    desk = Desk(deadline=500.0)
    desk.executing()
    since = len(desk.task.events)
    effects = desk.says_client(clients.CancelTask(task=desk.task.id, reason=reason), 10.0)
    assert bodies(effects) == ["Stop", "Cancelling"]
    wakes = {effect.timer: effect.at for effect in effects if isinstance(effect, SetTimer)}
    assert (wakes[DeadlineDue(desk.task.id)], wakes[StopDue(desk.task.id)]) == (None, 70.0)
    assert (desk.task.phase, desk.task.ending, desk.task.reasons) == (clients.Phase.RECOVERING, Outcome.CANCELLED, (said,))
    desk.says_client(clients.CancelTask(task=desk.task.id, reason="once more"), 11.0)
    effects = desk.says(frp.Stopped(situation=BEFORE), 12.0)
    assert [one for one, *_ in desk.news(since)] == [
        events.Stopping(reason=said),
        events.StepStopped(service=ONE),
        events.WorkUndone(),
        events.TaskEnded(outcome=Outcome.CANCELLED, reasons=(said, f"TransferObject by {ONE} was undone: {BEFORE}")),
    ]
    assert bodies(effects) == ["UpdateMap", "End"]
    assert [effect.timer for effect in effects if isinstance(effect, SetTimer)].count(StopDue(desk.task.id)) == 2
    assert desk.task.services.broken == {}, "it was called off, and did not fail"
    assert (desk.task.outcome, desk.task.ended_at) == (Outcome.CANCELLED, 12.0)


def test_a_task_whose_deadline_is_over_has_failed() -> None:
    desk = Desk(deadline=500.0)
    effects = desk.rings(DeadlineDue(desk.task.id), 500.0)
    assert bodies(effects) == ["Cancel"]
    assert desk.task.outcome is Outcome.FAILED
    assert desk.task.reasons == ("the deadline of 500 s is over",)
    assert [one for one, *_ in desk.news(-1)] == [events.TaskEnded(outcome=Outcome.FAILED, reasons=desk.task.reasons)]


def test_one_that_does_not_say_that_it_stopped_is_given_up() -> None:
    desk = Desk()
    desk.executing()
    desk.says_client(clients.CancelTask(task=desk.task.id), 10.0)
    since = len(desk.task.events)
    effects = desk.rings(StopDue(desk.task.id), 70.0)
    assert desk.news(since)[0] == (events.ServiceLost(service=ONE, stopping=True), *STEP)
    assert "End" in bodies(effects)
    assert desk.task.outcome is Outcome.CANCELLED
    assert desk.rings(StopDue(desk.task.id), 80.0) == []


def test_a_procedure_that_was_laid_down_for_a_failure_is_begun_once_for_a_step() -> None:
    aside = "Jar001 isOn Cupboard002"
    handlers = (Handler(on=Occasion.COMPENSATION, effect="Tin001 isOn Platform001"), Handler(on=Occasion.FAILURE, effect=aside))
    desk = Desk("Robot1", "Robot2", handlers=handlers)
    desk.executing()
    for service, begun in ((ONE, ["HandlerBegun", "Planned"]), (TWO, [])):
        since = len(desk.task.events)
        desk.says(frp.Failed(description="stuck", situation=BEFORE), 5.0, service)
        told = [one for one, *_ in desk.news(since)]
        assert [type(one).__name__ for one in told][1 : len(begun) + 1] == begun
        assert (events.HandlerBegun(effect=aside) in told) is bool(begun)
        if service == ONE:
            desk.offer(6.0, TWO)
    assert (desk.task.goal_count, desk.task.side_goals) == (2, [])
