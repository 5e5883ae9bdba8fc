"""A Repository, message by message: what exactly it answers, asks of its archive and tells its followers."""

from __future__ import annotations

import pytest
from msgspec import json, structs

from somrs.kernel.component import Answered, Ask, DeliveryFailed, ErrorAnswer, Input, Received, Record, Send, SetTimer, Started
from somrs.kernel.subscription import Subscription
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object, ValueSet
from somrs.ontology.types import AttributeType, Kind, ObjectType
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Discover
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Define,
    Defined,
    Definitions,
    Event,
    Events,
    History,
    MapChanged,
    MapPage,
    MapSubscribed,
    OntologyChanged,
    OntologyPage,
    QueryMap,
    ReadEvents,
    ReadHistory,
    ReadMap,
    ReadOntology,
    Rejected,
    Rows,
    SubscribeMap,
    Undo,
    Updated,
    UpdateMap,
)
from somrs.protocol.messages.paging import PAGE_BYTES
from somrs.repository import component, map_answers
from somrs.repository.component import Repository, only_reads
from somrs.repository.pages import map_page, ontology_page
from somrs.repository.state import ArchivedEvents, Contents, DefinitionChange, EventsOf, HistoryOf, LeasesDue, PageOf
from tests.support.lab import CLIENT, REPOSITORY, ask, contents, deliver_request, lab, records, request, sent_bodies

FOLLOWER, SECOND = "http://here/follower", "http://here/second"
RED, BLUE = ValueSet("Jar1", "Color", "Red"), ValueSet("Jar1", "Color", "Blue")
CRATE = ObjectType(name="Crate", parent="Jar")


@pytest.fixture
def repository() -> Repository:
    return Repository(REPOSITORY, contents())


def archive_task(repository: Repository, body: Body) -> object:
    """What the archive is asked."""
    [question] = deliver_request(repository, body)
    assert isinstance(question, Ask)
    return question.task


def archived(repository: Repository, body: Body, value: object) -> Body:
    """What is answered when the archive answered."""
    [question] = deliver_request(repository, body)
    assert isinstance(question, Ask)
    [answer] = repository.handle(Answered(question.question, value), 5.0)
    assert isinstance(answer, Send)
    return answer.message.body


@pytest.mark.parametrize(
    ("question", "task"),
    [
        (ReadHistory(object="Jar1", limit=2), HistoryOf(object="Jar1", limit=3)),
        (ReadHistory(object="Jar1", limit=0, before=7), HistoryOf(object="Jar1", limit=2, before=7)),
        (ReadHistory(object="Jar1", limit=2000), HistoryOf(object="Jar1", limit=1001)),
        (ReadEvents(limit=3), EventsOf(limit=4)),
        (ReadEvents(limit=5000, before=7), EventsOf(limit=1001, before=7)),
        (ReadEvents(limit=-1, after=7, ontology=True, brief=True), EventsOf(limit=2, after=7, ontology=True, brief=True)),
        (Undo(version=3), EventsOf(limit=1, before=4)),
    ],
)
def test_what_the_archive_is_asked(repository: Repository, question: Body, task: object) -> None:
    assert archive_task(repository, question) == task


@pytest.mark.parametrize("question", [ReadMap(at_version=2), ReadOntology(at_version=2), ReadMap(at_version=1), ReadMap(at_version=3)])
def test_a_page_of_the_past_is_the_archives(question: ReadMap | ReadOntology) -> None:
    repository_contents = contents()
    repository_contents.version, repository_contents.since = 3, 1
    assert question.at_version is not None
    expected = PageOf(
        question=question, at_version=question.at_version, version=3, map=repository_contents.map, ontology=repository_contents.ontology
    )
    repository = Repository(REPOSITORY, repository_contents)
    assert archive_task(repository, question) == expected
    page = MapPage(objects=(), facts=(), version=2, more=False)
    assert archived(repository, question, page) == page


