"""Planning problems of others: what is read of PDDL and MA-PDDL, what it means here, and what is refused."""

from __future__ import annotations

import itertools
import random
import re
from pathlib import Path

import pytest

from somrs.devices.symbolic.world import SymbolicWorld
from somrs.entish import Name
from somrs.entish.formula import conjuncts, variables
from somrs.entish.parse import parse
from somrs.errors import ModelError, UsageError
from somrs.ontology.conformance import violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.files.dump import dump_map, dump_ontology
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.services import PROVIDER
from somrs.ontology.truth import formula_holds
from somrs.planner.model.plan import Step
from somrs.sites.pddl import ImportedProblem, classical, read
from tests.support.naive_pddl import Naive, State
from tests.support.paths import SHARED
from tests.support.pddl_harbour import DOMAIN, PROBLEM, written
from tests.support.small_pddl import PROBLEMS

BENCHMARKS = SHARED / "benchmarks" / "codmap"
OF_BENCHMARKS = [
    "depot/pfile1",
    "driverlog/pfile1",
    "elevators08/p01",
    "logistics00/probLOGISTICS-4-0",
    "wireless/p01",
    "zenotravel/pfile3",
]


@pytest.fixture
def harbour(tmp_path: Path) -> ImportedProblem:
    return read(*written(tmp_path))


def steps(imported: ImportedProblem) -> list[Step]:
    """Every use of every service, whether it can be done or not."""
    possible_steps = []
    for available in imported.problem().services:
        service = available.service_type
        domains = [
            [name for kind in imported.ontology.subtypes(parameter.type) for name in imported.map.of_type(kind)]
            for parameter in service.inputs
        ]
        for provider, *inputs in itertools.product(available.providers, *domains):
            bound_inputs = {parameter.name: Name(name) for parameter, name in zip(service.inputs, inputs, strict=True)}
            possible_steps.append(
                Step(id="step", service_type=service.name, inputs={**bound_inputs}, effect=imported.goal, provider=provider)
            )
    return possible_steps


def call_arguments(step: Step) -> tuple[str, dict[str, str], str]:
    assert step.provider is not None
    return step.service_type, {name: str(term) for name, term in step.inputs.items()}, step.provider


def state(imported: ImportedProblem, world: SymbolicWorld, naive: Naive) -> State:
    """The world's facts in PDDL's words; the numbers of one object or none among them."""
    facts = {
        (fact.relation, *(imported.pddl_name(name) for name in fact.arguments if name != "World"))
        for fact in world.map.facts()
        if fact.relation in naive.domain.predicates
    }
    for name, object in world.map.objects.items():
        suffix = f" {imported.pddl_name(name)}" if name != "World" else ""
        facts |= {("=", f"({path}{suffix})", f"{value:.9g}") for path, value in object.values.items() if isinstance(value, float)}
    return frozenset(facts)


def of_interest(truth: State) -> State:
    """Without what is counted up to be kept small, and without tables, which never change."""
    return frozenset(fact for fact in truth if fact[0] != "=" or (fact[1].count(" ") < 2 and fact[1] != "(total-cost)"))


SAMPLE = 60
"""Of what cannot be done, so many a move are asked about, and of what can be done all."""


def compare(imported: ImportedProblem, naive: Naive, moves: int, seed: int) -> set[str]:
    """Walk at random, and compare in each state what can be done and what comes of it. Returns the actions seen."""
    rng = random.Random(seed)
    world = SymbolicWorld(imported.ontology, imported.map)
    truth, grounds = naive.initial, list(naive.actions())
    all_steps = [(imported.pddl_step(step).lower(), step) for step in steps(imported)]
    seen_actions: set[str] = set()
    for _ in range(moves):
        assert state(imported, world, naive) == of_interest(truth)
        assert formula_holds(imported.goal, world.map, imported.ontology) == naive.reached(truth)
        possible = {str(ground): ground for ground in grounds if naive.applicable(ground, truth)}
        useful = {name for name, ground in possible.items() if of_interest(naive.apply(ground, truth)) != of_interest(truth)}
        sampled_names = {name for name, _ in rng.sample(all_steps, min(len(all_steps), SAMPLE))} | possible.keys()
        ours = {name: step for name, step in all_steps if name in sampled_names and world.refusal(*call_arguments(step)) is None}
        assert useful <= ours.keys() <= possible.keys()
        if not useful:
            break
        chosen = rng.choice(sorted(useful))
        seen_actions.add(possible[chosen].action.word.text)
        truth_before, truth = truth, naive.apply(possible[chosen], truth)
        if naive.task.metric is not None:
            assert world.cost(*call_arguments(ours[chosen])) == pytest.approx(naive.cost(possible[chosen], truth_before))
        assert world.perform(*call_arguments(ours[chosen])) is None
    return seen_actions


