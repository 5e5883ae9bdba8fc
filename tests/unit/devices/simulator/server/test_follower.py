"""A simulated world that follows the Repository's map while it runs."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from msgspec import structs

from somrs.devices.simulator.link.commands import Approach, Command, CommandDone, CommandGivenUp, DriveTo, Grip, Place
from somrs.devices.simulator.server.driving_distances import find_legs
from somrs.devices.simulator.server.follower import Followed, Follower
from somrs.devices.simulator.server.simulated_world import SimulatedWorld
from somrs.kernel.component import Component, Effect, Received, Send, Started, TimerFired
from somrs.kernel.following import GAP_TIME
from somrs.kernel.replica import ReplicaDue
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.objects import FactAdded, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import Value
from somrs.protocol.messages.knowledge import Alteration, Define, Definitions, MergeObject, RenameObject, UpdateMap
from somrs.protocol.messages.observations import Observation
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from tests.support.lab import REPOSITORY, request
from tests.support.observation_lab import SITE

FOLLOWER = "http://here/simulator"
DOOR = "  Door1: {type: Door, at: [6, 5, 0], Shape: {Form: Box, Width: 0.1, Depth: 2, Height: 2.1}, Open: true}\nfacts:"


class RepositoryAndWorld:
    """A Repository and a world that follows it, joined by a network that loses nothing."""

    def __init__(self) -> None:
        loaded = load_text(SITE.replace("facts:", DOOR), base=upper())
        assert loaded.map is not None
        self.repository = Repository(REPOSITORY, Contents(ontology=loaded.ontology, map=loaded.map))
        world = SimulatedWorld()
        self.follower = Follower(FOLLOWER, REPOSITORY, Followed(world, [REPOSITORY]))
        self.now = 0.0
        self._carry(self.follower.handle(Started(FOLLOWER), 0.0))
        assert world.simulation is not None
        self.simulation = world.simulation

    def _carry(self, effects: Iterable[Effect]) -> None:
        messages = [effect.message for effect in effects if isinstance(effect, Send)]
        while messages:
            message = messages.pop(0)
            parts: dict[str, Component] = {REPOSITORY: self.repository, FOLLOWER: self.follower}
            recipient = parts.get(message.header.recipient)
            if recipient is not None:
                messages += [effect.message for effect in recipient.handle(Received(message), self.now) if isinstance(effect, Send)]

    def update(self, update: Alteration) -> None:
        self._carry(self.repository.handle(Received(request(update)), self.now))
        self.now += 2 * GAP_TIME  # what it could not be told, it notices
        self._carry(self.follower.handle(TimerFired(ReplicaDue()), self.now))
        assert self.follower.replica.version == self.repository.contents.version

    def drive(self, command: Command, robot: str = "Patrol1") -> CommandDone | CommandGivenUp:
        ends: list[CommandDone | CommandGivenUp] = []
        self.simulation.command(robot, command, ends.append)
        while not ends:
            assert self.simulation.time < 300
            self.simulation.step()
        return ends[0]


def test_a_door_that_is_closed_on_the_map_is_closed_in_the_world() -> None:
    pair = RepositoryAndWorld()
    drive_there, drive_back = DriveTo(x=4, y=5), DriveTo(x=8, y=5)
    assert isinstance(pair.drive(drive_there), CommandDone)
    pair.update(UpdateMap(situation="Door1.Open = FALSE"))
    end = pair.drive(drive_back)
    assert isinstance(end, CommandGivenUp)
    assert end.reason == "unreachable"
    pair.update(UpdateMap(situation="Door1.Open = TRUE"))
    assert isinstance(pair.drive(drive_back), CommandDone)


def test_things_can_be_put_where_the_map_says_so() -> None:
    pair = RepositoryAndWorld()
    stool: dict[str, Value] = {
        "PositionX": 2.0,
        "PositionY": 2.0,
        "PositionZ": 0.0,
        "Shape.Form": "Box",
        "Shape.Width": 0.5,
        "Shape.Depth": 0.5,
    }
    pair.update(UpdateMap(changes=(ObjectAdded(Object(name="Stool1", type="Chair", values={**stool, "Shape.Height": 0.5})),)))
    assert not find_legs(pair.simulation, "Patrol1", ("Stool1",)).carries
    pair.update(UpdateMap(situation="Stool1.Supporting = TRUE"))
    assert find_legs(pair.simulation, "Patrol1", ("Stool1",)).carries
    pair.update(UpdateMap(changes=(ValueSet("Stool1", "Supporting", None),)))
    assert not find_legs(pair.simulation, "Patrol1", ("Stool1",)).carries
    chair = structs.replace(upper().types["Chair"], defaults={"Supporting": True})
    pair.update(Define(definitions=Definitions(types=(chair,))))
    assert find_legs(pair.simulation, "Patrol1", ("Stool1",)).carries


def test_what_is_measured_moves_nothing() -> None:
    pair = RepositoryAndWorld()
    jar_before = pair.simulation.observe("Jar1")
    pair.update(UpdateMap(situation="Jar1.PositionX = 3 AND Jar1 isOn Floor1"))
    assert pair.simulation.observe("Jar1") == jar_before


def test_what_comes_to_the_map_and_goes_from_it_comes_and_goes() -> None:
    pair = RepositoryAndWorld()
    cup = Object(name="Cup1", type="Cup", values={"PositionX": 10.5, "PositionY": 4.0, "PositionZ": 0.3})
    pair.update(UpdateMap(changes=(ObjectAdded(cup),)))
    assert pair.simulation.observe("Cup1").support == "Platform1"
    pair.update(UpdateMap(changes=(ObjectRemoved("Cup1"),)))
    assert "Cup1" not in pair.simulation.scene.world.solids


def make_renaming(section: Section, name: str, new_name: str) -> Define:
    return Define(renamed=(Renaming(section=section, name=name, to=new_name),))


@pytest.mark.parametrize("type", ["Jar", "PatrolRobot", "Platform", "Building"])
def test_what_is_of_a_type_with_another_name_stays_as_it_is(type: str) -> None:
    pair = RepositoryAndWorld()
    assert isinstance(pair.drive(DriveTo(x=4, y=5)), CommandDone)
    poses_before = pair.simulation.scene.pose("Jar1"), pair.simulation.scene.pose("Patrol1")
    if type != "PatrolRobot":  # which SO-MRS relies on
        pair.update(make_renaming(Section.TYPES, type, "Other"))
    else:
        pair.update(Define(definitions=Definitions(types=(structs.replace(upper().types[type], name="Other", parent=type),))))
        robot = structs.replace(pair.repository.contents.map.objects["Patrol1"], type="Other")
        facts = tuple(FactAdded(fact) for fact in pair.repository.contents.map.facts_about("Patrol1"))
        pair.update(UpdateMap(changes=(ObjectRemoved("Patrol1"), ObjectAdded(robot), *facts)))
    assert (pair.simulation.scene.pose("Jar1"), pair.simulation.scene.pose("Patrol1")) == poses_before
    assert isinstance(pair.drive(DriveTo(x=8, y=5)), CommandDone)


def test_a_thing_with_another_name_stays_where_it_is() -> None:
    pair = RepositoryAndWorld()
    pair.simulation.move("Jar1", 3.0, 4.0, 0.0)
    for _ in range(50):
        pair.simulation.step()
    jar_before = pair.simulation.observe("Jar1")
    pair.update(RenameObject(name="Jar1", to="Krug"))
    jar_after = pair.simulation.observe("Krug")
    assert (jar_after.x, jar_after.y, jar_after.z) == pytest.approx((jar_before.x, jar_before.y, jar_before.z), abs=1e-4)
    assert "Jar1" not in pair.simulation.scene.world.solids
    pair.update(RenameObject(name="Platform1", to="Stage1"))
    assert "Stage1" in pair.simulation.scene.world.solids


SEEN_JAR = "?Seen: Jar.PositionX = 3.01 AND ?Seen.PositionY = 4 AND ?Seen.PositionZ = 0 AND ?Seen isOn Floor1"


def see_moved_jar() -> RepositoryAndWorld:
    """The world after somebody moved Jar1, and a camera that did not look for it saw a jar: the Repository takes that for another."""
    pair = RepositoryAndWorld()
    pair.simulation.move("Jar1", 3.0, 4.0, 0.0)
    pair.update(UpdateMap(situation=SEEN_JAR, observation=Observation()))
    assert {"Jar1", "Jar002"} <= pair.repository.contents.map.objects.keys()
    return pair


def test_a_thing_that_is_seen_as_a_new_object_stands_in_the_world_once() -> None:
    pair = see_moved_jar()
    assert list(pair.simulation.scene.things()) == ["Jar002"]
    assert pair.simulation.scene.pose("Jar002")[:2] == pytest.approx((3.0, 4.0), abs=1e-3), (
        "it stays where it is, not where it was measured"
    )
    pair.update(UpdateMap(changes=(ObjectRemoved("Jar1"),)))
    assert list(pair.simulation.scene.things()) == ["Jar002"]


def test_a_thing_that_only_the_world_has_gets_the_name_under_which_it_comes_to_the_map() -> None:
    pair = RepositoryAndWorld()
    pair.simulation.add(Object(name="Hidden1", type="Jar", values={"PositionX": 3.0, "PositionY": 4.0, "PositionZ": 0.0}))
    pair.update(UpdateMap(situation=SEEN_JAR, observation=Observation()))
    assert {*pair.simulation.scene.things()} == {"Jar1", "Jar002"}


def test_a_new_object_that_turns_out_to_be_a_thing_of_the_map_gives_it_its_name_back() -> None:
    pair = see_moved_jar()
    pair.update(UpdateMap(situation=SEEN_JAR, observation=Observation(sought=("Jar1",))))
    assert "Jar002" not in pair.repository.contents.map.objects
    assert list(pair.simulation.scene.things()) == ["Jar1"]
    assert pair.simulation.scene.pose("Jar1")[:2] == pytest.approx((3.0, 4.0), abs=1e-3)


def test_a_person_says_which_thing_of_the_map_a_new_object_is() -> None:
    pair = see_moved_jar()
    pair.update(MergeObject(name="Jar002", into="Jar1"))
    assert list(pair.simulation.scene.things()) == ["Jar1"]
    assert pair.simulation.scene.pose("Jar1")[:2] == pytest.approx((3.0, 4.0), abs=1e-3)


@pytest.mark.parametrize(("newer", "y"), [("Jar2", 2.0), ("Jar1", 4.0)])
def test_of_two_things_that_are_one_the_one_stays_that_is_where_the_map_has_it(newer: str, y: float) -> None:
    pair = RepositoryAndWorld()
    added = Object(name="Jar2", type="Jar", values={"PositionX": 3.0, "PositionY": 2.0, "PositionZ": 0.0})
    pair.update(UpdateMap(changes=(ObjectAdded(added),)))
    pair.update(UpdateMap(changes=(ValueSet(newer, "PositionY", y + 0.01),)))
    pair.update(MergeObject(name="Jar2", into="Jar1"))
    assert list(pair.simulation.scene.things()) == ["Jar1"]
    assert pair.simulation.scene.pose("Jar1")[1] == pytest.approx(y, abs=1e-2)


def test_a_new_object_that_is_said_to_be_a_thing_that_stands_elsewhere_is_what_it_is() -> None:
    pair = see_moved_jar()
    elsewhere = Object(name="Jar9", type="Jar", values={"PositionX": 5.0, "PositionY": 2.0, "PositionZ": 0.0})
    pair.update(UpdateMap(changes=(ObjectAdded(elsewhere),)))
    pair.update(MergeObject(name="Jar002", into="Jar9"))
    assert {*pair.simulation.scene.things()} == {"Jar1", "Jar9"}, "what the world has does not change by what somebody says"
    assert pair.simulation.scene.pose("Jar9")[:2] == pytest.approx((5.0, 2.0), abs=1e-2)


@pytest.mark.parametrize(
    ("new", "shape", "y"), [("Can", {}, 4.0), ("Jar", {"Shape.Height": 0.3}, 4.0), ("Jar", {}, 4.15)], ids=["type", "size", "place"]
)
def test_an_object_that_is_of_another_type_size_or_place_is_another_thing(new: str, shape: dict[str, float], y: float) -> None:
    pair = RepositoryAndWorld()
    pair.simulation.move("Jar1", 3.0, 4.0, 0.0)
    added = Object(name="New1", type=new, values={"PositionX": 3.0, "PositionY": y, "PositionZ": 0.0, **shape})
    pair.update(UpdateMap(changes=(ObjectAdded(added),)))
    assert {*pair.simulation.scene.things()} == {"Jar1", "New1"}


def test_an_object_beside_a_thing_that_the_map_has_there_is_another_thing() -> None:
    pair = RepositoryAndWorld()
    beside = Object(name="Jar2", type="Jar", values={"PositionX": 1.15, "PositionY": 4.09, "PositionZ": 0.7})
    pair.update(UpdateMap(changes=(ObjectAdded(beside),)))
    assert {*pair.simulation.scene.things()} == {"Jar1", "Jar2"}


def test_a_thing_in_a_robots_hand_may_get_another_name_or_go() -> None:
    pair = RepositoryAndWorld()
    assert isinstance(pair.drive(Approach(object="Jar1"), "Robot1"), CommandDone)
    assert isinstance(pair.drive(Grip(object="Jar1"), "Robot1"), CommandDone)
    pair.update(RenameObject(name="Jar1", to="Krug"))
    assert pair.simulation.observe("Krug").held_by == "Robot1"
    assert isinstance(pair.drive(DriveTo(x=4, y=5), "Robot1"), CommandDone)
    assert pair.simulation.scene.pose("Krug")[:2] == pytest.approx((4, 5), abs=1)
    ends: list[CommandDone | CommandGivenUp] = []
    pair.simulation.command("Robot1", Place(support="Floor1"), ends.append)
    pair.simulation.step()
    pair.update(UpdateMap(changes=(ObjectRemoved("Krug"),)))
    while not ends:
        assert pair.simulation.time < 300
        pair.simulation.step()
    assert isinstance(ends[0], CommandGivenUp)
    assert "Krug was removed from the world" in ends[0].description
    assert isinstance(pair.drive(DriveTo(x=4, y=4), "Robot1"), CommandDone)


def test_a_change_that_no_message_can_hold_is_followed_too() -> None:
    """It is read from the map as it is then."""
    pair = RepositoryAndWorld()
    pair.update(Define(definitions=Definitions(types=(structs.replace(upper().types["Cup"], name="Mug", doc="x" * 60_000),))))
    mugs = [Object(name=f"Mug{n}", type="Mug", values={"PositionX": 10.5, "PositionY": 4.0, "PositionZ": 0.3 + n}) for n in range(2)]
    pair.update(UpdateMap(changes=tuple(map(ObjectAdded, mugs))))
    pair.update(make_renaming(Section.TYPES, "Mug", "Beaker"))
    assert {"Mug0", "Mug1"} <= pair.simulation.scene.world.solids.keys()
    assert pair.simulation.scene.world.solids["Mug0"].type == "Beaker"
