"""Values as bytes and back, and which versions of them can be read."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from somrs.errors import UsageError
from somrs.kernel.codec import Codec, Migration, Schema, decode_untyped, encode, to_error_answer
from somrs.kernel.component import ErrorAnswer, Input, Started
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.types import Ontology
from tests.support.lab import contents

MAP = Map([Object(name="Box1", type="Box"), Object(name="Jar1", type="Jar", values={"Color": "Red"})], [Fact("isIn", ("Jar1", "Box1"))])


def test_an_ontology_is_read_as_it_was_written() -> None:
    ontology = contents().ontology
    assert all((ontology.attributes, ontology.relations, ontology.functions, ontology.types, ontology.services))
    document = encode({"a": ontology})
    for decoded in (Codec[Any](dict[str, Ontology]).decode(document), Codec[Any](dict[str, Ontology]).convert(decode_untyped(document))):
        assert [*decoded["a"]] == [*ontology]
    assert [len(section) for section in decode_untyped(encode(ontology))] == [
        len(section) for section in (ontology.attributes, ontology.relations, ontology.functions, ontology.types, ontology.services)
    ]


def test_a_map_is_read_as_it_was_written() -> None:
    document = encode([MAP])
    assert Codec[Any](list[Map]).decode(document) == Codec[Any](list[Map]).convert(decode_untyped(document)) == [MAP]
    assert [len(part) for part in decode_untyped(document)[0]] == [2, 1, 0, 0, 0]


def test_what_is_no_data_is_neither_written_nor_read() -> None:
    with pytest.raises(NotImplementedError, match=r"^Codec cannot be serialized: it is not data$"):
        encode(Codec[int](int))
    with pytest.raises(NotImplementedError, match=r"^Codec cannot be deserialized: it is not data$"):
        Codec[Any](Codec).decode(encode(1))
    with pytest.raises(msgspec.ValidationError):
        Codec[int](int).decode(encode("1"))


@pytest.mark.parametrize(("error", "text"), [(ValueError("no such thing"), "no such thing"), (ZeroDivisionError(), "ZeroDivisionError")])
def test_an_exception_in_words(error: BaseException, text: str) -> None:
    trouble = to_error_answer(error)
    assert (trouble, str(trouble)) == (ErrorAnswer(text), text)


def schema(**options: Any) -> Schema:
    return Schema(
        component="c", version=3, state=int, timers=None, questions=None, tasks=None, answers=None, restore=lambda state: state, **options
    )


STEPS = {
    1: Migration(snapshot=lambda value: [*value, 1], entry=lambda value: [*value, -1]),
    2: Migration(snapshot=lambda value: [*value, 2]),
}


@pytest.mark.parametrize(("version", "snapshot", "entry"), [(1, [0, 1, 2], [0, -1]), (2, [0, 2], [0]), (3, [0], [0])])
def test_data_of_earlier_versions_are_made_those_of_today_step_by_step(version: int, snapshot: list[int], entry: list[int]) -> None:
    today = schema(migrations=STEPS)
    assert today.can_read(version)
    assert today.migrate_snapshot([0], version) == snapshot
    assert today.migrate_entry([0], version) == entry


@pytest.mark.parametrize(("migrations", "version"), [(STEPS, 0), (STEPS, 4), ({2: STEPS[2]}, 1), ({1: STEPS[1]}, 1), ({}, 2)])
def test_where_a_step_is_missing_or_the_version_is_a_later_one_nothing_is_read(migrations: dict[int, Migration], version: int) -> None:
    today = schema(migrations=migrations)
    assert not today.can_read(version)
    for read in (today.migrate_snapshot, today.migrate_entry):
        with pytest.raises(UsageError) as error:
            read([0], version)
        assert str(error.value) == f"its data have version {version}, and this program reads up to 3"


def test_what_a_schema_says_if_it_does_not_say_otherwise() -> None:
    event: Input = Started("http://a")
    plain = schema()
    assert (plain.notices, plain.volatile, plain.relocatable, plain.irreplaceable) == (None, (), False, False)
    assert (plain.is_read_only(event), plain.snapshot_after, plain.migrations) == (False, 5000, {})
    assert plain.error_to_answer(ValueError("no")) == ErrorAnswer("no")