def test_what_can_be_done_and_what_comes_of_it_is_as_pddl_defines_it(harbour: ImportedProblem, tmp_path: Path) -> None:
    naive = Naive(*written(tmp_path))
    seen_actions = set().union(*(compare(harbour, naive, 40, seed) for seed in range(3)))
    assert seen_actions == set(naive.domain.actions)


@pytest.mark.parametrize("name", PROBLEMS)
def test_other_problems_mean_what_pddl_defines(name: str, tmp_path: Path) -> None:
    files = written(tmp_path, *PROBLEMS[name])
    imported, naive = read(*files), Naive(*files)
    assert not violations(imported.map, imported.ontology)
    seen_actions = set().union(*(compare(imported, naive, 20, seed) for seed in range(2)))
    assert seen_actions == set(naive.domain.actions)


def test_an_effect_that_changes_nothing_where_its_condition_fails_has_none(tmp_path: Path) -> None:
    imported = read(*written(tmp_path, *PROBLEMS["garden"]))
    assert [service.name for service in imported.services if service.name.startswith("flood")] == ["flood"]


def test_facts_that_never_change_decide_about_conditions_of_effects(tmp_path: Path) -> None:
    """With more than six conditional effects, an action becomes a service type for each way from stand to stand, and size of a plane."""
    imported = read(*written(tmp_path, *PROBLEMS["airfield"]))
    services = {service.name: service for service in imported.services if service.name.startswith("taxi")}
    assert len(services) == 2 * (5 + 1), "there are five ways, and one of them is watched, so that it matters whether the airfield is open"
    service = services["taxi-case1-z-is-large-a-is-s3-b-is-s4"]
    assert service.inputs == ()
    effect = {str(part).replace(": plane", "") for part in conjuncts(parse(service.effect))}
    assert effect == {
        "?Provider at s4",
        "s4 blocked ?Provider",
        "wet(s4)",
        "wet(s1)",
        "NOT ?Provider at s3",
        "NOT s2 blocked ?Provider",
        "NOT s3 blocked ?Provider",
    }


LAMPS = """
(define (domain town) (:requirements :adl :multi-agent) (:types lamp worker)
  (:predicates (wired ?a ?b ?c - lamp) (lit ?l - lamp))
  (:action push :agent ?w - worker :parameters (?a ?b - lamp)
    :effect (and (lit ?a) (forall (?l - lamp) (when (wired ?a ?b ?l) (lit ?l))))))
"""


def test_too_many_choices_are_refused(tmp_path: Path) -> None:
    lamps = " ".join(f"lamp{n}" for n in range(32))
    wires = " ".join(f"(wired lamp{n} lamp{n} lamp{n})" for n in range(32))
    problem = f"(define (problem p) (:domain town) (:objects ann - worker {lamps} - lamp) (:init {wires}) (:goal (lit lamp0)))"
    message = "domain.pddl:5: push: its conditional effects depend on more than 1000 choices of objects; make one action for each case"
    assert message in read_error(tmp_path, LAMPS, problem)


@pytest.mark.skipif(not BENCHMARKS.is_dir(), reason=f"there are no published problems in {BENCHMARKS}")
@pytest.mark.parametrize("name", OF_BENCHMARKS)
def test_benchmarks_mean_what_pddl_defines(name: str) -> None:
    files = BENCHMARKS / name / "domain.pddl", BENCHMARKS / name / "problem.pddl"
    assert compare(read(*files), Naive(*files), 3, seed=1)


def test_the_ontology_and_the_map_are_in_order_and_survive_being_written(harbour: ImportedProblem) -> None:
    assert not ontology_violations(harbour.ontology)
    assert not violations(harbour.map, harbour.ontology)
    text = dump_ontology(harbour.ontology, base=upper()) + dump_map(harbour.map, harbour.ontology)
    reloaded = load_text(text)
    assert reloaded.map == harbour.map
    assert [*reloaded.ontology] == [*harbour.ontology]


