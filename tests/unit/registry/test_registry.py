"""The Service Registry: who offers what, until when, and who is told."""

from __future__ import annotations

import msgspec
import pytest

from somrs.kernel.codec import encode
from somrs.kernel.component import DeliveryFailed, Effect, Received, Send, SetTimer, TimerFired
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import ObjectType, RelationType, Value
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import (
    Discover,
    Discovered,
    Offer,
    PresenceChange,
    PresenceLog,
    Publish,
    Published,
    ReadPresence,
    Renew,
    Retract,
    Retracted,
    ServicesJoined,
    ServicesLeft,
    ServicesSubscribed,
    SubscribeServices,
)
from somrs.protocol.messages.envelope import ANONYMOUS
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Define, Definitions, QueryMap
from somrs.protocol.messages.paging import PAGE_BYTES, size
from somrs.registry.announcements import LOG_LENGTH
from somrs.registry.component import SCHEMA, Registry, only_reads
from somrs.registry.state import LeasesDue
from somrs.repository.component import Repository
from somrs.runtime.virtual_time import World
from tests.support.lab import REPOSITORY, ask, contents, deliver_request, lab, request, sent_bodies
from tests.support.laboratory import OPEN

REGISTRY = "http://here/registry"
FOLLOWER = "http://here/follower"

TRANSFER = lab()[0].services["TransferObject"]

CAREFUL = ServiceType(name="CarefulTransfer", parent="TransferObject", inputs=TRANSFER.inputs, effect=TRANSFER.effect)


def offer(provider: str, service_type: ServiceType = TRANSFER, **attributes: Value) -> Offer:
    return Offer(
        service=f"{provider}.{service_type.name}",
        provider=provider,
        provider_type="PioneerP3DX",
        address=f"http://{provider}/",
        service_type=service_type,
        attributes=attributes,
    )


def publish(provider: str, *offers: Offer, lease: float = 30.0) -> Publish:
    return Publish(provider=provider, offers=offers or (offer(provider),), lease=lease)


def names(discovered: Discovered) -> list[str]:
    return [listed_offer.service for listed_offer in discovered.offers]


@pytest.fixture
def registry() -> Registry:
    return Registry(REGISTRY, lab()[0])


@pytest.fixture
def followed(registry: Registry) -> Registry:
    assert ask(registry, SubscribeServices(lease=3600), ServicesSubscribed, sender=FOLLOWER).until == 3600.0
    return registry


def news(effects: list[Effect]) -> list[ServicesJoined | ServicesLeft]:
    return [*sent_bodies(effects, ServicesJoined), *sent_bodies(effects, ServicesLeft)]


# Leases


def test_a_service_is_there_until_its_lease_ends(registry: Registry) -> None:
    assert ask(registry, publish("Robot1"), Published, now=100.0) == Published(until=130.0, renew_within=10.0)
    assert names(ask(registry, Discover(), Discovered, now=129.9)) == ["Robot1.TransferObject"]
    assert ask(registry, Discover(), Discovered, now=130.0).offers == ()


def test_a_lease_is_renewed(registry: Registry) -> None:
    ask(registry, publish("Robot1"), Published, now=100.0)
    assert ask(registry, Renew(provider="Robot1", lease=60.0), Published, now=120.0).until == 180.0
    assert names(ask(registry, Discover(), Discovered, now=179.0)) == ["Robot1.TransferObject"]


def test_who_is_not_known_is_told_to_publish_anew(registry: Registry) -> None:
    assert "publish its services anew" in ask(registry, Renew(provider="Robot1", lease=60.0), Fault).text
    ask(registry, publish("Robot1", lease=5.0), Published, now=0.0)
    assert "publish" in ask(registry, Renew(provider="Robot1", lease=60.0), Fault, now=5.0).text


def test_leases_are_kept_within_limits(registry: Registry) -> None:
    assert ask(registry, publish("Robot1", lease=0.001), Published, now=100.0).until == 101.0
    assert ask(registry, publish("Robot1", lease=1e7), Published, now=100.0).until == 3700.0
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        assert "lease" in ask(registry, publish("Robot1", lease=wrong), Fault).text


def test_the_timer_is_set_for_the_next_lease_that_ends(registry: Registry) -> None:
    assert deliver_request(registry, publish("Robot1", lease=30.0), now=0.0)[-1] == SetTimer(LeasesDue(), 30.0)
    assert deliver_request(registry, publish("Robot2", lease=10.0), now=0.0)[-1] == SetTimer(LeasesDue(), 10.0)
    assert registry.handle(TimerFired(LeasesDue()), 10.0)[-1] == SetTimer(LeasesDue(), 30.0)
    assert registry.handle(TimerFired(LeasesDue()), 30.0)[-1] == SetTimer(LeasesDue(), None)


