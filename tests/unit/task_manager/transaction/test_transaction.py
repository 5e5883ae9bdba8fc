"""How a task goes from one thing to the next: looking, what is laid down, waiting for others, stopping, and its end."""

from __future__ import annotations

import pytest

from somrs.kernel.component import Answered, Effect, Received, Record, Send, SetTimer, Started, Withdraw
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.plan import NoPlan
from somrs.protocol.messages import clients, events, frp
from somrs.protocol.messages.clients import Phase, Submit
from somrs.protocol.messages.directory import Discovered, Offer
from somrs.protocol.messages.envelope import reply
from somrs.protocol.messages.events import GoalKind
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.records import TaskRecord
from somrs.task_manager.reservations import Reservation
from somrs.task_manager.timers import BidsDue, DeadlineDue, OverdueDue, PlanWanted, StopDue
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.transaction import new_task
from somrs.task_manager.transaction.views import row, view
from tests.unit.task_manager.transaction.test_participant_events import BEFORE, ONE, STEP, TWO, WISH, Desk, bodies
from tests.unit.task_manager.transaction.test_undoing import undoing

EYE = "Robot3.RecognizeSituation"
LOOK = ("look2.step1", GoalKind.LOOK)
THERE = "Jar002 isOn Cupboard002 AND Jar002.Unknown = FALSE"
BACK = f"{BEFORE} AND Jar002.Unknown = FALSE"


def told(desk: Desk, since: int) -> list[object]:
    return [one for one, *_ in desk.news(since)]


def kinds(desk: Desk, since: int) -> list[str]:
    return [type(one).__name__ for one in told(desk, since)]


def wakes(effects: list[Effect]) -> list[tuple[str, float | None]]:
    """The timers of the task itself."""
    own = (one for one in effects if isinstance(one, SetTimer) and isinstance(one.timer, DeadlineDue | StopDue))
    return [(type(one.timer).__name__, one.at) for one in own]


def looking() -> tuple[Desk, int]:
    """The first robot failed, and nothing is known of what it left; the third can look. How many events came before."""
    desk = Desk("Robot1", "Robot2")
    desk.executing()
    recognize = desk.replica.ontology.services["RecognizeSituation"]
    desk.offers += (Offer(service=EYE, provider="Robot3", provider_type="PioneerP3DX", address="Robot3", service_type=recognize),)
    since = len(desk.task.events)
    effects = desk.says(frp.Failed(description="stuck"), 5.0)
    assert bodies(effects) == ["Discover", "Arrange"]
    assert desk.news(since) == [
        (events.StepFailed(service=ONE, description="stuck"), *STEP),
        (events.LookBegun(service_type="RecognizeSituation", object="Jar002"), *STEP),
        (events.ServicesAsked(services=(EYE,)), *LOOK),
    ]
    assert desk.task.phase is Phase.RECOVERING
    return desk, len(desk.task.events)


# Beginning


def test_a_task_that_was_just_stated_is_nobodys_and_has_one_goal() -> None:
    task = new_task("t", Submit(effect=WISH), 3.0)
    assert (task.id, task.client, task.submitted_at, task.goal_count, [*task.executions]) == ("t", "", 3.0, 1, [task.goal])
    assert (task.goal.number, task.goal.goal, task.goal.kind, task.goal.calls.timer) == (1, WISH, GoalKind.TASK, BidsDue("t", 1))


@pytest.mark.parametrize(("deadline", "timers"), [(None, []), (50.0, [("DeadlineDue", 53.0)])])
def test_a_task_begins_with_its_deadline_and_its_place_in_the_order(deadline: float | None, timers: list[tuple[str, float]]) -> None:
    desk = Desk()
    effects = desk.says_client(Submit(effect="Jar001 isOn Platform001", deadline=deadline, priority=4), 3.0)
    assert wakes(effects) == timers
    first, second = desk.manager.open
    reservations = desk.manager.state.reservations
    assert (reservations.goals, reservations.priorities) == ({second: "Jar001 isOn Platform001", first: WISH}, {second: 4, first: 0})
    assert [*reservations.goals] == [second, first]