def test_agents_are_devices_and_offer_what_their_types_do(harbour: ImportedProblem) -> None:
    offered = {agent: sorted(service.name for service in services) for agent, services in harbour.agents.items()}
    assert set(offered) == {"boat1", "boat2", "crane1", "crane2"}
    assert offered["boat1"] == ["Sail", "pump", "pump-other-is-Provider", "refill", "signal"]
    assert "lift" in offered["crane1"]
    assert "Sail" not in offered["crane1"]
    for agent in harbour.agents:
        assert harbour.ontology.is_subtype(harbour.map.objects[agent].type, "Device")
    assert not harbour.ontology.is_subtype(harbour.map.objects["crate1"].type, "Device")


def test_the_task_is_the_goal_in_words_of_the_map(harbour: ImportedProblem) -> None:
    assert harbour.task == "crate1 at South AND NOT barrel1 at South AND marked(boat1)"


def test_the_agent_is_the_provider_in_every_formula(harbour: ImportedProblem) -> None:
    for service in harbour.services:
        spoken = {**variables(parse(service.effect)), **(variables(parse(service.precondition)) if service.precondition else {})}
        assert PROVIDER in spoken, service


def test_a_plan_is_written_as_pddl_with_the_agent_first(harbour: ImportedProblem) -> None:
    step = Step(id="s", service_type="Sail", inputs={"from": Name("North"), "to": Name("South")}, effect=harbour.goal, provider="boat1")
    assert harbour.pddl_plan([step, step]) == "(Sail boat1 north south)\n" * 2
    assert harbour.cost(step) == 12 + 2 * 4
    assert harbour.price("Sail", {"from": "South", "to": "North"}, "boat1") == 7.5 + 2 * 4


def test_names_that_entish_cannot_say_are_changed_and_known_again(tmp_path: Path) -> None:
    domain = """(define (domain d) (:requirements :strips) (:predicates (isOn ?a ?b) (TRUE ?a) (go_-- ?a) (World))
      (:action NOT :parameters (?Provider ?2nd) :precondition (and (true ?Provider) (go_-- ?2nd))
       :effect (and (isOn ?Provider ?2nd) (World))))"""
    problem = """(define (problem p) (:domain d) (:objects AND 7up World a--b) (:init (true and) (go_-- 7up) (go_-- a--b))
      (:goal (and (ison and 7up) (ison and a--b) (world))))"""
    files = written(tmp_path, domain, problem)
    imported = read(*files)
    assert not ontology_violations(imported.ontology)
    assert not violations(imported.map, imported.ontology)
    assert "isOn_" in imported.ontology.relations
    assert {imported.pddl_name(name) for name in imported.map.objects if imported.map.objects[name].type == "object"} == {
        "and", "7up", "world", "a--b"
    }  # fmt: skip
    world = SymbolicWorld(imported.ontology, imported.map)
    possible = [step for step in steps(imported) if world.refusal(*call_arguments(step)) is None]
    assert {imported.pddl_step(step) for step in possible} == {"(NOT and 7up)", "(NOT and a--b)"}
    for step in possible:
        assert world.perform(*call_arguments(step)) is None
    assert formula_holds(imported.goal, world.map, imported.ontology)


def test_a_variable_needs_no_space_before_it(harbour: ImportedProblem, tmp_path: Path) -> None:
    domain, problem = written(tmp_path)
    domain.write_text(DOMAIN.replace(" ?", "?"))
    assert dump_ontology(read(domain, problem).ontology) == dump_ontology(harbour.ontology)


def test_without_agents_one_device_offers_everything(tmp_path: Path) -> None:
    domain = """(define (domain blocks) (:requirements :strips) (:predicates (on ?a ?b) (clear ?a) (table ?a) (free))
      (:action take :parameters (?a) :precondition (and (clear ?a) (table ?a) (free)) :effect (and (not (table ?a)) (not (free)))))"""
    problem = "(define (problem p) (:domain blocks) (:objects a b) (:init (clear a) (table a) (free)) (:goal (not (free))))"
    imported = read(*written(tmp_path, domain, problem))
    assert {agent: [service.name for service in services] for agent, services in imported.agents.items()} == {"Agent1": ["take"]}
    assert not violations(imported.map, imported.ontology)
    assert imported.task == "NOT free(World)"
    step = Step(id="s", service_type="take", inputs={"a": Name("a")}, effect=imported.goal)
    assert imported.pddl_step(step) == "(take a)"


