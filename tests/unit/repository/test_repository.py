"""The Repository: what it answers, what it takes in, what it tells those who follow it."""

from __future__ import annotations

import msgspec
import pytest

from somrs.kernel.component import Answered, Ask, DeliveryFailed, Received, Record, Send, SetTimer, Started, TimerFired
from somrs.kernel.subscription import Subscription
from somrs.ontology.conformance import violations
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Section
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType, Value
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Discover, Discovered
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Define,
    Defined,
    Definitions,
    Event,
    History,
    MapChanged,
    MapPage,
    MapSubscribed,
    OntologyChanged,
    OntologyPage,
    QueryMap,
    ReadHistory,
    ReadMap,
    ReadOntology,
    Rejected,
    Row,
    Rows,
    SubscribeMap,
    Updated,
    UpdateMap,
)
from somrs.protocol.messages.observations import Observation
from somrs.repository.component import Repository
from somrs.repository.state import ArchivedEvents, Contents, HistoryOf, LeasesDue
from tests.support.lab import CLIENT, REPOSITORY, SITE, ask, contents, deliver_request, lab, records, request, sent_bodies

JAR = Object(name="Jar9", type="Jar", values={"PositionX": 1.0, "PositionY": 1.1, "PositionZ": 0.7})


@pytest.fixture
def repository() -> Repository:
    return Repository(REPOSITORY, contents())


def update(repository: Repository, *changes: Change, situation: str | None = None, expected: int | None = None, now: float = 1.0) -> Body:
    """The answer to an update."""
    effects = deliver_request(repository, UpdateMap(changes=changes, situation=situation, expected_version=expected, author="test"), now)
    (answer,) = [effect.message.body for effect in effects if isinstance(effect, Send) and effect.message.header.recipient == CLIENT]
    return answer


def problems(repository: Repository, *changes: Change, situation: str | None = None, expected: int | None = None) -> str:
    """Why an update is rejected; and that it left no trace."""
    map_before, version = repository.contents.map, repository.contents.version
    answer = update(repository, *changes, situation=situation, expected=expected)
    assert isinstance(answer, Rejected), answer
    assert (repository.contents.map, repository.contents.version) == (map_before, version)
    return "\n".join(answer.problems)


def read_map(repository: Repository) -> tuple[list[MapPage], Map]:
    pages = [ask(repository, ReadMap(), MapPage)]
    while pages[-1].more:
        pages.append(ask(repository, ReadMap(after=pages[-1].objects[-1].name), MapPage))
    return pages, Map([o for page in pages for o in page.objects], [f for page in pages for f in page.facts])


# Reading and asking


def test_what_is_read_page_by_page_is_the_ontology_and_the_map(repository: Repository) -> None:
    pages = [ask(repository, ReadOntology(), OntologyPage)]
    while pages[-1].more:
        pages.append(ask(repository, ReadOntology(after=pages[-1].next), OntologyPage))
    assert [*Ontology([d for page in pages for d in page.definitions.all_definitions()])] == [*repository.contents.ontology]
    assert read_map(repository)[1] == repository.contents.map


def test_a_large_map_comes_in_pages_that_a_node_accepts() -> None:
    ontology, small_map = contents().ontology, contents().map
    jars = [Object(name=f"Jar-{n}", type="Jar", values={**JAR.values, "Label": "x" * (n % 300)}) for n in range(3000)]
    map = small_map.changed([*map_of(jars), *(FactAdded(Fact("isOn", (jar.name, "Table2"))) for jar in jars)])
    repository = Repository(REPOSITORY, Contents(ontology=ontology, map=map))
    pages, read = read_map(repository)
    assert read == map
    assert all(len(page.objects) <= 200 and len(msgspec.json.encode(page)) < 50_000 for page in pages)
    assert len(pages) < 60


def map_of(objects: list[Object]) -> list[Change]:
    return [ObjectAdded(object) for object in objects]


