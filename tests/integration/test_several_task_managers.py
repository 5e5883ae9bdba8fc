"""Several Task Managers on one Repository: their tasks share the objects and the robots, as the tasks of one do."""

from __future__ import annotations

import pytest

from somrs.kernel.reservations import LEASE, Reservations
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.reservations import TaskAssigned
from somrs.protocol.messages.submission import CancelTask, Policy, Submit, SubmitOnce, TaskRejected
from somrs.protocol.messages.task_views import Phase
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Order, ServiceFailed, WorkDone
from somrs.task_manager.reservations import TaskReservation
from tests.integration.test_competing_tasks import Hands, run_until_executing
from tests.support.event_sentences import texts
from tests.support.virtual_system import Robot, VirtualSystem, transfer_effect

A, B = "tm", "tm-b"
FIRST, SECOND = "Jar002 isOn Platform001", "Jar002 isOn Cupboard002"


def two_managers(*robots: Robot, planning: float = 0.0) -> VirtualSystem:
    system = VirtualSystem(*robots, planning=planning)
    system.add_manager(B)
    system.world.run(5)
    return system


@pytest.mark.parametrize("planning", [0.0, 3.0])
def test_opposite_wishes_for_one_thing_come_true_one_after_the_other(planning: float) -> None:
    hands = Hands()
    system = two_managers(hands.robot("Robot1"), hands.robot("Robot2"), planning=planning)
    tasks = [system.submit(FIRST, A, policy=Policy.TIME), system.submit(SECOND, B, policy=Policy.TIME)]
    views = system.finish(*tasks)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 2
    assert not hands.conflicts
    earlier, later = sorted(views, key=lambda view: view.ended_at or 0.0)
    assert earlier.ended_at is not None
    assert min(work.began for work in later.work) >= earlier.ended_at


