"""Standing orders in a system with several Task Managers: any of them takes a task, and each due time is one task whoever is down."""

from __future__ import annotations

from collections import Counter

import pytest

from somrs.protocol.messages import orders
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.orders import Every, OrderSaved, Run, RunState
from somrs.protocol.messages.submission import Submit
from somrs.runtime.virtual_time import KillPoint
from somrs.scheduling.component import SCHEMA, Scheduler
from somrs.scheduling.execution import LATE
from somrs.scheduling.state import Located
from tests.support.virtual_system import Robot, VirtualSystem

SCHEDULER, MANAGERS = "scheduler", ("tm", "tm-b")
MINUTES = 10.0


class ScheduledSystem(VirtualSystem):
    """Two Task Managers, and a Scheduler with an order that is due every ten minutes."""

    def __init__(self) -> None:
        super().__init__(Robot("Robot1", 10, 20), Robot("Robot2", 20, 20))
        self.add_manager(MANAGERS[1])
        located = Located("repository", MANAGERS[0], "", MANAGERS[1:])
        self.world.add(SCHEDULER, Scheduler(SCHEDULER, located), journaled=SCHEMA)
        self.world.run(5)
        task = Submit(effect="Jar002 isOn Platform001")
        saved = OrderSaved(name="Often", when=Every(minutes=MINUTES), task=task)
        header = Header(sender="client", recipient=SCHEDULER, message_id="urn:uuid:order", reply_to="client")
        self.world.send(Message(header=header, body=orders.SaveOrder(saved=saved)))
        self.world.run(1)

    def runs(self) -> list[Run]:
        """The runs, the earliest first."""
        scheduler = self.world.components[SCHEDULER]
        assert isinstance(scheduler, Scheduler)
        return sorted((run for runs in scheduler.book.runs.values() for run in runs), key=lambda run: run.due)

    def owners(self) -> Counter[str]:
        """How many tasks each Task Manager has been given."""
        return Counter(manager for manager in MANAGERS if manager in self.world.components for _ in self.manager_at(manager).state.tasks)


def assert_done_once(system: ScheduledSystem, count: int) -> None:
    runs = system.runs()
    assert [run.outcome for run in runs] == [Outcome.ACCOMPLISHED] * count
    tasks = [task for manager in MANAGERS for task in system.manager_at(manager).state.tasks]
    assert sorted(tasks) == sorted(run.task or "" for run in runs)


def test_the_tasks_of_an_order_are_spread_and_followed_to_their_ends() -> None:
    system = ScheduledSystem()
    system.world.run(12 * MINUTES * 60 + 120)
    assert_done_once(system, 12)
    assert {*system.owners()} == {*MANAGERS}
    assert {run.task_manager for run in system.runs()} == {*MANAGERS}


@pytest.mark.parametrize("down", MANAGERS)
def test_while_one_is_down_the_other_gets_the_tasks(down: str) -> None:
    system = ScheduledSystem()
    system.world.kill(down)
    system.world.run(6 * MINUTES * 60 + 120)
    assert [run.outcome for run in system.runs()] == [Outcome.ACCOMPLISHED] * 6
    system.world.revive(down)
    system.world.run(60)
    assert_done_once(system, 6)


@pytest.mark.parametrize("manager", MANAGERS)
def test_a_task_whose_task_manager_dies_is_not_stated_again_and_goes_on_when_that_is_back(manager: str) -> None:
    system = ScheduledSystem()
    assert system.world.run(12 * MINUTES * 60, lambda: any(run.task_manager == manager and run.open for run in system.runs()))
    count = len(system.runs())
    system.world.kill(manager)
    system.world.run(200)
    assert system.runs()[-1].state is RunState.SUBMITTED
    assert system.runs()[-1].open
    system.world.revive(manager)
    system.world.run(120)
    assert_done_once(system, count)


@pytest.mark.parametrize("manager", MANAGERS)
def test_who_was_given_the_task_and_died_does_it_when_it_is_back(manager: str) -> None:
    """It dies when it has been given the task, before it has answered. The other one, which was down, is back."""
    system = ScheduledSystem()
    other = MANAGERS[1 - MANAGERS.index(manager)]
    system.world.kill(other)
    assert system.world.run(MINUTES * 60 + 30, lambda: bool(system.manager_at(manager).state.awaiting_assignment))
    system.world.kill(manager, KillPoint.JOURNALED)
    assert system.world.run(5, lambda: manager not in system.world.components)
    system.world.revive(other)
    system.world.run(300)
    assert [(run.state, run.open) for run in system.runs()] == [(RunState.SUBMITTED, True)]
    system.world.revive(manager)
    system.world.run(60)
    assert_done_once(system, 1)
    assert [*system.manager_at(manager).state.tasks] == [system.runs()[0].task]


@pytest.mark.parametrize("manager", MANAGERS)
def test_a_run_is_not_missed_while_one_that_may_have_its_task_is_down(manager: str) -> None:
    """As before, but the other one is back too late to be told the task in time, and knows nothing of it."""
    system = ScheduledSystem()
    other = MANAGERS[1 - MANAGERS.index(manager)]
    system.world.kill(other)
    assert system.world.run(MINUTES * 60 + 30, lambda: bool(system.manager_at(manager).state.awaiting_assignment))
    system.world.kill(manager, KillPoint.JOURNALED)
    system.world.run(2 * LATE)
    system.world.revive(other)
    system.world.run(200)
    assert [run.state for run in system.runs()] == [RunState.SUBMITTING]
    system.world.revive(manager)
    system.world.run(60)
    assert_done_once(system, 1)


def test_a_run_is_missed_when_all_were_down_while_it_was_due() -> None:
    system = ScheduledSystem()
    for manager in MANAGERS:
        system.world.kill(manager)
    system.world.run(MINUTES * 60 + 2 * LATE)
    for manager in MANAGERS:
        system.world.revive(manager)
    system.world.run(120)
    assert [run.state for run in system.runs()] == [RunState.MISSED]
    assert not system.owners()
