"""Messages come late, twice, in another order or never, and vehicles restart between any two of them."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.adapters.vda5050.control.exchange import ActionEnded, Broken, GaveUp, Halted, Perform
from somrs.adapters.vda5050.control.policy import Policy
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.simulated.exchange import Connected, Restarted
from tests.support.vda5050_pair import Pair

VERSIONS = pytest.mark.parametrize("version", [Version.V2_1, Version.V3_0])
SEEDS = st.integers(0, 100_000)


class Storm:
    """What becomes of messages, until it is over. `restarts`: how often the vehicle restarts, whenever a message arrives."""

    def __init__(self, seed: int, restarts: int = 0) -> None:
        self.dice = random.Random(seed)
        self.is_over, self.restarts = False, restarts
        self.pair: Pair | None = None

    def fate(self, topic: Topic) -> int:
        if self.is_over or topic is Topic.CONNECTION:
            return 1
        if self.restarts and self.pair is not None and self.dice.random() < 0.05:
            self.restarts -= 1
            self.pair.tell(Restarted())
        return self.dice.choice([0, 1, 1, 1, 2])

    def delay(self, topic: Topic) -> float:
        return 0.0 if self.is_over or self.dice.random() < 0.5 else self.dice.uniform(0.0, 4.0)

    def begin(self, version: Version) -> Pair:
        pair = Pair(version, self.fate, delay=self.delay, policy=Policy(hibernate_after=15.0))
        self.pair = pair
        return pair


@VERSIONS
@given(seed=SEEDS, restarts=st.integers(0, 2))
@settings(max_examples=4, deadline=None)
def test_a_vehicle_comes_to_the_end_of_its_way_and_never_beyond_what_is_released(seed: int, restarts: int, version: Version) -> None:
    storm = Storm(seed, restarts)
    pair = storm.begin(version)
    for released in (2, 3, 5):
        pair.follow("A", "B", "C", "D", "E", released=released)
        pair.run(8 * storm.dice.random())
        assert pair.body.x <= 2.0 * (released - 1) + 1e-6
    storm.is_over = True
    for _ in range(12):
        if pair.body.x < 8.0:
            pair.run(5)
    pair.run(5)
    assert pair.of(GaveUp) == []
    assert pair.body.x == 8.0
    assert pair.passed() == sorted(set(pair.passed()))
    assert pair.passed()[-1] == 4


@VERSIONS
@given(seed=SEEDS, restarts=st.integers(0, 2))
@settings(max_examples=4, deadline=None)
def test_an_action_ends_once_and_the_next_one_is_performed(seed: int, restarts: int, version: Version) -> None:
    storm = Storm(seed, restarts)
    pair = storm.begin(version)
    pair.follow("A", "B")
    pair.run(6 * storm.dice.random())
    pair.do(Perform(action_type="pick"))
    pair.run(6 * storm.dice.random())
    storm.is_over = True
    pair.run_until(ActionEnded)
    pair.run(8)
    assert len(pair.of(ActionEnded)) == 1
    pair.forget()
    pair.do(Perform(action_type="drop"))
    assert pair.run_until(ActionEnded) == ActionEnded(failure=None)
    assert pair.of(Broken) == []


@VERSIONS
@given(seed=SEEDS, restarts=st.integers(0, 2))
@settings(max_examples=4, deadline=None)
def test_who_was_halted_stands_and_stays(seed: int, restarts: int, version: Version) -> None:
    storm = Storm(seed, restarts)
    pair = storm.begin(version)
    pair.follow("A", "B", "C", "D", "E")
    pair.run(6 * storm.dice.random())
    pair.halt()
    pair.run(6 * storm.dice.random())
    storm.is_over = True
    pair.run_until(Halted)
    pair.run(6)
    x = pair.body.x
    pair.run(6)
    assert pair.body.x == x
    assert pair.vehicle.progress.is_idle
    pair.tell(Connected())
    pair.run(5)
    assert pair.body.x == x
