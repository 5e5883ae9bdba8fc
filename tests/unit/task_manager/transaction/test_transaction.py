"""How a task goes from one thing to the next: looking, what is laid down, waiting for others, stopping, and its end."""

from __future__ import annotations

import pytest

from somrs.kernel.component import Answered, Effect, Record, Send, SetTimer, Started, Withdraw
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.plan import NoPlan
from somrs.protocol.messages import events, frp, submission
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import Phase
from somrs.protocol.messages.waits import Holder, WaitsForTasks
from somrs.task_manager.timers import BidsDue, DeadlineDue, DiscoveryDue, OverdueDue, PlanWanted, StopDue
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.views import row, view
from tests.unit.task_manager.transaction.test_participant_events import (
    FIRST_SERVICE,
    GOAL,
    INITIAL_SITUATION,
    SECOND_SERVICE,
    STEP,
    TaskManagerHarness,
    bodies,
)
from tests.unit.task_manager.transaction.test_undoing import start_undoing

EYE = "Robot3.RecognizeSituation"
LOOK = ("look2.step1", GoalKind.LOOK)
FOUND_ELSEWHERE = "Jar002 isOn Cupboard002 AND Jar002.Unknown = FALSE"
FOUND_IN_PLACE = f"{INITIAL_SITUATION} AND Jar002.Unknown = FALSE"


def logged_events(harness: TaskManagerHarness, event_count: int) -> list[object]:
    return [event for event, *_ in harness.news(event_count)]


def kinds(harness: TaskManagerHarness, event_count: int) -> list[str]:
    return [type(event).__name__ for event in logged_events(harness, event_count)]


def timer_times(effects: list[Effect]) -> list[tuple[str, float | None]]:
    """The timers of the task itself."""
    task_timers = (effect for effect in effects if isinstance(effect, SetTimer) and isinstance(effect.timer, DeadlineDue | StopDue))
    return [(type(effect.timer).__name__, effect.at) for effect in task_timers]


def start_look() -> tuple[TaskManagerHarness, int]:
    """The first robot failed, and nothing is known of what it left; the third can look. How many events came before."""
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.executing()
    recognize = harness.replica.ontology.services["RecognizeSituation"]
    harness.offers += (Offer(service=EYE, provider="Robot3", provider_type="PioneerP3DX", address="Robot3", service_type=recognize),)
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Failed(description="stuck"), 5.0)
    assert bodies(effects) == ["Arrange"]
    assert harness.news(event_count) == [
        (events.StepFailed(service=FIRST_SERVICE, description="stuck"), *STEP),
        (events.LookBegun(service_type="RecognizeSituation", object="Jar002"), *STEP),
        (events.ServicesAsked(services=(EYE,)), *LOOK),
    ]
    assert harness.task.phase is Phase.RECOVERING
    return harness, len(harness.task.events)


# Beginning


def test_a_task_that_was_just_stated_is_nobodys_and_has_one_goal() -> None:
    task = TaskState.new("t", Submit(effect=GOAL), 3.0)
    assert (task.id, task.client, task.submitted_at, task.goal_count, [*task.executions]) == ("t", "", 3.0, 1, [task.goal])
    assert (task.goal.number, task.goal.goal, task.goal.kind, task.goal.calls.timer) == (1, GOAL, GoalKind.TASK, BidsDue("t", 1))


@pytest.mark.parametrize(("deadline", "timers"), [(None, []), (50.0, [("DeadlineDue", 53.0)])])
def test_a_task_begins_with_its_deadline_and_its_priority(deadline: float | None, timers: list[tuple[str, float]]) -> None:
    harness = TaskManagerHarness()
    effects = harness.client_says(Submit(effect="Jar001 isOn Platform001", deadline=deadline, priority=4), 3.0)
    assert timer_times(effects) == timers
    known = harness.reservations.claimants
    assert [(known[task].goal, known[task].priority) for task in harness.manager.open] == [(GOAL, 0), ("Jar001 isOn Platform001", 4)]


