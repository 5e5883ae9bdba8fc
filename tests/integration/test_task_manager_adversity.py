"""The Task Manager when others are away, late, or come back: one case each, on virtual time."""

from __future__ import annotations

import math

import pytest

from somrs.kernel.component import Effect, Input
from somrs.kernel.replica import ReplicaDue
from somrs.kernel.service_replica import ServicesDue
from somrs.ontology.objects import ObjectRemoved
from somrs.protocol.messages import events, frp
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import Updated, UpdateMap
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.protocol.messages.submission import CancelTask, Policy, Submit, TaskRejected
from somrs.protocol.messages.task_views import Phase
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Advance, Order, ServiceFailed
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.requests import DISCOVERY_TIME
from somrs.task_manager.state import REMEMBERED
from tests.support.virtual_system import Robot, Script, VirtualSystem

GOAL = "Jar002 isOn Platform001"
ROBOT1 = "devices/Robot1"


def run_until_executing(system: VirtualSystem, task: str) -> None:
    assert system.world.run(60, lambda: any(step.state is State.EXECUTING for step in system.view(task).steps))
    system.world.run(1)


def update(system: VirtualSystem, body: UpdateMap, seconds: float = 1.0) -> None:
    """Somebody changes the map."""
    id = message_id("person", system.world.now)
    system.world.send(Message(header=Header(sender="client", recipient="repository", message_id=id, reply_to="client"), body=body))
    system.world.run(seconds)


def test_a_task_cancelled_while_services_are_asked_stays_cancelled() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, mute=True))
    task = system.submit(GOAL)
    system.world.run(1)
    assert ("Arrange", "Robot1") in system.protocol_messages(task)
    system.ask(CancelTask(task=task))
    events = len(system.manager.state.tasks[task].events)
    system.world.run(300)
    assert (system.view(task).phase, system.view(task).outcome) == (Phase.ENDED, Outcome.CANCELLED)
    assert len(system.manager.state.tasks[task].events) == events
    assert system.world.timers("tm") == {ReplicaDue(), ServicesDue()}


def test_an_execute_that_was_lost_on_the_way_is_said_again() -> None:
    """A Query alone would find the robot alive, and waiting to be told to start, for ever."""
    system = VirtualSystem(Robot("Robot1", 10, 60))
    task = system.submit(GOAL)
    assert system.world.run(60, lambda: ("Execute", "Robot1") in system.protocol_messages(task))
    system.world.cut_off(ROBOT1)
    system.world.run(25)
    system.world.reconnect(ROBOT1)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert [(work.service, work.note) for work in view.work] == [("Robot1.TransferObject", "")]


@pytest.mark.parametrize("outage", [3.0, 15.0, 100.0])
@pytest.mark.parametrize("is_reachable", [0, 1])
def test_who_could_not_answer_while_the_task_manager_was_away_is_not_given_up(outage: float, is_reachable: int) -> None:
    """However long it was away: its question is heard, and so is the answer."""
    system = VirtualSystem(Robot("Robot1", 10, 60))
    if not is_reachable:
        system.world.cut_off(ROBOT1)
    task = system.submit(GOAL)
    assert system.world.run(60, lambda: ("Arrange", "Robot1") in system.protocol_messages(task))
    system.world.kill("tm")
    system.world.run(outage)
    system.world.reconnect(ROBOT1)
    system.restart_manager()
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert not any(isinstance(event.event, events.Replanned) for event in system.manager.state.tasks[task].events)


def test_the_repository_may_be_away_when_the_work_is_done() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    task = system.submit(GOAL)
    run_until_executing(system, task)
    system.world.cut_off("repository")
    system.world.run(200)
    assert system.view(task).outcome is None
    system.world.reconnect("repository")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert system.map.has_fact("isOn", ("Jar002", "Platform001"))


def hold_jar(order: Order) -> Work:
    """It stops by itself when it notices that nobody hears it, and says what it had come to."""
    yield 10.0, Advance(fraction=0.3, situation="Jar002 isHeldBy Robot1")
    yield 500.0, ServiceFailed("too slow", None)


