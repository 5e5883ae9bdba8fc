"""What is read of OWL files that others wrote, definition by definition, and what is said of what is not understood."""

from __future__ import annotations

import pytest

from somrs.errors import ModelError, Problem
from somrs.ontology.files.loading import upper
from somrs.ontology.naming import DefinitionKey, Renaming, Section
from somrs.ontology.objects import Fact, Object
from somrs.ontology.owl import read
from somrs.ontology.services import Handler, Occasion, Parameter, ServiceKind, ServiceType
from somrs.ontology.types import AttributeType, Constraint, Definition, FunctionType, Kind, ObjectType, Part, RelationType, Value

pytest.importorskip("rdflib", reason="rdflib is not installed")

from tests.unit.ontology.owl.test_owl import PREFIXES, noted, turtle, wrong

NO_WORDS = "SO-MRS has no equivalent for it, and it is not kept"
ONE_VALUE = "an attribute has one value: state `max 1` (may have), `exactly 1` (must have) or `only`"
BELOW_NOTE = "its superclass is "
TEXT_TAKEN = "; it is treated as a text"


def datatype(range_body: str) -> str:
    return f":A a owl:DatatypeProperty ; rdfs:range [ a rdfs:Datatype ; {range_body} ] ."


def facet_range(limits: str) -> str:
    return f"owl:onDatatype xsd:decimal ; owl:withRestrictions ( {limits} )"


def restricted(property_iri: str, rule: str) -> str:
    return f"[ a owl:Restriction ; owl:onProperty {property_iri} ; {rule} ]"


def attribute(
    kind: Kind = Kind.TEXT, *, low: float | None = None, high: float | None = None, values: tuple[str, ...] = ()
) -> AttributeType:
    return AttributeType(name="A", kind=kind, minimum=low, maximum=high, values=values)


ATTRIBUTES: list[tuple[str, AttributeType, list[str]]] = [
    (
        ':A a owl:DatatypeProperty ; rdfs:range xsd:decimal ; somrs:unit "kg" ; somrs:tolerance 0.5 ; rdfs:comment "Heavy" .',
        AttributeType(name="A", kind=Kind.NUMBER, unit="kg", tolerance=0.5, doc="Heavy"),
        [],
    ),
    (":A a owl:DatatypeProperty , owl:FunctionalProperty ; rdfs:range owl:real .", attribute(Kind.NUMBER), []),
    (":A a owl:DatatypeProperty ; rdfs:range xsd:boolean .", attribute(Kind.TRUTH), []),
    (":A a owl:DatatypeProperty ; rdfs:range rdfs:Literal .", attribute(), []),
    (
        ':A a owl:DatatypeProperty ; rdfs:range xsd:string ; somrs:unit "kg" , "g" .',
        AttributeType(name="A", kind=Kind.TEXT, unit="g"),
        ["unit occurs 2 times; the first is used"],
    ),
    (
        ":A a owl:DatatypeProperty .",
        attribute(),
        ["it has no range, and is treated as a text; give it one: xsd:decimal, xsd:string, xsd:boolean"],
    ),
    (
        ":A a owl:DatatypeProperty ; rdfs:range xsd:date .",
        attribute(),
        [
            "its range is the datatype http://www.w3.org/2001/XMLSchema#date; there are numbers (xsd:decimal), texts (xsd:string), "
            "truths (xsd:boolean) and lists of values; it is treated as a text"
        ],
    ),
    (datatype(facet_range("[ xsd:minInclusive 1 ] [ xsd:maxInclusive 2.5 ]")), attribute(Kind.NUMBER, low=1, high=2.5), []),
    (datatype(facet_range("[ xsd:maxInclusive 2.5 ]")), attribute(Kind.NUMBER, high=2.5), []),
    (datatype("owl:onDatatype xsd:string"), attribute(), []),
    (
        datatype(facet_range("[ xsd:minExclusive 1 ]")),
        attribute(),
        [
            "its range is a limit of another sort (http://www.w3.org/2001/XMLSchema#minExclusive); limits are xsd:minInclusive and "
            "xsd:maxInclusive; it is treated as a text"
        ],
    ),
    (datatype('owl:oneOf ( "b" "a" "c" ) ') + ' :A somrs:order "c a" .', attribute(Kind.ENUMERATION, values=("c", "a", "b")), []),
    (datatype('owl:oneOf ( "b" "a" ) ') + " :A somrs:order '[\"b\"' .", attribute(Kind.ENUMERATION, values=("a", "b")), []),
    (
        datatype('owl:oneOf ( "b" 1 )'),
        attribute(Kind.ENUMERATION, values=("1.0", "b")),
        ["its range lists values that are not texts; it is treated as an enumeration of names"],
    ),
    (
        datatype('owl:oneOf ( "b" :c )'),
        attribute(),
        [f"its range is http://example.org/vases#c, where a value is expected{TEXT_TAKEN}"],
    ),
    (
        datatype("owl:unionOf ( xsd:string xsd:decimal )"),
        attribute(),
        [f"its range is a data range that is neither a datatype, nor one within limits, nor a list of values{TEXT_TAKEN}"],
    ),
    (
        datatype(f"owl:intersectionOf ( [ {facet_range('[ xsd:minInclusive 1 ]')} ] [ {facet_range('[ xsd:maxInclusive 2 ]')} ] )"),
        attribute(Kind.NUMBER, low=1, high=2),
        [],
    ),
]


