"""Plans of hundreds of steps: as much side by side as their links allow, and little time to coordinate."""

from __future__ import annotations

import time

from somrs.planner.model.plan import Plan
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import Outcome
from tests.support.relay import SECONDS, Relay, longest


def coordinated(relay: Relay) -> tuple[float, float]:
    """The seconds that the steps took, and those that coordinating them took."""
    process_start, start = time.process_time(), relay.world.now
    (view,) = relay.finish(relay.submit(relay.goal), seconds=100_000)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert relay.wrong == []
    assert len(relay.started) == len(relay.plan.steps)
    assert view.ended_at is not None
    return view.ended_at - start, time.process_time() - process_start


def test_two_hundred_steps_take_as_long_as_the_longest_chain_of_them() -> None:
    relay = Relay(couriers=10, parcels=5)
    steps = longest(relay.plan)
    assert len(relay.plan.steps) == 200 > 4 * steps
    seconds, coordination = coordinated(relay)
    assert steps * SECONDS <= seconds < (steps + 1) * SECONDS
    assert coordination < 20, "0.7 s where it was measured; what grows with the square of the steps takes longer by far"


def test_a_hundred_and_sixty_steps_of_one_device_are_promised_one_after_the_other() -> None:
    relay = Relay(couriers=1, parcels=40)
    seconds, _ = coordinated(relay)
    assert 160 * SECONDS <= seconds < 165 * SECONDS


def test_steps_that_do_not_depend_on_each_other_are_asked_for_at_the_same_time() -> None:
    relay = Relay(couriers=10, parcels=1)
    relay.plan = Plan(relay.plan.steps[::4])
    relay.submit(relay.goal)
    assert relay.world.run(60, lambda: any(isinstance(message.body, frp.Terms) for message in relay.world.messages))
    assert sum(isinstance(message.body, frp.Arrange) for message in relay.world.messages) == 10
