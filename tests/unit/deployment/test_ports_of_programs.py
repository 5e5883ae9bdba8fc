"""The ports of a system's programs, from one run to the next."""

from __future__ import annotations

import pytest

from somrs.deployment.ports_of_programs import Part, Ports, ports_before


def test_several_task_managers_and_registries_have_ports_behind_the_others() -> None:
    ports = Ports("here", [*range(100, 100 + len(Part)), 201, 202, 301], registries=2)
    assert ports.task_managers == [102, 201, 202]
    assert ports.registries == [101, 301]
    addresses = ports.addresses(None, has_windows=False)
    assert addresses.registries == {"Registry1": "http://here:101/registry", "Registry2": "http://here:301/registry-2"}
    assert list(addresses.task_managers.values())[1:] == ["http://here:201/task-manager-2", "http://here:202/task-manager-3"]


@pytest.mark.parametrize(("task_managers", "further"), [(1, [301]), (2, [201, 301]), (3, [201, 202, 301]), (4, [201, 202, 0, 301])])
def test_each_has_the_port_of_the_last_run_whatever_the_number_of_task_managers(task_managers: int, further: list[int]) -> None:
    last = Ports("here", [*range(100, 100 + len(Part)), 201, 202, 301], registries=2).addresses(None, has_windows=True)
    ports = ports_before(last, task_managers=task_managers, is_on_bus=False, has_own_bus=False)
    assert ports[len(Part) :] == further
    assert ports[Part.REGISTRY] == 101