@pytest.mark.parametrize(
    ("first_version", "at_version", "text"),
    [
        (0, 4, "the map and the ontology are known up to version 3; version 4 is none of these"),
        (0, -1, "the map and the ontology are known up to version 3; version -1 is none of these"),
        (2, 1, "the map and the ontology are known up to version 3, from version 2 on; version 1 is none of these"),
    ],
)
def test_a_version_that_is_not_known_is_a_fault(first_version: int, at_version: int, text: str) -> None:
    repository_contents = contents()
    repository_contents.version, repository_contents.since = 3, first_version
    assert ask(Repository(REPOSITORY, repository_contents), ReadMap(at_version=at_version), Fault) == Fault(code="Sender", text=text)


def test_events_are_told_in_one_direction(repository: Repository) -> None:
    fault = Fault(code="Sender", text="events are read either before a version or after one: give one of the two")
    assert ask(repository, ReadEvents(before=3, after=1), Fault) == fault


def test_what_the_archive_answered_is_told(repository: Repository) -> None:
    events = tuple(Event(version=version, at=1.0, author="a", changes=(RED,)) for version in (3, 2, 1))
    assert archived(repository, ReadEvents(limit=2), ArchivedEvents(events)) == Events(events=events[:2], more=True, since=0)
    assert archived(repository, ReadEvents(limit=3), ArchivedEvents(events)) == Events(events=events, more=False, since=0)
    assert archived(repository, ReadHistory(object="Jar1"), ArchivedEvents(events)) == History(object="Jar1", events=events)
    assert archived(repository, ReadHistory(object="Jar1"), ArchivedEvents(())) == History(object="Jar1", events=())
    assert archived(repository, ReadHistory(object="Gone"), ArchivedEvents(events)) == History(object="Gone", events=events)
    page = OntologyPage(definitions=Definitions(), version=0, next=0, more=False)
    assert archived(repository, ReadOntology(at_version=0), page) == page


@pytest.mark.parametrize(("name", "hint"), [("Jar9", " did you mean Jar2 or Jar1?"), ("Qqqq", "")])
def test_there_is_no_history_of_what_never_was(repository: Repository, name: str, hint: str) -> None:
    fault = Fault(code="Sender", text=f"there never was an object {name} on the map.{hint}")
    assert archived(repository, ReadHistory(object=name), ArchivedEvents(())) == fault


@pytest.mark.parametrize(
    ("question", "text"),
    [
        (ReadHistory(object="Jar1"), "the history of Jar1 cannot be read: disk gone"),
        (ReadEvents(), "the archive cannot be read: disk gone"),
        (ReadMap(at_version=0), "the archive cannot be read: disk gone"),
    ],
)
def test_a_broken_archive_is_the_receivers_fault(repository: Repository, question: Body, text: str) -> None:
    assert archived(repository, question, ErrorAnswer("disk gone")) == Fault(code="Receiver", text=text)


@pytest.mark.parametrize(
    ("first_version", "found_version", "version", "text"),
    [
        (0, None, 5, "there is no version 5 that could be undone; the latest is 2"),
        (0, 1, 2, "there is no version 2 that could be undone; the latest is 2"),
        (0, None, 0, "there is no version 0 that could be undone; the latest is 2"),
        (1, 1, 1, "version 1 cannot be undone: history is stored only from version 2 on"),
    ],
)
def test_what_cannot_be_undone_says_why(
    repository: Repository, first_version: int, found_version: int | None, version: int, text: str
) -> None:
    deliver_request(repository, UpdateMap(changes=(RED,)))
    deliver_request(repository, UpdateMap(changes=(BLUE,)))
    repository.contents.since = first_version
    events = (Event(version=found_version, at=1.0, author="a", changes=(RED,)),) if found_version is not None else ()
    answer = archived(repository, Undo(version=version), ArchivedEvents(events))
    assert isinstance(answer, Rejected)
    assert (answer.problems, answer.version) == ((text,), 2)
    assert [(rule.subject, rule.rule) for rule in answer.broken] == [(f"version {version}", "unknown-version")]


