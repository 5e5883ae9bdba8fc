"""Many robots on random roadmaps, and whatever goes wrong: nobody touches anybody, and everybody arrives; and it is noticed if not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

import pytest

from somrs.protocol.messages.traffic import TripResult
from somrs.traffic.dispatcher import Dispatcher
from somrs.traffic.drives import Drives
from somrs.traffic.exits import Lane
from somrs.traffic.passage_call import PassageCall
from somrs.traffic.schedule import Schedule
from somrs.traffic.state import PassageRecord
from somrs.traffic.surroundings import Surroundings
from verification.traffic_runs.draw import draw
from verification.traffic_runs.play import Outcome, Play


def outcomes(seeds: range) -> Iterator[Outcome]:
    """What came of the seeds, each played when it is asked for."""
    return (Play(draw(seed)).run() for seed in seeds)


def test_nobody_touches_anybody_and_everybody_arrives() -> None:
    played = [*outcomes(range(60))]
    assert [outcome for outcome in played if outcome.violation] == []
    results = sum((outcome.results for outcome in played), Counter[TripResult]())
    assert all(results[result] for result in TripResult), "every end of a trip occurs"


def test_a_robot_that_starts_again_does_not_take_answers_to_its_earlier_program_for_its_own() -> None:
    assert not Play(draw(425)).run().violation


def test_a_seed_is_one_run() -> None:
    assert Play(draw(18)).run() == Play(draw(18)).run()


def test_robots_that_do_not_wait_for_others_touch_them(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody(schedule: Schedule, robot: str) -> Iterator[str]:
        yield from ()

    monkeypatch.setattr(Schedule, "obstacles", nobody)
    assert any("are both at" in outcome.violation for outcome in outcomes(range(10)))


def test_robots_touch_each_other_at_berths_that_exclude_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    for near in ("_near_places", "_near_berth"):
        monkeypatch.setattr(Surroundings, near, lambda *_: iter(()))
    assert any("touch each other" in outcome.violation for outcome in outcomes(range(30)))


def test_it_is_noticed_if_robots_are_granted_ways_while_traffic_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    assert any(draw(seed).holds for seed in range(10))

    def goal(dispatcher: Dispatcher, robot: str, stuck: Mapping[str, Lane]) -> int | None:
        trip = dispatcher.state.robots[robot].trip
        return trip.destination if trip is not None else None

    monkeypatch.setattr(Dispatcher, "_goal", goal)
    assert any("while traffic was held" in outcome.violation for outcome in outcomes(range(10)))


def test_robots_that_are_granted_nothing_do_not_arrive(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Dispatcher, "_grant_next", lambda *_: False)
    assert any("not arrived" in outcome.violation for outcome in outcomes(range(3)))


def test_a_way_that_is_said_to_have_no_room_is_looked_for() -> None:
    """The twin of the planner: a corridor without a bay, in which two robots cannot change places."""
    scenario = draw(25)
    outcome = Play(scenario).run()
    assert outcome.results[TripResult.NO_ROOM]
    assert not outcome.violation
    assert not scenario.incidents, "nothing went wrong that would explain it"


def test_it_is_noticed_if_robots_are_let_in_before_a_passage_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Drives, "_is_open_for", lambda *_: True)
    assert any("is not open there" in outcome.violation for outcome in outcomes(range(10)))


def test_it_is_noticed_if_a_passage_is_released_too_early(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = Drives._wanted

    def hasty(drives: Drives, name: str, record: PassageRecord) -> PassageCall | None:
        is_told = any(robot.told is not None and robot.told.is_open for robot in drives._state.robots.values())
        return None if is_told else wanted(drives, name, record)

    monkeypatch.setattr(Drives, "_wanted", hasty)
    assert any("shuts while" in outcome.violation for outcome in outcomes(range(20)))