MIXED = """(define (domain mixed) (:requirements :typing :multi-agent) (:types {types})
  (:predicates (at ?x ?y - object) (on ?x - object) (done))
  (:action move :agent ?a - {agent} :parameters (?x - {moved} ?y - object)
    :precondition (and (on ?a) (not (at ?x ?y))) :effect (and (at ?x ?y) (not (on ?a)) (on ?x)))
  (:action ring :agent ?a - {rings} :parameters () :precondition (not (done)) :effect (done)))"""
OF_MIXED = """(define (problem p) (:domain mixed) (:objects {objects}) (:init (on a) (on v)) (:goal (and (at a a) (done))))"""


@pytest.mark.parametrize(
    ("types", "agent", "moved", "rings", "objects"),
    [
        ("van box - thing", "van", "thing", "van", "a v - van b - box"),
        ("van box - thing", "van", "object", "van", "a v - van b - box c"),
        ("van box - thing", "object", "thing", "van", "a v - van b - box"),
        ("van box - thing", "thing", "box", "van", "a v - van b - box t - thing"),
        ("van tram - vehicle box", "van", "vehicle", "tram", "a - tram v - van b - box"),
        ("van tram - vehicle box", "(either van tram)", "(either tram box)", "(either van box)", "a - tram v - van b - box"),
        ("van tram - vehicle vehicle box - thing", "tram", "vehicle", "tram", "a - tram v - vehicle b - box c - van"),
        ("van - van2 van2 - van3", "van2", "van3", "van", "a - van v - van2 c - van3"),
        ("van", "van", "van", "object", "a v c"),
    ],
)
def test_whatever_the_types_the_same_can_be_done(tmp_path: Path, types: str, agent: str, moved: str, rings: str, objects: str) -> None:
    domain = MIXED.format(types=types, agent=agent, moved=moved, rings=rings)
    files = written(tmp_path, domain, OF_MIXED.format(objects=objects))
    imported, naive = read(*files), Naive(*files)
    assert not ontology_violations(imported.ontology)
    assert not violations(imported.map, imported.ontology)
    for seed in range(4):
        compare(imported, naive, 8, seed)
    for agent_name in imported.agents:
        assert imported.ontology.is_subtype(imported.map.objects[agent_name].type, "Device")


def test_an_agent_may_be_a_constant_of_its_own_action(tmp_path: Path) -> None:
    domain = """(define (domain chiefs) (:requirements :typing :multi-agent) (:types van)
      (:constants chief - van) (:predicates (on ?v - van))
      (:action call :agent ?a - van :parameters () :effect (and (on chief) (not (on ?a)))))"""
    problem = "(define (problem p) (:domain chiefs) (:objects v - van) (:init (on v)) (:goal (and (on chief) (not (on v)))))"
    files = written(tmp_path, domain, problem)
    imported, naive = read(*files), Naive(*files)
    assert not ontology_violations(imported.ontology)
    for seed in range(4):
        compare(imported, naive, 3, seed)


def test_objects_of_mixed_types_are_picked_out_by_a_relation(harbour: ImportedProblem) -> None:
    """`signal` is of boats, which act, and boxes, which do not: no type of the ontology is both and nothing else."""
    signal = harbour.ontology.services["signal"]
    assert [parameter.type for parameter in signal.inputs] == ["PhysicalObject"]
    picked = {fact.arguments[0] for fact in harbour.map.facts("is-locatable")}
    assert picked == {"boat1", "boat2", "crate1", "barrel1"}