def test_what_concerns_a_goal_that_is_no_more_changes_nothing() -> None:
    desk = Desk()
    id, since = desk.task.id, len(desk.task.events)
    assert desk.rings(BidsDue(id, 7), 10.0) == []
    assert desk.give(Answered(PlanWanted(id, 7, 0, 1), NoPlan("none")), 10.0) == []
    assert desk.give(Answered(PlanWanted(id, 1, 0, 1), NoPlan("none")), 10.0) == [], "it was answered before"
    assert len(desk.task.events) == since


# Looking


def test_what_was_looked_at_is_what_the_step_begins_with() -> None:
    desk, since = looking()
    assert bodies(desk.offer(6.0, EYE)) == ["Accept", "Execute"]
    since = len(desk.task.events)
    effects = desk.says(frp.Completed(situation=THERE), 7.0, EYE)
    assert bodies(effects) == ["UpdateMap", "Arrange"]
    assert desk.news(since) == [
        (events.StepCompleted(service=EYE, situation=THERE), *LOOK),
        (events.LookFound(situation=THERE), *STEP),
        (events.ServiceReplaced(), *STEP),
        (events.ServicesAsked(services=(TWO,)), *STEP),
    ]
    assert desk.reports == [UpdateMap(situation=THERE, author=EYE)]
    first, second = desk.task.log.works
    assert (first.situation, first.state, second.label, second.goal) == (THERE, State.FAILED, "look2.step1", GoalKind.LOOK)
    (run,) = desk.task.goal
    assert (str(run.reported), desk.task.side_goals, desk.task.phase) == (THERE, [], Phase.ARRANGING)
    (arrange,) = [one.message.body for one in effects if isinstance(one, Send) and isinstance(one.message.body, frp.Arrange)]
    assert arrange.precondition == THERE


@pytest.mark.parametrize("refuses", [True, False])
def test_when_nobody_can_look_the_map_says_that_nothing_is_known(refuses: bool) -> None:
    desk, since = looking()
    desk.says(frp.Refuse(reason="blind"), 6.0, EYE) if refuses else desk.rings(BidsDue(desk.task.id, 2), 15.0)
    why = f"no service takes it ({EYE}: {'blind' if refuses else 'did not answer'})"
    assert events.GoalFailed(goal=GoalKind.LOOK, step="step1", reasons=(why,)) in told(desk, since)
    assert (events.NobodyLooks(object="Jar002"), *STEP) in desk.news(since)
    (report,) = desk.reports
    assert (report.author, report.situation, report.expected_version) == ("nobody could look", None, 0)
    assert desk.replica.map.objects["Jar002"].values["Unknown"] is True
    assert (desk.task.side_goals, desk.task.look_queue.unseen, desk.task.look_queue.look_count) == ([], [], 1)


def test_a_map_that_does_not_take_it_knows_otherwise() -> None:
    desk, since = looking()
    desk.rejects = ("it changed since",)
    desk.says(frp.Refuse(reason="blind"), 6.0, EYE)
    assert (events.KnownOtherwise(object="Jar002", problems=("it changed since",)), *STEP) in desk.news(since)


def test_a_look_that_was_called_off_is_begun_anew_before_anything_is_undone() -> None:
    desk, since = looking()
    effects = desk.says_client(clients.CancelTask(task=desk.task.id), 6.0)
    assert bodies(effects) == ["Cancel", "Discover", "Cancelling", "Arrange"]
    assert wakes(effects) == [("DeadlineDue", None), ("StopDue", 66.0)]
    assert kinds(desk, since) == ["Stopping", "LookBegun", "ServicesAsked"]
    assert [wake.timer for wake in effects if isinstance(wake, SetTimer) and isinstance(wake.timer, BidsDue)] == [
        BidsDue(desk.task.id, 2),
        BidsDue(desk.task.id, 3),
    ]
    assert [(one.number, one.goal) for one in desk.task.side_goals] == [(3, "Jar002.Unknown = FALSE")]
    desk.offer(7.0, EYE)
    since = len(desk.task.events)
    effects = desk.says(frp.Completed(situation=BACK), 8.0, EYE)
    assert kinds(desk, since) == ["StepCompleted", "LookFound", "WorkUndone", "TaskEnded"]
    assert bodies(effects) == ["UpdateMap", "End", "End"]
    assert desk.task.outcome is Outcome.CANCELLED


