"""A replica, message by message: what exactly it asks for, when it wakes up, and what it tells its owner."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.kernel.component import DeliveryFailed, Effect, Received, Send, SetTimer, TimerFired
from somrs.kernel.following import GAP_TIME, LEASE, PATIENCE
from somrs.kernel.replica import Replica, ReplicaDue, ReplicaUpdate
from somrs.ontology.objects import Fact, FactAdded, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import AttributeType, Kind, ObjectType
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Definitions,
    Event,
    MapChanged,
    MapPage,
    MapSubscribed,
    OntologyChanged,
    OntologyPage,
    ReadMap,
    ReadOntology,
    SubscribeMap,
)

OWNER, REPOSITORY, ALIAS = "http://here/owner", "http://here/repository", "http://localhost/repository"
JAR, BOX = Object(name="Jar1", type="Jar"), Object(name="Box1", type="Box")
THING = ObjectType(name="Thing", parent=None)
COLOR = AttributeType(name="Color", kind=Kind.TEXT)
SMELL = AttributeType(name="Smell", kind=Kind.TEXT)


class Reader:
    """A replica, and the last question that it asked."""

    def __init__(self) -> None:
        self.replica = Replica(OWNER, REPOSITORY)
        self.question = self._noted(self.replica.start(0.0))

    def _noted(self, effects: list[Effect]) -> Message:
        [message] = [effect.message for effect in effects if isinstance(effect, Send)]
        return message

    def hear(self, body: Body, now: float = 0.0, question: Message | None = None, sender: str = REPOSITORY) -> ReplicaUpdate | None:
        """What came of a message that answers that question, or None."""
        relates_to = question.header.message_id if question is not None else None
        header = Header(sender=sender, recipient=OWNER, message_id="urn:x", relates_to=relates_to)
        return self.replica.handle(Received(Message(header=header, body=body)), now)

    def answer(self, body: Body, now: float = 0.0, sender: str = REPOSITORY) -> Body | None:
        """What it asks for next."""
        news = self.hear(body, now, self.question, sender)
        assert news is not None
        messages = [effect.message for effect in news.effects if isinstance(effect, Send)]
        for message in messages:
            self.question = message
        return messages[0].body if messages else None

    def ring(self, now: float) -> list[Body]:
        news = self.replica.handle(TimerFired(ReplicaDue()), now)
        assert news is not None
        messages = [effect.message for effect in news.effects if isinstance(effect, Send)]
        self.question = messages[-1] if messages else self.question
        return [message.body for message in messages]

    def read(self, version: int = 7, sender: str = REPOSITORY) -> None:
        """Read a map of one object, whole."""
        assert self.answer(MapSubscribed(version=version, until=60.0), sender=sender) == ReadOntology()
        assert self.answer(ontology_page(version), sender=sender) == ReadMap()
        assert self.answer(MapPage(objects=(JAR,), facts=(), version=version, more=False), sender=sender) is None
        assert self.replica.version == version


def ontology_page(version: int = 7, *, more_pages: bool = False, changed_at: int = 3, following: int = 1) -> OntologyPage:
    return OntologyPage(definitions=Definitions(types=(THING,)), version=version, next=following, more=more_pages, changed_at=changed_at)


def changed(version: int, *changes: ValueSet | ObjectAdded | ObjectRemoved | FactAdded) -> MapChanged:
    return MapChanged(event=Event(version=version, at=0.0, author="a", changes=changes))


def timer_time(news: ReplicaUpdate | None) -> float | None:
    assert news is not None
    [fire_time] = [effect.at for effect in news.effects if isinstance(effect, SetTimer)]
    return fire_time


def test_it_begins_with_a_subscription() -> None:
    send, timer = Replica(OWNER, REPOSITORY).start(10.0)
    identity = message_id(OWNER, REPOSITORY, "replica", 1, 10.0)
    header = Header(sender=OWNER, recipient=REPOSITORY, message_id=identity, reply_to=OWNER)
    assert send == Send(Message(header=header, body=SubscribeMap(lease=LEASE)), expires_at=10.0 + PATIENCE)
    assert timer == SetTimer(ReplicaDue(), 10.0 + PATIENCE)


def test_it_reads_the_ontology_and_then_the_map_page_by_page() -> None:
    reader = Reader()
    assert reader.answer(MapSubscribed(version=7, until=60.0), now=1.0) == ReadOntology()
    assert reader.answer(ontology_page(more_pages=True, following=5), now=1.0) == ReadOntology(after=5)
    last_page = OntologyPage(definitions=Definitions(attributes=(COLOR,)), version=7, next=6, more=False, changed_at=3)
    assert reader.answer(last_page, now=1.0) == ReadMap()
    assert reader.answer(MapPage(objects=(BOX,), facts=(), version=7, more=True), now=1.0) == ReadMap(after="Box1")
    assert not reader.replica.ready
    fact = Fact("isOn", ("Jar1", "Box1"))
    page = MapPage(objects=(JAR,), facts=(fact,), version=7, more=False)
    assert reader.hear(page, 1.0, reader.question) == ReplicaUpdate(effects=[SetTimer(ReplicaDue(), LEASE / 3)], reloaded=True)
    replica = reader.replica
    assert (replica.ready, replica.version, set(replica.map.objects), [*replica.map.facts()]) == (True, 7, {"Box1", "Jar1"}, [fact])
    assert [*replica.ontology] == [COLOR, THING]


def test_each_question_has_an_id_of_its_own_and_some_seconds() -> None:
    reader = Reader()
    first = reader.question.header.message_id
    news = reader.hear(MapSubscribed(version=0, until=60.0), 2.0, reader.question)
    assert news is not None
    send, timer = news.effects
    assert isinstance(send, Send)
    assert send.message.header.message_id == message_id(OWNER, REPOSITORY, "replica", 2, 2.0) != first
    assert (send.expires_at, timer) == (2.0 + PATIENCE, SetTimer(ReplicaDue(), 2.0 + PATIENCE))


@pytest.mark.parametrize(
    "second",
    [ontology_page(6), ontology_page(8, changed_at=8), ontology_page(6, more_pages=True)],
    ids=["an older page", "the ontology changed between them", "an older page, and more"],
)
def test_pages_that_do_not_belong_together_make_it_begin_anew(second: OntologyPage) -> None:
    reader = Reader()
    reader.answer(MapSubscribed(version=7, until=60.0))
    reader.answer(ontology_page(7, more_pages=True))
    assert reader.answer(second) == SubscribeMap(lease=LEASE)
    assert (reader.replica.reading, reader.replica.question) == (None, None)
    assert reader.answer(MapSubscribed(version=7, until=60.0)) == ReadOntology()


def test_a_page_that_is_as_old_as_the_one_before_belongs_to_it() -> None:
    reader = Reader()
    reader.answer(MapSubscribed(version=7, until=60.0))
    reader.answer(ontology_page(7, more_pages=True))
    reader.answer(ontology_page(9))
    assert reader.answer(MapPage(objects=(), facts=(), version=8, more=False)) == SubscribeMap(lease=LEASE), "older than the last one"


def test_events_between_the_pages_are_waited_for() -> None:
    reader = Reader()
    reader.answer(MapSubscribed(version=7, until=60.0))
    reader.answer(ontology_page(7))
    assert reader.hear(MapPage(objects=(JAR,), facts=(), version=9, more=False), 1.0, reader.question) == ReplicaUpdate(
        effects=[SetTimer(ReplicaDue(), 1.0 + GAP_TIME)]
    )
    assert reader.hear(changed(9, ValueSet("Jar1", "Color", "Blue"))) == ReplicaUpdate(effects=[SetTimer(ReplicaDue(), 1.0 + GAP_TIME)])
    assert not reader.replica.ready
    news = reader.hear(changed(8, ValueSet("Jar1", "Color", "Red")))
    changes = (ValueSet("Jar1", "Color", "Red"), ValueSet("Jar1", "Color", "Blue"))
    assert news == ReplicaUpdate(effects=[SetTimer(ReplicaDue(), LEASE / 3)], changes=changes, reloaded=True)
    assert (reader.replica.version, reader.replica.events) == (9, {})


def test_events_that_neither_the_copy_nor_its_successor_needs_are_dropped() -> None:
    reader = Reader()
    reader.read(7)
    reader.hear(changed(9), 2.0)
    assert reader.ring(2.0 + GAP_TIME) == [ReadOntology()]
    reader.hear(changed(6), 3.0)
    assert set(reader.replica.events) == {6, 9}, "which of them the first page shows is not known yet"
    assert reader.answer(ontology_page(9), 3.0) == ReadMap()
    assert set(reader.replica.events) == {9}
    assert reader.answer(MapPage(objects=(), facts=(), version=9, more=False), 3.0) is None
    assert (reader.replica.version, reader.replica.events) == (9, {})


def test_what_follows_is_told_once_and_in_order() -> None:
    reader = Reader()
    reader.read(7)
    assert reader.hear(changed(8, ValueSet("Jar1", "Color", "Red"))) == ReplicaUpdate(
        effects=[SetTimer(ReplicaDue(), LEASE / 3)], changes=(ValueSet("Jar1", "Color", "Red"),)
    )
    assert reader.hear(changed(8, ValueSet("Jar1", "Color", "Red"))) == ReplicaUpdate(effects=[SetTimer(ReplicaDue(), LEASE / 3)])
    assert reader.replica.events == {}
    news = reader.hear(OntologyChanged(definitions=Definitions(attributes=(SMELL,)), version=9, changes=(ObjectAdded(BOX),)))
    assert news == ReplicaUpdate(effects=[SetTimer(ReplicaDue(), LEASE / 3)], changes=(ObjectAdded(BOX),), definitions=(SMELL,))
    assert reader.replica.map.objects["Box1"] == BOX
    assert reader.replica.ontology.attributes["Smell"] == SMELL


def test_values_of_what_is_not_there_are_left_out() -> None:
    reader = Reader()
    reader.read(7)
    applied_changes = (ValueSet("Jar1", "Color", "Red"), ObjectAdded(BOX), ValueSet("Box1", "Color", "Red"), ObjectRemoved("Jar1"))
    news = reader.hear(changed(8, ValueSet("Jar9", "Color", "Red"), *applied_changes, ValueSet("Jar1", "Color", "Blue")))
    assert news is not None
    assert news.changes == applied_changes
    assert set(reader.replica.map.objects) == {"Box1"}


def test_a_gap_that_does_not_close_has_everything_read_again() -> None:
    reader = Reader()
    reader.read(7)
    assert timer_time(reader.hear(changed(9), 2.0)) == 2.0 + GAP_TIME
    assert timer_time(reader.hear(changed(10), 2.5)) == 2.0 + GAP_TIME, "it is as old as it was"
    assert reader.ring(2.0 + GAP_TIME / 2) == []
    assert reader.ring(2.0 + GAP_TIME) == [ReadOntology()]
    assert reader.replica.version == 7, "until it is read, the copy stays"


def test_a_gap_that_closes_in_part_is_given_more_time() -> None:
    reader = Reader()
    reader.read(7)
    reader.hear(changed(9), 2.0)
    reader.hear(changed(11), 2.2)
    assert timer_time(reader.hear(changed(8), 2.5)) == 2.5 + GAP_TIME
    assert timer_time(reader.hear(changed(10), 2.6)) == LEASE / 3
    assert reader.replica.version == 11


def test_a_subscription_that_tells_of_a_later_version_shows_a_gap() -> None:
    reader = Reader()
    reader.read(7)
    assert reader.ring(LEASE / 3) == [SubscribeMap(lease=LEASE)]
    assert timer_time(reader.hear(MapSubscribed(version=8, until=99.0), 20.5, reader.question)) == 20.5 + GAP_TIME
    assert reader.replica.subscription is None
    assert reader.replica.answer_by is None


@pytest.mark.parametrize(("version", "questions"), [(6, [ReadOntology()]), (7, [])])
def test_a_repository_that_is_at_an_earlier_version_is_another_one(version: int, questions: list[Body]) -> None:
    reader = Reader()
    reader.read(7)
    assert reader.ring(LEASE / 3) == [SubscribeMap(lease=LEASE)]
    reader.hear(changed(9), 20.5)
    news = reader.hear(MapSubscribed(version=version, until=99.0), 21.0, reader.question)
    assert news is not None
    assert [effect.message.body for effect in news.effects if isinstance(effect, Send)] == questions
    assert (reader.replica.version, reader.replica.announced_version) == ((-1, 6) if questions else (7, 9))
    assert set(reader.replica.events) == (set() if questions else {9})


def test_a_repository_that_came_up_again_is_asked_where_it_is() -> None:
    reader = Reader()
    reader.read(7)
    news = reader.hear(MapSubscribed(version=7, until=60.0), 3.0)
    assert news is not None
    assert [effect.message.body for effect in news.effects if isinstance(effect, Send)] == [SubscribeMap(lease=LEASE)]
    assert reader.replica.renew_at == 3.0 + LEASE / 3


@pytest.mark.parametrize(
    "body",
    [
        MapSubscribed(version=99, until=60.0),
        ontology_page(99),
        MapPage(objects=(), facts=(), version=99, more=False),
    ],
)
def test_answers_to_a_question_that_was_given_up_change_nothing(body: Body) -> None:
    reader = Reader()
    reader.read(7)
    old_question = Message(header=structs.replace(reader.question.header, message_id="urn:old"), body=ReadMap())
    assert reader.hear(body, 1.0, old_question) == ReplicaUpdate(effects=[SetTimer(ReplicaDue(), LEASE / 3)])
    assert (reader.replica.version, reader.replica.announced_version) == (7, 7)


def test_a_fault_is_the_replicas_if_it_answers_its_question() -> None:
    reader = Reader()
    fault = Fault(code="Sender", text="no")
    assert reader.hear(fault, 1.0, reader.question) == ReplicaUpdate(effects=[SetTimer(ReplicaDue(), PATIENCE)])
    assert reader.hear(fault, 1.0) is None
    assert reader.ring(PATIENCE - 0.1) == []
    assert reader.ring(PATIENCE) == [SubscribeMap(lease=LEASE)]
    reader = Reader()
    reader.answer(MapSubscribed(version=7, until=60.0))
    assert reader.hear(fault, 1.0, reader.question) is not None


@pytest.mark.parametrize(
    ("sender", "accepted"),
    [(REPOSITORY, True), (ALIAS, True), ("http://there/other", False)],
    ids=["as asked", "as it is called", "another"],
)
def test_only_its_repository_is_listened_to_by_either_name(sender: str, accepted: bool) -> None:
    reader = Reader()
    reader.read(7, sender=ALIAS)
    assert reader.replica.source == ALIAS
    news = reader.hear(changed(8), sender=sender)
    assert (news is not None) is accepted
    assert reader.replica.version == (8 if accepted else 7)


@pytest.mark.parametrize(
    ("body", "recipient", "ours"),
    [
        (SubscribeMap(lease=LEASE), REPOSITORY, True),
        (ReadMap(), REPOSITORY, True),
        (ReadOntology(), REPOSITORY, True),
        (ReadMap(), "http://there/other", False),
        (changed(1), REPOSITORY, False),
    ],
)
def test_what_could_not_be_delivered_is_the_replicas_if_it_was_a_question_to_its_repository(body: Body, recipient: str, ours: bool) -> None:
    reader = Reader()
    header = structs.replace(reader.question.header, recipient=recipient)
    news = reader.replica.handle(DeliveryFailed(Message(header=header, body=body), "r"), 2.0)
    assert news == (ReplicaUpdate(effects=[SetTimer(ReplicaDue(), 2.0 + GAP_TIME)]) if ours else None)


@pytest.mark.parametrize(
    ("news", "redefined"),
    [
        (ReplicaUpdate(effects=[]), False),
        (ReplicaUpdate(effects=[], changes=(ObjectRemoved("A"),)), False),
        (ReplicaUpdate(effects=[], definitions=(COLOR,)), True),
        (ReplicaUpdate(effects=[], reloaded=True), True),
    ],
)
def test_news_say_whether_the_ontology_may_be_another(news: ReplicaUpdate, redefined: bool) -> None:
    assert news.ontology_changed is redefined


def test_a_page_that_was_not_asked_for_is_none_of_those_being_read() -> None:
    reader = Reader()
    reader.answer(MapSubscribed(version=7, until=60.0))
    old_question = Message(header=structs.replace(reader.question.header, message_id="urn:old"), body=ReadOntology())
    for question in (old_question, None):
        assert reader.hear(ontology_page(99), 1.0, question) == ReplicaUpdate(effects=[SetTimer(ReplicaDue(), PATIENCE)])
    assert reader.answer(ontology_page(7)) == ReadMap()
    assert reader.answer(MapPage(objects=(JAR,), facts=(), version=7, more=False)) is None
    assert reader.replica.version == 7
