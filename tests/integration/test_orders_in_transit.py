"""An order to begin is on its way when what it depends on ceases to hold: nothing begins, and nothing is assumed to have begun."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.protocol.messages import events, frp
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.task_views import TaskView
from somrs.runtime.virtual_network import LATENCY, Medium
from somrs.service_manager.sdk.device import Device
from tests.integration.test_invariants import DOOR_OPEN, Carrier, logged
from tests.integration.test_promised_situations import SITE, Porter
from tests.integration.test_promised_situations import Carrier as CheckingCarrier
from tests.support.virtual_system import VirtualSystem

CARRIER = "devices/Carrier1"


def slow_execute(seconds: float) -> Medium:
    """The first Execute to the carrier takes so long."""
    delayed: set[str] = set()

    def medium(message: Message) -> Sequence[float]:
        if message.header.recipient == CARRIER and isinstance(message.body, frp.Execute) and not delayed:
            delayed.add(message.header.message_id)
            return (seconds,)
        return (LATENCY,)

    return medium


def finish_with_a_door_that_closes(carrier: Device, medium: Medium) -> tuple[VirtualSystem, TaskView]:
    """The door closes when the carrier was told to begin, and before it knows."""
    system = VirtualSystem(site=SITE, medium=medium)
    system.join_device(Porter("Porter1"))
    system.join_device(carrier)
    system.change(DOOR_OPEN)
    task = system.submit("Carton001 isOn Shelf001")
    assert system.world.run(10, lambda: any(isinstance(message.body, frp.Execute) for message in system.world.messages))
    system.change("Door001.Open = FALSE")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    return system, view


def test_a_stop_that_comes_before_the_execute_leaves_nothing_to_observe() -> None:
    system, view = finish_with_a_door_that_closes(Carrier("Carrier1"), slow_execute(5.0))
    assert logged(system, view.task, events.NobodyLooks) == [], "nothing was begun, so the carton is where it was"
    assert [(work.service, work.state) for work in view.work] == [
        ("Porter1.UnlockDoor", "Completed"),
        ("Carrier1.CarryThrough", "Completed"),
    ]
    assert system.manager.state.tasks[view.task].services.failures == {}


def test_an_order_that_did_not_arrive_is_not_repeated_when_its_precondition_has_ceased_to_hold() -> None:
    carrier = CheckingCarrier("Carrier1")
    system, view = finish_with_a_door_that_closes(carrier, slow_execute(100.0))
    quoted_and_began = carrier.read
    assert False not in quoted_and_began[-1:], "it began behind an open door"
    assert [work.service for work in view.work] == ["Porter1.UnlockDoor", "Carrier1.CarryThrough"]
    began_while_shut = [
        message
        for message in system.world.messages
        if isinstance(message.body, frp.Execute)
        and message.header.recipient == CARRIER
        and DOOR_OPEN not in (message.body.precondition or "")
    ]
    assert began_while_shut == []
