"""How work is undone: what is tried in which order, and when it is given up."""

from __future__ import annotations

import pytest

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.component import Effect
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.plan import Step
from somrs.protocol.messages import events, frp
from somrs.protocol.messages.clients import Submit
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import State
from somrs.task_manager.execution.execution_log import ExecutionLog, Work
from somrs.task_manager.recovery.compensation import Attempt, Compensation, RestorationGoal, Undoing
from somrs.task_manager.reservations import Reservation
from tests.unit.planner.test_planning import MAP, TRANSFER
from tests.unit.task_manager.arrangement.test_plan_request import context
from tests.unit.task_manager.execution.test_participants import Table, carried_out, sends

THERE, HERE = "Jar001 isOn Platform001", "Jar001 isOn Shelf2"


def work(number: int, participant: str = "nobody", before: str | None = THERE, jar: str = "Jar001") -> Work:
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
        prior_situation=parse(before) if before is not None else None,
        concerned=(jar,),
        state=State.COMPLETED,
        note="it broke",
    )


class Ending:
    """A task that is being undone: the jars are on Shelf1, where its work put them."""

    def __init__(self, *works: Work, by_others: bool = True, handlers: tuple[Handler, ...] = (), table: Table | None = None) -> None:
        self.table, self.context, self.works = table or Table(), context(), works
        self.state = Undoing.from_works(works, by_other_services=by_others)
        self.told: list[tuple[Event, float, Work]] = []
        self.compensation = Compensation(
            self.state,
            owner="task1",
            task=Submit(effect=HERE, handlers=handlers),
            log=ExecutionLog(works=[*works]),
            members=self.table.members,
            participants=self.table.participants,
            context=self.context,
            log_event=lambda event, now, work: self.told.append((event, now, work)),
        )

    def proceeds(self, now: float = 9.0) -> tuple[list[Effect], bool | RestorationGoal]:
        return carried_out(self.compensation.proceed(now))


def test_with_nothing_to_undo_it_is_over() -> None:
    assert Ending().proceeds() == ([], True)


def test_what_is_as_it_was_is_undone() -> None:
    works = work(1, before="Jar001 isOn Shelf1"), work(2)
    works[1].state = State.COMPENSATED
    ending = Ending(*works)
    assert ending.state.remaining_numbers == [1, 2]
    assert ending.proceeds() == ([], True)
    assert ending.told == [(events.WorkUndone(), 9.0, one) for one in works]
    assert [one.state for one in works] == [State.COMPENSATED] * 2
    assert (ending.state.restored, ending.state.work, ending.state.remaining_numbers) == (2, None, [])


@pytest.mark.parametrize("state", [State.COMPLETED, State.FAILED, State.STOPPED, State.UNREACHABLE])
@pytest.mark.parametrize(
    ("situation", "nothing"),
    [(THERE, True), (f"{THERE} AND Robot1.Charge = 5 %", True), (HERE, False), ("Robot1.Charge = 5 %", False), ("no formula (", False)],
)
def test_what_changed_nothing_is_not_undone_whatever_others_did_since(state: State, situation: str, nothing: bool) -> None:
    one = work(1)
    one.state, one.situation = state, situation
    nothing = nothing and state is not State.UNREACHABLE
    effects, found = Ending(one).proceeds()
    assert (effects, found) == ([], True if nothing else RestorationGoal(THERE, one))
    assert one.state is (State.COMPENSATED if nothing else state)


@pytest.mark.parametrize("taken", [("Jar001",), ("Jar002",)])
def test_what_another_task_has_is_left_to_it(taken: tuple[str, ...]) -> None:
    ending = Ending(work(1), by_others=False)
    ending.context.reservations.hold("other", Reservation(changes=frozenset(taken)))
    ending.context.reservations.hold("task1", Reservation(changes=frozenset({"Jar001"})))
    assert ending.proceeds() == ([], True)
    mine = "Jar001" in taken
    assert ending.told == ([(events.WorkStranded(taken=True), 9.0, ending.works[0])] if mine else [])
    assert (ending.works[0].state, ending.state.restored) == (State.STRANDED if mine else State.COMPLETED, 0)


def test_the_attempts_are_made_one_after_the_other() -> None:
    table = Table()
    member = table.in_state(State.COMPLETED)
    handlers = tuple(
        Handler(on=on, effect=effect)
        for on, effect in ((Occasion.FAILURE, HERE), (Occasion.COMPENSATION, "?Object isOn Shelf2"), (Occasion.COMPENSATION, HERE))
    )
    ending = Ending(work(1, member.id), handlers=handlers, table=table)
    (one,) = ending.works
    assert ending.proceeds() == ([], RestorationGoal(HERE, one))
    assert (ending.state.pursued, ending.state.attempts) == (True, [Attempt.PARTICIPANT, Attempt.OTHER_SERVICES, Attempt.NO_SERVICE])
    assert ending.proceeds() == ([], False), "it is pursued"
    ending.compensation.goal_failed()
    effects, found = ending.proceeds(10.0)
    assert (sends(effects), found) == ([(frp.Compensate(situation=THERE, begin_by=30.0), 30.0)], False)
    assert ending.proceeds(11.0) == ([], False), "it is at it"
    table.says(member, frp.Stranded(description="stuck"), 12.0)
    member.halting = True
    assert ending.proceeds(12.0) == ([], False), "it moves yet"
    member.halting = False
    assert ending.proceeds(13.0) == ([], RestorationGoal(THERE, one))
    ending.compensation.goal_failed()
    assert ending.proceeds(14.0) == ([], True)
    assert ending.told == [
        (events.UndoneByHandler(effect=HERE), 9.0, one),
        (events.UndoneByService(service="Robot1.Work", situation=THERE), 10.0, one),
        (events.UndoneByOthers(situation=THERE), 13.0, one),
        (events.WorkStranded(reason="it broke"), 14.0, one),
    ]
    assert (one.state, ending.state.restored, ending.state.work) == (State.STRANDED, 0, None)


def test_what_others_restored_is_undone_and_the_next_is_gone_on_with() -> None:
    ending = Ending(work(2), work(1, before="Jar002 isOn Platform001", jar="Jar002"))
    first, second = ending.works
    assert ending.proceeds() == ([], RestorationGoal(THERE, first))
    ending.compensation.goal_reached(20.0)
    assert (first.state, ending.state.restored, ending.state.pursued, ending.state.work) == (State.COMPENSATED, 1, False, None)
    assert ending.told[-1] == (events.WorkUndone(), 20.0, first)
    assert ending.proceeds(21.0) == ([], RestorationGoal("Jar002 isOn Platform001", second))
    assert ending.state.remaining_numbers == []
    ending.state.work = None
    ending.compensation.goal_reached(22.0)
    assert (ending.state.pursued, ending.state.restored) == (False, 1)


def test_where_others_are_not_to_undo_it_work_stays_as_it_is() -> None:
    table = Table()
    member = table.in_state(State.UNREACHABLE)
    ending = Ending(work(1, member.id), table=table, by_others=False)
    assert ending.proceeds() == ([], True)
    assert (ending.told, ending.works[0].state, ending.state.work) == ([], State.COMPLETED, None)


@pytest.mark.parametrize("before", [None, "Gone isOn Shelf1"])
def test_it_is_not_as_it_was_where_that_is_not_known(before: str | None) -> None:
    ending = Ending(work(1, before=before), by_others=False)
    ending.proceeds()
    assert (ending.works[0].state, ending.context.replica.map) == (State.COMPLETED, MAP)