def test_what_concerns_a_goal_that_is_no_more_changes_nothing() -> None:
    harness = TaskManagerHarness()
    id, event_count = harness.task.id, len(harness.task.events)
    assert harness.rings(BidsDue(id, 7), 10.0) == []
    assert harness.feed(Answered(PlanWanted(id, 7, 0, 1), NoPlan("none")), 10.0) == []
    assert harness.feed(Answered(PlanWanted(id, 1, 0, 1), NoPlan("none")), 10.0) == [], "it was answered before"
    assert len(harness.task.events) == event_count


# Looking


def test_what_was_looked_at_is_what_the_step_begins_with() -> None:
    harness, event_count = start_look()
    assert bodies(harness.offer(6.0, EYE)) == ["Accept", "Execute"]
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Completed(situation=FOUND_ELSEWHERE), 7.0, EYE)
    assert bodies(effects) == ["UpdateMap", "Arrange"]
    assert harness.news(event_count) == [
        (events.StepCompleted(service=EYE, situation=FOUND_ELSEWHERE), *LOOK),
        (events.LookFound(situation=FOUND_ELSEWHERE), *STEP),
        (events.ServiceReplaced(), *STEP),
        (events.ServicesAsked(services=(SECOND_SERVICE,)), *STEP),
    ]
    assert harness.reports == [UpdateMap(situation=FOUND_ELSEWHERE, author=EYE)]
    first, second = harness.task.log.works
    assert (first.situation, first.state, second.label, second.goal) == (FOUND_ELSEWHERE, State.FAILED, "look2.step1", GoalKind.LOOK)
    (run,) = harness.task.goal
    assert (str(run.reported), harness.task.side_goals, harness.task.phase) == (FOUND_ELSEWHERE, [], Phase.ARRANGING)
    (arrange,) = [effect.message.body for effect in effects if isinstance(effect, Send) and isinstance(effect.message.body, frp.Arrange)]
    assert arrange.precondition == "Jar002 isOn Cupboard002 AND Platform001.Supporting = TRUE AND Jar002.Unknown = FALSE"


@pytest.mark.parametrize("refuses", [True, False])
def test_when_nobody_can_look_the_map_says_that_nothing_is_known(refuses: bool) -> None:
    harness, event_count = start_look()
    harness.service_says(frp.Refuse(reason="blind"), 6.0, EYE) if refuses else harness.rings(BidsDue(harness.task.id, 2), 15.0)
    reason = f"no service takes it ({EYE}: {'blind' if refuses else 'did not answer'})"
    assert events.GoalFailed(goal=GoalKind.LOOK, step="step1", reasons=(reason,)) in logged_events(harness, event_count)
    assert (events.NobodyLooks(object="Jar002"), *STEP) in harness.news(event_count)
    (report,) = harness.reports
    assert (report.author, report.situation, report.expected_version) == ("nobody could look", None, 0)
    assert harness.replica.map.objects["Jar002"].values["Unknown"] is True
    assert (harness.task.side_goals, harness.task.look_queue.unseen, harness.task.look_queue.look_count) == ([], [], 1)


def test_a_map_that_does_not_take_it_knows_otherwise() -> None:
    harness, event_count = start_look()
    harness.rejects = ("it changed since",)
    harness.service_says(frp.Refuse(reason="blind"), 6.0, EYE)
    assert (events.KnownOtherwise(object="Jar002", problems=("it changed since",)), *STEP) in harness.news(event_count)


def test_a_look_that_was_called_off_is_begun_anew_before_anything_is_undone() -> None:
    harness, event_count = start_look()
    effects = harness.client_says(submission.CancelTask(task=harness.task.id), 6.0)
    assert bodies(effects) == ["Cancel", "Cancelling", "Arrange"]
    assert timer_times(effects) == [("DeadlineDue", None), ("StopDue", 66.0)]
    assert kinds(harness, event_count) == ["Stopping", "LookBegun", "ServicesAsked"]
    assert [wake.timer for wake in effects if isinstance(wake, SetTimer) and isinstance(wake.timer, BidsDue)] == [
        BidsDue(harness.task.id, 2),
        BidsDue(harness.task.id, 3),
    ]
    assert [(side_goal.number, side_goal.goal) for side_goal in harness.task.side_goals] == [(3, "Jar002.Unknown = FALSE")]
    harness.offer(7.0, EYE)
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Completed(situation=FOUND_IN_PLACE), 8.0, EYE)
    assert kinds(harness, event_count) == ["StepCompleted", "LookFound", "WorkUndone", "TaskEnded"]
    assert bodies(effects) == ["UpdateMap", "End", "End"]
    assert harness.task.outcome is Outcome.CANCELLED


