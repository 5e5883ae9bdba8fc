"""What is said of definitions that make no sense beside the others of their ontology."""

from __future__ import annotations

import pytest

from somrs.ontology.conformance import Violation
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.services import Handler, Occasion, Parameter, ServiceType
from somrs.ontology.types import AttributeType, Constraint, Definition, FunctionType, Kind, ObjectType, Ontology, Part, RelationType

ONTOLOGY = Ontology(
    [
        AttributeType(name="Load", kind=Kind.NUMBER, unit="kg", minimum=1, maximum=10, tolerance=0.1),
        AttributeType(name="Color", kind=Kind.ENUMERATION, values=("Red", "Blue")),
        AttributeType(name="Note", kind=Kind.TEXT),
        AttributeType(name="Open", kind=Kind.TRUTH),
        AttributeType(name="Shape", kind=Kind.COMPLEX, attributes=("Load", "Note")),
        RelationType(name="isOn", joins=("Object", "Object"), functional=True),
        ObjectType(name="Object", parent=None, attributes=("Note",)),
        ObjectType(name="Box", parent="Object", attributes=("Load", "Color", "Shape")),
        ObjectType(name="Device", parent="Object", attributes=("Load",)),
        ServiceType(name="Put", inputs=(Parameter(name="x", type="Box"),), effect="?x isOn ?Provider"),
    ]
)
X = (Parameter(name="x", type="Box"),)


def broken(section: str, rule: str, path: str, message: str) -> Violation:
    return Violation(subject="New", rule=rule, message=message, path=path, section=section)


def number(**fields: object) -> AttributeType:
    return AttributeType(name="New", kind=Kind.NUMBER, **fields)  # type: ignore[arg-type]


def text(**fields: object) -> AttributeType:
    return AttributeType(name="New", kind=Kind.TEXT, **fields)  # type: ignore[arg-type]


def type_(**fields: object) -> ObjectType:
    return ObjectType(name="New", **{"parent": "Box", **fields})  # type: ignore[arg-type]


def service(**fields: object) -> ServiceType:
    return ServiceType(name="New", **{"inputs": X, "effect": "?x isOn ?Provider", **fields})  # type: ignore[arg-type]


def function(*parameters: str, **fields: object) -> FunctionType:
    return FunctionType(name="New", parameters=parameters, **fields)  # type: ignore[arg-type]


