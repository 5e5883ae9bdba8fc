"""The replica: after whatever happened to messages and programs, it comes to be what the Repository has."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.kernel.component import DeliveryFailed, Effect, Input, Received, Send, SetTimer, Started, TimerFired
from somrs.kernel.following import GAP_TIME, LEASE
from somrs.kernel.replica import Replica, ReplicaDue, ReplicaUpdate
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import AttributeType, Kind
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.knowledge import Define, Definitions, MapPage, MergeObject, ReadMap, RenameObject, UpdateMap
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.virtual_time import World
from tests.support.examples import examples
from tests.support.lab import REPOSITORY, contents, deliver_request, request
from tests.support.unfair_medium import UnfairMedium

OWNER = "http://here/owner"


class Owner:
    """A component that has a replica and nothing else."""

    def __init__(self) -> None:
        self.replica = Replica(OWNER, REPOSITORY)
        self.news: list[ReplicaUpdate] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Started):
            return self.replica.start(now)
        news = self.replica.handle(event, now)
        if news is None:
            return []
        self.news.append(news)
        return news.effects


def has_same_contents(replica: Replica, repository: Repository) -> bool:
    repository_contents = repository.contents
    ontology = {definition.name: definition for definition in repository_contents.ontology}
    return (
        replica.map == repository_contents.map
        and replica.version == repository_contents.version
        and {d.name: d for d in replica.ontology} == ontology
    )


def many_jars(number: int) -> Contents:
    lab_contents = contents()
    values = {"PositionX": 8.0, "PositionY": 8.0, "PositionZ": 0.7}
    lab_contents.map = lab_contents.map.changed(
        ObjectAdded(Object(name=f"Jar-{n:04}", type="Jar", values={**values})) for n in range(number)
    )
    return lab_contents


def test_it_reads_everything_and_follows() -> None:
    world, owner, repository = World(), Owner(), Repository(REPOSITORY, many_jars(1000))
    world.add(REPOSITORY, repository)
    world.add(OWNER, owner)
    assert world.run(10.0, lambda: owner.replica.ready)
    assert has_same_contents(owner.replica, repository)
    assert [news.reloaded for news in owner.news][-1]
    world.send(request(UpdateMap(situation="Jar1 isOn Table2")))
    world.run(1.0)
    assert has_same_contents(owner.replica, repository)
    moved = (FactRemoved(Fact("isOn", ("Jar1", "Table1"))), FactAdded(Fact("isOn", ("Jar1", "Table2"))))
    assert owner.news[-1].changes == moved
    color = AttributeType(name="Smell", kind=Kind.TEXT)
    world.send(request(Define(definitions=Definitions(attributes=(color,)))))
    world.run(1.0)
    assert has_same_contents(owner.replica, repository)
    assert owner.news[-1].definitions == (color,)


def test_what_changes_while_pages_are_read_is_on_the_copy() -> None:
    """An update between any two messages of the reading; the first pages are older than the last ones."""
    repository, owner = Repository(REPOSITORY, many_jars(500)), Owner()
    waiting = [effect.message for effect in owner.handle(Started(OWNER), 0.0) if isinstance(effect, Send)]
    pages = 0
    for step in itertools.count():
        if not waiting:
            break
        to_repository = waiting.pop(0)
        effects = repository.handle(Received(to_repository), 0.0)
        changes: tuple[Change, ...] = (ValueSet("Jar1", "PositionX", float(step)), ValueSet("Table2", "PositionX", float(step)))
        if step == 2:
            changes = (*changes, ValueSet("Jar-0499", "Color", "Red"))
        elif step == 3:
            changes = (*changes, ObjectRemoved("Jar-0003"), ObjectRemoved("Jar-0499"), ObjectAdded(Object(name="A1", type="Room")))
            changes = (*changes, FactAdded(Fact("isPartOf", ("A1", "Storey1"))))
        effects += deliver_request(repository, UpdateMap(changes=changes), 0.0)
        for effect in effects:
            if isinstance(effect, Send) and effect.message.header.recipient == OWNER:
                pages += isinstance(effect.message.body, MapPage)
                waiting += [e.message for e in owner.handle(Received(effect.message), 0.0) if isinstance(e, Send)]
    assert pages >= 3
    assert owner.replica.ready
    assert has_same_contents(owner.replica, repository)


def test_names_that_change_several_times_are_the_latest_ones() -> None:
    repository, owner = Repository(REPOSITORY, contents()), Owner()
    world = World()
    world.add(REPOSITORY, repository)
    world.add(OWNER, owner)
    assert world.run(10.0, lambda: owner.replica.ready)
    renamings = (RenameObject(name="Jar1", to="Pot1"), MergeObject(name="Pot1", into="Jar2"), RenameObject(name="Table1", to="Jar1"))
    events = [effect.message for body in renamings for effect in deliver_request(repository, body) if isinstance(effect, Send)]
    for message in reversed([message for message in events if message.header.recipient == OWNER]):  # they arrive in the wrong order
        owner.handle(Received(message), 11.0)
    assert owner.news[-1].new_names == {"Jar1": "Jar2", "Pot1": "Jar2", "Table1": "Jar1"}


def test_a_message_that_was_lost_is_noticed_and_everything_read_again() -> None:
    world, owner, repository = World(), Owner(), Repository(REPOSITORY, contents())
    world.add(REPOSITORY, repository)
    world.add(OWNER, owner)
    world.run(1.0)
    deliver_request(repository, UpdateMap(situation="Jar1 isOn Table2"), world.now)  # its MapChanged goes nowhere
    world.send(request(UpdateMap(changes=(ValueSet("Jar2", "Color", "Red"),))))
    world.run(GAP_TIME / 2)
    assert owner.replica.version == 0
    world.run(GAP_TIME)
    assert has_same_contents(owner.replica, repository)
    assert owner.news[-2].reloaded or owner.news[-1].reloaded


def test_a_last_message_that_was_lost_is_noticed_when_the_lease_is_renewed() -> None:
    world, owner, repository = World(), Owner(), Repository(REPOSITORY, contents())
    world.add(REPOSITORY, repository)
    world.add(OWNER, owner)
    world.run(1.0)
    deliver_request(repository, UpdateMap(situation="Jar1 isOn Table2"), world.now)
    world.run(LEASE / 3 + 2 * GAP_TIME)
    assert has_same_contents(owner.replica, repository)


def test_it_goes_on_for_hours_and_waits_for_a_repository_that_is_away() -> None:
    world, owner, repository = World(), Owner(), Repository(REPOSITORY, contents())
    world.add(OWNER, owner)
    world.run(100.0)
    assert not owner.replica.ready
    world.add(REPOSITORY, repository)
    world.run(7200.0)
    assert has_same_contents(owner.replica, repository)
    world.remove(REPOSITORY)
    world.run(600.0)
    deliver_request(repository, UpdateMap(situation="Jar1 isOn Table2"), world.now)
    world.add(REPOSITORY, Repository(REPOSITORY, repository.contents))
    world.run(10.0)
    assert has_same_contents(owner.replica, repository)


def test_a_repository_that_begins_anew_replaces_the_copy() -> None:
    world, owner, repository = World(), Owner(), Repository(REPOSITORY, contents())
    world.add(REPOSITORY, repository)
    world.add(OWNER, owner)
    for n in range(5):
        world.send(request(UpdateMap(changes=(ValueSet("Jar1", "PositionX", float(n + 10)),))))
    world.run(1.0)
    assert owner.replica.version == 5
    anew = Repository(REPOSITORY, many_jars(3))
    world.add(REPOSITORY, anew)
    world.run(LEASE)
    assert has_same_contents(owner.replica, anew)


def test_a_repository_that_is_back_from_a_crash_says_so() -> None:
    """What it had on disk but not yet told is known to its followers long before their leases end."""
    world, owner, repository = World(), Owner(), Repository(REPOSITORY, contents())
    world.add(REPOSITORY, repository)
    world.add(OWNER, owner)
    world.run(1.0)
    world.remove(REPOSITORY)
    deliver_request(repository, UpdateMap(situation="Jar1 isOn Table2"), world.now)
    world.add(REPOSITORY, Repository(REPOSITORY, repository.contents))
    world.run(2 * GAP_TIME)
    assert has_same_contents(owner.replica, repository)


def test_pages_of_two_repositories_are_not_mixed() -> None:
    old, owner = Repository(REPOSITORY, many_jars(500)), Owner()
    for n in range(5):
        deliver_request(old, UpdateMap(changes=(ValueSet("Jar1", "PositionX", float(n + 10)),)))
    answering, anew = old, Repository(REPOSITORY, contents())
    waiting = [effect.message for effect in owner.handle(Started(OWNER), 0.0) if isinstance(effect, Send)]
    while waiting:
        message = waiting.pop(0)
        if message.body == ReadMap():
            answering = anew
        for effect in answering.handle(Received(message), 0.0):
            if isinstance(effect, Send):
                waiting += [e.message for e in owner.handle(Received(effect.message), 0.0) if isinstance(e, Send)]
    assert has_same_contents(owner.replica, anew)


def test_its_questions_are_the_same_after_the_same_inputs_and_others_in_another_life() -> None:
    def identity(now: float) -> str:
        send = Replica(OWNER, REPOSITORY).start(now)[0]
        assert isinstance(send, Send)
        return send.message.header.message_id

    assert identity(1.0) == identity(1.0)
    assert identity(1.0) != identity(2.0)


@pytest.mark.parametrize(
    "event", [TimerFired("other"), Received(request(UpdateMap(), sender=REPOSITORY)), DeliveryFailed(request(UpdateMap()), "x")]
)
def test_what_is_no_business_of_the_replica_is_left_to_its_owner(event: Input) -> None:
    assert Replica(OWNER, REPOSITORY).handle(event, 0.0) is None


def test_what_others_say_of_their_maps_is_left_to_the_owner() -> None:
    body = MapPage(objects=(), facts=(), version=0, more=False)
    assert Replica(OWNER, REPOSITORY).handle(Received(request(body, sender="http://there/other")), 0.0) is None


def test_what_could_not_be_delivered_is_asked_again_soon_unless_it_was_asked_again_already() -> None:
    def timer_times(effects: list[Effect]) -> list[float | None]:
        return [effect.at for effect in effects if isinstance(effect, SetTimer)]

    replica = Replica(OWNER, REPOSITORY)
    [first] = [effect.message for effect in replica.start(0.0) if isinstance(effect, Send)]
    lost = replica.handle(DeliveryFailed(first, "the line is dead"), 1.0)
    assert lost is not None
    assert timer_times(lost.effects) == [1.0 + GAP_TIME]
    retry_update = replica.handle(TimerFired(ReplicaDue()), 1.0 + GAP_TIME)
    assert retry_update is not None
    assert [effect.message.body for effect in retry_update.effects if isinstance(effect, Send)] == [first.body]
    old = replica.handle(DeliveryFailed(first, "the line is dead"), 1.5 + GAP_TIME)
    assert old is not None
    assert timer_times(old.effects) == timer_times(retry_update.effects)


# Any medium, any order


UPDATES: list[Body] = [
    UpdateMap(changes=(ObjectAdded(Object(name="Jar5", type="Jar", values={"PositionX": 0.0, "PositionY": 0.0, "PositionZ": 0.0})),)),
    UpdateMap(changes=(ObjectRemoved("Jar5"),)),
    UpdateMap(changes=(ValueSet("Jar5", "Color", "Red"),)),
    UpdateMap(situation="Jar5 isOn Table1"),
    UpdateMap(situation="Jar5 isOn Table2"),
    UpdateMap(situation="Jar1 isOn Table2"),
    UpdateMap(situation="Jar1 isOn Table1 AND Jar1.Color = Blue"),
    UpdateMap(changes=(ValueSet("Jar1", "Color", None),)),
    Define(definitions=Definitions(attributes=(AttributeType(name="Smell", kind=Kind.TEXT),))),
    Define(definitions=Definitions(attributes=(AttributeType(name="Smell", kind=Kind.TRUTH),))),
]

STEPS = st.one_of(
    st.tuples(st.just("deliver"), st.integers(0, 9)),
    st.tuples(st.just("deliver"), st.just(0)),
    st.tuples(st.just("twice"), st.integers(0, 9)),
    st.tuples(st.just("lose"), st.integers(0, 9)),
    st.tuples(st.just("change"), st.integers(0, len(UPDATES) - 1)),
    st.tuples(st.just("ring"), st.just(0)),
    st.tuples(st.just("restart"), st.just(0)),
)


@examples(40)
@given(st.lists(STEPS, max_size=60))
def test_on_any_medium_it_comes_to_be_what_the_repository_has(steps: list[tuple[str, int]]) -> None:
    repository, owner = Repository(REPOSITORY, many_jars(250)), Owner()
    medium = UnfairMedium({OWNER: owner, REPOSITORY: repository})
    medium.feed(OWNER, Started(OWNER))
    for action, index in steps:
        if action == "change":
            medium.feed(REPOSITORY, Received(request(UPDATES[index])))
        elif action == "ring":
            medium.ring()
        elif action == "restart":
            repository = Repository(REPOSITORY, repository.contents)
            medium.replace(REPOSITORY, repository)
        else:
            medium.carry(action, index)
        assert owner.replica.version <= repository.contents.version
    medium.settle()
    assert has_same_contents(owner.replica, repository)