def test_a_query_gives_every_way_in_which_it_holds(repository: Repository) -> None:
    rows = ask(repository, QueryMap(formula="?Thing: Jar isOn ?Where"), Rows)
    assert [row.bindings for row in rows.rows] == [{"Thing": "Jar1", "Where": "Table1"}, {"Thing": "Jar2", "Where": "Table1"}]
    assert (rows.more, rows.version) == (False, 0)
    assert ask(repository, QueryMap(formula="Jar1 isOn Table1"), Rows).rows[0].bindings == {}
    assert ask(repository, QueryMap(formula="Jar1 isOn Table2"), Rows).rows == ()


def test_a_query_says_when_there_is_more_than_it_may_tell(repository: Repository) -> None:
    rows = ask(repository, QueryMap(formula="?Thing: Jar isOn ?Where", limit=1), Rows)
    assert len(rows.rows) == 1
    assert rows.more
    assert ask(repository, QueryMap(formula="?Thing: Jar isOn ?Where", limit=2), Rows).more is False


def test_a_promised_situation_is_read_without_being_made_so(repository: Repository) -> None:
    situation = "Jar1 isOn Table2 AND Table2.Color = Blue"
    assert ask(repository, QueryMap(formula="Jar1 isOn ?Where", situation=situation), Rows).rows == (Row(bindings={"Where": "Table2"}),)
    page = ask(repository, ReadMap(after="Table1", situation=situation), MapPage)
    assert next(object for object in page.objects if object.name == "Table2").values["Color"] == "Blue"
    assert ask(repository, QueryMap(formula="Jar1 isOn ?Where"), Rows).rows == (Row(bindings={"Where": "Table1"}),)
    ask(repository, UpdateMap(situation="Jar2 isOn Table2"), Updated)
    assert len(ask(repository, QueryMap(formula="?It: Jar isOn Table2", situation=situation), Rows).rows) == 2, "the map has changed since"


@pytest.mark.parametrize(
    ("question", "problem"),
    [
        (QueryMap(formula="Jar1 isOn ?Where", situation="Jar9 isOn Table2"), "Jar9"),
        (QueryMap(formula="Jar1 isOn ?Where", situation="Jar1 isOn Table2 OR Jar1 isOn Table1"), "OR"),
        (ReadMap(at_version=0, situation="Jar1 isOn Table2"), "not both"),
    ],
)
def test_a_situation_that_cannot_be_read(repository: Repository, question: QueryMap | ReadMap, problem: str) -> None:
    assert problem in ask(repository, question, Fault).text


@pytest.mark.parametrize(
    ("formula", "problem"),
    [("Jar1 isOn", "^"), ("Jar1 isOm Table1", "isOn"), ("Jar11 isOn Table1", "Jar1"), ("?Thing isOn Table1 AND", "ends too early")],
)
def test_a_query_that_is_none_is_a_fault_that_shows_the_place(repository: Repository, formula: str, problem: str) -> None:
    assert problem in ask(repository, QueryMap(formula=formula), Fault).text


# Updates


def test_a_situation_changes_what_it_says_and_what_follows_from_the_relations(repository: Repository) -> None:
    answer = update(repository, situation="Jar1 isOn Table2 AND Jar1.PositionX = 8 AND Jar1.PositionY = 8")
    assert answer == Updated(version=1)
    map = repository.contents.map
    assert map.has_fact("isOn", ("Jar1", "Table2"))
    assert not map.has_fact("isOn", ("Jar1", "Table1"))
    assert map.objects["Jar1"].values["PositionX"] == 8.0
    assert violations(map, repository.contents.ontology) == []


