"""A conversation that was recorded with real nodes: a robot drives around a corner, and gives up on its next way."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from typing import Any

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.ros2.connection import RobotConnection
from somrs.adapters.ros2.lines import Request, decode_report
from somrs.adapters.ros2.session import Session
from somrs.adapters.ros2.settings import Binding, RobotSettings
from somrs.devices.road_robot import Waypoint
from tests.support.ros2.record import BINDING, FILE
from tests.support.ros2.robots import Witness

RECORDED: list[dict[str, Any]] = [msgspec.json.decode(line) for line in FILE.read_bytes().splitlines()]


def _replayed(entries: list[dict[str, Any]]) -> tuple[list[Any], Witness]:
    """What was sent to the bridge, and what the robot said, when the connection is told and hears this."""

    async def replay() -> tuple[list[Any], Witness]:
        requests: list[Request] = []
        witness = Witness()
        session = Session(requests.append, lambda problem: None)
        settings = RobotSettings.model_validate({"binding": "none.yaml", "namespace": "robot1"})
        connection = RobotConnection("Robot1", settings, Binding.model_validate(BINDING), session, witness)
        connection.open()
        for entry in entries:
            if "told" in entry:
                connection.follow(msgspec.convert(entry["told"], tuple[Waypoint, ...]))
            elif "heard" in entry:
                session.handle(decode_report(msgspec.json.encode(entry["heard"])))
        return [msgspec.to_builtins(request) for request in requests], witness

    return asyncio.run(replay())


def test_the_connection_says_what_it_said_when_it_was_recorded() -> None:
    requests, witness = _replayed(RECORDED)
    assert requests == [entry["sent"] for entry in RECORDED if "sent" in entry]
    assert witness.passed_numbers == [1, 2, 3]
    assert witness.reasons == ["the navigation of Robot1 aborted the goal P4: no valid path"]


@given(indexes=st.lists(st.integers(0, len(RECORDED) - 1), max_size=120))
def test_lines_that_are_lost_repeated_or_late_pass_no_waypoint_twice(indexes: list[int]) -> None:
    _, witness = _replayed([RECORDED[0], *(RECORDED[index] for index in indexes)])
    assert all(earlier < later for earlier, later in pairwise(witness.passed_numbers))
    assert {*witness.passed_numbers} <= {1, 2, 3, 4}
