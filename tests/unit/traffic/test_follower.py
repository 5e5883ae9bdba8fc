"""Who follows the map for traffic tells it what follows from the map, also after a restart of either."""

from __future__ import annotations

from itertools import count

from somrs.kernel.component import Effect, Input
from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.virtual_time import Work, World
from somrs.traffic.component import SCHEMA, Traffic
from somrs.traffic.follower import MapFollower
from somrs.traffic.notices import CloseWays, HoldTraffic
from somrs.traffic.roadmap import Roadmap
from tests.support.simulated_tower import tower
from tests.support.simulator_room import ONTOLOGY

BUILDING = "House"


class _Operator:
    """Changes the map, and needs no answer."""

    def handle(self, event: Input, now: float) -> list[Effect]:
        return []


class _Building:
    """The map of a building, its traffic, and who follows the map for it."""

    def __init__(self) -> None:
        self.world, self._ids = World(), count()
        self.traffic = Traffic("traffic", Roadmap(places=(), lanes=()))
        self.start_repository()
        self.world.add("operator", _Operator())
        self.world.add("traffic", self.traffic, journaled=SCHEMA)
        self.start_follower()

    def start_repository(self) -> None:
        self.world.add("repository", Repository("repository", Contents(ontology=ONTOLOGY, map=tower((2, 2, 0)))))

    def start_follower(self) -> None:
        """With nothing but the map: no memory of what an earlier one has told."""
        follower = MapFollower("map-follower", "repository")
        self.world.remove("map-follower")
        self.world.add("map-follower", follower, self._work)
        self.world.run(5.0)

    def _work(self, task: object) -> Work:
        """What the program of traffic does: a survey finds nothing closed."""
        if isinstance(task, CloseWays | HoldTraffic):
            self.world.notify("traffic", task)
        yield 0.1, CloseWays()

    def set_mode(self, mode: str) -> None:
        header = Header(sender="operator", recipient="repository", message_id=f"m{next(self._ids)}", reply_to="operator")
        self.world.send(Message(header=header, body=UpdateMap(changes=(ValueSet(BUILDING, "Mode", mode),))))
        self.world.run(5.0)

    @property
    def hold(self) -> str:
        return self.traffic.state.hold


def test_traffic_is_held_in_a_fire_and_goes_on_afterwards() -> None:
    building = _Building()
    building.set_mode("Fire")
    assert building.hold == "fire alarm in House"
    building.set_mode("Normal")
    assert building.hold == ""


def test_traffic_goes_on_after_a_fire_that_ended_while_nobody_followed_the_map() -> None:
    building = _Building()
    building.set_mode("Fire")
    building.world.remove("map-follower")
    building.set_mode("Normal")
    assert building.hold == "fire alarm in House"
    building.start_follower()
    assert building.hold == ""


def test_traffic_goes_on_after_a_fire_if_the_map_is_an_earlier_one() -> None:
    building = _Building()
    for mode in ("Emergency", "Normal", "Fire"):
        building.set_mode(mode)
    building.start_repository()  # from a backup, of a time before the fire
    building.start_follower()
    assert building.hold == ""
