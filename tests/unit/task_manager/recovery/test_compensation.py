"""How work is undone: what is tried in which order, and when it is given up."""

from __future__ import annotations

import pytest

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.component import Effect, Send
from somrs.kernel.reservations import Reservation
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.plan import Step
from somrs.protocol.messages import events, frp, waits
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.reservations import ReservationMode, Reserve, Reserved
from somrs.protocol.messages.submission import Submit
from somrs.task_manager.execution.execution_log import ExecutionLog, Work
from somrs.task_manager.recovery.compensation import Attempt, Compensation, RestorationGoal, Undoing
from somrs.task_manager.requests import ReservationAnswer
from somrs.task_manager.reservations import ReservationRequester, TaskReservation
from tests.support.effects import run_effects
from tests.support.laboratory import MAP, TRANSFER
from tests.unit.task_manager.arrangement.test_plan_request import context
from tests.unit.task_manager.execution.test_participants import TransactionHarness, sends

ON_PLATFORM, ON_SHELF = "Jar001 isOn Platform001", "Jar001 isOn Shelf2"


def work(number: int, participant: str = "nobody", prior_situation: str | None = ON_PLATFORM, jar: str = "Jar001") -> Work:
    inputs = {"Object": Name(jar), "Destination": Name("Shelf1")}
    return Work(
        number=number,
        label=f"step{number}",
        key=f"1.1/step{number}",
        step=Step(f"step{number}", "TransferObject", {**inputs}, parse(f"{jar} isOn Shelf1")),
        service_type=TRANSFER,
        participant=participant,
        service="Robot1.Work",
        provider="Robot1",
        started_at=1.0,
        prior_situation=parse(prior_situation) if prior_situation is not None else None,
        concerned=(jar,),
        state=State.COMPLETED,
        note="it broke",
    )


class CompensationHarness:
    """A task that is being undone: the jars are on Shelf1, where its work put them."""

    def __init__(
        self,
        *works: Work,
        by_other_services: bool = True,
        handlers: tuple[Handler, ...] = (),
        transaction: TransactionHarness | None = None,
    ) -> None:
        self.transaction, self.context, self.works = transaction or TransactionHarness(), context(), works
        self.reservation = TaskReservation(held=Reservation(changes=frozenset({"Jar001", "Jar002"})), fence=5)
        self.state = Undoing.from_works(works, by_other_services=by_other_services)
        self.logged_events: list[tuple[Event, float, Work]] = []
        self.compensation = Compensation(
            self.state,
            task=Submit(effect=ON_SHELF, handlers=handlers),
            log=ExecutionLog(works=[*works]),
            members=self.transaction.members,
            participants=self.transaction.participants,
            reserving=ReservationRequester(self.reservation, "task1", ON_SHELF, 0, self.context),
            context=self.context,
            log_event=lambda event, now, work: self.logged_events.append((event, now, work)),
        )

    def reserve(self, answer: ReservationAnswer) -> Reserve:
        """The task holds nothing any more: it asks for what it is to undo, and gets this answer."""
        self.reservation.clear()
        effects, result = self.proceeds()
        (request,) = [effect.message.body for effect in effects if isinstance(effect, Send)]
        assert isinstance(request, Reserve)
        assert result is False
        assert self.proceeds() == ([], False), "it has asked"
        self.compensation.reserved(answer)
        return request

    def proceeds(self, now: float = 9.0) -> tuple[list[Effect], bool | RestorationGoal]:
        return run_effects(self.compensation.proceed(now))


def test_with_nothing_to_undo_it_is_over() -> None:
    assert CompensationHarness().proceeds() == ([], True)


def test_what_is_as_it_was_is_undone() -> None:
    works = work(1, prior_situation="Jar001 isOn Shelf1"), work(2)
    works[1].state = State.COMPENSATED
    harness = CompensationHarness(*works)
    assert harness.state.remaining_numbers == [1, 2]
    assert harness.proceeds() == ([], True)
    assert harness.logged_events == [(events.WorkUndone(), 9.0, undone_work) for undone_work in works]
    assert [undone_work.state for undone_work in works] == [State.COMPENSATED] * 2
    assert (harness.state.restored, harness.state.work, harness.state.remaining_numbers) == (2, None, [])


@pytest.mark.parametrize("state", [State.COMPLETED, State.FAILED, State.STOPPED, State.UNREACHABLE])
@pytest.mark.parametrize(
    ("situation", "unchanged"),
    [
        (ON_PLATFORM, True),
        (f"{ON_PLATFORM} AND Robot1.Charge = 5 %", True),
        (ON_SHELF, False),
        ("Robot1.Charge = 5 %", False),
        ("no formula (", False),
    ],
)
def test_what_changed_nothing_is_not_undone_whatever_others_did_since(state: State, situation: str, unchanged: bool) -> None:
    first_work = work(1)
    first_work.state, first_work.situation = state, situation
    unchanged = unchanged and state is not State.UNREACHABLE
    effects, result = CompensationHarness(first_work).proceeds()
    assert (effects, result) == ([], True if unchanged else RestorationGoal(ON_PLATFORM, first_work))
    assert first_work.state is (State.COMPENSATED if unchanged else state)


