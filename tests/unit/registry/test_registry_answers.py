"""A Registry, message by message: what exactly it answers and tells, and when it wakes up."""

from __future__ import annotations

import pytest
from msgspec import json, structs

from somrs.kernel.component import DeliveryFailed, Received, Send, SetTimer, Started, TimerFired
from somrs.kernel.following import LEASE
from somrs.kernel.replica import ReplicaDue
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import Ontology, Value
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import (
    Discover,
    Discovered,
    Offer,
    Publish,
    Published,
    Renew,
    Retract,
    Retracted,
    ServicesJoined,
    ServicesLeft,
    ServicesSubscribed,
    SubscribeServices,
)
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import QueryMap, SubscribeMap
from somrs.protocol.messages.paging import PAGE_BYTES
from somrs.registry import component
from somrs.registry.component import Registry
from somrs.registry.state import LeasesDue
from tests.support.lab import CLIENT, REPOSITORY, ask, deliver_request, request, sent_bodies

REGISTRY, FOLLOWER, SECOND = "http://here/registry", "http://here/follower", "http://here/second"
WASH = ServiceType(name="Wash", inputs=(Parameter(name="Object", type="Thing"),), effect="?Object isClean ?Provider")


def offer(provider: str, name: str = "Wash", doc: str = "", **attributes: Value) -> Offer:
    return Offer(
        service=f"{provider}.{name}",
        provider=provider,
        provider_type="Washer",
        address=f"http://{provider}/",
        service_type=structs.replace(WASH, name=name, doc=doc),
        attributes=attributes,
    )


def publish(*offers: Offer, lease: float = 30.0) -> Publish:
    return Publish(provider=offers[0].provider, offers=offers, lease=lease)


@pytest.fixture
def registry() -> Registry:
    return Registry(REGISTRY, Ontology())


def test_it_follows_a_repository_if_there_is_one(registry: Registry) -> None:
    assert registry.handle(Started(REGISTRY), 1.0) == [SetTimer(LeasesDue(), None)]
    following = Registry(REGISTRY, repository=REPOSITORY)
    send, *timers = following.handle(Started(REGISTRY), 1.0)
    assert isinstance(send, Send)
    assert (send.message.header.recipient, send.message.body) == (REPOSITORY, SubscribeMap(lease=LEASE))
    assert timers == [SetTimer(ReplicaDue(), 6.0), SetTimer(LeasesDue(), None)]
    assert following.handle(TimerFired(ReplicaDue()), 2.0) == [SetTimer(ReplicaDue(), 6.0)], "that is the copy's alone"
    assert ([*following.ontology], following.open) == ([], [])


def test_what_is_published_is_answered_then_told_and_then_watched(registry: Registry) -> None:
    for follower in (FOLLOWER, SECOND):
        ask(registry, SubscribeServices(lease=100.0), ServicesSubscribed, now=5.0, sender=follower)
    message = request(publish(offer("Washer1")), recipient=REGISTRY)
    answer, first, second, timer = registry.handle(Received(message), 10.0)
    assert isinstance(answer, Send)
    assert (answer.message.header.sender, answer.message.header.recipient) == (REGISTRY, CLIENT)
    assert (answer.message.header.relates_to, answer.message.body) == (message.header.message_id, Published(until=40.0, renew_within=10.0))
    assert [first, second] == [
        Send(
            Message(
                header=Header(sender=REGISTRY, recipient=follower, message_id=message_id(REGISTRY, follower, "news", 1, 10.0)),
                body=ServicesJoined(offers=(offer("Washer1"),), version=1),
            )
        )
        for follower in (FOLLOWER, SECOND)
    ]
    assert timer == SetTimer(LeasesDue(), 40.0)
    departure = deliver_request(registry, Retract(provider="Washer1"), 11.0)[1]
    assert isinstance(departure, Send)
    assert departure.message.header.message_id == message_id(REGISTRY, FOLLOWER, "news", 2, 11.0)


