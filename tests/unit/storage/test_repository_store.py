"""The Repository's file: what was acknowledged is there, whatever happened to the process."""

from __future__ import annotations

import sqlite3
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import UsageError
from somrs.kernel.component import Received, Started
from somrs.ontology.objects import Fact, FactAdded, FactRemoved, Map, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import AttributeType, Kind, ObjectType
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Define,
    Defined,
    Definitions,
    Event,
    History,
    MapSubscribed,
    ReadHistory,
    Rejected,
    SubscribeMap,
    Updated,
    UpdateMap,
)
from somrs.repository.component import Repository
from somrs.repository.entries import Contents, Handled, HistoryOf, Subscription
from somrs.runtime.virtual import World, at_once
from somrs.storage.repository_store import KIND, RepositoryStore
from tests.support.examples import examples
from tests.support.lab import CLIENT, REPOSITORY, lab, records, request, sent, tell


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "repository.sqlite"


@pytest.fixture
def store(path: Path) -> Iterator[RepositoryStore]:
    store = RepositoryStore.open(path)
    store.initialise(*lab())
    yield store
    store.close()


def loaded(store: RepositoryStore) -> Contents:
    contents = store.load()
    assert contents is not None
    return contents


def reopened(store: RepositoryStore) -> RepositoryStore:
    store.close()
    return RepositoryStore.open(store.path)


def carry(repository: Repository, store: RepositoryStore, message: Message, now: float = 1.0) -> list[object]:
    """Hand over a message and keep what is to be kept; what was said."""
    effects = repository.handle(Received(message), now)
    for entry in records(effects):
        store.record(entry)  # type: ignore[arg-type]  # a Repository records entries
    return sent(effects, object)


def test_a_new_file_holds_nothing_and_then_what_it_is_given(path: Path) -> None:
    store = RepositoryStore.open(path)
    assert store.load() is None
    ontology, map = lab()
    store.initialise(ontology, map)
    contents = loaded(reopened(store))
    assert ([*contents.ontology], contents.map, contents.version) == ([*ontology], map, 0)
    assert [*contents.map.objects] == [*map.objects]


def test_a_map_is_not_replaced_by_accident(store: RepositoryStore) -> None:
    with pytest.raises(UsageError, match="holds a map already"):
        store.initialise(*lab())


def test_every_kind_of_change_and_definition_is_kept(store: RepositoryStore) -> None:
    repository = Repository(REPOSITORY, loaded(store))
    values: dict[str, float | str | bool] = {"PositionX": 0.1, "PositionY": 1e-9, "PositionZ": 0.0, "Label": "Krug „Ö“ \n"}
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
        assert isinstance(carry(repository, store, request(body))[0], Updated | Defined)
    contents = loaded(reopened(store))
    kept = repository.contents
    assert ([*contents.ontology], contents.map, contents.version) == ([*kept.ontology], kept.map, 5)
    assert (contents.changed_at, contents.answered) == (kept.changed_at, kept.answered)


def test_what_was_answered_is_answered_again_after_a_restart(store: RepositoryStore) -> None:
    repository = Repository(REPOSITORY, loaded(store))
    moved, wrong = request(UpdateMap(situation="Jar1 isOn Table2")), request(UpdateMap(situation="Jar9 isOn Table2"))
    idle, defined = request(UpdateMap(situation="Jar2 isOn Table1")), request(Define(definitions=Definitions()))
    first = [carry(repository, store, message) for message in (moved, wrong, idle, defined)]
    carry(repository, store, request(UpdateMap(situation="Jar1 isOn Table1 AND Jar2 isOn Table2")))
    store = reopened(store)
    repository = Repository(REPOSITORY, loaded(store))
    assert [carry(repository, store, message) for message in (moved, wrong, idle, defined)] == first
    assert isinstance(first[1][0], Rejected)
    assert repository.contents.version == 2
    assert repository.contents.map.holds("isOn", ("Jar2", "Table2"))
    store.close()


