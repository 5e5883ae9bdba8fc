"""Other names for definitions and objects, everywhere where they are spoken of, all at once."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Renaming, Section
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.renaming import Renamer, speaks_of
from somrs.ontology.services import Handler, Occasion, Parameter, ServiceType
from somrs.ontology.types import AttributeType, Constraint, FunctionType, Kind, ObjectType, Ontology, Part, RelationType

ONTOLOGY = Ontology(
    [
        AttributeType(name="Color", kind=Kind.ENUMERATION, values=("A", "Blue")),
        AttributeType(name="Owner", kind=Kind.TEXT),
        AttributeType(name="Shape", kind=Kind.COMPLEX, attributes=("Color", "Owner")),
        RelationType(name="isOn", joins=("Jar", "Room")),
        FunctionType(name="way", parameters=("Jar", "Room"), values={"A B": 1.0, "B C": 2.0}),
        FunctionType(name="size", parameters=("Jar",), attribute="Shape.Owner"),
        ObjectType(name="Jar", parent=None),
        ObjectType(name="Room", parent=None),
    ]
)


def renamer(*renamings: tuple[Section, str, str]) -> Renamer:
    return Renamer((Renaming(section=section, name=name, to=new_name) for section, name, new_name in renamings), ONTOLOGY)


SWAPPED = renamer(
    (Section.OBJECTS, "A", "B"),
    (Section.OBJECTS, "B", "A"),
    (Section.TYPES, "Jar", "Tin"),
    (Section.ATTRIBUTES, "Color", "Paint"),
    (Section.RELATIONS, "isOn", "standsOn"),
    (Section.FUNCTIONS, "way", "road"),
)


@pytest.mark.parametrize(
    ("text", "renamed"),
    [
        ("A isOn B", "B standsOn A"),
        ("NOT ?A: Jar isOn ?B", "NOT ?A: Tin standsOn ?B"),
        ("C isOn D OR isNew(A) AND A.Shape.Color = A", "C standsOn D OR isNew(B) AND B.Shape.Paint = A"),
        ("A = ?x.Color", "A = ?x.Paint"),
        ("A.Owner = A", "B.Owner = B"),
        ("way(A, ?x) + 1 < 2 m", "road(B, ?x) + 1 < 2 m"),
        ('size(C) = "A"', 'size(C) = "A"'),
    ],
)
def test_formulas(text: str, renamed: str) -> None:
    assert SWAPPED.formula(parse(text)) == parse(renamed)


def test_definitions() -> None:
    renamed = SWAPPED.ontology(ONTOLOGY)
    assert renamed.attributes["Paint"] == structs.replace(ONTOLOGY.attributes["Color"], name="Paint")
    assert renamed.attributes["Shape"].attributes == ("Paint", "Owner")
    assert renamed.relations == {"standsOn": RelationType(name="standsOn", joins=("Tin", "Room"))}
    assert renamed.functions["road"] == FunctionType(name="road", parameters=("Tin", "Room"), values={"B A": 1.0, "A C": 2.0})
    assert renamed.functions["size"] == FunctionType(name="size", parameters=("Tin",), attribute="Shape.Owner")
    assert SWAPPED.definition(ONTOLOGY.types["Room"]) is ONTOLOGY.types["Room"]
    assert SWAPPED.renamed_key(DefinitionKey(section=Section.OBJECTS, name="A")) == DefinitionKey(section=Section.OBJECTS, name="B")


def test_types() -> None:
    jar = ObjectType(
        name="Jar",
        parent="Jar",
        attributes=("Color",),
        required=("Color", "Owner"),
        parts=(Part(type="Jar", minimum=2),),
        constraints=(Constraint(attribute="Shape.Color", formula="?Self isOn B"), Constraint(formula="(A")),
        defaults={"Shape.Color": "A"},
        doc="A",
    )
    assert SWAPPED.definition(jar) == ObjectType(
        name="Tin",
        parent="Tin",
        attributes=("Paint",),
        required=("Paint", "Owner"),
        parts=(Part(type="Tin", minimum=2),),
        constraints=(Constraint(attribute="Shape.Paint", formula="?Self standsOn A"), Constraint(formula="(A")),
        defaults={"Shape.Paint": "A"},
        doc="A",
    )


def test_what_becomes_of_a_map() -> None:
    room_a, room_c = (
        Object(name="A", type="Room", values={"Color": "A"}),
        Object(name="C", type="Room", values={"Color": "Blue", "Owner": "A"}),
    )
    jar, other_room = Object(name="D", type="Jar"), Object(name="E", type="Room", values={"Owner": "A"})
    map = Map([room_a, room_c, jar, other_room], [Fact("isOn", ("A", "C")), Fact("isNew", ("C",))])
    expected: list[Change] = [
        FactRemoved(Fact("isOn", ("A", "C"))),
        ObjectRemoved("A"),
        ObjectAdded(Object(name="B", type="Room", values={"Paint": "A"})),
        ValueSet("C", "Color", None),
        ValueSet("C", "Paint", "Blue"),
        ObjectAdded(Object(name="D", type="Tin")),
        FactAdded(Fact("standsOn", ("B", "C"))),
    ]
    assert list(SWAPPED.changes(map)) == expected
    assert SWAPPED.object(other_room) is other_room


def test_whether_something_is_spoken_of() -> None:
    formula = parse("A isOn B")
    mentions = [(Section.OBJECTS, "A"), (Section.RELATIONS, "isOn"), (Section.OBJECTS, "C"), (Section.TYPES, "A")]
    assert [speaks_of(formula, DefinitionKey(section=section, name=name), ONTOLOGY) for section, name in mentions] == [
        True,
        True,
        False,
        False,
    ]
    way = ONTOLOGY.functions["way"]
    assert [speaks_of(way, DefinitionKey(section=Section.OBJECTS, name=name), ONTOLOGY) for name in ("C", "D")] == [True, False]


def test_service_types() -> None:
    service = ServiceType(
        name="Bring",
        parent="Bring",
        effect="?Jar isOn B",
        precondition="?Jar.Color = A",
        invariant="?Jar.Color = A",
        inputs=(Parameter(name="Jar", type="Jar"),),
        outputs=(Parameter(name="Weight", type="number"), Parameter(name="Other", type="Jar")),
        handlers=(Handler(on=Occasion.FAILURE, effect="A isOn B", when="?Jar.Color = A", service_type="Bring"),),
        cost="way(A, ?Jar) + 1",
    )
    assert renamer((Section.SERVICES, "Bring", "Carry")).definition(service) == structs.replace(
        service, name="Carry", parent="Carry", handlers=(structs.replace(service.handlers[0], service_type="Carry"),)
    )
    assert SWAPPED.definition(service) == structs.replace(
        service,
        effect="?Jar standsOn A",
        precondition="?Jar.Paint = A",
        invariant="?Jar.Paint = A",
        inputs=(Parameter(name="Jar", type="Tin"),),
        outputs=(Parameter(name="Weight", type="number"), Parameter(name="Other", type="Tin")),
        handlers=(Handler(on=Occasion.FAILURE, effect="B standsOn A", when="?Jar.Paint = A", service_type="Bring"),),
        cost="road(B, ?Jar) + 1",
    )
    unread = structs.replace(service, effect="(", precondition=None, invariant=None, cost="(", inputs=(), outputs=(), handlers=())
    assert SWAPPED.definition(unread) is unread
