"""Which services can make a formula true, and with which inputs."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from somrs.entish.formula import Formula, Name, Not, Relation, Term, Variable, conjunction, substitute, variables
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.effects import changes
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.matching import achieving_bindings, can_achieve, types_of, unifiers
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import RelationType
from tests.support import small_ontology
from tests.support.examples import examples

MAP = Map(
    [
        Object(name="Jar1", type="Jar"),
        Object(name="Jar2", type="Jar"),
        Object(name="Table1", type="Table"),
        Object(name="Table2", type="Table"),
        Object(name="Robot1", type="PioneerP3DX"),
        Object(name="Door1", type="Door"),
        Object(name="Spot1", type="Place"),
    ]
)


def service(effect: str, outputs: tuple[Parameter, ...] = (), **inputs: str) -> ServiceType:
    parameters = tuple(Parameter(name=name, type=type_name) for name, type_name in inputs.items())
    return ServiceType(name="Service", effect=effect, inputs=parameters, outputs=outputs)


TRANSFER = service("?Object isOn ?Destination", Object="Graspable", Destination="Object")
PICK = service("?Object isHeldBy ?Provider", Object="Graspable")
MOVE = service("?Provider isAt ?Place", Place="Place")
OPEN = service("?Door.Open = ?Open", Door="Door", Open="truth")
FILL = service("?Object.Weight = 500 g AND ?Object.Color = ?Color", Object="Graspable", Color="text")
WEIGH = service("?Object.Weight = ?w", outputs=(Parameter(name="w", type="number"),), Object="Graspable")
JOIN = service("?A isAdjacentTo ?B", A="Object", B="Object")


@pytest.mark.parametrize(
    ("offered", "goal", "able", "rows"),
    [
        (TRANSFER, "Jar1 isOn Table1", True, [{"Object": "Jar1", "Destination": "Table1"}]),
        (TRANSFER, "Table1 isOn Table2", False, []),  # too heavy for its input's type
        (TRANSFER, "?x: Door isOn Table1", False, []),
        (TRANSFER, "?x isOn Table1", True, [{"Object": "?x: Graspable", "Destination": "Table1"}]),
        (TRANSFER, "?x: Jar isOn Table1", True, [{"Object": "?x: Jar", "Destination": "Table1"}]),
        (TRANSFER, "Jar1 isOn Table1 AND Jar2 isOn Table1", True, []),  # one at a time
        (
            TRANSFER,
            "Jar1 isOn Table1 OR Jar1 isOn Table2",
            True,
            [{"Object": "Jar1", "Destination": "Table1"}, {"Object": "Jar1", "Destination": "Table2"}],
        ),
        (TRANSFER, "Jar1 isHeldBy Robot1", False, []),
        (TRANSFER, "NOT Jar1 isOn Table1", True, []),  # only by a transfer to somewhere else
        (TRANSFER, "NOT Jar1 isHeldBy Robot1", True, [{"Object": "Jar1"}]),
        (TRANSFER, "Jar1 isOn Table2 AND NOT Jar1 isOn Table1", True, [{"Object": "Jar1", "Destination": "Table2"}]),
        (PICK, "Jar1 isHeldBy Robot1", True, [{"Object": "Jar1", "Provider": "Robot1"}]),
        (PICK, "Jar1 isHeldBy Table1", False, []),
        (PICK, "NOT Jar1 isOn Table1", True, [{"Object": "Jar1"}]),
        (MOVE, "Robot1 isAt Spot1", True, [{"Provider": "Robot1", "Place": "Spot1"}]),
        (MOVE, "Robot1 isAt ?where AND Jar1 isHeldBy Robot1", True, []),
        (OPEN, "Door1.Open = TRUE", True, [{"Door": "Door1", "Open": "TRUE"}]),
        (OPEN, "Door1.Open = Red", False, []),
        (OPEN, "NOT Door1.Open = TRUE", True, []),
        (FILL, "Jar1.Weight = 0.5", True, [{"Object": "Jar1"}]),
        (FILL, "0.4 < Jar1.Weight", True, [{"Object": "Jar1"}]),
        (FILL, "Jar1.Weight > 600 g", False, []),
        (FILL, "Jar1.Color = Red AND Jar1.Weight < 1 kg", True, [{"Object": "Jar1", "Color": "Red"}]),
        (FILL, "?j.Color = Red AND ?k.Weight < 1 kg", True, [{"Object": "?j: Graspable", "Color": "Red"}]),
        (WEIGH, "Jar1.Weight = 3 kg", True, []),  # it may turn out so
        (WEIGH, "Jar1.Weight < 3 kg", True, []),
        (WEIGH, "Jar1.Weight = ?weight", True, [{"Object": "Jar1", "w": "?weight: number"}]),
        (JOIN, "Table1 isAdjacentTo Table2", True, [{"A": "Table1", "B": "Table2"}, {"A": "Table2", "B": "Table1"}]),
        (JOIN, "?x isAdjacentTo ?x", True, [{"A": "?x: Object", "B": "?x: Object"}]),
        (JOIN, "NOT Table1 isAdjacentTo Table2", False, []),  # it may be beside many
    ],
)
def test_matches(offered: ServiceType, goal: str, able: bool, rows: list[dict[str, str]]) -> None:
    formula = parse(goal)
    assert can_achieve(offered, formula, upper(), MAP) is able
    found_rows = [{name: str(term) for name, term in row.items()} for row in achieving_bindings(offered, formula, upper(), MAP)]
    assert sorted(found_rows, key=str) == sorted(rows, key=str)


LIGHTEN = service("?Object.Weight = ?Object.Weight - 1 kg", Object="Graspable")
LABEL = service("?Object.Label = ?Words", Object="Graspable", Words="text")
HEAVIER = service("?Object.Weight > 1 kg", Object="Graspable")


@pytest.mark.parametrize(
    ("offered", "goal", "able"),
    [
        (FILL, "0.5 = Jar1.Weight", True),
        (FILL, "0.6 = Jar1.Weight", False),
        (FILL, "0.6 != Jar1.Weight", True),
        (FILL, "0.5 != Jar1.Weight", False),
        (FILL, "0.6 > Jar1.Weight", True),
        (FILL, "0.5 > Jar1.Weight", False),
        (FILL, "0.5 >= Jar1.Weight", True),
        (FILL, "0.4 >= Jar1.Weight", False),
        (FILL, "0.4 < Jar1.Weight", True),
        (FILL, "0.5 < Jar1.Weight", False),
        (FILL, "0.5 <= Jar1.Weight", True),
        (FILL, "0.6 <= Jar1.Weight", False),
        (FILL, "NOT Jar1.Weight = 0.6", True),
        (FILL, "NOT Jar1.Weight = 0.5", False),
        (FILL, "NOT Jar1.Weight != 0.5", True),
        (FILL, "NOT Jar1.Weight != 0.6", False),
        (FILL, "NOT Jar1.Weight < 0.5", True),
        (FILL, "NOT Jar1.Weight < 0.6", False),
        (FILL, "NOT Jar1.Weight <= 0.4", True),
        (FILL, "NOT Jar1.Weight <= 0.5", False),
        (FILL, "NOT Jar1.Weight > 0.5", True),
        (FILL, "NOT Jar1.Weight > 0.4", False),
        (FILL, "NOT Jar1.Weight >= 0.6", True),
        (FILL, "NOT Jar1.Weight >= 0.5", False),
        (FILL, "Jar1.Elevation = 0.5", False),
        (FILL, "Door1.Weight = 0.5", False),
        (FILL, "?x = Jar1", False),
        (HEAVIER, "Jar1.Weight > 1 kg", False),
        (LABEL, 'Jar1.Label = "x"', True),
        (LABEL, "Jar1.Label = Red", True),
        (LABEL, "Jar1.Label = 3", False),
        (LABEL, "Jar1.Label = TRUE", False),
        (WEIGH, "Jar1.Weight = Red", False),
        (OPEN, "Door1.Open = 3", False),
        (LIGHTEN, "Jar1.Weight < 3 kg", True),
    ],
)
def test_an_effect_on_a_value_reaches_a_limit(offered: ServiceType, goal: str, able: bool) -> None:
    assert can_achieve(offered, parse(goal), upper(), MAP) is able


@pytest.mark.parametrize(
    ("offered", "goal", "rows"),
    [
        (LIGHTEN, "Jar1.Weight = Jar1.Weight - 1 kg", [{"Object": "Jar1"}]),
        (LIGHTEN, "Jar1.Weight = Jar2.Weight - 1 kg", []),
        (LIGHTEN, "Jar1.Weight <= Jar1.Weight - 1 kg", []),
        (LIGHTEN, "Jar1.Weight < 3 kg", []),
        (TRANSFER, "?x: Object isOn Table1", [{"Object": "?x: Graspable", "Destination": "Table1"}]),
        (TRANSFER, "Nothing isOn Table1", []),
        (TRANSFER, "Jar1 isOn ?y: Table", [{"Object": "Jar1", "Destination": "?y: Table"}]),
        (TRANSFER, "NOT Jar1 isIn Table1", [{"Object": "Jar1"}]),
        (TRANSFER, "NOT Jar1 isAdjacentTo Table1", []),
        (LABEL, "Jar1.Label = ?w: text", [{"Object": "Jar1", "Words": "?w: text"}]),
        (LABEL, "Jar1.Label = ?w: number", []),
    ],
)
def test_what_is_sure_to_bring_about_all(offered: ServiceType, goal: str, rows: list[dict[str, str]]) -> None:
    found_rows = achieving_bindings(offered, parse(goal), upper(), MAP)
    assert [{name: str(term) for name, term in row.items()} for row in found_rows] == rows


PLACES = small_ontology.ONTOLOGY.extended(
    [
        *(RelationType(name=name, joins=("Object", "Object"), excludes="place") for name in ("hangs", "leans")),
        RelationType(name="fits", joins=("Object", "Object"), excludes="size"),
        RelationType(name="waits", joins=("Object",), functional=True, excludes="place"),
        RelationType(name="lies", joins=("Object", "Object", "Object"), functional=True),
    ]
)


@pytest.mark.parametrize(
    ("effect", "goal", "able", "rows"),
    [
        ("?P hangs ?Q", "NOT A leans B", True, [{"P": "A"}]),
        ("?P hangs C", "NOT A hangs B", False, []),  # it may hang on both
        ("?P foo ?Q", "NOT A isOn B", False, []),
        ("?P isOn ?Q", "NOT A foo B", False, []),
        ("?P isOn ?Q", "NOT A fits B", False, []),
        ("?P isNear ?Q", "NOT isNew(A)", False, []),
        ("?P isOn ?Q", "NOT A isOn B", True, []),  # unless it is put there
        ("?P isOn C", "NOT A isOn B", True, [{"P": "A"}]),
        ("?P isOn B", "NOT A isOn B", False, []),
        ("?P isPairedWith ?Q", "NOT A isPairedWith B", True, []),
        ("?P isPairedWith C", "NOT A isPairedWith B", True, [{"P": "A"}, {"P": "B"}]),
        ("C isPairedWith ?P", "NOT A isPairedWith B", True, [{"P": "A"}, {"P": "B"}]),
        ("waits(?P)", "NOT A isOn B", True, [{"P": "A"}]),
        ("waits(?P)", "NOT waits(A)", False, []),
        ("lies(?P, B, C)", "NOT lies(A, B, D)", True, [{"P": "A"}]),
        ("lies(?P, B, ?Q)", "NOT lies(A, B, C)", True, []),
        ("lies(?P, B, C)", "NOT lies(A, B, C)", False, []),
        ("?P isOn ?Q", "NOT isOn()", False, []),
        ("isOn()", "NOT A isOn B", False, []),
        ("NOT ?P isOn ?Q", "NOT A isOn B", True, [{"P": "A", "Q": "B"}]),
        ("NOT ?P isOn ?Q", "A isOn B", False, []),
        ("?P isOn ?Q", "isOn(A)", False, []),
    ],
)
def test_what_displaces_what(effect: str, goal: str, able: bool, rows: list[dict[str, str]]) -> None:
    offered, goal_formula = service(effect, P="Object", Q="Object"), parse(goal)
    assert can_achieve(offered, goal_formula, PLACES) is able
    assert [{name: str(term) for name, term in row.items()} for row in achieving_bindings(offered, goal_formula, PLACES)] == rows


def test_without_a_map_constants_may_be_anything() -> None:
    assert can_achieve(TRANSFER, parse("Door1 isOn Table1"), upper())
    assert not can_achieve(TRANSFER, parse("?Door: Door isOn Table1"), upper())


def test_variables_of_both_sides_may_have_the_same_name() -> None:
    goal = parse("?Destination isOn ?Object")
    assert isinstance(goal, Relation)
    assert list(unifiers(parse(TRANSFER.effect), goal, upper(), types_of(TRANSFER, upper()))) == [
        {"Object": Variable("Destination", "Graspable"), "Destination": Variable("Object", "Object")}
    ]


# In general: what is sure comes true, and what comes true was found possible

effect_relations = small_ontology.facts.flatmap(
    lambda fact: st.tuples(*(st.sampled_from([Variable("P"), Variable("Q"), Name(name)]) for name in fact.arguments)).map(
        lambda arguments: Relation(fact.relation, arguments)
    )
)
effects = st.lists(effect_relations | st.builds(Not, effect_relations), min_size=1, max_size=2).map(lambda parts: conjunction(*parts))
goal_relations = small_ontology.facts.map(lambda fact: Relation(fact.relation, tuple(Name(name) for name in fact.arguments)))
goals = st.lists(goal_relations | st.builds(Not, goal_relations), min_size=1, max_size=2).map(lambda parts: conjunction(*parts))


PAIRED = Map([Object(name="A", type="Object"), Object(name="B", type="Jar")], [Fact("isPairedWith", ("A", "B"))])


def made_true(effect: Formula, map: Map, inputs: dict[str, Term]) -> Map | None:
    try:
        return map.changed(changes(substitute(effect, inputs), map, small_ontology.ONTOLOGY))
    except FormulaError:
        return None  # this effect contradicts itself


@examples(60)
@given(effects, goals, small_ontology.maps(), st.sampled_from(["Object", "Thing", "Jar"]))
@example(parse("?P isPairedWith ?P"), parse("NOT A isPairedWith B"), PAIRED, "Thing")
def test_matches_agree_with_the_effects_made_true(effect: Formula, goal: Formula, map: Map, type_name: str) -> None:
    offered = service(str(effect), P=type_name, Q="Object")
    fitting = [Name(o.name) for o in map.objects.values() if small_ontology.ONTOLOGY.is_subtype(o.type, type_name)]
    all_names = [Name(name) for name in map.objects]
    assignments: list[dict[str, Term]] = [{"P": p, "Q": q} for p, q in itertools.product(fitting, all_names)]
    for row in achieving_bindings(offered, goal, small_ontology.ONTOLOGY, map):
        for assignment in assignments:
            if all(assignment[name] == term for name, term in row.items()):
                map_after = made_true(effect, map, assignment)
                assert map_after is None or formula_holds(goal, map_after, small_ontology.ONTOLOGY)
    for assignment in assignments:
        map_after = made_true(effect, map, assignment) if variables(effect) else None
        if (
            map_after is not None
            and formula_holds(goal, map_after, small_ontology.ONTOLOGY)
            and not formula_holds(goal, map, small_ontology.ONTOLOGY)
        ):
            assert can_achieve(offered, goal, small_ontology.ONTOLOGY, map)
