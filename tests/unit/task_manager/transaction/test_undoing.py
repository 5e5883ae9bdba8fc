"""How what was done is undone when a task ends otherwise than wanted."""

from __future__ import annotations

import pytest

from somrs.kernel.component import Send
from somrs.protocol.messages import clients, events, frp
from somrs.protocol.messages.frp import Compensate, Outcome, State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.task_manager.execution.member import Member
from somrs.task_manager.timers import SilenceDue
from tests.unit.task_manager.transaction.test_participant_events import BEFORE, ONE, WISH, Desk, bodies

ELSEWHERE = "Jar002 isOn Cupboard002"


def undoing() -> tuple[Desk, Member, int]:
    """The jar is elsewhere than wanted when the task is cancelled; who put it there is told to undo that. How many events came before."""
    desk = Desk()
    desk.executing()
    member, since = desk.member(), len(desk.task.events)
    effects = desk.says(frp.Completed(situation=ELSEWHERE), 61.0)
    assert [one for one, *_ in desk.news(since)] == [
        events.StepCompleted(service=ONE, situation=ELSEWHERE),
        events.Replanned(reasons=("every step was done, but the goal does not hold",)),
        events.Planned(steps=1),
        events.ServicesAsked(services=(ONE,)),
    ]
    assert bodies(effects) == ["UpdateMap", "Discover", "Arrange"]
    since = len(desk.task.events)
    effects = desk.says_client(clients.CancelTask(task=desk.task.id), 70.0)
    assert bodies(effects) == ["Cancel", "Compensate", "Cancelling"]
    (told,) = [effect for effect in effects if isinstance(effect, Send) and isinstance(effect.message.body, Compensate)]
    assert (told.message.body, told.message.header.participant) == (Compensate(situation=BEFORE, begin_by=90.0), member.id)
    assert [one for one, *_ in desk.news(since)] == [
        events.Stopping(reason="cancelled by the client"),
        events.UndoneByService(service=ONE, situation=BEFORE),
    ]
    assert desk.task.phase is clients.Phase.COMPENSATING
    return desk, member, len(desk.task.events)


def test_the_service_that_did_it_undoes_it() -> None:
    desk, member, since = undoing()
    effects = desk.says(frp.Compensated(situation=BEFORE), 90.0, by=member)
    assert [one for one, *_ in desk.news(since)] == [
        events.Compensated(service=ONE, situation=BEFORE),
        events.WorkUndone(),
        events.TaskEnded(outcome=Outcome.CANCELLED, reasons=desk.task.reasons),
    ]
    assert desk.reports[-1] == UpdateMap(situation=BEFORE, author=ONE)
    assert bodies(effects) == ["UpdateMap", "End"]
    (work,) = desk.task.log.works
    assert (work.state, work.result, work.ended, work.situation) == (State.COMPENSATED, State.COMPLETED, 61.0, BEFORE)
    assert desk.task.reasons == ("cancelled by the client", f"TransferObject by {ONE} was undone: {BEFORE}")
    assert (desk.task.outcome, desk.task.phase, desk.manager.open) == (Outcome.CANCELLED, clients.Phase.ENDED, [])


@pytest.mark.parametrize("situation", [None, ELSEWHERE])
def test_what_it_cannot_undo_others_do(situation: str | None) -> None:
    desk, member, since = undoing()
    effects = desk.says(frp.Stranded(description="stuck", situation=situation, tried=False), 90.0, by=member)
    (label,) = [work.label for work in desk.task.log]
    assert [one for one, *_ in desk.news(since)] == [
        events.CompensationFailed(service=ONE, description="stuck", situation=situation),
        events.UndoneByOthers(situation=BEFORE),
        events.Planned(steps=1),
        events.ServicesAsked(services=(ONE,)),
    ]
    assert bodies(effects) == [*(["UpdateMap"] if situation else []), "Discover", "Arrange"]
    desk.offer(91.0)
    assert desk.member().label == "undo2.step1"
    effects = desk.says(frp.Completed(situation=BEFORE), 150.0)
    assert desk.task.outcome is Outcome.CANCELLED
    assert desk.task.reasons[1:] == (f"TransferObject by {ONE} was undone: {BEFORE}",)
    assert [(work.label, work.state) for work in desk.task.log] == [(label, State.COMPENSATED), ("undo2.step1", State.COMPLETED)]


