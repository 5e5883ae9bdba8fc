"""The formula language: what is printed is read back, mistakes are shown in their place, and the documentation is true."""

from __future__ import annotations

import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.entish.formula import (
    And,
    Arithmetic,
    Attribute,
    Call,
    Comparison,
    Exists,
    ForAll,
    Formula,
    Name,
    Not,
    Number,
    Or,
    Relation,
    Term,
    Text,
    Truth,
    Variable,
    alternatives,
    conjunction,
    count_alternatives,
    disjunction,
    literals,
    substitute,
    variables,
)
from somrs.entish.parse import KEYWORDS, nearest, parse, read
from somrs.errors import FormulaError
from somrs.ontology.check import check
from somrs.ontology.files.loading import load_text, upper
from tests.support.paths import ROOT

DOCUMENT = ROOT / "docs" / "reference" / "entish.md"

SITE = """
map: Lab
objects:
  Lab:
    type: Building
    parts:
      Storey1: {type: Storey, parts: {Floor1: {type: Floor, at: [0, 0, 0], Shape: {Form: Box, Width: 9, Depth: 9, Height: 0}}}}
      Room1: {type: Room}
      Room2: {type: Room}
      Door1: {type: Door, at: [4, 4, 0], Shape: {Form: Box, Width: 1, Depth: 0.1, Height: 2}}
      Table1: {type: Table, at: [1, 1, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.7}}
      Table2: {type: Table, at: [8, 8, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.7}}
  Jar1: {type: Jar, at: [1, 1, 0.7]}
  Jar2: {type: Jar, at: [1.2, 1, 0.7]}
  Robot1: {type: PioneerP3DX, at: [3, 3, 0]}
facts:
  - Jar1 isOn Table1
"""

# Formulas as a person might build them

words = st.from_regex(r"[A-Za-zäöüßŁćжλ東]\w{0,5}(-\w{1,3}){0,2}", fullmatch=True).filter(lambda word: word not in KEYWORDS)
names = words.map(Name)
types = {"x": "Jar", "y": None, "Provider": "Device", "höhe-2": "number"}
variable_terms = st.sampled_from([Variable(name, type_name) for name, type_name in types.items()])
numbers = st.builds(
    Number,
    st.floats(allow_nan=False, allow_infinity=False) | st.integers(-1000, 1000).map(float),
    st.none() | st.sampled_from(["g", "kg", "m/s", "m/s^2", "%", "°", "°C", "kg*m**2", "EUR", "µm"]),
)
objects = names | variable_terms
attributes = st.builds(Attribute, objects, st.lists(words, min_size=1, max_size=3).map(".".join))
simple_terms: st.SearchStrategy[Term] = objects | attributes | numbers | st.builds(Text, st.text()) | st.booleans().map(Truth)
calls = st.builds(Call, words, st.lists(simple_terms, max_size=3).map(tuple))
all_terms = simple_terms | calls
relations = st.builds(Relation, words, st.lists(objects, max_size=4).map(tuple))
counted = attributes | numbers | calls | variable_terms
products = st.builds(Arithmetic, counted, st.just("*"), counted)
sums = st.builds(Arithmetic, counted | products, st.sampled_from("+-"), counted | products)
sides = all_terms | products | sums
comparisons = st.builds(Comparison, sides, st.sampled_from(["=", "!=", "<", "<=", ">", ">="]), sides)
atoms = relations | comparisons
formulas: st.SearchStrategy[Formula] = st.recursive(
    atoms | st.builds(Not, atoms),
    lambda inner: st.one_of(
        st.lists(inner, min_size=1, max_size=4).flatmap(
            lambda parts: st.sampled_from([conjunction(*parts), disjunction(*parts)]),
        ),
        st.builds(ForAll, variable_terms, inner),
        st.builds(Exists, variable_terms, inner),
    ),
    max_leaves=12,
)


@given(formulas)
def test_what_is_printed_is_read_back(formula: Formula) -> None:
    assert parse(str(formula)) == formula


@given(formulas)
def test_every_atom_is_found_in_its_place(formula: Formula) -> None:
    reading = read(str(formula))
    for (atom, term), place in reading.places.items():
        rest = reading.text[place:]
        match term:
            case None:
                sign = atom.operator if isinstance(atom, Comparison) else atom.relation
                assert rest.startswith(sign)
            case Name(name):
                assert rest.startswith(name)
            case Variable(name):
                assert rest.startswith(f"?{name}")
            case Attribute(_, path):
                assert rest.startswith(path)
            case Call(function):
                assert rest.startswith(function)
            case Arithmetic(_, operator):
                assert rest.startswith(operator)
            case _:
                assert rest.startswith(str(term))
    assert {atom for atom, _ in reading.places} == {part.atom if isinstance(part, Not) else part for part in literals(formula)}


@given(
    st.text()
    | st.lists(st.sampled_from([*KEYWORDS, "a", "?x", ":", "isOn", "(", ")", ".", ",", "=", "5", "m", '"t"', "#", "\n"])).map(" ".join)
)
def test_any_text_is_a_formula_or_an_error_in_its_place(text: str) -> None:
    try:
        formula = parse(text)
    except FormulaError as caught:
        error = caught
    else:
        assert parse(str(formula)) == formula
        return
    assert 0 <= error.position <= len(text)
    assert "^" in str(error)


@given(formulas)
def test_alternatives_are_as_many_as_counted(formula: Formula) -> None:
    assert len(list(alternatives(formula))) == count_alternatives(formula)