def test_what_a_robot_did_that_had_been_given_up_comes_to_the_map() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, works=hold_jar))
    task = system.submit(GOAL, waits=False)
    run_until_executing(system, task)
    system.world.cut_off(ROBOT1)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.FAILED
    assert "fell silent" in view.explanation
    assert not list(system.map.facts_about("Jar002")), "nothing is assumed"
    assert system.map.objects["Jar002"].values["Unknown"] is True
    system.world.reconnect(ROBOT1)
    system.world.run(60)
    assert system.map.has_fact("isHeldBy", ("Jar002", "Robot1"))
    assert "Unknown" not in system.map.objects["Jar002"].values
    assert system.device("Robot1").idle


@pytest.mark.parametrize(
    ("other_situation", "expected_fact"),
    [
        pytest.param("Jar002 isOn Cupboard002", ("isOn", ("Jar002", "Cupboard002")), id="what others said since of the same jar stays"),
        pytest.param("Jar001 isHeldBy Robot1", ("isHeldBy", ("Jar002", "Robot1")), id="what is said of one jar says nothing of the other"),
    ],
)
def test_a_late_report_counts_for_what_nobody_spoke_of_since(other_situation: str, expected_fact: tuple[str, tuple[str, str]]) -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, works=hold_jar))
    task = system.submit(GOAL, waits=False)
    run_until_executing(system, task)
    system.world.cut_off(ROBOT1)
    system.finish(task)
    update(system, UpdateMap(situation=other_situation, author="a person"))
    system.world.reconnect(ROBOT1)
    system.world.run(60)
    assert system.map.has_fact(*expected_fact)


def test_what_the_task_speaks_of_may_go() -> None:
    def loses(order: Order) -> Work:
        yield 10.0, ServiceFailed("it broke", None)

    system = VirtualSystem(Robot("Robot1", 10, 60, works=loses))
    task = system.submit(GOAL)
    run_until_executing(system, task)
    update(system, UpdateMap(changes=(ObjectRemoved("Jar002"),), author="a person"))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.FAILED
    assert "does not fit the map any more" in view.explanation
    assert "Jar002" in view.explanation


def test_work_for_a_task_manager_that_was_restarted_is_sent_home() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    task = system.submit(GOAL)
    run_until_executing(system, task)
    system.world.remove("tm")
    system.world.add("tm", TaskManager("tm", repository="repository", registry="registry"))
    system.world.run(30)
    assert system.protocol_messages(task)[-1] == ("End", "Robot1")
    assert system.device("Robot1").idle


def test_without_a_repository_clients_hear_what_is_wrong() -> None:
    system = VirtualSystem()
    system.world.remove("repository")
    system.world.remove("tm")
    system.world.add("tm", TaskManager("tm", repository="repository", registry="registry"))
    for question in (Submit(effect=GOAL), Preview(effect=GOAL)):
        answer = system.ask(question)
        assert isinstance(answer, frp.Fault)
        assert "repository does not answer" in answer.text


def test_without_a_registry_clients_hear_what_is_wrong() -> None:
    system = VirtualSystem()
    system.world.remove("registry")
    system.world.remove("tm")
    system.add_manager("tm")
    system.world.run(5)
    answer = system.ask(Preview(effect=GOAL))
    assert isinstance(answer, Previewed)
    assert answer.explanation == "the Service Registry does not answer"
    (view,) = system.finish(system.submit(GOAL, waits=False))
    assert view.explanation == "the Service Registry does not answer"


def test_who_knows_the_services_on_offer_needs_no_registry() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    system.world.remove("registry")
    (view,) = system.finish(system.submit(GOAL, waits=False), seconds=100)
    assert view.outcome is Outcome.ACCOMPLISHED
    system.restart_manager(snapshot=True)
    (view,) = system.finish(system.submit("Jar002 isOn Cupboard001", waits=False), seconds=100 + DISCOVERY_TIME)
    assert view.outcome is Outcome.ACCOMPLISHED


