"""What the Task Manager does beyond giving a step to another: looking, undoing, and what was laid down; on virtual time."""

from __future__ import annotations

import pytest

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, ValueSet
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.plan import Step
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import MapChanged, UpdateMap
from somrs.protocol.messages.submission import CancelTask, Policy
from somrs.protocol.messages.task_views import Phase, TaskView
from somrs.runtime.virtual_network import LATENCY
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Advance, Halt, Order, ServiceFailed, WorkDone
from somrs.task_manager.execution.execution_log import situation_to_restore
from tests.support.virtual_system import Robot, Script, VirtualSystem, drop_object, transfer_effect

GOAL = "Jar002 isOn Platform001"
BOTH_JARS = "Jar001 isOn Platform001 AND Jar002 isOn Platform001"


def holding(name: str, seconds: float = 10.0) -> Script:
    def works(order: Order) -> Work:
        yield seconds, ServiceFailed("the drive is dead", f"{order.inputs['Object']} isHeldBy {name}")

    return works


def restore_object(order: Order, situation: str) -> Work:
    yield 10.0, WorkDone(situation=situation)


def update(system: VirtualSystem, *changes: Change) -> None:
    header = Header(sender="client", recipient="repository", message_id=message_id("update", changes), reply_to="client")
    system.world.send(Message(header=header, body=UpdateMap(changes=changes)))
    system.world.run(1)


def robots_in_state(view: TaskView, state: State) -> list[str]:
    return [work.service.partition(".")[0] for work in view.work if work.state is state]


def run_until_step_done(system: VirtualSystem, task: str) -> None:
    assert system.world.run(600, lambda: any(step.state is State.COMPLETED for step in system.view(task).steps))
    system.world.run(1)


# Undoing


def test_what_was_done_is_undone_when_the_client_cancels() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, undoes=restore_object))
    task = system.submit(BOTH_JARS)
    run_until_step_done(system, task)
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    assert [kind for kind, _ in system.protocol_messages(task)][-6:] == ["Stop", "Stopped", "Compensate", "Compensated", "End", "End"]
    assert system.map.has_fact("isOn", ("Jar001", "Cupboard002"))
    assert system.map.has_fact("isOn", ("Jar002", "Cupboard001"))
    assert "was undone" in view.explanation


def test_steps_are_undone_in_the_reverse_of_the_order_in_which_they_were_done() -> None:
    def dawdles(order: Order) -> Work:
        yield 40.0 if order.inputs["Object"] != "Tin001" else 500.0, WorkDone(situation=transfer_effect(order))

    system = VirtualSystem(Robot("Robot1", 10, 60, works=dawdles, undoes=restore_object))
    task = system.submit(f"{BOTH_JARS} AND Tin001 isOn Platform001")
    assert system.world.run(600, lambda: sum(step.state is State.COMPLETED for step in system.view(task).steps) == 2)
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    compensated = [m.header.participant for m in system.world.messages if isinstance(m.body, frp.Compensate)]
    completed = [m.header.participant for m in system.world.messages if isinstance(m.body, frp.Completed)]
    assert compensated == completed[::-1]
    assert robots_in_state(view, State.COMPENSATED)[:2] == ["Robot1", "Robot1"]


def test_what_its_robot_cannot_undo_others_restore() -> None:
    robots = Robot("Robot1", 10, 60), Robot("Robot2", 25, 60)
    system = VirtualSystem(*robots)
    task = system.submit(BOTH_JARS)
    run_until_step_done(system, task)
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    assert system.map.has_fact("isOn", ("Jar001", "Cupboard002"))
    assert system.map.has_fact("isOn", ("Jar002", "Cupboard001"))
    assert State.STRANDED not in {work.state for work in view.work}


def test_what_nobody_can_undo_is_told_with_where_it_is() -> None:
    """FRP, property 4."""

    def fail_second_jar(order: Order) -> Work:
        yield (
            10.0,
            WorkDone(situation=transfer_effect(order))
            if order.inputs["Destination"] == "Platform001" and order.inputs["Object"] == first
            else (ServiceFailed("the gripper is stuck", f"{order.inputs['Object']} isOn {'Floor001'}")),
        )

    first = "Jar001"
    system = VirtualSystem(Robot("Robot1", 10, 60, works=fail_second_jar))
    (view,) = system.finish(system.submit(BOTH_JARS))
    assert view.outcome is Outcome.FAILED
    stranded = [work for work in view.work if work.state is State.STRANDED]
    assert stranded
    for work in stranded:
        assert work.situation is not None
        assert work.situation in view.explanation


