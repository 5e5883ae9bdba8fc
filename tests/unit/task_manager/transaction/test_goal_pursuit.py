"""How a goal is pursued: plans and their steps, one service after the other, and what is done when a step is lost."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.kernel.component import Answered, Ask, Effect, ErrorAnswer, Send, SetTimer, Withdraw
from somrs.ontology.effects import changes
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.plan import Link, NoPlan, Plan
from somrs.protocol.messages import clients, events, frp
from somrs.protocol.messages.clients import Phase
from somrs.protocol.messages.events import GoalKind
from somrs.protocol.messages.frp import Outcome, State
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Progress
from somrs.task_manager.reservations import Reservation
from somrs.task_manager.timers import BidsDue, PlanWanted
from tests.unit.task_manager.test_preview import APART, CHAIN, move
from tests.unit.task_manager.transaction.test_participant_events import BEFORE, ONE, STEP, TWO, WISH, Desk, bodies

BOTH = "Jar001 isOn Platform001 AND Tin001 isOn Platform001"
A, B = ("a", GoalKind.TASK), ("b", GoalKind.TASK)
HELD = "Jar001 isHeldBy Robot1"


def told(desk: Desk, since: int) -> list[object]:
    return [one for one, *_ in desk.news(since)]


def asked(effects: list[Effect]) -> list[tuple[str, float | None, str | None]]:
    """What services were asked for: the effect, from when on, and on what."""
    sent = [one.message.body for one in effects if isinstance(one, Send)]
    return [(body.effect, body.earliest_start, body.precondition) for body in sent if isinstance(body, frp.Arrange)]


def goodbyes(effects: list[Effect]) -> list[str]:
    sent = [one.message.body for one in effects if isinstance(one, Send)]
    return [body.reason for body in sent if isinstance(body, frp.Cancel | frp.Stop)]


def member(desk: Desk, label: str, service: str = ONE) -> Member:
    return [one for one in desk.task.members if (one.label, one.offer.service) == (label, service)][-1]


def terms(desk: Desk, label: str, now: float, first: float, second: float | None = None) -> list[Effect]:
    """Both give terms for the step, at these prices."""
    effects = desk.says(frp.Terms(effect=WISH, price=first, duration=60.0), now, by=member(desk, label))
    if second is not None:
        effects += desk.says(frp.Terms(effect=WISH, price=second, duration=60.0), now, by=member(desk, label, TWO))
    return effects


def chain(**more: object) -> Desk:
    """The first robot does the first step, the second is committed to the second."""
    desk = Desk("Robot1", "Robot2", found=[CHAIN], effect=BOTH, **more)  # type: ignore[arg-type]  # fields of Submit
    effects = terms(desk, "a", 1.0, 10.0, 20.0)
    assert bodies(effects) == ["Accept", "Cancel", "Arrange", "Arrange"]
    assert asked(effects) == [("Tin001 isOn Platform001", 60.0, None)] * 2
    assert (desk.task.phase, [run.progress for run in desk.task.goal]) == (Phase.ARRANGING, [Progress.ARRANGED, Progress.ARRANGING])
    assert bodies(terms(desk, "b", 2.0, 10.0, 5.0)) == ["Cancel", "Accept", "Execute"]
    assert (desk.task.phase, [run.progress for run in desk.task.goal]) == (Phase.EXECUTING, [Progress.EXECUTING, Progress.ARRANGED])
    return desk


def moved(desk: Desk, situation: str) -> None:
    """Somebody else has made it so."""
    desk.replica.map = desk.replica.map.changed(changes(parse(situation), desk.replica.map, desk.replica.ontology))


# Planning


def test_steps_follow_each_other_to_the_goal() -> None:
    desk = chain()
    assert bodies(desk.says(frp.Completed(situation="Jar001 isOn Platform001"), 50.0, by=member(desk, "a"))) == ["UpdateMap", "Execute"]
    assert [run.progress for run in desk.task.goal] == [Progress.COMPLETED, Progress.EXECUTING]
    effects = desk.says(frp.Completed(situation="Tin001 isOn Platform001"), 90.0, by=member(desk, "b", TWO))
    assert (bodies(effects), desk.task.outcome) == (["UpdateMap", "End", "End"], Outcome.ACCOMPLISHED)


def test_what_the_client_said_of_the_beginning_is_about_the_first_plan() -> None:
    desk = Desk(held=True, precondition=BEFORE)
    goal, id = desk.task.goal, desk.task.id
    first = goal.request
    assert first is not None
    assert (first.task, first.question, goal.plans) == (desk.task.task, PlanWanted(id, 1, 0, 1), 1)
    desk.give(Answered(PlanWanted(id, 1, 0, 1), Plan((move("a", "Jar002"),))), 1.0)
    assert (goal.request, desk.task.phase) == (None, Phase.ARRANGING)
    effects = desk.says(frp.Refuse(reason="no"), 2.0)
    assert [one.question for one in effects if isinstance(one, Ask)] == [PlanWanted(id, 1, 1, 1)]
    request = goal.request
    assert request is not None
    assert (request.task.precondition, request.task.effect, goal.plans, desk.task.phase) == (None, WISH, 2, Phase.PLANNING)
    assert desk.give(Answered(PlanWanted(id, 1, 0, 1), CHAIN), 3.0) == [], "that plan is not wanted any more"
    assert goal.request is request


@pytest.mark.parametrize(
    ("found", "why"),
    [
        (ErrorAnswer("out of memory"), "planning failed: out of memory"),
        (NoPlan("none"), "no plan: none"),
    ],
)
def test_a_task_without_a_plan_fails(found: object, why: str) -> None:
    desk = Desk(found=[found])
    assert (desk.task.outcome, desk.task.reasons) == (Outcome.FAILED, (why,))
    assert told(desk, 1) == [events.TaskEnded(outcome=Outcome.FAILED, reasons=(why,))]


def test_why_services_are_not_asked_belongs_to_why_there_is_no_plan() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.says(frp.Refuse(reason="too heavy"), 1.0)
    desk.found = [NoPlan("none", separate_reasons=("none", "never"), lost=(TWO,))]
    desk.says(frp.Refuse(reason="too far"), 2.0, TWO)
    assert desk.task.reasons == ("no plan: none", "never", f"{ONE}: too heavy")
    assert desk.task.services.broken == {ONE: "too heavy", TWO: "too far"}


def test_when_the_registry_cannot_say_who_is_there_the_task_fails() -> None:
    desk = Desk("Robot1")
    desk.registry = frp.Fault(code="env:Receiver", text="it is full")
    desk.says(frp.Refuse(reason="too heavy"), 1.0)
    assert desk.task.reasons == ("the Service Registry answered: it is full",)


# Steps that are lost


def test_a_new_plan_keeps_what_still_stands_of_the_one_before() -> None:
    desk = chain()
    since = len(desk.task.events)
    effects = desk.says(frp.Failed(description="stuck", situation=HELD), 5.0, by=member(desk, "a"))
    assert desk.news(since)[:3] == [
        (events.StepFailed(service=ONE, description="stuck", situation=HELD), *A),
        (events.Replanned(reasons=("failed: stuck",)), None, None),
        (events.Planned(steps=2), None, None),
    ]
    assert bodies(effects) == ["UpdateMap", "Discover", "Arrange"]
    assert [(run.label, run.key, run.progress, run.provider) for run in desk.task.goal] == [
        ("step1", "1.2/step1", Progress.ARRANGING, None),
        ("step2", "1.2/step2", Progress.ARRANGED, "Robot2"),
    ]
    assert member(desk, "b", TWO).step == "1.2/step2"
    assert (desk.task.goal.replans.total, desk.task.goal.replans.fruitless, desk.task.goal.replans.steps) == (1, 1, 2)


def test_whose_step_is_not_in_the_new_plan_is_sent_home() -> None:
    desk = chain()
    desk.found = [Plan((move("c", "Jar002"),))]
    effects = desk.says(frp.Failed(description="stuck", situation=HELD), 5.0, by=member(desk, "a"))
    assert (bodies(effects), goodbyes(effects)) == (["UpdateMap", "Discover", "Cancel", "Arrange"], ["the plan changed"])


def test_a_new_plan_waits_for_what_is_under_way() -> None:
    desk = Desk("Robot1", "Robot2", found=[APART], effect=BOTH)
    terms(desk, "a", 1.0, 10.0, 20.0)
    terms(desk, "b", 2.0, 20.0, 10.0)
    assert [run.progress for run in desk.task.goal] == [Progress.EXECUTING, Progress.EXECUTING]
    since = len(desk.task.events)
    effects = desk.says(frp.Failed(description="stuck", situation=HELD), 5.0, by=member(desk, "a"))
    assert (bodies(effects), told(desk, since)[1:], desk.task.phase) == (["UpdateMap"], [], Phase.RECOVERING)
    assert desk.task.goal.replan_because == ("failed: stuck",)
    since = len(desk.task.events)
    effects = desk.says(frp.Completed(situation="Tin001 isOn Platform001"), 6.0, by=member(desk, "b", TWO))
    assert bodies(effects)[:2] == ["UpdateMap", "Discover"]
    assert told(desk, since)[1] == events.Replanned(reasons=("failed: stuck",))
    assert desk.task.goal.replan_because is None


def test_a_step_that_nobody_takes_is_planned_anew() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.says(frp.Refuse(reason="too heavy"), 1.0)
    since = len(desk.task.events)
    desk.found = [Plan((move("c", "Jar002"),))]
    desk.says(frp.Refuse(reason="too far"), 2.0, TWO)
    why = f"no service takes it ({ONE}: too heavy; {TWO}: too far)"
    assert told(desk, since)[:2] == [events.ServiceRefused(service=TWO, reason="too far"), events.Replanned(reasons=(why,))]
    assert desk.task.services.broken == {ONE: "too heavy", TWO: "too far"}


def test_a_step_that_nobody_offers_any_more_is_planned_anew() -> None:
    desk = Desk("Robot1", "Robot2", found=[CHAIN], effect=BOTH)
    desk.task.services.offers = ()
    since = len(desk.task.events)
    effects = terms(desk, "a", 1.0, 10.0, 20.0)
    assert told(desk, since)[3:5] == [events.Replanned(reasons=("nobody offers it any more",)), events.Planned(steps=2)]
    assert bodies(effects) == ["Accept", "Cancel", "Discover", "Arrange", "Arrange"]


def test_a_step_that_turns_out_to_be_so_is_done() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.executing()
    since = len(desk.task.events)
    desk.says(frp.Failed(description="fell over", situation=WISH), 5.0)
    assert desk.news(since)[:2] == [
        (events.StepFailed(service=ONE, description="fell over", situation=WISH), *STEP),
        (events.FoundSo(), *STEP),
    ]
    assert (desk.task.outcome, [run.progress for run in desk.task.goal]) == (Outcome.ACCOMPLISHED, [Progress.COMPLETED])


def test_the_only_one_that_can_do_it_may_try_again() -> None:
    desk = Desk()
    desk.executing()
    since = len(desk.task.events)
    effects = desk.says(frp.Failed(description="stuck", situation=BEFORE), 5.0)
    assert desk.news(since)[1:] == [
        (events.MayTryAgain(services=(ONE,)), *STEP),
        (events.ServiceReplaced(), *STEP),
        (events.ServicesAsked(services=(ONE,)), *STEP),
    ]
    assert asked(effects) == [(WISH, 5.0, BEFORE)]
    assert (desk.task.services.broken, [run.excluded for run in desk.task.goal], desk.member().number) == ({}, [{}], 2)


def test_a_step_that_cannot_start_any_more_is_planned_anew() -> None:
    desk = Desk("Robot1", "Robot2", found=[APART], effect=BOTH)
    terms(desk, "a", 1.0, 10.0, 20.0)
    moved(desk, HELD)
    since = len(desk.task.events)
    effects = terms(desk, "b", 2.0, 20.0, 10.0)
    assert goodbyes(effects) == ["another service was chosen by price", "its precondition does not hold any more"]
    assert [type(one).__name__ for one in told(desk, since)][2:4] == ["ServiceChosen", "Replanned"]
    (replanned,) = [one for one in told(desk, since) if isinstance(one, events.Replanned)]
    assert replanned.reasons == ("TransferObject cannot start: Jar001 isOn ?Source does not hold",)


def test_a_step_waits_for_its_device_and_says_so_once() -> None:
    desk = Desk(found=[APART], effect=BOTH)
    terms(desk, "a", 1.0, 10.0)
    since = len(desk.task.events)
    assert bodies(terms(desk, "b", 2.0, 10.0)) == ["Accept", "Execute"]
    assert (events.WaitsForDevice(device="Robot1"), *B) in desk.news(since)
    desk.says(frp.Progress(fraction=0.5, situation="Jar001 isHeldBy Robot1"), 3.0, by=member(desk, "a"))
    assert told(desk, since).count(events.WaitsForDevice(device="Robot1")) == 1
    effects = desk.says(frp.Completed(situation="Jar001 isOn Platform001"), 60.0, by=member(desk, "a"))
    assert bodies(effects) == ["UpdateMap", "Execute"]


def test_no_more_than_so_many_steps_are_arranged_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.task_manager.transaction.goal_pursuit.AT_ONCE", 2)
    desk = Desk(found=[Plan((*APART.steps, move("c", "Jar002")))], effect=BOTH)
    assert [one.label for one in desk.task.members] == ["a", "b"]
    assert bodies(terms(desk, "a", 1.0, 10.0)) == ["Accept", "Arrange"]
    assert [one.label for one in desk.task.members] == ["a", "b", "c"]


def test_terms_for_what_is_arranged_already_are_only_remembered() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.executing()
    desk.manager.state.quotes.prices.clear()
    since = len(desk.task.events)
    assert desk.says(frp.Terms(effect=WISH, price=1.0, duration=2.0), 5.0) == []
    assert desk.news(since) == []


# Giving up


def test_a_goal_is_not_planned_anew_for_ever() -> None:
    desk = Desk()
    desk.executing()
    for now in range(20):
        desk.says(frp.Completed(situation=BEFORE), 61.0 + now)
        if desk.task.outcome is not None:
            break
        desk.offer(61.5 + now)
    assert desk.task.reasons[:2] == ("every step was done, but the goal does not hold", "planned anew 9 times already")
    assert [type(one).__name__ for one in told(desk, 0)].count("Replanned") == 9


def test_when_a_plan_is_given_up_nobody_goes_on_with_it() -> None:
    plan = Plan((*CHAIN.steps, move("c", "Jar002")), (Link("a", "b", ""),))
    desk = Desk("Robot1", "Robot2", found=[plan], effect=f"{BOTH} AND {WISH}")
    terms(desk, "a", 1.0, 10.0, 20.0)
    terms(desk, "c", 2.0, 20.0, 10.0)
    terms(desk, "b", 2.0, 20.0, 10.0)
    assert [(run.label, run.progress, run.provider) for run in desk.task.goal] == [
        ("a", Progress.EXECUTING, "Robot1"),
        ("b", Progress.ARRANGED, "Robot2"),
        ("c", Progress.EXECUTING, "Robot2"),
    ]
    desk.task.goal.replans.total = 100
    effects = desk.says(frp.Failed(description="stuck", situation="Jar002 isHeldBy Robot2"), 5.0, by=member(desk, "c", TWO))
    assert (bodies(effects), goodbyes(effects)) == (["UpdateMap", "Stop", "Cancel"], ["the plan was given up"] * 2)
    assert (desk.task.ending, desk.task.reasons) == (Outcome.FAILED, ("failed: stuck", "planned anew 100 times already"))
    assert member(desk, "a").state is State.STOPPING


# Beside the goal of the task


def handling(effect: str, *, held: bool = False) -> Desk:
    """The first of two steps that are under way has failed, and a procedure was laid down for that."""
    desk = Desk("Robot1", "Robot2", found=[APART], effect=BOTH, handlers=(Handler(on=Occasion.FAILURE, effect=effect),))
    terms(desk, "a", 1.0, 10.0, 20.0)
    terms(desk, "b", 2.0, 20.0, 10.0)
    desk.held = held
    desk.says(frp.Failed(description="stuck", situation="Jar001 isOn Cupboard001"), 5.0, by=member(desk, "a"))
    assert (desk.task.phase, [one.kind for one in desk.task.side_goals]) == (Phase.RECOVERING, [GoalKind.HANDLER])
    return desk


def test_what_is_reported_while_a_plan_is_made_has_it_made_again() -> None:
    desk = handling("Jar002 isOn Platform001", held=True)
    id, since = desk.task.id, len(desk.task.events)
    effects = desk.says(frp.Completed(situation="Tin001 isOn Platform001"), 6.0, by=member(desk, "b", TWO))
    assert [one.question for one in effects if isinstance(one, Withdraw)] == [PlanWanted(id, 2, 0, 1)]
    assert [one.question for one in effects if isinstance(one, Ask)] == [PlanWanted(id, 2, 1, 1)]
    assert told(desk, since) == [
        events.StepCompleted(service=TWO, situation="Tin001 isOn Platform001"),
        events.Replanned(reasons=(f"{TWO} reported while it was planned",)),
    ]


def test_a_procedure_is_done_when_what_it_demands_is_so() -> None:
    aside = "Jar002 isOn Platform001"
    desk = handling(aside)
    assert member(desk, "handler2.step1", TWO).step == "2.1/step1"
    since = len(desk.task.events)
    desk.says(frp.Completed(situation="Tin001 isOn Platform001"), 6.0, by=member(desk, "b", TWO))
    desk.offer(7.0, TWO)
    assert member(desk, "handler2.step1", TWO).state is State.EXECUTING
    desk.says(frp.Completed(situation=BEFORE), 60.0, TWO)
    assert events.Replanned(reasons=(f"every step was done, but {aside} does not hold",)) in told(desk, since)
    desk.offer(61.0, TWO)
    since = len(desk.task.events)
    desk.says(frp.Completed(situation=aside), 90.0, TWO)
    assert [type(one).__name__ for one in told(desk, since)] == ["StepCompleted", "ServiceReplaced", "ServicesAsked"]
    assert (desk.task.side_goals, desk.task.phase) == ([], Phase.ARRANGING)


def test_when_a_procedure_is_given_up_nobody_is_asked_for_it_any_more() -> None:
    desk = Desk(
        "Robot1",
        "Robot2",
        found=[APART, Plan((move("x", "Jar002"), move("y", "Jar001")), ())],
        effect=BOTH,
        handlers=(Handler(on=Occasion.FAILURE, effect=f"Jar002 isOn Platform001 AND {WISH}"),),
    )
    terms(desk, "a", 1.0, 10.0, 20.0)
    terms(desk, "b", 2.0, 20.0, 10.0)
    desk.says(frp.Failed(description="stuck", situation="Jar001 isOn Cupboard001"), 5.0, by=member(desk, "a"))
    (aside,) = desk.task.side_goals
    assert [(run.label, run.progress) for run in aside] == [("handler2.x", Progress.ARRANGING), ("handler2.y", Progress.ARRANGING)]
    aside.replans.total = 100
    effects = desk.says(frp.Refuse(reason="too heavy"), 6.0, by=member(desk, "handler2.y", TWO))
    assert (desk.task.side_goals, goodbyes(effects)) == ([], ["the plan was given up"])
    assert member(desk, "handler2.x", TWO).state is State.ENDED


# Waiting for others


def test_who_has_to_wait_lets_go_of_who_is_committed() -> None:
    desk = chain()
    desk.manager.state.reservations.goals["other"] = "another wish"
    desk.manager.state.reservations.held["other"] = Reservation(changes=frozenset({"Jar001"}))
    since = len(desk.task.events)
    effects = desk.says(frp.Failed(description="stuck", situation=HELD), 5.0, by=member(desk, "a"))
    assert (bodies(effects), goodbyes(effects)) == (["UpdateMap", "Discover", "Cancel"], ["the task has to wait for others"])
    waits = events.WaitsForTasks(tasks={"other": "another wish"}, objects=("Jar001",))
    assert told(desk, since)[1:] == [events.Replanned(reasons=("failed: stuck",)), waits]
    assert (desk.task.phase, desk.task.goal.waiting_for, [run.provider for run in desk.task.goal]) == (Phase.WAITING, waits, [None, None])
    reservations = desk.manager.state.reservations
    assert (desk.task.id in reservations.held, [*reservations.waiting]) == (False, [desk.task.id])
    reservations.remove_task("other")
    since = len(desk.task.events)
    effects = desk.says_client(clients.ReadTasks(), 6.0)
    assert [type(one).__name__ for one in told(desk, since)] == ["GoesOn", "Planned", "ServicesAsked", "ServicesAsked"]
    assert bodies(effects)[:2] == ["Tasks", "Discover"]


@pytest.mark.parametrize(("others", "kept"), [("Tin001", True), ("Jar001", False)])
def test_what_is_to_be_undone_is_kept_from_others_unless_they_have_it_by_now(others: str, kept: bool) -> None:
    desk = chain()
    reservations, id = desk.manager.state.reservations, desk.task.id
    reservations.held["other"] = Reservation(changes=frozenset({others}))
    desk.says(frp.Failed(description="stuck", situation=HELD), 5.0, by=member(desk, "a"))
    assert desk.task.phase is Phase.WAITING
    since = len(desk.task.events)
    effects = desk.says_client(clients.CancelTask(task=id), 6.0)
    assert reservations.held.get(id) == (Reservation(changes=frozenset({"Jar001"})) if kept else None)
    assert ("Compensate" in bodies(effects)) is kept
    assert ((events.WorkStranded(taken=True), *A) in desk.news(since)) is not kept


def test_a_timer_that_rings_early_is_set_again() -> None:
    desk = Desk()
    timer = BidsDue(desk.task.id, 1)
    assert desk.rings(timer, 9.9) == [SetTimer(timer, 10.0)]
