"""A small ontology with every kind of definition, and Hypothesis strategies for maps and formulas in it."""

from __future__ import annotations

from hypothesis import strategies as st

from somrs.entish.formula import (
    Attribute,
    Call,
    Comparison,
    Formula,
    Literal,
    Name,
    Not,
    Number,
    Relation,
    Term,
    Text,
    Truth,
    Variable,
    conjunction,
    disjunction,
)
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.types import AttributeType, FunctionType, Kind, ObjectType, Ontology, RelationType, Value

ONTOLOGY = Ontology(
    [
        AttributeType(name="PositionX", kind=Kind.NUMBER, unit="m"),
        AttributeType(name="PositionY", kind=Kind.NUMBER, unit="m"),
        AttributeType(name="PositionZ", kind=Kind.NUMBER, unit="m"),
        AttributeType(name="Size", kind=Kind.NUMBER, unit="m", tolerance=0.5),
        AttributeType(name="Color", kind=Kind.ENUMERATION, values=("Red", "Blue")),
        AttributeType(name="Label", kind=Kind.TEXT),
        AttributeType(name="Open", kind=Kind.TRUTH),
        RelationType(name="isOn", joins=("Object", "Object"), functional=True, excludes="place"),
        RelationType(name="isIn", joins=("Object", "Object"), functional=True, excludes="place"),
        RelationType(name="isNear", joins=("Object", "Object"), symmetric=True),
        RelationType(name="isPairedWith", joins=("Object", "Object"), symmetric=True, functional=True),
        RelationType(name="between", joins=("Object", "Object", "Object")),
        RelationType(name="isNew", joins=("Object",)),
        FunctionType(name="distance", parameters=("Object", "Object"), unit="m"),
        FunctionType(name="size", parameters=("Object",), attribute="Size", unit="m"),
        ObjectType(name="Object", parent=None, attributes=("PositionX", "PositionY", "PositionZ", "Size", "Color", "Label", "Open")),
        ObjectType(name="Thing", parent="Object", defaults={"Open": True, "Size": 2.0}),
        ObjectType(name="Jar", parent="Thing", defaults={"Color": "Red"}),
        ObjectType(name="Shelf", parent="Object"),
    ]
)

OBJECTS = ("A", "B", "C", "D")

lengths = st.integers(0, 4).map(float)
values: dict[str, st.SearchStrategy[Value]] = {
    "PositionX": lengths,
    "PositionY": lengths,
    "PositionZ": lengths,
    "Size": st.integers(0, 8).map(lambda halves: halves / 2),
    "Color": st.sampled_from(["Red", "Blue"]),
    "Label": st.sampled_from(["one", "two"]),
    "Open": st.booleans(),
}
object_names = st.sampled_from(OBJECTS)


def _fact(relation: RelationType) -> st.SearchStrategy[Fact]:
    return st.builds(Fact, st.just(relation.name), st.tuples(*(object_names for _ in relation.joins)))


facts = st.one_of([_fact(relation) for relation in ONTOLOGY.relations.values()])

# Made once: Hypothesis takes longer to make a strategy than to draw from it.
_present_names = st.lists(object_names, unique=True, min_size=1)
_types = st.sampled_from(["Object", "Thing", "Jar", "Shelf"])
_values_of_object = st.fixed_dictionaries({}, optional=values)
_fact_lists = st.lists(facts, max_size=10)


@st.composite
def maps(draw: st.DrawFn) -> Map:
    """Up to four objects and any facts between them, whether or not the relations' definitions allow them together."""
    present = draw(_present_names)
    objects = [Object(name=name, type=draw(_types), values=draw(_values_of_object)) for name in present]
    chosen_facts = [fact for fact in draw(_fact_lists) if set(fact.arguments) <= set(present)]
    return Map(objects, chosen_facts)


# Formulas. ?x ?y ?z stand for objects, ?v ?w for values.

object_variables = st.sampled_from([Variable("x"), Variable("y", "Thing"), Variable("z", "Shelf")])
objects: st.SearchStrategy[Name | Variable] = object_names.map(Name) | object_variables
value_variables = st.sampled_from([Variable("v"), Variable("w")])
numbers = st.builds(Number, st.integers(0, 4).map(float), st.sampled_from([None, "m"])) | st.builds(
    Number, st.integers(0, 400).map(float), st.just("cm")
)
constants = numbers | st.sampled_from([Name("Red"), Name("Blue"), Text("one"), Truth(True), Truth(False)])
readings: st.SearchStrategy[Term] = (
    st.builds(Attribute, objects, st.sampled_from(list(values)))
    | st.builds(Call, st.just("distance"), st.tuples(objects, objects))
    | st.builds(Call, st.just("size"), st.tuples(objects))
)
signs = st.sampled_from(["=", "=", "!=", "<", "<=", ">", ">="])


def _atom(relation: RelationType) -> st.SearchStrategy[Relation]:
    return st.builds(Relation, st.just(relation.name), st.tuples(*(objects for _ in relation.joins)))


relations = st.one_of([_atom(relation) for relation in ONTOLOGY.relations.values()])
comparisons = st.builds(Comparison, readings, signs, constants | readings)
identities = st.builds(Comparison, objects, st.sampled_from(["=", "!="]), objects)
equations = st.builds(Comparison, readings, st.just("="), value_variables) | st.builds(
    Comparison, value_variables, signs, constants | readings
)
equalities = st.builds(Comparison, value_variables, signs, value_variables)
literals: st.SearchStrategy[Literal] = st.one_of(
    relations, relations, comparisons, equations, identities, equalities, st.builds(Not, relations), st.builds(Not, comparisons)
)
formulas: st.SearchStrategy[Formula] = st.recursive(
    literals,
    lambda inner: st.lists(inner, min_size=2, max_size=3).flatmap(
        lambda parts: st.sampled_from([conjunction(*parts), disjunction(*parts)])
    ),
    max_leaves=5,
)