@pytest.mark.parametrize(("text", "expected", "notes"), ATTRIBUTES)
def test_attributes(text: str, expected: AttributeType, notes: list[str]) -> None:
    owl_import = turtle(text)
    assert [*owl_import.ontology] == [expected]
    assert noted(owl_import) == [("A", note) for note in notes]


NUMBERS = (
    "decimal double float integer int long short byte nonNegativeInteger positiveInteger nonPositiveInteger negativeInteger unsignedInt "
    "unsignedLong unsignedShort unsignedByte"
)
DATATYPES = {
    **{f"xsd:{name}": Kind.NUMBER for name in NUMBERS.split()},
    **dict.fromkeys(("owl:real", "owl:rational"), Kind.NUMBER),
    **dict.fromkeys(("xsd:string", "xsd:normalizedString", "xsd:token", "rdfs:Literal", "rdf:PlainLiteral", "rdf:langString"), Kind.TEXT),
    "xsd:boolean": Kind.TRUTH,
}


def test_what_the_datatypes_of_others_are() -> None:
    prefix = "@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> ."
    owl_import = turtle("\n".join([prefix, *(f":A{n} a owl:DatatypeProperty ; rdfs:range {name} ." for n, name in enumerate(DATATYPES))]))
    assert {name: owl_import.ontology.attributes[f"A{n}"].kind for n, name in enumerate(DATATYPES)} == DATATYPES
    assert owl_import.notes == ()


def test_attributes_that_are_made_of_others() -> None:
    rules = [
        restricted("attribute:Weight", "owl:maxCardinality 1"),
        restricted("attribute:Label", "owl:cardinality 1"),
        restricted("attribute:Color", "owl:maxCardinality 2"),
    ]
    owl_import = turtle(f"""
:A a owl:ObjectProperty ; rdfs:range :Parts ; rdfs:comment "Made" .
:Parts a owl:Class ; rdfs:label "Parts" ; rdfs:comment "Not kept" ; somrs:order "Weight Label" ;
  rdfs:subClassOf somrs:Value , {" , ".join(rules)} .
:Part1 a :Parts .
""")
    assert [*owl_import.ontology] == [AttributeType(name="A", kind=Kind.COMPLEX, attributes=("Weight", "Label"), doc="Made")]
    assert not owl_import.map.objects
    assert noted(owl_import) == [
        ("Parts", f"says a rule for Color; {ONE_VALUE}"),
        ("Parts", f"rdfs:subClassOf: {NO_WORDS}"),
        ("Part1", f"it is declared as Parts: {NO_WORDS}"),
    ]


NOT_ONE_CLASS = "must be one class, and it is not a single named class; Object is used"
ARGUMENTS = [
    restricted(f"somrs:argument{number}", f"owl:allValuesFrom type:{name}") for number, name in enumerate(("Jar", "Cup", "Can"), 1)
]


