"""Random small problems: every plan is valid in every order that it allows, and a plain search through maps agrees."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice, product

from hypothesis import event, given, note
from hypothesis import strategies as st

from somrs.entish import Formula, Name, Relation, Term, Truth
from somrs.entish.formula import conjunction, conjuncts, substitute, variables, with_types
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.effects import changes
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import PROVIDER, Parameter, ServiceType
from somrs.ontology.truth import bindings, formula_holds
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.plan import NoPlan, Plan, linearisations
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.validation import apply_step, validate
from somrs.planner.planning import plan
from tests.support.examples import examples

ONTOLOGY = Ontology(
    [
        AttributeType(name="Clean", kind=Kind.TRUTH),
        AttributeType(name="Level", kind=Kind.NUMBER, unit="m"),
        AttributeType(name="Mode", kind=Kind.ENUMERATION, values=("Slow", "Fast")),
        AttributeType(name="Weight", kind=Kind.NUMBER, unit="kg"),
        RelationType(name="on", joins=("Thing", "Place"), functional=True, excludes="place"),
        RelationType(name="heldBy", joins=("Thing", "Robot"), functional=True, excludes="place"),
        RelationType(name="at", joins=("Robot", "Place"), functional=True),
        RelationType(name="near", joins=("Place", "Place"), symmetric=True),
        RelationType(name="marked", joins=("Thing",)),
        RelationType(name="tiedTo", joins=("Thing", "Place"), excludes="bond"),
        RelationType(name="gluedTo", joins=("Thing", "Place"), functional=True, excludes="bond"),
        ObjectType(name="Object", parent=None, attributes=("Clean", "Level", "Mode", "Weight")),
        ObjectType(name="Thing", parent="Object", defaults={"Level": 1.0}),
        ObjectType(name="Place", parent="Object"),
        ObjectType(name="Robot", parent="Object"),
    ]
)
OBJECTS = {"T1": "Thing", "T2": "Thing", "P1": "Place", "P2": "Place", "P3": "Place", "R1": "Robot"}
CONDITIONS = [
    "?T on ?P",
    "?T on ?Q",
    "?Provider at ?P",
    "?Provider at ?Q",
    "?Q near ?P",
    "?T heldBy ?Provider",
    "?T heldBy ?W",
    "marked(?T)",
    "NOT marked(?T)",
    "NOT ?T on ?P",
    "NOT ?X on ?P",
    "NOT ?T heldBy ?Provider",
    "NOT ?T tiedTo ?Y",
    "?T tiedTo ?P",
    "?T gluedTo ?P",
    "?T.Clean = TRUE",
    "?T.Clean != TRUE",
    "NOT ?T.Clean = TRUE",
    "?T.Level >= 2 m",
    "?T.Level = ?P.Level",
    "?T.Weight <= ?Provider.Weight",
    "?Provider.Mode = Fast",
    "?T.Level < ?Provider.Level",
    "NOT ?Q near ?P",
    "(marked(?T) OR ?T.Clean = TRUE)",
]
EFFECTS = [
    "?T on ?P",
    "?T heldBy ?Provider",
    "?Provider at ?P",
    "marked(?T)",
    "NOT marked(?T)",
    "NOT ?T on ?P",
    "NOT ?T heldBy ?Provider",
    "?T tiedTo ?P",
    "?T gluedTo ?P",
    "NOT ?T tiedTo ?P",
    "?T.Clean = TRUE",
    "?T.Clean = FALSE",
    "?T.Clean = ?V",
    "?T.Level = 200 cm",
    "?T.Level = ?P.Level",
    "?Provider.Mode = Fast",
    "?Provider.Mode = Slow",
    "?Provider.Level = ?T.Level",
    "P1 near ?P",
    "NOT ?P near P2",
]
INPUTS = (Parameter(name="T", type="Thing"), Parameter(name="P", type="Place"), Parameter(name="V", type="truth"))
FACTS = st.one_of(
    st.builds(
        Fact, st.sampled_from(["on", "tiedTo", "gluedTo"]), st.tuples(st.sampled_from(["T1", "T2"]), st.sampled_from(["P1", "P2", "P3"]))
    ),
    st.builds(Fact, st.just("at"), st.tuples(st.just("R1"), st.sampled_from(["P1", "P2", "P3"]))),
    st.builds(Fact, st.just("heldBy"), st.tuples(st.sampled_from(["T1", "T2"]), st.just("R1"))),
    st.builds(Fact, st.just("near"), st.sampled_from([("P1", "P2"), ("P2", "P3"), ("P1", "P3")])),
    st.builds(Fact, st.just("marked"), st.tuples(st.sampled_from(["T1", "T2"]))),
)
CONTRADICTIONS = [{"?T on ?P", "?T heldBy ?Provider"}, {"?T tiedTo ?P", "?T gluedTo ?P"}]
"""Effects that contradict each other."""
STATES = 60
"""The plain search gives up after so many maps."""


@st.composite
def service_types(draw: st.DrawFn, name: str) -> ServiceType:
    conditions = draw(st.lists(st.sampled_from(CONDITIONS), max_size=2, unique=True))
    effects = draw(st.lists(st.sampled_from(EFFECTS), min_size=1, max_size=2, unique=True).filter(lambda e: set(e) not in CONTRADICTIONS))
    inputs = tuple(p for p in INPUTS if any(f"?{p.name}" in text for text in (*conditions, *effects)))
    return ServiceType(name=name, inputs=inputs, precondition=" AND ".join(conditions) or None, effect=" AND ".join(effects))


@st.composite
def maps(draw: st.DrawFn) -> Map:
    """Maps that obey the functional relations and exclusive groups."""
    map = Map(Object(name=name, type=type_name, values=_values(draw)) for name, type_name in OBJECTS.items())
    for fact in draw(st.lists(FACTS, max_size=8, unique=True)):
        map = map.changed(changes(parse(str(fact)), map, ONTOLOGY))
    return map


def _values(draw: st.DrawFn) -> dict[str, float | str | bool]:
    values: dict[str, float | str | bool] = {}
    if (clean := draw(st.sampled_from([None, True, False]))) is not None:
        values["Clean"] = clean
    if (level := draw(st.sampled_from([None, 1.0, 2.0]))) is not None:
        values["Level"] = level
    if (weight := draw(st.sampled_from([None, 1.0, 2.0]))) is not None:
        values["Weight"] = weight
    return values


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    """Problems with a goal of any kind, or with one taken from a map that some services lead to."""
    services = tuple(AvailableService(draw(service_types(f"S{n}")), ("R1",)) for n in range(draw(st.integers(1, 4))))
    problem = Problem(ontology=ONTOLOGY, map=draw(maps()), goal=parse("marked(T1)"), services=services)
    goal = draw(_wishes()) if draw(st.integers(0, 2)) == 0 else draw(_outcomes(problem))
    return Problem(ontology=ONTOLOGY, map=problem.map, goal=goal, services=services)


@st.composite
def _wishes(draw: st.DrawFn) -> Formula:
    parts = draw(st.lists(st.sampled_from([c for c in CONDITIONS if "Provider" not in c]), min_size=1, max_size=2, unique=True))
    goal = parse(" AND ".join(parts))
    for name, choices in {"T": ["T1", "T2"], "P": ["P1", "P2", "P3"]}.items():
        if draw(st.booleans()) or name == "P":
            goal = substitute(goal, {name: Name(draw(st.sampled_from(choices)))})
    return with_types(goal, {"T": "Thing", "Q": "Place", "W": "Robot", "X": "Thing", "Y": "Place"})


@st.composite
def _outcomes(draw: st.DrawFn, problem: Problem) -> Formula:
    later_map = problem.map
    for _ in range(draw(st.integers(2, 5))):
        choices = list(islice(successors(problem, later_map), 12))
        if choices:
            later_map = draw(st.sampled_from(choices))
    new = [str(fact) for fact in later_map.facts() if not problem.map.has_fact(fact.relation, fact.arguments)]
    new += [f"NOT {fact}" for fact in problem.map.facts() if not later_map.has_fact(fact.relation, fact.arguments)]
    for object in later_map.objects.values():
        for path, value in object.values.items():
            if problem.map.objects[object.name].values.get(path) != value:
                new.append(f"{object.name}.{path} = {str(value).upper() if isinstance(value, bool) else value}")
    if not new:
        return draw(_wishes())
    return conjunction(*map(parse, draw(st.lists(st.sampled_from(new), min_size=1, max_size=4, unique=True))))


def successors(problem: Problem, map: Map) -> Iterator[Map]:
    """The maps after one service, whichever, with whatever inputs."""
    for available in problem.services:
        service = available.service_type
        domains: list[list[Term]] = [
            [Truth(True), Truth(False)] if p.type == "truth" else [Name(n) for n, t in OBJECTS.items() if t == p.type]
            for p in service.inputs
        ]
        for values in product(*domains):
            substitution = {PROVIDER: Name("R1"), **{p.name: value for p, value in zip(service.inputs, values, strict=True)}}
            for row in _ways(service, substitution, map):
                effect = substitute(parse(service.effect), row)
                if any(isinstance(part, Relation) and len(set(part.arguments)) < len(part.arguments) for part in conjuncts(effect)):
                    continue  # nothing is put on itself
                try:
                    yield map.changed(changes(effect, map, ONTOLOGY))
                except FormulaError:
                    continue  # an effect that contradicts itself, or a value that is not there


def _ways(service: ServiceType, substitution: dict[str, Term], map: Map) -> Iterator[dict[str, Term]]:
    if service.precondition is None:
        return iter([substitution])
    precondition = parse(service.precondition)
    rows = bindings(precondition, map, ONTOLOGY, {name: term for name, term in substitution.items() if name in variables(precondition)})
    return ({**substitution, **row} for row in rows)


def reachable(problem: Problem) -> bool | None:
    """Whether a plain breadth-first search through maps finds the goal; None when it gave up."""
    waiting, seen_maps = [problem.map], [problem.map]
    while waiting:
        map = waiting.pop(0)
        if formula_holds(problem.goal, map, ONTOLOGY):
            return True
        for new in successors(problem, map):
            if new not in seen_maps:
                if len(seen_maps) >= STATES:
                    return None
                seen_maps.append(new)
                waiting.append(new)
    return False


def described(problem: Problem) -> str:
    services = [
        f"{available.service_type.name}: {available.service_type.precondition} -> {available.service_type.effect}"
        for available in problem.services
    ]
    facts = [*map(str, problem.map.facts())]
    return "\n".join([*services, "; ".join(facts), str({o.name: o.values for o in problem.map.objects.values()}), f"goal: {problem.goal}"])


@examples(50)
@given(problems())
def test_plans_are_valid_and_a_plain_search_agrees(problem: Problem) -> None:
    note(described(problem))
    result = plan(problem)
    expected = reachable(problem)
    event(f"plan: {len(result.steps) if isinstance(result, Plan) else 'none'}, expected: {expected}")
    if isinstance(result, NoPlan):
        assert expected is not True, f"{result}\n{described(problem)}"
        assert result.explanation
        return
    assert expected is not False
    assert validate(result, problem) == []
    for order in islice(linearisations(result), 50):
        map = problem.map
        for step in order:
            assert step.precondition is None or formula_holds(step.precondition, map, ONTOLOGY), (str(result), [s.id for s in order])
            map = apply_step(step, map, problem)
        assert formula_holds(problem.goal, map, ONTOLOGY), (str(result), [s.id for s in order])