def test_a_look_for_which_nobody_was_found_yet_is_begun_anew_too() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.executing()
    harness.answers_version = False
    assert harness.service_says(frp.Failed(description="stuck"), 5.0)
    assert harness.task.phase is Phase.RECOVERING
    event_count = len(harness.task.events)
    assert bodies(harness.client_says(submission.CancelTask(task=harness.task.id), 6.0)) == ["Cancelling"]
    harness.directory.known_since = 7.0
    assert bodies(harness.rings(DiscoveryDue(), 7.0)) == ["UpdateMap", "Compensate"]
    assert kinds(harness, event_count)[:2] == ["Stopping", "NobodyLooks"]
    assert (harness.task.look_queue.look_count, harness.task.look_queue.current_look, harness.task.look_queue.unseen) == (2, None, [])


# What is laid down


def test_a_procedure_that_cannot_be_had_is_told_of_and_the_step_is_recovered() -> None:
    aside = "Jar001 isOn Platform001"
    harness = TaskManagerHarness("Robot1", "Robot2", handlers=(Handler(on=Occasion.FAILURE, effect=aside),))
    harness.executing()
    event_count = len(harness.task.events)
    harness.plan_results = [NoPlan("none"), NoPlan("none at all", separate_reasons=("none at all", "never"))]
    harness.service_says(frp.Failed(description="stuck", situation=INITIAL_SITUATION), 5.0)
    assert harness.news(event_count) == [
        (events.StepFailed(service=FIRST_SERVICE, description="stuck", situation=INITIAL_SITUATION), *STEP),
        (events.HandlerBegun(effect=aside), *STEP),
        (events.TriedOnceMore(services=(FIRST_SERVICE,)), None, None),
        (events.GoalFailed(goal=GoalKind.HANDLER, step="step1", reasons=("no plan: none at all", "never")), None, None),
        (events.ServiceReplaced(), *STEP),
        (events.ServicesAsked(services=(SECOND_SERVICE,)), *STEP),
    ]
    assert (harness.task.side_goals, harness.task.goal_count, harness.task.setbacks) == ([], 2, 2)


def test_a_procedure_needs_nothing_that_others_have() -> None:
    aside = "Jar001 isOn Platform001"
    harness = TaskManagerHarness("Robot1", "Robot2", handlers=(Handler(on=Occasion.FAILURE, effect=aside),))
    task = harness.task
    harness.executing()
    harness.reserve_elsewhere("Jar001")
    event_count = len(task.events)
    harness.service_says(frp.Failed(description="stuck", situation=INITIAL_SITUATION), 5.0)
    assert (
        events.GoalFailed(goal=GoalKind.HANDLER, step="step1", reasons=("task other has reserved Jar001",)),
        None,
        None,
    ) in harness.news(event_count)


def test_no_procedure_is_begun_for_what_failed_while_the_task_ends() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2", handlers=(Handler(on=Occasion.FAILURE, effect="Jar001 isOn Platform001"),))
    harness.executing()
    harness.client_says(submission.CancelTask(task=harness.task.id), 5.0)
    event_count = len(harness.task.events)
    harness.service_says(frp.Failed(description="stuck", situation=INITIAL_SITUATION), 6.0)
    assert kinds(harness, event_count) == ["StepFailed", "WorkUndone", "TaskEnded"]
    assert harness.task.outcome is Outcome.CANCELLED


# Waiting for others


def waits() -> tuple[TaskManagerHarness, TaskState, TaskState]:
    """The second task wants what the first has."""
    harness = TaskManagerHarness("Robot1", "Robot2")
    first = harness.task
    effects = harness.client_says(Submit(effect="Jar002 isOn Cupboard002", deadline=90.0), 3.0)
    (second,) = [task for task in harness.manager.state.tasks.values() if task is not first]
    assert bodies(effects) == ["Submitted"]
    holders = (Holder(task=first.id, goal=GOAL, objects=("Jar002",)),)
    event = WaitsForTasks(tasks={first.id: GOAL}, objects=("Jar002",), holders=holders)
    assert [entry.event for entry in second.events[1:]] == [event]
    assert (second.phase, second.goal.waiting_for) == (Phase.WAITING, event)
    return harness, first, second


