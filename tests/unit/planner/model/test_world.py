"""What a map says to the planner: types, what holds now, what is settled, and what uses of services cost."""

from __future__ import annotations

import pytest

from somrs.entish import Name, Number, Text, Truth
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import PROVIDER, Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.operators import Test as Compared
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.vocabulary import Argument
from somrs.planner.model.vocabulary import Fact as Pattern
from somrs.planner.model.world import Binding, World, as_argument, as_term

ONTOLOGY = Ontology(
    [
        AttributeType(name="Clean", kind=Kind.TRUTH),
        AttributeType(name="Level", kind=Kind.NUMBER, unit="m", tolerance=0.5),
        AttributeType(name="Mode", kind=Kind.ENUMERATION, values=("Slow", "Fast")),
        AttributeType(name="Label", kind=Kind.TEXT),
        ObjectType(name="Object", parent=None, attributes=("Level",)),
        ObjectType(name="Thing", parent="Object", attributes=("Clean", "Label"), defaults={"Level": 1.0}),
        ObjectType(name="Cup", parent="Thing"),
        ObjectType(name="Place", parent="Object"),
        ObjectType(name="Robot", parent="Object", attributes=("Mode",)),
        RelationType(name="on", joins=("Thing", "Place"), functional=True, excludes="place"),
        RelationType(name="near", joins=("Place", "Place"), symmetric=True),
        RelationType(name="marked", joins=("Thing",)),
    ]
)
OBJECTS = [
    Object(name="T1", type="Thing", values={"Clean": True, "Level": 2.0, "Label": "a"}),
    Object(name="T2", type="Thing", values={"Clean": False}),
    Object(name="C1", type="Cup"),
    Object(name="P1", type="Place"),
    Object(name="P2", type="Place", values={"Level": 2.0}),
    Object(name="P3", type="Place"),
    Object(name="R1", type="Robot", values={"Mode": "Fast"}),
    Object(name="R2", type="Robot"),
]
FACTS = [
    Fact("on", ("T1", "P1")),
    Fact("on", ("T2", "P1")),
    Fact("on", ("C1", "P2")),
    Fact("near", ("P2", "P1")),
    Fact("near", ("P1", "P3")),
    Fact("marked", ("T1",)),
]
PUT_SERVICE = ServiceType(name="Put", inputs=(Parameter(name="T", type="Thing"),), effect="?T on P1 AND P1 near P2 AND ?T.Level = 1 m")
WIPE = ServiceType(name="Wipe", inputs=(Parameter(name="T", type="Thing"),), effect="?T.Clean = TRUE")


def make_world(*services: AvailableService, excluded: frozenset[str] = frozenset()) -> World:
    offered = services or (AvailableService(PUT_SERVICE, ("R1", "R2")), AvailableService(WIPE, ("R2", "Far")))
    return World(Problem(ontology=ONTOLOGY, map=Map(OBJECTS, FACTS), goal=parse("marked(T1)"), services=offered, excluded=excluded))


# What is of which type


@pytest.mark.parametrize(
    ("argument", "types", "expected"),
    [
        ("T1", set(), True),
        ("T1", {"Thing"}, True),
        ("C1", {"Thing", "Object"}, True),
        ("T1", {"Thing", "Cup"}, False),
        ("Nobody", {"Object"}, False),
        ("Nobody", set(), True),
        ("R1", {"provider of Put"}, True),
        ("R1", {"provider of Put", "Robot"}, True),
        ("R1", {"provider of Put", "Thing"}, False),
        ("R1", {"provider of Wipe"}, False),
        ("Far", {"provider of Wipe"}, True),
        ("Far", {"provider of Wipe", "Robot"}, False),
        (Number(1.0), {"number"}, True),
        (Number(1.0), {"text"}, False),
        (Text("a"), {"text"}, True),
        (Name("a"), {"text"}, True),
        (Truth(True), {"truth"}, True),
        (Truth(True), {"truth", "number"}, False),
        (Truth(True), {"Thing"}, False),
    ],
)
def test_what_is_of_all_the_types(argument: Argument, types: set[str], expected: bool) -> None:
    assert make_world().has_types(argument, types) is expected
    assert make_world().is_eligible(argument, types) is expected


