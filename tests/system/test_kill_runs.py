"""Two kills of real processes, and that what the kill runs judge by can tell good from bad. `make kill-runs` kills many more."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import Event
from tests.support import warm
from verification.kill_runs import checks
from verification.kill_runs.bystanders import AUTHOR, CHANGED, PATH, Acknowledged
from verification.kill_runs.checks import LoggedMessage
from verification.kill_runs.draw import CELLS, MAX_ATTEMPTS, MESSAGES, Victim, draw_case
from verification.kill_runs.run import Run
from verification.kill_runs.running_system import RunningSystem
from verification.kill_runs.scenarios import ROBOTS, scenarios_of

pytestmark = pytest.mark.long


def test_a_killed_task_manager_and_a_killed_repository_find_their_places(tmp_path: Path) -> None:
    async def play() -> None:
        async with RunningSystem(tmp_path / "system", warm.launcher()) as stage:
            for number, (message, victim) in enumerate((("Execute", Victim.TASK_MANAGER), ("Arrange", Victim.REPOSITORY))):
                carry = next(play for play in scenarios_of(message) if play.name == "carry")
                case = draw_case(CELLS.index((message, victim)))
                case = replace(case, seed=number, scenario=carry, nth=1, pause=0.1, placements=(("Jar002", "Platform001"),))
                result = await Run(stage, case).play()
                assert result.recovered, [*result.problems, *result.lost, result.missed]
                assert result.struck == victim
                assert result.outcome == "accomplished"
                assert result.acknowledged > 5
            await stage.save_world(tmp_path)

    asyncio.run(play())
    world = msgspec.json.decode((tmp_path / "world.json").read_bytes())
    assert world["things"]["Jar002"]["on"] == "Platform001"
    assert {*ROBOTS} <= {*world["traffic"]["robots"]}
    assert world["roadmap"]["places"]


def test_every_message_is_brought_about_with_every_victim() -> None:
    cases = [draw_case(seed) for seed in range(len(CELLS))]
    assert {(case.message, case.victim) for case in cases} == {
        (message, victim) for message in MESSAGES for victim in Victim if victim is not Victim.HOST
    }
    assert len(MESSAGES) == 18
    for case in cases:
        assert 1 <= case.nth <= case.scenario.count(case.message, len(case.placements)), case
        assert draw_case(case.seed) == case
        assert draw_case(case.seed, 1).message == case.message
        last_case = draw_case(case.seed, MAX_ATTEMPTS - 1)  # the surest of all to come in time
        assert (last_case.message, last_case.victim, last_case.nth, last_case.delay) == (case.message, case.victim, 1, 0.0)


def make_messages(*messages: tuple[float, str, str]) -> list[LoggedMessage]:
    return [LoggedMessage(at=time, type=type, participant=participant, id=f"{time}") for time, type, participant in messages]


FIRST_PARTICIPANT, SECOND_PARTICIPANT = "Robot1.TransferObject#step1", "Robot2.TransferObject#step1.2"
CONTRACT = [
    (0.0, "Arrange", FIRST_PARTICIPANT),
    (0.1, "Terms", FIRST_PARTICIPANT),
    (0.2, "Accept", FIRST_PARTICIPANT),
    (0.3, "Execute", FIRST_PARTICIPANT),
]
RIVAL = [(0.0, "Arrange", SECOND_PARTICIPANT), (0.1, "Terms", SECOND_PARTICIPANT)]
ENDS = [(90.0, "End", FIRST_PARTICIPANT), (90.1, "End", SECOND_PARTICIPANT)]
FAILED = (0.4, "Failed", FIRST_PARTICIPANT)


def takeover_messages(time: float) -> list[tuple[float, str, str]]:
    return [(time, "Accept", SECOND_PARTICIPANT), (time + 0.1, "Execute", SECOND_PARTICIPANT), *ENDS]


@pytest.mark.parametrize(
    ("messages", "wrong"),
    [
        ([*CONTRACT, (1.0, "Completed", FIRST_PARTICIPANT), *ENDS], ""),
        ([*CONTRACT, (1.0, "Completed", FIRST_PARTICIPANT)], "was not released"),
        ([*CONTRACT[:2], CONTRACT[3], *ENDS], "without a contract"),
        ([*CONTRACT, (0.4, "Execute", FIRST_PARTICIPANT), *ENDS], "2 times"),
        ([*CONTRACT, *RIVAL, *takeover_messages(0.5)], "worked at the same step"),
        ([*CONTRACT, *RIVAL, FAILED, *takeover_messages(0.5)], ""),
        ([*CONTRACT, *RIVAL, (20.3, "Query", FIRST_PARTICIPANT), *takeover_messages(30.0)], "worked at the same step"),
        ([*CONTRACT, *RIVAL, (20.3, "Query", FIRST_PARTICIPANT), *takeover_messages(40.5)], ""),
    ],
)
def test_what_a_conversation_must_not_be_is_found(messages: list[tuple[float, str, str]], wrong: str) -> None:
    violations = [*checks.protocol(make_messages(*messages))]
    assert wrong in violations[0] if wrong else not violations, violations


def test_who_is_not_at_home_is_found() -> None:
    assert not [*checks.unreleased({FIRST_PARTICIPANT: State.ENDED, SECOND_PARTICIPANT: State.NEW})]
    assert [*checks.unreleased({FIRST_PARTICIPANT: State.ENDED, SECOND_PARTICIPANT: State.EXECUTING})] == [
        f"{SECOND_PARTICIPANT} is Executing after the end"
    ]


def test_what_was_acknowledged_and_is_lost_is_found() -> None:
    acknowledged = Acknowledged(versions={"a": 3, "b": 4}, tasks=["t", "u"])
    events = [Event(version=v, at=0.0, author=AUTHOR, changes=(ValueSet(CHANGED, PATH, label),)) for label, v in (("a", 3), ("b", 4))]
    assert not [*checks.lost_updates(acknowledged, events)]
    assert len([*checks.lost_updates(acknowledged, events[:1])]) == 1
    twice = [*events, Event(version=5, at=0.0, author=AUTHOR, changes=(ValueSet(CHANGED, PATH, "b"),))]
    assert len([*checks.lost_updates(acknowledged, twice)]) == 1
    assert not [*checks.lost_tasks(acknowledged, dict.fromkeys(("t", "u"), Outcome.ACCOMPLISHED))]
    assert len([*checks.lost_tasks(acknowledged, {"t": Outcome.ACCOMPLISHED})]) == 1
    assert len([*checks.lost_tasks(acknowledged, {"t": Outcome.ACCOMPLISHED, "u": None})]) == 1
