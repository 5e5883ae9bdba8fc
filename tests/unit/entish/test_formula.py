"""How formulas and terms are written, in text and in JSON."""

from __future__ import annotations

import msgspec
import pytest

from somrs.entish.formula import Arithmetic, Attribute, Call, Formula, Name, Number, Term, Text, Truth, Variable, names, terms
from somrs.entish.parse import parse


@pytest.mark.parametrize(
    ("term", "text", "built"),
    [
        (Name("A"), "A", {"is": "Name", "name": "A"}),
        (Variable("x", "Jar"), "?x: Jar", {"is": "Variable", "name": "x", "type": "Jar"}),
        (Number(2.0, "m"), "2 m", {"is": "Number", "value": 2.0, "unit": "m"}),
        (Text("ż"), '"ż"', {"is": "Text", "value": "ż"}),
        (Truth(True), "TRUE", {"is": "Truth", "value": True}),
        (Attribute(Name("A"), "B.C"), "A.B.C", {"is": "Attribute", "of": {"is": "Name", "name": "A"}, "path": "B.C"}),
        (Call("f", (Name("A"),)), "f(A)", {"is": "Call", "function": "f", "arguments": ({"is": "Name", "name": "A"},)}),
        (
            Arithmetic(Number(1), "+", Number(2)),
            "1 + 2",
            {
                "is": "Arithmetic",
                "left": {"is": "Number", "value": 1.0, "unit": None},
                "operator": "+",
                "right": {"is": "Number", "value": 2.0, "unit": None},
            },
        ),
    ],
)
def test_how_terms_are_written(term: Term, text: str, built: object) -> None:
    assert str(term) == text
    assert msgspec.to_builtins(term) == built


@pytest.mark.parametrize(
    ("text", "tag"),
    [
        ("A isOn B", "Relation"),
        ("A = B", "Comparison"),
        ("NOT A isOn B", "Not"),
        ("A isOn B AND B isOn A", "And"),
        ("A isOn B OR B isOn A", "Or"),
    ],
)
def test_how_formulas_are_written(text: str, tag: str) -> None:
    formula = parse(text)
    assert str(formula) == text
    assert msgspec.to_builtins(formula)["is"] == tag
    assert msgspec.json.decode(msgspec.json.encode(formula), type=Formula) == formula


def test_all_terms_in_their_order() -> None:
    formula = parse("NOT A isOn ?x AND (A.D + 2 < f(?y, B) OR C isOn A)")
    assert [str(term) for term in terms(formula)] == ["A", "?x", "A.D + 2", "A.D", "A", "2", "f(?y, B)", "?y", "B", "C", "A"]
    assert names(formula) == ("A", "B", "C")