def test_a_person_puts_nothing_beside_what_it_is_on_and_a_report_says_what_was_measured(repository: Repository) -> None:
    """Seen with `somrs map update`: a jar was on a table that was elsewhere."""
    beside = "Jar1 isOn Table2 AND Jar1.PositionX = 8 AND Jar1.PositionY = 5"
    assert "Jar1: it is on Table2, and its position is" in problems(repository, situation=beside)
    answer = ask(repository, UpdateMap(situation=beside, author="Robot1", observation=Observation()), Updated)
    assert answer.version == 1


def test_an_update_is_recorded_before_it_is_answered_and_answered_before_it_is_told(repository: Repository) -> None:
    ask(repository, SubscribeMap(lease=60), MapSubscribed, sender="http://follower")
    message = request(UpdateMap(situation="Jar1 isOn Table2", author="Robot1"))
    record, answer, notification = repository.handle(Received(message), 5.0)
    changes = (FactRemoved(Fact("isOn", ("Jar1", "Table1"))), FactAdded(Fact("isOn", ("Jar1", "Table2"))))
    event = Event(version=1, at=5.0, author="Robot1", changes=changes)
    stored_event = msgspec.structs.replace(event, before=tuple(reversed([FactAdded(changes[0].fact), FactRemoved(changes[1].fact)])))
    assert record == Record(stored_event)
    assert isinstance(answer, Send)
    assert answer.message.body == Updated(version=1)
    assert isinstance(notification, Send)
    assert (notification.message.header.recipient, notification.message.body) == ("http://follower", MapChanged(event=event))


def test_single_changes_and_a_situation_are_one_update(repository: Repository) -> None:
    assert update(repository, ObjectAdded(JAR), situation="Jar9 isOn Table1") == Updated(version=1)
    assert repository.contents.map.has_fact("isOn", ("Jar9", "Table1"))


def test_everything_that_is_wrong_is_said_and_nothing_is_done(repository: Repository) -> None:
    problem_text = problems(
        repository,
        ValueSet("Jar1", "PositionX", 5.0),
        ValueSet("Jra2", "Color", "Red"),
        ObjectAdded(Object(name="Table1", type="Table")),
        FactRemoved(Fact("isAt0", ("Robot1", "Jar1"))),
    )
    assert "no object Jra2" in problem_text
    assert "Jar2" in problem_text
    assert "Table1: is on the map already" in problem_text
    assert "no relation is called isAt0" in problem_text


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ([ValueSet("Jar1", "Weight", 9.0)], "constraint"),
        ([ValueSet("Jar1", "Weight", "heavy")], "value"),
        ([ValueSet("Jar1", "Weight", float("nan"))], "value"),
        ([ValueSet("Jar1", "Wieght", 1.0)], "unknown-attribute"),
        ([ValueSet("Jar1", "PositionX", None)], "required"),
        ([ObjectAdded(Object(name="Thing1", type="Thing"))], "unknown-type"),
        ([FactAdded(Fact("isOn", ("Jar1", "Table2")))], "functional"),
        ([FactAdded(Fact("isHeldBy", ("Jar1", "Robot1")))], "exclusive"),
        ([FactAdded(Fact("isHeldBy", ("Jar1", "Table1")))], "relation-types"),
        ([FactAdded(Fact("isOn", ("Jar1", "Nowhere")))], "unknown-object"),
        ([ObjectRemoved("Jar1"), FactAdded(Fact("isOn", ("Jar1", "Table1")))], "unknown-object"),  # though the fact held before
        ([ObjectRemoved("Floor1")], "parts"),
        ([ObjectRemoved(name) for name in ("Floor1", "Room1", "Room2", "Storey1", "Building1")], "root"),
        ([FactRemoved(Fact("isPartOf", ("Room1", "Storey1")))], "root"),
        ([FactAdded(Fact("isPartOf", ("Building1", "Storey1")))], "cycle"),
    ],
)
def test_the_map_goes_on_obeying_its_types(repository: Repository, changes: list[Change], rule: str) -> None:
    assert f"[{rule}]" in problems(repository, *changes)