def test_who_waits_for_another_goes_on_when_that_one_has_ended() -> None:
    harness, first, second = waits()
    reason = f"waiting for task {short_id(first.id)} ({GOAL}), which has reserved Jar002"
    assert view(second).waiting_for == row(second).waiting_for == second.goal.waiting_for
    assert (view(second).reasons, view(second).explanation, row(second).reasons, row(second).explanation) == (
        (reason,),
        reason,
        (reason,),
        reason,
    )
    effects = harness.client_says(submission.CancelTask(task=first.id), 4.0)
    assert bodies(effects) == ["Cancel", "Cancel", "Cancelling", "Arrange", "Arrange"]
    assert [type(entry.event).__name__ for entry in second.events[2:]] == ["GoesOn", "Planned", "ServicesAsked"]
    assert (second.phase, second.goal.waiting_for, second.goal.resumed, view(second).reasons) == (Phase.ARRANGING, None, False, ())
    assert view(second).waiting_for is None


def test_who_never_got_what_it_waited_for_says_so() -> None:
    harness, first, second = waits()
    effects = harness.rings(DeadlineDue(second.id), 93.0)
    waited = f"it was waiting for task {short_id(first.id)} ({GOAL}), which has reserved Jar002"
    assert (second.outcome, second.reasons) == (Outcome.FAILED, ("the deadline of 90 s is over", waited))
    assert [effect.entry.reasons for effect in effects if isinstance(effect, Record) and isinstance(effect.entry, TaskRecord)] == [
        second.reasons
    ]
    assert [*harness.reservations.claimants] == [first.id]
    assert bodies(harness.client_says(submission.CancelTask(task=first.id), 94.0)) == ["Cancel", "Cancel", "Cancelling"]


# Going on


def test_when_the_time_to_answer_is_over_the_best_of_what_came_is_taken() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.offer(1.0, SECOND_SERVICE)
    event_count = len(harness.task.events)
    assert bodies(harness.rings(BidsDue(harness.task.id, 1), 10.0)) == ["Cancel", "Accept", "Execute"]
    assert logged_events(harness, event_count) == [
        events.ServiceChosen(service=SECOND_SERVICE, price=10.0, currency="EUR", duration=60.0),
        events.StepStarted(service=SECOND_SERVICE),
    ]
    assert [run.excluded for run in harness.task.goal] == [{FIRST_SERVICE: "did not answer"}]


def test_a_task_manager_that_was_away_asks_anew() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.offer(1.0, SECOND_SERVICE)
    event_count, harness.answers_version = len(harness.task.events), False
    effects = harness.feed(Started("tm"), 5.0)
    assert bodies(effects) == ["SubscribeServices", "SubscribeMap", "Cancel", "Cancel", "Arrange", "Arrange"]
    reasons = {effect.message.body.reason for effect in effects if isinstance(effect, Send) and isinstance(effect.message.body, frp.Cancel)}
    assert reasons == {"the Task Manager restarted, and asks again"}
    assert logged_events(harness, event_count) == [events.ServicesAsked(services=(FIRST_SERVICE, SECOND_SERVICE))]
    assert [effect.at for effect in effects if isinstance(effect, SetTimer) and isinstance(effect.timer, BidsDue)] == [None, 15.0]


def test_a_plan_that_is_not_wanted_any_more_is_not_waited_for() -> None:
    harness = TaskManagerHarness(held=True, deadline=50.0)
    id = harness.task.id
    effects = harness.rings(DeadlineDue(id), 50.0)
    assert [effect.question for effect in effects if isinstance(effect, Withdraw)] == [PlanWanted(id, 1, 0, 1)]
    assert timer_times(effects) == [("DeadlineDue", None), ("StopDue", 110.0), ("StopDue", None), ("DeadlineDue", None), ("StopDue", None)]
    assert (harness.task.goal.request, harness.task.outcome, harness.task.goal.calls.pending) == (None, Outcome.FAILED, {})


# Ending