@pytest.mark.parametrize(
    ("text", "expected", "notes"),
    [
        (
            ':r a owl:ObjectProperty , owl:FunctionalProperty ; rdfs:domain type:Jar ; rdfs:range type:Cup ; somrs:excludes "place" .',
            RelationType(name="r", joins=("Jar", "Cup"), functional=True, excludes="place"),
            [],
        ),
        (
            ':r a owl:ObjectProperty , owl:SymmetricProperty ; rdfs:domain type:Jar ; rdfs:range type:Cup , type:Can ; rdfs:comment "R" .',
            RelationType(name="r", joins=("Jar", "Object"), symmetric=True, doc="R"),
            [f"range {NOT_ONE_CLASS}"],
        ),
        (
            ":r a owl:ObjectProperty ; rdfs:domain owl:Thing ; rdfs:range type:Cup , [ owl:unionOf ( type:Cup type:Can ) ] .",
            RelationType(name="r", joins=("Object", "Object")),
            [f"domain {NOT_ONE_CLASS}", f"range {NOT_ONE_CLASS}"],
        ),
        (
            f':r a owl:Class ; rdfs:subClassOf somrs:Fact , {" , ".join(reversed(ARGUMENTS))} ; somrs:functional true ; rdfs:comment "R" .',
            RelationType(name="r", joins=("Jar", "Cup", "Can"), functional=True, doc="R"),
            [],
        ),
        (
            f":r a owl:Class ; rdfs:subClassOf somrs:Fact , {ARGUMENTS[0]} , {restricted('attribute:Weight', 'owl:maxCardinality 2')} , "
            f"{restricted('attribute:Weight', 'owl:maxCardinality 1')} , {ARGUMENTS[1]} ; somrs:symmetric true .",
            RelationType(name="r", joins=("Jar", "Cup"), symmetric=True),
            [f"says a rule for Weight; {ONE_VALUE}", f"rdfs:subClassOf: {NO_WORDS}", f"rdfs:subClassOf: {NO_WORDS}"],
        ),
    ],
)
def test_relations(text: str, expected: RelationType, notes: list[str]) -> None:
    owl_import = turtle(text)
    assert [*owl_import.ontology] == [expected]
    assert noted(owl_import) == [("r", note) for note in dict.fromkeys(notes)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            ':f a somrs:Function , owl:NamedIndividual ; somrs:parameters "Jar Cup" ; somrs:unit "m" ; somrs:values "{\\"a b\\": 2}" ; '
            'rdfs:comment "F" .',
            FunctionType(name="f", parameters=("Jar", "Cup"), values={"a b": 2.0}, unit="m", doc="F"),
        ),
        (
            ':f a somrs:Function ; somrs:parameters "Jar" ; somrs:reads "Weight" .',
            FunctionType(name="f", parameters=("Jar",), attribute="Weight"),
        ),
        (
            ':S a owl:Class ; rdfs:subClassOf somrs:Service ; somrs:effect "p(?x)" ; somrs:inputs "?x: Jar , y:Cup" ; '
            'somrs:outputs "n: number" ; somrs:kind "cognitive" ; somrs:cost "3" ; somrs:precondition "q(?x)" ; rdfs:comment "S" ; '
            'somrs:invariant "r(?x)" ; '
            'somrs:handlers "[{\\"on\\":\\"failure\\",\\"effect\\":\\"q(?x)\\"}]" .',
            ServiceType(
                name="S",
                effect="p(?x)",
                precondition="q(?x)",
                invariant="r(?x)",
                inputs=(Parameter(name="x", type="Jar"), Parameter(name="y", type="Cup")),
                outputs=(Parameter(name="n", type="number"),),
                kind=ServiceKind.COGNITIVE,
                handlers=(Handler(on=Occasion.FAILURE, effect="q(?x)"),),
                cost="3",
                doc="S",
            ),
        ),
        (
            '<urn:so-mrs:service:S> a owl:Class ; rdfs:subClassOf <urn:so-mrs:service:TransferObject> ; somrs:effect "p()" .',
            ServiceType(name="S", effect="p()", parent="TransferObject"),
        ),
    ],
)
def test_functions_and_services(text: str, expected: Definition) -> None:
    owl_import = turtle(text)
    assert [*owl_import.ontology] == [expected]
    assert owl_import.notes == ()
    assert not owl_import.map.objects


def test_subclasses_are_of_the_kind_of_their_superclass() -> None:
    """A service type, a relation and a group of attributes, each two levels below the class of the vocabulary."""
    owl_import = turtle(f"""\
:Move a owl:Class ; rdfs:subClassOf somrs:Service ; somrs:effect "p()" .
:Carry a owl:Class ; rdfs:subClassOf :Move ; somrs:effect "q()" .
:touches a owl:Class ; rdfs:subClassOf somrs:Fact , {ARGUMENTS[0]} .
:hits a owl:Class ; rdfs:subClassOf :touches , {ARGUMENTS[0]} .
:Size a owl:Class ; rdfs:subClassOf somrs:Value .
:Volume a owl:Class ; rdfs:subClassOf :Size .
""")
    ontology = owl_import.ontology
    assert {name: service.parent for name, service in ontology.services.items()} == {"Move": None, "Carry": "Move"}
    assert [*ontology.relations] == ["hits", "touches"]
    assert not ontology.types


def part(rule: str, property_iri: str = "somrs:hasPart") -> str:
    return restricted(property_iri, rule)


def vase(
    attributes: tuple[str, ...] = (),
    required: tuple[str, ...] = (),
    parts: tuple[Part, ...] = (),
    constraints: tuple[Constraint, ...] = (),
    defaults: dict[str, Value] | None = None,
) -> ObjectType:
    return ObjectType(
        name="V", parent="Jar", attributes=attributes, required=required, parts=parts, constraints=constraints, defaults=defaults or {}
    )


