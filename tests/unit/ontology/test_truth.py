"""What is true in a map, compared with a plain twin that tries every assignment."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import pytest
from hypothesis import assume, given

from somrs.entish.formula import (
    Attribute,
    Call,
    Comparison,
    Condition,
    Formula,
    Name,
    Not,
    Number,
    Relation,
    Term,
    Text,
    Truth,
    Variable,
    alternatives,
    conjunction,
    literals,
    terms,
    variables,
)
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.truth import bindings, evaluate, formula_holds
from somrs.ontology.types import FunctionType, Ontology, Value
from tests.support.examples import examples
from tests.support.small_ontology import ONTOLOGY, formulas, maps

# The twin: reads values, compares and assigns in the most direct way, in metres and centimetres only

Assignment = dict[str, Term]


def read_plain(term: Term, map: Map, chosen: Assignment) -> tuple[Term, float] | None:
    match term:
        case Variable(name):
            return chosen[name], 0.0
        case Call("size", (argument,)):
            assert isinstance(argument, Name | Variable)
            return read_plain(Attribute(argument, "Size"), map, chosen)
        case Call(_, (first_object, second_object)):
            assert isinstance(first_object, Name | Variable)
            assert isinstance(second_object, Name | Variable)
            total = 0.0
            for path in ("PositionX", "PositionY", "PositionZ"):
                first_value, second_value = (
                    read_plain(Attribute(endpoint, path), map, chosen) for endpoint in (first_object, second_object)
                )
                if first_value is not None and second_value is not None:
                    assert isinstance(first_value[0], Number)
                    assert isinstance(second_value[0], Number)
                    total += (first_value[0].value - second_value[0].value) ** 2
                elif path != "PositionZ":
                    return None
            return Number(math.sqrt(total), "m"), 0.0
        case Attribute(owner_term, path):
            owner = chosen[owner_term.name] if isinstance(owner_term, Variable) else owner_term
            assert isinstance(owner, Name)
            if owner.name not in map.objects:
                return None
            object = map.objects[owner.name]
            defaults: dict[str, dict[str, Value]] = {
                "Thing": {"Open": True, "Size": 2.0},
                "Jar": {"Open": True, "Size": 2.0, "Color": "Red"},
            }
            value = object.values.get(path, defaults.get(object.type, {}).get(path))
            match value:
                case None:
                    return None
                case bool():
                    return Truth(value), 0.0
                case str():
                    return (Name(value) if path == "Color" else Text(value)), 0.0
                case _:
                    return Number(value, "m"), 0.5 if path == "Size" else 0.0
    return term, 0.0


def metres(number: Number) -> float:
    return number.value / 100 if number.unit == "cm" else number.value


def literal_holds(literal: Condition, map: Map, chosen: Assignment) -> bool:
    match literal:
        case Not(atom):
            hidden = [name for name in variables(atom) if name not in chosen]
            return not any(
                literal_holds(atom, map, {**chosen, **dict(zip(hidden, choice, strict=True))})
                for choice in itertools.product(*(domain(variables(atom)[name], map) for name in hidden))
            )
        case Relation(relation, arguments):
            object_names = tuple(str(chosen[argument.name] if isinstance(argument, Variable) else argument) for argument in arguments)
            symmetric = relation in ("isNear", "isPairedWith")
            return Fact(relation, object_names) in [*map.facts()] or (symmetric and Fact(relation, object_names[::-1]) in [*map.facts()])
        case Comparison(left_term, operator, right_term):
            left_value, right_value = read_plain(left_term, map, chosen), read_plain(right_term, map, chosen)
            if left_value is None or right_value is None:
                return False
            (left_constant, left_tolerance), (right_constant, right_tolerance) = left_value, right_value
            if isinstance(left_constant, Number) and isinstance(right_constant, Number):
                gap = metres(left_constant) - metres(right_constant)
                if abs(gap) <= max(left_tolerance, right_tolerance) + 1e-7:
                    gap = 0.0
                return {"=": gap == 0, "!=": gap != 0, "<": gap < 0, "<=": gap <= 0, ">": gap > 0, ">=": gap >= 0}[operator]
            if (
                isinstance(left_constant, Truth) != isinstance(right_constant, Truth)
                or isinstance(left_constant, Number)
                or isinstance(right_constant, Number)
            ):
                return False
            return {
                "=": str(left_constant).strip('"') == str(right_constant).strip('"'),
                "!=": str(left_constant).strip('"') != str(right_constant).strip('"'),
            }.get(operator, False)
    raise AssertionError("these formulas have no quantifiers")


def domain(variable: Variable, map: Map) -> list[Term]:
    subtypes = {"Thing": ("Thing", "Jar"), "Shelf": ("Shelf",)}
    return [Name(o.name) for o in map.objects.values() if variable.type is None or o.type in subtypes[variable.type]]


def equations_of(branch: tuple[Condition, ...], name: str) -> list[Term]:
    """What `?name` is said to equal: terms that read something first, then variables, as they are written."""
    equal_terms = [
        other_side
        for part in branch
        if isinstance(part, Comparison) and part.operator == "="
        for side, other_side in ((part.left, part.right), (part.right, part.left))
        if side == Variable(name)
    ]
    return sorted(equal_terms, key=lambda term: isinstance(term, Variable))


def plain_rows(formula: Formula, map: Map) -> Iterator[Assignment]:
    free = {n: v for part in literals(formula) if not isinstance(part, Not) for n, v in variables(part).items()}
    for branch in alternatives(formula):
        objects = [name for name in free if name in "xyz"]
        for choice in itertools.product(*(domain(free[name], map) for name in objects)):
            chosen: Assignment = dict(zip(objects, choice, strict=True))
            if assign_values(branch, [name for name in free if name in "vw"], map, chosen) and all(
                literal_holds(part, map, chosen) for part in branch
            ):
                yield chosen


def assign_values(branch: tuple[Condition, ...], names: list[str], map: Map, chosen: Assignment) -> bool:
    """Gives the value variables their values; False when a term that defines one has none."""
    waiting = list(names)
    while waiting:
        for name in waiting:
            sources = equations_of(branch, name)
            if not sources:
                continue
            if not isinstance(sources[0], Variable):
                sources = sources[:1]
            known_sources = [source for source in sources if all(v in chosen for v in variables(source))]
            if known_sources:
                value = read_plain(known_sources[0], map, chosen)
                if value is None:
                    return False
                chosen[name] = value[0]
                waiting.remove(name)
                break
        else:
            raise ValueError(f"nothing defines {waiting}")
    return True


def undefined(formula: Formula) -> bool:
    """Whether in some branch nothing gives a value variable its value."""
    free = [n for part in literals(formula) if not isinstance(part, Not) for n in variables(part) if n in "vw"]
    for branch in alternatives(formula):
        known_names: set[str] = set("xyz")
        for _ in free:
            known_names |= {n for n in free for source in equations_of(branch, n) if set(variables(source)) <= known_names}
        if not set(free) <= known_names:
            return True
    return False


def says_what_x_is(formula: Formula) -> bool:
    """Whether ?x, which has no type, is shown to be an object by a relation, an attribute or a function."""
    if Variable("x") not in terms(formula):
        return True
    atoms = [part.atom if isinstance(part, Not) else part for part in literals(formula)]
    inner_terms = [
        t for atom in atoms for t in ([atom] if isinstance(atom, Relation) else [atom.left, atom.right]) if not isinstance(t, Variable)
    ]
    return any(Variable("x") in terms(t) for t in inner_terms)


def row_key(row: Assignment) -> frozenset[tuple[str, str]]:
    return frozenset((name, f"{metres(term):.6f}" if isinstance(term, Number) else str(term)) for name, term in row.items())


@examples(80)
@given(formulas, maps())
def test_bindings_are_those_of_the_plain_twin(formula: Formula, map: Map) -> None:
    assume(says_what_x_is(formula))
    if undefined(formula):
        with pytest.raises(FormulaError, match="gives"):
            list(bindings(formula, map, ONTOLOGY))
        return
    rows = list(bindings(formula, map, ONTOLOGY))
    assert {row_key(row) for row in rows} == {row_key(row) for row in plain_rows(formula, map)}
    assert len({tuple(sorted((n, str(t)) for n, t in row.items())) for row in rows}) == len(rows)
    assert formula_holds(formula, map, ONTOLOGY) == bool(rows)


@examples(40)
@given(formulas, maps())
def test_given_bindings_select_among_the_rows(formula: Formula, map: Map) -> None:
    assume(not undefined(formula))
    formula = conjunction(formula, parse("?x.Open = TRUE OR ?x.Size > 0"))
    rows = list(bindings(formula, map, ONTOLOGY))
    for name in map.objects:
        selected = list(bindings(formula, map, ONTOLOGY, {"x": Name(name)}))
        assert {row_key(row) for row in selected} == {row_key(row) for row in rows if row["x"] == Name(name)}


# By example

SITE = """
map: Lab
objects:
  Table1: {type: Table, at: [1, 1, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.7}}
  Table2: {type: Table, at: [4, 5, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.7}, Color: Red}
  Jar1: {type: Jar, at: [1, 1, 0.7], Weight: 0.2}
  Jar2: {type: Jar, at: [1.2, 1, 0.7], Color: Blue}
  Robot1: {type: PioneerP3DX, at: [3, 3, 0]}
  Building1:
    type: Building
    parts:
      Room1: {type: Room}
      Room2: {type: Room}
      Storey1:
        type: Storey
        parts: {Floor1: {type: Floor, at: [0, 0, 0], Shape: {Form: Box, Width: 9, Depth: 9, Height: 0}}}
