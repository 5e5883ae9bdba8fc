"""Three Repositories with messages that are late, doubled and lost, and that are killed at any moment: every thing keeps one home."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest

from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.homes import renamed_fact, renamed_object
from somrs.ontology.map import Map
from somrs.ontology.qualified_names import home_of, translated
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.protocol.messages.neighbours import Neighbour
from somrs.repository.component import SCHEMA, Repository
from somrs.repository.neighbouring import NeighboursConfigured
from somrs.repository.state import Contents
from somrs.runtime.virtual_time import KillPoint, World
from tests.support.answer_client import AnswerClient
from tests.support.building import building

MAPS = ("Barn", "Yard", "Mill")
JARS = 3


def address(map: str) -> str:
    return f"http://{map}/repository"


def repository(map: str) -> Repository:
    tables = "".join(
        f"\n  {map}Table{n}: {{type: Table, at: [{n}, 1, 0], Shape: {{Form: Box, Width: 1, Depth: 1, Height: 0.7}}}}" for n in (1, 2)
    )
    jars = "".join(f"\n  Jar{n}: {{type: Jar, at: [1, 1, 0.7], Label: {map}-{n}}}" for n in range(JARS))
    facts = "".join(f"\n  - Jar{n} isOn {map}Table1" for n in range(JARS))
    loaded = load_text(f"{building(map, 10, 10)}{tables}{jars}\nfacts:{facts}\n", base=upper())
    assert loaded.map is not None
    return Repository(address(map), Contents(ontology=loaded.ontology, map=loaded.map))


class Neighbourhood:
    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.calm = False
        self.world = World(medium=self.carry)
        self.client = AnswerClient(self.world)
        self.calm = True
        for map in MAPS:
            self.world.add(address(map), repository(map), journaled=SCHEMA)
        for map in MAPS:
            neighbours = tuple(Neighbour(map=other, address=address(other), shows_all=True) for other in MAPS if other != map)
            self.world.notify(address(map), NeighboursConfigured(map=map, neighbours=neighbours))
        self.world.run(120.0)
        self.calm = False

    def carry(self, message: Message) -> Sequence[float]:
        if self.calm:
            return (0.001,)
        copies = self.chance.choice((0, 1, 1, 1, 1, 2))
        return [self.chance.choice((0.001, 0.1, 2.0)) * self.chance.random() for _ in range(copies)]

    def map(self, name: str) -> Map:
        component = self.world.components[address(name)]
        assert isinstance(component, Repository)
        return component.contents.map

    def play(self, steps: int) -> list[str]:
        """Let things be moved at any map to any map, and kill Repositories. Return the ids of the updates."""
        requests: list[str] = []
        for _ in range(steps):
            map = self.chance.choice(MAPS)
            if self.chance.random() < 0.3 and self.world.alive(address(map)):
                self.world.kill(address(map), self.chance.choice([*KillPoint]), self.chance.randrange(4))
            elif self.world.alive(address(map)):
                known = self.map(map)
                jars = sorted(object.name for object in known.objects.values() if object.type == "Jar")
                tables = sorted(object.name for object in known.objects.values() if object.type == "Table")
                if jars and tables:
                    situation = f"{self.chance.choice(jars)} isOn {self.chance.choice(tables)}"
                    requests.append(self.client.send(address(map), UpdateMap(situation=situation, author="test")))
            self.world.run(self.chance.choice((0.0, 0.05, 1.0, 30.0)))
            for other in MAPS:
                if not self.world.alive(address(other)) and self.chance.random() < 0.5:
                    self.world.revive(address(other))
        self.calm = True
        for _ in MAPS:  # one that is to be killed at its next input is alive before it
            for other in MAPS:
                if not self.world.alive(address(other)):
                    self.world.revive(address(other))
            self.world.run(60.0)
        self.client.repeat()
        self.world.run(300.0)
        return requests


def homes(neighbourhood: Neighbourhood) -> dict[str, list[str]]:
    """The maps on which each thing is an own object, by its label."""
    found: dict[str, list[str]] = {f"{map}-{n}": [] for map in MAPS for n in range(JARS)}
    for map in MAPS:
        for object in neighbourhood.map(map).objects.values():
            if object.type == "Jar" and not home_of(object.name):
                found[str(object.values["Label"])].append(map)
    return found


@pytest.mark.parametrize("seed", range(25))
def test_every_thing_has_one_home_whoever_dies_when(seed: int) -> None:
    neighbourhood = Neighbourhood(seed)
    requests = neighbourhood.play(40)
    assert all(isinstance(neighbourhood.client.answers.get(id), Updated | Rejected) for id in requests)
    assert {label: len(maps) for label, maps in homes(neighbourhood).items()} == dict.fromkeys(homes(neighbourhood), 1)
    for map in MAPS:
        own_map = neighbourhood.map(map)
        for object in own_map.objects.values():
            if object.type == "Jar" and not home_of(object.name):
                ((_, table),) = own_map.facts_with("isOn", 0, object.name)
                assert not home_of(table), f"{object.name} of {map} is on {table}, and would be at home there"
        for other in MAPS:
            if other != map:
                assert shown(neighbourhood.map(other), other, map) == seen(own_map, other)


def shown(map: Map, name: str, to: str) -> tuple[set[object], set[object]]:
    """The own objects of a map, and their facts, under the names of another map."""
    objects = {repr(renamed_object(o, lambda n: translated(n, name, to))) for o in map.objects.values() if not home_of(o.name)}
    facts = {renamed_fact(fact, lambda n: translated(n, name, to)) for fact in map.facts() if not home_of(fact.arguments[0])}
    return {*objects}, {*facts}


def seen(map: Map, home: str) -> tuple[set[object], set[object]]:
    """What a map has of another one."""
    objects = {repr(object) for object in map.objects.values() if home_of(object.name) == home}
    return {*objects}, {fact for fact in map.facts() if home_of(fact.arguments[0]) == home}
