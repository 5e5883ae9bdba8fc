"""The ports of a system's programs, from one run to the next."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.deployment.ports_of_programs import Part, Ports, ports_before
from somrs.runtime.bus_address import BusAddress


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


def test_a_bus_of_several_servers_has_its_own_ports() -> None:
    """Seen with a system that was started again at a bus with several servers: it ended with a stack trace."""
    bus = BusAddress(servers="nats://10.0.0.1:4222,nats://10.0.0.2:4222", site="yard", gateway="http://here:8600")
    last = Ports("here", [*range(100, 100 + len(Part))], registries=1).addresses(bus, has_windows=False)
    last = structs.replace(last, mqtt="mqtt://10.0.0.1:1883,mqtt://10.0.0.2:1883")
    ports = ports_before(last, task_managers=1, is_on_bus=True, has_own_bus=False)
    assert (ports[Part.BUS], ports[Part.MQTT], ports[Part.GATEWAY]) == (0, 0, 8600)