def test_a_situation_that_is_none_is_rejected(repository: Repository) -> None:
    assert "^" in problems(repository, situation="Jar1 isOn")
    assert "Table2" in problems(repository, situation="Jar1 isOn Tabel2")
    assert "?Where" in problems(repository, situation="Jar1 isOn ?Where")


@pytest.mark.parametrize("name", ["", "a b", "AND", "a.b", "?x", "1st", "Jar1 "])
def test_names_are_such_that_formulas_can_use_them(repository: Repository, name: str) -> None:
    assert "not a name that formulas can use" in problems(repository, ObjectAdded(msgspec.structs.replace(JAR, name=name)))
    answer = ask(repository, Define(definitions=Definitions(types=(ObjectType(name=name, parent="Jar"),))), Rejected)
    assert "not a name that formulas can use" in answer.problems[0]


def test_texts_are_such_that_messages_can_carry_them(repository: Repository) -> None:
    assert "U+0000" in problems(repository, situation='Jar1.Label = "a\\u0000b"')
    assert "U+D800" in problems(repository, ValueSet("Jar1", "Label", "\ud800"))
    assert "U+FFFF" in problems(repository, ObjectAdded(msgspec.structs.replace(JAR, values={**JAR.values, "Label": "\uffff"})))
    assert update(repository, ValueSet("Jar1", "Label", "Krug „Ö“ \n 🏺")) == Updated(version=1)


def test_many_problems_are_told_in_part(repository: Repository) -> None:
    problem_lines = problems(repository, *(ValueSet(f"Thing{n}", "Color", "Red") for n in range(200))).splitlines()
    assert len(problem_lines) == 51
    assert problem_lines[-1] == "and 150 more problems"


def test_an_update_that_changes_nothing_makes_no_version(repository: Repository) -> None:
    ask(repository, SubscribeMap(lease=60), MapSubscribed, sender="http://follower")
    assert update(repository, situation="Jar1 isOn Table1") == Updated(version=0)
    assert update(repository, ValueSet("Table2", "Color", "Red")) == Updated(version=0)
    assert update(repository, ObjectAdded(JAR), ObjectRemoved("Jar9")) == Updated(version=0)
    assert sent_bodies(deliver_request(repository, UpdateMap(situation="Jar1 isOn Table1")), MapChanged) == []


def test_what_is_removed_leaves_with_every_fact_about_it(repository: Repository) -> None:
    effects = deliver_request(repository, UpdateMap(changes=(ObjectRemoved("Jar1"),)))
    (event,) = records(effects)
    assert isinstance(event, Event)
    assert event.changes == (FactRemoved(Fact("isOn", ("Jar1", "Table1"))), ObjectRemoved("Jar1"))
    assert [*repository.contents.map.facts_about("Jar1")] == []


def test_what_is_said_of_two_is_taken_back_whichever_way_round(repository: Repository) -> None:
    assert update(repository, FactRemoved(Fact("isAdjacentTo", ("Room2", "Room1")))) == Updated(version=1)
    assert [*repository.contents.map.facts("isAdjacentTo")] == []


def test_an_object_may_be_replaced_by_one_of_another_type(repository: Repository) -> None:
    changes = (
        ObjectRemoved("Jar1"),
        ObjectAdded(msgspec.structs.replace(JAR, name="Jar1", type="Can")),
        FactAdded(Fact("isOn", ("Jar1", "Table1"))),
    )
    assert update(repository, *changes) == Updated(version=1)
    assert repository.contents.map.objects["Jar1"].type == "Can"
    assert repository.contents.map.has_fact("isOn", ("Jar1", "Table1"))


def test_a_repeated_message_is_answered_again_and_not_done_again(repository: Repository) -> None:
    first = request(UpdateMap(situation="Jar1 isOn Table2"))
    repeated_request = request(first.body, identity=first.header.message_id.upper().replace("URN:UUID", "uuid"))
    assert sent_bodies(repository.handle(Received(first), 1.0), Updated) == [Updated(version=1)]
    update(repository, situation="Jar1 isOn Table1")
    effects = repository.handle(Received(repeated_request), 2.0)
    assert sent_bodies(effects, Updated) == [Updated(version=1)]
    assert len(effects) == 1
    assert repository.contents.map.has_fact("isOn", ("Jar1", "Table1"))


