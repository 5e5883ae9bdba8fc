"""Mappings in pages, beside plain dicts; and maps that are large, beside the same maps made anew and maps without pages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.differences import differences
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.paged import PagedDict, changed_keys, mutable_copy, settled
from somrs.ontology.types import PART_OF
from tests.support.examples import examples
from tests.support.small_pages import small_pages

KEYS = [f"K{number}" for number in range(40)]
ABSENT = object()

edits = st.lists(st.tuples(st.sampled_from(KEYS), st.one_of(st.none(), st.integers(0, 3))), max_size=40)
"""Keys with a new value each; None removes the key."""


@given(st.lists(edits, max_size=6))
@examples(100)
def test_a_mapping_in_pages_is_a_dict_in_the_order_of_its_keys(versions: list[list[tuple[str, int | None]]]) -> None:
    with small_pages():
        plain: list[dict[str, int]] = [dict.fromkeys(KEYS[::2], 0)]
        pages = [PagedDict(plain[0])]
        for version in versions:
            plain.append(dict(plain[-1]))
            pages.append(pages[-1].copy())
            for key, value in version:
                if value is not None:
                    plain[-1][key] = pages[-1][key] = value
                else:
                    assert pages[-1].pop(key, ABSENT) == plain[-1].pop(key, ABSENT)
        for entries, expected in zip(pages, plain, strict=True):
            assert list(entries.items()) == sorted(expected.items()), "also after later copies were changed"
            assert (list(entries), list(entries.values()), len(entries)) == (
                [*sorted(expected)],
                [v for _, v in sorted(expected.items())],
                len(expected),
            )
            for key in KEYS:
                assert (key in entries, entries.get(key)) == (key in expected, expected.get(key))
                assert list(entries.keys_after(key)) == [later for later in sorted(expected) if later > key]
            assert settled(entries) == expected
            different = {key for key in KEYS if expected.get(key, ABSENT) != plain[-1].get(key, ABSENT)}
            assert set(changed_keys(entries, pages[-1])) == different


def test_a_mapping_keeps_the_form_for_its_size() -> None:
    with small_pages():
        small = settled({"B": 1, "A": 2})
        assert list(small) == ["B", "A"], "a small one has its entries in the order in which they were added"
        growing = mutable_copy(small)
        growing.update(dict.fromkeys("HGFEDCI", 0))
        large = settled(growing)
        assert isinstance(large, PagedDict)
        assert list(large) == [*"ABCDEFGHI"]
        shrinking = mutable_copy(large)
        del shrinking["C"]
        assert type(settled(shrinking)) is dict


def test_a_change_copies_one_page_of_a_large_mapping() -> None:
    large = PagedDict(dict.fromkeys(map(str, range(100_000)), 0))
    changed = large.copy()
    changed["50000"] = 1
    del changed["70000"]
    changed["x"] = 2
    shared = {id(page) for page in large._pages} & {id(page) for page in changed._pages}
    assert len(shared) == len(large._pages) - 3
    assert sorted(changed_keys(large, changed)) == ["50000", "70000", "x"]


# Maps

NAMES = [f"N{number}" for number in range(12)]
PATHS = ("Color", "Weight", "Unknown", "PositionX", "PositionY")
COORDINATES = (-1.0, 0.0, 1.5)
VALUES = ("Red", True, 1.5, "Blue", 0)
TYPES = ("Jar", "Shelf", "Room")
RELATIONS = ("isOn", PART_OF, "near")

names = st.sampled_from(NAMES)
facts = st.builds(lambda relation, first, second: Fact(relation, (first, second)), st.sampled_from(RELATIONS), names, names)
map_changes: st.SearchStrategy[Change] = st.one_of(
    st.builds(ObjectAdded, st.builds(Object, name=names, type=st.sampled_from(TYPES))),
    st.builds(ObjectRemoved, names),
    st.builds(ValueSet, names, st.sampled_from(PATHS), st.sampled_from([*VALUES, None])),
    facts.map(FactAdded),
    facts.map(FactRemoved),
)


def possible(map: Map, changes: list[Change]) -> Iterator[Change]:
    """The changes, without values of objects that are not there."""
    present = {*map.objects}
    for change in changes:
        if isinstance(change, ObjectAdded):
            present.add(change.object.name)
        elif isinstance(change, ObjectRemoved):
            present.discard(change.name)
        if not isinstance(change, ValueSet) or change.object in present:
            yield change


def answers(map: Map) -> dict[str, object]:
    """All that indexes answer. The order counts."""
    return {
        "objects": list(map.objects.items()),
        "facts": [(relation, list(map.facts(relation))) for relation in RELATIONS],
        "types": {name: list(map.of_type(name)) for name in TYPES},
        "wholes": {name: list(map.wholes_of_type(name)) for name in TYPES},
        "values": {(path, str(value)): list(map.with_value(path, value)) for path in PATHS for value in VALUES},
        "arguments": {(r, p, n): list(map.facts_with(r, p, n)) for r in RELATIONS for p in (0, 1) for n in NAMES},
        "about": {name: list(map.facts_about(name)) for name in NAMES},
        "from": {name: list(map.facts_from(name)) for name in NAMES},
        "at": {(relation, place): list(map.objects_at(relation, place)) for relation in RELATIONS for place in (0, 1)},
        "after": {name: list(map.names_after(name)) for name in ("", *NAMES)},
        "roots": map.roots(),
        "near": {(x, y): [*map.places.near(x, y, 0.5)] for x in COORDINATES for y in COORDINATES},
        "unplaced": {name: [*map.places.unplaced(name)] for name in TYPES},
    }


def without_order(answer: object) -> object:
    match answer:
        case list():
            return sorted(map(str, answer))
        case dict():
            return {key: without_order(value) for key, value in answer.items()}
    return answer


@given(st.lists(map_changes, min_size=12, max_size=60), st.lists(st.lists(map_changes, max_size=6), max_size=8))
@examples(100)
def test_a_large_map_answers_as_a_plain_one_and_as_one_made_anew(beginning: list[Change], sequence: list[list[Change]]) -> None:
    plain = [Map([Object(name=name, type="Jar", values={"Color": "Red"}) for name in NAMES])]
    steps = [[*possible(plain[0], beginning)]]
    plain.append(plain[0].changed(steps[0]))
    for changes in sequence:
        steps.append([*possible(plain[-1], changes)])
        plain.append(plain[-1].changed(steps[-1]))
    with small_pages():
        large = [Map(plain[0].objects.values())]
        for step in steps:
            answers(large[-1])  # builds all indexes, which the next map continues
            large.append(large[-1].changed(step))
        for map, expected in zip(large, plain, strict=True):
            assert map == expected
            assert without_order(answers(map)) == without_order(answers(expected))
            if isinstance(map.objects, PagedDict):
                fresh = Map(map.objects.values(), map.facts())
                assert same_order(answers(map), answers(fresh)), "a component that restarts has the same order"
            assert large[-1].changed(differences(large[-1], map)) == map
            assert map.changed(differences(map, large[-1])) == large[-1]


def same_order(answer: Mapping[str, object], fresh_answer: Mapping[str, object]) -> bool:
    """Whether what a large mapping of objects determines has the same order."""
    return all(
        answer[part] == fresh_answer[part] for part in ("objects", "types", "wholes", "values", "after", "roots", "near", "unplaced")
    )
