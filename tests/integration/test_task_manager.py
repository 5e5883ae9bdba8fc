"""The Task Manager with real Repository, Registry and Service Managers, on virtual time: what clients and robots see."""

from __future__ import annotations

from somrs.protocol.messages.frp import Arrange, Failed, Outcome, State
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.protocol.messages.submission import CancelTask, Policy
from somrs.protocol.messages.task_news import ReadTasks, Tasks
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Advance, Order, ServiceFailed, WorkDone
from tests.support.event_sentences import texts
from tests.support.virtual_system import Robot, VirtualSystem, transfer_effect

GOAL = "Jar002 isOn Platform001"
DROPPED = "Jar002.PositionX = 4.5 AND Jar002.PositionY = 1.3 AND Jar002.PositionZ = 0 AND Jar002 isOn Floor001"


def breaks(order: Order) -> Work:
    """The paper's Scenario 1b: the drive breaks on the way, and the jar is put down."""
    yield 10.0, Advance(fraction=0.4, situation="Jar002 isHeldBy Robot1")
    yield 10.0, ServiceFailed("the drive is out of order", f"{DROPPED} AND Robot1.Working = FALSE")


def test_scenario_1_has_the_papers_messages_and_the_cheaper_service_does_it() -> None:
    system = VirtualSystem(Robot("Robot1", price=10, duration=60), Robot("Robot2", price=25, duration=30))
    task = system.submit(GOAL, precondition="Jar002 isOn ?Shelf")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    robot_messages = system.protocol_messages(task)
    assert sorted(robot_messages[:2]) == [("Arrange", "Robot1"), ("Arrange", "Robot2")]
    assert sorted(robot_messages[2:4]) == [("Terms", "Robot1"), ("Terms", "Robot2")]
    assert sorted(robot_messages[4:6]) == [("Accept", "Robot1"), ("Cancel", "Robot2")]
    assert robot_messages[6:] == [("Execute", "Robot1"), ("Completed", "Robot1"), ("End", "Robot1")]
    assert system.map.has_fact("isOn", ("Jar002", "Platform001"))


def test_scenario_1b_replaces_the_broken_robot_from_where_the_jar_lies() -> None:
    system = VirtualSystem(Robot("Robot1", price=10, duration=60, works=breaks), Robot("Robot2", price=25, duration=30))
    task = system.submit(GOAL)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    robot_messages = system.protocol_messages(task)
    assert robot_messages[6:8] == [("Execute", "Robot1"), ("Failed", "Robot1")]
    assert robot_messages[8:13] == [(m, "Robot2") for m in ("Arrange", "Terms", "Accept", "Execute", "Completed")]
    assert sorted(robot_messages[13:]) == [("End", "Robot1"), ("End", "Robot2")]
    arranges = [m.body for m in system.world.messages if isinstance(m.body, Arrange)]
    assert arranges[-1].precondition is not None
    for part in DROPPED.split(" AND "):
        assert part in arranges[-1].precondition
    assert "Robot1" not in arranges[-1].precondition, "the next service need not know of the broken robot"
    assert system.map.objects["Robot1"].values["Working"] is False
    assert system.map.has_fact("isOn", ("Jar002", "Platform001"))
    assert not system.map.has_fact("isHeldBy", ("Jar002", "Robot1"))


def test_the_reported_situation_is_on_the_map_before_anyone_is_asked_again() -> None:
    """FRP, property 5."""
    system = VirtualSystem(Robot("Robot1", price=10, duration=60, works=breaks), Robot("Robot2", price=25, duration=30))
    task = system.submit(GOAL)
    map_checks: list[bool] = []

    def is_reassigned() -> bool:
        failed = any(isinstance(m.body, Failed) for m in system.world.messages)
        arranged_twice = sum(isinstance(m.body, Arrange) for m in system.world.messages) > 2
        if arranged_twice:
            map_checks.append(system.map.has_fact("isOn", ("Jar002", "Floor001")))
        return failed and arranged_twice

    assert system.world.run(600, is_reassigned)
    assert map_checks == [True]
    system.finish(task)