def test_a_rejected_message_stays_rejected(repository: Repository) -> None:
    message = request(UpdateMap(situation="Jar9 isOn Table2"))
    assert sent_bodies(repository.handle(Received(message), 1.0), Rejected)
    update(repository, ObjectAdded(JAR))
    assert sent_bodies(repository.handle(Received(message), 2.0), Rejected)


def test_an_expected_version_holds_for_the_objects_that_are_touched(repository: Repository) -> None:
    assert update(repository, situation="Jar1 isOn Table2") == Updated(version=1)
    assert update(repository, ValueSet("Jar2", "Color", "Red"), expected=0) == Updated(version=2)
    assert "Jar1: changed in version 1" in problems(repository, ValueSet("Jar1", "Color", "Red"), expected=0)
    assert update(repository, ValueSet("Jar1", "Color", "Red"), expected=1) == Updated(version=3)
    assert "does not exist yet" in problems(repository, ValueSet("Jar1", "Color", "Blue"), expected=99)


# Definitions

TRAY = ObjectType(name="Tray", parent="Support")
FILL = ServiceType(name="Fill", inputs=(Parameter(name="Jar", type="Jar"),), effect='?Jar.Label = "full"')


def test_definitions_are_added_and_told(repository: Repository) -> None:
    ask(repository, SubscribeMap(lease=60), MapSubscribed, sender="http://follower")
    effects = deliver_request(repository, Define(definitions=Definitions(types=(TRAY,), services=(FILL,))))
    assert sent_bodies(effects, Defined) == [Defined(version=1)]
    assert sent_bodies(effects, OntologyChanged) == [OntologyChanged(definitions=Definitions(types=(TRAY,), services=(FILL,)), version=1)]
    assert isinstance(effects[0], Record)
    size: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": 0.5, "Shape.Depth": 0.4, "Shape.Height": 0.1}
    tray = Object(name="Tray1", type="Tray", values={"PositionX": 0.0, "PositionY": 0.0, "PositionZ": 0.0, **size})
    assert update(repository, ObjectAdded(tray)) == Updated(version=2)
    assert ask(repository, Define(definitions=Definitions(types=(TRAY,))), Defined) == Defined(version=2)


@pytest.mark.parametrize(
    ("definitions", "problem"),
    [
        (Definitions(types=(ObjectType(name="Tray", parent="Suport"),)), "Support"),
        (Definitions(services=(ServiceType(name="Fill", effect="?Jar isOm Table1"),)), "isOn"),
        (Definitions(types=(ObjectType(name="Jar", parent="Graspable", required=("Label",)),)), "Jar1: a Jar must have Label"),
        (Definitions(attributes=(AttributeType(name="Color", kind=Kind.NUMBER),)), "Color is a number"),
        (
            Definitions(relations=(RelationType(name="isAdjacentTo", joins=("Table", "Table"), symmetric=True),)),
            "isAdjacentTo needs a Table",
        ),
    ],
)
def test_definitions_that_break_the_ontology_or_the_map_are_rejected(
    repository: Repository, definitions: Definitions, problem: str
) -> None:
    definitions_before = [*repository.contents.ontology]
    with_good_one = msgspec.structs.replace(
        definitions, types=(*definitions.types, TRAY) if "Tray" not in str(definitions) else definitions.types
    )
    answer = ask(repository, Define(definitions=with_good_one), Rejected)
    assert problem in "\n".join(answer.problems)
    assert [*repository.contents.ontology] == definitions_before
    assert repository.contents.version == 0


# History


