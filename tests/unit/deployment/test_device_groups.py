"""Which devices share a process."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from somrs.deployment.device_groups import LEAST_PROCESSES, group_devices

OWN, FOREIGN = "somrs.devices.simulator.drivers.manipulator:Manipulator", "forklift.py:Forklift"
FLEETS = st.lists(st.sampled_from([OWN, FOREIGN]), max_size=130).map(
    lambda drivers: [(f"Robot{number:03}", driver) for number, driver in enumerate(drivers)]
)


def fleet(size: int, driver: str = OWN) -> list[tuple[str, str]]:
    return [(f"Robot{number:03}", driver) for number in range(size)]


@given(FLEETS, st.none() | st.integers(1, 40))
def test_each_device_is_in_one_process_and_the_processes_have_names_of_their_own(
    driven: list[tuple[str, str]], per_process: int | None
) -> None:
    groups = group_devices(driven, per_process)
    assert sorted(device for group in groups for device in group.drivers.items()) == driven
    assert all(group.drivers for group in groups)
    assert len({group.name for group in groups}) == len(groups)
    if per_process is not None:
        assert all(len(group.drivers) <= per_process for group in groups)


def test_few_devices_have_a_process_each_that_has_their_name() -> None:
    assert [group.name for group in group_devices(fleet(LEAST_PROCESSES))] == [name for name, _ in fleet(LEAST_PROCESSES)]


def test_a_hundred_robots_share_a_few_processes_evenly() -> None:
    sizes = [len(group.drivers) for group in group_devices(fleet(100))]
    assert len(sizes) < 100 / 2
    assert max(sizes) - min(sizes) <= 1


def test_a_driver_of_somebody_else_shares_its_process_only_if_that_is_asked_for() -> None:
    driven = [*fleet(50), *((name.replace("Robot", "Fork"), driver) for name, driver in fleet(3, FOREIGN))]
    alone = [group.name for group in group_devices(driven) if FOREIGN in group.drivers.values()]
    assert alone == ["Fork000", "Fork001", "Fork002"]
    assert len(group_devices(fleet(50, FOREIGN), 25)) == 2


def test_each_device_has_its_own_process_if_that_is_asked_for() -> None:
    assert [group.name for group in group_devices(fleet(30), 1)] == [name for name, _ in fleet(30)]
