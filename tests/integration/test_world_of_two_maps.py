"""A simulated world of two maps: it follows both, and keeps a thing that the one owner gives to the other."""

from __future__ import annotations

import pytest

from somrs.devices.simulator.server.follower import Followed, Follower
from somrs.devices.simulator.server.simulated_world import SimulatedWorld
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.kernel.component import Effect, Input
from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.knowledge import Updated, UpdateMap
from somrs.runtime.virtual_time import World
from tests.integration.test_two_maps import Owner, TwoOwners
from tests.support.two_sites import SITES

ON_RAMP = "Jar1 isOn Yard:Ramp AND Jar1.PositionX = 8.5 AND Jar1.PositionY = 3 AND Jar1.PositionZ = 0.3"


class LateFollower:
    """A follower for which inputs can be held up."""

    def __init__(self, follower: Follower) -> None:
        self._follower = follower
        self._late: list[tuple[Input, float]] | None = None

    def handle(self, event: Input, now: float) -> list[Effect]:
        if self._late is None:
            return self._follower.handle(event, now)
        self._late.append((event, now))
        return []

    def hold(self) -> None:
        self._late = []

    def go_on(self) -> None:
        late, self._late = self._late or [], None
        for event, now in late:
            self._follower.handle(event, now)


class SharedWorld:
    """The barn and the yard, and a world of both."""

    def __init__(self) -> None:
        self.owners = TwoOwners(sites=SITES)
        self.followed = Followed(SimulatedWorld(WorldKind.KINEMATIC), ["Barn/repository", "Yard/repository"])
        self.followers = {name: LateFollower(Follower(f"world/{name}", f"{name}/repository", self.followed)) for name in ("Barn", "Yard")}
        for name, follower in self.followers.items():
            assert self.followed.world.simulation is None
            self.owners.world.add(f"world/{name}", follower)
            self.owners.world.run(5)

    @property
    def simulation(self) -> Simulation:
        assert self.followed.world.simulation is not None
        return self.followed.world.simulation

    def update(self, repository: str, update: UpdateMap) -> None:
        self.owners.client.ask(repository, update, Updated)
        self.owners.world.run(30)


def test_a_world_of_two_maps_has_the_objects_of_both() -> None:
    shared = SharedWorld()
    assert {*shared.simulation.robots} == {"Barn:BarnRobot", "Yard:YardRobot"}
    assert [*shared.simulation.scene.things()] == ["Barn:Jar1"]
    assert shared.followed.world.map.has_fact("isOn", ("Barn:Jar1", "Barn:BarnTable"))


@pytest.mark.parametrize("late", ["Barn", "Yard"])
@pytest.mark.parametrize("is_there", [True, False], ids=["there", "elsewhere"])
def test_a_thing_that_gets_another_home_stays_in_the_world_once(late: str, is_there: bool) -> None:
    """Whichever map tells the world first, and wherever the thing is by then."""
    shared = SharedWorld()
    x = 8.5 if is_there else 14.5
    shared.simulation.move("Barn:Jar1", x, 3, 0.3)
    weight = shared.simulation.scene.world.solids["Barn:Jar1"].weight
    shared.followers[late].hold()
    shared.update("Barn/repository", UpdateMap(situation=ON_RAMP))
    assert shared.owners.barn.map.has_fact("isOn", ("Yard:Jar1", "Yard:Ramp"))
    shared.followers[late].go_on()
    assert [*shared.simulation.scene.things()] == ["Yard:Jar1"]
    assert shared.simulation.scene.pose("Yard:Jar1")[0] == pytest.approx(x)
    assert shared.simulation.scene.world.solids["Yard:Jar1"].weight == weight


def test_what_stops_the_robots_of_one_map_is_followed() -> None:
    shared = SharedWorld()
    shared.update("Barn/repository", UpdateMap(changes=(ValueSet("BarnRobot", "Paused", True),)))
    assert shared.simulation.robots["Barn:BarnRobot"].paused
    assert not shared.simulation.robots["Yard:YardRobot"].paused


def test_maps_of_one_name_are_refused() -> None:
    world = World()
    followed = Followed(SimulatedWorld(WorldKind.KINEMATIC), ["Barn/repository", "Yard/repository"])
    for name, site in SITES.items():
        Owner(world, name, site.replace("map: Yard", "map: Barn"))
        world.add(f"world/{name}", Follower(f"world/{name}", f"{name}/repository", followed))
    world.run(5)
    assert followed.world.read.is_set()
    assert "several maps are called Barn" in followed.problem