AT_LEAST_1 = restricted("attribute:Weight", f"owl:allValuesFrom [ a rdfs:Datatype ; {facet_range('[ xsd:minInclusive 1 ]')} ]")
FORMS = 'owl:allValuesFrom [ a rdfs:Datatype ; owl:oneOf ( "Box" "Cylinder" ) ]'
ATTRIBUTE_RULES = [
    restricted(f"attribute:{name}", rule)
    for name, rule in (
        ("Weight", "owl:minCardinality 1"),
        ("Label", "owl:someValuesFrom xsd:string"),
        ("Open", "owl:qualifiedCardinality 1"),
        ("Color", "owl:maxQualifiedCardinality 1"),
        ("Texture", "owl:maxCardinality 1"),
        ("Speed", "owl:minCardinality 2"),
        ("Price", "owl:maxCardinality 0"),
    )
]
TYPES: list[tuple[list[str], ObjectType, list[str]]] = [
    (
        ATTRIBUTE_RULES,
        vase(attributes=("Color", "Texture"), required=("Label", "Open", "Weight")),
        [f"{BELOW_NOTE}a rule for Price; {ONE_VALUE}", f"{BELOW_NOTE}a rule for Speed; {ONE_VALUE}"],
    ),
    (
        [
            part("owl:onClass type:Cup ; owl:minQualifiedCardinality 1"),
            part("owl:onClass type:Cup ; owl:maxQualifiedCardinality 4"),
            part("owl:onClass type:Cup ; owl:maxQualifiedCardinality 3"),
            part("owl:onClass type:Can ; owl:qualifiedCardinality 2"),
            part("owl:onClass type:Bottle ; owl:minQualifiedCardinality 3"),
            part("owl:onClass type:Bottle ; owl:minQualifiedCardinality 2"),
            part("owl:someValuesFrom type:Box", "[ owl:inverseOf relation:isPartOf ]"),
        ],
        vase(
            parts=(
                Part(type="Bottle", minimum=3),
                Part(type="Box", minimum=1),
                Part(type="Can", minimum=2, maximum=2),
                Part(type="Cup", minimum=1, maximum=3),
            )
        ),
        [],
    ),
    ([part("owl:allValuesFrom type:Cup")], vase(), [f"{BELOW_NOTE}a class expression where a class should be named"]),
    (
        [part("owl:onClass type:Cup")],
        vase(),
        [f"{BELOW_NOTE}a rule for parts; parts are counted: `min 1 Wall`, `max 4 Wall`, `exactly 1 Floor`"],
    ),
    (
        [part("owl:someValuesFrom type:Cup", "[ owl:inverseOf relation:isOn ]")],
        vase(),
        [f"{BELOW_NOTE}a rule for something without a name, which is not an attribute; state it as a formula with somrs:constraint"],
    ),
    (
        [part("owl:someValuesFrom type:Cup", "relation:isOn")],
        vase(),
        [f"{BELOW_NOTE}a rule for isOn, which is not an attribute; state it as a formula with somrs:constraint"],
    ),
    ([ARGUMENTS[0]], vase(), ["it has a rule for an argument, and is not a relation"]),
    (
        ["[ owl:onProperty attribute:Weight ; owl:maxCardinality 1 ]"],
        vase(),
        [f"{BELOW_NOTE}a class expression; a type has one parent, cardinalities and `only` for its attributes, and formulas"],
    ),
    (
        [restricted("attribute:Weight", "owl:allValuesFrom xsd:decimal")],
        vase(),
        [f"{BELOW_NOTE}the composition of Weight; the attribute's own range defines it"],
    ),
    ([AT_LEAST_1], vase(constraints=(Constraint(attribute="Weight", minimum=1.0),)), []),
    (
        [restricted("attribute:Shape", f"owl:allValuesFrom {restricted('attribute:Form', FORMS)}")],
        vase(constraints=(Constraint(attribute="Shape.Form", values=("Box", "Cylinder")),)),
        [],
    ),
    (
        [restricted("attribute:Shape", f"owl:allValuesFrom {restricted('attribute:Form', 'owl:maxCardinality 1')}")],
        vase(),
        [f"{BELOW_NOTE}a rule for the parts of Shape; only limits of them are kept"],
    ),
]


@pytest.mark.parametrize(("rules", "expected", "notes"), TYPES)
def test_types(rules: list[str], expected: ObjectType, notes: list[str]) -> None:
    owl_import = turtle(f":V a owl:Class ; rdfs:subClassOf type:Jar , {' , '.join(rules)} .")
    assert [*owl_import.ontology] == [expected]
    assert sorted(noted(owl_import)) == [("V", note) for note in notes]


def test_types_with_all_that_is_annotated() -> None:
    owl_import = turtle(f"""
:V a owl:Class ; rdfs:subClassOf type:Jar , owl:Thing , {" , ".join((*ATTRIBUTE_RULES[:2], part("owl:someValuesFrom type:Can")))} ,
    {part("owl:someValuesFrom type:Cup")} ; somrs:order "Weight Label" ; somrs:parts "Cup Can" ; somrs:driver "v.py" ;
  rdfs:comment "C" ; somrs:default "Weight = 0.5" , "Label = \\"a\\"" , "Open = true" .
""")
    assert [*owl_import.ontology] == [
        ObjectType(
            name="V",
            parent="Jar",
            required=("Weight", "Label"),
            parts=(Part(type="Cup", minimum=1), Part(type="Can", minimum=1)),
            defaults={"Label": "a", "Open": True, "Weight": 0.5},
            driver="v.py",
            doc="C",
        )
    ]
    assert owl_import.notes == ()


def test_rules_have_the_place_and_the_meaning_that_is_said_of_them() -> None:
    axiom = "[] a owl:Axiom ; owl:annotatedSource :V ;"
    owl_import = turtle(f"""
:V a owl:Class ; rdfs:subClassOf type:Jar , {AT_LEAST_1} ; somrs:constraint "?Self.Weight < 3" , "?Self.Weight > 1" .
{axiom} owl:annotatedProperty rdfs:label .
{axiom} owl:annotatedTarget {part("owl:onClass type:Cup")} .
{axiom} owl:annotatedTarget {restricted("attribute:Weight", "owl:cardinality 1")} .
{axiom} owl:annotatedTarget "?Self.Weight > 1" ; owl:annotatedProperty somrs:constraint ; somrs:rank 1 ; rdfs:comment "More" .
{axiom} owl:annotatedTarget {AT_LEAST_1} ; owl:annotatedProperty rdfs:subClassOf ; somrs:rank 2 ; rdfs:comment "Least" .
""")
    assert owl_import.ontology.types["V"].constraints == (
        Constraint(formula="?Self.Weight > 1", doc="More"),
        Constraint(attribute="Weight", minimum=1.0, doc="Least"),
        Constraint(formula="?Self.Weight < 3"),
    )


