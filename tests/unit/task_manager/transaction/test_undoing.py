"""How what was done is undone when a task ends otherwise than wanted."""

from __future__ import annotations

import pytest

from somrs.kernel.component import Send
from somrs.protocol.messages import events, frp, submission, task_views
from somrs.protocol.messages.frp import Compensate, Outcome, State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.task_manager.execution.member import Member
from somrs.task_manager.timers import SilenceDue
from tests.unit.task_manager.transaction.test_participant_events import FIRST_SERVICE, GOAL, INITIAL_SITUATION, TaskManagerHarness, bodies

ELSEWHERE = "Jar002 isOn Cupboard002"


def start_undoing() -> tuple[TaskManagerHarness, Member, int]:
    """The jar is elsewhere than wanted when the task is cancelled; who put it there is told to undo that. How many events came before."""
    harness = TaskManagerHarness()
    harness.executing()
    member, event_count = harness.member(), len(harness.task.events)
    effects = harness.service_says(frp.Completed(situation=ELSEWHERE), 61.0)
    assert [event for event, *_ in harness.news(event_count)] == [
        events.StepCompleted(service=FIRST_SERVICE, situation=ELSEWHERE),
        events.Replanned(reasons=("every step was done, but the goal does not hold",)),
        events.Planned(steps=1),
        events.ServicesAsked(services=(FIRST_SERVICE,)),
    ]
    assert bodies(effects) == ["UpdateMap", "Arrange"]
    event_count = len(harness.task.events)
    effects = harness.client_says(submission.CancelTask(task=harness.task.id), 70.0)
    assert bodies(effects) == ["Cancel", "Compensate", "Cancelling"]
    (compensate_effect,) = [effect for effect in effects if isinstance(effect, Send) and isinstance(effect.message.body, Compensate)]
    assert (compensate_effect.message.body, compensate_effect.message.header.participant) == (
        Compensate(situation=INITIAL_SITUATION, begin_by=90.0),
        member.id,
    )
    assert [event for event, *_ in harness.news(event_count)] == [
        events.Stopping(reason="cancelled by the client"),
        events.UndoneByService(service=FIRST_SERVICE, situation=INITIAL_SITUATION),
    ]
    assert harness.task.phase is task_views.Phase.COMPENSATING
    return harness, member, len(harness.task.events)


def test_the_service_that_did_it_undoes_it() -> None:
    harness, member, event_count = start_undoing()
    effects = harness.service_says(frp.Compensated(situation=INITIAL_SITUATION), 90.0, sender=member)
    assert [event for event, *_ in harness.news(event_count)] == [
        events.Compensated(service=FIRST_SERVICE, situation=INITIAL_SITUATION),
        events.WorkUndone(),
        events.TaskEnded(outcome=Outcome.CANCELLED, reasons=harness.task.reasons),
    ]
    assert harness.reports[-1] == UpdateMap(situation=INITIAL_SITUATION, author=FIRST_SERVICE)
    assert bodies(effects) == ["UpdateMap", "End"]
    (work,) = harness.task.log.works
    assert (work.state, work.result, work.ended, work.situation) == (State.COMPENSATED, State.COMPLETED, 61.0, INITIAL_SITUATION)
    assert harness.task.reasons == ("cancelled by the client", f"TransferObject by {FIRST_SERVICE} was undone: {INITIAL_SITUATION}")
    assert (harness.task.outcome, harness.task.phase, harness.manager.open) == (Outcome.CANCELLED, task_views.Phase.ENDED, [])


@pytest.mark.parametrize("situation", [None, ELSEWHERE])
def test_what_it_cannot_undo_others_do(situation: str | None) -> None:
    harness, member, event_count = start_undoing()
    effects = harness.service_says(frp.Stranded(description="stuck", situation=situation, tried=False), 90.0, sender=member)
    (label,) = [work.label for work in harness.task.log]
    assert [event for event, *_ in harness.news(event_count)] == [
        events.CompensationFailed(service=FIRST_SERVICE, description="stuck", situation=situation),
        events.UndoneByOthers(situation=INITIAL_SITUATION),
        events.Planned(steps=1),
        events.ServicesAsked(services=(FIRST_SERVICE,)),
    ]
    assert bodies(effects) == [*(["UpdateMap"] if situation else []), "Arrange"]
    harness.offer(91.0)
    assert harness.member().label == "undo2.step1"
    effects = harness.service_says(frp.Completed(situation=INITIAL_SITUATION), 150.0)
    assert harness.task.outcome is Outcome.CANCELLED
    assert harness.task.reasons[1:] == (f"TransferObject by {FIRST_SERVICE} was undone: {INITIAL_SITUATION}",)
    assert [(work.label, work.state) for work in harness.task.log] == [(label, State.COMPENSATED), ("undo2.step1", State.COMPLETED)]


