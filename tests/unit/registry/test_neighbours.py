"""Registries that are neighbours: what passes between them, whose it is, and what happens when one of them is away."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from somrs.errors import UsageError
from somrs.kernel.codec import Codec, encode
from somrs.kernel.component import Effect, Input, Notified, Received, Send, Started, TimerFired
from somrs.kernel.following import GAP_TIME, LEASE
from somrs.kernel.offers import Offers
from somrs.ontology.objects import Fact, FactAdded, FactRemoved, ObjectAdded, ValueSet
from somrs.ontology.objects import Object as MapObject
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Value
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import (
    Discover,
    Discovered,
    NeighbourView,
    Offer,
    PresenceLog,
    Publish,
    ReadPresence,
    Renew,
    Retract,
    ServicesSubscribed,
    SubscribeServices,
)
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Define, Definitions, UpdateMap
from somrs.registry import neighbours
from somrs.registry.component import SCHEMA, Registry
from somrs.registry.neighbours import Configured, Neighbour
from somrs.registry.selection import Selection, Selector
from somrs.registry.state import RegistryState
from somrs.repository.component import Repository
from somrs.runtime.virtual_time import World
from somrs.service_manager.participant.joining import Joining
from somrs.service_manager.sdk.orders import Capability, Profile
from tests.support.examples import examples
from tests.support.lab import REPOSITORY, ask, contents, request
from tests.support.unfair_medium import UnfairMedium
from tests.unit.kernel.test_service_replica import OWNER, POLISH, TRANSFER, Owner

HERE, THERE, THIRD = "http://here/registry", "http://there/registry", "http://third/registry"
ALL = Selection()
CAREFUL = ServiceType(name="CarefulTransfer", parent="TransferObject", inputs=TRANSFER.inputs, effect=TRANSFER.effect)
WELD = ServiceType(name="Weld", effect="?Provider isWeldedTo ?Provider")


def offer(provider: str, service_type: ServiceType = TRANSFER, registry: str = "", at: str = "") -> Offer:
    return Offer(
        service=f"{provider}.{service_type.name}",
        provider=provider,
        provider_type="PioneerP3DX",
        address=f"http://{at or provider}/",
        service_type=service_type,
        registry=registry,
    )


def publish(provider: str, *types: ServiceType, lease: float = 3600.0, at: str = "") -> Publish:
    offers = tuple(offer(provider, service_type, at=at) for service_type in types or (TRANSFER,))
    return Publish(provider=provider, offers=offers, lease=lease)


def neighbour(name: str, address: str, takes: Selection | None = ALL, gives: Selection | None = ALL) -> Neighbour:
    return Neighbour(name=name, address=address, takes=takes, gives=gives)


class Neighbours:
    """Two Registries on virtual time, `Here` and `There`, of which each is a neighbour of the other."""

    def __init__(self, *, takes: Selection | None = ALL, gives: Selection | None = ALL, repository: bool = False) -> None:
        self.world = World()
        if repository:
            self.world.add(REPOSITORY, Repository(REPOSITORY, contents()))
        source = REPOSITORY if repository else None
        here = Registry(HERE, contents().ontology, source, [neighbour("There", THERE, takes=takes)])
        there = Registry(THERE, contents().ontology, source, [neighbour("Here", HERE, gives=gives)])
        self.world.add(HERE, here, journaled=SCHEMA)
        self.world.add(THERE, there, journaled=SCHEMA)
        self.world.run(1.0)

    def send(self, body: Body, recipient: str = THERE, seconds: float = 1.0) -> None:
        self.world.send(request(body, recipient=recipient))
        self.world.run(seconds)

    def discover(self, address: str = HERE, **query: Any) -> Discovered:
        return ask(self.world.components[address], Discover(**query), Discovered, now=self.world.now)

    def services(self, address: str = HERE) -> list[tuple[str, str]]:
        return [(listed.service, listed.registry) for listed in self.discover(address).offers]

    def log(self) -> list[tuple[str, str, str]]:
        changes = ask(self.world.components[HERE], ReadPresence(), PresenceLog, now=self.world.now).changes
        return [(change.device, change.registry, "joined" if change.joined else change.reason) for change in changes]


def test_offers_of_a_neighbour_are_listed_with_its_name_and_followed() -> None:
    system, owner = Neighbours(), Owner()
    owner.replica.registry = HERE
    system.world.add(OWNER, owner)
    system.send(publish("Robot1"), HERE)
    system.send(publish("Robot2"))
    assert system.services(HERE) == [("Robot1.TransferObject", ""), ("Robot2.TransferObject", "There")]
    assert system.services(THERE) == [("Robot1.TransferObject", "Here"), ("Robot2.TransferObject", "")]
    assert owner.replica.offers == Offers(system.discover().offers)
    system.send(Retract(provider="Robot2"))
    assert system.services(HERE) == [("Robot1.TransferObject", "")]
    assert owner.replica.offers == Offers(system.discover().offers)
    assert system.log() == [("Robot2", "There", "retracted"), ("Robot2", "There", "joined"), ("Robot1", "", "joined")]


def test_a_lease_that_ends_there_ends_here() -> None:
    system = Neighbours()
    system.send(publish("Robot2", lease=10.0))
    assert system.services() == [("Robot2.TransferObject", "There")]
    system.world.run(11.0)
    assert system.services() == []
    assert system.log()[0] == ("Robot2", "There", "expired")


def test_an_offer_passes_one_registry_and_never_comes_back() -> None:
    world = World()
    here = Registry(HERE, contents().ontology, neighbours=[neighbour("There", THERE)])
    there = Registry(THERE, contents().ontology, neighbours=[neighbour("Here", HERE), neighbour("Third", THIRD)])
    third = Registry(THIRD, contents().ontology, neighbours=[neighbour("There", THERE)])
    for address, registry in ((HERE, here), (THERE, there), (THIRD, third)):
        world.add(address, registry)
    world.run(1.0)
    world.send(request(publish("Robot1"), recipient=HERE))
    world.run(1.0)

    def services(registry: Registry) -> list[tuple[str, str]]:
        return [(listed.service, listed.registry) for listed in ask(registry, Discover(), Discovered, now=world.now).offers]

    assert services(here) == [("Robot1.TransferObject", "")]
    assert services(there) == [("Robot1.TransferObject", "Here")]
    assert services(third) == []


# What passes


@pytest.mark.parametrize("side", ["takes", "gives"])
@pytest.mark.parametrize(
    ("selection", "services"),
    [
        (ALL, {"Robot2.TransferObject", "Robot2.CarefulTransfer", "Robot3.Polish"}),
        (Selection(types=("TransferObject",)), {"Robot2.TransferObject", "Robot2.CarefulTransfer"}),
        (Selection(types=("CarefulTransfer", "Polish")), {"Robot2.CarefulTransfer", "Robot3.Polish"}),
        (Selection(providers=("Robot2",)), {"Robot2.TransferObject", "Robot2.CarefulTransfer"}),
        (Selection(providers=("Robot2",), types=("Polish",)), set()),
    ],
)
def test_either_owner_decides_what_passes(side: str, selection: Selection, services: set[str]) -> None:
    system = Neighbours(takes=selection if side == "takes" else ALL, gives=selection if side == "gives" else ALL)
    system.send(publish("Robot2", TRANSFER, CAREFUL))
    system.send(publish("Robot3", POLISH))
    assert {listed.service for listed in system.discover().offers} == services
    assert system.discover(withheld=True).offers == ()
    system.send(Retract(provider="Robot2"))
    assert {listed.service for listed in system.discover().offers} == services & {"Robot3.Polish"}


def test_a_neighbour_learns_nothing_of_what_it_is_not_given() -> None:
    system = Neighbours(gives=Selection(types=("Polish",)))
    before = len(system.world.messages)
    system.send(publish("Robot2"), seconds=1.0)
    assert not [message for message in system.world.messages[before:] if message.header.recipient == HERE]
    there = system.world.components[THERE]
    secret = ask(there, Discover(withheld=True), Discovered, now=system.world.now, sender=HERE)
    assert (secret.offers, secret.neighbours) == ((), ())
    assert ask(there, Discover(provider="Robot2"), Discovered, now=system.world.now, sender=HERE).offers == ()


def test_a_device_that_leaves_a_room_leaves_the_neighbours_list() -> None:
    """By its position over a floor of the room, and by the fact that it is at a place that is part of a room."""
    system = Neighbours(gives=Selection(areas=("Room1",)), repository=True)

    def update(*changes: Any) -> None:
        system.send(UpdateMap(changes=changes), REPOSITORY)

    system.send(publish("Robot1"))
    assert system.services() == []
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": 2.0, "Shape.Depth": 2.0, "Shape.Height": 0.1}
    floor = MapObject(name="Floor7", type="Floor", values={"PositionX": 5.0, "PositionY": 5.0, "PositionZ": -0.1, **shape})
    update(ObjectAdded(floor), FactAdded(Fact("isPartOf", ("Floor7", "Room1"))))
    assert system.services() == []
    update(ValueSet("Robot1", "PositionX", 5.8), ValueSet("Robot1", "PositionY", 5.0))
    assert system.services() == [("Robot1.TransferObject", "There")]
    update(ValueSet("Robot1", "PositionZ", 4.0))
    assert system.services() == [], "it is a storey higher"
    place = MapObject(name="Place1", type="Place", values={"PositionX": 1.0, "PositionY": 1.0})
    update(ObjectAdded(place), FactAdded(Fact("isPartOf", ("Place1", "Room1"))))
    update(FactAdded(Fact("isAt", ("Robot1", "Place1"))))
    assert system.services() == [("Robot1.TransferObject", "There")]
    update(FactRemoved(Fact("isAt", ("Robot1", "Place1"))))
    assert system.services() == []


def test_a_device_is_on_the_storey_at_its_height() -> None:
    ontology, map = contents().ontology, contents().map
    storeys = [MapObject(name=name, type="Storey", values={"Elevation": height}) for name, height in (("Low", 0.0), ("High", 4.0))]
    for height, storey in ((0.0, "Low"), (3.4, "Low"), (3.6, "High"), (9.0, "High")):
        changed = map.changed([*(ObjectAdded(object) for object in storeys), ValueSet("Robot1", "PositionZ", height)])
        areas = [area for area in ("Low", "High") if Selector(Selection(areas=(area,)), ontology, changed).selects(offer("Robot1"))]
        assert areas == [storey]
    assert not Selector(Selection(areas=("Low",)), ontology, None).selects(offer("Robot1"))


def test_who_is_no_neighbour_is_told_what_its_owner_has_to_ask_for() -> None:
    there = Registry(THERE, contents().ontology)
    text = ask(there, SubscribeServices(lease=60.0, neighbour=True), Fault, sender=HERE).text
    assert "http://here/registry is no neighbour of the Registry at http://there/registry" in text
    assert ask(there, SubscribeServices(lease=60.0), ServicesSubscribed, sender=HERE), "any client may follow it"
    system = Neighbours(gives=None)
    [view] = system.discover().neighbours
    assert (view.name, view.services, view.away_since is not None) == ("There", 0, True)
    assert "gives nothing to Here" in view.problem


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ([neighbour("A", HERE)], "the neighbour A has the address of this Registry"),
        ([neighbour("A", THERE), neighbour("B", THERE)], "the neighbours A and B are both http://there/registry"),
        ([neighbour("A", THERE), neighbour("A", THIRD)], "the neighbours A and A are both A"),
    ],
)
def test_neighbours_that_cannot_be_told_apart_are_refused(wrong: list[Neighbour], text: str) -> None:
    with pytest.raises(UsageError, match=text):
        Registry(HERE, neighbours=wrong)


# Names and types


def test_of_two_devices_with_one_name_that_of_this_registry_is_listed() -> None:
    system, owner = Neighbours(), Owner()
    owner.replica.registry = HERE
    system.world.add(OWNER, owner)
    system.send(publish("Robot1", TRANSFER, POLISH, at="there"))
    assert system.services() == [("Robot1.Polish", "There"), ("Robot1.TransferObject", "There")]
    system.send(publish("Robot1", at="here"), HERE)
    assert system.services() == [("Robot1.TransferObject", "")]
    assert owner.replica.offers == Offers(system.discover().offers)
    withheld = system.discover(withheld=True).withheld
    assert {(entry.service, entry.registry) for entry in withheld} == {("Robot1.Polish", "There"), ("Robot1.TransferObject", "There")}
    assert withheld[0].reason == "Robot1 of There has the name of another here: give one of the two another name"
    system.send(Retract(provider="Robot1"), HERE)
    assert system.services() == [("Robot1.Polish", "There"), ("Robot1.TransferObject", "There")]
    assert owner.replica.offers == Offers(system.discover().offers)


def test_of_two_neighbours_the_first_one_counts_and_withheld_services_of_one_name_are_on_one_page() -> None:
    world = World()
    here = Registry(HERE, contents().ontology, neighbours=[neighbour("Third", THIRD), neighbour("There", THERE)])
    world.add(HERE, here)
    for address in (THERE, THIRD):
        world.add(address, Registry(address, contents().ontology, neighbours=[neighbour("Here", HERE)]))
        world.run(1.0)
        for number in range(300):
            world.send(request(publish(f"Robot{number:03}", at=address[7:]), recipient=address))
    world.run(2.0)
    assert {listed.registry for listed in ask(here, Discover(), Discovered, now=world.now).offers} == {"Third"}
    world.send(request(publish("Robot000", at="here"), recipient=HERE))
    world.run(1.0)
    reasons: list[tuple[str, str]] = []
    after, more = "", True
    while more:
        page = ask(here, Discover(withheld=True, after=after), Discovered, now=world.now)
        reasons += [(entry.service, entry.registry) for entry in page.withheld]
        after, more = page.offers[-1].service, page.more
    assert len(reasons) == len(set(reasons)) == 301


def test_a_device_that_publishes_at_another_registry_of_its_site_is_listed_once() -> None:
    system, owner = Neighbours(), Owner()
    owner.replica.registry = HERE
    system.world.add(OWNER, owner)
    system.send(publish("Robot1"))
    system.world.remove(THERE)
    system.send(publish("Robot1"), HERE)
    assert system.services() == [("Robot1.TransferObject", "")]
    assert [entry.reason for entry in system.discover(withheld=True).withheld] == ["Robot1 is listed as it is published here"]
    assert owner.replica.offers == Offers(system.discover().offers)
    assert system.log()[0] == ("Robot1", "There", "joined"), "it did not leave"


def test_a_type_that_is_defined_otherwise_here_is_withheld_with_the_reason() -> None:
    system = Neighbours()
    otherwise = structs.replace(TRANSFER, effect="?Object isIn ?Destination")
    system.send(publish("Robot2", otherwise, POLISH))
    [listed] = system.discover(THERE).offers
    assert listed.service == "Robot2.Polish", "it is withheld there, too, and so not given"
    world = system.world
    world.add(THIRD, Registry(THIRD, contents().ontology.extended([otherwise]), neighbours=[neighbour("Here", HERE)]))
    world.components[HERE].handle(Notified(Configured((neighbour("Third", THIRD),))), world.now)
    assert system.services() == [], "who is no neighbour any more is not asked"
    world.add(HERE, world.components[HERE])
    system.send(publish("Robot3", otherwise), THIRD)
    assert system.services() == []
    [entry] = system.discover(withheld=True).withheld
    assert (entry.service, entry.registry) == ("Robot3.TransferObject", "Third")
    assert "the Repository defines it otherwise" in entry.reason


def test_a_type_that_nobody_has_here_is_listed_if_it_fits_the_ontology() -> None:
    system = Neighbours()
    system.send(publish("Robot2", structs.replace(POLISH, parent="Refine"), WELD))
    assert system.services() == [("Robot2.Polish", "There")]
    [entry] = system.discover(withheld=True).withheld
    assert entry.service == "Robot2.Weld"
    assert "Weld does not fit the definitions of the Repository" in entry.reason
    assert "isWeldedTo" in entry.reason


def test_a_type_that_is_defined_here_later_is_judged_again() -> None:
    system = Neighbours(repository=True)
    system.send(publish("Robot2", POLISH))
    assert system.services() == [("Robot2.Polish", "There")]
    other = structs.replace(POLISH, effect="?Provider.Working = FALSE")
    system.send(Define(definitions=Definitions(services=(other,))), REPOSITORY)
    assert system.services() == []


# Away and back


def test_a_neighbour_that_does_not_answer_is_left_out_and_back_when_it_answers() -> None:
    system, owner = Neighbours(), Owner()
    owner.replica.registry = HERE
    system.world.add(OWNER, owner)
    system.send(publish("Robot2"))
    assert system.discover().neighbours == (NeighbourView(name="There", address=THERE, services=1),)
    system.world.kill(THERE)
    system.world.run(LEASE - 25.0)
    assert system.services() == [("Robot2.TransferObject", "There")], "slow is not gone"
    system.world.run(40.0)
    assert system.services() == []
    assert owner.replica.offers == Offers()
    [view] = system.discover().neighbours
    assert view.services == 0
    assert view.away_since is not None
    assert system.world.now - 100.0 < view.away_since < system.world.now - LEASE
    assert system.log()[0] == ("Robot2", "There", "away")
    system.world.revive(THERE)
    system.world.run(10.0)
    assert system.services() == [("Robot2.TransferObject", "There")]
    assert system.discover().neighbours == (NeighbourView(name="There", address=THERE, services=1),)
    assert owner.replica.offers == Offers(system.discover().offers)


def test_a_neighbour_that_has_lost_everything_is_read_again() -> None:
    system = Neighbours()
    system.send(publish("Robot2"))
    system.world.remove(THERE)
    system.world.add(THERE, Registry(THERE, contents().ontology, neighbours=[neighbour("Here", HERE)]))
    system.send(publish("Robot3"))
    system.world.run(LEASE / 3 + 2 * GAP_TIME)
    assert system.services() == [("Robot3.TransferObject", "There")]


def test_it_goes_on_after_a_crash_and_leaves_out_who_was_silent_meanwhile() -> None:
    system = Neighbours()
    system.send(publish("Robot2"))
    system.world.kill(HERE)
    system.world.run(5.0)
    system.world.revive(HERE)
    assert system.services() == [("Robot2.TransferObject", "There")]
    system.world.kill(HERE)
    system.world.kill(THERE)
    system.world.run(2 * LEASE)
    system.world.revive(HERE)
    system.world.run(1.0)
    assert system.services() == []
    assert system.discover().neighbours[0].away_since is not None


def test_new_settings_take_effect_at_the_next_start_for_both() -> None:
    system = Neighbours()
    system.send(publish("Robot2", TRANSFER, POLISH))
    there = system.world.components[THERE]
    assert isinstance(there, Registry)
    state = Codec[RegistryState](RegistryState).decode(encode(there.state))
    system.world.remove(THERE)
    registry = Registry.restored(state)
    effects = registry.handle(Notified(Configured((neighbour("Here", HERE, gives=Selection(types=("Polish",))),))), system.world.now)
    assert effects
    system.world.add(THERE, registry)
    system.world.run(3.0)
    assert system.services() == [("Robot2.Polish", "There")]
    here = system.world.components[HERE]
    here.handle(Notified(Configured(())), system.world.now)
    assert system.services() == []
    assert system.discover().neighbours == ()
    assert system.log()[0] == ("Robot2", "There", "retracted")


@pytest.mark.parametrize("is_there_first", [True, False])
def test_a_neighbour_that_gives_more_than_can_be_kept_is_listed_in_part(monkeypatch: pytest.MonkeyPatch, *, is_there_first: bool) -> None:
    monkeypatch.setattr(neighbours, "MOST_OFFERS", 5)
    system = Neighbours()
    if is_there_first:  # it is read, and not told
        system.world.kill(HERE)
    for number in range(8):
        system.send(publish(f"Robot{number}"))
    if is_there_first:
        system.world.revive(HERE)
        system.world.run(5.0)
    assert len(system.services()) == 5
    assert system.discover().neighbours[0].problem == "only 5 of its offers are kept"
    for number in range(8):
        system.send(Retract(provider=f"Robot{number}"))
    assert system.services() == []
    assert system.discover().neighbours[0].problem == ""


# Several Registries of one site


class Device:
    """A component that joins as devices do, and nothing else."""

    def __init__(self) -> None:
        profile = Profile(
            name="Robot1",
            type="PioneerP3DX",
            capabilities=(Capability(type="TransferObject", method="transfer"),),
        )
        self.joining = Joining(profile=profile, repository=REPOSITORY, registry=HERE)

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case Started(address):
                return [*self.joining.start(address, now)]
            case Received(message):
                return [*self.joining.receive(message, now)]
            case TimerFired():
                return [*self.joining.timer_fired(now)]
            case Notified():
                return [*self.joining.depart(now)]
        return []


def test_when_the_registry_of_a_site_is_lost_devices_publish_at_another_and_followers_follow_it() -> None:
    world, owner, device = World(), Owner(), Device()
    owner.replica.registry = HERE
    world.add(REPOSITORY, Repository(REPOSITORY, contents()))
    for address, name, other in ((HERE, "There", THERE), (THERE, "Here", HERE)):
        of_site = structs.replace(neighbour(name, other), is_of_site=True)
        world.add(address, Registry(address, contents().ontology, REPOSITORY, [of_site]))
    world.run(5.0)
    world.add(OWNER, owner)
    world.add("http://here/devices/Robot1", device)
    world.run(5.0)
    assert [(listed.service, listed.registry) for listed in owner.replica.offers] == [("Robot1.TransferObject", "")]
    world.remove(HERE)
    for _ in range(300):
        world.run(1.0)
        assert owner.replica.offers.get("Robot1.TransferObject") is not None, "it is on offer all the time"
    assert device.joining.registry == owner.replica.registry == THERE
    assert owner.replica.is_current
    there = world.components[THERE]
    retractions = [effect for effect in device.handle(Notified(None), world.now) if isinstance(effect, Send)]
    assert {effect.message.header.recipient for effect in retractions} == {HERE, THERE}
    for effect in retractions:
        there.handle(Received(effect.message), world.now)
    assert ask(there, Discover(), Discovered, now=world.now).offers == ()


# Any medium, any order

TYPES = (TRANSFER, CAREFUL, POLISH)
CHANGES: list[tuple[str, Body]] = [
    *((HERE, publish("Robot1", *types, at="here")) for types in (TYPES[:1], TYPES)),
    *((THERE, publish("Robot1", *types, at="there")) for types in (TYPES[:1], TYPES[1:])),
    (THERE, publish("Robot2", TRANSFER, POLISH, lease=20.0)),
    (THERE, publish("Robot2", POLISH, lease=3600.0)),
    (THIRD, publish("Robot2", TRANSFER, WELD, at="third")),
    (THIRD, publish("Robot3", TRANSFER)),
    (THERE, Renew(provider="Robot2", lease=25.0)),
    *((address, Retract(provider=name)) for address in (HERE, THERE, THIRD) for name in ("Robot1", "Robot2")),
]
STEPS = st.one_of(
    st.tuples(st.sampled_from(["deliver", "deliver", "twice", "lose"]), st.integers(0, 9)),
    st.tuples(st.just("change"), st.integers(0, len(CHANGES) - 1)),
    st.tuples(st.just("change"), st.integers(0, len(CHANGES) - 1)),
    st.tuples(st.just("ring"), st.just(0)),
    st.tuples(st.sampled_from(["restart", "renew", "kill"]), st.integers(0, 2)),
)
SETTINGS = {
    HERE: [neighbour("There", THERE), neighbour("Third", THIRD, takes=Selection(types=("TransferObject",)))],
    THERE: [neighbour("Here", HERE, gives=Selection(types=("TransferObject",))), neighbour("Third", THIRD, takes=None)],
    THIRD: [neighbour("There", THERE, gives=None), neighbour("Here", HERE)],
}
ADDRESSES = [*SETTINGS]


def new_registry(address: str) -> Registry:
    return Registry(address, contents().ontology, neighbours=SETTINGS[address])


def expected(registries: dict[str, Registry], address: str) -> set[tuple[str, str]]:
    """What a Registry should list, by a plain reading of the rules."""
    listed: dict[str, tuple[str, str]] = {}
    devices: set[str] = set()
    for name, source in (("", address), *((entry.name, entry.address) for entry in SETTINGS[address] if entry.takes is not None)):
        given = next((entry.gives for entry in SETTINGS[source] if entry.address == address), None) if name else ALL
        takes = next((entry.takes for entry in SETTINGS[address] if entry.name == name), ALL)
        own = {device: provider.offers for device, provider in registries[source].state.providers.items()}
        passing = {
            device: [
                service
                for service, published in offers.items()
                if all(
                    selection is not None
                    and (not selection.types or {published.service_type.name, published.service_type.parent} & {*selection.types})
                    for selection in (given, takes)
                )
            ]
            for device, offers in own.items()
        }
        for device, services in passing.items():
            if device not in devices:
                listed |= {service: (service, name) for service in services if not (name and service.endswith("Weld"))}
        devices |= {device for device, services in passing.items() if services}
    return {*listed.values()}


@examples(60)
@given(st.lists(STEPS, max_size=60))
def test_on_any_medium_every_registry_comes_to_list_what_it_should(steps: list[tuple[str, int]]) -> None:
    medium = UnfairMedium({address: new_registry(address) for address in ADDRESSES})
    for address in ADDRESSES:
        medium.feed(address, Started(address))
    killed: dict[str, bytes] = {}

    def revive(address: str) -> None:
        medium.replace(address, Registry.restored(Codec[RegistryState](RegistryState).decode(killed.pop(address))))

    for action, index in steps:
        address = ADDRESSES[index % len(ADDRESSES)]
        match action:
            case "change":
                recipient, body = CHANGES[index]
                if recipient not in killed:
                    medium.bag.append(request(body, recipient=recipient))
            case "ring":
                medium.ring()
            case "kill" if address not in killed:
                registry = medium.components.pop(address)
                assert isinstance(registry, Registry)
                killed[address] = encode(registry.state)
                medium.bag = [message for message in medium.bag if message.header.recipient != address]
                medium.timers = {key: time for key, time in medium.timers.items() if key[0] != address}
            case "restart" if address in killed:
                revive(address)
            case "renew" if address not in killed:
                medium.replace(address, new_registry(address))
            case _:
                medium.carry(action, index)
    for address in [*killed]:
        revive(address)
    medium.settle()
    registries = {address: registry for address, registry in medium.components.items() if isinstance(registry, Registry)}
    for address, registry in registries.items():
        discovered = ask(registry, Discover(), Discovered, now=medium.now)
        assert {(listed.service, listed.registry) for listed in discovered.offers} == expected(registries, address), address
        assert all(view.away_since is None for view in discovered.neighbours)