def test_what_is_undone_is_a_change_that_says_of_what(repository: Repository) -> None:
    deliver_request(repository, UpdateMap(changes=(RED,), author="Robot1"))
    [event] = records(deliver_request(repository, UpdateMap(changes=(BLUE,), author="Robot1"), 2.0))
    [question] = deliver_request(repository, Undo(version=2))
    assert isinstance(question, Ask)
    assert isinstance(event, Event)
    record, answer = repository.handle(Answered(question.question, ArchivedEvents((event,))), 3.0)
    assert record == Record(Event(version=3, at=3.0, author=CLIENT, changes=(RED,), undoes=2, before=(BLUE,)))
    assert isinstance(answer, Send)
    assert answer.message.body == Updated(version=3)
    assert sent_bodies(repository.handle(Answered(question.question, ArchivedEvents((event,))), 4.0), object) == [Updated(version=3)], (
        "once"
    )


def test_an_author_is_who_says_so_or_else_the_sender(repository: Repository) -> None:
    for author, expected_author in (("Robot1", "Robot1"), ("", CLIENT)):
        change = RED if author else BLUE
        [event] = records(deliver_request(repository, UpdateMap(changes=(change,), author=author)))
        assert isinstance(event, Event)
        assert event.author == expected_author


def test_it_is_noted_when_what_changed(repository: Repository) -> None:
    assert ask(repository, Define(definitions=Definitions(types=(CRATE,)), author="Robot1"), Defined) == Defined(version=1)
    deliver_request(repository, UpdateMap(changes=(RED,)))
    repository_contents = repository.contents
    assert (repository_contents.version, repository_contents.changed_at, repository_contents.ontology_changed_at) == (2, {"Jar1": 2}, 1)
    assert [*repository_contents.defined_at.values()] == [{"Crate": DefinitionChange(version=1, author="Robot1")}]
    assert contents().ontology_changed_at == 0