# Arrivals and departures


def log(registry: Registry, now: float) -> list[tuple[float, str, bool, str]]:
    changes = ask(registry, ReadPresence(), PresenceLog, now=now).changes
    return [(change.at, change.device, change.joined, change.reason) for change in changes]


def test_arrivals_and_departures_are_remembered_once_each_newest_first(registry: Registry) -> None:
    assert log(registry, 0.0) == []
    ask(registry, publish("Robot1", offer("Robot1"), offer("Robot1", OPEN)), Published, now=1.0)
    ask(registry, publish("Robot1", offer("Robot1", Price=2.0), offer("Robot1", OPEN)), Published, now=2.0)
    ask(registry, Renew(provider="Robot1", lease=30.0), Published, now=3.0)
    assert log(registry, 3.0) == [(1.0, "Robot1", True, "")], "another price is no arrival"
    ask(registry, publish("Robot1", offer("Robot1")), Published, now=4.0)
    assert ask(registry, ReadPresence(), PresenceLog, now=4.0).changes[0] == PresenceChange(
        at=4.0, device="Robot1", services=("Robot1.OpenDoor",), joined=False, reason="retracted"
    )
    ask(registry, Retract(provider="Robot1"), Retracted, now=5.0)
    ask(registry, Retract(provider="Robot1"), Retracted, now=6.0)
    assert log(registry, 6.0) == [
        (5.0, "Robot1", False, "retracted"),
        (4.0, "Robot1", False, "retracted"),
        (1.0, "Robot1", True, ""),
    ]


def test_a_device_whose_lease_ended_left_when_it_ended_even_if_the_registry_did_not_run_then(registry: Registry) -> None:
    ask(registry, publish("Robot1", lease=30.0), Published, now=0.0)
    ask(registry, publish("Robot2", lease=10.0), Published, now=0.0)
    registry.handle(TimerFired(LeasesDue()), 1000.0)
    assert log(registry, 1000.0)[:2] == [(30.0, "Robot1", False, "expired"), (10.0, "Robot2", False, "expired")]


def test_the_log_is_bounded_and_its_answer_fits_into_a_message(registry: Registry) -> None:
    for number in range(LOG_LENGTH):
        ask(registry, publish("Robot1"), Published, now=float(number))
        ask(registry, Retract(provider="Robot1"), Retracted, now=number + 0.5)
    assert len(registry.state.presence_log) == len(log(registry, 1000.0)) == LOG_LENGTH
    assert log(registry, 1000.0)[0][0] == LOG_LENGTH - 0.5, "the latest are kept"
    offers = [
        Offer(service=f"Robot2.{number:0200}", provider="Robot2", provider_type="R", address="a", service_type=OPEN) for number in range(50)
    ]
    for number in range(10):
        ask(registry, publish("Robot2", *offers), Published, now=2000.0 + number)
        ask(registry, Retract(provider="Robot2"), Retracted, now=2000.5 + number)
    answer = ask(registry, ReadPresence(), PresenceLog, now=2020.0)
    assert size(answer.changes) < PAGE_BYTES + 1000
    assert answer.changes[0].at == 2009.5


# Discovering


@pytest.mark.parametrize("effect", [None, "Jar1 isOn", "Jar1 isOn Table1"])
def test_who_asks_on_a_connection_leaves_the_registry_as_it_was(registry: Registry, effect: str | None) -> None:
    ask(registry, publish("Robot1", lease=5.0), Published, now=0.0)
    state_before = encode(registry.state)
    received = Received(request(Discover(effect=effect), ANONYMOUS))
    for now in (4.0, 6.0):
        assert len(registry.handle(received, now)) == 1
    assert only_reads(received)
    assert only_reads(Received(request(ReadPresence(), ANONYMOUS)))
    assert encode(registry.state) == state_before
    assert not only_reads(Received(request(Discover(effect=effect)))), "somebody who has an address waits for it"
    assert not only_reads(Received(request(publish("Robot1"), ANONYMOUS)))
    assert not only_reads(TimerFired(LeasesDue()))


@pytest.fixture
def busy(registry: Registry) -> Registry:
    ask(registry, publish("Robot1", offer("Robot1", Price=10.0), offer("Robot1", OPEN)), Published)
    ask(registry, publish("Robot2", offer("Robot2", CAREFUL, Price=25.0, Gentle=True)), Published)
    return registry


