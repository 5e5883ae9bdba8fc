"""Events of the past, as far as they go into a message."""

from __future__ import annotations

import pytest

from somrs.ontology.objects import ValueSet
from somrs.ontology.types import AttributeType, Kind
from somrs.protocol.messages.knowledge import Definitions, Event, Revision
from somrs.protocol.messages.paging import size
from somrs.repository.past import shortened

CHANGES = tuple(ValueSet(f"Jar{number:03}", "PositionX", float(number)) for number in range(200))
REVISION = Revision(after=Definitions(attributes=(AttributeType(name="Smell", kind=Kind.TEXT, doc="of what is in it " * 40),)))


@pytest.mark.parametrize("revision", [None, REVISION])
@pytest.mark.parametrize("room", [500, 2_000])
def test_of_what_is_too_long_the_beginning_is_told_and_how_much_there_is(revision: Revision | None, room: int) -> None:
    event = Event(version=7, at=1.0, author="a person", changes=CHANGES, before=CHANGES, revision=revision)
    told = shortened(event, room)
    assert size(told) < room + 100
    assert 1 < len(told.changes) < len(CHANGES)
    assert told.changes == CHANGES[: len(told.changes)]
    assert (told.before, told.all_changes) == ((), len(CHANGES))
    assert (told.version, told.author) == (7, "a person")
    assert (told.revision is not None) == (revision is not None)


def test_what_fits_is_told_as_it_is() -> None:
    event = Event(version=7, at=1.0, author="a person", changes=CHANGES[:3], before=CHANGES[:3], revision=REVISION)
    assert shortened(event, size(event)) is event