def test_what_is_excluded_is_of_its_type_and_not_to_be_used() -> None:
    world = make_world(excluded=frozenset({"T1", "R2"}))
    assert world.has_types("T1", {"Thing"})
    assert not world.is_eligible("T1", {"Thing"})
    assert world.providers == {"Put": ("R1",), "Wipe": ("Far",)}
    assert [*world.domain(frozenset({"Thing"}))] == ["T2", "C1"]


@pytest.mark.parametrize(
    ("type_name", "supertype", "expected"),
    [
        ("Cup", "Thing", True),
        ("Thing", "Cup", False),
        ("provider of Put", "provider of Put", True),
        ("provider of Put", "provider of Wipe", False),
        ("Robot", "provider of Put", False),
        ("provider of Put", "Robot", False),
        ("provider of Put", "Object", False),
    ],
)
def test_whether_all_of_one_type_are_of_the_other(type_name: str, supertype: str, expected: bool) -> None:
    assert make_world().is_subtype(type_name, supertype) is expected


def test_those_who_offer_less_offer_what_more_offer() -> None:
    world = make_world(AvailableService(PUT_SERVICE, ("R1", "R2")), AvailableService(WIPE, ("R2",)))
    assert world.is_subtype("provider of Wipe", "provider of Put")
    assert not world.is_subtype("provider of Put", "provider of Wipe")


@pytest.mark.parametrize(
    ("types", "expected"),
    [
        (set(), ["T1", "T2", "C1", "P1", "P2", "P3", "R1", "R2"]),
        ({"Object", "Cup", "Thing"}, ["C1"]),
        ({"Thing"}, ["T1", "T2", "C1"]),
        ({"Cup", "Place"}, []),
        ({"provider of Wipe"}, ["R2", "Far"]),
        ({"Robot", "provider of Wipe"}, ["R2"]),
        ({"provider of Put", "provider of Wipe"}, ["R2"]),
    ],
)
def test_the_objects_of_all_the_types(types: set[str], expected: list[str]) -> None:
    assert sorted(make_world().domain(frozenset(types))) == sorted(expected)


@pytest.mark.parametrize(
    ("name", "path", "expected"),
    [("T1", "Clean", True), ("C1", "Level", True), ("P1", "Clean", False), ("Nobody", "Level", False)],
)
def test_which_attributes_an_object_may_have(name: str, path: str, expected: bool) -> None:
    assert make_world().has_attribute(name, path) is expected


# What holds now


@pytest.mark.parametrize(
    ("fact", "expected"),
    [
        (("on", ("T1", "P1")), True),
        (("on", ("P1", "T1")), False),
        (("on", ("T1", "P2")), False),
        (("near", ("P1", "P2")), True),
        (("near", ("P2", "P1")), True),
        (("near", ("P2", "P3")), False),
        (("on *", ("T1",)), True),
        (("on *", ("P1",)), False),
        ((".Clean", ("T1", Truth(True))), True),
        ((".Clean", ("T1", Truth(False))), False),
        ((".Level", ("T2", Number(1.0, "m"))), True),
        ((".Level", ("P1", Number(1.0, "m"))), False),
        ((".Mode", ("R1", Name("Fast"))), True),
        ((".Label", ("T1", Text("a"))), True),
        ((".Clean", (Truth(True), Truth(True))), False),
    ],
)
def test_what_is_so(fact: Pattern, expected: bool) -> None:
    assert make_world().fact_holds(fact) is expected