def test_parents() -> None:
    owl_import = turtle("""
:V a owl:Class ; rdfs:subClassOf type:Jar , :W .
:W a owl:Class ; rdfs:subClassOf :X .
:X a rdfs:Class ; rdfs:subClassOf type:Jar .
:Y a rdfs:Class .
:Q a owl:DatatypeProperty ; rdfs:range xsd:decimal ; rdfs:domain :V .
:R a owl:DatatypeProperty ; rdfs:range xsd:decimal ; rdfs:domain [ owl:unionOf ( :W :X ) ] .
""")
    types = {type.name: (type.parent, type.attributes) for type in owl_import.ontology.types.values()}
    assert types == {"V": ("W", ("Q",)), "W": ("X", ("R",)), "X": ("Jar", ("R",)), "Y": ("Object", ())}
    assert noted(owl_import) == [("Y", "it has no superclass; Object is used as its parent")]


GRASPABLE = "a owl:Class ; rdfs:subClassOf type:Graspable"


@pytest.mark.parametrize(
    ("text", "name", "renamings", "notes"),
    [
        (f':V {GRASPABLE} ; rdfs:label "a b" , "Vase" .', "Vase", (), []),
        (f':V {GRASPABLE} ; rdfs:label "Vase" , "Glas"@de .', "Vase", (), [f"rdfs:label Glas: {NO_WORDS}"]),
        (f':V {GRASPABLE} ; rdfs:label "a b" .', "V", (), []),
        (f'type:Cup {GRASPABLE} ; rdfs:label "Mug" .', "Cup", (Renaming(section=Section.TYPES, name="Cup", to="Mug"),), []),
        (f'type:Cup {GRASPABLE} ; rdfs:label "Cup" , "Mug" .', "Cup", (), []),
        (
            f'type:Cup {GRASPABLE} ; rdfs:label "NOT" .',
            "Cup",
            (),
            ["the label 'NOT' is no name (letters, digits, _ and -), so that it keeps its own"],
        ),
        (f'type:Newly {GRASPABLE} ; rdfs:label "Mug" .', "Mug", (), []),
        (f"type:Newly {GRASPABLE} .", "Newly", (), []),
        *((f':V {GRASPABLE} ; rdfs:label "{word}" , "a-1" , "b c" .', "a-1", (), []) for word in ("AND", "OR", "NOT", "TRUE", "FALSE")),
    ],
)
def test_what_a_type_is_called(text: str, name: str, renamings: tuple[Renaming, ...], notes: list[str]) -> None:
    owl_import = turtle(text)
    assert [*owl_import.ontology.types] == [name]
    assert owl_import.renamings == renamings
    assert [message for _, message in noted(owl_import)] == notes


def test_what_is_only_mentioned_is_neither_changed_nor_told() -> None:
    mentioned = """type:Jar a owl:Class ; rdfs:label "Jar" .
relation:isOn a owl:ObjectProperty , owl:FunctionalProperty .
attribute:Weight a owl:DatatypeProperty .
<urn:so-mrs:service:TransferObject> a owl:Class .
"""
    owl_import = turtle(mentioned + "attribute:A a owl:ObjectProperty ; rdfs:range type:Jar .")
    assert [(type(definition), definition.name) for definition in owl_import.ontology] == [(AttributeType, "A")]
    message = "its range is the datatype urn:so-mrs:type:Jar; there are numbers (xsd:decimal), texts (xsd:string), truths (xsd:boolean)"
    assert noted(owl_import) == [("A", f"{message} and lists of values{TEXT_TAKEN}")]


def test_definitions_come_in_the_order_in_which_they_were_written_and_what_is_new_by_name() -> None:
    types = [f":{name} {GRASPABLE} {rank} ." for name, rank in (("b", "; somrs:rank 2"), ("d", ""), ("c", "; somrs:rank 1"), ("a", ""))]
    assert [*turtle("\n".join(types)).ontology.types] == ["c", "b", "a", "d"]


def test_what_is_deprecated_is_removed() -> None:
    marks = {"Cup": "true", "Can": '"1"', "Jar": "false", "Box": '"no"'}
    owl_import = turtle("\n".join(f"type:{name} {GRASPABLE} ; owl:deprecated {mark} ." for name, mark in marks.items()))
    assert owl_import.removed == (DefinitionKey(section=Section.TYPES, name="Can"), DefinitionKey(section=Section.TYPES, name="Cup"))
    assert [*owl_import.ontology.types] == ["Box", "Jar"]
    assert owl_import.notes == ()


# Maps


