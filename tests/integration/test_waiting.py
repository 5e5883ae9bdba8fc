"""Tasks that wait because no service can do them now, and go on by themselves."""

from __future__ import annotations

from itertools import pairwise

import pytest

from somrs.protocol.messages import waits
from somrs.protocol.messages.directory import Retract, Retracted, ServicesJoined
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.protocol.messages.submission import CancelTask, Submit, Submitted
from somrs.protocol.messages.task_views import Phase
from somrs.runtime.virtual_network import LATENCY
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Order, Quote, ServiceFailed, WorkDone
from somrs.task_manager.world_clock import WorldTimePassed
from tests.support.virtual_system import Robot, VirtualSystem, drop_object, transfer_effect

GOAL = "Jar002 isOn Platform001"


def charging_robot() -> Robot:
    return Robot("Robot1", price=10, duration=60, refuses="it charges", not_now=True)


def update(system: VirtualSystem, situation: str) -> None:
    """Change the map, as a client or a device does."""
    header = Header(sender="client", recipient="repository", message_id=message_id("update", situation), reply_to="client")
    system.world.send(Message(header=header, body=UpdateMap(situation=situation, author="the operator")))


def logged(system: VirtualSystem, task: str, kind: type) -> list[object]:
    return [noted.event for noted in system.manager.state.tasks[task].events if isinstance(noted.event, kind)]


def test_a_task_for_which_all_robots_are_broken_waits_until_one_is_mended() -> None:
    robots = [Robot(f"Robot{number}", price=10, duration=60, refuses="the gripper is stuck", not_now=True) for number in (1, 2)]
    system = VirtualSystem(*robots)
    task = system.submit(GOAL)
    system.world.run(600)
    view = system.view(task)
    assert view.phase is Phase.WAITING
    assert view.waiting_to_retry is not None
    assert [hindrance.subject for hindrance in view.waiting_to_retry.hindrances] == ["Robot1.TransferObject", "Robot2.TransferObject"]
    assert "Robot1.TransferObject, Robot2.TransferObject: the gripper is stuck" in view.explanation
    robots[1].refuses = ""
    (view,) = system.finish(task, seconds=180)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert [work.service for work in view.work] == ["Robot2.TransferObject"]


def test_what_comes_to_nothing_for_the_same_reason_is_said_once() -> None:
    system = VirtualSystem(charging_robot())
    task = system.submit(GOAL)
    system.world.run(60)
    state = system.manager.state.tasks[task]
    event_count, message_count, participant_count = len(state.events), len(state.messages), len([*state.members])
    system.world.run(7200)
    assert len(logged(system, task, waits.WaitsToRetry)) == 1
    assert (len(state.events), len(state.messages), len([*state.members])) == (event_count, message_count, participant_count)
    assert state.goal.waiting_to_retry is not None
    assert state.goal.waiting_to_retry.attempts > 100
    assert "attempts" in system.view(task).explanation


def test_a_refusal_for_good_ends_the_task_also_after_a_wait() -> None:
    robot = charging_robot()
    system = VirtualSystem(robot)
    task = system.submit(GOAL)
    system.world.run(60)
    robot.refuses, robot.not_now = "it is too heavy for me", False
    (view,) = system.finish(task, seconds=180)
    assert view.outcome is Outcome.FAILED
    assert "it is too heavy for me" in view.explanation


def test_a_task_that_does_not_wait_fails() -> None:
    system = VirtualSystem(charging_robot())
    (view,) = system.finish(system.submit(GOAL, waits=False))
    assert view.outcome is Outcome.FAILED
    assert "it charges" in view.explanation


def test_the_wait_ends_with_the_deadline() -> None:
    system = VirtualSystem(charging_robot())
    task = system.submit(GOAL, deadline=300.0)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.FAILED
    assert view.ended_at == pytest.approx(view.submitted_at + 300)
    assert "the deadline of 300 s is over" in view.explanation
    assert "it charges" in view.explanation
    assert view.waiting_to_retry is None


@pytest.mark.parametrize(("rate", "seconds"), [(0.25, 1_200.0), (1.0, 300.0), (8.0, 37.5)])
def test_the_deadline_is_said_by_the_wall_s_clock_and_comes_in_the_world_s_time(rate: float, seconds: float) -> None:
    system = VirtualSystem(charging_robot())
    clock = system.manager.state.clock
    system.world.notify("tm", WorldTimePassed(seconds=clock.time_at(system.world.now) - clock.time, rate=rate))
    task = system.submit(GOAL, deadline=300.0)
    view = system.view(task)
    assert view.due_at == pytest.approx(view.submitted_at + seconds, abs=1e-3)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.FAILED
    assert view.ended_at == pytest.approx(view.submitted_at + seconds, abs=0.1)


