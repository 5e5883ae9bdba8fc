"""What is said of files that are not built as files are, and what their entries define."""

from __future__ import annotations

from typing import Any

import pytest

from somrs.errors import Problem
from somrs.ontology.files.nodes import Source
from somrs.ontology.files.structure import definition, flat, structure_problems
from somrs.ontology.schema import ENTRIES, File
from somrs.ontology.services import Handler, Occasion, Parameter, ServiceKind, ServiceType
from somrs.ontology.types import AttributeType, Constraint, Definition, FunctionType, Kind, ObjectType, Part, RelationType

ANY_KEY = f"there are {', '.join(File.model_fields)}"


@pytest.mark.parametrize(
    ("text", "broken", "reports"),
    [
        ("ontology: x\n", set(), []),
        ("- a\n", set(), [(1, "file", f"a file is a list of keys ({', '.join(File.model_fields)}) with values")]),
        ("map: x\nontologie: x\n", set(), [(2, "ontologie", "unknown key ontologie; did you mean ontology?")]),
        (
            "map: x\nthings: {}\n",
            set(),
            [(2, "things", "things belongs into a mapping file, which is named under `adapters: {things: {mappings: [FILE]}}` of a site")],
        ),
        ("map: x\nqwertz: x\n", set(), [(2, "qwertz", f"unknown key qwertz; {ANY_KEY}")]),
        ("map: x\ntypes: [a]\n", set(), [(2, "types", "types should be keys with values (types: {...}), not ['a']")]),
        ("types:\n  Vase: 3\n", {"Vase"}, [(2, "Vase", "Vase should be keys with values (Vase: {...}), not 3")]),
        ("types:\n  Vase:\n    parrent: Jar\n", {"Vase"}, [(3, "Vase", "unknown key parrent; did you mean parent or parts?")]),
        (
            "attributes:\n  Heat: {kind: number, kin: 1, kynd: 2}\n",
            {"Heat"},
            [(2, "Heat", "unknown key kin; did you mean kind?"), (2, "Heat", "unknown key kynd; did you mean kind?")],
        ),
        (
            "attributes:\n  Heat:\n    kind: numbr\n    doc: [1]\n",
            {"Heat"},
            [
                (3, "Heat", "kind should be 'number', 'text', 'truth', 'enumeration' or 'complex', not 'numbr'; did you mean number?"),
                (4, "Heat", "doc should be a text, not [1.0]"),
            ],
        ),
        (
            "attributes: {Heat: {kind: number, minimum: a, maximum: b}}\n",  # one problem of a line and a subject
            {"Heat"},
            [(1, "Heat", "minimum should be a number, not 'a'")],
        ),
        ("relations:\n  near: {}\n", {"near"}, [(2, "near", "joins is missing; write joins: and its value")]),
        (
            "types: {Vase: {parts: [{type: Jar, parent: Jar, minimun: 1}], constraints: [{atribute: Weight}]}}\n",
            {"Vase"},
            [
                (1, "Vase", "unknown key parent; there are type, minimum, maximum"),
                (1, "Vase", "unknown key minimun; did you mean minimum?"),
                (1, "Vase", "unknown key atribute; did you mean attribute?"),
            ],
        ),
        ("functions: {far: {}}\n", {"far"}, [(1, "far", "parameters is missing; write parameters: and its value")]),
        (
            "objects:\n  A:\n    type: Jar\n    parts:\n      B:\n        parts:\n          C: {tipe: Jar}\n",
            {"B", "C"},
            [
                (5, "B", "type is missing; write type: and its value"),
                (7, "C", "type is missing; write type: and its value"),
            ],
        ),
        ("objects:\n  A:\n    type: Jar\n    at: [1]\n", {"A"}, [(4, "A", "at should be a list with at least 2 items, not [1.0]")]),
        (
            "objects: {A: {type: Jar, at: [1, 2, 3, 4]}}",
            {"A"},
            [(1, "A", "at should be a list with at most 3 items, not [1.0, 2.0, 3.0, 4.0]")],
        ),
        ("objects: {A: {type: Jar, parts: {B: 4}}}", {"B"}, [(1, "B", "B should be keys with values (B: {...}), not 4")]),
        ("objects: {A: {type: Jar, parts: 4}}", {"A"}, [(1, "A", "parts should be keys with values (parts: {...}), not 4")]),
        ("facts:\n  - A isOn B\n  - 3\n", set(), [(3, "facts", "an item of facts should be a text, not 3; write it in quotes")]),
        ("map: [1]\n", set(), [(1, "map", "map should be a text, not [1.0]")]),
        (f"map: [{'a' * 55}]\n", set(), [(1, "map", f"map should be a text, not ['{'a' * 55}']")]),
        (f"map: [{'a' * 56}]\n", set(), [(1, "map", f"map should be a text, not ['{'a' * 55}...")]),
    ],
)
def test_what_is_said_of_the_structure(text: str, broken: set[str], reports: list[tuple[int, str, str]]) -> None:
    problems = [
        Problem(file="own.yaml", line=line, subject=subject, rule="structure", message=message) for line, subject, message in reports
    ]
    assert structure_problems(Source("own.yaml", text)) == (problems, broken)