def test_amounts_that_are_none_are_rejected() -> None:
    system = VirtualSystem()
    for task, name in (
        (Submit(effect=GOAL, deadline=-5.0), "deadline"),
        (Submit(effect=GOAL, deadline=math.nan), "deadline"),
        (Submit(effect=GOAL, time_value=math.inf), "time_value"),
    ):
        answer = system.ask(task)
        assert isinstance(answer, TaskRejected)
        assert name in answer.problem


def test_the_oldest_tasks_that_are_over_are_forgotten() -> None:
    robot = Robot("Robot1", 10, 6_000)
    system = VirtualSystem(robot)
    alive = system.submit(GOAL)
    run_until_executing(system, alive)
    ended_tasks = [system.submit("Jar001 isOn Cupboard002") for _ in range(REMEMBERED + 10)]
    system.finish(ended_tasks[-1])
    assert len(system.manager.state.tasks) == REMEMBERED
    assert alive in system.manager.state.tasks, "a task that is not over is never forgotten"
    assert ended_tasks[0] not in system.manager.state.tasks
    assert ended_tasks[-1] in system.manager.state.tasks


class Stranger:
    """Takes whatever comes, and says nothing."""

    def handle(self, event: Input, now: float) -> list[Effect]:
        return []


def test_a_device_that_takes_messages_and_never_answers_is_left_out() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 25, 30))
    system.world.remove(ROBOT1)
    system.world.add(ROBOT1, Stranger())
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.steps[0].service == "Robot2.TransferObject"


def drops(delay: float) -> Script:
    def works(order: Order) -> Work:
        yield delay, ServiceFailed("it slipped", f"{order.inputs['Object']} isOn Floor001")

    return works


BOTH_JARS = "Jar001 isOn Platform001 AND Jar002 isOn Platform001"


def test_a_second_report_that_is_on_its_way_is_awaited_before_anyone_is_asked() -> None:
    """FRP, property 5: two robots drop their jars at nearly the same time."""

    system = VirtualSystem(Robot("Robot1", 1, 20, works=drops(10.0)), Robot("Robot2", 1, 20, works=drops(9.9985)), Robot("Robot3", 1, 500))
    task = system.submit(BOTH_JARS, policy=Policy.TIME)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    kinds = [type(m.body) for m in system.world.messages]
    failed = [number for number, kind in enumerate(kinds) if kind is frp.Failed]
    assert len(failed) == 2
    assert kinds.index(UpdateMap) < failed[1], "the second fails while the first report is on its way"
    next_arrange = kinds.index(frp.Arrange, failed[0])
    assert kinds[failed[0] : next_arrange].count(Updated) == 2


def test_nothing_begins_while_the_plan_is_made_anew() -> None:
    """One of two steps turns out to be impossible when both are to begin: the other may not be in the next plan."""
    robot1, robot2 = Robot("Robot1", 1, 60), Robot("Robot2", 1, 60)
    system = VirtualSystem(robot1, robot2)
    task = system.submit(BOTH_JARS, policy=Policy.TIME)
    assert system.world.run(60, lambda: "Arrange" in [kind for kind, _ in system.protocol_messages(task)])
    jar = system.view(task).steps[0].inputs["Object"]
    directory = system.manager.state.discovery.directory
    assert directory is not None
    directory.confirmed = False  # the services on offer are not known until the Registry has answered
    system.world.cut_off("registry")
    update(system, UpdateMap(situation=f"{jar} isHeldBy Robot3", author="a person"), seconds=0.05)
    system.world.run(5)
    assert system.view(task).phase is Phase.PLANNING
    assert not robot1.orders
    assert not robot2.orders
    update(system, UpdateMap(situation=f"{jar} isOn Cupboard002", author="a person"))
    system.world.reconnect("registry")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert len(robot1.orders) == len(robot2.orders) == 1


def test_a_robot_that_fails_while_its_terms_for_another_step_are_awaited_does_not_get_it() -> None:
    first = Robot("Robot1", 1, 20, works=drops(10.0))
    system = VirtualSystem(first, Robot("Robot2", 1, 20, works=drops(9.9)), Robot("Robot3", 1, 500))
    (view,) = system.finish(system.submit(BOTH_JARS, policy=Policy.TIME))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert len(first.orders) == 1