def test_numbers_of_one_object_are_attributes_and_of_several_tables(tmp_path: Path) -> None:
    domain = """(define (domain trucks) (:requirements :typing :numeric-fluents) (:types truck place)
      (:predicates (at ?t - truck ?p - place))
      (:functions (fuel ?t - truck) (tank ?t - truck) (need ?a ?b - place) (price))
      (:action go :parameters (?t - truck ?a ?b - place)
        :precondition (and (at ?t ?a) (>= (fuel ?t) (need ?a ?b)))
        :effect (and (not (at ?t ?a)) (at ?t ?b) (assign (fuel ?t) 1)))
      (:action fill :parameters (?t - truck) :precondition (not (= (fuel ?t) (tank ?t)))
        :effect (and (assign (fuel ?t) (tank ?t)) (assign (price) 7))))"""
    problem = """(define (problem p) (:domain trucks) (:objects t1 - truck here there - place)
      (:init (at t1 here) (= (fuel t1) 2) (= (tank t1) 9) (= (need here there) 5) (= (price) 3))
      (:goal (and (at t1 there) (> (price) 6))))"""
    imported = read(*written(tmp_path, domain, problem))
    assert not violations(imported.map, imported.ontology)
    assert imported.task == "t1 at there AND World.price > 6"
    world = SymbolicWorld(imported.ontology, imported.map)
    go_inputs = {"t": "t1", "a": "here", "b": "there"}
    assert world.perform("go", go_inputs, "Agent1") == "t1.fuel >= need(here, there) does not hold"
    assert world.perform("fill", {"t": "t1"}, "Agent1") is None
    assert world.refusal("fill", {"t": "t1"}, "Agent1") == "t1.fuel != t1.tank does not hold"
    assert world.perform("go", go_inputs, "Agent1") is None
    assert world.map.objects["t1"].values["fuel"] == 1
    assert formula_holds(imported.goal, world.map, imported.ontology)


def test_as_ordinary_pddl_the_agent_is_a_parameter_and_nothing_is_private(tmp_path: Path) -> None:
    domain, problem = classical(*written(tmp_path))
    for word in (":agent", ":private", ":multi-agent", ":unfactored-privacy"):
        assert word not in domain + problem
    assert "(?b - boat ?from ?to - quay)" in domain
    folder = tmp_path / "again"
    folder.mkdir()
    classical_import = read(*written(folder, domain, problem))
    actions = {str(action.word) for action in Naive(*written(tmp_path)).domain.actions.values()}
    assert {re.sub("-[a-z]+-is-.*", "", service.name) for service in classical_import.services} == actions
    assert list(classical_import.agents) == ["Agent1"]


def test_as_ordinary_pddl_the_parameters_of_a_predicate_have_different_names(tmp_path: Path) -> None:
    domain, _ = classical(*written(tmp_path, DOMAIN.replace("(:predicates", "(:predicates (near ?q ?q - quay)")))
    assert "(near ?q ?q-2 - quay)" in domain


def test_a_type_that_is_said_of_nothing_is_left_out(tmp_path: Path) -> None:
    domain = tmp_path / "domain.pddl"
    problem = tmp_path / "problem.pddl"
    domain.write_text("(define (domain d) (:requirements :strips :typing) (:types part board) (:predicates (cut ?p - part)))")
    problem.write_text("(define (problem p) (:domain d) (:objects - board p0 p1 - part - board) (:init (cut p0)) (:goal (cut p0)))")
    assert "(:objects p0 p1 - part)" in classical(domain, problem)[1]


def test_unified_planning_accepts_what_the_world_did(tmp_path: Path) -> None:
    """An independent reader and validator, on a random walk to the goal; they know no `either`, and nothing that is changed twice."""
    unified_planning = pytest.importorskip("unified_planning.io")
    from unified_planning.engines import SequentialPlanValidator, ValidationResultStatus

    readable_domain = DOMAIN.replace("(either crane boat)", "boat").replace("(increase (total-cost) 1) (increase (total-cost) 2)", "")
    readable_domain = readable_domain.replace("(>= (fuel ?b) 3)", "(and (not (= ?b ?other)) (>= (fuel ?b) 3))")
    readable_domain = readable_domain.replace("(holds ?c ?b) (idle ?d)", "(holds ?c ?b) (not (= ?b ?other)) (idle ?d)")
    files = written(tmp_path, readable_domain)
    harbour = read(*files)
    domain, problem = classical(*files)
    rng = random.Random(3)
    world = SymbolicWorld(harbour.ontology, harbour.map)
    plan: list[Step] = []
    choices = steps(harbour)
    while not formula_holds(harbour.goal, world.map, harbour.ontology):
        rng.shuffle(choices)
        plan.append(next(step for step in choices if world.refusal(*call_arguments(step)) is None))
        assert world.perform(*call_arguments(plan[-1])) is None
    folder = tmp_path / "classical"
    folder.mkdir()
    files = written(folder, domain, problem)
    (folder / "plan").write_text(harbour.pddl_plan(plan))
    reader = unified_planning.PDDLReader()
    parsed_problem = reader.parse_problem(*map(str, files))
    validator = SequentialPlanValidator()
    validator.skip_checks = True
    assert (
        validator.validate(parsed_problem, reader.parse_plan(parsed_problem, str(folder / "plan"))).status is ValidationResultStatus.VALID
    )