def test_a_look_for_which_nobody_was_found_yet_is_begun_anew_too() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.executing()
    effects = desk.manager.handle(Received(desk.message(frp.Failed(description="stuck"))), 5.0)
    (discover,) = [one.message for one in effects if isinstance(one, Send)]
    assert desk.task.phase is Phase.RECOVERING
    since = len(desk.task.events)
    assert bodies(desk.says_client(clients.CancelTask(task=desk.task.id), 6.0)) == ["Discover", "Cancelling", "UpdateMap", "Compensate"]
    assert kinds(desk, since)[:2] == ["Stopping", "NobodyLooks"]
    assert (desk.task.look_queue.look_count, desk.task.look_queue.current_look, desk.task.look_queue.unseen) == (2, None, [])
    late = desk.give(Received(reply(discover, Discovered(offers=desk.offers), "registry")), 7.0)
    assert [type(one).__name__ for one in late] == ["Wake"], "it was asked for the look that was called off"


# What is laid down


def test_a_procedure_that_cannot_be_had_is_told_of_and_the_step_is_recovered() -> None:
    aside = "Jar001 isOn Platform001"
    desk = Desk("Robot1", "Robot2", handlers=(Handler(on=Occasion.FAILURE, effect=aside),))
    desk.executing()
    since = len(desk.task.events)
    desk.found = [NoPlan("none"), NoPlan("none at all", separate_reasons=("none at all", "never"))]
    desk.says(frp.Failed(description="stuck", situation=BEFORE), 5.0)
    assert desk.news(since) == [
        (events.StepFailed(service=ONE, description="stuck", situation=BEFORE), *STEP),
        (events.HandlerBegun(effect=aside), *STEP),
        (events.TriedOnceMore(services=(ONE,)), None, None),
        (events.GoalFailed(goal=GoalKind.HANDLER, step="step1", reasons=("no plan: none at all", "never")), None, None),
        (events.ServiceReplaced(), *STEP),
        (events.ServicesAsked(services=(TWO,)), *STEP),
    ]
    assert (desk.task.side_goals, desk.task.goal_count, desk.task.setbacks) == ([], 2, 2)


def test_a_procedure_needs_nothing_that_others_have() -> None:
    aside = "Jar001 isOn Platform001"
    desk = Desk("Robot1", "Robot2", handlers=(Handler(on=Occasion.FAILURE, effect=aside),))
    task = desk.task
    desk.executing()
    desk.manager.state.reservations.hold("other", Reservation(changes=frozenset({"Jar001"})))
    since = len(task.events)
    desk.says(frp.Failed(description="stuck", situation=BEFORE), 5.0)
    assert (events.GoalFailed(goal=GoalKind.HANDLER, step="step1", reasons=("other tasks have Jar001",)), None, None) in desk.news(since)


def test_no_procedure_is_begun_for_what_failed_while_the_task_ends() -> None:
    desk = Desk("Robot1", "Robot2", handlers=(Handler(on=Occasion.FAILURE, effect="Jar001 isOn Platform001"),))
    desk.executing()
    desk.says_client(clients.CancelTask(task=desk.task.id), 5.0)
    since = len(desk.task.events)
    desk.says(frp.Failed(description="stuck", situation=BEFORE), 6.0)
    assert kinds(desk, since) == ["StepFailed", "WorkUndone", "TaskEnded"]
    assert desk.task.outcome is Outcome.CANCELLED


# Waiting for others


def waits() -> tuple[Desk, TaskState, TaskState]:
    """The second task wants what the first has."""
    desk = Desk("Robot1", "Robot2")
    first = desk.task
    effects = desk.says_client(Submit(effect="Jar002 isOn Cupboard002", deadline=90.0), 3.0)
    (second,) = [task for task in desk.manager.state.tasks.values() if task is not first]
    assert bodies(effects) == ["Discover", "Submitted"]
    event = events.WaitsForTasks(tasks={first.id: WISH}, objects=("Jar002",))
    assert [one.event for one in second.events[1:]] == [event]
    assert (second.phase, second.goal.waiting_for) == (Phase.WAITING, event)
    return desk, first, second