def test_a_waiting_task_can_be_cancelled() -> None:
    system = VirtualSystem(charging_robot())
    task = system.submit(GOAL)
    system.world.run(600)
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task, seconds=10)
    assert view.outcome is Outcome.CANCELLED


def test_with_nobody_on_offer_the_task_goes_on_as_soon_as_a_robot_joins() -> None:
    system = VirtualSystem()
    task = system.submit(GOAL)
    system.world.run(3000)
    view = system.view(task)
    assert view.waiting_to_retry is not None
    assert [hindrance.subject for hindrance in view.waiting_to_retry.hindrances] == ["TransferObject"]
    joined_at = system.world.now
    system.join(Robot("Robot1", price=10, duration=60))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.work[0].began < joined_at + 5


def test_a_task_waits_for_a_robot_that_failed_and_then_says_that_it_cannot_serve_now() -> None:
    def is_driven_away(order: Order) -> Work:
        robot.refuses, robot.not_now = "all chargers are in use", True
        yield 5.0, ServiceFailed("another robot stands at the charger", f"{order.inputs['Object']} isOn Floor001")

    robot = Robot("Robot1", price=10, duration=60, works=is_driven_away)
    system = VirtualSystem(robot)
    task = system.submit(GOAL)
    system.world.run(3000)
    view = system.view(task)
    assert view.outcome is None, view.explanation
    assert view.waiting_to_retry is not None
    assert [hindrance.reason for hindrance in view.waiting_to_retry.hindrances] == ["all chargers are in use"]
    robot.refuses, robot.works = "", None
    (view,) = system.finish(task, seconds=600)
    assert view.outcome is Outcome.ACCOMPLISHED


def test_a_task_goes_on_as_soon_as_the_map_says_that_a_robot_works() -> None:
    robot = charging_robot()
    system = VirtualSystem(robot)
    update(system, "Robot1.Working = FALSE")
    task = system.submit(GOAL)
    system.world.run(3000)
    robot.refuses = ""
    mended_at = system.world.now
    update(system, "Robot1.Working = TRUE")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.work[0].began < mended_at + 5


def test_a_robot_that_broke_at_work_is_used_again_when_it_is_mended() -> None:
    def breaks(order: Order) -> Work:
        yield 5.0, ServiceFailed("the gripper is stuck", f"{order.inputs['Object']} isOn Floor001 AND Robot1.Working = FALSE")

    robot = Robot("Robot1", price=10, duration=60, works=breaks)
    system = VirtualSystem(robot)
    task = system.submit(GOAL)
    system.world.run(600)
    assert system.view(task).phase is Phase.WAITING
    robot.works = None
    update(system, "Robot1.Working = TRUE")
    (view,) = system.finish(task, seconds=180)
    assert view.outcome is Outcome.ACCOMPLISHED


def test_a_robot_that_fails_again_and_again_is_asked_after_growing_pauses() -> None:
    def slips(order: Order) -> Work:
        begin_times.append(system.world.now)
        yield 1.0, ServiceFailed("the jar slips", "Jar002 isOn Cupboard001")

    begin_times: list[float] = []
    system = VirtualSystem(Robot("Robot1", price=10, duration=60, works=slips))
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.FAILED
    assert "the jar slips" in view.explanation
    pauses = [end - start - 1.0 for start, end in pairwise(begin_times)]
    assert pauses[0] < 2.0, "a jar may slip once"
    assert pauses[1:] == [pytest.approx(pause, abs=1.5) for pause in (2.0, 4.0, 8.0)]
    assert pauses == sorted(pauses)


class RestlessRobot(Robot):
    """Refuses once after each failure, and then gives terms again."""

    def carry_out(self, task: object) -> Work:
        yield from Robot.carry_out(self, task)
        if isinstance(task, Quote):
            self.refuses = ""


def test_a_robot_that_fails_whenever_it_has_recovered_is_asked_less_and_less() -> None:
    """Seen with vehicles that reject each order: a refusal in between began the count of failures anew."""

    def rejects(order: Order) -> Work:
        robot.refuses, robot.not_now = "it starts again", True
        yield 1.0, ServiceFailed("the order was rejected", "Jar002 isOn Cupboard001")

    robot = RestlessRobot("Robot1", price=10, duration=60, works=rejects)
    system = VirtualSystem(robot)
    task = system.submit(GOAL)
    system.world.run(1800)
    assert system.view(task).outcome is None
    assert 10 < len(robot.orders) < 40
    robot.works = None
    (view,) = system.finish(task, seconds=180)
    assert view.outcome is Outcome.ACCOMPLISHED


