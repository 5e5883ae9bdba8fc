"""Where robots in traffic are, for those who ask about the fleet."""

from __future__ import annotations

from somrs.api.traffic_reader import last_place
from somrs.devices.simulator.link.roads import RobotInTraffic, TrafficState


def test_a_robot_is_at_the_last_place_that_it_has_come_to() -> None:
    """Seen: the fleet showed a driving robot where it had been after its last task, on another storey."""
    traffic = TrafficState(
        roadmap=1, robots={"Robot1": RobotInTraffic(granted=((1.0, 2.0, 8.0), (3.0, 2.0, 8.0))), "Robot2": RobotInTraffic()}
    )
    assert [last_place(name, traffic) for name in ("Robot1", "Robot2", "Robot3")] == [(1.0, 2.0, 8.0), None, None]