@pytest.mark.parametrize(
    ("text", "objects", "facts", "notes"),
    [
        (
            """object:J1 a type:Jar , owl:NamedIndividual ; attribute:Weight 2 ; attribute:Open "1"^^xsd:boolean ; :unknown 3 ;
  attribute:Shape [ a <urn:so-mrs:value:Shape> ; attribute:Height 3 ; attribute:Form "Box" ] ; relation:isOn object:T1 .""",
            [Object(name="J1", type="Jar", values={"Weight": 2.0, "Open": True, "Shape.Height": 3.0, "Shape.Form": "Box"})],
            [Fact("isOn", ("J1", "T1"))],
            [("J1", f"unknown 3: {NO_WORDS}")],
        ),
        (
            'object:J1 a type:Jar ; rdfs:label "J2" .',
            [Object(name="J1", type="Jar")],
            [],
            [("J1", "the label 'J2' does not rename an object; give it another name on the map itself")],
        ),
        (':J1 a type:Jar , type:Graspable ; rdfs:label "J2" .', [Object(name="J2", type="Jar")], [], []),
        (":J1 a type:Nope .", [Object(name="J1", type="Nope")], [], []),
        (
            ':J1 a owl:NamedIndividual ; rdfs:comment "x" .',
            [],
            [],
            [
                ("J1", "it is an individual of no known type, and is left out; give it one of the types"),
                ("J1", f"rdfs:comment x: {NO_WORDS}"),
            ],
        ),
        (
            """:J1 a type:Jar .
[] a relation:isNew ; somrs:argument1 :J1 .
[] a relation:between ; somrs:argument1 :J1 ; somrs:argument2 object:B ; somrs:argument4 object:C .
:Fact1 a :other , relation:isNew ; somrs:argument1 :J1 .""",
            [Object(name="J1", type="Jar")],
            [Fact("isNew", ("J1",)), Fact("between", ("J1", "B"))],
            [
                ("Fact1", f"it is declared as other: {NO_WORDS}"),
                ("Fact1", f"it is declared as isNew: {NO_WORDS}"),
                ("Fact1", f"somrs:argument1 J1: {NO_WORDS}"),
            ],
        ),
        (
            f":b a owl:Class ; rdfs:subClassOf somrs:Fact , {ARGUMENTS[0]} .\n:J1 a type:Jar .\n[] a :b ; somrs:argument1 :J1 .",
            [Object(name="J1", type="Jar")],
            [Fact("b", ("J1",))],
            [],
        ),
    ],
)
def test_maps(text: str, objects: list[Object], facts: list[Fact], notes: list[tuple[str, str]]) -> None:
    owl_import = turtle(text)
    assert [*owl_import.map.objects.values()] == objects
    assert sorted(owl_import.map.facts(), key=str) == sorted(facts, key=str)
    assert sorted(noted(owl_import)) == sorted(notes)


# Shapes


def shape(*properties: str, target: str = "type:Jar") -> str:
    return (
        f":S a sh:NodeShape ; sh:targetClass {target} ; sh:property {' , '.join(f'[ {property_text} ]' for property_text in properties)} ."
    )


@pytest.mark.parametrize(
    ("text", "constraints", "required", "notes"),
    [
        (
            shape(
                'sh:path attribute:Weight ; sh:minInclusive 1 ; sh:maxInclusive 2 ; sh:description "D" ; sh:minCount 0',
                "sh:path attribute:Label ; sh:minCount 1",
                'sh:path ( attribute:Shape attribute:Height ) ; sh:minCount 1 ; sh:datatype xsd:decimal ; sh:name "h" ; sh:maxCount 1',
                "sh:path ( attribute:Shape attribute:Width ) ; sh:minInclusive 0",
            ),
            (Constraint(attribute="Shape.Width", minimum=0.0), Constraint(attribute="Weight", minimum=1.0, maximum=2.0, doc="D")),
            ("Label",),
            [],
        ),
        (
            "type:Jar a sh:NodeShape ; sh:property [ sh:path attribute:Weight ; sh:in ( 1 2 ) ] .",
            (Constraint(attribute="Weight", values=(1.0, 2.0)),),
            (),
            [],
        ),
        (shape("sh:path attribute:Weight ; sh:in ( 1 2 )", target="type:Nope"), None, (), [f"sh:property: {NO_WORDS}"]),
        (
            shape("sh:path attribute:Weight ; sh:in ( 1 2 )", target=":Nope"),
            None,
            (),
            [
                f"it is declared as sh:NodeShape: {NO_WORDS}",
                f"sh:property: {NO_WORDS}",
                f"sh:targetClass Nope: {NO_WORDS}",
            ],
        ),
        *(
            (shape(property_text), (), (), [f"a property shape has {problem}", f"sh:property: {NO_WORDS}"])
            for property_text, problem in (
                ("sh:path :zz ; sh:minCount 1", "a path without attributes (zz); state it as a formula"),
                ("sh:path ( attribute:Shape :zz )", "a path without attributes (zz); state it as a formula"),
                ("sh:path [ sh:inversePath relation:isOn ]", "a path without attributes (empty); state it as a formula"),
                (
                    "sh:path attribute:Label ; sh:minLength 1",
                    "sh:minLength, which is not kept; limits are sh:minInclusive, sh:maxInclusive, sh:in and sh:minCount",
                ),
                ("sh:minCount 1", "no path"),
                ("sh:path attribute:Color ; sh:in ( :x )", "http://example.org/vases#x, where a value is expected"),
            )
        ),
    ],
)
def test_shapes(text: str, constraints: tuple[Constraint, ...] | None, required: tuple[str, ...], notes: list[str]) -> None:
    owl_import = turtle(text)
    jar = owl_import.ontology.types.get("Jar")
    assert (None if jar is None else jar.constraints) == constraints
    assert (() if jar is None else jar.required) == required
    assert jar is None or jar.defaults == upper().types["Jar"].defaults
    assert noted(owl_import) == [("S", note) for note in notes]