def test_what_nobody_can_undo_is_stranded_and_the_client_hears_how_it_was_left() -> None:
    desk, member, _ = undoing()
    desk.offers = ()
    since = len(desk.task.events)
    desk.says(frp.Stranded(description="stuck", situation=ELSEWHERE, tried=False), 90.0, by=member)
    told = [one for one, *_ in desk.news(since)]
    assert [type(one).__name__ for one in told] == ["CompensationFailed", "UndoneByOthers", "GoalFailed", "WorkStranded", "TaskEnded"]
    assert told[3] == events.WorkStranded(reason="stuck")
    assert desk.task.reasons[1:] == (f"TransferObject by {ONE} could not be undone, and it left {ELSEWHERE}",)
    (work,) = desk.task.log.works
    assert (work.state, work.note, desk.task.undoing is not None) == (State.STRANDED, "stuck", True)


def test_what_is_as_it_was_needs_no_undoing() -> None:
    desk = Desk()
    desk.executing()
    desk.says(frp.Completed(situation=BEFORE), 61.0)
    since = len(desk.task.events)
    effects = desk.says_client(clients.CancelTask(task=desk.task.id), 70.0)
    assert [type(one).__name__ for one, *_ in desk.news(since)] == ["Stopping", "WorkUndone", "TaskEnded"]
    assert "Compensate" not in bodies(effects)


def test_what_was_never_begun_is_not_undone() -> None:
    desk = Desk()
    since = len(desk.task.events)
    effects = desk.says_client(clients.CancelTask(task=desk.task.id), 70.0)
    assert [type(one).__name__ for one, *_ in desk.news(since)] == ["Stopping", "TaskEnded"]
    assert bodies(effects) == ["Cancel", "Cancelling"]
    assert desk.task.reasons == ("cancelled by the client",)
    assert desk.task.task.effect == WISH


BROKEN = f"{ELSEWHERE} AND Robot1.Working = FALSE"


def test_without_a_plan_who_failed_undoes_what_it_left_and_then_there_may_be_one() -> None:
    desk = Desk()
    desk.executing()
    since = len(desk.task.events)
    effects = desk.says(frp.Failed(description="stuck", situation=BROKEN), 61.0)
    told = [one for one, *_ in desk.news(since)]
    assert [type(one).__name__ for one in told] == ["StepFailed", "Replanned", "FailuresUndone", "UndoneByService"]
    assert bodies(effects) == ["UpdateMap", "Discover", "Compensate"]
    assert desk.task.blocked != ()
    assert desk.task.ending is None
    since = len(desk.task.events)
    effects = desk.says(frp.Compensated(situation=f"{BEFORE} AND Robot1.Working = TRUE"), 90.0)
    assert [type(one).__name__ for one, *_ in desk.news(since)] == [
        "Compensated",
        "WorkUndone",
        "TriedOnceMore",
        "Planned",
        "ServicesAsked",
    ]
    assert bodies(effects) == ["UpdateMap", "Discover", "Discover", "Arrange"]
    assert desk.task.undoing is None


def test_when_who_failed_cannot_undo_it_and_nobody_is_left_the_task_fails() -> None:
    desk = Desk()
    desk.executing()
    desk.says(frp.Failed(description="stuck", situation=BROKEN), 61.0)
    since, blocked = len(desk.task.events), desk.task.blocked
    desk.says(frp.Stranded(description="still stuck", tried=False), 90.0)
    told = [type(one).__name__ for one, *_ in desk.news(since)]
    assert (told[0], told[-1], desk.task.outcome) == ("CompensationFailed", "TaskEnded", Outcome.FAILED)
    assert desk.task.reasons[: len(blocked)] == blocked


def test_whoever_is_lost_is_not_told_to_undo_anything() -> None:
    desk = Desk()
    desk.executing()
    since, member = len(desk.task.events), desk.member()
    desk.says(frp.Progress(fraction=0.5, situation=ELSEWHERE), 30.0)
    for now in (50.0, 70.0):
        desk.rings(SilenceDue(desk.task.id, member.id), now)
    assert "FailuresUndone" not in [type(one).__name__ for one, *_ in desk.news(since)]
    assert desk.task.outcome is Outcome.FAILED
