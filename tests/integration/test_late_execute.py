"""An order to begin that comes too late moves nothing: its step may be another's by then. Whole systems on virtual time."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.submission import CancelTask
from somrs.runtime.virtual_network import LATENCY, Medium
from somrs.task_manager.execution.participants import SILENCE
from tests.integration.test_recovery import recognize_at_place, restore_object
from tests.support.event_sentences import texts
from tests.support.virtual_system import Robot, VirtualSystem

GOAL = "Jar002 isOn Platform001"
ROBOT1 = "devices/Robot1"


def slow(kind: type[object], seconds: float, lost: type[object] | None = None) -> Medium:
    """What Robot1 is told first of one type takes so long, and what it is told of another is lost."""
    delayed: set[str] = set()

    def medium(message: Message) -> Sequence[float]:
        to_robot = message.header.recipient == ROBOT1
        if to_robot and lost is not None and isinstance(message.body, lost):
            return ()
        if to_robot and isinstance(message.body, kind) and not delayed:
            delayed.add(message.header.message_id)
            return (seconds,)
        return (LATENCY,)

    return medium


def executes(system: VirtualSystem) -> list[Message]:
    return [m for m in system.world.messages if isinstance(m.body, frp.Execute) and m.header.recipient == ROBOT1]


def test_a_late_execute_is_not_obeyed_after_its_step_went_to_another() -> None:
    first = Robot("Robot1", 10, 60)
    system = VirtualSystem(first, Robot("Robot2", 25, 60), medium=slow(frp.Execute, 100.0, lost=frp.Query))
    system.join(Robot("Robot3", 1, 10, works=recognize_at_place("Cupboard001")), service="RecognizeSituation")
    system.world.run(2)
    task = system.submit(GOAL)
    assert system.world.run(99, lambda: ("Execute", "Robot2") in system.protocol_messages(task)), "Robot1 was given up before"
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    system.world.run(100)
    assert first.orders == []
    assert system.device("Robot1").state_of(task, "Robot1.TransferObject#step1") is State.ENDED


def test_who_was_not_reached_in_time_is_told_anew() -> None:
    robot = Robot("Robot1", 10, 60)
    system = VirtualSystem(robot, medium=slow(frp.Execute, 50.0))
    task = system.submit(GOAL)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    first, second = executes(system)
    assert first.header.message_id != second.header.message_id
    assert isinstance(first.body, frp.Execute)
    assert isinstance(second.body, frp.Execute)
    assert first.body.begin_by is not None
    assert second.body.begin_by is not None
    assert second.body.begin_by >= first.body.begin_by + SILENCE
    assert len(robot.orders) == 1


def test_one_that_was_told_too_late_and_says_so_is_replaced_without_looking() -> None:
    first = Robot("Robot1", 10, 60)
    system = VirtualSystem(first, Robot("Robot2", 25, 60), medium=slow(frp.Execute, SILENCE + 5, lost=frp.Query))
    task = system.submit(GOAL)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert first.orders == []
    assert [work.service for work in view.work] == ["Robot2.TransferObject"]
    event_texts = texts(system.manager.state.tasks[task])
    assert any("Robot1.TransferObject did not begin: Execute came 5.0 s too late" in text for text in event_texts), event_texts


def test_what_was_told_too_late_to_be_undone_is_undone_by_another() -> None:
    undone: list[str] = []

    def undoes(order: object, situation: str) -> object:
        undone.append(situation)
        return iter(())

    first = Robot("Robot1", 10, 60, undoes=undoes)  # type: ignore[arg-type]  # it is never begun
    system = VirtualSystem(first, Robot("Robot2", 25, 60, undoes=restore_object), medium=slow(frp.Compensate, SILENCE + 5, lost=frp.Query))
    task = system.submit(f"{GOAL} AND Jar001 isOn Platform001")
    assert system.world.run(600, lambda: any(step.state is State.COMPLETED for step in system.view(task).steps))
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    assert undone == []
    (stranded,) = [m.body for m in system.world.messages if isinstance(m.body, frp.Stranded)]
    assert not stranded.tried
    assert system.map.has_fact("isOn", ("Jar002", "Cupboard001"))
    assert system.map.has_fact("isOn", ("Jar001", "Cupboard002"))