def test_what_a_shape_says_once_more_is_kept_once() -> None:
    weight = restricted("attribute:Weight", f"owl:allValuesFrom [ a rdfs:Datatype ; {facet_range('[ xsd:maxInclusive 2 ]')} ]")
    required_rule = restricted("attribute:Weight", "owl:cardinality 1")
    owl_import = turtle(
        f":V a owl:Class ; rdfs:subClassOf type:Jar , {weight} , {required_rule} .\n"
        + shape('sh:path attribute:Weight ; sh:maxInclusive 2 ; sh:minCount 2 ; sh:message "Light"', target=":V")
    )
    assert [*owl_import.ontology] == [vase(required=("Weight",), constraints=(Constraint(attribute="Weight", maximum=2.0),))]
    assert owl_import.notes == ()


def test_our_own_shapes_are_not_read_back_and_those_of_others_beside_them_are() -> None:
    of_jars = "a sh:NodeShape ; sh:targetClass type:Jar ; sh:property"
    own_shape = f"<urn:so-mrs:shape:type.Jar> {of_jars} [ sh:path attribute:Weight ; sh:minInclusive 9 ] ."
    other_shape = f"<urn:z:S> {of_jars} [ sh:path attribute:Weight ; sh:maxInclusive 2 ] ."
    owl_import = turtle(f"{own_shape}\n{other_shape}\n[] sh:path attribute:Weight .")
    assert owl_import.ontology.types["Jar"].constraints == (Constraint(attribute="Weight", maximum=2.0),)
    assert owl_import.notes == ()


# What is not understood


LONG = "x" * 59


def test_what_is_told_of_what_there_are_no_words_for() -> None:
    owl_import = turtle(f"""
<http://example.org/o> a owl:Ontology ; owl:versionInfo "1" ; rdfs:comment "c" ; rdfs:seeAlso <http://example.org/x> .
<urn:so-mrs:ontology> a owl:Ontology ; somrs:unit "x" ; rdfs:seeAlso "y" .
:Note a owl:AnnotationProperty ; :said "{LONG}" , "{LONG}y" .
:V {GRASPABLE} ; owl:madeUp 3 ; a owl:MadeUp , owl:AllDifferent ; rdfs:seeAlso [] ; sh:order 1 .
[] rdfs:comment "q" ; :x [ :y 3 ] .
[] sh:path attribute:Weight .
""")
    assert [(note.line and note.line - PREFIXES.count("\n"), note.subject, note.message) for note in owl_import.notes] == [
        (None, "something without a name", f"x: {NO_WORDS}"),
        (None, "something without a name", f"rdfs:comment q: {NO_WORDS}"),
        (2, "o", "rdfs:seeAlso x: it is not kept; put it into the comment"),
        (3, "ontology", "rdfs:seeAlso y: it is not kept; put it into the comment"),
        (3, "ontology", f"somrs:unit of the ontology: {NO_WORDS}"),
        (4, "Note", f"said {LONG}: {NO_WORDS}"),
        (4, "Note", f"said {LONG[2:]}...: {NO_WORDS}"),
        (5, "V", "it is declared as owl:AllDifferent: it is not needed: different names are different objects"),
        (5, "V", f"it is declared as owl:MadeUp: {NO_WORDS}"),
        (5, "V", "rdfs:seeAlso: it is not kept; put it into the comment"),
        (5, "V", f"owl:madeUp 3: {NO_WORDS}"),
        (5, "V", f"sh:order 1: {NO_WORDS}"),
    ]
    assert {(note.file, note.rule) for note in owl_import.notes} == {("vases.ttl", "not-kept")}