facts: [Jar1 isOn Table1, Jar2 isOn Table1, Room1 isAdjacentTo Room2]
"""


@pytest.fixture(scope="module")
def lab() -> tuple[Ontology, Map]:
    loaded = load_text(SITE, base=upper())
    assert loaded.map is not None
    return loaded.ontology, loaded.map


@pytest.mark.parametrize(
    ("formula", "rows"),
    [
        ("Jar1 isOn Table1", [{}]),
        ("Jar1 isOn Table2", []),
        ("NOT Jar1 isOn Table2", [{}]),
        ("?Jar: Jar isOn Table1", [{"Jar": "Jar1"}, {"Jar": "Jar2"}]),
        ("?Shelf: Shelf isPartOf ?Whole", []),
        ("?Table: Table.Color = ?c", [{"Table": "Table2", "c": "Red"}]),
        ("Jar1.Weight = ?w", [{"w": "0.2 kg"}]),
        ("Jar1.Weight + 1 = ?w", [{"w": "1.2 kg"}]),
        ("1 + Jar1.Weight = ?w", [{"w": "1.2 kg"}]),
        ("Jar1.Weight + 500 g = ?w", [{"w": "0.7 kg"}]),
        ("500 g + Jar1.Weight = ?w", [{"w": "700 g"}]),
        ("Jar1.Weight - 100 g = ?w", [{"w": "0.1 kg"}]),
        ("Jar1.Weight * 2 = ?w", [{"w": "0.4 kg"}]),
        ("Jar1.Weight + 1 m = ?w", []),
        ("Jar2.Weight = ?w", [{"w": "0.3 kg"}]),  # the type's default
        ("?Jar: Jar.Weight < 250 g", [{"Jar": "Jar1"}]),
        ("Jar1.PositionX = 1.01", [{}]),  # within the tolerance
        ("Jar1.PositionX < 1.01", []),
        ("Jar1.PositionX = 1.05", []),
        ("Jar1.PositionX = 101 cm", [{}]),
        ("Table1.Color != Red", []),  # it has none
        ("NOT Table1.Color = Red", [{}]),
        ("Room2 isAdjacentTo ?Room", [{"Room": "Room1"}]),
        ("?Table: Table isPartOf Building1 AND NOT ?Thing isOn ?Table", []),
        ("?Table: Table.Shape.Width = 1 m AND NOT ?Thing isOn ?Table", [{"Table": "Table2"}]),
        ("distance(Table1, Table2) = 5 m", [{}]),
        ("distance(Robot1, ?Jar: Jar) < 300 cm", [{"Jar": "Jar1"}, {"Jar": "Jar2"}]),
        ("distance(Robot1, Jar1) < range(Robot1)", []),
        ("distance(Robot1, Room1) < 1000 km", []),  # a room has no position of its own
        ("?a isOn ?t AND ?b isOn ?t AND ?a != ?b", [{"a": "Jar1", "b": "Jar2", "t": "Table1"}, {"a": "Jar2", "b": "Jar1", "t": "Table1"}]),
        ("Jar1 isOn ?x OR ?x isAdjacentTo Room1", [{"x": "Table1"}, {"x": "Room2"}]),
        ("Unknown isOn ?x", []),
        ("Jar1 isOm ?x", []),
    ],
)
def test_rows(lab: tuple[Ontology, Map], formula: str, rows: list[dict[str, str]]) -> None:
    ontology, map = lab
    found_rows = [{name: str(term) for name, term in row.items()} for row in bindings(parse(formula), map, ontology)]
    assert sorted(found_rows, key=str) == sorted(rows, key=str)


@pytest.mark.parametrize(
    ("formula", "rows"),
    [
        ("?n: number = Jar1.Weight", [{"n": "0.2 kg"}]),
        ("?n: text = Jar1.Weight", []),
        ("?n: truth = Jar1.Weight", []),
        ("?c: text = Table2.Color", [{"c": "Red"}]),
        ("?c: number = Table2.Color", []),
        ("?x: Object = Jar1", [{"x": "Jar1"}]),
        ("?x: Jar = Jar1", [{"x": "Jar1"}]),
        ("?x: Jar = Table1", []),
        ("?x: Gone isOn Table1", []),
        ("?x: Room = ?y AND ?y isAdjacentTo Room2", [{"x": "Room1", "y": "Room1"}]),
        ("?a = ?b AND ?b = ?c AND Jar1.Weight = ?c", [{"a": "0.2 kg", "b": "0.2 kg", "c": "0.2 kg"}]),
        ("?w = Jar1.Weight AND ?w = Jar2.Weight", []),
        ("?x: Jar.Weight = ?w AND ?w > 0.25", [{"x": "Jar2", "w": "0.3 kg"}]),
        ("NOT ?x: Jar isOn Table2", [{}]),
        ("NOT ?x: Jar isOn Table1", []),
        ("Jar1 isOn Table2 OR ?x isOn Table1", [{"x": "Jar1"}, {"x": "Jar2"}]),
        ("?a isAdjacentTo ?b", [{"a": "Room1", "b": "Room2"}, {"a": "Room2", "b": "Room1"}]),
        ("?a isAdjacentTo ?a", []),
        ("isOn(?a)", []),
        ("isOn(?a, Table1, ?c)", []),
    ],
)
def test_variables_stand_for_what_their_types_say(lab: tuple[Ontology, Map], formula: str, rows: list[dict[str, str]]) -> None:
    ontology, map = lab
    found_rows = [{name: str(term) for name, term in row.items()} for row in bindings(parse(formula), map, ontology)]
    assert sorted(found_rows, key=_by_name) == sorted(rows, key=_by_name)


def _by_name(row: dict[str, str]) -> list[tuple[str, str]]:
    return sorted(row.items())


@pytest.mark.parametrize(
    ("formula", "initial_bindings", "rows"),
    [
        ("?x isOn Table1", {"x": Name("Jar1")}, [{"x": "Jar1"}]),
        ("?x isOn Table1", {"x": Name("Table1")}, []),
        ("?x isOn Table1", {"x": Name("Gone")}, []),
        ("?x isOn Table1", {"x": Text("Jar1")}, []),
        ("?x isOn ?t", {"x": Name("Jar1"), "z": Number(1)}, [{"x": "Jar1", "z": "1", "t": "Table1"}]),
        ("?n: number = Jar1.Weight", {"n": Number(200, "g")}, [{"n": "200 g"}]),
        ("?n: number = Jar1.Weight", {"n": Number(300, "g")}, []),
        ("?n: number > 3 OR Jar1 isOn Table1", {"n": Text("a")}, []),
        ("?n: text = Jar1.Label OR Jar1 isOn Table1", {"n": Name("a")}, [{"n": "a"}]),
        ("?n: truth = Table1.Open OR Jar1 isOn Table1", {"n": Truth(True)}, [{"n": "TRUE"}]),
        ("?n: truth = Table1.Open OR Jar1 isOn Table1", {"n": Number(1)}, []),
        ("NOT ?x isOn Table1", {"x": Name("Jar1")}, []),
        ("NOT ?x isOn Table1", {"x": Name("Table2")}, [{"x": "Table2"}]),
        ("NOT ?x isOn ?t", {"x": Name("Jar1")}, []),
        ("NOT ?x isOn ?t", {"x": Name("Table2")}, [{"x": "Table2"}]),
    ],
)
def test_given_terms_are_kept_or_are_no_answer(
    lab: tuple[Ontology, Map], formula: str, initial_bindings: dict[str, Term], rows: list[dict[str, str]]
) -> None:
    ontology, map = lab
    assert [{name: str(term) for name, term in row.items()} for row in bindings(parse(formula), map, ontology, initial_bindings)] == rows


@pytest.mark.parametrize(
    ("formula", "position", "name"), [("?a = ?b", 0, "a"), ("Jar1 isOn Table1 AND ?w = ?w + 1", 21, "w"), ("3 < ?w: number", 4, "w")]
)
def test_what_gives_no_value_is_shown(lab: tuple[Ontology, Map], formula: str, position: int, name: str) -> None:
    ontology, map = lab
    with pytest.raises(FormulaError) as caught:
        list(bindings(parse(formula), map, ontology))
    assert (caught.value.text, caught.value.position) == (formula, position)
    assert (caught.value.problem, caught.value.hint) == (f"nothing gives ?{name} a value", f"add an equation, such as ... = ?{name}")


def test_evaluate(lab: tuple[Ontology, Map]) -> None:
    ontology, map = lab
    assert evaluate(Attribute(Name("Jar1"), "Weight"), map, ontology) == 0.2
    assert evaluate(Attribute(Name("Jar1"), "Shape.Form"), map, ontology) == "Cylinder"
    assert evaluate(Attribute(Name("Jar1"), "Label"), map, ontology) is None
    assert evaluate(Call("distance", (Name("Table1"), Name("Table2"))), map, ontology) == 5
    assert evaluate(Call("range", (Name("Robot1"),)), map, ontology) == 0.45


def test_a_table_has_the_values_that_it_is_given(lab: tuple[Ontology, Map]) -> None:
    ontology, map = lab
    table = FunctionType(name="steps", parameters=("Object", "Object"), values={"Jar1 Table1": 3.0}, unit="m")
    ontology = ontology.extended([table])
    assert evaluate(Call("steps", (Name("Jar1"), Name("Table1"))), map, ontology) == 3
    assert evaluate(Call("steps", (Name("Table1"), Name("Jar1"))), map, ontology) is None
    assert list(bindings(parse("steps(?a, Table1) = 300 cm"), map, ontology)) == [{"a": Name("Jar1")}]


def test_a_value_without_an_equation_is_an_error(lab: tuple[Ontology, Map]) -> None:
    ontology, map = lab
    with pytest.raises(FormulaError) as caught:
        list(bindings(parse("Jar1 isOn Table1 AND ?w < 5"), map, ontology))
    assert caught.value.position == 21
    assert "?w" in caught.value.hint


def test_a_given_object_of_another_type_is_no_answer(lab: tuple[Ontology, Map]) -> None:
    ontology, map = lab
    formula = parse("?x: Table isPartOf Building1 OR ?x isOn Table1")
    assert list(bindings(formula, map, ontology, {"x": Name("Jar1")})) == []


def test_formulas_with_many_ors_are_answered_without_variables(lab: tuple[Ontology, Map]) -> None:
    ontology, map = lab
    clauses = " AND ".join(f"(Jar1 isOn Table1 OR Jar2.Weight = {n})" for n in range(40))
    assert formula_holds(parse(clauses), map, ontology)
    with pytest.raises(FormulaError, match="fewer ORs"):
        formula_holds(parse(clauses.replace("Jar2", "?j")), map, ontology)


def test_large_maps_are_answered() -> None:
    count = 2500
    objects = [
        Object(name=f"Jar{n}", type="Jar", values={"PositionX": n / 10, "PositionY": 1.0, "Color": "Blue" if n % 100 else "Red"})
        for n in range(count)
    ]
    objects += [Object(name=f"Shelf{n}", type="Shelf", values={"PositionX": n / 10, "PositionY": 2.0}) for n in range(count)]
    objects += [Object(name=f"Room{n}", type="Room") for n in range(50)]
    facts = [Fact("isOn", (f"Jar{n}", f"Shelf{n // 2}")) for n in range(count)]
    facts += [Fact("isPartOf", (f"Shelf{n}", f"Room{n % 50}")) for n in range(count)]
    map = Map(objects, facts)
    expected = {
        "Jar7 isOn ?s": 1,
        "?j: Jar isOn Shelf3": 2,
        "?j: Jar isOn ?s AND ?s isPartOf Room7": 50,
        "?j.Color = Red AND ?j isOn ?s AND ?s isPartOf ?r": 25,
        "?a isOn ?s AND ?b isOn ?s AND ?a != ?b": count,
        "?s: Shelf isPartOf Room3 AND NOT ?j isOn ?s": 25,
        "distance(?j: Jar, ?s) < 150 cm AND ?s isPartOf Room0 AND ?j.Color = Red": 25,
    }
    assert {text: len(list(bindings(parse(text), map, upper()))) for text in expected} == expected