def test_the_policy_chooses() -> None:
    for policy, value, chosen in (
        (Policy.PRICE, 0.01, "Robot1"),
        (Policy.TIME, 0.01, "Robot2"),
        (Policy.WEIGHTED, 0.01, "Robot1"),
        (Policy.WEIGHTED, 1.0, "Robot2"),
    ):
        system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 25, 30))
        (view,) = system.finish(system.submit(GOAL, policy=policy, time_value=value))
        assert view.steps[0].service == f"{chosen}.TransferObject", (policy, value)


def test_when_every_robot_fails_the_client_hears_what_each_said() -> None:
    def sticks(order: Order) -> Work:
        yield 5.0, ServiceFailed("the gripper is stuck", "Jar002 isOn Cupboard001")

    system = VirtualSystem(Robot("Robot1", 10, 60, works=breaks), Robot("Robot2", 25, 30, works=sticks))
    (view,) = system.finish(system.submit(GOAL, waits=False))
    assert view.outcome is Outcome.FAILED
    assert "the drive is out of order" in view.explanation
    assert "the gripper is stuck" in view.explanation


def test_refusals_leave_the_task_to_whoever_takes_it() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, refuses="it is too heavy for me"), Robot("Robot2", 25, 30))
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.steps[0].service == "Robot2.TransferObject"
    single_robot_system = VirtualSystem(Robot("Robot1", 10, 60, refuses="it is too heavy for me"))
    (view,) = single_robot_system.finish(single_robot_system.submit(GOAL))
    assert view.outcome is Outcome.FAILED
    assert "it is too heavy for me" in view.explanation


def test_a_wish_that_everybody_refuses_is_said_to_be_refused() -> None:
    refusal = "Platform001 is too high"
    system = VirtualSystem(Robot("Robot1", 10, 60, refuses=refusal), Robot("Robot2", 25, 30, refuses=refusal))
    (view,) = system.finish(system.submit(GOAL))
    assert view.explanation == (
        f"no plan: {GOAL} could be brought about by TransferObject, "
        f"but no service is left (Robot1.TransferObject and Robot2.TransferObject: {refusal})"
    )


def test_a_goal_that_no_device_could_ever_reach_is_answered_before_anybody_is_asked() -> None:
    first = Robot("Robot1", 10, 60)
    for system in (VirtualSystem(first), VirtualSystem()):
        (view,) = system.finish(system.submit("Jar002 isOn Jar001"))
        assert view.outcome is Outcome.FAILED, "it does not wait for a device"
        assert "no service type brings it about" in view.explanation
        assert "Jar001.Supporting = TRUE" in view.explanation
        assert "it is FALSE, by default for a Jar" in view.explanation
    assert first.orders == []


def test_independent_tasks_run_at_the_same_time_on_different_robots() -> None:
    first, second = Robot("Robot1", 10, 60), Robot("Robot2", 25, 60)
    system = VirtualSystem(first, second)
    start = system.world.now
    tasks = [system.submit(GOAL, policy=Policy.TIME), system.submit("Jar001 isOn Platform001", policy=Policy.TIME)]
    views = system.finish(*tasks)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 2
    assert {len(first.orders), len(second.orders)} == {1}
    assert system.world.now - start < 90, "they did not wait for each other"


def test_one_robot_does_two_tasks_one_after_the_other() -> None:
    robot = Robot("Robot1", 10, 60)
    system = VirtualSystem(robot)
    start = system.world.now
    views = system.finish(system.submit(GOAL), system.submit("Jar001 isOn Platform001"))
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 2
    assert len(robot.orders) == 2
    assert system.world.now - start > 119


def test_parallel_steps_of_one_task_run_in_parallel() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 10, 60))
    start = system.world.now
    (view,) = system.finish(system.submit(f"{GOAL} AND Jar001 isOn Platform001", policy=Policy.TIME))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert {step.service for step in view.steps} == {"Robot1.TransferObject", "Robot2.TransferObject"}
    assert system.world.now - start < 90


def test_cancelling_stops_the_robot_and_ends_everyone() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 600), Robot("Robot2", 25, 300))
    task = system.submit(GOAL)
    assert system.world.run(60, lambda: any(step.state is State.EXECUTING for step in system.view(task).steps))
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    assert system.protocol_messages(task)[-3:] == [("Stop", "Robot1"), ("Stopped", "Robot1"), ("End", "Robot1")]