def read_error(tmp_path: Path, domain: str, problem: str = PROBLEM) -> str:
    with pytest.raises(ModelError) as raised:
        read(*written(tmp_path, domain, problem))
    return str(raised.value).replace(f"{tmp_path}/", "")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("(not (storm))", "(forall (?x - box) (on ?x ?from))", "domain.pddl:17: Sail: there is no predicate on"),
        ("(at ?b ?to)", "(oneof (at ?b ?to) (storm))", "domain.pddl:18: Sail: oneof in an effect is not supported"),
        ("(at ?b ?to)", "(when (storm))", "domain.pddl:18: Sail: when takes two groups"),
        (
            "(at ?b ?to)",
            "(and " + " ".join(f"(when (at {box} ?from) (not (at {box} ?to)))" for box in 7 * ["?b"]) + ")",
            "domain.pddl:18: Sail: 7 conditional effects are too many",
        ),
        ("(holds ?c ?b) (not (at", "(held ?c ?b) (not (at", "domain.pddl:33: lift: there is no predicate held"),
        ("(at ?b ?q) (idle ?c)", "(at ?b) (idle ?c)", "domain.pddl:32: lift: at takes 2 arguments, not 1"),
        ("(at ?b ?q) (idle ?c)", "(at ?q ?b) (idle ?c)", "domain.pddl:32: lift: ?q cannot be a locatable, which is expected here"),
        ("(at ?b ?q) (idle ?c)", "(at ?z ?q) (idle ?c)", "domain.pddl:32: lift: ?z is not known; declare it as a parameter of the action"),
        ("(at ?x - locatable", "(at ?x - locatabel", "domain.pddl:9: ?x: there is no type locatabel"),
        ("(:action lift", "(:durative-action lift", "domain.pddl:29: :durative-action: actions with durations are not supported"),
        ("(decrease (fuel ?b)", "(decrease (miles ?from ?to)", "domain.pddl:19: Sail: a function of several objects that actions change"),
        ("(/ (miles ?from ?to) 2)", "(/ 2 (miles ?from ?to))", "domain.pddl:19: Sail: division is supported only by a number other than 0"),
        ("(/ (miles ?from ?to) 2)", "(/ (miles ?from ?to))", "domain.pddl:19: Sail: / takes two numbers"),
        ("(:action lift", "(:action Sail", "domain.pddl:29: Sail: there is an action of this name already"),
        ("(:constants North - quay)", "(:constants North - quay", "domain.pddl:3: file: the ( in this line is never closed"),
    ],
)  # fmt: skip
def test_mistakes_and_what_is_not_read_are_named_with_their_lines(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in DOMAIN
    assert message in read_error(tmp_path, DOMAIN.replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("(at boat1 north)", "(at boat1 nort)", "problem.pddl:5: init: nort is not known; declare it among the objects"),
        ("(at boat1 north)", "(at 5 (at boat1 north))", "problem.pddl:5: init: timed initial facts are not supported"),
        ("minimize (total-cost)", "maximize (total-cost)", "problem.pddl:9: metric: a metric maximize (total-cost) is not supported"),
        ("crate1 - crate", "crate1 - crat", "problem.pddl:3: crate1: the domain has no type crat"),
        ("(:goal", "(:aim", "problem.pddl:2: problem: there is no goal"),
    ],
)
def test_mistakes_in_problems_are_named_with_their_lines(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in PROBLEM
    assert message in read_error(tmp_path, DOMAIN, PROBLEM.replace(old, new, 1))


def test_all_mistakes_are_told_at_once(tmp_path: Path) -> None:
    message = read_error(
        tmp_path, DOMAIN.replace("(idle ?c))\n    :effect", "(idel ?c))\n    :effect").replace("(not (storm))", "(not (strom))")
    )
    assert "idel" in message
    assert "strom" in message


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    domain, _ = written(tmp_path)
    with pytest.raises(UsageError, match=r"none\.pddl cannot be read"):
        read(domain, tmp_path / "none.pddl")
