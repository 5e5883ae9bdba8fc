"""Any physical object can be a device: a door with a drive offers to open itself."""

from __future__ import annotations

from collections.abc import Iterator

from somrs.ontology.services import ServiceType
from somrs.protocol.messages.frp import Outcome
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Order, WorkDone
from tests.support.virtual_system import SITE, Robot, VirtualSystem

OPEN = ServiceType(name="OpenItself", precondition="?Provider.Open = FALSE", effect="?Provider.Open = TRUE", cost="?Provider.Price")
DOOR = "  Door001: {type: Door, at: [2, 2, 0], Shape: {Form: Box, Width: 0.1, Depth: 1, Height: 2}, Open: false, Price: 1 EUR}\nfacts:"


def opens(order: Order) -> Work:
    def work() -> Iterator[tuple[float, object]]:
        yield 5.0, WorkDone(situation="Door001.Open = TRUE")

    return work()


def test_a_door_opens_itself() -> None:
    system = VirtualSystem(site=SITE.replace("facts:", DOOR))
    system.join(Robot("Door001", 1, 5, works=opens), type="Door", service=OPEN)
    system.world.run(5)
    assert [offer.provider_type for offer in system.registry.state.providers["Door001"].offers.values()] == ["Door"]
    (view,) = system.finish(system.submit("Door001.Open = TRUE"))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert [work.service for work in view.work] == ["Door001.OpenItself"]
