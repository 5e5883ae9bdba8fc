"""Offers by name and type, beside a plain list of them."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from somrs.kernel.codec import Codec, encode
from somrs.kernel.offers import Offers
from somrs.ontology.services import ServiceType
from somrs.protocol.messages.directory import Offer
from tests.support.examples import examples

TYPE_NAMES = ("Carry", "Wash", "Cook")
SERVICES = tuple(f"Robot{number}.Work" for number in range(5))


def offer(service: str, type_name: str, effect: str = "") -> Offer:
    service_type = ServiceType(name=type_name, effect=effect)
    return Offer(service=service, provider=service.partition(".")[0], provider_type="Robot", address="", service_type=service_type)


OFFERS = st.builds(offer, st.sampled_from(SERVICES), st.sampled_from(TYPE_NAMES), st.sampled_from(["", "A isOn B"]))
CHANGES = st.lists(st.tuples(st.lists(OFFERS, max_size=3), st.lists(st.sampled_from(SERVICES), max_size=2)), max_size=8)


@examples(60)
@given(CHANGES)
def test_indexes_find_what_a_search_of_all_finds(changes: list[tuple[list[Offer], list[str]]]) -> None:
    offers, plain = Offers(), list[Offer]()
    for added_offers, removed_services in changes:
        offers = offers.changed(added_offers, removed_services)
        added = {added_offer.service: added_offer for added_offer in added_offers}
        plain = [kept for kept in plain if kept.service not in removed_services and kept.service not in added] + [*added.values()]
        plain.sort(key=lambda plain_offer: plain_offer.service)
        assert [*offers] == plain
        assert len(offers) == len(plain)
        for names in ((), TYPE_NAMES[:1], TYPE_NAMES[:2], (*TYPE_NAMES, *TYPE_NAMES, "None")):
            assert offers.of_types(names) == [plain_offer for plain_offer in plain if plain_offer.service_type.name in names]
        for services in ((), SERVICES[1:3], (*SERVICES, "None")):
            assert offers.of_services(services) == [plain_offer for plain_offer in plain if plain_offer.service in services]
        assert {service: offers.get(service) for service in SERVICES} == {
            service: next((plain_offer for plain_offer in plain if plain_offer.service == service), None) for service in SERVICES
        }
        providers = [service.partition(".")[0] for service in SERVICES]
        assert {provider: offers.of_provider(provider) for provider in providers} == {
            provider: [plain_offer for plain_offer in plain if plain_offer.provider == provider] for provider in providers
        }
        assert {*offers.providers} == {plain_offer.provider for plain_offer in plain}
        assert offers.types == {plain_offer.service_type.name: plain_offer.service_type for plain_offer in plain}
        definitions = {(plain_offer.service_type.name, plain_offer.service_type.effect) for plain_offer in plain}
        assert len(offers.definitions) == len(definitions)
        assert {(definition.name, definition.effect) for definition in offers.definitions} == definitions
    assert Codec[Offers](Offers).decode(encode(offers)) == offers


def test_equal_definitions_are_one_object() -> None:
    offers = Offers([offer("Robot1.Work", "Carry")]).changed([offer("Robot2.Work", "Carry"), offer("Robot3.Work", "Carry", "A isOn B")])
    first, second, other = (listed_offer.service_type for listed_offer in offers)
    assert first is second
    assert other != first


def test_an_offer_is_there_as_it_is_and_not_otherwise() -> None:
    offers = Offers([offer("Robot1.Work", "Carry")])
    assert offer("Robot1.Work", "Carry") in offers
    assert structs.replace(offer("Robot1.Work", "Carry"), address="elsewhere") not in offers
    assert offers != Offers()
    assert offers != [*offers]