def test_what_a_failure_left_in_the_way_is_undone_and_the_step_begun_again() -> None:
    """FRP, third rung: nobody takes a jar out of a broken robot's gripper, so that robot has to give it back."""
    system = VirtualSystem(Robot("Robot1", 10, 60, works=holding("Robot1"), undoes=restore_object), Robot("Robot2", 25, 60))
    task = system.submit(GOAL)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    robot_messages = [pair for pair in system.protocol_messages(task) if pair[1] == "Robot1"]
    assert robot_messages[-3:] == [("Compensate", "Robot1"), ("Compensated", "Robot1"), ("End", "Robot1")]
    assert view.steps[0].service == "Robot2.TransferObject"


def test_nobody_takes_over_from_a_robot_that_may_still_be_undoing() -> None:
    """FRP, property 1: it shows that it is alive, and does not come to an end."""
    halted: list[float] = []

    def undo_endlessly(order: Order, situation: str) -> Work:
        yield 1e9, WorkDone()

    def carries(task: object) -> Work:
        if isinstance(task, Halt):
            yield 15.0, WorkDone()
            halted.append(system.world.now)
        else:
            yield from robot.carry_out(task)

    robot = Robot("Robot1", 10, 5, undoes=undo_endlessly)
    system = patrolled_system("Platform001", robot, Robot("Robot2", 25, 5))
    manager = system.device("Robot1")
    system.world.remove("devices/Robot1")
    system.world.add("devices/Robot1", manager, carries)
    task = system.submit(BOTH_JARS)
    run_until_step_done(system, task)
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    system.world.run(60)
    undone = [work for work in view.work if work.step.startswith("undo")]
    assert undone
    assert min(work.began for work in undone) > max(halted)


def test_what_a_failed_undoing_left_is_looked_at() -> None:
    """FRP, properties 4 and 5: it was picked up to be brought back, and fell."""

    def fails(order: Order, situation: str) -> Work:
        yield 5.0, ServiceFailed("the gripper is stuck", None)

    system = patrolled_system("Floor001", Robot("Robot1", 10, 60, undoes=fails))
    task = system.submit(BOTH_JARS)
    run_until_step_done(system, task)
    jar = next(step.inputs["Object"] for step in system.view(task).steps if step.state is State.COMPLETED)
    system.ask(CancelTask(task=task))
    assert system.world.run(600, lambda: system.map.has_fact("isOn", (jar, "Floor001")))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED


def test_who_cannot_undo_says_nothing_of_where_things_are_by_now() -> None:
    """FRP, property 5: what it left is long ago, and somebody has told since."""
    system = VirtualSystem(Robot("Robot1", 10, 60))
    task = system.submit(BOTH_JARS)
    run_until_step_done(system, task)
    jar = next(step.inputs["Object"] for step in system.view(task).steps if step.state is State.COMPLETED)
    update(system, FactRemoved(Fact("isOn", (jar, "Platform001"))), FactAdded(Fact("isHeldBy", (jar, "Robot4"))))
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    assert jar in [work.inputs["Object"] for work in view.work if work.state is State.STRANDED]
    assert system.map.has_fact("isHeldBy", (jar, "Robot4"))
    assert not system.map.has_fact("isOn", (jar, "Platform001"))


def test_a_robot_that_falls_silent_while_it_undoes_holds_nobody_up() -> None:
    def undo_endlessly(order: Order, situation: str) -> Work:
        yield 1e9, WorkDone()

    system = VirtualSystem(Robot("Robot1", 10, 60, undoes=undo_endlessly), Robot("Robot2", 25, 60))
    task = system.submit(BOTH_JARS, policy=Policy.PRICE)
    run_until_step_done(system, task)
    system.ask(CancelTask(task=task))
    assert system.world.run(600, lambda: any(isinstance(m.body, frp.Compensate) for m in system.world.messages))
    system.world.run(1)
    system.world.cut_off("devices/Robot1")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    assert view.ended_at is not None
    assert view.ended_at - view.submitted_at < 1200


# Looking


def recognize_at_place(place: str) -> Script:
    def works(order: Order) -> Work:
        object = order.inputs["Object"]
        yield 5.0, Advance(fraction=0.5, note=f"looks for {object}")
        yield 5.0, WorkDone(situation=f"{object} isOn {place} AND {object}.Unknown = FALSE")

    return works


