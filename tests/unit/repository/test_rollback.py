"""Events of the past: what leads back from them, and as much of them as goes into a message."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import AttributeType, Kind
from somrs.protocol.messages.knowledge import Definitions, Event, Revision
from somrs.protocol.messages.paging import size
from somrs.repository.rollback import inverse, rewind_map, shorten_event

CHANGES = tuple(ValueSet(f"Jar{number:03}", "PositionX", float(number)) for number in range(200))
REVISION = Revision(after=Definitions(attributes=(AttributeType(name="Smell", kind=Kind.TEXT, doc="of what is in it " * 40),)))


@pytest.mark.parametrize("revision", [None, REVISION])
@pytest.mark.parametrize("room", [500, 2_000])
def test_of_what_is_too_long_the_beginning_is_told_and_how_much_there_is(revision: Revision | None, room: int) -> None:
    event = Event(version=7, at=1.0, author="a person", changes=CHANGES, before=CHANGES, revision=revision)
    short_event = shorten_event(event, room)
    assert size(short_event) < room + 120
    assert 1 < len(short_event.changes) < len(CHANGES)
    room_left = room // 2 - sum(map(size, short_event.changes))
    assert 0 <= room_left < size(CHANGES[len(short_event.changes)]), "changes take half of the room"
    assert short_event.changes == CHANGES[: len(short_event.changes)]
    assert (short_event.before, short_event.all_changes) == ((), len(CHANGES))
    assert (short_event.version, short_event.author) == (7, "a person")
    assert (short_event.revision is not None) == (revision is not None)


def test_what_fits_is_told_as_it_is() -> None:
    event = Event(version=7, at=1.0, author="a person", changes=CHANGES[:3], before=CHANGES[:3], revision=REVISION)
    assert shorten_event(event, size(event)) is event


names = st.sampled_from(["A", "B", "C"])
one_change: st.SearchStrategy[Change] = st.one_of(
    st.builds(ObjectAdded, st.builds(Object, name=names, type=st.sampled_from(["Thing", "Jar"]))),
    st.builds(ObjectRemoved, names),
    st.builds(ValueSet, names, st.sampled_from(["Size", "PositionX"]), st.sampled_from([1.0, 2.0, None])),
    st.builds(FactAdded, st.builds(Fact, st.sampled_from(["between", "isNew"]), st.tuples(names))),
    st.builds(FactRemoved, st.builds(Fact, st.sampled_from(["between", "isNew"]), st.tuples(names))),
)
CHANGED = Map(
    [Object(name="A", type="Jar", values={"Size": 1.0}), Object(name="B", type="Thing")], [Fact("isNew", ("A",)), Fact("between", ("B",))]
)


def possible(map: Map, changes: list[Change]) -> list[Change]:
    """Without what speaks of objects that are not there; objects that go have no facts by then, as where rules are kept."""
    possible_changes: list[Change] = []
    for change in changes:
        match change:
            case ObjectRemoved(name) if name not in map.objects or [*map.facts_about(name)]:
                continue
            case ValueSet(name) if name not in map.objects:
                continue
            case FactAdded(fact) if not set(fact.arguments) <= set(map.objects):
                continue
        possible_changes.append(change)
        map = map.changed([change])
    return possible_changes


@given(st.lists(one_change, max_size=8))
def test_what_leads_back_leads_to_the_map_as_it_was(changes: list[Change]) -> None:
    possible_changes = possible(CHANGED, changes)
    map_after = CHANGED.changed(possible_changes)
    inverse_changes = inverse(CHANGED, possible_changes)
    assert map_after.changed(inverse_changes) == CHANGED
    assert rewind_map(map_after, [inverse_changes]) == CHANGED


NEW_A, OBJECT_A = FactRemoved(Fact("isNew", ("A",))), CHANGED.objects["A"]


@pytest.mark.parametrize(
    ("changes", "inverse_changes"),
    [
        ([ValueSet("A", "Size", 2.0), ValueSet("A", "Size", 3.0)], [ValueSet("A", "Size", 2.0), ValueSet("A", "Size", 1.0)]),
        ([ValueSet("A", "Size", None), ValueSet("A", "Size", 3.0)], [ValueSet("A", "Size", None), ValueSet("A", "Size", 1.0)]),
        ([NEW_A, ObjectRemoved("A")], [ObjectAdded(OBJECT_A), FactAdded(NEW_A.fact)]),
        ([NEW_A, NEW_A], [FactAdded(NEW_A.fact)]),
        ([FactAdded(NEW_A.fact), FactRemoved(Fact("isNew", ("B",)))], []),
        ([FactAdded(Fact("isNew", ("B",))), FactAdded(Fact("isNew", ("B",)))], [FactRemoved(Fact("isNew", ("B",)))]),
        ([ObjectAdded(Object(name="A", type="Thing"))], [ObjectAdded(OBJECT_A)]),
        ([ObjectAdded(Object(name="C", type="Jar")), ValueSet("C", "Size", 2.0)], [ValueSet("C", "Size", None), ObjectRemoved("C")]),
        ([ObjectAdded(Object(name="C", type="Jar")), ObjectRemoved("C")], [ObjectAdded(Object(name="C", type="Jar")), ObjectRemoved("C")]),
        ([NEW_A, ObjectRemoved("A"), ObjectAdded(OBJECT_A)], [ObjectRemoved("A"), ObjectAdded(OBJECT_A), FactAdded(NEW_A.fact)]),
        ([ObjectRemoved("C"), ValueSet("C", "Size", 2.0)], []),
    ],
)
def test_what_leads_back_from_each_change(changes: list[Change], inverse_changes: list[Change]) -> None:
    assert [*inverse(CHANGED, changes)] == inverse_changes