def test_who_takes_for_ever_to_stop_is_given_up_and_nothing_is_known_of_what_it_had() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 600, halts=5_000.0))
    task = system.submit(GOAL)
    run_until_executing(system, task)
    cancel_time = system.world.now
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    assert 60 <= system.world.now - cancel_time < 70, "a robot has a minute to stop"
    assert system.protocol_messages(task)[-2:] == [("Stop", "Robot1"), ("End", "Robot1")]
    assert "nothing is known of Jar002" in view.explanation
    assert system.map.objects["Jar002"].values["Unknown"] is True


def test_who_takes_for_ever_to_undo_something_is_given_up_and_the_task_ends() -> None:
    def undo_endlessly(order: Order, situation: str) -> Work:
        yield 5_000.0, None

    system = VirtualSystem(Robot("Robot1", 10, 30, undoes=undo_endlessly))
    task = system.submit(BOTH_JARS)
    assert system.world.run(100, lambda: ("Completed", "Robot1") in system.protocol_messages(task))
    system.world.run(3)
    cancel_time = system.world.now
    system.ask(CancelTask(task=task))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    assert system.world.now - cancel_time < 600
    assert "could not be undone, and it left Jar001 isOn Platform001" in view.explanation


STRANGER = "stranger"
"""The address of somebody else, to which nobody answers."""


def interfere(system: VirtualSystem, task: str, body: frp.Stop | frp.End | frp.Execute, sender: str | None = None) -> None:
    """Somebody else gives the robot of the task an order, by default in the name of its coordinator, as a copy of that would do."""
    (member,) = [member for member in system.manager.state.tasks[task].members if member.state is State.EXECUTING]
    header = Header(
        sender=sender or system.manager.address,
        recipient=ROBOT1,
        message_id=message_id("stranger", type(body).__name__),
        transaction=task,
        participant=member.id,
        reply_to=STRANGER,
        relates_to=member.session.terms_id,
    )
    system.world.send(Message(header=header, body=body))


@pytest.mark.parametrize(
    "orders",
    [
        (frp.Stop(reason="mine"),),
        (frp.End(outcome=Outcome.CANCELLED),),
        (frp.Stop(reason="mine"), frp.End(outcome=Outcome.CANCELLED)),
    ],
)
def test_a_robot_that_somebody_else_has_stopped_is_found_out_with_the_first_question(orders: tuple[frp.Stop | frp.End, ...]) -> None:
    system = VirtualSystem(Robot("Robot1", 10, 600), Robot("Robot2", 20, 5))
    task = system.submit(GOAL)
    run_until_executing(system, task)
    for order in orders:
        interfere(system, task, order)
        system.world.run(3)
    assert system.world.run(60, lambda: system.view(task).work[0].state is not State.EXECUTING)
    assert [kind for kind, device in system.protocol_messages(task) if device == "Robot1"].count("Query") == 1
    assert system.view(task).work[0].state in (State.STOPPED, State.FAILED)


@pytest.mark.parametrize("order", [frp.Stop(reason="mine"), frp.End(outcome=Outcome.CANCELLED), frp.Execute(inputs={})])
def test_a_robot_obeys_nobody_but_its_coordinator(order: frp.Stop | frp.End | frp.Execute) -> None:
    system = VirtualSystem(Robot("Robot1", 10, 30))
    task = system.submit(GOAL)
    run_until_executing(system, task)
    interfere(system, task, order, sender=STRANGER)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    assert [(work.service.partition(".")[0], work.state) for work in view.work] == [("Robot1", State.COMPLETED)]


def test_a_report_that_went_to_somebody_else_is_asked_for() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 30))
    task = system.submit(GOAL)
    run_until_executing(system, task)
    interfere(system, task, frp.Execute(inputs={}))
    assert system.world.run(100, lambda: system.view(task).work[0].state is not State.EXECUTING)
    assert system.view(task).work[0].note == "failed: no heartbeat reached the coordinator, so the work was stopped"