def test_signs_of_life_between_do_not_make_what_a_robot_says_twice_news() -> None:
    def says_it_twice(order: Order) -> Work:
        yield 1.0, Advance(fraction=0.3, note="carries the jar")
        yield 20.0, Advance(fraction=0.6, note="carries the jar")
        yield 1.0, WorkDone(situation=transfer_effect(order))

    system = VirtualSystem(Robot("Robot1", 10, 60, works=says_it_twice))
    task = system.submit(GOAL)
    system.finish(task)
    news = texts(system.manager.state.tasks[task])
    assert news.count("Robot1.TransferObject: carries the jar") == 1


def test_a_robot_that_falls_silent_is_asked_and_then_given_up() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 600))
    task = system.submit(GOAL, waits=False)
    assert system.world.run(60, lambda: any(step.state is State.EXECUTING for step in system.view(task).steps))
    system.world.remove("devices/Robot1")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.FAILED
    assert "Robot1.TransferObject: fell silent while it worked;" in view.explanation
    assert ("Query", "Robot1") in system.protocol_messages(task)


def test_nobody_is_contracted_who_says_that_it_takes_too_long() -> None:
    robot = Robot("Robot1", 10, 600)
    system = VirtualSystem(robot)
    (view,) = system.finish(system.submit(GOAL, deadline=100.0))
    assert view.outcome is Outcome.FAILED
    assert "latest finish" in view.explanation
    assert robot.orders == []


def test_a_deadline_ends_the_task() -> None:
    def dawdles(order: Order) -> Work:
        yield 600.0, WorkDone(situation=transfer_effect(order))

    system = VirtualSystem(Robot("Robot1", 10, 60, works=dawdles))
    start = system.world.now
    (view,) = system.finish(system.submit(GOAL, deadline=100.0))
    assert view.outcome is Outcome.FAILED
    assert "deadline" in view.explanation
    assert system.world.now - start < 120


def test_what_is_so_already_needs_nobody() -> None:
    system = VirtualSystem()
    (view,) = system.finish(system.submit("Jar002 isOn Cupboard001"))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.steps == ()


def test_a_wish_about_something_unknown_is_rejected_with_the_nearest_name() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    problem = system.rejected("Jar003 isOn Platform001")
    assert "Jar003" in problem
    assert "Jar002" in problem or "Jar001" in problem
    assert "^" in problem


def test_a_thing_that_is_nowhere_gets_a_clear_answer() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    (view,) = system.finish(system.submit("LostJar isOn Platform001"))
    assert view.outcome is Outcome.FAILED
    assert "LostJar" in view.explanation


def test_nobody_there_is_said() -> None:
    system = VirtualSystem()
    (view,) = system.finish(system.submit(GOAL, waits=False))
    assert view.outcome is Outcome.FAILED
    assert GOAL in view.explanation


def test_a_robot_that_joins_while_the_system_runs_is_used() -> None:
    system = VirtualSystem()
    system.join(Robot("Robot2", 25, 30))
    system.world.run(2)
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.ACCOMPLISHED


def test_a_wrong_report_is_not_believed_over_the_wish() -> None:
    """A robot says Completed, but what it reports is not the wish: the task is planned anew from what it reported."""
    reports = iter((WorkDone(situation="Jar002 isOn Cupboard002"),))

    def wrong(order: Order) -> Work:
        report = next(reports, None)
        yield 30.0, report if report is not None else WorkDone(situation=transfer_effect(order))

    robot = Robot("Robot1", 10, 60, works=wrong)
    system = VirtualSystem(robot)
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert len(robot.orders) == 2
    assert robot.orders[-1].precondition is not None
    assert "Cupboard002" in robot.orders[-1].precondition


def test_a_preview_shows_the_plan_and_asks_nobody() -> None:
    robot = Robot("Robot1", 10, 60)
    system = VirtualSystem(robot)
    answer = system.ask(Preview(effect=GOAL))
    assert isinstance(answer, Previewed)
    assert [step.service_type for step in answer.steps] == ["TransferObject"]
    assert robot.orders == []
    tasks = system.ask(ReadTasks())
    assert isinstance(tasks, Tasks)
    assert tasks.tasks == ()
