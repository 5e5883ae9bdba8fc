"""Tasks of different priorities that want the same things, or the same devices."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.kernel.codec import Codec, encode
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Value
from somrs.protocol.messages.directory import CAPACITY_ATTRIBUTE, Offer
from somrs.protocol.messages.frp import Execute, Outcome, State
from somrs.protocol.messages.submission import CancelTask, Policy
from somrs.protocol.messages.task_news import ReadTasks, Tasks
from somrs.protocol.messages.task_views import Phase
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.sdk.orders import Capability, Profile
from somrs.task_manager import state
from somrs.task_manager.device_queue import AtWork, DeviceQueues
from tests.integration.test_competing_tasks import Hands, run_until_executing
from tests.support.event_sentences import texts
from tests.support.examples import examples
from tests.support.virtual_system import Robot, VirtualSystem

JARS = ("Jar001", "Jar002", "Tin001")
PLACES = ("Platform001", "Cupboard001", "Cupboard002", "Floor001")


def taken_objects(robot: Robot) -> list[str]:
    """The things that the robot took, in that order."""
    return [order.inputs["Object"] for order in robot.orders]


def test_of_tasks_that_wait_for_one_thing_the_higher_priority_comes_first() -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"), hands.robot("Robot2"))
    first = system.submit("Jar002 isOn Platform001", policy=Policy.TIME)
    run_until_executing(system, first)
    low = system.submit("Jar002 isOn Cupboard002", policy=Policy.TIME)
    high = system.submit("Jar002 isOn Floor001", policy=Policy.TIME, priority=5)
    system.world.run(5)
    assert [system.view(task).phase for task in (low, high)] == [Phase.WAITING] * 2
    views = system.finish(first, low, high)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 3
    assert tasks_by_end(system) == [first, high, low]
    assert not hands.conflicts


def tasks_by_end(system: VirtualSystem) -> list[str]:
    ended = {task: transaction.ended_at or 0.0 for task, transaction in system.manager.state.tasks.items()}
    return sorted(ended, key=lambda task: ended[task])


def test_what_is_under_way_is_not_interrupted() -> None:
    robot = Robot("Robot1", price=10, duration=60)
    system = VirtualSystem(robot)
    low = system.submit("Jar001 isOn Platform001", priority=-3)
    run_until_executing(system, low)
    high = system.submit("Jar001 isOn Cupboard001", priority=1000)
    system.world.run(30)
    assert system.view(low).phase is Phase.EXECUTING
    assert "has reserved Jar001" in system.view(high).explanation
    views = system.finish(low, high)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 2
    assert tasks_by_end(system) == [low, high]


def test_of_tasks_that_wait_for_one_device_the_higher_priority_comes_first() -> None:
    robot = Robot("Robot1", price=10, duration=60)
    system = VirtualSystem(robot)
    first = system.submit("Jar001 isOn Platform001")
    run_until_executing(system, first)
    low = system.submit("Jar002 isOn Platform001")
    system.world.run(1)
    high = system.submit("Tin001 isOn Platform001", priority=1)
    system.world.run(1)
    for task in (low, high):
        (step,) = system.view(task).steps
        assert step.state is State.COMMITTED, "whoever waits was promised the device, and is not told to begin"
        assert texts(system.manager.state.tasks[task])[-1] == "waiting for its turn at Robot1"
    system.finish(first, low, high)
    assert taken_objects(robot) == ["Jar001", "Tin001", "Jar002"]


def test_with_the_same_priority_the_one_that_was_promised_first_comes_first() -> None:
    robot = Robot("Robot1", price=10, duration=60)
    system = VirtualSystem(robot)
    tasks = []
    for jar in ("Jar002", "Jar001", "Tin001"):
        tasks.append(system.submit(f"{jar} isOn Platform001"))
        system.world.run(1)
    views = system.finish(*tasks)
    assert taken_objects(robot) == ["Jar002", "Jar001", "Tin001"]
    assert max(view.ended_at or 0 for view in views) - views[0].submitted_at < 185, "there is hardly a pause between them"


def test_a_device_that_waits_for_nobody_does_the_next_whatever_its_priority() -> None:
    robot = Robot("Robot1", price=10, duration=60)
    system = VirtualSystem(robot)
    task = system.submit("Jar001 isOn Platform001", priority=-100)
    run_until_executing(system, task)
    system.finish(task)
    assert taken_objects(robot) == ["Jar001"]


def test_who_waited_goes_on_when_the_one_before_is_cancelled() -> None:
    system = VirtualSystem(Hands().robot("Robot1", seconds=60))
    first = system.submit("Jar001 isOn Platform001")
    run_until_executing(system, first)
    second = system.submit("Jar002 isOn Platform001")
    system.world.run(2)
    system.ask(CancelTask(task=first))
    views = system.finish(first, second)
    assert [view.outcome for view in views] == [Outcome.CANCELLED, Outcome.ACCOMPLISHED]


def test_who_waited_for_a_device_that_falls_silent_does_not_wait_for_ever() -> None:
    system = VirtualSystem(Robot("Robot1", price=10, duration=60))
    first = system.submit("Jar001 isOn Platform001", waits=False)
    run_until_executing(system, first)
    second = system.submit("Jar002 isOn Platform001")
    system.world.run(2)
    system.world.cut_off("devices/Robot1")
    assert system.world.run(600, lambda: system.manager.state.tasks[first].outcome is not None)
    system.world.reconnect("devices/Robot1")
    (view,) = system.finish(second)
    assert view.outcome is Outcome.ACCOMPLISHED


def test_between_the_steps_of_a_task_a_more_urgent_one_gets_the_device() -> None:
    robot = Robot("Robot1", price=10, duration=60)
    system = VirtualSystem(robot)
    low = system.submit("Jar001 isOn Platform001 AND Tin001 isOn Platform001")
    run_until_executing(system, low)
    high = system.submit("Jar002 isOn Platform001", priority=1)
    system.finish(low, high)
    assert taken_objects(robot)[1] == "Jar002"
    assert sorted(taken_objects(robot)) == ["Jar001", "Jar002", "Tin001"]


def test_turns_outlive_a_restart() -> None:
    robot = Robot("Robot1", price=10, duration=60)
    system = VirtualSystem(robot)
    tasks = [system.submit("Jar001 isOn Platform001")]
    run_until_executing(system, tasks[0])
    tasks += [system.submit("Jar002 isOn Platform001"), system.submit("Tin001 isOn Platform001", priority=1)]
    system.world.run(1)
    system.restart_manager(snapshot=True)
    system.world.run(1)
    system.restart_manager()
    views = system.finish(*tasks)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 3
    assert taken_objects(robot) == ["Jar001", "Tin001", "Jar002"]


def test_a_device_that_does_several_things_at_once_is_told_so_many() -> None:
    system, crew = VirtualSystem(), Robot("Robot1", price=10, duration=60)
    capability = Capability(type="TransferObject", method="work")
    profile = Profile(name="Robot1", type="PioneerP3DX", capabilities=(capability,), lease=3600, capacity=2)
    system.world.add("devices/Robot1", ServiceManager(profile, repository="repository", registry="registry"), crew.carry_out)
    system.world.run(5)
    start = system.world.now
    tasks = [system.submit(f"{jar} isOn Platform001") for jar in ("Jar001", "Jar002", "Tin001")]
    system.world.run(30)
    assert len(crew.orders) == 2
    assert sum(isinstance(message.body, Execute) for message in system.world.messages) == 2, "the third is not told to begin"
    system.finish(*tasks)
    assert system.world.now - start < 130


def test_many_tasks_ask_services_one_after_the_other_and_the_more_urgent_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise, with hundreds of tasks and services, all answers come too late."""
    monkeypatch.setattr(state, "MOST_INVITATIONS", 5)
    asked: list[int] = []
    robots = [Robot(f"Robot{number}", price=10, duration=20) for number in (1, 2, 3, 4)]
    system = VirtualSystem(*robots, watch=lambda address, event: asked.append(_invitations(system)) if asked else None)
    asked.append(0)
    jars = ("Jar001", "Jar002", "Tin001")
    tasks = [system.submit(f"{jar} isOn Platform001", priority=priority) for priority, jar in enumerate(jars)]
    views = system.finish(*tasks)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 3
    assert 4 <= max(asked) <= 8