@pytest.mark.parametrize(
    ("predicate", "known_arguments", "expected_facts", "count"),
    [
        ("on", (None, None), [("T1", "P1"), ("T2", "P1"), ("C1", "P2")], 3),
        ("on", ("T1", None), [("T1", "P1")], 1),
        ("on", (None, "P1"), [("T1", "P1"), ("T2", "P1")], 2),
        ("on", ("T1", "P1"), [("T1", "P1")], 1),
        ("on", ("T2", "P2"), [("T2", "P1")], 1),
        ("on", (None, "P3"), [], 0),
        ("on *", (None,), [("T1",), ("T2",), ("C1",)], 3),
        ("on *", ("T1",), [("T1",)], 1),
        ("near", (None, None), [("P1", "P2"), ("P1", "P3")], 2),
        ("near", ("P1", None), [("P1", "P3"), ("P1", "P2")], 2),
        ("near", (None, "P1"), [], 2),
        ("near", (None, "P2"), [("P1", "P2")], 1),
        ("near", ("P2", None), [], 1),
        (".Level", ("T1", None), [("T1", Number(2.0, "m"))], 1),
        (".Level", ("P1", None), [], 1),
        (".Level", ("T1", Number(1.0, "m")), [("T1", Number(2.0, "m"))], 1),
        (".Level", (None, Number(2.0, "m")), [("T1", Number(2.0, "m")), ("P2", Number(2.0, "m"))], 2),
        (".Level", (None, Number(1.0, "m")), [("T2", Number(1.0, "m")), ("C1", Number(1.0, "m"))], 2),
        (".Level", (None, Number(3.0, "m")), [], 0),
        (".Level", (None, "T1"), [], 0),
        (".Level", (Number(1.0), None), [], 1),
        (".Mode", (None, Name("Fast")), [("R1", Name("Fast"))], 1),
        (".Clean", (None, None), [("T1", Truth(True)), ("T2", Truth(False))], 8),
        (".Label", (None, Text("a")), [("T1", Text("a"))], 1),
    ],
)
def test_the_facts_that_may_have_the_known_arguments(
    predicate: str, known_arguments: tuple[Argument | None, ...], expected_facts: list[tuple[Argument, ...]], count: int
) -> None:
    world = make_world()
    assert world.find_facts(predicate, known_arguments) == expected_facts
    assert world.find_facts(predicate, known_arguments) is world.find_facts(predicate, known_arguments), "it is kept"
    assert world.count(predicate, known_arguments) == count


def test_facts_of_symmetric_relations_are_written_in_one_way() -> None:
    world = make_world()
    assert world.canonical(("near", ("P2", "P1"))) == ("near", ("P1", "P2"))
    assert world.canonical(("on", ("T1", "P1"))) == ("on", ("T1", "P1"))


# What is settled


@pytest.mark.parametrize(
    ("literal", "bound", "expected"),
    [
        ("marked(?T)", {"T": "T1"}, True),
        ("marked(?T)", {"T": "T2"}, False),
        ("NOT marked(?T)", {"T": "T2"}, True),
        ("marked(?T)", {}, True),
        ("?R.Mode = Fast", {"R": "R1"}, True),
        ("?R.Mode = Fast", {"R": "R2"}, False),
        ("NOT ?Provider.Mode = Fast", {"Provider": "Far"}, True),
        ("?Provider.Mode = Fast", {"Provider": "Far"}, False),
        ("?X = 1 m", {"X": Number(100.0, "cm")}, True),
        ("?X = 1 m", {"X": Number(100.0, "m")}, False),
    ],
)
def test_what_no_service_changes_is_settled(literal: str, bound: Binding, expected: bool) -> None:
    world = make_world()
    for _ in range(2):
        assert world.holds_statically(parse(literal), {**bound, "Other": "T2"}) is expected  # type: ignore[arg-type]


def test_the_ways_in_which_something_is_so_keep_what_was_bound() -> None:
    world = make_world()
    found_bindings = world.find_bindings(parse("?T on ?P"), {"P": "P1", "Other": "R1"})  # type: ignore[arg-type]
    assert [*found_bindings] == [{"P": "P1", "Other": "R1", "T": "T1"}, {"P": "P1", "Other": "R1", "T": "T2"}]
    far = world.find_bindings(parse("NOT ?Provider.Mode = Fast"), {PROVIDER: "Far"})  # type: ignore[arg-type]
    assert [*far] == [{PROVIDER: "Far"}]