@pytest.mark.parametrize("objects", [("Jar001",), ("Jar002",)])
def test_what_another_task_has_is_left_to_it(objects: tuple[str, ...]) -> None:
    harness = CompensationHarness(work(1), by_other_services=False)
    holders = (waits.Holder(task="other", goal="", objects=objects),)
    harness.reserve(Reserved(task="task1", fence=5, holders=holders))
    assert harness.proceeds() == ([], True)
    mine = "Jar001" in objects
    stranded = events.WorkStranded(taken=True, holders=holders)
    assert harness.logged_events == ([(stranded, 9.0, harness.works[0])] if mine else [])
    assert (harness.works[0].state, harness.state.restored) == (State.STRANDED if mine else State.COMPLETED, 0)


def test_a_task_that_has_released_its_objects_asks_for_them_before_it_undoes_anything() -> None:
    harness = CompensationHarness(work(1), work(2, jar="Jar002"))
    request = harness.reserve(Reserved(task="task1", fence=6))
    assert (request.mode, request.changes) == (ReservationMode.UNDO, ("Jar001", "Jar002"))
    assert harness.proceeds()[1] == RestorationGoal(ON_PLATFORM, harness.works[0])


def test_what_another_task_has_changed_since_is_not_undone() -> None:
    harness = CompensationHarness(work(1), work(2, jar="Jar002"))
    harness.works[0].overtaken = True
    harness.reserve(Reserved(task="task1", fence=6, overtaken=("Jar001",)))
    assert harness.state.remaining_numbers == [2]


def test_without_the_repository_nothing_is_undone_yet() -> None:
    harness = CompensationHarness(work(1))
    harness.reserve("it does not answer")
    effects, result = harness.proceeds()
    assert (result, harness.state.reserved, len(effects)) == (False, False, 2), "it asks again"


def test_the_attempts_are_made_one_after_the_other() -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(State.COMPLETED)
    handlers = tuple(
        Handler(on=occasion, effect=effect)
        for occasion, effect in (
            (Occasion.FAILURE, ON_SHELF),
            (Occasion.COMPENSATION, "?Object isOn Shelf2"),
            (Occasion.COMPENSATION, ON_SHELF),
        )
    )
    harness = CompensationHarness(work(1, member.id), handlers=handlers, transaction=transaction)
    (first_work,) = harness.works
    assert harness.proceeds() == ([], RestorationGoal(ON_SHELF, first_work))
    assert (harness.state.pursued, harness.state.attempts) == (True, [Attempt.PARTICIPANT, Attempt.OTHER_SERVICES, Attempt.NO_SERVICE])
    assert harness.proceeds() == ([], False), "it is pursued"
    harness.compensation.goal_failed()
    effects, result = harness.proceeds(10.0)
    assert (sends(effects), result) == ([(frp.Compensate(situation=ON_PLATFORM, begin_by=30.0), 30.0)], False)
    assert harness.proceeds(11.0) == ([], False), "it is at it"
    transaction.member_says(member, frp.Stranded(description="stuck"), 12.0)
    member.halting = True
    assert harness.proceeds(12.0) == ([], False), "it moves yet"
    member.halting = False
    assert harness.proceeds(13.0) == ([], RestorationGoal(ON_PLATFORM, first_work))
    harness.compensation.goal_failed()
    assert harness.proceeds(14.0) == ([], True)
    assert harness.logged_events == [
        (events.UndoneByHandler(effect=ON_SHELF), 9.0, first_work),
        (events.UndoneByService(service="Robot1.Work", situation=ON_PLATFORM), 10.0, first_work),
        (events.UndoneByOthers(situation=ON_PLATFORM), 13.0, first_work),
        (events.WorkStranded(reason="it broke"), 14.0, first_work),
    ]
    assert (first_work.state, harness.state.restored, harness.state.work) == (State.STRANDED, 0, None)


def test_what_others_restored_is_undone_and_the_next_is_gone_on_with() -> None:
    harness = CompensationHarness(work(2), work(1, prior_situation="Jar002 isOn Platform001", jar="Jar002"))
    first, second = harness.works
    assert harness.proceeds() == ([], RestorationGoal(ON_PLATFORM, first))
    harness.compensation.goal_reached(20.0)
    assert (first.state, harness.state.restored, harness.state.pursued, harness.state.work) == (State.COMPENSATED, 1, False, None)
    assert harness.logged_events[-1] == (events.WorkUndone(), 20.0, first)
    assert harness.proceeds(21.0) == ([], RestorationGoal("Jar002 isOn Platform001", second))
    assert harness.state.remaining_numbers == []
    harness.state.work = None
    harness.compensation.goal_reached(22.0)
    assert (harness.state.pursued, harness.state.restored) == (False, 1)


def test_where_others_are_not_to_undo_it_work_stays_as_it_is() -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(State.UNREACHABLE)
    harness = CompensationHarness(work(1, member.id), transaction=transaction, by_other_services=False)
    assert harness.proceeds() == ([], True)
    assert (harness.logged_events, harness.works[0].state, harness.state.work) == ([], State.COMPLETED, None)


@pytest.mark.parametrize("prior_situation", [None, "Gone isOn Shelf1"])
def test_it_is_not_as_it_was_where_that_is_not_known(prior_situation: str | None) -> None:
    harness = CompensationHarness(work(1, prior_situation=prior_situation), by_other_services=False)
    harness.proceeds()
    assert (harness.works[0].state, harness.context.replica.map) == (State.COMPLETED, MAP)
