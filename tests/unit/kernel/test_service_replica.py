"""The copy of the services on offer: after whatever happened to messages and programs, it comes to be what the Registry lists."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from somrs.kernel.codec import Codec, encode
from somrs.kernel.component import DeliveryFailed, Effect, Input, Received, Send, Started, TimerFired
from somrs.kernel.following import GAP_TIME, LEASE
from somrs.kernel.offers import Offers
from somrs.kernel.service_replica import ServiceReplica, ServicesDue, ServiceUpdate
from somrs.ontology.services import ServiceType
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import (
    REPUBLISHING_TIME,
    Discover,
    Discovered,
    Offer,
    Publish,
    Renew,
    Retract,
    ServicesJoined,
    ServicesLeft,
)
from somrs.protocol.messages.knowledge import Define, Definitions
from somrs.registry.component import SCHEMA, Registry
from somrs.registry.state import RegistryState
from somrs.repository.component import Repository
from somrs.runtime.virtual_time import World
from tests.support.examples import examples
from tests.support.lab import REPOSITORY, ask, contents, deliver_request, request
from tests.support.unfair_medium import UnfairMedium

OWNER, REGISTRY = "http://here/owner", "http://here/registry"
TRANSFER = contents().ontology.services["TransferObject"]
POLISH = ServiceType(name="Polish", effect="?Provider.Working = TRUE")


class Owner:
    """A component that has a copy of the services on offer and nothing else."""

    def __init__(self) -> None:
        self.replica = ServiceReplica(OWNER, REGISTRY)
        self.updates: list[ServiceUpdate] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Started):
            return self.replica.start(now)
        update = self.replica.handle(event, now)
        if update is None:
            return []
        self.updates.append(update)
        return update.effects


def offer(provider: str, service_type: ServiceType = TRANSFER, price: float = 1.0) -> Offer:
    return Offer(
        service=f"{provider}.{service_type.name}",
        provider=provider,
        provider_type="PioneerP3DX",
        address=f"http://{provider}/",
        service_type=service_type,
        attributes={"Price": price},
    )


def publish(provider: str, *offers: Offer, lease: float = 3600.0, version: int = 0) -> Publish:
    return Publish(provider=provider, offers=offers or (offer(provider),), lease=lease, ontology_version=version)


def listed(registry: Registry, now: float) -> Offers:
    """What the Registry answers when it is asked, page by page."""
    offers: list[Offer] = []
    while True:
        page = ask(registry, Discover(after=offers[-1].service if offers else ""), Discovered, now=now)
        offers += page.offers
        if not page.more:
            return Offers(offers)


def system(registry: Registry) -> tuple[World, Owner]:
    world, owner = World(), Owner()
    world.add(REGISTRY, registry)
    world.add(OWNER, owner)
    assert world.run(10.0, lambda: owner.replica.is_current)
    return world, owner


def send(world: World, body: Body) -> None:
    world.send(request(body, recipient=REGISTRY))
    world.run(0.5)


def test_it_reads_all_pages_and_follows() -> None:
    registry = Registry(REGISTRY, contents().ontology)
    for number in range(300):
        deliver_request(registry, publish(f"Robot{number:03}", lease=600.0), World().now)
    world, owner = system(registry)
    assert owner.replica.offers == listed(registry, world.now)
    assert len(owner.replica.offers) == 300
    assert len(owner.updates[-1].joined) == 300
    send(world, publish("Robot000", offer("Robot000"), offer("Robot000", POLISH)))
    assert owner.updates[-1].joined == ("Robot000.Polish",)
    send(world, publish("Robot000", offer("Robot000", price=2.0), offer("Robot000", POLISH)))
    assert owner.updates[-1].joined == ("Robot000.TransferObject",), "it is offered otherwise"
    send(world, Retract(provider="Robot001"))
    assert owner.replica.offers.get("Robot001.TransferObject") is None
    assert owner.replica.offers == listed(registry, world.now)
    assert owner.replica.version == registry.state.version
    world.run(700.0)
    assert [listed_offer.service for listed_offer in owner.replica.offers] == ["Robot000.Polish", "Robot000.TransferObject"]


def test_news_that_was_lost_is_noticed_and_everything_read_again() -> None:
    registry = Registry(REGISTRY, contents().ontology)
    world, owner = system(registry)
    deliver_request(registry, publish("Robot1"), world.now)  # its ServicesJoined goes nowhere
    send(world, publish("Robot2"))
    assert not owner.replica.is_current
    assert owner.replica.offers == Offers()
    world.run(GAP_TIME)
    assert owner.replica.offers == listed(registry, world.now) == Offers([offer("Robot1"), offer("Robot2")])
    deliver_request(registry, Retract(provider="Robot1"), world.now)  # and this is the last for now
    world.run(LEASE / 3 + 2 * GAP_TIME)
    assert owner.replica.offers == Offers([offer("Robot2")])


def test_a_registry_that_is_back_from_a_crash_says_so() -> None:
    world, owner = World(), Owner()
    world.add(REGISTRY, Registry(REGISTRY, contents().ontology), journaled=SCHEMA)
    world.add(OWNER, owner)
    world.run(1.0)
    registry = world.components[REGISTRY]
    assert isinstance(registry, Registry)
    world.remove(REGISTRY)
    deliver_request(registry, publish("Robot1"), world.now)
    world.add(REGISTRY, Registry.restored(registry.state))
    world.run(2 * GAP_TIME)
    assert owner.replica.offers == Offers([offer("Robot1")])


def test_the_registry_may_lose_its_state() -> None:
    registry = Registry(REGISTRY, contents().ontology)
    world, owner = system(registry)
    send(world, publish("Robot1"))
    send(world, publish("Robot2"))
    world.remove(REGISTRY)
    new_registry = Registry(REGISTRY, contents().ontology)
    world.add(REGISTRY, new_registry)
    send(world, publish("Robot2", offer("Robot2", price=9.0)))
    assert owner.replica.offers == Offers([offer("Robot1"), offer("Robot2")]), "it has not heard of it yet"
    world.run(LEASE / 3 + 2 * GAP_TIME)
    assert owner.replica.offers == listed(new_registry, world.now) == Offers([offer("Robot2", price=9.0)])


def test_a_registry_that_was_restored_from_a_backup_replaces_the_copy() -> None:
    registry = Registry(REGISTRY, contents().ontology)
    world, owner = system(registry)
    send(world, publish("Robot1"))
    backup = encode(registry.state)
    for number in range(2, 5):
        send(world, publish(f"Robot{number}"))
    world.remove(REGISTRY)
    restored = Registry.restored(Codec[RegistryState](RegistryState).decode(backup))
    world.add(REGISTRY, restored)
    world.run(LEASE / 3 + 2 * GAP_TIME)
    assert owner.replica.offers == listed(restored, world.now) == Offers([offer("Robot1")])


def test_providers_are_expected_again_while_their_types_are_defined_anew() -> None:
    world, owner, repository = World(), Owner(), Repository(REPOSITORY, contents())
    registry = Registry(REGISTRY, repository=REPOSITORY)
    for address, component in ((REPOSITORY, repository), (REGISTRY, registry), (OWNER, owner)):
        world.add(address, component)
    world.run(1.0)
    for name in ("Robot1", "Robot2"):
        send(world, publish(name))
    redefined = structs.replace(TRANSFER, precondition="?Object isOn ?Source", effect="?Object isIn ?Destination")
    world.send(request(Define(definitions=Definitions(services=(redefined,)))))
    world.run(0.5)
    changed_at = world.now
    assert owner.replica.offers == Offers()
    assert owner.replica.settles_at(world.now) is not None
    late_owner = Owner()
    world.components.pop(OWNER)
    world.add(OWNER, late_owner)
    world.run(0.5)
    assert late_owner.replica.settles_at(world.now) is not None, "the pages say so, too"
    for name in ("Robot1", "Robot2"):
        send(world, publish(name, offer(name, redefined)))
    assert owner.replica.settles_at(changed_at + REPUBLISHING_TIME) is None
    assert late_owner.replica.settles_at(world.now + REPUBLISHING_TIME) is None
    assert late_owner.replica.offers == Offers([offer("Robot1", redefined), offer("Robot2", redefined)])


def test_whoever_publishes_again_is_not_expected_any_more() -> None:
    replica = ServiceReplica(OWNER, REGISTRY, version=4)
    outdated = ServicesLeft(services=("Robot1.TransferObject",), provider="Robot1", reason="outdated", version=5)
    for now, body in ((1.0, outdated), (2.0, ServicesJoined(offers=(offer("Robot2"),), version=6))):
        replica.handle(Received(request(body, sender=REGISTRY)), now)
        assert replica.settles_at(now) == 1.0 + REPUBLISHING_TIME
    replica.handle(Received(request(ServicesJoined(offers=(offer("Robot1"),), version=7), sender=REGISTRY)), 3.0)
    assert replica.settles_at(3.0) is None
    gone = ServicesLeft(services=("Robot2.TransferObject",), provider="Robot2", reason="retracted", version=8)
    replica.handle(Received(request(gone, sender=REGISTRY)), 3.5)
    assert replica.settles_at(3.5) is None


@pytest.mark.parametrize(
    "event",
    [
        TimerFired("other"),
        Received(request(Discovered(offers=()), sender="http://there/other")),
        Received(request(Renew(provider="Robot1", lease=1.0), sender=REGISTRY)),
        DeliveryFailed(request(Discover()), "x"),
    ],
)
def test_what_is_no_business_of_the_copy_is_left_to_its_owner(event: Input) -> None:
    assert ServiceReplica(OWNER, REGISTRY).handle(event, 0.0) is None


# Any medium, any order

WASH, OTHER_WASH = (ServiceType(name="Wash", effect=f"?Provider.Working = {value}") for value in ("TRUE", "FALSE"))
CAREFUL = structs.replace(TRANSFER, precondition=f"{TRANSFER.precondition} AND ?Provider.Working = TRUE")
CHANGES: list[tuple[str, Body]] = [
    *((REGISTRY, publish("Robot1", *offers)) for offers in ((), (offer("Robot1", price=2.0), offer("Robot1", POLISH)))),
    (REGISTRY, publish("Robot2", lease=20.0)),
    (REGISTRY, publish("Robot2", offer("Robot2", CAREFUL), offer("Robot2", WASH), lease=30.0)),
    (REGISTRY, publish("Robot3", offer("Robot3", OTHER_WASH))),
    *((REGISTRY, publish("Robot4", offer("Robot4", CAREFUL), offer("Robot4", WASH), version=version)) for version in (1, 2, 3, 9)),
    (REGISTRY, Retract(provider="Robot1")),
    (REGISTRY, Retract(provider="Robot2", services=("Robot2.Wash",))),
    (REGISTRY, Renew(provider="Robot2", lease=25.0)),
    *((REPOSITORY, Define(definitions=Definitions(services=(service_type,)))) for service_type in (TRANSFER, CAREFUL, WASH, OTHER_WASH)),
]

STEPS = st.one_of(
    st.tuples(st.just("deliver"), st.integers(0, 9)),
    st.tuples(st.just("deliver"), st.just(0)),
    st.tuples(st.just("twice"), st.integers(0, 9)),
    st.tuples(st.just("lose"), st.integers(0, 9)),
    st.tuples(st.just("change"), st.integers(0, len(CHANGES) - 1)),
    st.tuples(st.just("change"), st.integers(0, len(CHANGES) - 1)),
    st.tuples(st.just("ring"), st.just(0)),
    st.tuples(st.sampled_from(["restart registry", "new registry", "restart owner"]), st.just(0)),
)


@examples(60)
@given(st.lists(STEPS, max_size=60))
def test_on_any_medium_it_comes_to_be_what_the_registry_lists(steps: list[tuple[str, int]]) -> None:
    registry, owner = Registry(REGISTRY, repository=REPOSITORY), Owner()
    medium = UnfairMedium({REPOSITORY: Repository(REPOSITORY, contents()), REGISTRY: registry, OWNER: owner})
    for address in (REPOSITORY, REGISTRY, OWNER):
        medium.feed(address, Started(address))
    for action, index in steps:
        if action == "change":
            address, body = CHANGES[index]
            medium.feed(address, Received(request(body, recipient=address)))
        elif action == "ring":
            medium.ring()
        elif action == "restart registry":
            registry = Registry.restored(Codec[RegistryState](RegistryState).decode(encode(registry.state)))
            medium.replace(REGISTRY, registry)
        elif action == "new registry":
            medium.now += 1.0
            registry = Registry(REGISTRY, repository=REPOSITORY)
            medium.replace(REGISTRY, registry)
        elif action == "restart owner":
            owner.replica = Codec[ServiceReplica](ServiceReplica).decode(encode(owner.replica))
            medium.feed(OWNER, Started(OWNER))
        else:
            medium.carry(action, index)
        assert owner.replica.offers._by_service.keys() == {listed_offer.service for listed_offer in owner.replica.offers}
    medium.settle()
    assert owner.replica.offers == listed(registry, medium.now)
    assert owner.replica.is_current


def test_the_time_of_a_reply_sets_the_timer() -> None:
    replica = ServiceReplica(OWNER, REGISTRY)
    first, *_ = replica.start(1.0)
    assert isinstance(first, Send)
    again = replica.handle(TimerFired(ServicesDue()), 1.0 + LEASE)
    assert again is not None
    (repeated, *_) = again.effects
    assert isinstance(repeated, Send)
    assert repeated.message.body == first.message.body