def test_and_binds_closer_than_or() -> None:
    first_atom, second_atom, third_atom = Relation("is", (Name("a"),)), Relation("is", (Name("b"),)), Relation("is", (Name("c"),))
    assert parse("is(a) AND is(b) OR is(c)") == Or((And((first_atom, second_atom)), third_atom))
    assert parse("is(a) AND (is(b) OR is(c))") == And((first_atom, Or((second_atom, third_atom))))
    assert parse("NOT (is(a)) AND NOT is(b)") == And((Not(first_atom), Not(second_atom)))


def test_keywords_may_begin_names() -> None:
    assert parse("ORanges isOn ANDes AND NOTebook isOn OR-gate") == And(
        (Relation("isOn", (Name("ORanges"), Name("ANDes"))), Relation("isOn", (Name("NOTebook"), Name("OR-gate")))),
    )


def test_a_type_written_once_holds_everywhere() -> None:
    formula = parse("?x isOn A AND ?x: Jar isOn B")
    assert variables(formula) == {"x": Variable("x", "Jar")}
    assert str(formula) == "?x: Jar isOn A AND ?x isOn B"


def test_substitution_reaches_attributes_and_functions() -> None:
    formula = parse("?x.Weight < 5 AND distance(?x, ?y) < 2 m")
    assert str(substitute(formula, {"x": Name("Jar1")})) == "Jar1.Weight < 5 AND distance(Jar1, ?y) < 2 m"


@pytest.mark.parametrize(
    ("text", "position", "problem"),
    [
        ("", 0, "there is no formula here"),
        ("a isOn", 6, "ends too early"),
        ("a isOn b AND\n  c isOn  ", 21, "ends too early"),
        ("a isOn b and c isOn d", 9, "'and' does not fit"),
        ("a isOn b AND OR isOn c", 13, "'OR' does not fit"),
        ("a isOn 5", 7, "5 is not one"),
        ("a.b = 1e999", 6, "beyond what a number can be"),
        ("a.b = -1e999 kg", 6, "beyond what a number can be"),
        ('a.b = "\\q"', 6, "cannot be read"),
        ("a isOn b $", 9, "'$' does not fit"),
        ("?x: Jar isOn b AND ?x : Can isOn c", 24, "?x cannot be both Jar and Can"),
        ("(" * 101 + "a isOn b" + ")" * 101, 100, "more than 100 parentheses"),
    ],
)
def test_mistakes_are_shown_in_their_place(text: str, position: int, problem: str) -> None:
    with pytest.raises(FormulaError) as caught:
        parse(text)
    assert caught.value.position == position
    assert problem in caught.value.problem


def test_the_caret_stands_below_the_mistake_in_its_line() -> None:
    with pytest.raises(FormulaError) as caught:
        parse("a isOn b AND\nc isOn 7 OR d isOn e")
    assert str(caught.value).splitlines()[1:3] == ["  c isOn 7 OR d isOn e", "         ^"]


def test_nearest_names() -> None:
    assert nearest("isom", ["isOn", "connects"]) == "did you mean isOn?"
    assert nearest("JAR002", ["Jar002"]) == "did you mean Jar002?"
    assert nearest("xyz", ["Jar002"]) == ""


def test_texts_have_the_escapes_of_json() -> None:
    text = 'a "quoted" \\ line\nend\t\x00€'
    assert parse(f"a.b = {json.dumps(text)}") == Comparison(Attribute(Name("a"), "b"), "=", Text(text))


# The documentation


def blocks(tag: str) -> list[str]:
    return re.findall(rf"^```{tag}\n(.*?)^```", DOCUMENT.read_text("utf-8"), re.DOTALL | re.MULTILINE)


def test_the_examples_in_the_documentation_fit_a_map() -> None:
    loaded = load_text(SITE, base=upper())
    examples = [example for block in blocks("entish") for example in block.split("\n\n")]
    assert len(examples) >= 12
    for example in examples:
        check(example, loaded.ontology, loaded.map)


def test_the_mistakes_in_the_documentation_get_their_messages() -> None:
    loaded = load_text(SITE, base=upper())
    wrong, messages = blocks("entish-error"), blocks("text")
    assert len(wrong) == len(messages) == 3
    for text, message in zip(wrong, messages, strict=True):
        with pytest.raises(FormulaError) as caught:
            check(text.rstrip("\n"), loaded.ontology, loaded.map)
        assert str(caught.value) == message.rstrip("\n")


@pytest.mark.parametrize(
    "text",
    [
        "?P.Charge - 5 % >= 2 * distance(?A, ?B)",
        "R.Charge = R.Charge - 5 + 2 * R.Level * 3 - -1",
        "range(A) + 1 m > 3 m AND p(A)",
        "(p(A) OR A.X * 2 <= 3) AND NOT A.X + 4 %/m = ?v: number",
    ],
)
def test_numbers_are_calculated_with(text: str) -> None:
    assert str(parse(text)) == text
    assert parse(str(parse(text))) == parse(text)


@pytest.mark.parametrize(
    ("text", "problem"), [("A.X = Red + 1", "Red is no number"), ("A.X = 2 * TRUE", "TRUE is no number"), ("A + B isOn C", "isOn")]
)
def test_what_is_no_number_is_not_calculated_with(text: str, problem: str) -> None:
    with pytest.raises(FormulaError, match=problem):
        parse(text)