def limited(**fields: object) -> ObjectType:
    return type_(constraints=(Constraint(attribute="Load", minimum=1), Constraint(**fields)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("new", "expected"),
    [
        (number(unit="kg", minimum=2, maximum=3, tolerance=1), []),
        (number(unit="cm"), []),
        (
            number(unit="wibble"),
            [
                broken(
                    "attributes", "unit", "unit", "pint knows no unit wibble; write one such as m, cm, kg, rad, deg, s, m/s, percent, EUR"
                )
            ],
        ),
        (number(unit="kgg"), [broken("attributes", "unit", "unit", "pint knows no unit kgg; did you mean kg?")]),
        (
            text(unit="kg", minimum=2, maximum=3, tolerance=1),
            [
                broken("attributes", "kind", "unit", "only a number has a unit; leave it out, or write kind: number"),
                broken("attributes", "kind", "minimum", "only a number has a minimum; leave it out, or write kind: number"),
                broken("attributes", "kind", "maximum", "only a number has a maximum; leave it out, or write kind: number"),
                broken("attributes", "kind", "tolerance", "only a number has a tolerance; leave it out, or write kind: number"),
            ],
        ),
        (
            text(minimum=0, maximum=0),
            [
                broken("attributes", "kind", "minimum", "only a number has a minimum; leave it out, or write kind: number"),
                broken("attributes", "kind", "maximum", "only a number has a maximum; leave it out, or write kind: number"),
            ],
        ),
        (
            text(values=("a",), attributes=("Load",)),
            [
                broken("attributes", "kind", "values", "only an enumeration has values; this one's kind is text"),
                broken("attributes", "kind", "attributes", "only a complex attribute has attributes; this one's kind is text"),
            ],
        ),
        (AttributeType(name="New", kind=Kind.ENUMERATION, values=("a",)), []),
        (
            AttributeType(name="New", kind=Kind.ENUMERATION),
            [broken("attributes", "kind", "kind", "an enumeration needs values; list them")],
        ),
        (
            AttributeType(name="New", kind=Kind.COMPLEX),
            [broken("attributes", "kind", "kind", "a complex attribute needs attributes; list them")],
        ),
        (
            AttributeType(name="New", kind=Kind.COMPLEX, values=("a",), attributes=("Load",)),
            [broken("attributes", "kind", "values", "only an enumeration has values; this one's kind is complex")],
        ),
        (
            AttributeType(name="New", kind=Kind.ENUMERATION, values=("a",), attributes=("Load",)),
            [broken("attributes", "kind", "attributes", "only a complex attribute has attributes; this one's kind is enumeration")],
        ),
        (
            AttributeType(name="New", kind=Kind.COMPLEX, attributes=("Load", "Lode", "New", "Qwertz")),
            [
                broken("attributes", "unknown-name", "attributes.1", "no attribute is called Lode; did you mean Load?"),
                broken("attributes", "cycle", "attributes.2", "is made of itself, through New; leave it out there"),
                broken("attributes", "unknown-name", "attributes.3", "no attribute is called Qwertz; define it, or use one that is there"),
            ],
        ),
        (
            RelationType(name="New", joins=("Object", "Boxx", "Qwertz")),
            [
                broken("relations", "unknown-name", "joins.1", "no type is called Boxx; did you mean Box?"),
                broken("relations", "unknown-name", "joins.2", "no type is called Qwertz; define it, or use one that is there"),
            ],
        ),
        (RelationType(name="New", joins=("Box", "Box"), symmetric=True), []),
        (
            RelationType(name="New", joins=("Box", "Object"), symmetric=True),
            [broken("relations", "relation", "joins", "a symmetric relation joins two objects of the same type, not Box, Object")],
        ),
        (
            RelationType(name="New", joins=("Box",), symmetric=True),
            [broken("relations", "relation", "joins", "a symmetric relation joins two objects of the same type, not Box")],
        ),
        (
            RelationType(name="New", joins=("Box", "Box", "Box"), symmetric=True),
            [broken("relations", "relation", "joins", "a symmetric relation joins two objects of the same type, not Box, Box, Box")],
        ),
        (RelationType(name="New", joins=("Box", "Object")), []),
        (function("Box", attribute="Load", unit="kg"), []),
        (function("Box", attribute="Shape.Load"), []),
        (
            function("Boxx", attribute="Lode", unit="wibble"),
            [
                broken("functions", "unknown-name", "parameters.0", "no type is called Boxx; did you mean Box?"),
                broken(
                    "functions", "unit", "unit", "pint knows no unit wibble; write one such as m, cm, kg, rad, deg, s, m/s, percent, EUR"
                ),
                broken("functions", "unknown-name", "attribute", "no attribute is called Lode; did you mean Load?"),
            ],
        ),
        (
            function("Box", "Box", attribute="Load"),
            [
                broken(
                    "functions",
                    "function",
                    "parameters",
                    "a function that reads an attribute has one parameter, the object whose attribute it is",
                )
            ],
        ),
        (
            function(attribute="Load"),
            [
                broken(
                    "functions",
                    "function",
                    "parameters",
                    "a function that reads an attribute has one parameter, the object whose attribute it is",
                )
            ],
        ),
        (
            function("Box", attribute="Load", values={"a": 1.0}),
            [
                broken(
                    "functions", "function", "values", "a function either reads an attribute or is a table of values; leave one of them out"
                )
            ],
        ),
        (
            function("Box", "Box", values={"a b": 1.0, "a": 2.0, "a b c": 3.0}),
            [
                broken("functions", "function", "values.a", "'a' should name 2 objects, with a space between two"),
                broken("functions", "function", "values.a b c", "'a b c' should name 2 objects, with a space between two"),
            ],
        ),
        (function("Box", "Box"), []),
        (type_(parent=None), [broken("types", "parent", "", "has no parent; write parent: Object, or a type below it")]),
        (type_(parent="Boxx"), [broken("types", "unknown-name", "parent", "no type is called Boxx; did you mean Box?")]),
        (type_(parent="New"), [broken("types", "cycle", "parent", "is its own ancestor (New below New); give one of them another parent")]),
        (
            type_(attributes=("Note", "Lode"), required=("Noet",)),
            [
                broken("types", "unknown-name", "attributes.1", "no attribute is called Lode; did you mean Load?"),
                broken("types", "unknown-name", "required.0", "no attribute is called Noet; did you mean Note?"),
            ],
        ),
        (
            type_(
                parts=(
                    Part(type="Box", minimum=2, maximum=2),
                    Part(type="Bxo"),
                    Part(type="Box", minimum=3, maximum=2),
                    Part(type="Box", minimum=0, maximum=0),
                )
            ),
            [
                broken("types", "unknown-name", "parts.1.type", "no type is called Bxo; did you mean Box?"),
                broken("types", "parts", "parts.2", "at least 3 and at most 2 of Box is impossible; correct the limits"),
            ],
        ),
        (type_(defaults={"Load": 2.0, "Shape.Load": 3.0}), []),
        (
            type_(defaults={"Load": 20.0, "Open": True, "Shape.Lode": 3.0, "Color": "Red"}),
            [
                broken("types", "value", "defaults.Load", "Load is at most 10, not 20"),
                broken(
                    "types",
                    "unknown-name",
                    "defaults.Open",
                    "no attribute of this type is called Open; define it, or use one that is there",
                ),
                broken(
                    "types",
                    "unknown-name",
                    "defaults.Shape.Lode",
                    "no attribute of this type is called Shape.Lode; did you mean Shape.Load or Shape.Note or Shape?",
                ),
            ],
        ),
        (
            limited(attribute="Load", formula="?Self.Load > 1"),
            [broken("types", "constraint", "constraints.1", "a constraint has either an attribute with limits, or a formula")],
        ),
        (limited(), [broken("types", "constraint", "constraints.1", "a constraint has either an attribute with limits, or a formula")]),
        (limited(formula="?Self.Load > 1"), []),
        (
            limited(formula="?Self.Open = TRUE"),
            [broken("types", "formula", "constraints.1.formula", "a New has no attribute Open\n  ?Self.Open = TRUE\n        ^")],
        ),
        (
            limited(attribute="Lode", minimum=1),
            [broken("types", "unknown-name", "constraints.1.attribute", "no attribute of this type is called Lode; did you mean Load?")],
        ),
        (
            limited(attribute="Open", values=(True,)),
            [
                broken(
                    "types",
                    "unknown-name",
                    "constraints.1.attribute",
                    "no attribute of this type is called Open; define it, or use one that is there",
                )
            ],
        ),
        (
            limited(attribute="Load"),
            [broken("types", "constraint", "constraints.1", "says nothing about Load; give minimum, maximum or values")],
        ),
        (limited(attribute="Load", minimum=0), []),
        (limited(attribute="Load", maximum=0), []),
        (limited(attribute="Color", values=("Red",)), []),
        (
            limited(attribute="Color", minimum=1),
            [broken("types", "constraint", "constraints.1", "Color is no number, so it has no minimum or maximum; give values")],
        ),
        (
            limited(attribute="Color", maximum=1),
            [broken("types", "constraint", "constraints.1", "Color is no number, so it has no minimum or maximum; give values")],
        ),
        (limited(attribute="Shape.Load", maximum=1), []),
        (service(), []),
        (service(parent="Put"), []),
        (service(parent="Putt"), [broken("services", "unknown-name", "parent", "no service is called Putt; did you mean Put?")]),
        (
            service(parent="New"),
            [broken("services", "cycle", "parent", "is its own ancestor (New below New); give one of them another parent")],
        ),
        (
            service(
                inputs=(
                    Parameter(name="x", type="Bxo"),
                    Parameter(name="y", type="number"),
                    Parameter(name="z", type="text"),
                    Parameter(name="w", type="truth"),
                ),
                precondition="?q likes ?x",
                cost="?q",
            ),
            [broken("services", "unknown-name", "inputs.x", "no type is called Bxo; did you mean Box?")],
        ),
        (
            service(outputs=(Parameter(name="x", type="Box"), Parameter(name="y", type="numbr"))),
            [
                broken("services", "duplicate", "outputs.x", "?x is declared twice; give one of the two another name"),
                broken("services", "unknown-name", "outputs.y", "no type is called numbr; did you mean number?"),
            ],
        ),
        (
            service(inputs=(*X, Parameter(name="Provider", type="Box"))),
            [broken("services", "duplicate", "inputs.Provider", "?Provider is declared twice; give one of the two another name")],
        ),
        (
            service(precondition="?x isOm ?Provider", effect="?x isOn ?Provider AND"),
            [
                broken("services", "formula", "precondition", "there is no relation isOm\n  ?x isOm ?Provider\n     ^\ndid you mean isOn?"),
                broken(
                    "services",
                    "formula",
                    "effect",
                    "the formula ends too early\n  ?x isOn ?Provider AND\n                       ^\n"
                    'expected a name, a variable such as ?Shelf, a number, a text in "quotes", TRUE or FALSE, NOT, FORALL or EXISTS or (',
                ),
            ],
        ),
        (
            service(effect="?x.Color = Red AND (?x isOn ?Provider OR ?x.Load = 2)"),
            [
                broken(
                    "services",
                    "formula",
                    "effect",
                    "an effect with OR does not say what becomes true\n  ?x.Color = Red AND (?x isOn ?Provider OR ?x.Load = 2)\n"
                    "                         ^\nchoose one of its alternatives",
                )
            ],
        ),
        (
            service(effect="?x.Load > 2 AND NOT ?x.Color = Red"),
            [
                broken(
                    "services",
                    "formula",
                    "effect",
                    "this does not say what becomes true\n  ?x.Load > 2 AND NOT ?x.Color = Red\n          ^\n"
                    "write Object.Attribute = value",
                ),
                broken(
                    "services",
                    "formula",
                    "effect",
                    "this does not say what becomes true\n  ?x.Load > 2 AND NOT ?x.Color = Red\n                               ^\n"
                    "say which value the attribute gets",
                ),
            ],
        ),
        (service(effect="NOT ?x isOn ?Provider AND ?x.Load = ?Provider.Load + 1 AND Red = ?x.Color"), []),
        (service(inputs=X, invariant="?x isOn ?Provider"), []),
        (
            service(inputs=X, invariant="?x isOn ?y"),
            [
                broken(
                    "services",
                    "formula",
                    "invariant",
                    "?y is no input; what has to hold while the service runs is a formula over the inputs and ?Provider",
                )
            ],
        ),
        (service(cost="?x.Load"), []),
        (service(cost="?Provider.Load"), []),
        (
            service(cost="?x.Load +"),
            [
                broken(
                    "services",
                    "formula",
                    "cost",
                    "this is no term\n  ?x.Load +\n           ^\n"
                    'expected a name, a variable such as ?Shelf, a number, a text in "quotes" or TRUE or FALSE',
                )
            ],
        ),
        (
            service(cost="?x.Note"),
            [broken("services", "formula", "cost", ">= compares numbers, and ?x.Note is a text\n  ?x.Note >= 0\n          ^\nuse = or !=")],
        ),
        (
            service(cost="?y.Load"),
            [broken("services", "formula", "cost", "?y is no input; a cost is a term over the inputs and ?Provider")],
        ),
        (
            service(
                handlers=(
                    Handler(on=Occasion.FAILURE, when="?x isOn ?Provider", effect="?x isOn ?Provider"),
                    Handler(on=Occasion.FAILURE, when="?x isOm ?Provider", effect="?x isOn"),
                )
            ),
            [
                broken(
                    "services", "formula", "handlers.1.when", "there is no relation isOm\n  ?x isOm ?Provider\n     ^\ndid you mean isOn?"
                ),
                broken(
                    "services",
                    "formula",
                    "handlers.1.effect",
                    "the formula ends too early\n  ?x isOn\n         ^\n"
                    'expected a name, a variable such as ?Shelf, a number, a text in "quotes" or TRUE or FALSE',
                ),
            ],
        ),
        (service(handlers=(Handler(on=Occasion.FAILURE, effect="?x isOn ?Provider"),)), []),
    ],
    ids=str,
)
def test_what_is_said_of_a_definition(new: Definition, expected: list[Violation]) -> None:
    ontology = ONTOLOGY.extended([new])
    assert ontology_violations(ontology, [new]) == expected
    assert ontology_violations(ontology) == expected
    assert ontology_violations(ontology, [ONTOLOGY.types["Box"]]) == []


def test_an_attribute_is_not_called_as_what_every_object_has() -> None:
    found_violations = ontology_violations(ONTOLOGY.extended([text(), AttributeType(name="parts", kind=Kind.TEXT)]))
    message = "objects have a key parts of their own; give the attribute another name"
    assert found_violations == [Violation(subject="parts", rule="reserved", message=message, section="attributes")]


def test_attributes_made_of_each_other_are_a_cycle_of_both() -> None:
    complexes = [
        AttributeType(name=name, kind=Kind.COMPLEX, attributes=attributes)
        for name, attributes in (("Above", ("Note", "A")), ("A", ("B", "Note")), ("B", ("Note", "Shape", "A")))
    ]
    found_problems = [(v.subject, v.rule, v.path, v.message) for v in ontology_violations(ONTOLOGY.extended(complexes))]
    assert found_problems == [
        ("A", "cycle", "attributes.0", "is made of itself, through B; leave it out there"),
        ("B", "cycle", "attributes.2", "is made of itself, through A; leave it out there"),
    ]


def test_a_cycle_of_parents_is_told_of_those_in_it() -> None:
    types = [ObjectType(name=name, parent=parent) for name, parent in (("A", "B"), ("B", "C"), ("C", "A"), ("Below", "B"))]
    found_problems = [(v.subject, v.rule, v.path, v.message) for v in ontology_violations(ONTOLOGY.extended(types))]
    assert found_problems == [
        ("A", "cycle", "parent", "is its own ancestor (A below B below C below A); give one of them another parent"),
        ("B", "cycle", "parent", "is its own ancestor (B below C below A below B); give one of them another parent"),
        ("C", "cycle", "parent", "is its own ancestor (C below A below B below C); give one of them another parent"),
    ]


def test_a_service_needs_no_type_of_devices() -> None:
    new = ServiceType(name="Rest", effect="?Provider isOn ?Provider")
    ontology = Ontology([definition for definition in ONTOLOGY if definition.name not in ("Device", "Put")])
    assert ontology_violations(ontology.extended([new])) == []
    assert ontology_violations(Ontology()) == []
