"""A small ontology with all sorts of relations and attributes, and the vocabulary of planning problems with it."""

from __future__ import annotations

from somrs.entish.parse import parse
from somrs.ontology.types import AttributeType, FunctionType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.vocabulary import Vocabulary

ONTOLOGY = Ontology(
    [
        AttributeType(name="Clean", kind=Kind.TRUTH),
        AttributeType(name="Level", kind=Kind.NUMBER, unit="m", tolerance=0.5),
        AttributeType(name="Weight", kind=Kind.NUMBER, unit="kg"),
        AttributeType(name="PositionX", kind=Kind.NUMBER, unit="m"),
        AttributeType(name="PositionY", kind=Kind.NUMBER, unit="m"),
        FunctionType(name="level", parameters=("Thing",), attribute="Level"),
        FunctionType(name="weight", parameters=("Thing",), attribute="Weight"),
        ObjectType(name="Object", parent=None, attributes=("Clean", "Level", "Weight", "PositionX", "PositionY")),
        ObjectType(name="Thing", parent="Object"),
        ObjectType(name="Cup", parent="Thing"),
        ObjectType(name="Place", parent="Object"),
        ObjectType(name="Robot", parent="Object"),
        RelationType(name="on", joins=("Thing", "Place"), functional=True, excludes="place"),
        RelationType(name="heldBy", joins=("Thing", "Robot"), functional=True, excludes="place"),
        RelationType(name="at", joins=("Robot", "Place"), functional=True),
        RelationType(name="near", joins=("Place", "Place"), symmetric=True),
        RelationType(name="marriedTo", joins=("Thing", "Thing"), symmetric=True, functional=True),
        RelationType(name="meet", joins=("Thing", "Thing", "Place"), symmetric=True),
        RelationType(name="tiedTo", joins=("Thing", "Place"), excludes="bond"),
        RelationType(name="gluedTo", joins=("Thing", "Place"), functional=True, excludes="bond"),
        RelationType(name="marked", joins=("Thing",)),
    ]
)
ALL_EFFECTS = "?T on ?P AND ?T.Clean = TRUE AND ?T.Level = 1 m AND ?R at ?P AND ?P near ?Q AND marked(?T) AND ?T gluedTo ?P"


def make_vocabulary(*effects: str, counting: bool = False) -> Vocabulary:
    return Vocabulary(ONTOLOGY, map(parse, effects), counting)
