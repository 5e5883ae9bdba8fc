"""IRIs and literals of OWL files, and the small texts in their annotations."""

from __future__ import annotations

import pytest

from somrs.ontology.naming import Section
from somrs.ontology.types import Value

pytest.importorskip("rdflib", reason="rdflib is not installed")

from rdflib import Literal, URIRef

from somrs.ontology.owl.ordering import in_order, ordered, read_default
from somrs.ontology.owl.words import argument, iri, literal, local_name, section_of


@pytest.mark.parametrize(
    ("section", "name", "written"),
    [
        (Section.ATTRIBUTES, "Weight", "urn:so-mrs:attribute:Weight"),
        (Section.RELATIONS, "isOn", "urn:so-mrs:relation:isOn"),
        (Section.FUNCTIONS, "way-to", "urn:so-mrs:function:way-to"),
        (Section.TYPES, "Żaba", "urn:so-mrs:type:Żaba"),
        (Section.SERVICES, "Move", "urn:so-mrs:service:Move"),
        (Section.OBJECTS, "a/b: c#d", "urn:so-mrs:object:a%2Fb%3A%20c%23d"),
    ],
)
def test_an_iri_says_the_section_and_the_name(section: Section, name: str, written: str) -> None:
    node = iri(section, name)
    assert node == URIRef(written)
    assert (section_of(node), local_name(node)) == (section, name)


@pytest.mark.parametrize(
    ("node", "name"),
    [
        ("http://a.b/c/d", "d"),
        ("http://a.b/c#d", "d"),
        ("http://a.b/c#d/e", "e"),
        ("http://a.b/c/", ""),
        ("abc", "abc"),
        ("a:b%20c", "b c"),
    ],
)
def test_the_last_part_of_an_iri_of_others_is_a_name(node: str, name: str) -> None:
    assert local_name(URIRef(node)) == name
    assert section_of(URIRef(node)) is None


def test_arguments_are_counted_from_one() -> None:
    assert argument(1) == URIRef("urn:so-mrs:owl:argument1")


@pytest.mark.parametrize(
    ("value", "text", "datatype"),
    [
        (True, "true", "boolean"),
        (3, "3.0", "decimal"),
        (0.1, "0.1", "decimal"),
        (-1e-07, "-0.0000001", "decimal"),
        (1e22, "10000000000000000000000", "decimal"),
        (float("-inf"), "-inf", "double"),
        ("3", "3", None),
    ],
)
def test_how_values_are_written(value: Value, text: str, datatype: str | None) -> None:
    literal_node = literal(value)
    expected = None if datatype is None else URIRef(f"http://www.w3.org/2001/XMLSchema#{datatype}")
    assert (str(literal_node), literal_node.datatype) == (text, expected)
    assert isinstance(literal_node, Literal)


@pytest.mark.parametrize(
    ("items", "hint", "result"),
    [
        (["b", "a", "b"], None, ("a", "b")),
        (["b", "a", "c"], "", ("a", "b", "c")),
        (["b", "a", "c"], "c", ("c", "a", "b")),
        (["b", "a", "c"], " c  b ", ("c", "b", "a")),
        (["b", "a", "c"], ' ["c", "b"] ', ("c", "b", "a")),
        (["b", "a", "c"], '["c", "b"', ("a", "b", "c")),
        ([2.0, True, "2"], '["2", true, 2]', ("2", True, 2.0)),
        ([2.0, True, "2"], '[2, true, "2"]', (2.0, True, "2")),
        ([True, 3.0], "[1, 3]", (3.0, True)),  # TRUE is not 1
        ([10.0, 9.0], "[10, 9.0]", (10.0, 9.0)),
    ],
)
def test_a_hint_gives_the_order(items: list[Value], hint: str | None, result: tuple[Value, ...]) -> None:
    ordered_items = in_order(items, hint)
    assert [(type(item), item) for item in ordered_items] == [(type(item), item) for item in result]


@pytest.mark.parametrize(("items", "hint"), [([], ""), (["a"], ""), (["b", "ż"], '["b", "ż"]'), ([2.5, True], "[2.5, true]")])
def test_one_thing_needs_no_hint(items: list[Value], hint: str) -> None:
    assert ordered(items) == hint


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("Shape.Height = 0.14", "Shape.Height", 0.14),
        ("Count=3", "Count", 3.0),
        ("Open = true", "Open", True),
        ('Label = "a = b"', "Label", "a = b"),
    ],
)
def test_defaults_are_read(text: str, path: str, value: Value) -> None:
    default = read_default(text)
    assert default == (path, value)
    assert type(default[1]) is type(value)


@pytest.mark.parametrize("text", ["Weight", "Weight =", "Weight = x", "Weight = [1]", "Weight = null", "Weight = {}"])
def test_what_is_no_default(text: str) -> None:
    with pytest.raises(ValueError, match=r"there is no = in it|Expecting value|it is no number, text or truth"):
        read_default(text)