def test_what_nobody_can_undo_is_stranded_and_the_client_hears_how_it_was_left() -> None:
    harness, member, _ = start_undoing()
    harness.offers = ()
    event_count = len(harness.task.events)
    harness.service_says(frp.Stranded(description="stuck", situation=ELSEWHERE, tried=False), 90.0, sender=member)
    logged_events = [event for event, *_ in harness.news(event_count)]
    assert [type(event).__name__ for event in logged_events] == [
        "CompensationFailed",
        "UndoneByOthers",
        "GoalFailed",
        "WorkStranded",
        "TaskEnded",
    ]
    assert logged_events[3] == events.WorkStranded(reason="stuck")
    assert harness.task.reasons[1:] == (f"TransferObject by {FIRST_SERVICE} could not be undone, and it left {ELSEWHERE}",)
    (work,) = harness.task.log.works
    assert (work.state, work.note, harness.task.undoing is not None) == (State.STRANDED, "stuck", True)


def test_what_is_as_it_was_needs_no_undoing() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    harness.service_says(frp.Completed(situation=INITIAL_SITUATION), 61.0)
    event_count = len(harness.task.events)
    effects = harness.client_says(submission.CancelTask(task=harness.task.id), 70.0)
    assert [type(event).__name__ for event, *_ in harness.news(event_count)] == ["Stopping", "WorkUndone", "TaskEnded"]
    assert "Compensate" not in bodies(effects)


def test_what_was_never_begun_is_not_undone() -> None:
    harness = TaskManagerHarness()
    event_count = len(harness.task.events)
    effects = harness.client_says(submission.CancelTask(task=harness.task.id), 70.0)
    assert [type(event).__name__ for event, *_ in harness.news(event_count)] == ["Stopping", "TaskEnded"]
    assert bodies(effects) == ["Cancel", "Cancelling"]
    assert harness.task.reasons == ("cancelled by the client",)
    assert harness.task.task.effect == GOAL


BROKEN = f"{ELSEWHERE} AND Robot1.Working = FALSE"


def test_without_a_plan_who_failed_undoes_what_it_left_and_then_there_may_be_one() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Failed(description="stuck", situation=BROKEN), 61.0)
    logged_events = [event for event, *_ in harness.news(event_count)]
    assert [type(event).__name__ for event in logged_events] == ["StepFailed", "Replanned", "FailuresUndone", "UndoneByService"]
    assert bodies(effects) == ["UpdateMap", "Compensate"]
    assert harness.task.blocked != ()
    assert harness.task.ending is None
    event_count = len(harness.task.events)
    effects = harness.service_says(frp.Compensated(situation=f"{INITIAL_SITUATION} AND Robot1.Working = TRUE"), 90.0)
    assert [type(event).__name__ for event, *_ in harness.news(event_count)] == [
        "Compensated",
        "WorkUndone",
        "TriedOnceMore",
        "Planned",
        "ServicesAsked",
    ]
    assert bodies(effects) == ["UpdateMap", "Arrange"]
    assert harness.task.undoing is None


def test_when_who_failed_cannot_undo_it_and_nobody_is_left_the_task_fails() -> None:
    harness = TaskManagerHarness(waits=False)
    harness.executing()
    harness.service_says(frp.Failed(description="stuck", situation=BROKEN), 61.0)
    event_count, blocked = len(harness.task.events), harness.task.blocked
    harness.service_says(frp.Stranded(description="still stuck", tried=False), 90.0)
    event_names = [type(event).__name__ for event, *_ in harness.news(event_count)]
    assert (event_names[0], event_names[-1], harness.task.outcome) == ("CompensationFailed", "TaskEnded", Outcome.FAILED)
    assert harness.task.reasons[: len(blocked)] == blocked


def test_whoever_is_lost_is_not_told_to_undo_anything() -> None:
    harness = TaskManagerHarness(waits=False)
    harness.executing()
    event_count, member = len(harness.task.events), harness.member()
    harness.service_says(frp.Progress(fraction=0.5, situation=ELSEWHERE), 30.0)
    for now in (50.0, 70.0):
        harness.rings(SilenceDue(harness.task.id, member.id), now)
    assert "FailuresUndone" not in [type(event).__name__ for event, *_ in harness.news(event_count)]
    assert harness.task.outcome is Outcome.FAILED