@pytest.mark.parametrize(
    ("query", "services"),
    [
        (Discover(), ["Robot1.OpenDoor", "Robot1.TransferObject", "Robot2.CarefulTransfer"]),
        (Discover(service_type="OpenDoor"), ["Robot1.OpenDoor"]),
        (Discover(service_type="TransferObject"), ["Robot1.TransferObject", "Robot2.CarefulTransfer"]),
        (Discover(service_type="CarefulTransfer"), ["Robot2.CarefulTransfer"]),
        (Discover(service_type="Cook"), []),
        (Discover(provider="Robot2"), ["Robot2.CarefulTransfer"]),
        (Discover(attributes={"Price": 10}), ["Robot1.TransferObject"]),
        (Discover(attributes={"Gentle": True}), ["Robot2.CarefulTransfer"]),
        (Discover(attributes={"Gentle": 1.0}), []),
        (Discover(attributes={"Colour": "Red"}), []),
        (Discover(effect="Jar1 isOn Table2"), ["Robot1.TransferObject", "Robot2.CarefulTransfer"]),
        (Discover(effect="?Door: Door.Open = TRUE"), ["Robot1.OpenDoor"]),
        (Discover(effect="Jar1 isIn Room1"), []),
        (Discover(effect="Jar1 isOn Table2", attributes={"Price": 25.0}), ["Robot2.CarefulTransfer"]),
    ],
)
def test_what_is_found_fits_all_that_is_asked(busy: Registry, query: Discover, services: list[str]) -> None:
    assert names(ask(busy, query, Discovered)) == services


def test_a_formula_that_is_none_is_a_fault(busy: Registry) -> None:
    assert "^" in ask(busy, Discover(effect="Jar1 isOn"), Fault).text


def test_many_services_are_found_page_by_page(registry: Registry) -> None:
    for n in range(300):
        ask(registry, publish(f"Robot{n:03}"), Published)
    pages = [ask(registry, Discover(service_type="TransferObject"), Discovered)]
    while pages[-1].more:
        pages.append(ask(registry, Discover(service_type="TransferObject", after=pages[-1].offers[-1].service), Discovered))
    assert [name for page in pages for name in names(page)] == [f"Robot{n:03}.TransferObject" for n in range(300)]
    assert all(len(msgspec.json.encode(page)) < 50_000 for page in pages)


# Telling


def test_followers_hear_who_comes_and_who_goes(followed: Registry) -> None:
    offers = (offer("Robot1"), offer("Robot1", OPEN))
    assert news(deliver_request(followed, publish("Robot1", *offers))) == [ServicesJoined(offers=offers, version=1)]
    effects = deliver_request(followed, Retract(provider="Robot1", services=("Robot1.OpenDoor", "Robot9.Cook")))
    assert sent_bodies(effects, Retracted) == [Retracted(services=("Robot1.OpenDoor",))]
    assert news(effects) == [ServicesLeft(services=("Robot1.OpenDoor",), provider="Robot1", reason="retracted", version=2)]
    assert news(followed.handle(TimerFired(LeasesDue()), 30.0)) == [
        ServicesLeft(services=("Robot1.TransferObject",), provider="Robot1", reason="expired", version=3)
    ]


def test_all_services_are_retracted_when_none_is_named(followed: Registry) -> None:
    deliver_request(followed, publish("Robot1", offer("Robot1"), offer("Robot1", OPEN)))
    assert ask(followed, Retract(provider="Robot1"), Retracted).services == ("Robot1.TransferObject", "Robot1.OpenDoor")
    assert ask(followed, Retract(provider="Robot1"), Retracted).services == ()
    assert ask(followed, Discover(), Discovered).offers == ()


def test_of_a_second_publication_only_the_difference_is_told(followed: Registry) -> None:
    deliver_request(followed, publish("Robot1", offer("Robot1", Price=10.0), offer("Robot1", OPEN)))
    assert news(deliver_request(followed, publish("Robot1", offer("Robot1", Price=10.0), offer("Robot1", OPEN)), now=5.0)) == []
    dearer = offer("Robot1", Price=12.0)
    assert news(deliver_request(followed, publish("Robot1", dearer), now=6.0)) == [
        ServicesJoined(offers=(dearer,), version=3),
        ServicesLeft(services=("Robot1.OpenDoor",), provider="Robot1", reason="retracted", version=2),
    ]


def test_a_follower_hears_nothing_after_its_lease_or_when_it_cannot_be_reached(registry: Registry) -> None:
    ask(registry, SubscribeServices(lease=10), ServicesSubscribed, now=0.0, sender=FOLLOWER)
    assert news(deliver_request(registry, publish("Robot1"), now=10.0)) == []
    ask(registry, SubscribeServices(lease=100), ServicesSubscribed, now=10.0, sender=FOLLOWER)
    messages = [e.message for e in deliver_request(registry, publish("Robot2"), now=11.0) if isinstance(e, Send)]
    registry.handle(DeliveryFailed(messages[-1], "refused"), 41.0)
    assert news(deliver_request(registry, publish("Robot3"), now=42.0)) == []


