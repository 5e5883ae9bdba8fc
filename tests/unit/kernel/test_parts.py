"""The large parts of a state: stored entry by entry, beside the plain twin that stores everything each time."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.kernel import codec
from somrs.kernel.parts import PartsReader, PartsWriter, chunk_document, part_changes
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved
from tests.support.examples import examples
from tests.support.small_pages import small_pages

NAMES = [f"N{number}" for number in range(14)]
PAGE = 4

names = st.sampled_from(NAMES)
facts = st.builds(lambda relation, first, second: Fact(relation, (first, second)), st.sampled_from(["isOn", "near"]), names, names)
changes: st.SearchStrategy[Change] = st.one_of(
    names.map(lambda name: ObjectAdded(Object(name=name, type="Jar"))),
    names.map(ObjectRemoved),
    facts.map(FactAdded),
    facts.map(FactAdded),
    facts.map(FactRemoved),
)


class Rows:
    """The stored rows of a state, as a file has them."""

    def __init__(self) -> None:
        self.rows: dict[tuple[str, bytes], bytes] = {}
        self.parts: Any = {}
        self.document = b""

    def store(self, state: object) -> int:
        """Store the state, and return the number of rows that were written or removed."""
        writer = PartsWriter()
        self.document = codec.encode(state, writer)
        difference = part_changes(self.parts, writer.parts)
        self.parts = writer.parts
        for part, key in difference.removed:
            del self.rows[part, key]
        self.rows.update({(part, key): value for part, key, value in difference.written})
        return len(difference.written) + len(difference.removed)

    def documents(self) -> dict[str, list[bytes]]:
        documents: dict[str, list[bytes]] = {}
        for (part, key), value in sorted(self.rows.items()):
            documents.setdefault(part, []).append(chunk_document([value or key]))
        return documents

    def read(self) -> list[Map]:
        return codec.Codec[list[Map]](list[Map], PartsReader(self.documents())).decode(self.document)


@given(st.lists(st.lists(changes, max_size=20), min_size=1, max_size=6))
@examples(100)
def test_parts_are_read_as_they_were_written(sequence: list[list[Change]]) -> None:
    with small_pages(PAGE):
        rows, map = Rows(), Map([Object(name=name, type="Jar") for name in NAMES])
        for step in sequence:
            map = map.changed(step)
            rows.store([map, map])
            (first, second) = rows.read()
            assert first == second == map
            assert [*first.objects] == [*map.objects]
            assert [*first.facts()] == [*map.facts()], "in the same order"
            large = [relation for relation, tuples in map.tuples() if len(tuples) > 2 * PAGE]
            assert set(rows.documents()) == {f"0 {relation}" for relation in [*large, *([""] if len(map.objects) > 2 * PAGE else [])]}


def test_a_snapshot_writes_what_has_changed() -> None:
    with small_pages(PAGE):
        map = Map([Object(name=f"Jar{number}", type="Jar") for number in range(100)], [Fact("isOn", ("Jar1", "Jar2"))])
        rows = Rows()
        assert rows.store([map]) == 100
        assert rows.store([map]) == 0
        assert rows.store([map.changed([ObjectRemoved("Jar5"), FactAdded(Fact("isOn", ("Jar2", "Jar3")))])]) == 1


def test_a_missing_entry_is_noticed() -> None:
    with small_pages(PAGE):
        rows = Rows()
        rows.store([Map([Object(name=name, type="Jar") for name in NAMES])])
        del rows.rows[next(iter(rows.rows))]
        with pytest.raises(ValueError, match="the objects of the map are 13, and not 14"):
            rows.read()
