"""The organisations of a run, one for each map: their Repositories and Registries, which are neighbours."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from somrs.kernel.component import Received, Send
from somrs.kernel.offers import Offers
from somrs.ontology.homes import renamed_fact, renamed_object
from somrs.ontology.map import Map
from somrs.ontology.qualified_names import home_of, plain_name, translated
from somrs.protocol.messages.directory import Discover, Discovered
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.neighbours import Neighbour
from somrs.registry.component import SCHEMA as REGISTRY
from somrs.registry.component import Registry
from somrs.registry.neighbours import Neighbour as NeighbouringRegistry
from somrs.registry.selection import Selection
from somrs.repository.component import SCHEMA as REPOSITORY
from somrs.repository.component import Repository
from somrs.repository.neighbouring import NeighboursConfigured
from somrs.repository.state import Contents
from somrs.runtime.virtual_time import World
from verification.fault_runs.scenario import Scenario
from verification.fault_runs.site import homes_of, map_of, ontology

EVERYTHING = Selection()


class Organisations:
    """Their Repositories and Registries, which `begin` adds to the world."""

    _world: World

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self.repositories = dict(zip(scenario.maps, scenario.repository_addresses, strict=True))
        """The address of each Repository, by the name of its map."""
        self.registries = [scenario.registry_addresses(number) for number in range(scenario.repositories)]
        """The addresses of the Registries of each organisation."""
        homes = homes_of(scenario)
        self.fixed_homes: Mapping[str, str] = {name: home for name, home in homes.items() if name not in dict(scenario.things)}
        """The maps of the objects that never get another one."""

    def begin(self, world: World) -> None:
        self._world = world
        for map, address in self.repositories.items():
            world.add(address, Repository(address, Contents(ontology=ontology(), map=map_of(self._scenario, map))), journaled=REPOSITORY)
        for number, addresses in enumerate(self.registries):
            for address in addresses:
                world.add(address, self._registry(number, address), journaled=REGISTRY)
        if len(self.repositories) > 1:
            for map, address in self.repositories.items():
                world.notify(address, NeighboursConfigured(map=map, neighbours=tuple(self._neighbouring_maps(map))))

    def _neighbouring_maps(self, map: str) -> Iterator[Neighbour]:
        for other_map, address in self.repositories.items():
            if other_map != map:
                yield Neighbour(map=other_map, address=address, shows_all=True)

    def _registry(self, number: int, address: str) -> Registry:
        return Registry(address, ontology(), self.repository_of(number), self._neighbouring_registries(number, address))

    def _neighbouring_registries(self, number: int, address: str) -> Iterator[NeighbouringRegistry]:
        for other in self.registries[number]:
            if other != address:
                yield NeighbouringRegistry(name=other, address=other, takes=EVERYTHING, gives=EVERYTHING, is_of_site=True)
        for map, addresses in zip(self._scenario.maps, self.registries, strict=True):
            if address not in addresses:
                yield NeighbouringRegistry(name=map, address=addresses[0], takes=EVERYTHING, gives=EVERYTHING)

    def repository_of(self, map_number: int) -> str:
        return self.repositories[self._scenario.maps[map_number]]

    def registry_of(self, map_number: int, number: int) -> str:
        """The Registry with which the Task Manager or the device with this number begins."""
        registries = self.registries[map_number]
        return registries[number % len(registries)]

    @property
    def first_map(self) -> str:
        return self._scenario.maps[0]

    @property
    def all_registries(self) -> list[str]:
        return [address for addresses in self.registries for address in addresses]

    # What they know

    def contents(self, map: str) -> Contents | None:
        """What a Repository has; None if it is down."""
        repository = self._world.components.get(self.repositories[map])
        return repository.contents if isinstance(repository, Repository) else None

    def running_contents(self) -> dict[str, Contents]:
        """What the Repositories have that run, by map."""
        return {map: contents for map in self.repositories if (contents := self.contents(map)) is not None}

    def homes(self, name: str) -> list[str]:
        """The maps on which an object with this plain name is at home, of the Repositories that run."""
        if name in self.fixed_homes:
            return [self.fixed_homes[name]]
        return [map for map, contents in self.running_contents().items() if name in contents.map.objects]

    def offers_at(self, registry: str) -> Offers | None:
        """What a Registry lists; None if it is down for good. All of it fits on a page."""
        if not self._world.alive(registry):
            return None
        header = Header(sender=ANONYMOUS, recipient=registry, message_id="urn:so-mrs:all-offers")
        effects = self._world.components[registry].handle(Received(Message(header=header, body=Discover())), self._world.now)
        (page,) = (effect.message.body for effect in effects if isinstance(effect, Send))
        assert isinstance(page, Discovered)
        assert not page.more
        return Offers(page.offers)

    def activity(self) -> Iterator[str]:
        """What Repositories still do, or have still reserved."""
        for map, address in self.repositories.items():
            contents = self.contents(map)
            if contents is None:
                yield f"{address} is down"
                continue
            yield from (f"{address} hands {name} over" for name in contents.handovers)
            yield from (f"{address} waits for its neighbours with the update {id}" for id in contents.forwarded)
            yield from (f"{address} has objects reserved for {task}" for task in contents.reservations.claimants)
            yield from (f"{address} has objects of neighbours reserved for {task}" for task in contents.shared_reservations)

    def disagreements(self) -> Iterator[str]:
        """How maps, or lists of services, that have to be the same differ."""
        maps = {map: contents.map for map, contents in self.running_contents().items()}
        for name, map in maps.items():
            yield from (
                f"{other} does not have the objects of {name}" for other in maps if _seen(maps[other], name) != _shown(map, name, other)
            )
        listed = {address: offers for address in self.all_registries if (offers := self.offers_at(address)) is not None}
        services = {address: {plain_name(offer.service) for offer in offers} for address, offers in listed.items()}
        if any(names != services[address] for address in services for names in services.values()):
            yield f"the Registries do not list the same: {services}"


def _shown(map: Map, name: str, to: str) -> tuple[set[str], set[object]]:
    """The own objects of a map, and their facts, under the names of another map."""
    own = [object for object in map.objects.values() if not home_of(object.name)]
    facts = {renamed_fact(fact, lambda n: translated(n, name, to)) for object in own for fact in map.facts_from(object.name)}
    return {repr(renamed_object(object, lambda n: translated(n, name, to))) for object in own}, {*facts}


def _seen(map: Map, home: str) -> tuple[set[str], set[object]]:
    """What a map has of another one, or of itself."""
    objects = [object for object in map.objects.values() if home_of(object.name) == (home if home != map.name else "")]
    return {repr(object) for object in objects}, {fact for object in objects for fact in map.facts_from(object.name)}