def _invitations(system: VirtualSystem) -> int:
    return system.manager.state.invitations


def test_priority_is_in_the_list_and_in_the_record() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    task = system.submit("Jar001 isOn Platform001", priority=-2)
    listed = system.ask(ReadTasks())
    assert isinstance(listed, Tasks)
    assert [view.priority for view in listed.tasks] == [-2]
    system.finish(task)
    record = system.task_record()
    assert record.priority == -2


@examples(20)
@given(
    requests=st.lists(st.tuples(st.sampled_from(JARS), st.sampled_from(PLACES), st.integers(-2, 2)), min_size=2, max_size=6),
    pauses=st.lists(st.sampled_from((0.0, 0.05, 20.0, 70.0)), min_size=6, max_size=6),
    couple=st.booleans(),
)
def test_whatever_is_wanted_and_how_urgently_everybody_gets_a_turn(
    requests: list[tuple[str, str, int]], pauses: list[float], couple: bool
) -> None:
    hands = Hands()
    system = VirtualSystem(hands.robot("Robot1"), *([hands.robot("Robot2")] if couple else []))
    tasks = []
    for (jar, place, priority), pause in zip(requests, pauses, strict=False):
        tasks.append(system.submit(f"{jar} isOn {place}", priority=priority))
        system.world.run(pause)
    views = system.finish(*tasks)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * len(tasks)
    assert not hands.conflicts