@pytest.mark.parametrize(
    ("comparison", "hidden", "bound", "expected"),
    [
        ("?V = 1 m", {"V": 0.5}, {"V": Number(1.4, "m")}, True),
        ("?V = 1 m", {"V": 0.0}, {"V": Number(1.4, "m")}, False),
        ("?V = 1 m", {}, {"V": Number(1.4, "m")}, False),
        ("1 m = ?V", {"V": 0.5}, {"V": Number(1.4, "m")}, True),
        ("?V > 1 m", {"V": 0.0}, {"V": Number(1.4, "m")}, True),
        ("?V > 1 m", {"V": 0.0}, {}, False),
        ("1 m < ?V", {"V": 0.0}, {}, False),
        ("?V = ?T.Level", {"V": 0.0}, {"V": Number(2.0, "m"), "T": "T1"}, True),
        ("?V != ?T.Level", {"V": 0.0}, {"V": Number(2.0, "m"), "T": "T1"}, False),
        ("?V = ?T.Level", {"V": 0.0}, {"V": Number(2.0, "m"), "T": "P1"}, False),
    ],
)
def test_comparisons_with_values_of_attributes(comparison: str, hidden: dict[str, float], bound: Binding, expected: bool) -> None:
    assert make_world().passes(Compared(parse(comparison), hidden), bound) is expected  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("argument", "term"), [("T1", Name("T1")), (Number(1.0, "m"), Number(1.0, "m")), (Text("a"), Text("a")), (Truth(True), Truth(True))]
)
def test_objects_are_names_in_formulas(argument: Argument, term: Name | Number | Text | Truth) -> None:
    assert as_term(argument) == term
    assert as_argument(term) == argument


# What it costs


def priced(cost: str | None, *prices: tuple[str, float]) -> tuple[World, ServiceType]:
    service = ServiceType(name="Put", inputs=PUT_SERVICE.inputs, effect=PUT_SERVICE.effect, cost=cost)
    return make_world(AvailableService(service, ("R1", "R2"), prices), AvailableService(WIPE, ("R1",))), service


@pytest.mark.parametrize(
    ("cost", "prices", "bound", "expected"),
    [
        (None, (), {}, 1.0),
        (None, (), {PROVIDER: "R1"}, 1.0),
        (None, (("R1", 3.0), ("R2", 5.0)), {PROVIDER: "R1"}, 3.0),
        (None, (("R1", 3.0), ("R2", 5.0)), {PROVIDER: "R2"}, 5.0),
        (None, (("R1", 3.0), ("R2", 5.0)), {}, 3.0),
        (None, (("R1", 3.0),), {PROVIDER: "R2"}, 3.0),
        (None, (("R1", 3.0),), {PROVIDER: Truth(True)}, 3.0),
        ("?T.Level", (("R1", 3.0),), {"T": "T1", PROVIDER: "R1"}, 2.0),
        ("?T.Level", (("R1", 3.0),), {"T": "P1", PROVIDER: "R1"}, 3.0),
        ("?T.Level - 5 m", (), {"T": "T1"}, 0.0),
        ("?T.Level - 1.5 m", (), {"T": "T1"}, 0.5),
        ("?T.Label", (("R1", 3.0),), {"T": "T1"}, 3.0),
    ],
)
def test_what_a_use_of_a_service_costs(cost: str | None, prices: tuple[tuple[str, float], ...], bound: Binding, expected: float) -> None:
    world, service = priced(cost, *prices)
    assert world.cost(service, bound) == expected


def test_who_never_asked_is_thought_to_ask_what_services_cost_as_a_rule() -> None:
    world, _ = priced(None, ("R1", 3.0), ("R2", 5.0))
    assert world.cost(WIPE, {}) == 4.0
    assert world.cost(None, {}) == 0.0


@pytest.mark.parametrize(
    ("cost", "prices", "expected"),
    [
        (None, (), False),
        (None, (("R1", 3.0),), False),
        (None, (("R1", 3.0), ("R2", 3.0)), False),
        (None, (("R1", 3.0), ("R2", 4.0)), True),
        ("?T.Level", (), True),
    ],
)
def test_whether_uses_may_cost_more_or_less(cost: str | None, prices: tuple[tuple[str, float], ...], expected: bool) -> None:
    assert priced(cost, *prices)[0].has_varying_costs is expected