def patrolled_system(place: str, *robots: Robot) -> VirtualSystem:
    system = VirtualSystem(*robots)
    system.join(Robot("Robot3", 1, 10, works=recognize_at_place(place)), service="RecognizeSituation")
    system.world.run(2)
    return system


def goes_silent(system: VirtualSystem, task: str, robot: str = "Robot1") -> None:
    assert system.world.run(60, lambda: any(step.state is State.EXECUTING for step in system.view(task).steps))
    system.world.run(1)
    system.world.remove(f"devices/{robot}")


def test_a_patrol_robot_says_what_a_silent_robot_left() -> None:
    system = patrolled_system("Floor001", Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    task = system.submit(GOAL)
    goes_silent(system, task)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.steps[0].service == "Robot2.TransferObject"
    second = [m.body for m in system.world.messages if isinstance(m.body, frp.Execute)][-1]
    assert second.precondition is not None
    assert "Jar002 isOn Floor001" in second.precondition
    assert ("Execute", "Robot3") in system.protocol_messages(task)


def test_a_report_that_says_nothing_of_the_thing_has_somebody_look() -> None:
    def robot_is_silent_to_its_manager(order: Order) -> Work:
        yield 10.0, Advance(fraction=0.4, situation="Jar002 isHeldBy Robot1")
        yield 10.0, ServiceFailed("the robot does not answer", "Robot1.Working = FALSE")

    system = patrolled_system("Floor001", Robot("Robot1", 10, 60, works=robot_is_silent_to_its_manager), Robot("Robot2", 25, 60))
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.steps[0].service == "Robot2.TransferObject"
    assert "Robot3.RecognizeSituation" in {work.service for work in view.work}


def test_what_the_silent_robot_had_finished_is_not_done_again() -> None:
    robot2 = Robot("Robot2", 25, 60)
    system = patrolled_system("Platform001", Robot("Robot1", 10, 600), robot2)
    task = system.submit(GOAL)
    goes_silent(system, task)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert robot2.orders == []


def test_with_nobody_to_look_nothing_is_assumed_and_another_jar_will_do() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    task = system.submit("?It: Jar isOn Platform001")
    goes_silent(system, task)
    jar = system.view(task).steps[0].inputs["Object"]
    (view,) = system.finish(task)
    assert system.map.objects[jar].values["Unknown"] is True
    assert not list(system.map.facts_about(jar))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.steps[0].inputs["Object"] != jar


def test_with_nobody_to_look_and_no_other_jar_the_client_hears_what_is_not_known() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    task = system.submit(GOAL, waits=False)
    goes_silent(system, task)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.FAILED
    assert "nothing is known of Jar002" in view.explanation
    assert "fell silent" in view.explanation


def test_what_a_failure_left_and_nobody_saw_is_not_called_undone() -> None:
    """FRP, properties 4 and 5: the map still says where the jar was, and the robot that failed may have it in its gripper."""

    def fails(order: Order) -> Work:
        yield 5.0, ServiceFailed("the gripper is stuck", None)

    system = VirtualSystem(Robot("Robot1", 10, 60, works=fails))
    (view,) = system.finish(system.submit(GOAL, waits=False))
    assert view.outcome is Outcome.FAILED
    assert system.map.objects["Jar002"].values["Unknown"] is True
    assert "nothing is known of Jar002" in view.explanation
    assert "was undone" not in view.explanation


def test_who_cancels_while_somebody_looks_is_not_told_that_all_is_undone() -> None:
    """FRP, property 4."""

    def fails(order: Order) -> Work:
        yield 5.0, ServiceFailed("the gripper is stuck", None)

    system = patrolled_system("Floor001", Robot("Robot1", 10, 60, works=fails))
    task = system.submit(GOAL)
    assert system.world.run(60, lambda: ("Execute", "Robot3") in system.protocol_messages(task))
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    assert system.map.has_fact("isOn", ("Jar002", "Floor001")), "somebody looked after all"
    assert robots_in_state(view, State.STRANDED) == ["Robot1"]
    assert "Jar002 isOn Floor001" in view.explanation


def test_what_nobody_knows_is_no_reason_to_be_content() -> None:
    """A map that says of a door that it is open, and that nothing is known of the door, does not say that it is open."""
    system = VirtualSystem(Robot("Robot1", 10, 60))
    update(system, ValueSet("Jar002", "Color", "Red"), ValueSet("Jar002", "Unknown", True))
    (view,) = system.finish(system.submit("Jar002.Color = Red"))
    assert view.outcome is Outcome.FAILED
    assert "the place and state of Jar002 are unknown" in view.explanation


def test_when_the_one_who_looks_falls_silent_too_another_looks() -> None:
    system = patrolled_system("Floor001", Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    system.join(Robot("Robot4", 5, 10, works=recognize_at_place("Floor001")), service="RecognizeSituation")
    task = system.submit(GOAL)
    goes_silent(system, task)
    assert system.world.run(200, lambda: ("Execute", "Robot3") in system.protocol_messages(task))
    system.world.remove("devices/Robot3")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert ("Execute", "Robot4") in system.protocol_messages(task)


def test_a_robot_that_takes_far_longer_than_it_said_is_stopped() -> None:
    def dawdles(order: Order) -> Work:
        for _ in range(10_000):
            yield 5.0, Advance(fraction=0.1, situation="Jar002 isOn Cupboard001")

    system = VirtualSystem(Robot("Robot1", 1, 10, works=dawdles), Robot("Robot2", 25, 60))
    task = system.submit(GOAL)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert ("Stop", "Robot1") in system.protocol_messages(task)
    assert view.steps[0].service == "Robot2.TransferObject"


def test_who_looks_and_sees_nothing_has_found_nothing() -> None:
    """FRP, property 5: that somebody knew of the jar once, the map says still."""

    def blind(order: Order) -> Work:
        yield 5.0, ServiceFailed("it sees nothing", None)

    system = VirtualSystem(Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    system.join(Robot("Robot3", 1, 10, works=blind), service="RecognizeSituation")
    update(system, ValueSet("Jar002", "Unknown", False))
    task = system.submit(GOAL, waits=False)
    goes_silent(system, task)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.FAILED
    assert system.map.objects["Jar002"].values["Unknown"] is True
    assert "nothing is known of Jar002" in view.explanation


def test_one_that_comes_back_has_stopped_before_another_takes_its_step() -> None:
    """FRP, property 1: its Service Manager is started again while somebody looks, and it takes long to stand still."""
    robot1, robot2 = Robot("Robot1", 10, 600, halts=14.0), Robot("Robot2", 25, 60)
    system = patrolled_system("Floor001", robot1, robot2)
    task = system.submit(GOAL)
    goes_silent(system, task)
    assert system.world.run(200, lambda: ("Execute", "Robot3") in system.protocol_messages(task))
    system.restart(robot1)
    assert system.world.run(200, lambda: ("Execute", "Robot2") in system.protocol_messages(task))
    assert ("Stop", "Robot1") in system.protocol_messages(task)
    assert system.device("Robot1").idle
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED


# What was laid down


def test_a_procedure_for_a_failure_goes_before_the_ladder() -> None:
    """Whoever drops a jar: it is to be put on the cupboard first."""
    tidy = Handler(on=Occasion.FAILURE, service_type="TransferObject", when="?Object isOn Floor001", effect="?Object isOn Cupboard001")

    system = VirtualSystem(Robot("Robot1", 1, 10, works=drop_object), Robot("Robot2", 25, 60))
    (view,) = system.finish(system.submit(GOAL, handlers=(tidy,)))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert [work.inputs["Destination"] for work in view.work] == ["Platform001", "Cupboard001", "Platform001"]


def test_a_procedure_for_undoing_goes_before_restoring() -> None:
    aside = Handler(on=Occasion.COMPENSATION, effect="?Object isOn Floor001")
    system = VirtualSystem(Robot("Robot1", 1, 10, undoes=restore_object))
    task = system.submit(BOTH_JARS, handlers=(aside,))
    run_until_step_done(system, task)
    done_first = next(step.inputs["Object"] for step in system.view(task).steps if step.state is State.COMPLETED)
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    assert system.map.has_fact("isOn", (done_first, "Floor001"))
    assert not [m for m in system.world.messages if isinstance(m.body, frp.Compensate) and done_first in m.body.situation]


def test_a_procedure_that_makes_no_sense_is_rejected_with_the_task() -> None:
    wrong = Handler(on=Occasion.FAILURE, effect="?Objekt isOn Nowhere")
    system = VirtualSystem(Robot("Robot1", 1, 10))
    answer = system.rejected(GOAL, handlers=(wrong,))
    assert "Nowhere" in answer


# What is kept


def test_all_of_a_task_that_is_over_is_kept() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, works=holding("Robot1"), undoes=restore_object), Robot("Robot2", 25, 60))
    task = system.submit(GOAL)
    (view,) = system.finish(task)
    record = system.task_record()
    assert (record.task, record.outcome, record.client) == (task, Outcome.ACCOMPLISHED, "client")
    assert record.work == view.work
    assert {contract.service for contract in record.contracts if contract.accepted} == {"Robot1.TransferObject", "Robot2.TransferObject"}
    assert all(contract.price in (10, 25) for contract in record.contracts)
    recorded_types = [message.type for message in record.messages]
    sent_types = [type(m.body).__name__ for m in system.world.messages if m.header.transaction == task]
    assert sorted(recorded_types) == sorted(sent_types)
    assert [message.at for message in record.messages] == sorted(message.at for message in record.messages)


def test_the_task_manager_may_be_killed_at_any_time() -> None:
    """FRP, property 7: what goes on from its journal, or from a snapshot, ends as it would have without."""
    for snapshot in (False, True):
        system = patrolled_system("Floor001", Robot("Robot1", 10, 600), Robot("Robot2", 25, 60, undoes=restore_object))
        task = system.submit(GOAL)
        goes_silent(system, task)
        for number in range(400):
            system.world.run(0.5)
            system.restart_manager(snapshot=snapshot and number % 3 == 0)
            if system.view(task).outcome is not None:
                break
        assert system.view(task).outcome is Outcome.ACCOMPLISHED
        executes = {m.header.message_id for m in system.world.messages if isinstance(m.body, frp.Execute)}
        assert len(executes) == 3, "Robot1, whoever looked, Robot2: nothing was done twice"


def carries(order: Order) -> Work:
    yield 10.0, Advance(fraction=0.4, situation="Jar002 isHeldBy Robot1")
    yield 50.0, WorkDone(situation=transfer_effect(order))


def dies_with_the_jar(robot: Robot, *, waits: bool) -> tuple[VirtualSystem, str]:
    """A system whose only robot dies with the jar of the task, and the task."""
    system = VirtualSystem(robot)
    task = system.submit(GOAL, waits=waits)
    assert system.world.run(60, lambda: system.map.has_fact("isHeldBy", ("Jar002", "Robot1")))
    system.world.kill("devices/Robot1")
    return system, task


@pytest.mark.parametrize("situation", ["Jar002 isHeldBy Robot1", "Jar002 isOn Floor001", None])
def test_a_task_goes_on_when_the_robot_is_back_that_it_had_given_up(situation: str | None) -> None:
    """It is not given up for what the map says until the robot has said how its work ended. What it still holds, it gives back first."""
    robot = Robot("Robot1", 10, 60, works=carries, lays_down=situation, undoes=restore_object)
    system, task = dies_with_the_jar(robot, waits=True)
    system.world.run(100)
    assert system.view(task).phase is Phase.WAITING
    system.restart(robot)
    (view,) = system.finish(task, seconds=300)
    assert view.outcome is Outcome.ACCOMPLISHED
    robot_messages = [kind for kind, _ in system.protocol_messages(task)]
    assert ("Compensated" in robot_messages) is (situation != "Jar002 isOn Floor001")


def dies_while_it_gives_back(robot: Robot, system: VirtualSystem, task: str) -> None:
    """The robot is back with the jar, and dies again while it undoes its work."""
    system.world.run(100)
    system.restart(robot)
    assert system.world.run(60, lambda: ("Compensate", "Robot1") in system.protocol_messages(task))
    system.world.run(5)
    system.world.kill("devices/Robot1")


def test_a_robot_that_is_away_again_while_it_gives_something_back_is_heard_out_too() -> None:
    robot = Robot("Robot1", 10, 60, works=carries, lays_down="Jar002 isHeldBy Robot1", undoes=restore_object)
    system, task = dies_with_the_jar(robot, waits=True)
    dies_while_it_gives_back(robot, system, task)
    system.world.run(100)
    robot.lays_down = "Jar002 isOn Floor001"
    system.restart(robot)
    (view,) = system.finish(task, seconds=300)
    assert ("Stranded", "Robot1") in system.protocol_messages(task)
    assert view.outcome is Outcome.ACCOMPLISHED


@pytest.mark.parametrize("is_undoing", [False, True])
def test_of_a_robot_that_is_back_without_its_contracts_nothing_is_awaited(is_undoing: bool) -> None:
    robot = Robot("Robot1", 10, 60, works=carries, lays_down="Jar002 isHeldBy Robot1", undoes=restore_object)
    system, task = dies_with_the_jar(robot, waits=True)
    if is_undoing:
        dies_while_it_gives_back(robot, system, task)
    system.world.remove("devices/Robot1")
    system.world.run(4000)
    assert system.view(task).phase is Phase.WAITING
    system.join(robot)
    system.world.run(120)
    waiting = system.view(task).waiting_to_retry
    assert {hindrance.subject for hindrance in waiting.hindrances} == {"RecognizeSituation"} if waiting else not is_undoing


def test_what_a_robot_lays_down_that_comes_back_when_all_is_over_comes_to_the_map() -> None:
    robot = Robot("Robot1", 10, 60, works=carries, lays_down="Jar002 isOn Floor001")
    system, task = dies_with_the_jar(robot, waits=False)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.FAILED
    system.restart(robot)
    system.world.run(30)
    assert system.device("Robot1").state_of(task, "Robot1.TransferObject#step1") is State.ENDED
    assert system.map.has_fact("isOn", ("Jar002", "Floor001"))


def test_what_contradicts_an_assumption_is_known_before_anything_is_planned_on_it() -> None:
    """News of the map comes late; the Repository's refusal says that there is some."""

    def slow_news(message: Message) -> tuple[float, ...]:
        return (30.0 if isinstance(message.body, MapChanged) and message.header.recipient == "tm" else LATENCY,)

    def loses(order: Order) -> Work:
        yield 10.0, ServiceFailed("it is not in the gripper any more")

    system = VirtualSystem(Robot("Robot1", 10, 60, works=loses), Robot("Robot2", 25, 60), medium=slow_news)
    task = system.submit(GOAL)
    assert system.world.run(60, lambda: ("Execute", "Robot1") in system.protocol_messages(task))
    update(system, FactRemoved(Fact("isOn", ("Jar002", "Cupboard001"))), FactAdded(Fact("isOn", ("Jar002", "Floor001"))))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    second = [m.body for m in system.world.messages if isinstance(m.body, frp.Execute)][-1]
    assert second.precondition is not None
    assert "Jar002 isOn Floor001" in second.precondition


# Trying again


def slips(times: int, *, extra_text: str = "") -> Script:
    """The first so many works fail, with the thing where it was, and what else is said."""
    works = 0

    def carries(order: Order) -> Work:
        nonlocal works
        works += 1
        situation = f"{order.inputs['Object']} isOn Cupboard001{extra_text}"
        yield 10.0, ServiceFailed("it slipped", situation) if works <= times else WorkDone(situation=transfer_effect(order))

    return carries


def test_who_alone_can_do_it_may_try_again() -> None:
    system = VirtualSystem(robot := Robot("Robot1", 10, 60, works=slips(3)))
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert len(robot.orders) == 4


def test_who_fails_again_and_again_is_not_asked_for_ever() -> None:
    system = VirtualSystem(robot := Robot("Robot1", 10, 60, works=slips(1000)))
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.FAILED
    assert len(robot.orders) == 5
    assert "it slipped" in view.explanation


def test_another_goes_before_who_failed() -> None:
    robots = Robot("Robot1", 10, 60, works=slips(1)), Robot("Robot2", 25, 60)
    system = VirtualSystem(*robots)
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert [len(robot.orders) for robot in robots] == [1, 1]


def test_who_says_that_it_does_not_work_is_not_asked_again() -> None:
    system = VirtualSystem(robot := Robot("Robot1", 10, 60, works=slips(1, extra_text=" AND Robot1.Working = FALSE")))
    (view,) = system.finish(system.submit(GOAL, waits=False))
    assert view.outcome is Outcome.FAILED
    assert len(robot.orders) == 1


def test_what_is_so_already_is_what_undoing_a_step_for_it_restores() -> None:
    system = VirtualSystem()
    step = Step(
        id="step1",
        service_type="TransferObject",
        inputs={"Object": Name("Jar002"), "Destination": Name("Cupboard001")},
        effect=parse("Jar002 isOn Cupboard001"),
    )
    assert str(situation_to_restore(step, system.map, system.repository.contents.ontology)) == "Jar002 isOn Cupboard001"
