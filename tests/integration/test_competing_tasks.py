"""Several tasks that want the same things: what one was promised, another does not take."""

from __future__ import annotations

import random
from dataclasses import dataclass

import pytest

from somrs.ontology.objects import Fact, FactRemoved
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.submission import CancelTask, Policy
from somrs.protocol.messages.task_views import Phase
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Advance, Halt, Order, ServiceFailed, WorkDone
from tests.support.event_sentences import texts
from tests.support.virtual_system import Robot, VirtualSystem, transfer_effect

FIRST, SECOND = "Jar002 isOn Platform001", "Jar002 isOn Cupboard002"


class Hands:
    """What robots really do: `conflicts` tells of things that two of them had in their hands at a time."""

    def __init__(self) -> None:
        self.carried: dict[str, str] = {}
        self.conflicts: list[str] = []

    def robot(self, name: str, seconds: float = 60.0, fails: float = 0.0, seed: int = 0) -> Robot:
        dice = random.Random(f"{name} {seed}")

        def works(order: Order) -> Work:
            thing = order.inputs["Object"]
            self.pick_up(name, thing)
            yield seconds, Advance(fraction=1.0)
            self.release(name)
            slips = dice.random() < fails
            yield 0.0, ServiceFailed("it slipped", f"{thing} isOn Floor001") if slips else WorkDone(situation=transfer_effect(order))

        def undoes(order: Order, situation: str) -> Work:
            self.pick_up(name, order.inputs["Object"])
            yield seconds, Advance(fraction=1.0)
            self.release(name)
            yield 0.0, WorkDone(situation=situation)

        return Carrier(name, 10, seconds, works=works, undoes=undoes, hands=self)

    def pick_up(self, name: str, thing: str) -> None:
        if thing in self.carried:
            self.conflicts.append(f"{name} takes {thing}, which {self.carried[thing]} has")
        self.carried[thing] = name

    def release(self, name: str) -> None:
        self.carried = {thing: robot_name for thing, robot_name in self.carried.items() if robot_name != name}


@dataclass(slots=True, kw_only=True)
class Carrier(Robot):
    """It lays down what it carries when it is stopped."""

    hands: Hands

    def carry_out(self, task: object) -> Work:
        if isinstance(task, Halt):
            self.hands.release(self.name)
        yield from Robot.carry_out(self, task)


def run_until_executing(system: VirtualSystem, task: str) -> None:
    assert system.world.run(60, lambda: any(step.state is State.EXECUTING for step in system.view(task).steps))


def test_the_later_of_two_tasks_that_want_one_thing_waits_and_says_so() -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit(FIRST, policy=Policy.TIME)
    run_until_executing(system, first)
    second = system.submit(SECOND, policy=Policy.TIME)
    system.world.run(5)
    view = system.view(second)
    assert view.phase is Phase.WAITING
    assert short_id(first) in view.explanation
    assert FIRST in view.explanation
    assert "which has reserved Jar002" in view.explanation
    assert view.explanation in texts(system.manager.state.tasks[second])
    views = system.finish(first, second)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 2
    assert views[1].explanation == ""
    assert system.map.has_fact("isOn", ("Jar002", "Cupboard002"))
    assert views[0].ended_at is not None
    assert min(work.began for work in views[1].work) >= views[0].ended_at
    assert not hands.conflicts


def test_two_tasks_that_are_planned_at_the_same_time_do_not_both_get_the_thing() -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"), hands.robot("Robot2"), planning=3.0)
    tasks = [system.submit(FIRST, policy=Policy.TIME), system.submit(SECOND, policy=Policy.TIME)]
    views = system.finish(*tasks)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 2
    assert not hands.conflicts


def test_who_wants_what_another_is_bringing_about_has_nothing_to_do_then() -> None:
    hands = Hands()
    robot = hands.robot("Robot1")
    system = VirtualSystem(robot)
    views = system.finish(system.submit(FIRST), system.submit(FIRST))
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 2
    assert len(robot.orders) == 1


def test_a_wish_that_any_thing_fulfils_takes_one_that_nobody_has() -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit("Jar001 isOn Platform001", policy=Policy.TIME)
    run_until_executing(system, first)
    second = system.submit("?Any: Jar isOn Cupboard002 AND NOT ?Any = Jar001", policy=Policy.TIME)
    assert system.world.run(30, lambda: system.view(second).phase is Phase.EXECUTING), system.view(second)
    assert system.view(second).steps[0].inputs["Object"] != "Jar001"


