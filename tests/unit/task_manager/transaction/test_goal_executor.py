"""How a goal is pursued: plans and their steps, one service after the other, and what is done when a step is lost."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.kernel.component import Answered, Ask, Effect, ErrorAnswer, Send, SetTimer, Withdraw
from somrs.kernel.reservations import Reservation
from somrs.ontology.effects import changes
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.plan import Link, NoPlan, Plan
from somrs.protocol.messages import events, frp, submission, waits
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.reservations import ReservationDenied, ReservationMode, Reserve, Reserved
from somrs.protocol.messages.task_views import Phase
from somrs.protocol.messages.waits import WaitsToRetry
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Progress
from somrs.task_manager.requests import DISCOVERY_TIME
from somrs.task_manager.timers import BidsDue, DiscoveryDue, PlanWanted, RetryDue
from tests.unit.task_manager.test_preview import APART, CHAIN, move
from tests.unit.task_manager.transaction.test_participant_events import (
    FIRST_SERVICE,
    GOAL,
    INITIAL_SITUATION,
    SECOND_SERVICE,
    STEP,
    TaskManagerHarness,
    bodies,
)

BOTH_JARS = "Jar001 isOn Platform001 AND Tin001 isOn Platform001"
STEP_A, STEP_B = ("a", GoalKind.TASK), ("b", GoalKind.TASK)
HELD = "Jar001 isHeldBy Robot1"


def logged_events(harness: TaskManagerHarness, event_count: int) -> list[object]:
    return [event for event, *_ in harness.news(event_count)]


def arrange_requests(effects: list[Effect]) -> list[tuple[str, float | None, str | None]]:
    """What services were asked for: the effect, from when on, and on what."""
    sent_bodies = [effect.message.body for effect in effects if isinstance(effect, Send)]
    return [(body.effect, body.earliest_start, body.precondition) for body in sent_bodies if isinstance(body, frp.Arrange)]


def goodbyes(effects: list[Effect]) -> list[str]:
    sent_bodies = [effect.message.body for effect in effects if isinstance(effect, Send)]
    return [body.reason for body in sent_bodies if isinstance(body, frp.Cancel | frp.Stop)]


def member(harness: TaskManagerHarness, label: str, service: str = FIRST_SERVICE) -> Member:
    return [participant for participant in harness.task.members if (participant.label, participant.offer.service) == (label, service)][-1]


def terms(harness: TaskManagerHarness, label: str, now: float, first: float, second: float | None = None) -> list[Effect]:
    """Both give terms for the step, at these prices."""
    effects = harness.service_says(frp.Terms(effect=GOAL, price=first, duration=60.0), now, sender=member(harness, label))
    if second is not None:
        effects += harness.service_says(
            frp.Terms(effect=GOAL, price=second, duration=60.0), now, sender=member(harness, label, SECOND_SERVICE)
        )
    return effects


def chain(**options: object) -> TaskManagerHarness:
    """The first robot does the first step, the second is committed to the second."""
    harness = TaskManagerHarness("Robot1", "Robot2", plan_results=[CHAIN], effect=BOTH_JARS, **options)  # type: ignore[arg-type]  # fields of Submit
    effects = terms(harness, "a", 1.0, 10.0, 20.0)
    assert bodies(effects) == ["Accept", "Cancel", "Arrange", "Arrange"]
    assert arrange_requests(effects) == [("Tin001 isOn Platform001", 60.0, None)] * 2
    assert (harness.task.phase, [run.progress for run in harness.task.goal]) == (Phase.ARRANGING, [Progress.ARRANGED, Progress.ARRANGING])
    assert bodies(terms(harness, "b", 2.0, 10.0, 5.0)) == ["Cancel", "Accept", "Execute"]
    assert (harness.task.phase, [run.progress for run in harness.task.goal]) == (Phase.EXECUTING, [Progress.EXECUTING, Progress.ARRANGED])
    return harness


def moved(harness: TaskManagerHarness, situation: str) -> None:
    """Somebody else has made it so."""
    harness.replica.map = harness.replica.map.changed(changes(parse(situation), harness.replica.map, harness.replica.ontology))


# Planning


def test_steps_follow_each_other_to_the_goal() -> None:
    harness = chain()
    assert bodies(harness.service_says(frp.Completed(situation="Jar001 isOn Platform001"), 50.0, sender=member(harness, "a"))) == [
        "UpdateMap",
        "Execute",
    ]
    assert [run.progress for run in harness.task.goal] == [Progress.COMPLETED, Progress.EXECUTING]
    effects = harness.service_says(frp.Completed(situation="Tin001 isOn Platform001"), 90.0, sender=member(harness, "b", SECOND_SERVICE))
    assert (bodies(effects), harness.task.outcome) == (["UpdateMap", "End", "End"], Outcome.ACCOMPLISHED)


def test_what_the_client_said_of_the_beginning_is_about_the_first_plan() -> None:
    harness = TaskManagerHarness(held=True, precondition=INITIAL_SITUATION)
    goal, id = harness.task.goal, harness.task.id
    first = goal.request
    assert first is not None
    assert (first.task, first.question, goal.plans) == (harness.task.task, PlanWanted(id, 1, 0, 1), 1)
    harness.feed(Answered(PlanWanted(id, 1, 0, 1), Plan((move("a", "Jar002"),))), 1.0)
    assert (goal.request, harness.task.phase) == (None, Phase.ARRANGING)
    effects = harness.service_says(frp.Refuse(reason="no"), 2.0)
    assert [effect.question for effect in effects if isinstance(effect, Ask)] == [PlanWanted(id, 1, 1, 1)]
    request = goal.request
    assert request is not None
    assert (request.task.precondition, request.task.effect, goal.plans, harness.task.phase) == (None, GOAL, 2, Phase.PLANNING)
    assert harness.feed(Answered(PlanWanted(id, 1, 0, 1), CHAIN), 3.0) == [], "that plan is not wanted any more"
    assert goal.request is request


@pytest.mark.parametrize(
    ("plan_result", "reason"),
    [
        (ErrorAnswer("out of memory"), "planning failed: out of memory"),
        (NoPlan("none"), "no plan: none"),
    ],
)
def test_a_task_without_a_plan_fails(plan_result: object, reason: str) -> None:
    harness = TaskManagerHarness(plan_results=[plan_result])
    assert (harness.task.outcome, harness.task.reasons) == (Outcome.FAILED, (reason,))
    assert logged_events(harness, 1) == [events.TaskEnded(outcome=Outcome.FAILED, reasons=(reason,))]


def test_why_services_are_not_asked_belongs_to_why_there_is_no_plan() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.service_says(frp.Refuse(reason="too heavy"), 1.0)
    harness.plan_results = [NoPlan("none", separate_reasons=("none", "never"), lost=(SECOND_SERVICE,))]
    harness.service_says(frp.Refuse(reason="too far"), 2.0, SECOND_SERVICE)
    assert harness.task.reasons == (f"no plan: {FIRST_SERVICE}: too heavy", "none", "never")
    assert harness.task.services.broken == {FIRST_SERVICE: "too heavy", SECOND_SERVICE: "too far"}


def test_when_the_registry_cannot_say_who_is_there_the_task_fails() -> None:
    harness = TaskManagerHarness("Robot1", waits=False)
    harness.directory.version = -1
    harness.service_says(frp.Refuse(reason="too heavy"), 1.0)
    harness.rings(DiscoveryDue(), 1.0 + DISCOVERY_TIME - 0.1)
    assert harness.task.outcome is None
    harness.rings(DiscoveryDue(), 1.0 + DISCOVERY_TIME)
    assert harness.task.reasons == ("the Service Registry does not answer",)


# Steps that are lost


def test_a_new_plan_keeps_what_still_stands_of_the_one_before() -> None:
    harness = chain()
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Failed(description="stuck", situation=HELD), 5.0, sender=member(harness, "a"))
    assert harness.news(event_count)[:3] == [
        (events.StepFailed(service=FIRST_SERVICE, description="stuck", situation=HELD), *STEP_A),
        (events.Replanned(reasons=("failed: stuck",)), None, None),
        (events.Planned(steps=2), None, None),
    ]
    assert bodies(effects) == ["UpdateMap", "Arrange"]
    assert [(run.label, run.key, run.progress, run.provider) for run in harness.task.goal] == [
        ("step1", "1.2/step1", Progress.ARRANGING, None),
        ("step2", "1.2/step2", Progress.ARRANGED, "Robot2"),
    ]
    assert member(harness, "b", SECOND_SERVICE).step == "1.2/step2"
    assert (harness.task.goal.replans.total, harness.task.goal.replans.fruitless, harness.task.goal.replans.steps) == (1, 1, 2)


def test_whose_step_is_not_in_the_new_plan_is_sent_home() -> None:
    harness = chain()
    harness.plan_results = [Plan((move("c", "Jar002"),))]
    effects = harness.service_says(frp.Failed(description="stuck", situation=HELD), 5.0, sender=member(harness, "a"))
    assert (bodies(effects), goodbyes(effects)) == (["UpdateMap", "Cancel", "Arrange"], ["the plan changed"])


def test_a_new_plan_waits_for_what_is_under_way() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2", plan_results=[APART], effect=BOTH_JARS)
    terms(harness, "a", 1.0, 10.0, 20.0)
    terms(harness, "b", 2.0, 20.0, 10.0)
    assert [run.progress for run in harness.task.goal] == [Progress.EXECUTING, Progress.EXECUTING]
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Failed(description="stuck", situation=HELD), 5.0, sender=member(harness, "a"))
    assert (bodies(effects), logged_events(harness, event_count)[1:], harness.task.phase) == (["UpdateMap"], [], Phase.RECOVERING)
    assert harness.task.goal.replan_because == ("failed: stuck",)
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Completed(situation="Tin001 isOn Platform001"), 6.0, sender=member(harness, "b", SECOND_SERVICE))
    assert bodies(effects)[:1] == ["UpdateMap"]
    assert logged_events(harness, event_count)[1] == events.Replanned(reasons=("failed: stuck",))
    assert harness.task.goal.replan_because is None


def test_a_step_that_nobody_takes_is_planned_anew() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.service_says(frp.Refuse(reason="too heavy"), 1.0)
    event_count = len(harness.task.events)
    harness.plan_results = [Plan((move("c", "Jar002"),))]
    harness.service_says(frp.Refuse(reason="too far"), 2.0, SECOND_SERVICE)
    reason = f"no service takes it ({FIRST_SERVICE}: too heavy; {SECOND_SERVICE}: too far)"
    assert logged_events(harness, event_count)[:2] == [
        events.ServiceRefused(service=SECOND_SERVICE, reason="too far"),
        events.Replanned(reasons=(reason,)),
    ]
    assert harness.task.services.broken == {FIRST_SERVICE: "too heavy", SECOND_SERVICE: "too far"}


def test_a_step_that_nobody_offers_any_more_is_planned_anew_when_somebody_does() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2", plan_results=[CHAIN], effect=BOTH_JARS)
    offers, harness.offers = harness.offers, ()
    event_count = len(harness.task.events)
    effects = terms(harness, "a", 1.0, 10.0, 20.0)
    replanned, waits = logged_events(harness, event_count)[3:5]
    assert replanned == events.Replanned(reasons=("no device offers it any more",))
    assert isinstance(waits, WaitsToRetry)
    assert [hindrance.reason for hindrance in waits.hindrances] == ["no device offers it now"]
    assert bodies(effects) == ["Accept", "Cancel", "Cancel"]
    harness.offers = offers
    effects = harness.rings(RetryDue(harness.task.id), waits.next_attempt)
    assert bodies(effects) == ["Arrange"] * 4


def test_a_step_that_turns_out_to_be_so_is_done() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.executing()
    event_count = len(harness.task.events)
    harness.service_says(frp.Failed(description="fell over", situation=GOAL), 5.0)
    assert harness.news(event_count)[:2] == [
        (events.StepFailed(service=FIRST_SERVICE, description="fell over", situation=GOAL), *STEP),
        (events.FoundSo(), *STEP),
    ]
    assert (harness.task.outcome, [run.progress for run in harness.task.goal]) == (Outcome.ACCOMPLISHED, [Progress.COMPLETED])


def test_the_only_one_that_can_do_it_may_try_again() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Failed(description="stuck", situation=INITIAL_SITUATION), 5.0)
    assert harness.news(event_count)[1:] == [
        (events.MayTryAgain(services=(FIRST_SERVICE,)), *STEP),
        (events.ServiceReplaced(), *STEP),
        (events.ServicesAsked(services=(FIRST_SERVICE,)), *STEP),
    ]
    assert arrange_requests(effects) == [(GOAL, 5.0, f"{INITIAL_SITUATION} AND Platform001.Supporting = TRUE")]
    assert (harness.task.services.broken, [run.excluded for run in harness.task.goal], harness.member().number) == ({}, [{}], 2)


def test_a_step_that_cannot_start_any_more_is_planned_anew() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2", plan_results=[APART], effect=BOTH_JARS)
    terms(harness, "a", 1.0, 10.0, 20.0)
    moved(harness, HELD)
    event_count = len(harness.task.events)
    effects = terms(harness, "b", 2.0, 20.0, 10.0)
    assert goodbyes(effects) == ["another service was chosen by price", "its precondition does not hold any more"]
    assert [type(event).__name__ for event in logged_events(harness, event_count)][2:4] == ["ServiceChosen", "Replanned"]
    (replanned,) = [event for event in logged_events(harness, event_count) if isinstance(event, events.Replanned)]
    assert replanned.reasons == ("TransferObject cannot start: Jar001 isOn ?Source AND Platform001.Supporting = TRUE does not hold",)


def test_a_step_waits_for_its_device_and_says_so_once() -> None:
    harness = TaskManagerHarness(plan_results=[APART], effect=BOTH_JARS)
    terms(harness, "a", 1.0, 10.0)
    event_count = len(harness.task.events)
    assert bodies(terms(harness, "b", 2.0, 10.0)) == ["Accept", "Execute"]
    assert (waits.WaitsForDevice(device="Robot1"), *STEP_B) in harness.news(event_count)
    harness.service_says(frp.Progress(fraction=0.5, situation="Jar001 isHeldBy Robot1"), 3.0, sender=member(harness, "a"))
    assert logged_events(harness, event_count).count(waits.WaitsForDevice(device="Robot1")) == 1
    effects = harness.service_says(frp.Completed(situation="Jar001 isOn Platform001"), 60.0, sender=member(harness, "a"))
    assert bodies(effects) == ["UpdateMap", "Execute"]


def test_no_more_than_so_many_steps_are_arranged_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.task_manager.transaction.goal_executor.MAX_OPEN_CALLS", 2)
    harness = TaskManagerHarness(plan_results=[Plan((*APART.steps, move("c", "Jar002")))], effect=BOTH_JARS)
    assert [participant.label for participant in harness.task.members] == ["a", "b"]
    assert bodies(terms(harness, "a", 1.0, 10.0)) == ["Accept", "Arrange"]
    assert [participant.label for participant in harness.task.members] == ["a", "b", "c"]


def test_terms_for_what_is_arranged_already_are_only_remembered() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.executing()
    harness.manager.state.quotes.prices.clear()
    event_count = len(harness.task.events)
    assert harness.service_says(frp.Terms(effect=GOAL, price=1.0, duration=2.0), 5.0) == []
    assert harness.news(event_count) == []


# Giving up


def test_a_goal_is_not_planned_anew_for_ever() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    for now in range(20):
        harness.service_says(frp.Completed(situation=INITIAL_SITUATION), 61.0 + now)
        if harness.task.outcome is not None:
            break
        harness.offer(61.5 + now)
    assert harness.task.reasons[:2] == ("every step was done, but the goal does not hold", "replanned 9 times")
    assert [type(event).__name__ for event in logged_events(harness, 0)].count("Replanned") == 9


def test_when_a_plan_is_given_up_nobody_goes_on_with_it() -> None:
    plan = Plan((*CHAIN.steps, move("c", "Jar002")), (Link("a", "b", ""),))
    harness = TaskManagerHarness("Robot1", "Robot2", plan_results=[plan], effect=f"{BOTH_JARS} AND {GOAL}")
    terms(harness, "a", 1.0, 10.0, 20.0)
    terms(harness, "c", 2.0, 20.0, 10.0)
    terms(harness, "b", 2.0, 20.0, 10.0)
    assert [(run.label, run.progress, run.provider) for run in harness.task.goal] == [
        ("a", Progress.EXECUTING, "Robot1"),
        ("b", Progress.ARRANGED, "Robot2"),
        ("c", Progress.EXECUTING, "Robot2"),
    ]
    harness.task.goal.replans.total = 100
    effects = harness.service_says(
        frp.Failed(description="stuck", situation="Jar002 isHeldBy Robot2"), 5.0, sender=member(harness, "c", SECOND_SERVICE)
    )
    assert (bodies(effects), goodbyes(effects)) == (["UpdateMap", "Stop", "Cancel"], ["the plan was given up"] * 2)
    assert (harness.task.ending, harness.task.reasons) == (Outcome.FAILED, ("failed: stuck", "replanned 100 times"))
    assert member(harness, "a").state is State.STOPPING


# Beside the goal of the task


def handling(effect: str, *, held: bool = False, registry_held: bool = False) -> TaskManagerHarness:
    """The first of two steps that are under way has failed, and a procedure was laid down for that."""
    harness = TaskManagerHarness(
        "Robot1", "Robot2", plan_results=[APART], effect=BOTH_JARS, handlers=(Handler(on=Occasion.FAILURE, effect=effect),)
    )
    terms(harness, "a", 1.0, 10.0, 20.0)
    terms(harness, "b", 2.0, 20.0, 10.0)
    harness.held, harness.directory.confirmed = held, not registry_held
    harness.service_says(frp.Failed(description="stuck", situation="Jar001 isOn Cupboard001"), 5.0, sender=member(harness, "a"))
    assert (harness.task.phase, [side_goal.kind for side_goal in harness.task.side_goals]) == (Phase.RECOVERING, [GoalKind.HANDLER])
    return harness


def test_what_is_reported_while_a_plan_is_made_has_it_made_again() -> None:
    harness = handling("Jar002 isOn Platform001", held=True)
    id, event_count = harness.task.id, len(harness.task.events)
    effects = harness.service_says(frp.Completed(situation="Tin001 isOn Platform001"), 6.0, sender=member(harness, "b", SECOND_SERVICE))
    assert [effect.question for effect in effects if isinstance(effect, Withdraw)] == [PlanWanted(id, 2, 0, 1)]
    assert [effect.question for effect in effects if isinstance(effect, Ask)] == [PlanWanted(id, 2, 1, 1)]
    assert logged_events(harness, event_count) == [
        events.StepCompleted(service=SECOND_SERVICE, situation="Tin001 isOn Platform001"),
        events.Replanned(reasons=(f"{SECOND_SERVICE} reported during planning",)),
    ]


def test_services_on_offer_that_are_not_asked_for_any_more_are_ignored() -> None:
    harness = handling("Jar002 isOn Platform001", registry_held=True)
    harness.service_says(frp.Completed(situation="Tin001 isOn Platform001"), 6.0, sender=member(harness, "b", SECOND_SERVICE))
    assert len(harness.manager.state.discovery.waiting) == 2
    harness.directory.confirmed = True
    effects = harness.rings(DiscoveryDue(), 7.0)
    assert [effect.question for effect in effects if isinstance(effect, Ask)] == [PlanWanted(harness.task.id, 2, 1, 1)]


def test_a_procedure_is_done_when_what_it_demands_is_so() -> None:
    aside = "Jar002 isOn Platform001"
    harness = handling(aside)
    assert member(harness, "handler2.step1", SECOND_SERVICE).step == "2.1/step1"
    event_count = len(harness.task.events)
    harness.service_says(frp.Completed(situation="Tin001 isOn Platform001"), 6.0, sender=member(harness, "b", SECOND_SERVICE))
    harness.offer(7.0, SECOND_SERVICE)
    assert member(harness, "handler2.step1", SECOND_SERVICE).state is State.EXECUTING
    harness.service_says(frp.Completed(situation=INITIAL_SITUATION), 60.0, SECOND_SERVICE)
    assert events.Replanned(reasons=(f"every step was done, but {aside} does not hold",)) in logged_events(harness, event_count)
    harness.offer(61.0, SECOND_SERVICE)
    event_count = len(harness.task.events)
    harness.service_says(frp.Completed(situation=aside), 90.0, SECOND_SERVICE)
    assert [type(event).__name__ for event in logged_events(harness, event_count)] == ["StepCompleted", "ServiceReplaced", "ServicesAsked"]
    assert (harness.task.side_goals, harness.task.phase) == ([], Phase.ARRANGING)


def test_when_a_procedure_is_given_up_nobody_is_asked_for_it_any_more() -> None:
    harness = TaskManagerHarness(
        "Robot1",
        "Robot2",
        plan_results=[APART, Plan((move("x", "Jar002"), move("y", "Jar001")), ())],
        effect=BOTH_JARS,
        handlers=(Handler(on=Occasion.FAILURE, effect=f"Jar002 isOn Platform001 AND {GOAL}"),),
    )
    terms(harness, "a", 1.0, 10.0, 20.0)
    terms(harness, "b", 2.0, 20.0, 10.0)
    harness.service_says(frp.Failed(description="stuck", situation="Jar001 isOn Cupboard001"), 5.0, sender=member(harness, "a"))
    (aside,) = harness.task.side_goals
    assert [(run.label, run.progress) for run in aside] == [("handler2.x", Progress.ARRANGING), ("handler2.y", Progress.ARRANGING)]
    aside.replans.total = 100
    effects = harness.service_says(frp.Refuse(reason="too heavy"), 6.0, sender=member(harness, "handler2.y", SECOND_SERVICE))
    assert (harness.task.side_goals, goodbyes(effects)) == ([], ["the plan was given up"])
    assert member(harness, "handler2.x", SECOND_SERVICE).state is State.ENDED


# Waiting for others


def test_who_has_to_wait_lets_go_of_who_is_committed() -> None:
    harness = chain()
    harness.take_away("Jar001", goal="another wish")
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Failed(description="stuck", situation=HELD), 5.0, sender=member(harness, "a"))
    assert (bodies(effects), goodbyes(effects)) == (["UpdateMap", "Cancel"], ["the task has to wait for others"])
    waiting = waits.WaitsForTasks.on((waits.Holder(task="other", goal="another wish", objects=("Jar001",)),))
    assert logged_events(harness, event_count)[1:] == [events.Replanned(reasons=("failed: stuck",)), waiting]
    assert (harness.task.phase, harness.task.goal.waiting_for, [run.provider for run in harness.task.goal]) == (
        Phase.WAITING,
        waiting,
        [None, None],
    )
    assert (harness.has_reserved(), harness.reservations.claimants[harness.task.id].waiting) == (
        Reservation(),
        Reservation(changes=frozenset({"Jar001", "Tin001"})),
    )
    harness.reservations.remove("other")
    event_count = len(harness.task.events)
    effects = harness.admit(6.0)
    assert [type(event).__name__ for event in logged_events(harness, event_count)] == [
        "GoesOn",
        "Planned",
        "ServicesAsked",
        "ServicesAsked",
    ]
    assert bodies(effects)[0] == "Arrange"


def test_a_task_goes_on_when_its_objects_are_free_before_it_hears_that_it_has_to_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    harness = chain()
    harness.take_away("Jar001")
    reserve = harness.reserving.reserve

    def reserve_and_free(request: Reserve, sender: str, now: float) -> tuple[Reserved | ReservationDenied, list[Send]]:
        answered = reserve(request, sender, now)
        if request.mode is ReservationMode.WAIT:
            harness.reservations.remove("other")
            harness.admit(now)
        return answered

    monkeypatch.setattr(harness.reserving, "reserve", reserve_and_free)
    effects = harness.service_says(frp.Failed(description="stuck", situation=HELD), 5.0, sender=member(harness, "a"))
    assert "Arrange" in bodies(effects)
    assert harness.task.reservation.held == Reservation(changes=frozenset({"Jar001", "Tin001"}))


@pytest.mark.parametrize(("reserved_object", "is_reserved"), [("Tin001", True), ("Jar001", False)])
def test_what_is_to_be_undone_is_kept_from_others_unless_they_have_it_by_now(reserved_object: str, is_reserved: bool) -> None:
    harness = chain()
    harness.take_away(reserved_object)
    harness.service_says(frp.Failed(description="stuck", situation=HELD), 5.0, sender=member(harness, "a"))
    assert harness.task.phase is Phase.WAITING
    event_count = len(harness.task.events)
    effects = harness.client_says(submission.CancelTask(task=harness.task.id), 6.0)
    assert harness.task.reservation.held == Reservation(changes=frozenset({"Jar001"} if is_reserved else ()))
    assert ("Compensate" in bodies(effects)) is is_reserved
    stranded = events.WorkStranded(taken=True, holders=(waits.Holder(task="other", goal="", objects=("Jar001",)),))
    assert ((stranded, *STEP_A) in harness.news(event_count)) is not is_reserved


def test_a_timer_that_rings_early_is_set_again() -> None:
    harness = TaskManagerHarness()
    timer = BidsDue(harness.task.id, 1)
    assert harness.rings(timer, 9.9) == [SetTimer(timer, 10.0)]
