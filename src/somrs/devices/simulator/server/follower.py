"""Follows the map of a Repository for a simulated world (`simulated_world.py`). A world of several maps has a follower for each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from msgspec import structs

from somrs.devices.simulator.server.simulated_world import SimulatedWorld
from somrs.kernel.component import Effect, Input, Received, Started
from somrs.kernel.not_understood import refuse_request
from somrs.kernel.replica import Replica, ReplicaUpdate
from somrs.ontology.differences import differences
from somrs.ontology.homes import renamed_change, renamed_fact, renamed_object
from somrs.ontology.map import Map
from somrs.ontology.naming import Section
from somrs.ontology.objects import Change
from somrs.ontology.qualified_names import translated
from somrs.ontology.types import Ontology


class Followed:
    """The maps of one or several Repositories, as `world` has them: the names of several are qualified with those of the maps."""

    def __init__(self, world: SimulatedWorld, repositories: Iterable[str]) -> None:
        self.world = world
        self._replicas: dict[str, Replica] = {}
        """Those that have read their maps, by the addresses of the Repositories."""
        self.problem = ""
        """Why there is no world although all maps have been read."""
        self._repositories = tuple(dict.fromkeys(repositories))

    @property
    def is_shared(self) -> bool:
        """Whether there are several maps."""
        return len(self._repositories) > 1

    @property
    def unread(self) -> list[str]:
        """The Repositories whose maps have not been read yet."""
        return [address for address in self._repositories if address not in self._replicas]

    def _name_problem(self) -> str:
        """Why several maps cannot be told apart; empty if they can."""
        names = Counter(replica.map.name for replica in self._replicas.values())
        for repository, replica in self._replicas.items() if self.is_shared else ():
            if not replica.map.name:
                return f"the map of {repository} has no name: write `map: NAME` into its site file"
            if names[replica.map.name] > 1:
                return f"several maps are called {replica.map.name}, one of them at {repository}: give each a name of its own"
        return ""

    def changed(self, replica: Replica, news: ReplicaUpdate, changes: Iterable[Change]) -> None:
        """A replica has changed; build the world when all have been read."""
        if replica.ready:
            self._replicas[replica.repository] = replica
        world = self.world
        if world.simulation is None:
            if not self.unread and not self.problem:
                self._build()
            return
        if news.ontology_changed:
            world.learn(self._ontology())
        renamed = [renaming for renaming in news.renamed if renaming.section is Section.OBJECTS] if not news.reloaded else []
        merged = {merging.name: merging.into for merging in news.merged} if not news.reloaded else {}
        if not self.is_shared:
            world.change(replica.map, changes, renamed, merged)
            return

        def full(name: str) -> str:
            return translated(name, replica.map.name, "")

        changes = [renamed_change(change, full) for change in changes]
        renamed = [structs.replace(renaming, name=full(renaming.name), to=full(renaming.to)) for renaming in renamed]
        merged = {full(name): full(into) for name, into in merged.items()}
        world.change(world.map.changed(changes), changes, renamed, merged)

    def _build(self) -> None:
        self.problem = self._name_problem()
        if self.problem:
            self.world.read.set()
        else:
            self.world.build(self._map(), self._ontology())

    def _map(self) -> Map:
        replicas = [self._replicas[address] for address in self._repositories]
        if not self.is_shared:
            return replicas[0].map
        objects, facts = [], []
        for replica in replicas:
            map = replica.map

            def full(name: str, home: str = map.name) -> str:
                return translated(name, home, "")

            objects += [renamed_object(object, full) for object in map.objects.values()]
            facts += [renamed_fact(fact, full) for fact in map.facts()]
        return Map(objects, facts)

    def _ontology(self) -> Ontology:
        """The definitions of all maps. Of two definitions of one name, that of the Repository that is named first counts."""
        ontology, *further_ontologies = (self._replicas[address].ontology for address in self._repositories)
        for further_ontology in further_ontologies:
            ontology = further_ontology.extended(ontology)
        return ontology


PURPOSE = "a simulator follows a map"


class Follower:
    """A component that only receives. It follows the objects that have their home on the map of one Repository."""

    def __init__(self, address: str, repository: str, followed: Followed) -> None:
        self.replica = Replica(address, repository, own=True)
        self._followed = followed
        self._map = Map()

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Started):
            return self.replica.start(now)
        news = self.replica.handle(event, now)
        if news is None:
            return [*refuse_request(event.message, PURPOSE)] if isinstance(event, Received) else []
        map_before, self._map = self._map, self.replica.map
        # A reloaded map has no list of changes, so they are computed from the difference.
        changes = differences(map_before, self.replica.map) if news.reloaded else news.changes
        self._followed.changed(self.replica, news, changes)
        return news.effects
