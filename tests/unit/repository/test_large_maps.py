"""What is asked of a large map, and changed on it, goes through no more of it than it touches."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from somrs.kernel.component import Received, Send
from somrs.kernel.replica import Replica
from somrs.ontology import map as ontology_map
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import Value
from somrs.planner.model.plan import Plan
from somrs.planner.planning import plan
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.knowledge import (
    Consider,
    Considered,
    MapChanged,
    MapPage,
    QueryMap,
    ReadMap,
    Rejected,
    Rows,
    SubscribeMap,
    Updated,
    UpdateMap,
)
from somrs.protocol.messages.observations import Observation
from somrs.protocol.messages.submission import Submit
from somrs.repository import association, reports
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.task_manager.context import planning_problem
from tests.support.lab import REPOSITORY, deliver_request
from tests.support.small_pages import Visits, small_pages

ROOMS, SHELVES = 40, 25
PAGE = 16
MOST_VISITS = 20 * PAGE
"""Entries in some pages. The map has more than ten times as many objects."""

FOLLOWER = "http://here/follower"
BOX: dict[str, Value] = {"PositionX": 0.0, "PositionY": 0.0, "PositionZ": 0.0, "Shape.Form": "Box"}
SIZE: dict[str, Value] = {"Shape.Width": 1.0, "Shape.Depth": 1.0, "Shape.Height": 1.0}


def store() -> Map:
    """Rooms with shelves, and a jar on each."""
    members = [Object(name="Building1", type="Building"), Object(name="Storey1", type="Storey")]
    members.append(Object(name="Floor1", type="Floor", values=BOX | SIZE))
    facts = [Fact("isPartOf", ("Storey1", "Building1")), Fact("isPartOf", ("Floor1", "Storey1"))]
    for room in range(ROOMS):
        members.append(Object(name=f"Room{room}", type="Room"))
        facts.append(Fact("isPartOf", (f"Room{room}", "Storey1")))
        for number in range(room * SHELVES, room * SHELVES + SHELVES):
            place: dict[str, Value] = {"PositionX": float(number), "PositionY": float(room), "PositionZ": 0.0}
            members += [
                Object(name=f"Shelf{number}", type="Shelf", values=BOX | SIZE | place),
                Object(name=f"Jar{number}", type="Jar", values={**place, "PositionZ": 1.0, "Color": "Red"}),
            ]
            facts += [Fact("isPartOf", (f"Shelf{number}", f"Room{room}")), Fact("isOn", (f"Jar{number}", f"Shelf{number}"))]
    return Map(members, facts)


@pytest.fixture(scope="module")
def visits() -> Iterator[Visits]:
    with small_pages(PAGE) as visits:
        yield visits


@pytest.fixture(scope="module")
def repository(visits: Visits) -> Repository:
    return Repository(REPOSITORY, Contents(ontology=upper(), map=store()))


def answer(repository: Repository, visits: Visits, body: Body) -> Body:
    """The answer to a request, which goes through a small part of the map only."""
    visits.count = 0
    effects = deliver_request(repository, body)
    assert visits.count <= MOST_VISITS < len(repository.contents.map.objects) / 5
    return next(effect.message.body for effect in effects if isinstance(effect, Send))


def fact(relation: str, *arguments: str) -> Fact:
    return Fact(relation, arguments)


NEW_JAR = Object(name="JarNew", type="Jar", values={"PositionX": 3.0, "PositionY": 0.0, "PositionZ": 1.0})
UPDATES: dict[str, tuple[Change, ...] | str] = {
    "a formula": "Jar7 isOn Shelf9",
    "a value": (ValueSet("Jar8", "Color", "Blue"),),
    "a value of the root": (ValueSet("Building1", "Label", "Store"),),
    "facts": (FactRemoved(fact("isOn", "Jar10", "Shelf10")), FactAdded(fact("isOn", "Jar10", "Shelf11"))),
    "an object": (ObjectAdded(NEW_JAR), FactAdded(fact("isOn", "JarNew", "Shelf3"))),
    "a part of a full storey": (ObjectAdded(Object(name="RoomNew", type="Room")), FactAdded(fact("isPartOf", "RoomNew", "Storey1"))),
    "a part that moves": (FactRemoved(fact("isPartOf", "Shelf4", "Room0")), FactAdded(fact("isPartOf", "Shelf4", "Room5"))),
    "an object removed": (ObjectRemoved("Jar12"),),
    "a room removed, and its shelves without it": (ObjectRemoved("RoomNew"),),
}


@pytest.mark.parametrize("update", UPDATES.values(), ids=UPDATES.keys())
def test_an_update(update: tuple[Change, ...] | str, repository: Repository, visits: Visits) -> None:
    body = UpdateMap(situation=update) if isinstance(update, str) else UpdateMap(changes=update)
    assert isinstance(answer(repository, visits, Consider(change=body)), Considered)
    assert isinstance(answer(repository, visits, body), Updated)


def test_a_mistake(repository: Repository, visits: Visits, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ontology_map, "SIMILAR_NAMES", 50)
    rejected = answer(repository, visits, UpdateMap(situation="Jra7 isOn Shelf9"))
    assert isinstance(rejected, Rejected)
    assert "there is no object Jra7" in rejected.problems[0]
    rejected = answer(repository, visits, UpdateMap(changes=(ObjectRemoved("Floor1"),)))
    assert isinstance(rejected, Rejected)


def test_queries_and_pages(repository: Repository, visits: Visits) -> None:
    rows = answer(repository, visits, QueryMap(formula="Jar20 isOn ?Where AND ?Where isPartOf ?Room"))
    assert isinstance(rows, Rows)
    assert [row.bindings for row in rows.rows] == [{"Where": "Shelf20", "Room": "Room0"}]
    rows = answer(repository, visits, QueryMap(formula="?What isOn Shelf30"))
    assert isinstance(rows, Rows)
    assert [row.bindings for row in rows.rows] == [{"What": "Jar30"}]
    page = answer(repository, visits, ReadMap(after="Jar500"))
    assert isinstance(page, MapPage)
    assert [member.name for member in page.objects[:2]] == ["Jar501", "Jar502"]
    assert fact("isOn", "Jar501", "Shelf501") in page.facts
    last = answer(repository, visits, ReadMap(after="\ufffd"))
    assert (isinstance(last, MapPage) and last.objects) == ()


def test_what_a_follower_does(repository: Repository, visits: Visits) -> None:
    replica = Replica(FOLLOWER, REPOSITORY)
    waiting = [effect.message for effect in replica.start(1.0) if isinstance(effect, Send)]
    while waiting:
        replies = [
            effect.message for message in waiting for effect in repository.handle(Received(message), 1.0) if isinstance(effect, Send)
        ]
        updates = [replica.handle(Received(reply), 1.0) for reply in replies]
        waiting = [effect.message for update in updates if update for effect in update.effects if isinstance(effect, Send)]
    assert replica.map == repository.contents.map
    visits.count = 0
    deliver_request(repository, SubscribeMap(lease=60.0), sender=FOLLOWER)
    effects = deliver_request(repository, UpdateMap(situation="Jar40 isOn Shelf50"))
    (news,) = [effect.message for effect in effects if isinstance(effect, Send) and isinstance(effect.message.body, MapChanged)]
    replica.handle(Received(news), 1.0)
    assert replica.map.has_fact("isOn", ("Jar40", "Shelf50"))
    transfer = replica.ontology.services["TransferObject"]
    offers = [
        Offer(service="urn:robot/transfer", service_type=transfer, provider="Robot1", provider_type="MobileManipulator", address="urn:r")
    ]
    result = plan(planning_problem(Submit(effect="Jar41 isOn Shelf60"), replica, offers))
    assert isinstance(result, Plan)
    assert [step.service_type for step in result.steps] == ["TransferObject"]
    assert visits.count <= MOST_VISITS


def test_a_report_of_what_was_seen(repository: Repository, visits: Visits, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(association, "MOST_COMPARED", 100)
    monkeypatch.setattr(reports, "MOST_NUMBERED", 100)
    seen = "?Seen: Jar isOn Shelf70 AND ?Seen.PositionX = 70 AND ?Seen.PositionY = 2 AND ?Seen.PositionZ = 1"
    assert repository.contents.map.places, "the index is there, as after the first report"
    updated = answer(repository, visits, UpdateMap(situation=seen, observation=Observation(as_of=0.5)))
    assert isinstance(updated, Updated)
    assert updated.reception is not None
    assert updated.reception.names == {"Seen": "Jar70"}
    new = seen.replace("70", "7000").replace("isOn Shelf7000", "isOn Shelf71")
    updated = answer(repository, visits, UpdateMap(situation=new, observation=Observation(as_of=0.6)))
    assert isinstance(updated, Updated)
    assert updated.reception is not None
    assert updated.reception.added == ("Jar001",), "a free name"