def test_history_comes_from_the_store(repository: Repository) -> None:
    message = request(ReadHistory(object="Jar1", limit=2))
    (question,) = repository.handle(Received(message), 1.0)
    assert isinstance(question, Ask)
    assert question.task == HistoryOf(object="Jar1", limit=3), "one more shows whether there are more"
    assert repository.handle(Received(message), 1.0) == [question], "it waits for the same answer"
    event = Event(version=3, at=1.0, author="Robot1", changes=(ValueSet("Jar1", "Color", "Red"),))
    effects = repository.handle(Answered(question.question, ArchivedEvents((event,))), 2.0)
    assert sent_bodies(effects, History) == [History(object="Jar1", events=(event,))]


def test_history_of_what_never_was_and_from_a_broken_store(repository: Repository) -> None:
    (question,) = deliver_request(repository, ReadHistory(object="Jra1"))
    assert isinstance(question, Ask)
    (fault,) = sent_bodies(repository.handle(Answered(question.question, ArchivedEvents(())), 2.0), Fault)
    assert "Jar1" in fault.text
    (question,) = deliver_request(repository, ReadHistory(object="Jar1"))
    assert isinstance(question, Ask)
    (fault,) = sent_bodies(repository.handle(Answered(question.question, OSError("disk gone")), 2.0), Fault)
    assert (fault.code, "disk gone" in fault.text) == ("Receiver", True)


# Following


def test_followers_hear_every_version_in_order_until_their_lease_ends(repository: Repository) -> None:
    effects = deliver_request(repository, SubscribeMap(lease=10), now=100.0, sender="http://follower")
    assert sent_bodies(effects, MapSubscribed) == [MapSubscribed(version=0, until=110.0)]
    assert effects[-1] == SetTimer(LeasesDue(), 110.0)
    versions = []
    for n in range(5):
        effects = deliver_request(repository, UpdateMap(changes=(ValueSet("Jar1", "PositionX", float(n)),)), now=101.0)
        versions += [news.event.version for news in sent_bodies(effects, MapChanged)]
    assert versions == [1, 2, 3, 4, 5]
    ended = repository.handle(TimerFired(LeasesDue()), 110.0)
    assert ended == [SetTimer(LeasesDue(), None)]
    assert sent_bodies(deliver_request(repository, UpdateMap(changes=(ValueSet("Jar1", "PositionX", 9.0),)), now=111.0), MapChanged) == []


def test_leases_are_kept_within_limits(repository: Repository) -> None:
    assert ask(repository, SubscribeMap(lease=0.01), MapSubscribed, now=100.0).until == 101.0
    assert ask(repository, SubscribeMap(lease=1e9), MapSubscribed, now=100.0).until == 3700.0
    for wrong in (0.0, -5.0, float("nan"), float("inf")):
        assert "lease" in ask(repository, SubscribeMap(lease=wrong), Fault).text


def test_a_follower_that_cannot_be_reached_is_dropped(repository: Repository) -> None:
    ask(repository, SubscribeMap(lease=600), MapSubscribed, sender="http://gone")
    ask(repository, SubscribeMap(lease=600), MapSubscribed, sender="http://there")
    send_effects = [e for e in deliver_request(repository, UpdateMap(situation="Jar1 isOn Table2")) if isinstance(e, Send)]
    lost = next(send.message for send in send_effects if send.message.header.recipient == "http://gone")
    repository.handle(DeliveryFailed(lost, "refused"), 31.0)
    send_effects = [e for e in deliver_request(repository, UpdateMap(situation="Jar1 isOn Table1")) if isinstance(e, Send)]
    assert [send.message.header.recipient for send in send_effects] == [CLIENT, "http://there"]