def test_it_wakes_up_for_followers_too(registry: Registry) -> None:
    assert deliver_request(registry, SubscribeServices(lease=20.0), 5.0, sender=FOLLOWER)[-1] == SetTimer(LeasesDue(), 25.0)
    assert deliver_request(registry, publish(offer("Washer1"), lease=30.0), 5.0)[-1] == SetTimer(LeasesDue(), 25.0)
    assert registry.handle(TimerFired(LeasesDue()), 25.0) == [SetTimer(LeasesDue(), 35.0)]
    assert registry.state.subscribers == {}


def test_what_expires_is_told_before_anything_else(registry: Registry) -> None:
    deliver_request(registry, SubscribeServices(lease=100.0), 0.0, sender=FOLLOWER)
    deliver_request(registry, publish(offer("Washer1"), offer("Washer1", "Dry"), lease=10.0))
    deliver_request(registry, publish(offer("Washer2"), lease=10.0), 9.0)
    assert sent_bodies(deliver_request(registry, Discover(), 10.0), object) == [
        ServicesLeft(services=("Washer1.Wash", "Washer1.Dry"), provider="Washer1", reason="expired", version=3),
        Discovered(offers=(offer("Washer2"),), version=3),
    ]


def test_a_renewal_says_how_long_it_holds(registry: Registry) -> None:
    deliver_request(registry, publish(offer("Washer1")))
    assert ask(registry, Renew(provider="Washer1", lease=60.0), Published, now=10.0) == Published(until=70.0, renew_within=20.0)
    assert ask(registry, Renew(provider="Washer2", lease=60.0), Fault) == Fault(
        code="Sender", text="nothing is registered for Washer2: publish its services anew"
    )


def test_what_was_answered_is_answered_again_and_not_done_again(registry: Registry) -> None:
    deliver_request(registry, publish(offer("Washer1")))
    for body, answer in (
        (Renew(provider="Washer1", lease=60.0), Published(until=61.0, renew_within=20.0)),
        (Retract(provider="Washer1"), Retracted(services=("Washer1.Wash",))),
        (Renew(provider="Washer1", lease=60.0), Fault(code="Sender", text="nothing is registered for Washer1: publish its services anew")),
    ):
        message = request(body)
        assert sent_bodies(registry.handle(Received(message), 1.0), object) == [answer]
        assert sent_bodies(registry.handle(Received(message), 2.0), object) == [answer]


def test_only_so_many_answers_are_remembered(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(component, "REMEMBERED", 2)
    messages = [request(Retract(provider="Washer1")) for _ in range(3)]
    for message in messages:
        registry.handle(Received(message), 0.0)
    assert list(registry.state.answers) == [message.header.message_id for message in messages[1:]]


def test_publishing_nothing_leaves_nothing(registry: Registry) -> None:
    deliver_request(registry, SubscribeServices(lease=100.0), 0.0, sender=FOLLOWER)
    deliver_request(registry, publish(offer("Washer1")))
    effects = deliver_request(registry, Publish(provider="Washer1", offers=(), lease=30.0))
    services_left = ServicesLeft(services=("Washer1.Wash",), provider="Washer1", reason="retracted", version=2)
    assert sent_bodies(effects, object) == [Published(until=30.0, renew_within=10.0), services_left]
    assert registry.state.providers == {}
    assert sent_bodies(deliver_request(registry, Publish(provider="Washer1", offers=(), lease=30.0)), object) == [
        Published(until=30.0, renew_within=10.0)
    ]


def test_a_provider_may_publish_the_same_service_again(registry: Registry) -> None:
    deliver_request(registry, publish(offer("Washer1")))
    deliver_request(registry, publish(offer("Washer2")))
    assert ask(registry, publish(offer("Washer2"), lease=60.0), Published, now=1.0) == Published(until=61.0, renew_within=20.0)


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        (
            Publish(provider="", offers=(), lease=30.0),
            "`provider` is empty: give the name of the device on the map",
        ),
        (
            Publish(provider="Washer2", offers=(offer("Washer1"),), lease=30.0),
            "Washer1.Wash belongs to Washer1, and Washer2 cannot offer it: let Washer1 publish it",
        ),
        (
            publish(structs.replace(offer("Washer2"), service="Washer1.Wash")),
            "Washer1.Wash is offered by Washer1 already: give the service of Washer2 another name",
        ),
        (
            publish(offer("Washer2"), offer("Washer2")),
            "Washer2 offers two services of the same name: give each a name of its own",
        ),
    ],
)
def test_why_offers_are_refused(registry: Registry, wrong: Publish, text: str) -> None:
    deliver_request(registry, publish(offer("Washer1")))
    assert ask(registry, wrong, Fault) == Fault(code="Sender", text=text)
    assert list(registry.state.providers) == ["Washer1"]