def test_tasks_that_have_nothing_to_do_with_each_other_do_not_wait() -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"), hands.robot("Robot2"), hands.robot("Robot3"))
    tasks = [system.submit(FIRST, policy=Policy.TIME), system.submit(SECOND, policy=Policy.TIME)]
    start = system.world.now
    third_task = system.submit("Tin001 isOn Platform001", policy=Policy.TIME)
    (view,) = system.finish(third_task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.ended_at is not None
    assert view.ended_at - start < 70
    system.finish(*tasks)


def test_a_thing_that_has_to_stay_for_one_wish_is_not_taken_for_another() -> None:
    """Jar001 is where it shall be, and the task brings the other one there, too."""
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit("Jar001 isOn Cupboard002 AND Jar002 isOn Cupboard002", policy=Policy.TIME)
    run_until_executing(system, first)
    second = system.submit("Jar001 isOn Platform001", policy=Policy.TIME)
    system.world.run(5)
    assert system.view(second).phase is Phase.WAITING
    assert [view.outcome for view in system.finish(first, second)] == [Outcome.ACCOMPLISHED] * 2


@pytest.mark.parametrize("snapshot", [False, True])
def test_who_waits_goes_on_waiting_after_a_restart(snapshot: bool) -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit(FIRST, policy=Policy.TIME)
    run_until_executing(system, first)
    second = system.submit(SECOND, policy=Policy.TIME)
    system.world.run(5)
    system.restart_manager(snapshot=snapshot)
    assert system.view(second).phase is Phase.WAITING
    assert [view.outcome for view in system.finish(first, second)] == [Outcome.ACCOMPLISHED] * 2
    assert not hands.conflicts


def test_what_a_cancelled_task_had_is_free_once_it_is_undone() -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"), hands.robot("Robot2"))
    first, second = system.submit(f"{FIRST} AND Tin001 isOn Platform001"), system.submit(SECOND)
    assert system.world.run(600, lambda: any(step.state is State.COMPLETED for step in system.view(first).steps))
    system.ask(CancelTask(task=first))
    views = system.finish(first, second)
    assert [view.outcome for view in views] == [Outcome.CANCELLED, Outcome.ACCOMPLISHED]
    assert views[0].ended_at is not None
    assert min(work.began for work in views[1].work) >= views[0].ended_at
    assert not hands.conflicts


def test_who_waits_can_be_cancelled_and_runs_out_of_time() -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1", seconds=300), hands.robot("Robot2", seconds=300))
    first = system.submit(FIRST)
    run_until_executing(system, first)
    cancelled, late = system.submit(SECOND), system.submit(SECOND, deadline=100.0)
    system.world.run(5)
    system.ask(CancelTask(task=cancelled))
    views = system.finish(cancelled, late)
    assert [view.outcome for view in views] == [Outcome.CANCELLED, Outcome.FAILED]
    assert "waiting for" in views[1].explanation
    assert "deadline" in views[1].explanation
    (view,) = system.finish(first)
    assert view.outcome is Outcome.ACCOMPLISHED


def test_three_tasks_that_want_one_thing_get_it_in_the_order_in_which_they_came() -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"), hands.robot("Robot2"))
    tasks = [system.submit(FIRST), system.submit(SECOND), system.submit("Jar002 isOn Cupboard001 AND Tin001 isOn Platform001")]
    views = system.finish(*tasks)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 3
    ends = [view.ended_at or 0.0 for view in views]
    assert ends == sorted(ends)
    assert system.map.has_fact("isOn", ("Jar002", "Cupboard001"))


def test_a_wish_that_nobody_can_fulfil_does_not_wait() -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"))
    first = system.submit(FIRST)
    run_until_executing(system, first)
    (view,) = system.finish(system.submit("Jar002 isOn Platform001 AND LostJar isOn Platform001"))
    assert view.outcome is Outcome.FAILED
    assert "LostJar" in view.explanation


def test_who_had_to_wait_does_not_undo_what_another_has_by_then() -> None:
    """The earlier task's second thing is moved away, so that it has to be planned anew; by then, a later one has the first thing."""
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1", seconds=20), hands.robot("Robot2", seconds=20))
    tasks = [system.submit("Jar001 isOn Platform001 AND Jar002 isOn Platform001"), system.submit("Jar001 isOn Cupboard001")]
    assert system.world.run(600, lambda: any(step.state is State.COMPLETED for step in system.view(tasks[0]).steps))
    remove(system, "Jar002", "Cupboard001")
    views = system.finish(*tasks)
    assert all(view.outcome is not None for view in views)
    assert not hands.conflicts


def remove(system: VirtualSystem, thing: str, place: str) -> None:
    update = UpdateMap(changes=(FactRemoved(Fact("isOn", (thing, place))),), author="a person")
    header = Header(sender="client", recipient="repository", message_id=message_id("person", thing), reply_to="client")
    system.world.send(Message(header=header, body=update))
    system.world.run(1)


@pytest.mark.parametrize("seed", range(25))
def test_whatever_tasks_want_all_end_and_nothing_is_carried_by_two(seed: int) -> None:
    dice = random.Random(seed)
    hands = Hands()
    robots = [hands.robot(f"Robot{n}", seconds=dice.choice((5, 20, 60)), fails=dice.choice((0.0, 0.3)), seed=seed) for n in (1, 2, 3)]
    system = VirtualSystem(*robots, planning=dice.choice((0.0, 0.5, 8.0)))
    tasks = []
    for _ in range(dice.randint(2, 4)):
        things = dice.sample(["Jar001", "Jar002", "Tin001"], dice.randint(1, 3))
        goal = " AND ".join(f"{thing} isOn {dice.choice(['Platform001', 'Cupboard001', 'Cupboard002'])}" for thing in things)
        tasks.append(system.submit(goal, policy=Policy.TIME))
        system.world.run(dice.choice((0.1, 5, 30)))
        if dice.random() < 0.3:
            system.restart_manager(snapshot=dice.random() < 0.5)
        if dice.random() < 0.2:
            system.ask(CancelTask(task=dice.choice(tasks)))
    views = system.finish(*tasks, seconds=20_000)
    assert not hands.conflicts, hands.conflicts
    for view in views:
        assert view.outcome in (Outcome.ACCOMPLISHED, Outcome.CANCELLED) or "slipped" in view.explanation, view.explanation