def test_who_waits_says_for_which_task_though_another_task_manager_has_it() -> None:
    hands = Hands()
    system = two_managers(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit(FIRST, A)
    run_until_executing(system, first)
    second = system.submit(SECOND, B)
    system.world.run(5)
    view = system.view(second)
    assert view.phase is Phase.WAITING
    assert f"waiting for task {short_id(first)} ({FIRST}), which has reserved Jar002" in view.explanation
    assert [view.outcome for view in system.finish(first, second)] == [Outcome.ACCOMPLISHED] * 2


def test_a_wish_that_any_thing_fulfils_takes_one_that_nobody_has() -> None:
    hands = Hands()
    system = two_managers(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit("Jar001 isOn Platform001", A)
    run_until_executing(system, first)
    second = system.submit("?Any: Jar isOn Floor001", B)
    assert system.world.run(30, lambda: system.view(second).phase is Phase.EXECUTING), system.view(second)
    assert system.view(second).steps[0].inputs["Object"] != "Jar001"


def test_a_cancelled_task_does_not_put_back_what_a_task_of_another_has_moved() -> None:
    """The first of two things is where A's task wants it, when B's task wants it elsewhere and A's task is cancelled."""

    def works(order: Order) -> Work:
        yield 20.0 if len(robot.orders) == 1 else 500.0, WorkDone(situation=transfer_effect(order))

    def undoes(order: Order, situation: str) -> Work:
        yield 20.0, WorkDone(situation=situation)

    robot = Robot("Robot1", price=10, duration=20, works=works, undoes=undoes)
    system = two_managers(robot, Robot("Robot2", price=20, duration=20))
    a = system.submit("Jar001 isOn Platform001 AND Jar002 isOn Platform001", A)
    moved = first_moved(system, a)
    b = system.submit(f"{moved} isOn Floor001", B, policy=Policy.TIME)
    system.world.run(100)
    assert system.view(b).phase is Phase.WAITING
    system.ask(CancelTask(task=a), A)
    views = system.finish(a, b)
    assert [view.outcome for view in views] == [Outcome.CANCELLED, Outcome.ACCOMPLISHED]
    assert system.map.has_fact("isOn", (moved, "Floor001"))


def first_moved(system: VirtualSystem, task: str) -> str:
    """What the task has moved first, as soon as it is there."""
    assert system.world.run(600, lambda: any(work.ended is not None for work in system.view(task).work))
    return system.view(task).work[0].inputs["Object"]


def test_what_a_waiting_task_has_done_and_another_has_by_now_is_not_undone_and_the_client_is_told() -> None:
    """The robot has no charge left for the second thing of A's task, so that the task waits, and releases what it has. B's task takes the
    first thing."""

    def works(order: Order) -> Work:
        if len(robot.orders) == 1:
            yield 20.0, WorkDone(situation=transfer_effect(order))
        robot.refuses, robot.not_now = "is charging", True
        yield 1.0, ServiceFailed("the charge is low")

    robot = Robot("Robot1", price=10, duration=20, works=works)
    system = two_managers(robot)
    a = system.submit("Jar001 isOn Platform001 AND Jar002 isOn Platform001", A)
    moved = first_moved(system, a)
    assert system.world.run(60, lambda: system.view(a).phase is Phase.WAITING)
    system.join(Robot("Robot2", price=10, duration=30))
    b = system.submit(f"{moved} isOn Floor001", B)
    run_until_executing(system, b)
    system.ask(CancelTask(task=a), A)
    views = system.finish(a, b)
    assert [view.outcome for view in views] == [Outcome.CANCELLED, Outcome.ACCOMPLISHED]
    assert system.map.has_fact("isOn", (moved, "Floor001"))
    assert short_id(b) in " ".join(texts(system.task_state(a)))


def test_tasks_of_two_task_managers_spread_over_the_robots() -> None:
    """Both are stated at the same moment, and the same robot is the cheapest for both."""
    cheap, dear = Robot("Robot1", price=10, duration=60), Robot("Robot2", price=12, duration=60)
    system = two_managers(cheap, dear)
    tasks = [
        system.submit("Jar001 isOn Platform001", A, policy=Policy.TIME),
        system.submit("Jar002 isOn Platform001", B, policy=Policy.TIME),
    ]
    start = system.world.now
    system.finish(*tasks)
    assert (len(cheap.orders), len(dear.orders)) == (1, 1)
    assert system.world.now - start < 100, "they worked side by side"


def test_of_tasks_that_wait_at_two_task_managers_the_higher_priority_comes_first() -> None:
    hands = Hands()
    system = two_managers(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit(FIRST, A)
    run_until_executing(system, first)
    low, high = system.submit(SECOND, A), system.submit("Jar002 isOn Floor001", B, priority=5)
    views = system.finish(first, low, high)
    ends = {task: view.ended_at or 0.0 for task, view in zip((first, low, high), views, strict=True)}
    assert sorted(ends, key=lambda task: ends[task]) == [first, high, low]


@pytest.mark.parametrize("snapshot", [False, True])
def test_a_task_manager_that_restarts_still_has_what_it_had(snapshot: bool) -> None:
    hands = Hands()
    system = two_managers(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit(FIRST, A)
    run_until_executing(system, first)
    second = system.submit(SECOND, B)
    system.world.run(5)
    for manager in (A, B):
        if snapshot:
            system.world.snapshot(manager)
        system.world.revive(manager)
    system.world.run(5)
    assert system.view(second).phase is Phase.WAITING
    assert [view.outcome for view in system.finish(first, second)] == [Outcome.ACCOMPLISHED] * 2
    assert not hands.conflicts


def test_what_a_task_manager_had_that_is_gone_for_good_is_free_after_its_lease() -> None:
    hands = Hands()
    system = two_managers(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit(FIRST, A)
    run_until_executing(system, first)
    system.world.kill(A)
    start = system.world.now
    second = system.submit(SECOND, B)
    system.world.run(LEASE - 60)
    assert system.view(second).phase is Phase.WAITING
    (view,) = system.finish(second)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert min(work.began for work in view.work) - start >= LEASE - 60


def test_who_was_cut_off_too_long_is_told_that_another_has_its_things_and_does_them_after_it() -> None:
    hands = Hands()
    system = two_managers(hands.robot("Robot1", seconds=30), hands.robot("Robot2", seconds=30))
    first = system.submit(FIRST, A)
    run_until_executing(system, first)
    system.world.cut_off(A)
    second = system.submit(SECOND, B)
    system.world.run(LEASE + 60)
    system.world.reconnect(A)
    views = system.finish(first, second, seconds=20_000)
    assert views[1].outcome is Outcome.ACCOMPLISHED
    assert any(
        "the reservation was lost" in text or "is not the task's to change any more" in text for text in texts(system.task_state(first))
    )
    assert not hands.conflicts


def test_what_a_program_of_before_had_reserved_itself_is_kept_for_its_tasks_after_the_upgrade() -> None:
    """As of a journal of version 2: the Task Manager has reserved, and the Repository knows nothing of it."""
    hands = Hands()
    system = two_managers(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit(FIRST, A)
    run_until_executing(system, first)
    state, reservations = system.manager_at(A).state, system.repository.contents.reservations
    state.tasks[first].reservation = TaskReservation(held=state.tasks[first].reservation.held)
    state.local_reservations, reservations.claimants = Reservations(claimants=reservations.claimants), {}
    system.world.snapshot(A)
    system.world.revive(A)
    system.world.run(5)
    second = system.submit(SECOND, B)
    system.world.run(5)
    assert system.view(second).phase is Phase.WAITING
    assert [view.outcome for view in system.finish(first, second)] == [Outcome.ACCOMPLISHED] * 2
    assert not hands.conflicts


def send_once(system: VirtualSystem, manager: str, effect: str = FIRST, id: str = "urn:uuid:submission") -> None:
    """A client that states a task at this Task Manager, and maybe at others, too."""
    header = Header(sender="client", recipient=manager, message_id=id, reply_to="client")
    system.world.send(Message(header=header, body=SubmitOnce(submission=Submit(effect=effect))))


def assigned_to(system: VirtualSystem) -> list[str]:
    """The Task Managers that the answers to the client name."""
    return [message.body.task_manager for message in system.client.received if isinstance(message.body, TaskAssigned)]


@pytest.mark.parametrize("order", [(A, B), (B, A)])
def test_a_task_that_is_stated_at_two_task_managers_is_one_task(order: tuple[str, str]) -> None:
    hands = Hands()
    system = two_managers(hands.robot("Robot1"), hands.robot("Robot2"))
    for _ in range(2):
        for manager in order:
            send_once(system, manager)
        system.world.run(5)
    assert len(assigned_to(system)) == 4
    (owner,) = {*assigned_to(system)}
    other = A if owner == B else B
    (task,) = system.manager_at(owner).state.tasks
    assert not system.manager_at(other).state.tasks
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert len(system.client.received) == 4


@pytest.mark.parametrize("snapshot", [False, True])
def test_a_task_goes_on_at_the_task_manager_that_died_when_it_was_given_to_it(snapshot: bool) -> None:
    """It has asked whose the task is, and dies before the answer. The client states the task at another one, and again when the first is
    back."""
    hands = Hands()
    system = two_managers(hands.robot("Robot1"), hands.robot("Robot2"))
    system.world.cut_off("repository")
    send_once(system, A)
    system.world.run(1)
    assert not assigned_to(system)
    if snapshot:
        system.world.snapshot(A)
    system.world.reconnect("repository")
    assert system.world.run(60, lambda: bool(system.repository.contents.answered))
    system.world.kill(A)
    send_once(system, B)
    assert system.world.run(60, lambda: A in assigned_to(system)), "the answer of the other one"
    assert not system.manager_at(B).state.tasks
    system.world.revive(A)
    system.world.run(60)
    send_once(system, A)
    (task,) = system.manager_at(A).state.tasks
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert {*assigned_to(system)} == {A}


def test_a_task_with_a_mistake_is_refused_and_given_to_nobody() -> None:
    system = two_managers(Hands().robot("Robot1"))
    for manager in (A, B):
        send_once(system, manager, "NoSuchJar isOn Platform001")
    system.world.run(10)
    assert [type(message.body) for message in system.client.received] == [TaskRejected] * 2
    assert not system.manager_at(A).state.tasks
    assert not system.manager_at(B).state.tasks
