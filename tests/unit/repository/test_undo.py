"""Undoing changes of the map: what stands in the way, in words."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.protocol.messages.knowledge import Event
from somrs.repository.undo import undo_outcome
from tests.support.lab import contents

JAR = contents().map.objects["Jar1"]
ON_TABLE = FactAdded(Fact("isOn", ("Jar1", "Table1")))


def event(*changes: Change, inverse_changes: tuple[Change, ...] = ()) -> Event:
    return Event(version=3, at=0.0, author="a", changes=changes, before=inverse_changes)


@pytest.mark.parametrize(
    ("changes", "inverse_changes", "subject", "message"),
    [
        ((ValueSet("Jar9", "Color", "Red"),), (), "Jar9", "Jar9 is not on the map any more"),
        ((ValueSet("Jar2", "Color", "Red"),), (), "Jar2", "Color was Red after it, and is Blue now"),
        ((ValueSet("Jar1", "Color", "Red"),), (), "Jar1", "Color was Red after it, and is not given now"),
        ((ValueSet("Jar1", "PositionX", True),), (), "Jar1", "PositionX was True after it, and is 1 now"),
        ((ValueSet("Jar1", "PositionX", 2.5),), (), "Jar1", "PositionX was 2.5 after it, and is 1 now"),
        ((ObjectAdded(Object(name="Jar9", type="Jar")),), (), "Jar9", "Jar9 is not on the map any more"),
        ((ObjectAdded(Object(name="Jar1", type="Jar")),), (), "Jar1", "Jar1 was changed since"),
        (
            (ObjectAdded(JAR),),
            (ObjectRemoved("Jar1"),),
            "Jar1",
            f"{ON_TABLE.fact} was added since, and cannot hold without Jar1",
        ),
        ((ObjectRemoved("Jar1"),), (), "Jar1", "there is a Jar1 on the map again"),
        ((FactAdded(Fact("isOn", ("Jar1", "Table2"))),), (), "Jar1", f"{Fact('isOn', ('Jar1', 'Table2'))} does not hold any more"),
        ((FactRemoved(Fact("isOn", ("Jar1", "Table1"))),), (), "Jar1", f"{Fact('isOn', ('Jar1', 'Table1'))} holds again"),
    ],
)
@pytest.mark.parametrize(("latest", "hint"), [(None, False), (3, False), (4, True)])
def test_what_is_not_as_the_change_left_it_stands_in_the_way(
    changes: tuple[Change, ...], inverse_changes: tuple[Change, ...], subject: str, message: str, latest: int | None, hint: bool
) -> None:
    repository_contents = contents()
    if latest is not None:
        repository_contents.changed_at[subject] = latest
    [violation] = undo_outcome(event(*changes, inverse_changes=inverse_changes), repository_contents).broken
    expected_hint = f"; {subject} changed in version 4: undo that first" if hint else ""
    assert violation.message == f"version 3 cannot be undone: {message}{expected_hint}"
    assert (violation.subject, violation.rule) == (subject, "changed-since")


@pytest.mark.parametrize(
    ("changes", "inverse_changes"),
    [
        ((ValueSet("Jar2", "Color", "Blue"),), (ValueSet("Jar2", "Color", "Red"),)),
        ((ValueSet("Jar2", "Color", "Blue"),), (ValueSet("Jar2", "Color", None),)),
        ((ObjectAdded(JAR), ON_TABLE), (FactRemoved(ON_TABLE.fact), ObjectRemoved("Jar1"))),
        ((ObjectRemoved("Jar9"),), (ObjectAdded(structs.replace(JAR, name="Jar9")),)),
        ((ON_TABLE,), (FactRemoved(ON_TABLE.fact),)),
        (
            (FactRemoved(Fact("isOn", ("Jar1", "Table2"))), ON_TABLE),
            (FactRemoved(ON_TABLE.fact), FactAdded(Fact("isOn", ("Jar1", "Table2")))),
        ),
    ],
)
def test_what_is_as_the_change_left_it_is_put_back(changes: tuple[Change, ...], inverse_changes: tuple[Change, ...]) -> None:
    repository_contents = contents()
    outcome = undo_outcome(event(*changes, inverse_changes=inverse_changes), repository_contents)
    assert outcome.broken == ()
    assert sorted(outcome.changes, key=str) == sorted(inverse_changes, key=str)
    assert outcome.map == repository_contents.map.changed(inverse_changes)
    assert outcome.revision is None