def test_expected_versions_outlast_a_restart(store: RepositoryStore) -> None:
    carry(Repository(REPOSITORY, loaded(store)), store, request(UpdateMap(situation="Jar1 isOn Table2")))
    repository = Repository(REPOSITORY, loaded(reopened(store)))
    effects = tell(repository, UpdateMap(changes=(ValueSet("Jar1", "Color", "Red"),), expected_version=0))
    assert "Jar1: changed in version 1" in sent(effects, Rejected)[0].problems[0]


def test_followers_outlast_a_restart(store: RepositoryStore) -> None:
    repository = Repository(REPOSITORY, loaded(store))
    carry(repository, store, request(SubscribeMap(lease=60), sender="http://follower"))
    carry(repository, store, request(SubscribeMap(lease=90), sender="http://follower"))
    store.record(Subscription(address="http://gone", until=5.0))
    store.record(Subscription(address="http://gone", until=None))
    repository = Repository(REPOSITORY, loaded(reopened(store)))
    assert sent(repository.handle(Started(REPOSITORY), 2.0), MapSubscribed) == [MapSubscribed(version=0, until=91.0)]


def test_history_is_told_newest_first(store: RepositoryStore) -> None:
    world = World()
    world.add(REPOSITORY, Repository(REPOSITORY, loaded(store)), at_once(store.answer))
    asked = [UpdateMap(changes=(ValueSet("Jar1", "PositionX", float(n + 10)),), author=f"Robot{n}") for n in range(5)]
    for body in [*asked, UpdateMap(situation="Jar2 isOn Table2")]:
        world.send(request(body))
        world.run(1.0)
        for entry in world.records[REPOSITORY]:
            store.record(entry)  # type: ignore[arg-type]  # a Repository records entries
        world.records[REPOSITORY].clear()
    world.send(request(ReadHistory(object="Jar1", limit=3)))
    world.run(1.0)
    history = world.messages[-1].body
    assert isinstance(history, History)
    assert [(event.version, event.author) for event in history.events] == [(5, "Robot4"), (4, "Robot3"), (3, "Robot2")]
    assert [event.version for event in store.history("Table1", 10)] == [6]
    assert store.history("Nothing", 10) == ()


# Whatever is changed


NAMES = st.sampled_from(["Jar1", "Jar2", "Jar5", "Jar6"])
WHERE = st.sampled_from(["Table1", "Table2", "Jar2"])
CHANGES = st.one_of(
    st.builds(
        lambda name, kind: ObjectAdded(Object(name=name, type=kind, values={"PositionX": 0.0, "PositionY": 1.0, "PositionZ": 2.0})),
        NAMES,
        st.sampled_from(["Jar", "Can"]),
    ),
    st.builds(ObjectRemoved, NAMES),
    st.builds(ValueSet, NAMES, st.just("PositionX"), st.floats(-1e6, 1e6)),
    st.builds(ValueSet, NAMES, st.just("Label"), st.none() | st.text(max_size=5)),
    st.builds(lambda name, where: FactAdded(Fact("isOn", (name, where))), NAMES, WHERE),
    st.builds(lambda name, where: FactRemoved(Fact("isOn", (name, where))), NAMES, WHERE),
)
UPDATES = st.builds(
    lambda changes, situation: UpdateMap(changes=tuple(changes), situation=situation),
    st.lists(CHANGES, max_size=4),
    st.none() | st.builds(lambda name, where: f"{name} isOn {where}", NAMES, WHERE),
)