def test_a_task_that_is_over_hears_of_nothing_more() -> None:
    harness = TaskManagerHarness(deadline=500.0)
    harness.executing()
    member = harness.member()
    harness.service_says(frp.Completed(situation=GOAL), 40.0)
    event_count, id = len(harness.task.events), harness.task.id
    for timer in (DeadlineDue(id), StopDue(id), BidsDue(id, 1), OverdueDue(id, member.id)):
        assert harness.rings(timer, 500.0) == []
    assert bodies(harness.client_says(submission.CancelTask(task=id), 501.0)) == ["Cancelling"]
    assert (harness.task.outcome, harness.news(event_count), harness.task.reasons) == (Outcome.ACCOMPLISHED, [], ())


def test_the_time_to_stop_matters_to_none_that_goes_on() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    assert harness.rings(StopDue(harness.task.id), 50.0) == []
    assert harness.member().state is State.EXECUTING


def test_what_is_kept_of_a_task_is_recorded_at_its_end() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2", deadline=90.0, priority=2, time_value=0.5)
    harness.executing()
    effects = harness.service_says(frp.Completed(situation=GOAL), 40.0)
    (record,) = [effect.entry for effect in effects if isinstance(effect, Record)]
    assert isinstance(record, TaskRecord)
    assert (record.task, record.client, record.effect, record.outcome) == (harness.task.id, "client", GOAL, Outcome.ACCOMPLISHED)
    assert (record.submitted_at, record.ended_at, record.deadline, record.priority, record.time_value) == (0.0, 40.0, 90.0, 2, 0.5)
    assert [(event.number, event.at) for event in record.events] == [
        (1, 0.0), (2, 0.0), (3, 0.0), (4, 1.0), (5, 2.0), (6, 2.0), (7, 2.0), (8, 40.0), (9, 40.0),
    ]  # fmt: skip
    assert [message.type for message in record.messages] == [
        "Arrange", "Arrange", "Terms", "Terms", "Accept", "Cancel", "Execute", "Completed", "End",
    ]  # fmt: skip
    assert [(contract.number, contract.service, contract.state, contract.accepted, contract.reason) for contract in record.contracts] == [
        (1, FIRST_SERVICE, State.COMPLETED, True, ""),
        (2, SECOND_SERVICE, State.ENDED, False, "another service was chosen by price"),
    ]
    assert [(contract.start, contract.finish, contract.price, contract.currency, contract.duration) for contract in record.contracts] == [
        (0.0, 60.0, 10.0, "EUR", 60.0),
        (0.0, 60.0, 11.0, "EUR", 60.0),
    ]
    assert ([*harness.task.members], harness.task.messages) == ([], [])
    assert [member.offer.service for member in harness.task.members.former.values()] == [FIRST_SERVICE]
    (step,) = view(harness.task).steps
    assert (step.service, step.state, step.price) == (FIRST_SERVICE, State.COMPLETED, 10.0)


def test_one_that_still_undoes_its_work_when_everybody_should_have_stopped_is_sent_home() -> None:
    harness, member, event_count = start_undoing()
    id = harness.task.id
    assert "Jar002" in harness.has_reserved().changes, "nobody else has to do with what is being undone"
    effects = harness.rings(StopDue(id), 130.0)
    assert bodies(effects) == ["End"]
    assert [effect.at for effect in effects if isinstance(effect, SetTimer) and effect.timer == OverdueDue(id, member.id)] == [None, 150.0]
    assert (member.halting, harness.task.outcome, harness.news(event_count)) == (True, None, [])
    assert harness.rings(StopDue(id), 131.0) == []
    effects = harness.rings(OverdueDue(id, member.id), 150.0)
    assert bodies(effects) == ["UpdateMap"]
    last_events = harness.news(event_count)
    assert [type(event).__name__ for event, *_ in last_events] == [
        "ServiceLost", "NobodyLooks", "UndoneByOthers", "GoalFailed", "WorkStranded", "TaskEnded",
    ]  # fmt: skip
    assert last_events[0] == (events.ServiceLost(service=FIRST_SERVICE), None, None)
    assert last_events[4] == (events.WorkStranded(reason="did not come to an end"), *STEP)
    (work,) = harness.task.log.works
    assert (work.state, work.result, work.note) == (State.STRANDED, State.COMPLETED, "did not come to an end")
    assert harness.reservations.claimants == {}