@pytest.mark.parametrize(
    ("text", "problems"),
    [
        (":A a owl:DatatypeProperty ; rdfs:range xsd:string , xsd:decimal .", [("A", "range", "has 2 ranges; an attribute has one")]),
        (
            ':A a owl:DatatypeProperty ; rdfs:range xsd:decimal ; somrs:tolerance "much" .',
            [("A", "value", "tolerance is a number, not 'much'")],
        ),
        (
            f":b a owl:Class ; rdfs:subClassOf somrs:Fact , {ARGUMENTS[0]} , {ARGUMENTS[2]} .",
            [("b", "relation", "has no arguments, or misses one; state `argument1 only TYPE`, and so on")],
        ),
        (
            f":b a owl:Class ; rdfs:subClassOf somrs:Fact , {ARGUMENTS[1]} .",
            [("b", "relation", "has no arguments, or misses one; state `argument1 only TYPE`, and so on")],
        ),
        (
            ':f a somrs:Function ; somrs:parameters "Jar" ; somrs:values "[1]" .',
            [("f", "value", "'[1]' cannot be read: Expected `object`, got `array`; export the ontology to see how it is written")],
        ),
        (
            ':S a owl:Class ; rdfs:subClassOf somrs:Service ; somrs:effect "p(?x)" ; somrs:kind "odd" ; somrs:inputs "x, ?y: Jar" ; '
            'somrs:outputs ": Jar, x:" .',
            [
                ("S", "value", "the kind is physical, cognitive or software, not 'odd'"),
                *(
                    ("S", "value", f"{parameter!r} is no variable with its type, such as Object: Graspable")
                    for parameter in ("x", ": Jar", "x:")
                ),
            ],
        ),
        (
            ':S a owl:Class ; rdfs:subClassOf somrs:Service , :T , :U ; somrs:effect "p()" .\n'
            ':T a owl:Class ; rdfs:subClassOf somrs:Service ; somrs:effect "p()" .\n'
            ':U a owl:Class ; rdfs:subClassOf :T ; somrs:effect "p()" .',
            [("S", "parent", "has the parents T and U; a service type has one parent")],
        ),
        (
            ":S a owl:Class ; rdfs:subClassOf somrs:Service .",
            [("S", "effect", "has no effect; state with somrs:effect what holds after it")],
        ),
        (
            f":V {GRASPABLE} , type:Room .",
            [("V", "parent", "has the parents Graspable and Room; a type has one parent: keep one of them")],
        ),
        (
            f':V {GRASPABLE} ; somrs:default "Weight" , "Weight = [1]" .',
            [
                ("V", "value", "the default 'Weight' cannot be read (there is no = in it); write such as Weight = 0.3"),
                ("V", "value", "the default 'Weight = [1]' cannot be read (it is no number, text or truth); write such as Weight = 0.3"),
            ],
        ),
        (
            f":NOT {GRASPABLE} .",
            [("NOT", "name", "is no name for a type; give it a label of a letter and then letters, digits, _ or -")],
        ),
        (
            f':a {GRASPABLE} ; rdfs:label "b" .\n:b {GRASPABLE} .',
            [("b", "duplicate", "has the same name as <http://example.org/vases#a>; give one of the two another name")],
        ),
        (":J1 a type:Jar , type:Cup .", [("J1", "type", "is of the types Cup and Jar; an object has one type")]),
        (":J1 a owl:NamedIndividual ; attribute:Weight 2 .", [("J1", "type", "is of no type; an object has one type")]),
    ],
)
def test_what_is_wrong(text: str, problems: list[tuple[str, str, str]]) -> None:
    found_problems = wrong(text)
    assert [(problem.subject, problem.rule, problem.message) for problem in found_problems] == problems
    assert {problem.file for problem in found_problems} == {"vases.ttl"}
    first = PREFIXES.count("\n") + 1
    assert {problem.line for problem in found_problems} <= {first, first + 1}


# Texts


XML = """<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:owl="http://www.w3.org/2002/07/owl#"
  xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#">
  <owl:Class rdf:about="urn:so-mrs:type:Vase"><rdfs:subClassOf rdf:resource="urn:so-mrs:type:Jar"/></owl:Class>
  <owl:Class rdf:about="http://example.org/pots/Pot"/>
</rdf:RDF>
"""
DECLARED = "<?xml version='1.0'?>\n"


@pytest.mark.parametrize("declaration", ["", DECLARED, "\ufeff" + DECLARED])
def test_xml_is_known_by_its_beginning_or_its_root(declaration: str) -> None:
    owl_import = read(declaration + XML, "pots.rdf", upper())
    assert [(type.name, type.parent) for type in owl_import.ontology.types.values()] == [("Pot", "Object"), ("Vase", "Jar")]
    message = "it has no superclass; Object is used as its parent"
    assert owl_import.notes == (
        Problem(file="pots.rdf", line=4 + declaration.count("\n"), subject="Pot", rule="not-kept", message=message),
    )


def test_only_xml_may_not_have_a_document_type() -> None:
    (note,) = read('<http://example.org/a> <http://example.org/b> "<!DOCTYPE" .', "file", upper()).notes
    assert (note.line, note.subject, note.message) == (1, "a", f"b <!DOCTYPE: {NO_WORDS}")


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (
            DECLARED + "<!DOCTYPE x [<!ENTITY a 'b'>]><x>&a;</x>",
            None,
            "has a document type declaration, which is not read; save the file as Turtle",
        ),
        (
            "<!DOCTYPE x>" + XML,
            None,
            "has a document type declaration, which is not read; save the file as Turtle",
        ),
        (XML + "<", 6, "this is not XML: unclosed token"),
        ("\n\n@prefix x", 3, "this is not Turtle: expected qname after @prefix"),
        ("{}", 1, "this is not Turtle: expected directive or statement"),
    ],
)
def test_what_is_said_of_a_text_that_is_neither(text: str, line: int | None, message: str) -> None:
    with pytest.raises(ModelError) as caught:
        read(text, "pots", upper())
    assert caught.value.problems == [Problem(file="pots", line=line, subject="file", rule="syntax", message=message)]