# The parts by themselves

names = st.sampled_from("abcdef")


class Bench:
    """Tasks that want turns at one device, as pursuits do; some steps vanish while they wait."""

    def __init__(self, capacity: int) -> None:
        self.queues = DeviceQueues()
        self.offer = OFFER if capacity == 1 else _offer(capacity)
        self.capacity = capacity
        self.ready: dict[str, int] = {}
        self.working: set[str] = set()
        self.log: list[str] = []

    def proceed(self, task: str) -> None:
        if task in self.ready and self.queues.request_turn(self.offer, task, (-self.ready[task], 0, 0, task), self.is_working):
            del self.ready[task]
            self.working.add(task)
            self.log.append(task)
            self.queues.add_work("Robot1", AtWork(task, "participant"))

    def is_working(self, work: AtWork) -> bool:
        return work.transaction in self.working

    def wake(self) -> None:
        for task in self.queues.admit_waiting(self.is_working):
            self.proceed(task)


def _offer(capacity: int = 1) -> Offer:
    attributes: dict[str, Value] = {CAPACITY_ATTRIBUTE: capacity} if capacity != 1 else {}
    service_type = ServiceType(name="Work", effect="")
    return Offer(
        service="Robot1.Work", provider="Robot1", provider_type="Robot", address="", service_type=service_type, attributes=attributes
    )


OFFER = _offer()
action_lists = st.lists(st.tuples(st.sampled_from(("want", "end", "vanish", "restart")), names, st.integers(-1, 1)), max_size=40)


@examples(75)
@given(actions=action_lists, capacity=st.integers(1, 3))
def test_a_device_is_never_idle_while_somebody_waits_nor_overrun_and_the_highest_goes_first(
    actions: list[tuple[str, str, int]], capacity: int
) -> None:
    bench = Bench(capacity)
    for action, task, priority in actions:
        ready_before = dict(bench.ready)
        log_length = len(bench.log)
        match action:
            case "want" if task not in bench.working and task not in bench.ready:
                bench.ready[task] = ready_before[task] = priority
                bench.proceed(task)
            case "end":
                bench.working.discard(task)
            case "vanish":
                bench.ready.pop(task, None)
                ready_before.pop(task, None)
            case "restart":
                bench.queues = Codec[DeviceQueues](DeviceQueues).decode(encode(bench.queues))
        bench.wake()
        assert len(bench.working) <= capacity
        assert not bench.ready or len(bench.working) == capacity
        for begun_task in bench.log[log_length:]:
            assert ready_before[begun_task] == max(ready_before.values())
            del ready_before[begun_task]