def test_a_follower_that_came_back_is_not_dropped_for_what_it_missed(repository: Repository) -> None:
    ask(repository, SubscribeMap(lease=600), MapSubscribed, sender="http://back")
    send_effects = [e for e in deliver_request(repository, UpdateMap(situation="Jar1 isOn Table2")) if isinstance(e, Send)]
    lost = send_effects[-1].message
    assert ask(repository, SubscribeMap(lease=600), MapSubscribed, sender="http://back").version == 1
    assert repository.handle(DeliveryFailed(lost, "refused"), 31.0) == []
    assert sent_bodies(deliver_request(repository, UpdateMap(situation="Jar1 isOn Table1")), MapChanged)


def test_a_change_too_large_for_a_message_is_announced_by_its_version(repository: Repository) -> None:
    ask(repository, SubscribeMap(lease=600), MapSubscribed, sender="http://follower")
    jars = tuple(ObjectAdded(Object(name=f"Jar-{n}", type="Jar", values=JAR.values)) for n in range(1000))
    effects = deliver_request(repository, UpdateMap(changes=jars))
    assert [news.version for news in sent_bodies(effects, MapSubscribed)] == [1]
    assert sent_bodies(effects, MapChanged) == []


def test_after_a_restart_followers_learn_where_the_repository_is() -> None:
    repository_contents = contents()
    repository_contents.version, repository_contents.subscriptions = 7, {"http://follower": Subscription(until=500.0, version=3)}
    effects = Repository(REPOSITORY, repository_contents).handle(Started(REPOSITORY), 100.0)
    assert sent_bodies(effects, MapSubscribed) == [MapSubscribed(version=7, until=500.0)]
    assert effects[-1] == SetTimer(LeasesDue(), 500.0)


def test_who_has_no_address_cannot_follow(repository: Repository) -> None:
    assert "address" in ask(repository, SubscribeMap(lease=60), Fault, sender=ANONYMOUS).text


# Manners


def test_what_is_no_business_of_a_repository_is_a_fault_and_faults_are_not_answered(repository: Repository) -> None:
    fault = ask(repository, Discover(), Fault)
    assert (fault.code, "Discover" in fault.text) == ("ActionNotSupported", True)
    assert sent_bodies(deliver_request(repository, Discovered(offers=())), Fault)
    assert deliver_request(repository, Fault(code="Sender", text="no")) == []


def test_answers_go_where_the_message_says(repository: Repository) -> None:
    header = Header(sender="http://a", recipient=REPOSITORY, message_id="urn:uuid:1", reply_to="http://b")
    (answer,) = repository.handle(Received(Message(header=header, body=ReadMap())), 0.0)
    assert isinstance(answer, Send)
    assert (answer.message.header.recipient, answer.message.header.relates_to) == ("http://b", "urn:uuid:1")


def test_the_laboratory_obeys_its_types() -> None:
    loaded = load_text(SITE, base=upper())
    assert loaded.map is not None
    assert violations(loaded.map, loaded.ontology) == []


def test_an_effect_with_or_is_refused_but_stays_where_an_earlier_version_accepted_it() -> None:
    ontology, map = lab()
    vague = ServiceType(name="Tidy", inputs=(Parameter(name="Jar", type="Jar"),), effect="?Jar isOn Table1 OR ?Jar isOn Table2")
    rejection = ask(Repository(REPOSITORY, contents()), Define(definitions=Definitions(services=(vague,)), author="Anna"), Rejected)
    [problem] = rejection.problems
    assert "an effect with OR does not say what becomes true" in problem
    repository = Repository(REPOSITORY, Contents(ontology=ontology.extended([vague]), map=map))
    crate = ObjectType(name="Crate", parent="Jar")
    assert ask(repository, Define(definitions=Definitions(types=(crate,)), author="Anna"), Defined)
    assert ask(repository, Define(definitions=Definitions(services=(vague,)), author="Anna"), Rejected).problems == (problem,)
    useless = Define(removed=(DefinitionKey(section=Section.TYPES, name="Jar"),), author="Anna")
    assert any("no type is called Jar" in problem for problem in ask(repository, useless, Rejected).problems)