def test_only_so_many_answers_are_remembered(repository: Repository, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(component, "REMEMBERED", 2)
    messages = [request(UpdateMap(changes=(change,))) for change in (RED, BLUE, RED)]
    for message in messages:
        repository.handle(Received(message), 0.0)
    assert list(repository.contents.answered) == [message.header.message_id for message in messages[1:]]


@pytest.mark.parametrize(
    ("limit", "row_count", "is_truncated"), [(-1, 0, True), (0, 0, True), (1, 1, True), (2, 2, False), (5000, 2, False)]
)
def test_a_query_tells_as_much_as_is_wanted(repository: Repository, limit: int, row_count: int, is_truncated: bool) -> None:
    rows = ask(repository, QueryMap(formula="?Thing: Jar isOn Table1", limit=limit), Rows)
    assert (len(rows.rows), rows.more, rows.version) == (row_count, is_truncated, 0)


def test_a_query_never_tells_more_than_the_most(repository: Repository, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_answers, "MOST_ROWS", 1)
    rows = ask(repository, QueryMap(formula="?Thing: Jar isOn Table1", limit=2), Rows)
    assert (len(rows.rows), rows.more) == (1, True)


def test_followers_are_told_until_their_lease_is_over_by_messages_with_ids_of_their_own(repository: Repository) -> None:
    effects = deliver_request(repository, SubscribeMap(lease=10.0), 0.0, sender=FOLLOWER)
    assert sent_bodies(effects, object) == [MapSubscribed(version=0, until=10.0)]
    assert effects[-1] == SetTimer(LeasesDue(), 10.0)
    assert deliver_request(repository, SubscribeMap(lease=20.0), 0.0, sender=SECOND)[-1] == SetTimer(LeasesDue(), 10.0)
    _, _, *notifications = deliver_request(repository, UpdateMap(changes=(RED,), author="a"), 10.0)
    news = MapChanged(event=Event(version=1, at=10.0, author="a", changes=(RED,)))
    identity = message_id(REPOSITORY, SECOND, "MapChanged", 1, "")
    assert notifications == [Send(Message(header=Header(sender=REPOSITORY, recipient=SECOND, message_id=identity), body=news))]
    [defined] = deliver_request(repository, Define(definitions=Definitions(types=(CRATE,))), 11.0)[2:]
    assert isinstance(defined, Send)
    assert defined.message.body == OntologyChanged(definitions=Definitions(types=(CRATE,)), version=2)


def test_who_comes_up_tells_its_followers_where_it_is_from_its_new_address(repository: Repository) -> None:
    deliver_request(repository, SubscribeMap(lease=10.0), 0.0, sender=FOLLOWER)
    elsewhere = "http://there/repository"
    identity = message_id(elsewhere, FOLLOWER, "MapSubscribed", 0, 3.0)
    header = Header(sender=elsewhere, recipient=FOLLOWER, message_id=identity)
    assert repository.handle(Started(elsewhere), 3.0) == [
        Send(Message(header=header, body=MapSubscribed(version=0, until=10.0))),
        SetTimer(LeasesDue(), 10.0),
    ]
    [answer] = deliver_request(repository, ReadMap())
    assert isinstance(answer, Send)
    assert answer.message.header.sender == elsewhere


@pytest.mark.parametrize(
    ("body", "dropped"),
    [
        (MapChanged(event=Event(version=4, at=0.0, author="a", changes=())), True),
        (MapChanged(event=Event(version=3, at=0.0, author="a", changes=())), False),
        (OntologyChanged(definitions=Definitions(), version=4), True),
        (OntologyChanged(definitions=Definitions(), version=3), False),
        (MapSubscribed(version=4, until=1.0), True),
        (MapSubscribed(version=3, until=1.0), False),
        (Updated(version=4), False),
    ],
)
def test_who_cannot_be_told_is_dropped_unless_it_subscribed_since(body: Body, dropped: bool) -> None:
    repository_contents = contents()
    repository_contents.version = 9
    repository_contents.subscriptions = {FOLLOWER: Subscription(until=20.0, version=3), SECOND: Subscription(until=30.0, version=3)}
    repository = Repository(REPOSITORY, repository_contents)
    lost = Message(header=Header(sender=REPOSITORY, recipient=FOLLOWER, message_id="urn:x"), body=body)
    assert repository.handle(DeliveryFailed(lost, "r"), 1.0) == ([SetTimer(LeasesDue(), 30.0)] if dropped else [])
    assert list(repository_contents.subscriptions) == ([SECOND] if dropped else [FOLLOWER, SECOND])
    stranger = Message(header=structs.replace(lost.header, recipient="http://stranger"), body=body)
    assert repository.handle(DeliveryFailed(stranger, "r"), 1.0) == []


def test_what_it_does_not_understand(repository: Repository) -> None:
    assert ask(repository, Discover(), Fault) == Fault(
        code="ActionNotSupported",
        text="a Repository does not understand Discover; it reads, queries, updates and follows maps and ontologies",
    )
    assert ask(repository, SubscribeMap(lease=60), Fault, sender=ANONYMOUS) == Fault(
        code="Sender", text="changes can only be sent to a client that has an address: set the sender to one that can be reached"
    )
    assert repository.open == []


def received_request(body: Body, reply_to: str) -> Input:
    return Received(Message(header=Header(sender=CLIENT, recipient=REPOSITORY, message_id="urn:x", reply_to=reply_to), body=body))


@pytest.mark.parametrize(
    ("event", "reads"),
    [
        (received_request(ReadMap(), ANONYMOUS), True),
        (received_request(ReadEvents(), ANONYMOUS), True),
        (received_request(QueryMap(formula=""), ANONYMOUS), True),
        (received_request(ReadMap(), CLIENT), False),
        (received_request(UpdateMap(), ANONYMOUS), False),
        (Started(REPOSITORY), False),
    ],
)
def test_which_requests_only_read(event: Input, reads: bool) -> None:
    assert only_reads(event) is reads


# Pages


def test_the_ontology_by_pages() -> None:
    ontology, _ = lab()
    definitions = list(ontology)
    page = ontology_page(ontology, 3, len(definitions) - 2, 2)
    assert (page.version, page.next, page.more, page.changed_at) == (3, len(definitions), False, 2)
    assert list(page.definitions.all_definitions()) == definitions[-2:]
    assert ontology_page(ontology, 3, -5, 2) == ontology_page(ontology, 3, 0, 2)
    large_ontology = ontology.extended(AttributeType(name=f"Smell{number}", kind=Kind.TEXT) for number in range(200))
    first = ontology_page(large_ontology, 3, 0, 2)
    assert (first.more, first.next, len(list(first.definitions.all_definitions()))) == (True, 200, 200)
    second = ontology_page(large_ontology, 3, 200, 2)
    assert [*first.definitions.all_definitions(), *second.definitions.all_definitions()] == list(large_ontology)
    assert (second.more, second.next) == (False, len(list(large_ontology)))
    assert ontology_page(ontology, 3, len(definitions), 2) == OntologyPage(
        definitions=Definitions(), version=3, next=len(definitions), more=False, changed_at=2
    )


def test_the_map_by_pages() -> None:
    size = PAGE_BYTES // 2 - 200
    objects = [Object(name=name, type="Jar", values={"Label": "x" * size}) for name in ("C", "A", "B")]
    facts = [Fact("isLit", ()), Fact("isOn", ("A", "B")), Fact("isOn", ("C", "B")), Fact("isNear", ("A", "C"))]
    map = Map(objects, facts)
    first, second = map_page(map, 4, ""), map_page(map, 4, "B")
    assert [map_object.name for map_object in first.objects] == ["A", "B"]
    assert (first.facts[0], set(first.facts[1:])) == (facts[0], {facts[1], facts[3]})
    assert (first.version, first.more) == (4, True)
    assert second == MapPage(objects=(objects[0],), facts=(facts[2],), version=4, more=False)
    assert map_page(map, 4, "Aa") == MapPage(objects=(objects[2], objects[0]), facts=(facts[2],), version=4, more=False)
    assert map_page(map, 4, "C") == MapPage(objects=(), facts=(), version=4, more=False)


def test_what_changed_is_read_at_once(repository: Repository) -> None:
    page_before = ask(repository, ReadMap(), MapPage)
    deliver_request(repository, UpdateMap(changes=(RED,)))
    page_after = ask(repository, ReadMap(), MapPage)
    assert (page_before.version, page_after.version) == (0, 1)
    assert [map_object.values.get("Color") for map_object in page_after.objects if map_object.name == "Jar1"] == ["Red"]


def test_news_that_are_a_little_larger_than_a_page_are_told_as_they_are() -> None:
    def news_body(length: int) -> Body:
        repository = Repository(REPOSITORY, Contents(ontology=lab()[0], map=lab()[1]))
        deliver_request(repository, SubscribeMap(lease=10.0), sender=FOLLOWER)
        [news] = deliver_request(repository, UpdateMap(changes=(ValueSet("Jar1", "Label", "x" * length),), author="a"))[2:]
        assert isinstance(news, Send)
        return news.message.body

    small = news_body(1)
    assert isinstance(small, MapChanged)
    room = int(PAGE_BYTES * 1.25) - len(json.encode(small)) + 1
    assert isinstance(news_body(room), MapChanged)
    assert news_body(room + 1) == MapSubscribed(version=1, until=10.0)