def test_when_the_robot_that_fell_silent_with_the_jar_comes_back_the_task_goes_on() -> None:
    def carries(order: Order) -> Work:
        yield 60.0, WorkDone(situation=transfer_effect(order))

    robot = Robot("Robot1", price=10, duration=60, works=carries, lays_down="Jar002 isOn Floor001")
    system = VirtualSystem(robot)
    task = system.submit(GOAL)
    system.world.run(600, lambda: bool(robot.orders))
    system.world.kill("devices/Robot1")
    system.world.run(600)
    view = system.view(task)
    assert view.phase is Phase.WAITING
    assert view.waiting_to_retry is not None
    system.restart(robot)
    (view,) = system.finish(task, seconds=600)
    assert view.outcome is Outcome.ACCOMPLISHED


def test_a_waiting_task_holds_up_no_other() -> None:
    robot = charging_robot()
    system = VirtualSystem(robot)
    waiting = system.submit(GOAL)
    system.world.run(100)
    system.join(Robot("Robot2", price=10, duration=60, refuses="", works=None))
    other = system.submit("Jar002 isOn Cupboard002")
    system.finish(waiting, other)
    assert {system.view(task).outcome for task in (waiting, other)} == {Outcome.ACCOMPLISHED}


@pytest.mark.parametrize("client_request", [Submit(effect=GOAL, waits=False), Preview(effect=GOAL)])
def test_a_service_of_which_news_is_on_its_way_is_not_missing(client_request: Submit | Preview) -> None:
    """The Registry lists the robot, and its news takes three seconds to the Task Manager."""

    def medium(message: Message) -> tuple[float, ...]:
        return (3.0 if isinstance(message.body, ServicesJoined) else LATENCY,)

    system = VirtualSystem(medium=medium)
    system.join(Robot("Robot1", price=10, duration=60))
    assert system.world.run(60, lambda: "Robot1" in system.registry.state.providers)
    answer = system.ask(client_request)
    if isinstance(answer, Submitted):
        (view,) = system.finish(answer.task)
        assert view.outcome is Outcome.ACCOMPLISHED
    else:
        assert isinstance(answer, Previewed)
        assert [step.service_type for step in answer.steps] == ["TransferObject"]
    assert [len(problem.services) for problem in system.problems] == [0, 1]


def test_a_service_that_left_after_the_plan_was_made_does_not_replace_another() -> None:
    system = VirtualSystem(Robot("Robot1", price=10, duration=60, works=drop_object), Robot("Robot2", price=20, duration=60))
    task = system.submit(GOAL)
    assert system.world.run(60, lambda: ("Execute", "Robot1") in system.protocol_messages(task))
    assert ("Arrange", "Robot2") in system.protocol_messages(task)
    assert isinstance(system.ask(Retract(provider="Robot2"), "registry"), Retracted)
    invited_before = system.protocol_messages(task).count(("Arrange", "Robot2"))
    assert system.world.run(60, lambda: system.view(task).phase is Phase.WAITING or system.view(task).outcome is not None)
    assert system.protocol_messages(task).count(("Arrange", "Robot2")) == invited_before


def test_without_a_registry_a_task_waits_for_it() -> None:
    system = VirtualSystem(Robot("Robot1", price=10, duration=60))
    system.world.kill("registry")
    system.world.remove("tm")
    system.add_manager("tm")
    system.world.run(5)
    task = system.submit(GOAL)
    system.world.run(200)
    assert system.view(task).phase is Phase.WAITING
    assert "the Service Registry does not answer" in system.view(task).explanation
    system.world.revive("registry")
    (view,) = system.finish(task, seconds=300)
    assert view.outcome is Outcome.ACCOMPLISHED


def test_a_task_manager_that_is_restarted_goes_on_waiting() -> None:
    robot = charging_robot()
    system = VirtualSystem(robot)
    task = system.submit(GOAL)
    system.world.run(100)
    system.restart_manager(snapshot=True)
    system.world.run(100)
    assert system.view(task).phase is Phase.WAITING
    robot.refuses = ""
    (view,) = system.finish(task, seconds=180)
    assert view.outcome is Outcome.ACCOMPLISHED
