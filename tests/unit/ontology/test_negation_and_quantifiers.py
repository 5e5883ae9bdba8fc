"""NOT before anything, FORALL and EXISTS: what holds, compared with a plain twin that reads the formula as it was built, NOTs in place."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.entish.formula import Name
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.check import check
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.truth import bindings, formula_holds
from tests.support.examples import examples
from tests.support.small_ontology import ONTOLOGY, maps

TYPES = {"Object": ("Object", "Thing", "Jar", "Shelf"), "Thing": ("Thing", "Jar"), "Jar": ("Jar",)}


@dataclass(frozen=True)
class Node:
    """A formula as it is written: `word` is AND, OR, NOT, FORALL, EXISTS or a relation."""

    word: str
    parts: tuple[Node, ...] = ()
    variable: str = ""
    type: str = "Object"
    arguments: tuple[str, ...] = ()

    def __str__(self) -> str:
        match self.word:
            case "AND" | "OR":
                return f" {self.word} ".join(f"({part})" for part in self.parts)
            case "NOT":
                return f"NOT ({self.parts[0]})"
            case "FORALL" | "EXISTS":
                return f"{self.word} ?{self.variable}: {self.type} ({self.parts[0]})"
        return f"{self.word}({', '.join(self.arguments)})"


terms = st.sampled_from(["A", "B", "C", "?x", "?y", "?z"])
atoms = st.builds(lambda word, arguments: Node(word, arguments=arguments), st.sampled_from(["isOn", "isNear"]), st.tuples(terms, terms))
nodes: st.SearchStrategy[Node] = st.recursive(
    atoms,
    lambda inner: st.one_of(
        st.builds(lambda word, parts: Node(word, tuple(parts)), st.sampled_from(["AND", "OR"]), st.lists(inner, min_size=2, max_size=3)),
        st.builds(lambda part: Node("NOT", (part,)), inner),
        st.builds(
            lambda word, variable, type, part: Node(word, (part,), variable, type),
            st.sampled_from(["FORALL", "EXISTS"]),
            st.sampled_from("xyz"),
            st.sampled_from(list(TYPES)),
            inner,
        ),
    ),
    max_leaves=6,
)


def affirmed(node: Node) -> set[str]:
    """The variables outside NOT that no quantifier binds."""
    if node.word == "NOT":
        return set()
    own = {argument[1:] for argument in node.arguments if argument.startswith("?")}
    return (own | {name for part in node.parts for name in affirmed(part)}) - {node.variable}


def holds_somehow(node: Node, map: Map, bound: dict[str, str]) -> bool:
    """Whether the formula holds for some objects in place of its own variables."""
    new = sorted(affirmed(node) - bound.keys())
    if not new:
        return holds(node, map, bound)
    return any(holds_somehow(node, map, {**bound, new[0]: name}) for name in map.objects)


def holds(node: Node, map: Map, bound: dict[str, str]) -> bool:
    match node.word:
        case "AND":
            return all(holds(part, map, bound) for part in node.parts)
        case "OR":
            return any(holds(part, map, bound) for part in node.parts)
        case "NOT":
            return not holds_somehow(node.parts[0], map, bound)
        case "FORALL" | "EXISTS":
            each = [
                holds(node.parts[0], map, {**bound, node.variable: name})
                for name, object in map.objects.items()
                if object.type in TYPES[node.type]
            ]
            return all(each) if node.word == "FORALL" else any(each)
    names = tuple(bound[argument[1:]] if argument.startswith("?") else argument for argument in node.arguments)
    return map.has_fact(node.word, names) or (node.word == "isNear" and map.has_fact(node.word, names[::-1]))


@examples(300)
@given(nodes, maps())
def test_truth_is_that_of_the_plain_twin(node: Node, map: Map) -> None:
    formula = parse(str(node))
    assert formula_holds(formula, map, ONTOLOGY) == holds_somehow(node, map, {})
    for name in map.objects:
        for row in bindings(formula, map, ONTOLOGY):
            assert holds(node, map, {variable: str(term) for variable, term in row.items()})
        given_x = {"x": name} if "x" in affirmed(node) else {}
        found = any(True for _ in bindings(formula, map, ONTOLOGY, {variable: Name(value) for variable, value in given_x.items()}))
        assert found == holds_somehow(node, map, given_x)


@examples(300)
@given(nodes)
def test_what_is_printed_means_the_same(node: Node) -> None:
    formula = parse(str(node))
    assert parse(str(formula)) == formula


# By example

JARS = Map(
    [*(Object(name=name, type="Jar") for name in ("Jar1", "Jar2")), *(Object(name=name, type="Shelf") for name in ("Top", "Floor"))],
    [Fact("isOn", ("Jar1", "Top")), Fact("isOn", ("Jar2", "Floor"))],
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("FORALL ?Jar: Jar (?Jar isOn Top OR ?Jar isOn Floor)", True),
        ("FORALL ?Jar: Jar (?Jar isOn Top)", False),
        ("FORALL ?Jar: Jar (EXISTS ?Shelf: Shelf (?Jar isOn ?Shelf))", True),
        ("EXISTS ?Shelf: Shelf (FORALL ?Jar: Jar (?Jar isOn ?Shelf))", False),
        ("FORALL ?Jar: Jar (?Jar isOn ?Shelf)", False),  # one shelf for all
        ("NOT FORALL ?Jar: Jar (?Jar isOn Top)", True),
        ("NOT EXISTS ?Jar: Jar (?Jar isOn Top AND ?Jar.Color = Blue)", True),
        ("NOT (?Jar isOn Top AND ?Jar.Color = Red)", False),
        ("NOT (?Jar isOn Top AND ?Jar.Color = Blue)", True),
        ("NOT (Jar1 isOn Top OR Jar2 isOn Top)", False),
        ("NOT (NOT Jar1 isOn Top)", True),
        ("NOT NOT Jar1 isOn Top", True),
        ("EXISTS ?Jar: Jar (?Jar isOn Top) AND EXISTS ?Jar: Jar (?Jar isOn Floor)", True),
        ("?Jar isOn Top AND EXISTS ?Jar: Jar (?Jar isOn Floor)", True),  # two variables of one name
        ("NOT (?Jar: Jar.Size = ?size AND ?size > 3)", True),
        ("NOT (?Jar: Jar.Size = ?size AND ?size > 1)", False),
        # where there are no such objects
        ("FORALL ?Thing: Thing (?Thing isOn Top AND ?Thing: Thing isOn Floor)", False),
        ("FORALL ?x: Jar (FORALL ?y: Jar (?x isOn ?y OR NOT ?x isOn ?y))", True),
    ],
)
def test_what_holds_for_two_jars_on_two_shelves(text: str, expected: bool) -> None:
    assert formula_holds(parse(text), JARS, ONTOLOGY) is expected


def test_where_there_are_no_such_objects_forall_holds_and_exists_does_not() -> None:
    shelves = Map([Object(name="Top", type="Shelf")], [])
    assert formula_holds(parse("FORALL ?Jar: Jar (?Jar isOn Top)"), shelves, ONTOLOGY)
    assert formula_holds(parse("FORALL ?Jar: Jar (isNew(Top))"), shelves, ONTOLOGY)
    assert not formula_holds(parse("EXISTS ?Jar: Jar (NOT ?Jar isOn Top)"), shelves, ONTOLOGY)
    assert not formula_holds(parse("EXISTS ?Jar: Jar (NOT isNew(Top))"), shelves, ONTOLOGY)


def test_the_variable_outside_a_quantifier_is_answered() -> None:
    everywhere = JARS
    rows = list(bindings(parse("?Shelf: Shelf != Floor AND FORALL ?Jar: Jar (NOT ?Jar isOn ?Shelf OR ?Jar = Jar1)"), everywhere, ONTOLOGY))
    assert [str(row["Shelf"]) for row in rows] == ["Top"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "FORALL ?Jar: Jra (?Jar isOn Top)",
            "there is no type Jra\n  FORALL ?Jar: Jra (?Jar isOn Top)\n               ^\ndid you mean Jar?",
        ),
        (
            "EXISTS ?Jar: Jar (?Jar isOm Top)",
            "there is no relation isOm\n  EXISTS ?Jar: Jar (?Jar isOm Top)\n                         ^\ndid you mean isOn?",
        ),
        (
            "FORALL ?Jar: Jar (?Jar.Open = 3) AND EXISTS ?Jar: Shelf (?Jar isOn Nowhere)",
            "?Jar: Jar.Open is TRUE or FALSE, and 3 is a number\n"
            "  FORALL ?Jar: Jar (?Jar.Open = 3) AND EXISTS ?Jar: Shelf (?Jar isOn Nowhere)\n"
            "                                ^",
        ),
        (
            "NOT (Jar1 isOn Top OR Jar1 isOm Top)",
            "there is no relation isOm\n  NOT (Jar1 isOn Top OR Jar1 isOm Top)\n                             ^\ndid you mean isOn?",
        ),
    ],
)
def test_mistakes_are_shown_in_their_place(text: str, message: str) -> None:
    with pytest.raises(FormulaError) as caught:
        check(text, ONTOLOGY, JARS)
    assert str(caught.value) == message


def test_variables_of_one_name_may_have_different_types() -> None:
    check("FORALL ?x: Jar (?x.Color = Red) AND EXISTS ?x: Shelf (Jar1 isOn ?x)", ONTOLOGY, JARS)
