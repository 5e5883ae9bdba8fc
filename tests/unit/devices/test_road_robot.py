"""A robot of any make stands still while an operator has stopped it, or paused its task."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

import pytest

from somrs.devices import road_robot
from somrs.devices.road_robot import RoadRobot, Way, Waypoint
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import PAUSED, PAUSED_FOR, Ontology, Value
from somrs.protocol.messages.bodies import Body
from somrs.service_manager.sdk.device import Task
from somrs.service_manager.sdk.orders import Order, Refusal

WAY = tuple(Waypoint(number=number, name=f"P{number}", x=float(number), y=0.0, level=0.0, released=True) for number in range(3))


async def no_answer(question: Body) -> Body:
    raise AssertionError("nothing is asked")


class NotedRobot(RoadRobot, replaces=("whole_map",)):
    def __init__(self, values: Iterable[dict[str, Value]]) -> None:
        super().__init__("Robot1")
        self.calls: list[str] = []
        self.maps = iter([Map([Object(name="Robot1", type="MobileRobot", values=value)]) for value in values])
        self.whole_map = self.next_map

    async def next_map(self, *, is_current: bool = True) -> tuple[Map, Ontology]:
        try:
            return next(self.maps), upper()
        except StopIteration:
            raise asyncio.CancelledError from None

    async def follow(self, way: Way) -> None:
        self.calls.append(f"follow {way[-1].name}")

    async def halt(self) -> None:
        self.calls.append("halt")


@pytest.mark.parametrize("stop", [{PAUSED: True}, {PAUSED_FOR: "Task1"}])
def test_a_stopped_robot_stands_and_follows_its_way_afterwards(stop: dict[str, Value], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(road_robot, "STOPS", 0.0)

    async def test() -> None:
        robot = NotedRobot([{}, stop, stop, {}, {}])
        robot.road._way = WAY
        robot.road._is_paused = True  # as the program before may have left it
        with pytest.raises(asyncio.CancelledError):
            await robot._follow_stops()
        assert robot.calls == ["follow P2", "halt", "follow P2"]

    asyncio.run(test())


def test_who_does_not_take_part_in_traffic_yet_refuses_for_now() -> None:
    """Seen when the program of a robot was killed: its task failed, and did not wait until the robot took part again."""

    async def test() -> None:
        robot = NotedRobot([])
        robot._link = robot._road_link
        order = Order(participant="task", method="move_to", inputs={}, effect="Robot1 isAt Table1")
        task = Task("Robot1", order, no_answer, lambda advance: None)
        with pytest.raises(Refusal, match="does not take part in traffic yet") as refused:
            await robot._legs_to(task, "Table1")
        assert refused.value.not_now

    asyncio.run(test())
