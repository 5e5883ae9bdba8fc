"""What robots know of a building is made anew only when it has changed for them."""

from __future__ import annotations

from somrs.devices.road.building import Building
from somrs.ontology.files.loading import upper
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.traffic import RoadmapPlace
from somrs.repository.update import update_outcome
from somrs.traffic.robot_tasks import RoadmapRead
from tests.support.simulated_tower import tower


def test_ways_stay_while_the_cabin_of_a_lift_moves() -> None:
    """Seen in a hotel: with each report of a lift, all places of the building were compared with each other."""
    map, building = tower((2.0, 2.0, 0.0)), Building()
    roadmap = RoadmapRead(1, tuple(RoadmapPlace(name=f"P{x}", x=float(x), y=2.0) for x in range(1, 6)))
    building.update(map, upper(), roadmap)
    ways = building.ways()
    for situation, stays in {"Lift1.PositionZ = 1.5": True, "Table1.PositionX = 2.5": False}.items():
        map = update_outcome(map, upper(), UpdateMap(situation=situation)).map
        building.update(map, upper(), roadmap)
        assert (building.ways() is ways) is stays
