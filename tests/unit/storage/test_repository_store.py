"""The Repository's file: what was acknowledged is there, whatever happened to the process."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.kernel.component import Ask, Input, Received, Send, Started
from somrs.kernel.durability import PendingMessage
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import AttributeType, Kind, ObjectType
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Consider,
    Considered,
    Define,
    Defined,
    Definitions,
    Event,
    History,
    MapPage,
    MapSubscribed,
    MergeObject,
    QueryMap,
    ReadEvents,
    ReadHistory,
    ReadMap,
    ReadOntology,
    Rejected,
    RenameObject,
    SubscribeMap,
    Undo,
    Updated,
    UpdateMap,
)
from somrs.repository.component import Repository
from somrs.runtime.host import Host
from somrs.storage.repository_store import repository_journal
from tests.support.examples import examples
from tests.support.keeper import Keeper
from tests.support.lab import REPOSITORY, contents, lab, request


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "repository.sqlite"


@pytest.fixture
def keeper(path: Path) -> Iterator[Keeper]:
    keeper = Keeper(path)
    yield keeper
    keeper.close()


def test_a_new_file_begins_with_what_is_given_and_is_gone_on_with(keeper: Keeper) -> None:
    ontology, map = lab()
    assert ([*keeper.contents.ontology], keeper.contents.map, keeper.contents.version) == ([*ontology], map, 0)
    keeper.ask(UpdateMap(situation="Jar1 isOn Table2"), Updated)
    keeper.restart(snapshot=True)
    assert ([*keeper.contents.ontology], [*keeper.contents.map.objects]) == ([*ontology], [*map.objects])
    assert keeper.contents.map.has_fact("isOn", ("Jar1", "Table2")), "not what was given at first"


@pytest.mark.parametrize("snapshot", [True, False])
def test_every_kind_of_change_and_definition_is_kept(keeper: Keeper, snapshot: bool) -> None:
    values: dict[str, float | str | bool] = {"PositionX": 1.1, "PositionY": 1 + 1e-9, "PositionZ": 0.0, "Label": "Krug „Ö“ \n"}
    bodies: list[Body] = [
        UpdateMap(changes=(ObjectAdded(Object(name="Jar9", type="Jar", values=values)),), situation="Jar9 isOn Table1"),
        UpdateMap(changes=(ValueSet("Robot1", "Working", False), ValueSet("Jar2", "Color", None))),
        UpdateMap(changes=(ObjectRemoved("Jar1"),)),
        UpdateMap(changes=(FactRemoved(Fact("isAdjacentTo", ("Room1", "Room2"))),)),
        Define(
            definitions=Definitions(
                attributes=(AttributeType(name="Smell", kind=Kind.TEXT),), types=(ObjectType(name="Tray", parent="Support"),)
            )
        ),
    ]
    for body in bodies:
        keeper.ask(body, Updated | Defined)  # type: ignore[arg-type]  # either
    contents_before = keeper.contents
    keeper.restart(snapshot=snapshot)
    contents_after = keeper.contents
    assert ([*contents_after.ontology], contents_after.map, contents_after.version) == ([*contents_before.ontology], contents_before.map, 5)
    assert (contents_after.changed_at, contents_after.defined_at, contents_after.answered) == (
        contents_before.changed_at,
        contents_before.defined_at,
        contents_before.answered,
    )


def test_what_was_answered_is_answered_again_after_a_restart(keeper: Keeper) -> None:
    situations = ["Jar1 isOn Table2", "Jar9 isOn Table2", "Jar2 isOn Table1"]
    first = [keeper.ask(UpdateMap(situation=situation), object, identity=situation) for situation in situations]
    keeper.ask(UpdateMap(situation="Jar1 isOn Table1 AND Jar2 isOn Table2"), Updated)
    keeper.restart()
    assert [keeper.ask(UpdateMap(situation=situation), object, identity=situation) for situation in situations] == first
    assert isinstance(first[1], Rejected)
    assert keeper.contents.version == 2
    assert keeper.contents.map.has_fact("isOn", ("Jar2", "Table2"))


def test_expected_versions_outlast_a_restart(keeper: Keeper) -> None:
    keeper.ask(UpdateMap(situation="Jar1 isOn Table2"), Updated)
    keeper.restart(snapshot=True)
    rejected = keeper.ask(UpdateMap(changes=(ValueSet("Jar1", "Color", "Red"),), expected_version=0), Rejected)
    assert "Jar1: changed in version 1" in rejected.problems[0]


def feed(keeper: Keeper, event: Input) -> list[Send]:
    return [effect for effect in keeper.effects(event) if isinstance(effect, Send)]


@pytest.mark.parametrize("snapshot", [True, False])
def test_followers_outlast_a_restart_with_what_they_were_not_told(keeper: Keeper, snapshot: bool) -> None:
    feed(keeper, Received(request(SubscribeMap(lease=90), sender="http://follower")))
    keeper.ask(UpdateMap(situation="Jar1 isOn Table2"), Updated)
    keeper.restart(snapshot=snapshot)
    waiting = [
        sent_message.message for sent_message in keeper.journaled.pending.messages.values() if isinstance(sent_message, PendingMessage)
    ]
    assert "MapChanged" in [type(message.body).__name__ for message in waiting if message.header.recipient == "http://follower"]
    greetings = [send.message for send in feed(keeper, Started(REPOSITORY)) if send.message.header.recipient == "http://follower"]
    assert [message.body for message in greetings] == [MapSubscribed(version=1, until=91.0)]


def test_history_is_told_newest_first(keeper: Keeper) -> None:
    updates = [UpdateMap(changes=(ValueSet("Jar1", "PositionX", float(n + 10)),), author=f"Robot{n}") for n in range(5)]
    for body in [*updates, UpdateMap(situation="Jar2 isOn Table2")]:
        keeper.ask(body, Updated)
    history = keeper.ask(ReadHistory(object="Jar1", limit=3), History)
    assert [(event.version, event.author) for event in history.events] == [(5, "Robot4"), (4, "Robot3"), (3, "Robot2")]
    assert [event.version for event in keeper.ask(ReadHistory(object="Table1"), History).events] == [6]
    assert keeper.ask(ReadHistory(object="Room1"), History).events == ()


# What is under way


@pytest.mark.parametrize("snapshot", [True, False])
@pytest.mark.parametrize(
    "body",
    [
        ReadHistory(object="Jar1"),
        ReadEvents(before=2),
        ReadMap(at_version=0),
        ReadOntology(at_version=0),
        Consider(change=Undo(version=1)),
    ],
)
def test_what_the_archive_is_to_say_is_asked_again_after_a_restart(keeper: Keeper, snapshot: bool, body: Body) -> None:
    keeper.ask(UpdateMap(situation="Jar1 isOn Table2"), Updated)
    expected = keeper.ask(body, object)
    (question,) = keeper.effects(Received(request(body, identity="urn:uuid:1")))
    assert isinstance(question, Ask)
    keeper.ask(UpdateMap(changes=(ValueSet("Jar2", "Color", "Red"),)), Updated)
    answers = [send.message for send in keeper.restart(snapshot=snapshot)]
    (answer,) = [message.body for message in answers if message.header.relates_to == "urn:uuid:1"]
    assert answer == (msgspec.structs.replace(expected, version=2) if isinstance(expected, Considered) else expected)
    assert keeper.journaled.pending.questions == {}


@pytest.mark.parametrize("snapshot", [True, False])
def test_an_undo_that_is_under_way_goes_on_after_a_restart(keeper: Keeper, snapshot: bool) -> None:
    keeper.ask(UpdateMap(situation="Jar1 isOn Table2"), Updated)
    (question,) = keeper.effects(Received(request(Undo(version=1), identity="urn:uuid:1")))
    assert isinstance(question, Ask)
    answers = [send.message for send in keeper.restart(snapshot=snapshot)]
    assert [message.body for message in answers if message.header.relates_to == "urn:uuid:1"] == [Updated(version=2)]
    assert keeper.contents.map == lab()[1]
    assert keeper.ask(Undo(version=1), Updated, identity="urn:uuid:1") == Updated(version=2), "it is done once"


def test_pages_of_the_past_are_of_their_version_whatever_comes_between(keeper: Keeper) -> None:
    pages = {0: keeper.ask(ReadMap(at_version=0), object)}
    for number in range(8):
        keeper.ask(UpdateMap(changes=(ValueSet("Jar1", "PositionX", float(number)),)), Updated)
        pages[number + 1] = keeper.ask(ReadMap(at_version=number + 1), MapPage)
    keeper.restart()
    assert {version: keeper.ask(ReadMap(at_version=version), MapPage) for version in pages} == pages


# On a node


def anonymous(body: Body, recipient: str, number: int = 0) -> Message:
    return Message(header=Header(sender=ANONYMOUS, recipient=recipient, message_id=message_id(repr(body), number)), body=body)


def test_what_is_only_read_is_not_kept_and_an_orderly_stop_leaves_nothing_to_be_done_again(path: Path) -> None:
    async def run(moved: bool) -> tuple[int, list[object]]:
        runtime, journal = Host(), repository_journal(path)
        await runtime.start()
        node = runtime.add_journaled(
            "/moved" if moved else "/repository", lambda address: Repository(address, contents()), journal, carry_out=journal.carry_out
        )
        number = int(moved)
        updated = await runtime.request(anonymous(UpdateMap(situation=f"Jar1 isOn Table{2 - number}"), node.address))
        entry_before = journal.disk.read(lambda db: db.execute("SELECT max(last) FROM entries").fetchone()[0]).result()
        reads: list[Body] = [
            ReadMap(), ReadMap(at_version=0), ReadOntology(), QueryMap(formula="Jar1 isOn ?Where"), ReadEvents(),
            ReadHistory(object="Jar1"), Consider(change=Undo(version=1)), Consider(change=RenameObject(name="Jar1", to="Krug")),
        ]  # fmt: skip
        answers = [await runtime.request(anonymous(body, node.address)) for body in reads]
        assert not any(isinstance(answer.body, Fault) for answer in answers)
        entry_after = journal.disk.read(lambda db: db.execute("SELECT max(last) FROM entries").fetchone()[0]).result()
        await runtime.stop()
        (entry_count,) = journal.disk.write_and_wait(lambda db: db.execute("SELECT count(*) FROM entries").fetchone())
        assert entry_count == 0
        journal.close()
        return entry_after - entry_before, [updated.body]

    assert asyncio.run(run(moved=False)) == (0, [Updated(version=1)])
    assert asyncio.run(run(moved=True)) == (0, [Updated(version=2)]), "it goes on at another address"


# Whatever is changed


NAMES = st.sampled_from(["Jar1", "Jar2", "Jar5", "Jar6"])
PLACES = st.sampled_from(["Table1", "Table2", "Jar2"])
CHANGES = st.one_of(
    st.builds(
        lambda name, kind: ObjectAdded(Object(name=name, type=kind, values={"PositionX": 0.0, "PositionY": 1.0, "PositionZ": 2.0})),
        NAMES,
        st.sampled_from(["Jar", "Can"]),
    ),
    st.builds(ObjectRemoved, NAMES),
    st.builds(ValueSet, NAMES, st.just("PositionX"), st.floats(-1e6, 1e6)),
    st.builds(ValueSet, NAMES, st.just("Label"), st.none() | st.text(max_size=5)),
    st.builds(lambda name, place: FactAdded(Fact("isOn", (name, place))), NAMES, PLACES),
    st.builds(lambda name, place: FactRemoved(Fact("isOn", (name, place))), NAMES, PLACES),
)
UPDATES = st.builds(
    lambda changes, situation: UpdateMap(changes=tuple(changes), situation=situation),
    st.lists(CHANGES, max_size=4),
    st.none() | st.builds(lambda name, place: f"{name} isOn {place}", NAMES, PLACES),
)
MERGES = st.builds(lambda name, into: MergeObject(name=name, into=into), NAMES, NAMES)
RESTARTS = st.sampled_from(["", "", "", "kill", "stop"])


@examples(40)
@given(st.lists(st.tuples(UPDATES | MERGES, RESTARTS), max_size=12))
def test_the_file_holds_the_map_and_history_adds_up_to_it(updates: list[tuple[UpdateMap | MergeObject, str]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        keeper = Keeper(Path(folder) / "repository.sqlite")
        merged: dict[str, str] = {}
        for update, restart in [*updates, (UpdateMap(), "kill")]:
            map_before, version = keeper.contents.map, keeper.contents.version
            answer = keeper.ask(update, object)
            if answer == Updated(version=version + 1):
                if isinstance(update, UpdateMap):
                    assert keeper.contents.map == plain(map_before, update, merged)
                    merged = {name: into for name, into in merged.items() if name not in keeper.contents.map.objects}
                else:
                    merged[update.name] = update.into
                    assert map_before.objects.keys() - keeper.contents.map.objects.keys() == {update.name}
            else:
                assert keeper.contents.map == map_before
            if restart:
                contents_before = keeper.contents
                keeper.restart(snapshot=restart == "stop")
                assert (keeper.contents.map, keeper.contents.changed_at) == (contents_before.map, contents_before.changed_at)
                assert (keeper.contents.version, keeper.contents.answered) == (contents_before.version, contents_before.answered)
        events: dict[int, Event] = {}
        for name in ("Jar1", "Jar2", "Jar5", "Jar6"):
            reply = keeper.ask(ReadHistory(object=name, limit=1000), object)
            events.update({event.version: event for event in reply.events} if isinstance(reply, History) else {})
        assert sorted(events) == list(range(1, keeper.contents.version + 1))
        sum_of_events = lab()[1].changed(change for version in sorted(events) for change in events[version].changes)
        assert sum_of_events == keeper.contents.map
        changed_at = {name: version for version in sorted(events) for name in changed_names(events[version])}
        assert changed_at == keeper.contents.changed_at
        keeper.close()


def changed_names(event: Event) -> list[str]:
    names: list[str] = []
    for change in event.changes:
        match change:
            case ObjectAdded(object):
                names.append(object.name)
            case ObjectRemoved(name) | ValueSet(name):
                names.append(name)
            case FactAdded(fact) | FactRemoved(fact):
                names += fact.arguments
    return [*names, *(merging.into for merging in event.merged)]


def plain(map: Map, update: UpdateMap, merged: Mapping[str, str]) -> Map:
    """What an update comes to, done change by change. A situation here is that one thing is on one other.

    `merged`: the object that a name which is lost stands for.
    """
    added = {change.object.name for change in update.changes if isinstance(change, ObjectAdded)}
    lost = {name for name in merged if name not in map.objects and name not in added}

    def current(name: str) -> str:
        return current(merged[name]) if name in lost else name

    def renamed(fact: Fact) -> Fact:
        return Fact(fact.relation, tuple(current(argument) for argument in fact.arguments))

    for change in update.changes:
        match change:
            case ObjectRemoved(name):
                map = map.changed([ObjectRemoved(current(name))])
            case ValueSet(name, path, value):
                map = map.changed([ValueSet(current(name), path, value)])
            case FactAdded(fact):
                map = map.changed([FactAdded(renamed(fact))])
            case FactRemoved(fact):
                map = map.changed([FactRemoved(renamed(fact))])
            case _:
                map = map.changed([change])
    if update.situation is not None:
        name, relation, place = update.situation.split()
        place_fact = renamed(Fact(relation, (name, place)))
        former = (fact for fact in map.facts("isOn") if fact.arguments[0] == place_fact.arguments[0])
        map = map.changed([*(FactRemoved(fact) for fact in former), FactAdded(place_fact)])
    return map