@pytest.mark.parametrize("part", ["effect", "precondition"])
def test_a_service_type_with_a_formula_that_is_none_is_refused(registry: Registry, part: str) -> None:
    wrong = structs.replace(offer("Washer2"), service_type=structs.replace(WASH, **{part: "?Object isClean"}))
    assert ask(registry, publish(wrong), Fault).text.startswith("Washer2.Wash, of type Wash: ")


@pytest.mark.parametrize(
    ("services", "remaining"), [(("Washer1.Dry",), ["Washer1.Wash"]), ((), None), (("Washer1.Dry", "Washer1.Wash"), None)]
)
def test_who_retracts_all_services_is_forgotten(registry: Registry, services: tuple[str, ...], remaining: list[str] | None) -> None:
    deliver_request(registry, publish(offer("Washer1"), offer("Washer1", "Dry")))
    deliver_request(registry, Retract(provider="Washer1", services=services))
    provider = registry.state.providers.get("Washer1")
    assert (list(provider.offers) if provider is not None else None) == remaining


def test_nothing_is_told_of_what_nobody_offered(registry: Registry) -> None:
    deliver_request(registry, SubscribeServices(lease=100.0), 0.0, sender=FOLLOWER)
    assert sent_bodies(deliver_request(registry, Retract(provider="Washer1")), object) == [Retracted(services=())]
    deliver_request(registry, publish(offer("Washer1")))
    assert sent_bodies(deliver_request(registry, Retract(provider="Washer1", services=("Washer1.Dry",))), object) == [
        Retracted(services=())
    ]


def test_pages_are_full_and_lose_nothing(registry: Registry) -> None:
    """Offers so large that two fill a page exactly, and a third goes onto the next."""
    deliver_request(registry, SubscribeServices(lease=100.0), 0.0, sender=FOLLOWER)
    room = PAGE_BYTES // 2 - len(json.encode(offer("Washer1", "W1")))
    offers = [offer("Washer1", f"W{number}", "x" * room) for number in range(5)]
    announcements = sent_bodies(deliver_request(registry, publish(*offers)), ServicesJoined)
    assert [len(news.offers) for news in announcements] == [2, 2, 1]
    assert [listed_offer for news in announcements for listed_offer in news.offers] == offers
    pages = [ask(registry, Discover(after=offset), Discovered) for offset in ("", "Washer1.W1", "Washer1.W3", "Washer1.W4")]
    assert [(list(page.offers), page.more) for page in pages] == [
        (offers[:2], True),
        (offers[2:4], True),
        (offers[4:], False),
        ([], False),
    ]


def test_an_offer_that_is_larger_than_a_page_has_one_to_itself(registry: Registry) -> None:
    large = offer("Washer1", "A", "x" * PAGE_BYTES)
    deliver_request(registry, publish(large, offer("Washer1", "B")))
    assert ask(registry, Discover(), Discovered) == Discovered(offers=(large,), more=True, version=2)