def test_who_waits_for_another_goes_on_when_that_one_has_ended() -> None:
    desk, first, second = waits()
    why = f"waiting for task {first.id} ({WISH}) to end, which has Jar002"
    assert (view(second).reasons, view(second).explanation, row(second).reasons, row(second).explanation) == ((why,), why, (why,), why)
    effects = desk.says_client(clients.CancelTask(task=first.id), 4.0)
    assert bodies(effects) == ["Cancel", "Cancel", "Cancelling", "Discover", "Arrange", "Arrange"]
    assert [type(one.event).__name__ for one in second.events[2:]] == ["GoesOn", "Planned", "ServicesAsked"]
    assert (second.phase, second.goal.waiting_for, second.goal.resumed, view(second).reasons) == (Phase.ARRANGING, None, False, ())


def test_who_never_got_what_it_waited_for_says_so() -> None:
    desk, first, second = waits()
    effects = desk.rings(DeadlineDue(second.id), 93.0)
    waited = f"it was waiting for task {first.id} ({WISH}) to end, which has Jar002"
    assert (second.outcome, second.reasons) == (Outcome.FAILED, ("the deadline of 90 s is over", waited))
    assert [one.entry.reasons for one in effects if isinstance(one, Record) and isinstance(one.entry, TaskRecord)] == [second.reasons]
    assert [*desk.manager.state.reservations.waiting] == []
    assert bodies(desk.says_client(clients.CancelTask(task=first.id), 94.0)) == ["Cancel", "Cancel", "Cancelling"]


# Going on


def test_when_the_time_to_answer_is_over_the_best_of_what_came_is_taken() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.offer(1.0, TWO)
    since = len(desk.task.events)
    assert bodies(desk.rings(BidsDue(desk.task.id, 1), 10.0)) == ["Cancel", "Accept", "Execute"]
    assert told(desk, since) == [
        events.ServiceChosen(service=TWO, price=10.0, currency="EUR", duration=60.0),
        events.StepStarted(service=TWO),
    ]
    assert [run.excluded for run in desk.task.goal] == [{ONE: "did not answer"}]


def test_a_task_manager_that_was_away_asks_anew() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.offer(1.0, TWO)
    since = len(desk.task.events)
    effects = desk.give(Started("tm"), 5.0)
    assert bodies(effects) == ["SubscribeMap", "Cancel", "Cancel", "Arrange", "Arrange"]
    reasons = {one.message.body.reason for one in effects if isinstance(one, Send) and isinstance(one.message.body, frp.Cancel)}
    assert reasons == {"the Task Manager was away, and asks anew"}
    assert told(desk, since) == [events.ServicesAsked(services=(ONE, TWO))]
    assert [one.at for one in effects if isinstance(one, SetTimer) and isinstance(one.timer, BidsDue)] == [None, 15.0]


def test_a_plan_that_is_not_wanted_any_more_is_not_waited_for() -> None:
    desk = Desk(held=True, deadline=50.0)
    id = desk.task.id
    effects = desk.rings(DeadlineDue(id), 50.0)
    assert [one.question for one in effects if isinstance(one, Withdraw)] == [PlanWanted(id, 1, 0, 1)]
    assert wakes(effects) == [("DeadlineDue", None), ("StopDue", 110.0), ("StopDue", None), ("DeadlineDue", None), ("StopDue", None)]
    assert (desk.task.goal.request, desk.task.outcome, desk.task.goal.calls.pending) == (None, Outcome.FAILED, {})


# Ending