def test_what_is_no_yaml_has_no_structure() -> None:
    unread = Source("own.yaml", "map: [\n")
    assert unread.problems != []
    assert structure_problems(unread) == (unread.problems, set())
    twice = Source("own.yaml", "map: a\nmap: b\nmapp: c\n")
    problems, broken = structure_problems(twice)
    assert [(problem.line, problem.rule) for problem in problems] == [(2, "duplicate"), (3, "structure")]
    assert broken == set()


@pytest.mark.parametrize(
    ("section", "body", "expected"),
    [
        ("attributes", {"kind": "text"}, AttributeType(name="New", kind=Kind.TEXT)),
        (
            "attributes",
            {"kind": "number", "unit": "m", "tolerance": 0.5, "minimum": 1.0, "maximum": 2.0, "doc": "x"},
            AttributeType(name="New", kind=Kind.NUMBER, unit="m", tolerance=0.5, minimum=1.0, maximum=2.0, doc="x"),
        ),
        ("attributes", {"kind": "enumeration", "values": ["a", "b"]}, AttributeType(name="New", kind=Kind.ENUMERATION, values=("a", "b"))),
        ("attributes", {"kind": "complex", "attributes": ["A"]}, AttributeType(name="New", kind=Kind.COMPLEX, attributes=("A",))),
        ("relations", {"joins": ["A", "B"]}, RelationType(name="New", joins=("A", "B"))),
        (
            "relations",
            {"joins": ["A", "A"], "symmetric": True, "functional": True, "excludes": "x", "doc": "y"},
            RelationType(name="New", joins=("A", "A"), symmetric=True, functional=True, excludes="x", doc="y"),
        ),
        (
            "functions",
            {"parameters": ["A"], "attribute": "Load", "unit": "kg", "doc": "y"},
            FunctionType(name="New", parameters=("A",), attribute="Load", unit="kg", doc="y"),
        ),
        ("functions", {"parameters": ["A"], "values": {"a": 1.0}}, FunctionType(name="New", parameters=("A",), values={"a": 1.0})),
        ("types", {"parent": "A"}, ObjectType(name="New", parent="A", defaults={"Load": 3.0})),
        (
            "types",
            {
                "parent": "A",
                "attributes": ["B"],
                "required": ["C"],
                "parts": [{"type": "D"}, {"type": "E", "minimum": 0.0, "maximum": 2.0}],
                "constraints": [{"attribute": "B", "values": ["x"]}, {"formula": "f", "doc": "d"}],
                "driver": "a:b",
                "doc": "y",
            },
            ObjectType(
                name="New",
                parent="A",
                attributes=("B",),
                required=("C",),
                parts=(Part(type="D"), Part(type="E", minimum=0, maximum=2)),
                constraints=(Constraint(attribute="B", values=("x",)), Constraint(formula="f", doc="d")),
                defaults={"Load": 3.0},
                driver="a:b",
                doc="y",
            ),
        ),
        ("services", {"effect": "e"}, ServiceType(name="New", effect="e")),
        (
            "services",
            {
                "effect": "e",
                "kind": "software",
                "parent": "p",
                "inputs": {"x": "A"},
                "outputs": {"y": "B"},
                "precondition": "c",
                "cost": 2.0,
                "handlers": [{"on": "failure", "effect": "h", "when": "w"}],
                "doc": "y",
            },
            ServiceType(
                name="New",
                effect="e",
                kind=ServiceKind.SOFTWARE,
                parent="p",
                inputs=(Parameter(name="x", type="A"),),
                outputs=(Parameter(name="y", type="B"),),
                precondition="c",
                cost="2",
                handlers=(Handler(on=Occasion.FAILURE, effect="h", when="w"),),
                doc="y",
            ),
        ),
        ("services", {"effect": "e", "cost": "range(?x)"}, ServiceType(name="New", effect="e", cost="range(?x)")),
    ],
)
def test_what_an_entry_defines(section: str, body: dict[str, Any], expected: Definition) -> None:
    new_definition = definition("New", ENTRIES[section].model_validate(body), {"Load": 3.0})
    assert new_definition == expected
    if isinstance(new_definition, ObjectType):
        assert [(type(part.minimum), type(part.maximum)) for part in new_definition.parts[1:]] == [(int, int)] * len(
            new_definition.parts[1:]
        )


def test_nothing_else_defines_something() -> None:
    with pytest.raises(TypeError, match="File defines nothing"):
        definition("New", File.model_validate({}), {})


def test_nested_values_are_told_by_their_path() -> None:
    nested = {"A": 1, "B": {"C": {"D": 2, "E": [3]}, "F": None}, "G.H": {"I": "x"}, "J": {}}
    assert list(flat(nested)) == [("A", 1), ("B.C.D", 2), ("B.C.E", [3]), ("B.F", None), ("G.H.I", "x")]
