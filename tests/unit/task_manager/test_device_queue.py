"""Whose turn it is at a device."""

from __future__ import annotations

import pytest

from somrs.ontology.services import ServiceType
from somrs.ontology.types import Value
from somrs.protocol.messages.directory import CAPACITY_ATTRIBUTE, UNOCCUPIED, Offer
from somrs.task_manager.device_queue import AtWork, DeviceQueues, Rank

WORK = AtWork("busy task", "participant")


def offer(device: str = "Robot1", attributes: dict[str, Value] | None = None) -> Offer:
    return Offer(
        service=f"{device}.Work",
        provider=device,
        provider_type="Robot",
        address="",
        service_type=ServiceType(name="Work", effect=""),
        attributes=attributes or {},
    )


def rank(place: float) -> Rank:
    return (place, 0.0, 0.0, "")


def always_at_work(work: AtWork) -> bool:
    return True


def never_at_work(work: AtWork) -> bool:
    return False


@pytest.mark.parametrize(
    ("attributes", "room"),
    [
        ({}, 1),
        ({CAPACITY_ATTRIBUTE: 2}, 2),
        ({CAPACITY_ATTRIBUTE: 2.0}, 2),
        ({CAPACITY_ATTRIBUTE: True}, 1),
        ({CAPACITY_ATTRIBUTE: "many"}, 1),
    ],
)
def test_a_device_does_as_many_things_at_once_as_it_says(attributes: dict[str, Value], room: int) -> None:
    queues = DeviceQueues()
    for _ in range(room):
        assert queues.request_turn(offer(attributes=attributes), "a", rank(0), always_at_work) is True
        queues.add_work("Robot1", WORK)
    assert queues.request_turn(offer(attributes=attributes), "a", rank(0), always_at_work) is False
    assert queues.request_turn(offer("Robot2", attributes), "a", rank(0), always_at_work) is True


def test_what_does_not_occupy_a_device_waits_for_nothing() -> None:
    queues = DeviceQueues()
    queues.add_work("Robot1", WORK)
    assert queues.request_turn(offer(), "a", rank(0), always_at_work) is False
    assert queues.request_turn(offer(attributes={CAPACITY_ATTRIBUTE: UNOCCUPIED}), "b", rank(1), always_at_work) is True


def test_what_is_over_is_forgotten() -> None:
    queues = DeviceQueues()
    other_work = AtWork("other task", "participant")
    queues.add_work("Robot1", WORK)
    queues.add_work("Robot1", other_work)
    assert queues.request_turn(offer(), "a", rank(0), lambda work: work == other_work) is False
    assert queues.at_work == {"Robot1": [other_work]}
    assert [*queues.admit_waiting(never_at_work)] == ["a"]
    assert (queues.at_work, queues.waiting) == ({}, {})


def test_nobody_overtakes_one_that_waits_and_comes_first() -> None:
    queues = DeviceQueues()
    queues.add_work("Robot1", WORK)
    assert queues.request_turn(offer(), "b", rank(2), always_at_work) is False
    assert queues.request_turn(offer(), "c", rank(3), never_at_work) is False
    assert queues.request_turn(offer(), "a", rank(2), never_at_work) is True, "of equals, whoever comes"
    assert queues.request_turn(offer(), "a", rank(1), never_at_work) is True
    assert queues.request_turn(offer(), "b", rank(9), never_at_work) is False, "c waits before it now"
    assert queues.request_turn(offer(), "c", rank(3), never_at_work) is False, "b keeps the place that it had"
    assert [*queues.admit_waiting(never_at_work)] == ["b", "c"]


def test_a_task_waits_with_the_first_of_its_steps() -> None:
    queues = DeviceQueues()
    queues.add_work("Robot1", WORK)
    for task, place in (("a", 5), ("b", 4), ("a", 3), ("a", 6)):
        assert queues.request_turn(offer(), task, rank(place), always_at_work) is False
    assert queues.waiting["Robot1"]["a"].rank == rank(3)
    assert [*queues.admit_waiting(never_at_work)] == ["a", "b"]


def test_the_next_is_called_while_there_is_room() -> None:
    queues = DeviceQueues()
    for device in ("Robot1", "Robot2"):
        queues.add_work(device, WORK)
        for task, place in (("a", 2), ("b", 1)):
            queues.request_turn(offer(device), f"{device} {task}", rank(place), always_at_work)
    admitted = []
    for task in queues.admit_waiting(never_at_work):
        admitted.append(task)
        queues.add_work(task.partition(" ")[0], WORK)
    assert admitted == ["Robot1 b", "Robot1 a", "Robot2 b", "Robot2 a"], "whoever is called may begin nothing that lasts"
    assert [*queues.admit_waiting(always_at_work)] == []
    queues = DeviceQueues()
    queues.add_work("Robot1", WORK)
    queues.request_turn(offer(), "a", rank(1), always_at_work)
    assert [*queues.admit_waiting(always_at_work)] == []
    assert [*queues.waiting] == ["Robot1"]