@examples(40)
@given(st.lists(UPDATES, max_size=12))
def test_the_file_holds_the_map_and_history_adds_up_to_it(updates: list[UpdateMap]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        store = RepositoryStore.open(Path(folder) / "repository.sqlite")
        store.initialise(*lab())
        repository = Repository(REPOSITORY, loaded(store))
        for update in updates:
            before, version = repository.contents.map, repository.contents.version
            (answer, *_) = carry(repository, store, request(update))
            if answer == Updated(version=version + 1):
                assert repository.contents.map == plain(before, update)
            else:
                assert repository.contents.map == before
        store = reopened(store)
        assert loaded(store).map == repository.contents.map
        assert loaded(store).changed_at == repository.contents.changed_at
        events: dict[int, Event] = {}
        for name in ("Jar1", "Jar2", "Jar5", "Jar6"):
            events.update({event.version: event for event in store.history(name, 1000)})
        assert sorted(events) == list(range(1, repository.contents.version + 1))
        sum_of_events = lab()[1].changed(change for version in sorted(events) for change in events[version].changes)
        assert sum_of_events == repository.contents.map
        store.close()


def plain(map: Map, update: UpdateMap) -> Map:
    """What an update comes to, done change by change. A situation here is that one thing is on one other."""
    for change in update.changes:
        map = map.changed([change])
    if update.situation is not None:
        name, _, where = update.situation.split()
        map = map.changed(
            [*(FactRemoved(fact) for fact in map.facts("isOn") if fact.arguments[0] == name), FactAdded(Fact("isOn", (name, where)))]
        )
    return map


# Accidents


def test_an_entry_that_cannot_be_kept_leaves_no_trace(store: RepositoryStore) -> None:
    changes = (ValueSet("Jar1", "Color", "Red"), ValueSet("Nobody", "Color", "Red"))
    event = Event(version=1, at=1.0, author="", changes=changes)
    with pytest.raises(UsageError, match="Nobody"):
        store.record(Handled(request="urn:uuid:1", answer=Updated(version=1), event=event))
    contents = loaded(store)
    assert (contents.version, contents.answered, contents.map) == (0, {}, lab()[1])


def test_one_process_at_a_time_has_the_file(store: RepositoryStore) -> None:
    with pytest.raises(UsageError, match="in use by another process"):
        RepositoryStore.open(store.path)


def test_a_file_that_is_no_database_is_refused_and_left_alone(path: Path) -> None:
    path.write_text("objects:\n  Jar1: {type: Jar}\n" * 100)
    before = path.read_bytes()
    with pytest.raises(UsageError, match="not a Repository's file"):
        RepositoryStore.open(path)
    assert path.read_bytes() == before


def test_a_database_of_somebody_else_is_refused_and_left_alone(path: Path) -> None:
    with sqlite3.connect(path) as other:
        other.execute("CREATE TABLE objects (name TEXT)")
    other.close()
    before = path.read_bytes()
    with pytest.raises(UsageError, match="not a Repository's"):
        RepositoryStore.open(path)
    assert path.read_bytes() == before


def test_a_file_of_another_format_is_refused(path: Path) -> None:
    RepositoryStore.open(path).close()
    with sqlite3.connect(path) as other:
        assert other.execute("PRAGMA application_id").fetchone() == (KIND.application,)
        other.execute(f"PRAGMA user_version = {KIND.version + 1}")
    other.close()
    with pytest.raises(UsageError, match=f"has format {KIND.version + 1}"):
        RepositoryStore.open(path)


def test_a_damaged_file_is_said_to_be_damaged(store: RepositoryStore) -> None:
    store.close()
    data = bytearray(store.path.read_bytes())
    data[4096:] = b"\x5a" * (len(data) - 4096)
    store.path.write_bytes(bytes(data))
    with pytest.raises(UsageError, match="damaged"):
        RepositoryStore.open(store.path).load()


def test_a_document_that_is_none_is_said_to_be_damaged(store: RepositoryStore) -> None:
    store.close()
    with sqlite3.connect(store.path) as other:
        other.execute("UPDATE objects SET document = '{\"name\": 1}' WHERE name = 'Jar1'")
    other.close()
    with pytest.raises(UsageError, match="put a copy back"):
        RepositoryStore.open(store.path).load()


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no folder"):
        RepositoryStore.open(tmp_path / "nowhere" / "repository.sqlite")


def test_a_store_answers_for_histories_only(store: RepositoryStore) -> None:
    assert store.answer(HistoryOf(object="Jar1", limit=1)) == ()
    with pytest.raises(UsageError, match="Fault"):
        store.answer(Fault(code="Sender", text=CLIENT))
