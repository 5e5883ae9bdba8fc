"""What is said of a text that is no formula, what can come next in one, where its parts stand, and terms by themselves."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from somrs.entish.formula import Comparison, Name, Term, Variable
from somrs.entish.parse import MAX_COMPARED_NAMES, MAX_DEPTH, nearest, parse, parse_beginning, parse_term, read
from somrs.errors import FormulaError

TERM = 'a name, a variable such as ?Shelf, a number, a text in "quotes"'
ANY_TERM = f"expected {TERM} or TRUE or FALSE"
ANY_FORMULA = f"expected {TERM}, TRUE or FALSE, NOT, FORALL or EXISTS or ("
EARLY = "the formula ends too early"
NO_TERM = "write a number, an attribute such as ?Jar.Weight, or a function such as range(?Provider)"


def refusal(read: Callable[[str], object], text: str) -> tuple[int, str, str]:
    with pytest.raises(FormulaError) as caught:
        read(text)
    assert caught.value.text == text
    return caught.value.position, caught.value.problem, caught.value.hint


@pytest.mark.parametrize(
    ("text", "position", "problem", "hint"),
    [
        ("", 0, "there is no formula here", ANY_FORMULA),
        ("  ", 0, "there is no formula here", ANY_FORMULA),
        ("a", 1, EARLY, "expected a name, a comparison (= != < <= > >=), + or -, *, ( or . and an attribute"),
        ("a isOn ", 6, EARLY, ANY_TERM),
        ("a isOn b AND", 12, EARLY, ANY_FORMULA),
        ("NOT", 3, EARLY, f"expected {TERM}, TRUE or FALSE, NOT, FORALL or EXISTS or ("),
        (
            "?x $",
            3,
            "'$' does not fit here",
            "expected a name, a comparison (= != < <= > >=), + or -, *, AND, OR, ), ,, : and a type or . and an attribute",
        ),
        ("?x:", 3, EARLY, "expected a name"),
        ("f(", 2, EARLY, f"expected {TERM}, TRUE or FALSE or )"),
        ("f(a.b", 5, EARLY, "expected ) or ,"),
        ("(a isOn b.c", 11, EARLY, "expected )"),
        ("a isOn b and c isOn d", 9, "'and' does not fit here", "expected AND, OR, (, . and an attribute or the end of the formula"),
        ("a.b = 5 (", 8, "'(' does not fit here", "expected a unit, + or -, *, AND, OR or the end of the formula"),
        ("a isOn b)", 8, "')' does not fit here", "expected the end of the formula"),
        (
            "a.b = 5 $",
            8,
            "'$' does not fit here",
            "expected a name, a unit, a comparison (= != < <= > >=), + or -, *, AND, OR, ) or ,",
        ),
        ('"a', 0, "'\"' does not fit here", ANY_FORMULA),
        ("a.b = 1e999", 6, "1e999 is beyond what a number can be", "the largest is about 1.8e308"),
        ('a.b = "\\q"', 6, "this text cannot be read: Invalid \\escape", "escapes are those of JSON"),
        ("a isOn f(b, c)", 7, "the relation isOn joins objects, and f(b, c) is not one", ""),
        ("a isOn b.c", 9, "the relation isOn joins objects, and b.c is not one", ""),
        ("?x: Jar isOn b AND ?x : Can isOn c", 24, "?x cannot be both Jar and Can", "give the type once"),
        ("A.X = Red + 1", 6, "Red is no number", "+ is for numbers"),
        ("A.X = 1 - Red", 10, "Red is no number", "- is for numbers"),
        ('A.X = 2 * "r"', 10, '"r" is no number', "* is for numbers"),
        ("A.X = 2 * TRUE", 10, "TRUE is no number", "* is for numbers"),
    ],
)
def test_what_is_said_of_what_is_no_formula(text: str, position: int, problem: str, hint: str) -> None:
    assert refusal(parse, text) == (position, problem, hint)


@pytest.mark.parametrize("read_", [parse, parse_beginning])
def test_only_parentheses_that_are_open_and_no_part_of_a_text_count(read_: Callable[[str], object]) -> None:
    deep = "(" * MAX_DEPTH
    prefix = f'{deep}a isOn b{")" * MAX_DEPTH} AND a.L = "((" AND # ((\n'
    assert read_(f"{prefix}{deep}a isOn b{')' * MAX_DEPTH}")
    problem = f"more than {MAX_DEPTH} parentheses within each other"
    assert refusal(read_, f"{prefix}{deep}(a isOn b") == (len(prefix) + MAX_DEPTH, problem, "write it flatter")


def test_negations_and_operations_are_limited() -> None:
    assert parse("NOT " * MAX_DEPTH + "a isOn b")
    assert refusal(parse, "NOT " * (MAX_DEPTH + 1) + "a isOn b")[1:] == (
        f"more than {MAX_DEPTH} NOTs in a row",
        "two NOTs cancel each other",
    )
    assert parse("a.W = 1" + " + 1" * MAX_DEPTH)
    problem = f"more than {MAX_DEPTH} operations in one expression"
    assert refusal(parse, "a.W = 1" + " + 1" * (MAX_DEPTH + 1))[1:] == (problem, "write a shorter sum")


@pytest.mark.parametrize(
    ("text", "tokens", "next_kinds"),
    [
        ("", "", "LPAR NAME NUMBER QUANTIFIER STRING TRUTH VARIABLE _NOT"),
        ("a isOn", "NAME:a NAME:isOn", "NAME NUMBER STRING TRUTH VARIABLE"),
        ("a isOn b", "NAME:a NAME:isOn NAME:b", "$END DOT LPAR _AND _OR"),
        ("a.b = 5", "NAME:a DOT:. NAME:b OPERATOR:= NUMBER:5", "$END SIGN TIMES UNIT _AND _OR"),
        ("NOT f(?a", "_NOT:NOT NAME:f LPAR:( VARIABLE:?a", "COLON COMMA DOT RPAR"),
    ],
)
def test_what_can_come_next(text: str, tokens: str, next_kinds: str) -> None:
    token_pairs = [tuple(token.split(":")) for token in tokens.split()]
    assert parse_beginning(text) == (token_pairs, frozenset(next_kinds.split()))


@pytest.mark.parametrize("text", ["a $", "isOn AND", "a isOn b c"])
def test_no_formula_begins_so(text: str) -> None:
    assert parse_beginning(text) is None


@pytest.mark.parametrize("text", ["?x.Weight", "range(?P)", "5 kg", "1 + 2 * a.b", "TRUE", "Red", '"t"'])
def test_terms_are_read_by_themselves(text: str) -> None:
    term: Term = parse_term(text)
    assert str(term) == text


@pytest.mark.parametrize(
    ("text", "position", "hint"),
    [
        ("", 0, ANY_FORMULA),
        ("a +", 3, ANY_TERM),
        ("a.b # it is heavy", 17, "expected a name, a comparison (= != < <= > >=), + or - or *"),
        ("a = 0 AND b", 0, NO_TERM),
        ("a = 1 #", 0, NO_TERM),
    ],
)
def test_what_is_said_of_what_is_no_term(text: str, position: int, hint: str) -> None:
    assert refusal(parse_term, text) == (position, "this is no term", hint)


def test_where_the_parts_of_a_formula_stand() -> None:
    text = "?x: Jar isOn b AND NOT a.b.c = f(?x, 5 kg) OR a.d < 2 * g() OR ?x isOn b OR a.L = TRUE"
    reading = read(text)
    places = {(str(atom), None if term is None else str(term)): place for (atom, term), place in reading.places.items()}
    relation_text, equation_text, comparison_text, truth_text = "?x: Jar isOn b", "a.b.c = f(?x: Jar, 5 kg)", "a.d < 2 * g()", "a.L = TRUE"
    assert places == {
        (relation_text, None): 8,
        (relation_text, "?x: Jar"): 0,
        (relation_text, "b"): 13,
        (equation_text, None): 29,
        (equation_text, "a.b.c"): 25,
        (equation_text, "a"): 23,
        (equation_text, "f(?x: Jar, 5 kg)"): 31,
        (equation_text, "?x: Jar"): 33,
        (equation_text, "5 kg"): 37,
        (comparison_text, None): 50,
        (comparison_text, "a.d"): 48,
        (comparison_text, "a"): 46,
        (comparison_text, "2 * g()"): 54,
        (comparison_text, "2"): 52,
        (comparison_text, "g()"): 56,
        (truth_text, None): 80,
        (truth_text, "a.L"): 78,
        (truth_text, "a"): 76,
        (truth_text, "TRUE"): 82,
    }
    assert reading.types == {Variable("x", "Jar"): 4}


def test_what_has_no_place_is_shown_at_the_beginning() -> None:
    reading = read("a isOn ?x: Jar")
    comparison = Comparison(Name("b"), "=", Name("c"))
    assert reading.error(comparison, None, "it is wrong").position == 0
    assert reading.type_error(Variable("y"), "it is wrong", "mend it").position == 0
    error = reading.type_error(Variable("x", "Jar"), "it is wrong", "mend it")
    assert (error.text, error.position, error.problem, error.hint) == ("a isOn ?x: Jar", 11, "it is wrong", "mend it")


@pytest.mark.parametrize(
    ("name", "known_names", "hint"),
    [
        ("Jar", ["Jar4", "JAR1", "Jar2", "Jar3"], "did you mean Jar4 or Jar3 or Jar2?"),
        ("abcde", ["abcXX"], "did you mean abcXX?"),  # just like enough
        ("abcde", ["abXXX"], ""),
        ("Robot", [*(f"Cupboard{n}" for n in range(2 * MAX_COMPARED_NAMES)), "ROBTO"], "did you mean ROBTO?"),
        ("Robot", [*(f"Cupboard{n}" for n in range(2 * MAX_COMPARED_NAMES))], ""),
    ],
)
def test_which_names_are_nearest(name: str, known_names: list[str], hint: str) -> None:
    assert nearest(name, known_names) == hint


@pytest.mark.parametrize(
    "text",
    [
        "a.L = " + " + ".join(["1"] * 5_000),
        "a.L = " + " - ".join(["b.L"] * 5_000),
        "a.L = " + "*".join(["b.L"] * 5_000),
        "NOT " * 90 + "(" + "NOT " * 90 + "a isOn b" + ")",
        ("NOT " * 50 + "(") * 90 + "a isOn b" + ")" * 90,
        "EXISTS ?x (" * 5_000 + "a isOn b" + ")" * 5_000,
        "f(" * 5_000,
    ],
)
def test_formulas_that_would_need_much_stack_are_refused(text: str) -> None:
    for read_text in (parse, parse_beginning):
        with pytest.raises(FormulaError, match="more than 100"):
            read_text(text)


def test_formulas_that_are_long_and_flat_are_read() -> None:
    for text in (
        " AND ".join(["NOT a isOn b"] * 2_000),
        " OR ".join(["a.L + 1 - 2 = b.L * 3"] * 2_000),
        "a.L = " + " + ".join(["1"] * 100),
        ("NOT (" * 50) + "a isOn b" + ")" * 50,
    ):
        parse(text)
