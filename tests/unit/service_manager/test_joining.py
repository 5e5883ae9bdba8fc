"""How a device joins the system, request by request."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.kernel.component import Ask, Effect, Effects, Send, SetTimer
from somrs.ontology.objects import Object, ObjectAdded
from somrs.ontology.services import ServiceType
from somrs.ontology.types import ObjectType
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import CAPACITY_ATTRIBUTE, UNOCCUPIED, Offer, Publish, Published, Renew, Retract
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Define,
    Defined,
    Definitions,
    MapPage,
    OntologyPage,
    QueryMap,
    ReadMap,
    ReadOntology,
    Rejected,
    Row,
    Rows,
    Updated,
    UpdateMap,
)
from somrs.repository.component import Repository
from somrs.service_manager.participant.joining import Joining
from somrs.service_manager.participant.timers import JoiningDue, ReportWanted
from somrs.service_manager.sdk.map_reader import predecessor_name
from somrs.service_manager.sdk.orders import Capability, Profile, Report
from tests.support.lab import REPOSITORY, contents, deliver_request

REGISTRY, ME = "http://here/registry", "http://here/washer"
WASH = ServiceType(name="Wash", effect="?Object isClean ?Provider")
DEFINITIONS = Definitions(types=(ObjectType(name="Washer", parent="StationaryDevice"),))
PROFILE = Profile(
    name="Washer1",
    type="Washer",
    capabilities=(Capability(type="Wash", method="wash", attributes={"Price": 2.0}),),
    definitions=DEFINITIONS,
    values={"PositionX": 1.0},
    situation="Washer1 isOn Floor1",
)
LOOK = ReadMap(after=predecessor_name("Washer1"))
ADDITION = UpdateMap(
    changes=(ObjectAdded(Object(name="Washer1", type="Washer", values={"PositionX": 1.0})),),
    situation="Washer1 isOn Floor1",
    author="Washer1",
)
NOW = 10.0


class Joiner:
    """A device that joins, and its last request."""

    def __init__(self, profile: Profile = PROFILE) -> None:
        self.joining = Joining(profile=profile, repository=REPOSITORY, registry=REGISTRY)
        self.requests: list[Message] = []
        self.run_effects(self.joining.start(ME, NOW))

    def run_effects(self, effects: Effects) -> list[Effect]:
        performed = [*effects]
        self.requests += [effect.message for effect in performed if isinstance(effect, Send)]
        return performed

    def answer(self, body: Body) -> list[Effect]:
        header = Header(sender=REPOSITORY, recipient=ME, message_id="urn:x", relates_to=self.requests[-1].header.message_id)
        return self.run_effects(self.joining.receive(Message(header=header, body=body), NOW))

    def last_request(self) -> tuple[str, Body]:
        return self.requests[-1].header.recipient, self.requests[-1].body

    def published(self, object_type: str = "Washer") -> None:
        self.answer(Defined(version=1))
        self.answer(ontology())
        self.answer(MapPage(objects=(Object(name="Washer1", type=object_type),), facts=(), version=1, more=False))


def ontology(*, more_pages: bool = False, services: tuple[ServiceType, ...] = (WASH,)) -> OntologyPage:
    return OntologyPage(definitions=Definitions(services=services), version=1, next=7, more=more_pages)


def offer(object_type: str = "Washer", **attributes: float) -> Offer:
    return Offer(
        service="Washer1.Wash",
        provider="Washer1",
        provider_type=object_type,
        address=ME,
        service_type=WASH,
        attributes={"Price": 2.0, **attributes},
    )


def test_it_defines_reads_looks_adds_itself_and_publishes() -> None:
    joiner = Joiner()
    assert joiner.last_request() == (REPOSITORY, Define(definitions=DEFINITIONS, author="Washer1", brought=True))
    joiner.answer(Defined(version=1))
    assert joiner.last_request() == (REPOSITORY, ReadOntology())
    joiner.answer(ontology(more_pages=True, services=()))
    assert joiner.last_request() == (REPOSITORY, ReadOntology(after=7))
    joiner.answer(ontology())
    assert joiner.last_request() == (REPOSITORY, LOOK)
    joiner.answer(MapPage(objects=(Object(name="Washer2", type="Washer"),), facts=(), version=1, more=False))
    assert joiner.last_request() == (REPOSITORY, ADDITION)
    joiner.answer(Updated(version=2))
    assert joiner.last_request() == (REGISTRY, Publish(provider="Washer1", offers=(offer(),), lease=30.0))
    assert joiner.answer(Published(until=40.0, renew_within=10.0)) == [
        SetTimer(JoiningDue(), NOW + 7.0),
        Ask(ReportWanted(), Report("Washer1 offers Washer1.Wash", joined=True)),
    ]
    joiner.run_effects(joiner.joining.timer_fired(NOW))
    assert joiner.last_request() == (REGISTRY, Renew(provider="Washer1", lease=30.0))
    assert joiner.answer(Published(until=50.0, renew_within=10.0)) == [SetTimer(JoiningDue(), NOW + 7.0)]


def test_a_request_has_five_seconds() -> None:
    joiner = Joiner()
    identity = message_id(ME, NOW, 2)
    header = Header(sender=ME, recipient=REPOSITORY, message_id=identity, reply_to=ME)
    assert joiner.answer(Defined(version=1)) == [
        Send(Message(header=header, body=ReadOntology()), NOW + 5.0),
        SetTimer(JoiningDue(), NOW + 5.0),
    ]


@pytest.mark.parametrize(("capacity", "attributes"), [(1, {}), (3, {CAPACITY_ATTRIBUTE: 3})])
def test_who_is_on_the_map_publishes_as_what_it_is_there(capacity: int, attributes: dict[str, float]) -> None:
    joiner = Joiner(structs.replace(PROFILE, capacity=capacity))
    joiner.published("BigWasher")
    assert joiner.last_request() == (REPOSITORY, QueryMap(formula="?Device: Washer = Washer1", limit=1))
    joiner.answer(Rows(rows=(Row(bindings={"Device": "Washer1"}),), version=1, more=False))
    assert joiner.last_request() == (REGISTRY, Publish(provider="Washer1", offers=(offer("BigWasher", **attributes),), lease=30.0))


def join_laboratory(name: str, type: str) -> tuple[Joiner, list[Effect]]:
    """Start a program for devices of the type, for an object of the laboratory. Return it, and what it does after the last answer."""
    repository = Repository(REPOSITORY, contents())
    joiner = Joiner(Profile(name=name, type=type, capabilities=(Capability(type="TransferObject", method="carry"),)))
    effects: list[Effect] = []
    answered = 0
    while answered < len(joiner.requests) and joiner.last_request()[0] == REPOSITORY:
        answered = len(joiner.requests)
        [reply] = deliver_request(repository, joiner.last_request()[1])
        assert isinstance(reply, Send)
        effects = joiner.answer(reply.message.body)
    return joiner, effects


@pytest.mark.parametrize("type", ["PioneerP3DX", "MobileRobot", "Device"])
def test_an_object_of_the_type_that_the_program_serves_or_below_it_joins(type: str) -> None:
    joiner, _ = join_laboratory("Robot1", type)
    assert joiner.last_request()[0] == REGISTRY


@pytest.mark.parametrize(
    ("name", "type", "actual_type"),
    [("Table1", "PioneerP3DX", "Table"), ("Robot1", "PatrolRobot", "PioneerP3DX"), ("Robot1", "Washer", "PioneerP3DX")],
)
def test_an_object_of_another_type_does_not_join(name: str, type: str, actual_type: str) -> None:
    _, effects = join_laboratory(name, type)
    text = (
        f"{name} cannot join: {name} is a {actual_type} on the map, and this program serves a {type}: "
        f"choose an object that is a {type}, or a name that is not on the map"
    )
    assert effects == [SetTimer(JoiningDue(), None), Ask(ReportWanted(), Report(text, joined=False))]


def test_who_brings_no_definitions_reads_those_of_its_service_types_at_once() -> None:
    known_profile = structs.replace(PROFILE, definitions=Definitions(), capabilities=(Capability(type=WASH, method="wash"),))
    for profile in (known_profile, structs.replace(PROFILE, definitions=Definitions())):
        assert Joiner(profile).last_request() == (REPOSITORY, ReadOntology())


def test_what_is_added_without_an_answer_is_looked_for_first() -> None:
    joiner = Joiner()
    joiner.answer(Defined(version=1))
    joiner.answer(ontology())
    joiner.answer(MapPage(objects=(), facts=(), version=1, more=False))
    assert joiner.last_request() == (REPOSITORY, ADDITION)
    joiner.run_effects(joiner.joining.timer_fired(NOW))
    assert joiner.last_request() == (REPOSITORY, LOOK)


def test_a_renewal_without_an_answer_or_with_a_fault_publishes_anew() -> None:
    for fault in (False, True):
        joiner = Joiner()
        joiner.published()
        joiner.answer(Published(until=40.0, renew_within=10.0))
        joiner.run_effects(joiner.joining.timer_fired(NOW))
        if fault:
            joiner.answer(Fault(code="Sender", text="who?"))
        else:
            joiner.run_effects(joiner.joining.timer_fired(NOW))
        assert joiner.last_request() == (REGISTRY, Publish(provider="Washer1", offers=(offer(),), lease=30.0))


@pytest.mark.parametrize(("answer", "text"), [(Rejected(problems=("a", "b"), version=1), "a\nb"), (Fault(code="Sender", text="no"), "no")])
def test_who_is_not_taken_says_why_and_waits(answer: Rejected | Fault, text: str) -> None:
    assert Joiner().answer(answer) == [
        SetTimer(JoiningDue(), None),
        Ask(ReportWanted(), Report(f"Washer1 cannot join: {text}", joined=False)),
    ]


def test_who_leaves_retracts_and_hears_no_more() -> None:
    joiner = Joiner()
    timer, retract = joiner.run_effects(joiner.joining.depart(NOW))
    assert timer == SetTimer(JoiningDue(), None)
    assert isinstance(retract, Send)
    assert joiner.last_request() == (REGISTRY, Retract(provider="Washer1"))
    assert joiner.answer(Defined(version=1)) == []
    assert joiner.run_effects(joiner.joining.timer_fired(NOW)) == []


def test_an_answer_to_an_earlier_request_is_out_of_date() -> None:
    joiner = Joiner()
    joiner.run_effects(joiner.joining.timer_fired(NOW))
    joiner.requests.pop()
    assert joiner.answer(Defined(version=1)) == []


DRY = structs.replace(WASH, name="Dry")
TWO_SERVICES = structs.replace(
    PROFILE, definitions=Definitions(), capabilities=tuple(Capability(type=name, method=name) for name in ("Wash", "Dry"))
)


def test_types_are_looked_for_page_by_page_until_all_are_found() -> None:
    joiner = Joiner(TWO_SERVICES)
    assert len(joiner.answer(ontology(more_pages=True, services=(DRY,)))) == 2, "a request and the time for its answer"
    assert joiner.last_request() == (REPOSITORY, ReadOntology(after=7))
    assert len(joiner.answer(ontology(more_pages=True))) == 2
    assert joiner.last_request() == (REPOSITORY, LOOK)
    assert joiner.joining.types == {"Dry": DRY, "Wash": WASH}


def test_types_that_are_not_there_are_told_when_all_pages_are_read() -> None:
    joiner = Joiner(TWO_SERVICES)
    assert len(joiner.answer(ontology(more_pages=True, services=(structs.replace(WASH, name="Wahs"),)))) == 2
    expected_text = (
        "Washer1 cannot join: the common ontology has no service type Dry.\n"
        "the common ontology has no service type Wash. did you mean Wahs?\n"
        "use one of its names, or pass a ServiceType to @service"
    )
    assert joiner.answer(ontology(services=())) == [SetTimer(JoiningDue(), None), Ask(ReportWanted(), Report(expected_text, joined=False))]
    assert joiner.run_effects(joiner.joining.start(ME, NOW + 1))[1:] == [SetTimer(JoiningDue(), NOW + 6.0)]
    assert joiner.last_request() == (REPOSITORY, ReadOntology()), "from the beginning"


def test_a_device_offers_the_types_that_are_there_and_the_others_when_they_come() -> None:
    joiner = Joiner(TWO_SERVICES)
    joiner.answer(ontology(services=(DRY,)))
    joiner.answer(MapPage(objects=(Object(name="Washer1", type="Washer"),), facts=(), version=1, more=False))
    _, publication = joiner.last_request()
    assert isinstance(publication, Publish)
    assert [offer.service for offer in publication.offers] == ["Washer1.Dry"]
    effects = joiner.answer(Published(until=40.0, renew_within=10.0))
    text = "Washer1 offers Washer1.Dry\nWasher1.Wash is not on offer: the common ontology has no service type Wash"
    assert Ask(ReportWanted(), Report(text, joined=True)) in effects
    joiner.run_effects(joiner.joining.timer_fired(NOW + 7.0))
    joiner.answer(ontology(services=(DRY, WASH)))
    _, publication = joiner.last_request()
    assert isinstance(publication, Publish)
    assert [offer.service for offer in publication.offers] == ["Washer1.Wash", "Washer1.Dry"]


def test_a_device_whose_services_change_publishes_those_that_it_has_then() -> None:
    joiner = Joiner()
    joiner.run_effects(joiner.joining.services_changed(PROFILE, NOW))
    assert len(joiner.requests) == 1, "who has not joined yet publishes later"
    joiner.published()
    joiner.answer(Published(until=40.0, renew_within=10.0))
    beside = Capability(type="Dry", method="dry", occupies=False)
    joiner.run_effects(joiner.joining.services_changed(structs.replace(PROFILE, capabilities=(beside,)), NOW))
    assert joiner.last_request() == (REPOSITORY, ReadOntology())
    joiner.answer(ontology(services=(DRY, WASH)))
    _, publication = joiner.last_request()
    assert isinstance(publication, Publish)
    assert [(offer.service, offer.attributes) for offer in publication.offers] == [("Washer1.Dry", {CAPACITY_ATTRIBUTE: UNOCCUPIED})]