def test_a_task_that_is_over_hears_of_nothing_more() -> None:
    desk = Desk(deadline=500.0)
    desk.executing()
    member = desk.member()
    desk.says(frp.Completed(situation=WISH), 40.0)
    since, id = len(desk.task.events), desk.task.id
    for timer in (DeadlineDue(id), StopDue(id), BidsDue(id, 1), OverdueDue(id, member.id)):
        assert desk.rings(timer, 500.0) == []
    assert bodies(desk.says_client(clients.CancelTask(task=id), 501.0)) == ["Cancelling"]
    assert (desk.task.outcome, desk.news(since), desk.task.reasons) == (Outcome.ACCOMPLISHED, [], ())


def test_the_time_to_stop_matters_to_none_that_goes_on() -> None:
    desk = Desk()
    desk.executing()
    assert desk.rings(StopDue(desk.task.id), 50.0) == []
    assert desk.member().state is State.EXECUTING


def test_what_is_kept_of_a_task_is_recorded_at_its_end() -> None:
    desk = Desk("Robot1", "Robot2", deadline=90.0, priority=2, time_value=0.5)
    desk.executing()
    effects = desk.says(frp.Completed(situation=WISH), 40.0)
    (record,) = [one.entry for one in effects if isinstance(one, Record)]
    assert isinstance(record, TaskRecord)
    assert (record.task, record.client, record.effect, record.outcome) == (desk.task.id, "client", WISH, Outcome.ACCOMPLISHED)
    assert (record.submitted_at, record.ended_at, record.deadline, record.priority, record.time_value) == (0.0, 40.0, 90.0, 2, 0.5)
    assert [(event.number, event.at) for event in record.events] == [
        (1, 0.0), (2, 0.0), (3, 0.0), (4, 1.0), (5, 2.0), (6, 2.0), (7, 2.0), (8, 40.0), (9, 40.0),
    ]  # fmt: skip
    assert [one.type for one in record.messages] == [
        "Arrange", "Arrange", "Terms", "Terms", "Accept", "Cancel", "Execute", "Completed", "End",
    ]  # fmt: skip
    assert [(one.number, one.service, one.state, one.accepted, one.reason) for one in record.contracts] == [
        (1, ONE, State.COMPLETED, True, ""),
        (2, TWO, State.ENDED, False, "another service was chosen by price"),
    ]
    assert [(one.start, one.finish, one.price, one.currency, one.duration) for one in record.contracts] == [
        (0.0, 60.0, 10.0, "EUR", 60.0),
        (0.0, 60.0, 11.0, "EUR", 60.0),
    ]
    assert ([*desk.task.members], desk.task.messages) == ([], [])
    assert [member.offer.service for member in desk.task.members.former.values()] == [ONE]
    (step,) = view(desk.task).steps
    assert (step.service, step.state, step.price) == (ONE, State.COMPLETED, 10.0)


def test_one_that_still_undoes_its_work_when_everybody_should_have_stopped_is_sent_home() -> None:
    desk, member, since = undoing()
    id = desk.task.id
    held = desk.manager.state.reservations.held[id]
    assert "Jar002" in held.changes, "nobody else has to do with what is being undone"
    effects = desk.rings(StopDue(id), 130.0)
    assert bodies(effects) == ["End"]
    assert [one.at for one in effects if isinstance(one, SetTimer) and one.timer == OverdueDue(id, member.id)] == [None, 150.0]
    assert (member.halting, desk.task.outcome, desk.news(since)) == (True, None, [])
    assert desk.rings(StopDue(id), 131.0) == []
    effects = desk.rings(OverdueDue(id, member.id), 150.0)
    assert bodies(effects) == ["Discover", "UpdateMap", "Discover"]
    told_ = desk.news(since)
    assert [type(one).__name__ for one, *_ in told_] == [
        "ServiceLost", "NobodyLooks", "UndoneByOthers", "GoalFailed", "WorkStranded", "TaskEnded",
    ]  # fmt: skip
    assert told_[0] == (events.ServiceLost(service=ONE), None, None)
    assert told_[4] == (events.WorkStranded(reason="did not come to an end"), *STEP)
    (work,) = desk.task.log.works
    assert (work.state, work.result, work.note) == (State.STRANDED, State.COMPLETED, "did not come to an end")
    assert desk.manager.state.reservations.held == {}
