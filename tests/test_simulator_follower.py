"""A simulated world that follows the Repository's map while it runs."""

from __future__ import annotations

from collections.abc import Iterable

from lab import REPOSITORY, request
from looking_lab import SITE
from somrs.devices.simulator.commands import Command, Done, DriveTo, Gave
from somrs.devices.simulator.follower import Follower
from somrs.ontology.files import load_text, upper
from somrs.ontology.objects import Object, ObjectAdded, ObjectRemoved
from somrs.protocol.component import Component, Effect, Received, Send, Started
from somrs.protocol.knowledge import UpdateMap
from somrs.repository.component import Repository
from somrs.repository.entries import Contents

FOLLOWER = "http://here/simulator"
DOOR = "  Door1: {type: Door, at: [6, 5, 0], Shape: {Form: Box, Width: 0.1, Depth: 2, Height: 2.1}, Open: true}\nfacts:"


class Both:
    """A Repository and a world that follows it, joined by a network that loses nothing."""

    def __init__(self) -> None:
        loaded = load_text(SITE.replace("facts:", DOOR), base=upper())
        assert loaded.map is not None
        self.repository = Repository(REPOSITORY, Contents(ontology=loaded.ontology, map=loaded.map))
        self.follower = Follower(FOLLOWER, REPOSITORY)
        self._carry(self.follower.handle(Started(FOLLOWER), 0.0))
        assert self.follower.simulation is not None
        self.simulation = self.follower.simulation

    def _carry(self, effects: Iterable[Effect]) -> None:
        sent = [effect.message for effect in effects if isinstance(effect, Send)]
        while sent:
            message = sent.pop(0)
            parts: dict[str, Component] = {REPOSITORY: self.repository, FOLLOWER: self.follower}
            to = parts.get(message.header.recipient)
            if to is not None:
                sent += [effect.message for effect in to.handle(Received(message), 0.0) if isinstance(effect, Send)]

    def update(self, update: UpdateMap) -> None:
        self._carry(self.repository.handle(Received(request(update)), 0.0))

    def drive(self, command: Command) -> Done | Gave:
        ends: list[Done | Gave] = []
        self.simulation.command("Patrol1", command, ends.append)
        while not ends:
            assert self.simulation.time < 300
            self.simulation.step()
        return ends[0]


def test_a_door_that_is_closed_on_the_map_is_closed_in_the_world() -> None:
    both = Both()
    there, back = DriveTo(x=4, y=5), DriveTo(x=8, y=5)
    assert isinstance(both.drive(there), Done)
    both.update(UpdateMap(situation="Door1.Open = FALSE"))
    end = both.drive(back)
    assert isinstance(end, Gave)
    assert end.reason == "unreachable"
    both.update(UpdateMap(situation="Door1.Open = TRUE"))
    assert isinstance(both.drive(back), Done)


def test_what_is_measured_moves_nothing() -> None:
    both = Both()
    before = both.simulation.seen("Jar1")
    both.update(UpdateMap(situation="Jar1.PositionX = 3 AND Jar1 isOn Floor1"))
    assert both.simulation.seen("Jar1") == before


def test_what_comes_to_the_map_and_goes_from_it_comes_and_goes() -> None:
    both = Both()
    cup = Object(name="Cup1", type="Cup", values={"PositionX": 10.5, "PositionY": 4.0, "PositionZ": 0.3})
    both.update(UpdateMap(changes=(ObjectAdded(cup),)))
    assert both.simulation.seen("Cup1").on == "Platform1"
    both.update(UpdateMap(changes=(ObjectRemoved("Cup1"),)))
    assert "Cup1" not in both.simulation.scene.world.solids