def test_types_above_are_found_even_in_a_circle() -> None:
    parent_types = (
        ServiceType(name="Clean", parent="Serve", effect=WASH.effect),
        ServiceType(name="Serve", parent="Clean", effect=WASH.effect),
    )
    registry = Registry(REGISTRY, Ontology().extended(parent_types[:1]).extended(parent_types[1:]))
    mine = structs.replace(offer("Washer1"), service_type=structs.replace(WASH, parent="Clean"))
    deliver_request(registry, publish(mine))
    match_counts = {
        name: len(ask(registry, Discover(service_type=name), Discovered).offers) for name in ("Wash", "Clean", "Serve", "Other")
    }
    assert match_counts == {"Wash": 1, "Clean": 1, "Serve": 1, "Other": 0}


def test_a_parent_that_nobody_defined_is_found_by_its_name(registry: Registry) -> None:
    deliver_request(registry, publish(structs.replace(offer("Washer1"), service_type=structs.replace(WASH, parent="Unknown"))))
    assert len(ask(registry, Discover(service_type="Unknown"), Discovered).offers) == 1


@pytest.mark.parametrize(
    ("attributes", "match_count"),
    [({"A": True}, 1), ({"A": 1.0}, 0), ({"B": 1.0}, 1), ({"B": True}, 0), ({"A": True, "B": 2.0}, 0), ({"A": True, "B": 1.0}, 1)],
)
def test_all_attributes_are_as_wanted(registry: Registry, attributes: dict[str, Value], match_count: int) -> None:
    deliver_request(registry, publish(offer("Washer1", A=True, B=1.0)))
    assert len(ask(registry, Discover(attributes=attributes), Discovered).offers) == match_count


def test_who_follows_is_told_until_when(registry: Registry) -> None:
    assert ask(registry, SubscribeServices(lease=20.0), ServicesSubscribed, now=5.0, sender=FOLLOWER) == ServicesSubscribed(until=25.0)
    assert ask(registry, SubscribeServices(lease=20.0), Fault, sender=ANONYMOUS) == Fault(
        code="Sender", text="a subscription needs a sender address: set the sender to an address that can be reached"
    )
    assert list(registry.state.subscribers) == [FOLLOWER]


@pytest.mark.parametrize(
    ("body", "dropped"),
    [
        (ServicesJoined(offers=(), version=2), True),
        (ServicesLeft(services=(), provider="Washer1", reason="retracted", version=2), True),
        (ServicesJoined(offers=(), version=1), False),
        (ServicesSubscribed(until=20.0, version=2), False),
    ],
)
def test_who_cannot_be_told_news_is_dropped_unless_it_has_subscribed_since(registry: Registry, body: Body, dropped: bool) -> None:
    deliver_request(registry, publish(offer("Washer1")))
    for follower in (FOLLOWER, SECOND):
        deliver_request(registry, SubscribeServices(lease=20.0), sender=follower)
    lost = Message(header=Header(sender=REGISTRY, recipient=FOLLOWER, message_id="urn:x"), body=body)
    registry.handle(DeliveryFailed(lost, "r"), 1.0)
    assert list(registry.state.subscribers) == ([SECOND] if dropped else [FOLLOWER, SECOND])
    stranger = Message(header=structs.replace(lost.header, recipient="http://stranger"), body=body)
    assert registry.handle(DeliveryFailed(stranger, "r"), 1.0) == [SetTimer(LeasesDue(), 20.0)]


def test_subscribers_hear_of_a_restart_which_version_is_the_latest(registry: Registry) -> None:
    registry.handle(Started(REGISTRY), 5.0)
    deliver_request(registry, SubscribeServices(lease=20.0), 6.0, sender=FOLLOWER)
    deliver_request(registry, publish(offer("Washer1")), 7.0)
    restarted = Registry.restored(registry.state)
    assert sent_bodies(restarted.handle(Started(REGISTRY), 8.0), ServicesSubscribed) == [ServicesSubscribed(until=26.0, version=5001)]


def test_what_it_does_not_understand(registry: Registry) -> None:
    assert ask(registry, QueryMap(formula="A isOn B"), Fault) == Fault(
        code="ActionNotSupported",
        text="a Registry does not understand QueryMap; it publishes, renews, retracts and discovers services",
    )
