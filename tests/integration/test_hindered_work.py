"""Work that something keeps from going on, which will pass: it is not too late, and users see why it waits."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from somrs.devices.simulator.drivers import simulated as driver_module
from somrs.devices.simulator.drivers.vehicle import Vehicle
from somrs.devices.simulator.link.commands import Fault
from somrs.protocol.messages.events import ProgressNoted, ServiceOverdue
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.submission import CancelTask
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Advance, Order, WorkDone
from tests.support.paths import ROOT
from tests.support.robot_lab import run
from tests.support.simulated_device_harness import simulated
from tests.support.virtual_system import Robot, VirtualSystem, transfer_effect

GOAL = "Jar002 isOn Platform001"
NOTE = "waits: Lift1 does not work"
HOTEL = (ROOT / "src/somrs/demo/data/scenario-4.yaml").read_text("utf-8")


def wait_for_lift(seconds: float, *, waits: bool) -> Work:
    for _ in range(int(seconds / 10)):
        yield 10.0, Advance(fraction=0.4, note=NOTE, waits=waits)


def events_of(system: VirtualSystem, task: str, kind: type[object]) -> list[object]:
    return [noted.event for noted in system.manager.state.tasks[task].events if isinstance(noted.event, kind)]


@pytest.mark.parametrize("waits", [True, False])
def test_work_that_says_that_it_waits_is_not_too_late(waits: bool) -> None:
    def drive(order: Order) -> Work:
        yield from wait_for_lift(7200.0, waits=waits)
        yield 500.0, WorkDone(situation=transfer_effect(order))

    system = VirtualSystem(Robot("Robot1", price=10, duration=60, works=drive))
    task = system.submit(GOAL)
    system.world.run(7000)
    overdue = events_of(system, task, ServiceOverdue)
    assert bool(overdue) is not waits
    if waits:
        (view,) = system.finish(task)
        assert view.outcome is Outcome.ACCOMPLISHED
        assert events_of(system, task, ProgressNoted) == [ProgressNoted(service="Robot1.TransferObject", note=NOTE)]


def test_work_that_waits_no_longer_has_its_whole_time_and_no_more() -> None:
    def drive(order: Order) -> Work:
        yield from wait_for_lift(3600.0, waits=True)
        yield 6000.0, WorkDone(situation=transfer_effect(order))

    system = VirtualSystem(Robot("Robot1", price=10, duration=60, works=drive))
    task = system.submit(GOAL)
    system.world.run(4100)
    assert not events_of(system, task, ServiceOverdue)
    system.world.run(400)
    assert events_of(system, task, ServiceOverdue)


@pytest.mark.parametrize("waits", [True, False])
def test_undoing_that_says_that_it_waits_is_not_too_late_either(waits: bool) -> None:
    def undo(order: Order, situation: str) -> Work:
        yield from wait_for_lift(7200.0, waits=waits)
        yield 30.0, WorkDone(situation=situation)

    def drive(order: Order) -> Work:
        yield from wait_for_lift(60.0, waits=True)

    system = VirtualSystem(Robot("Robot1", price=10, duration=60, works=drive, undoes=undo, lays_down="Jar002 isOn Floor001"))
    task = system.submit(GOAL)
    system.world.run(30)
    system.ask(CancelTask(task=task, reason="the guest has left"))
    (view,) = system.finish(task, seconds=9000)
    assert view.outcome is Outcome.CANCELLED
    assert [work.state for work in view.work] == [State.COMPENSATED if waits else State.STRANDED]


def test_a_robot_in_a_lift_that_breaks_says_why_it_waits_until_the_lift_is_mended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driver_module, "REPORTING", 0.02)

    async def test() -> None:
        async with simulated(Vehicle, "Robot1", HOTEL) as harness:

            async def reported(condition: Callable[[Advance], bool]) -> Advance:
                while not any(condition(advance) for advance in harness.advances):
                    await asyncio.sleep(0.01)
                return next(advance for advance in harness.advances if condition(advance))

            await harness.operator.schedule("LiftWest", Fault.DRIVE, carried=1.0)
            work = asyncio.create_task(harness.perform("MoveTo", Place="Landing"))
            waiting = await reported(lambda advance: advance.waits)
            assert waiting.note == "waits: LiftWest does not work"
            assert not work.done()
            await harness.operator.repair("LiftWest", Fault.DRIVE)
            map = await work
            assert list(map.facts_with("isAt", 0, "Robot1")) == [("Robot1", "Landing")]
            assert harness.advances[-1].note == "drives to Landing"

    run(test())
