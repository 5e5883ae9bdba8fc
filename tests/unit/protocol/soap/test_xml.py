"""Values of fields as XML, and back."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Any

import pytest
from lxml import etree
from msgspec import NODEFAULT, Struct, field

from somrs.errors import WireError
from somrs.ontology.types import Value
from somrs.protocol.soap.xml import Field, camel, escaped, escaped_attribute, fields, fields_writer, reader, struct_reader, text_of, writer

X = "urn:x"


class Color(StrEnum):
    RED = "red"
    DARK = "dark red"


class Circle(Struct, frozen=True):
    radius: float = 1.0


class Square(Struct, frozen=True):
    side: int


class Drawing(Struct, frozen=True):
    shape_drawn: Circle | Square
    note: str | None
    count: int = 3
    done: bool = False
    colors: tuple[Color, ...] = ()
    values: dict[str, Value] = field(default_factory=dict)
    by: str | None = "me"


def element(text: str) -> Any:
    return etree.fromstring(f'<m:E xmlns:m="{X}">{text}</m:E>')


def written(hint: Any, value: object) -> str:
    document: list[str] = []
    writer(hint)(document, "m:E", ' a="b"', value)
    return "".join(document)


def refusal(read: Callable[[], object]) -> str:
    with pytest.raises(WireError) as caught:
        read()
    assert caught.value.code == "env:Sender"
    return caught.value.text


def test_what_is_known_of_the_fields_of_a_struct() -> None:
    assert fields(Drawing)[:2] == (
        Field("shape_drawn", "ShapeDrawn", Circle | Square, False, NODEFAULT, True),
        Field("note", "Note", str, False, None, False),
    )
    assert fields(Drawing)[2:] == (
        Field("count", "Count", int, False, 3, False),
        Field("done", "Done", bool, False, False, False),
        Field("colors", "Colors", Color, True, (), False),
        Field("values", "Values", dict[str, Value], False, {}, False),
        Field("by", "By", str, False, "me", False),
    )
    assert [camel(name) for name in ("terms_id", "a", "a_b_c", "aB")] == ["TermsId", "A", "ABC", "AB"]


@pytest.mark.parametrize(
    ("hint", "value", "content"),
    [
        (str, "a<b", "a&lt;b"),
        (float, 1.5, "1.5"),
        (float, float("inf"), "INF"),
        (float, float("-inf"), "-INF"),
        (float, float("nan"), "NaN"),
        (int, -7, "-7"),
        (int, 10**18 - 1, "999999999999999999"),
        (int, 1 - 10**18, "-999999999999999999"),
        (bool, True, "true"),
        (bool, False, "false"),
        (Color, Color.DARK, "dark red"),
        (Circle | Square, Square(2), "<m:Square><m:Side>2</m:Side></m:Square>"),
        (Square, Square(2), "<m:Side>2</m:Side>"),
        (dict[str, str], {"a": "b", 'c"\n': "d"}, '<m:Entry name="a">b</m:Entry><m:Entry name="c&quot;&#10;">d</m:Entry>'),
        (
            dict[str, Value],
            {"a": 1.0, "b": True},
            '<m:Entry name="a" kind="number">1.0</m:Entry><m:Entry name="b" kind="truth">true</m:Entry>',
        ),
    ],
)
def test_an_element_with_a_value(hint: Any, value: object, content: str) -> None:
    assert written(hint, value) == f'<m:E a="b">{content}</m:E>'


@pytest.mark.parametrize(("value", "content"), [("x", ' kind="text">x'), (1.0, ' kind="number">1.0'), (False, ' kind="truth">false')])
def test_a_value_says_of_which_kind_it_is(value: object, content: str) -> None:
    assert written(Value, value) == f'<m:E a="b"{content}</m:E>'


@pytest.mark.parametrize(
    ("hint", "value", "text"),
    [
        (int, 10**18, "E: whole numbers have up to 18 digits, and this is 1000000000000000000"),
        (int, -(10**18), "E: whole numbers have up to 18 digits, and this is -1000000000000000000"),
        (int, 10**50, f"E: whole numbers have up to 18 digits, and this is {10**39}"),
        (str, "\x00" + "a" * 70, f"E: this text has a character that XML cannot carry: {chr(0) + 'a' * 59!r}"),
        (dict[str, str], {"\x00" + "a" * 70: ""}, f"a name has a character that XML cannot carry: {chr(0) + 'a' * 59!r}"),
    ],
)
def test_what_cannot_be_written(hint: Any, value: object, text: str) -> None:
    assert refusal(lambda: written(hint, value)) == text


@pytest.mark.parametrize(
    ("text", "between_tags", "between_quotes"),
    [
        ("a b", "a b", "a b"),
        ("&<>", "&amp;&lt;&gt;", "&amp;&lt;&gt;"),
        (">", "&gt;", "&gt;"),
        ("\r\n\t", "&#13;\n\t", "&#13;&#10;&#9;"),
        ("\"'", "\"'", "&quot;'"),
    ],
)
def test_what_has_a_meaning_in_xml_is_written_otherwise(text: str, between_tags: str, between_quotes: str) -> None:
    assert (escaped(text), escaped_attribute(text)) == (between_tags, between_quotes)


def test_what_is_as_it_always_is_is_left_out() -> None:
    def content(value: Drawing) -> str:
        document: list[str] = []
        fields_writer(Drawing)(document, value)
        return "".join(document)

    round_one = "<m:ShapeDrawn><m:Circle></m:Circle></m:ShapeDrawn>"
    assert content(Drawing(Circle(), None, by=None)) == content(Drawing(Circle(), None)) == round_one
    full = Drawing(Circle(2.0), "n", 4, True, (Color.RED, Color.RED), {"a": "b"}, "you")
    assert content(full) == (
        "<m:ShapeDrawn><m:Circle><m:Radius>2.0</m:Radius></m:Circle></m:ShapeDrawn><m:Note>n</m:Note><m:Count>4</m:Count><m:Done>true</m:Done>"
        '<m:Colors>red</m:Colors><m:Colors>red</m:Colors><m:Values><m:Entry name="a" kind="text">b</m:Entry></m:Values><m:By>you</m:By>'
    )
    assert struct_reader(Drawing, X)(element(content(full))) == full
    assert struct_reader(Drawing, X)(element(round_one)) == Drawing(Circle(), None)


@pytest.mark.parametrize(
    ("hint", "text", "value"),
    [
        (str, " a ", " a "),
        (str, "", ""),
        (float, " 1.5\n", 1.5),
        (float, "-INF", float("-inf")),
        (int, " 7 ", 7),
        (int, "+07", 7),
        (int, "-999999999999999999", 1 - 10**18),
        (bool, " true ", True),
        (bool, "1", True),
        (bool, "false", False),
        (bool, "0", False),
        (Color, " dark red\n", Color.DARK),
        (Circle | Square, "\n<m:Square><m:Side>2</m:Side></m:Square>\n", Square(2)),
        (dict[str, float], ' <m:Entry name="a">1</m:Entry> <m:Entry name="b">2</m:Entry>', {"a": 1.0, "b": 2.0}),
        (dict[str, Value], '<m:Entry name="a">1</m:Entry><m:Entry name="b" kind="number">1</m:Entry>', {"a": "1", "b": 1.0}),
    ],
)
def test_what_an_element_means(hint: Any, text: str, value: object) -> None:
    result = reader(hint, X)(element(text))
    assert (result, type(result)) == (value, type(value))


@pytest.mark.parametrize(
    ("hint", "text", "problem"),
    [
        (str, "<a/>", "E: text was expected, and there are elements in it"),
        (float, "1_0", "E: '1_0' is no number"),
        (float, "x" * 50, f"E: '{'x' * 40}' is no number"),
        (float, "١", "E: '١' is no number"),
        (int, "", "E: '' is no whole number"),
        (int, "--1", "E: '--1' is no whole number"),
        (int, "1.0", "E: '1.0' is no whole number"),
        (int, "²", "E: '²' is no whole number"),
        (int, "1" * 19, f"E: '{'1' * 19}' is no whole number"),
        (int, "-" + "1" * 50, f"E: '-{'1' * 39}' is no whole number"),
        (bool, "True" * 11, f"E: '{'True' * 10}' is neither true nor false"),
        (Color, "blue" * 11, f"E: '{'blue' * 10}' is none of red, dark red"),
        (Circle | Square, "", "E: one of Circle, Square was expected in it"),
        (Circle | Square, "<m:Circle/><m:Circle/>", "E: one of Circle, Square was expected in it"),
        (Circle | Square, "<Circle/>", "E: one of Circle, Square was expected in it"),
        (Circle | Square, "x<m:Circle/>", "E: elements were expected, and there is text in it"),
        (dict[str, str], "<m:Entry/>", "E: only Entry elements with a name were expected in it"),
        (dict[str, str], '<m:Other name="a"/>', "E: only Entry elements with a name were expected in it"),
        (dict[str, str], f'<m:Entry name="{"a" * 50}"/>' * 2, f"E: two entries are named '{'a' * 40}'"),
        (Square, "", "E: Side is missing in it"),
        (Square, "<m:Side>1</m:Side><m:Side>1</m:Side>", "E: Side is there twice"),
        (Square, "<m:Size>1</m:Size>", "E: Size in urn:x is unknown in it"),
        (Square, "<Side>1</Side>", "E: Side in None is unknown in it"),
        (Square, "<m:Side>x</m:Side>", "Side: 'x' is no whole number"),
    ],
)
def test_what_means_nothing(hint: Any, text: str, problem: str) -> None:
    assert refusal(lambda: reader(hint, X)(element(text))) == problem


def test_a_value_is_of_one_of_three_kinds() -> None:
    def read(kind: str, text: str) -> object:
        return reader(Value, X)(etree.fromstring(f'<E kind="{kind}">{text}</E>'))

    assert [read("number", "1"), read("truth", "1"), read("text", "1"), reader(Value, X)(element("1"))] == [1.0, True, "1", "1"]
    assert refusal(lambda: read("z" * 50, "1")) == f"E: kind is number, text or truth, and not '{'z' * 40}'"


def test_elements_that_are_somebody_elses_are_passed_over_and_the_order_is_free() -> None:
    read = struct_reader(Drawing, X, frozenset((f"{{{X}}}Version",)))
    drawing = read(element("<m:Done>1</m:Done><m:Version/><m:Colors>red</m:Colors><m:ShapeDrawn><m:Circle/></m:ShapeDrawn>"))
    assert drawing == Drawing(Circle(), None, done=True, colors=(Color.RED,))


@pytest.mark.parametrize(("value", "text"), [(1, "1"), (0.1, "0.1"), (True, "true"), ("x", "x"), (1e300, "1e+300")])
def test_a_simple_value_as_text(value: float | str | bool, text: str) -> None:
    assert text_of(value) == text