def test_who_has_no_address_cannot_follow(registry: Registry) -> None:
    assert "address" in ask(registry, SubscribeServices(lease=60), Fault, sender=ANONYMOUS).text


# Manners


def test_an_old_message_that_comes_again_undoes_nothing(followed: Registry) -> None:
    first = request(publish("Robot1"))
    followed.handle(Received(first), 0.0)
    deliver_request(followed, Retract(provider="Robot1"), now=1.0)
    repeated_effects = followed.handle(Received(first), 2.0)
    assert sent_bodies(repeated_effects, Published) == [Published(until=30.0, renew_within=10.0)]
    assert news(repeated_effects) == []
    assert ask(followed, Discover(), Discovered, now=3.0).offers == ()


@pytest.mark.parametrize(
    ("wrong", "expected_text"),
    [
        (publish("Robot2", offer("Robot1")), "Robot2 cannot offer it"),
        (publish("Robot2", msgspec.structs.replace(offer("Robot2"), service="Robot1.TransferObject")), "offered by Robot1 already"),
        (publish("Robot2", offer("Robot2"), offer("Robot2")), "two services of the same name"),
        (publish("Robot2", offer("Robot2", msgspec.structs.replace(TRANSFER, effect="?Object isOn"))), "^"),
        (publish("", offer("")), "provider"),
    ],
)
def test_offers_that_nobody_could_use_are_refused(registry: Registry, wrong: Publish, expected_text: str) -> None:
    ask(registry, publish("Robot1"), Published)
    assert expected_text in ask(registry, wrong, Fault).text
    assert names(ask(registry, Discover(), Discovered)) == ["Robot1.TransferObject"]


def test_what_is_no_business_of_a_registry_is_a_fault_and_faults_are_not_answered(registry: Registry) -> None:
    assert ask(registry, QueryMap(formula="Jar1 isOn Table1"), Fault).code == "ActionNotSupported"
    assert sent_bodies(deliver_request(registry, Fault(code="Sender", text="no")), object) == []


def test_it_learns_what_services_can_do_from_the_repository() -> None:
    """A type that was defined after the Registry came up counts when services are found by their effect."""
    world = World()
    registry = Registry(REGISTRY, repository=REPOSITORY)
    world.add(REPOSITORY, Repository(REPOSITORY, contents()))
    world.add(REGISTRY, registry)
    box = ObjectType(name="Box", parent="Graspable")
    packed = RelationType(name="isPackedIn", joins=("Graspable", "Box"))
    pack = ServiceType(
        name="Pack", inputs=(Parameter(name="Thing", type="Graspable"), Parameter(name="Box", type="Box")), effect="?Thing isPackedIn ?Box"
    )
    world.send(request(Define(definitions=Definitions(types=(box,), relations=(packed,), services=(pack,)))))
    world.run(2.0)
    assert "Pack" in registry.ontology.services
    deliver_request(registry, publish("Robot1", offer("Robot1", pack)), now=world.now)
    assert names(ask(registry, Discover(effect="Jar1 isPackedIn ?Box: Box"), Discovered, now=world.now)) == ["Robot1.Pack"]
    assert names(ask(registry, Discover(effect="Table1 isPackedIn ?Box: Box"), Discovered, now=world.now)) == []


@pytest.mark.parametrize("snapshot", [False, True])
def test_what_was_listed_is_listed_after_a_restart_until_its_lease_is_over(snapshot: bool) -> None:
    world = World(start=0.0)
    world.add(REGISTRY, Registry(REGISTRY, lab()[0]), journaled=SCHEMA)

    def send_request(body: Body) -> None:
        world.send(request(body, recipient=REGISTRY))
        world.run(1.0)

    send_request(publish("Robot1", lease=30.0))
    send_request(publish("Robot2", lease=30.0))
    if snapshot:
        world.snapshot(REGISTRY)
    send_request(Retract(provider="Robot2"))
    send_request(Renew(provider="Robot1", lease=60.0))
    world.revive(REGISTRY)
    registry = world.components[REGISTRY]
    assert isinstance(registry, Registry)
    assert names(ask(registry, Discover(), Discovered, now=world.now)) == ["Robot1.TransferObject"]
    logged_changes = [(device, joined) for _, device, joined, _ in log(registry, world.now)]
    assert logged_changes == [("Robot2", False), ("Robot2", True), ("Robot1", True)], "nor is it forgotten who came and went"
    world.run(70.0)
    assert registry.state.providers == {}, "its timer rings in the new life"
