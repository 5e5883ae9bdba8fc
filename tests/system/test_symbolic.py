"""Symbolic worlds: what is true in them, what they reject, and whole systems whose devices are nothing but their services' effects."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from somrs.cli.import_commands import import_sources
from somrs.client.client import Client
from somrs.deployment.devices_of_map import is_symbolic, of_one_world
from somrs.deployment.system import System
from somrs.devices.symbolic.agent import Faults, Mishap, SymbolicAgent
from somrs.devices.symbolic.lines import Apply, Begin, Estimate, Estimated, Hello, Result, Welcome
from somrs.devices.symbolic.link import ask
from somrs.devices.symbolic.server import WorldServer
from somrs.devices.symbolic.world import SymbolicWorld
from somrs.errors import RemoteError
from somrs.ontology.files.site import dump_site
from somrs.ontology.objects import Change, Fact, FactAdded
from somrs.ontology.truth import formula_holds
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.sdk.orders import Halt, Order, Perform, Quote, Quoted, ServiceFailed, WorkDone
from somrs.sites.pddl import ImportedProblem, read
from tests.support import warm
from tests.support.accomplishing import accomplish
from tests.support.command import somrs
from tests.support.paths import ROOT
from tests.support.pddl_harbour import written
from tests.support.virtual_system import VirtualSystem

PARCELS = ROOT / "examples" / "parcels"


@pytest.fixture
def parcels() -> ImportedProblem:
    return read(PARCELS / "domain.pddl", PARCELS / "problem.pddl")


@pytest.fixture
def world(parcels: ImportedProblem) -> SymbolicWorld:
    return SymbolicWorld(parcels.ontology, parcels.map)


# The world


@pytest.mark.parametrize(
    ("service", "inputs", "provider", "reason"),
    [
        ("load", {"x": "letter", "p": "harbour"}, "van1", "van1 at harbour and letter lies harbour do not hold"),
        ("drive", {"from": "mill", "to": "harbour"}, "van1", "street(van1, mill, harbour) does not hold"),
        ("load", {"x": "letter", "p": "mill"}, "van3", "there is no van3 in this world"),
        ("load", {"x": "letter", "p": "mill"}, "crate", "crate is a parcel, and a van is needed"),
        ("load", {"x": "mill", "p": "letter"}, "van1", "mill is a place, and a parcel is needed"),
        ("load", {"x": "letter"}, "van1", "the input p of load is missing"),
        ("fly", {}, "van1", "there is no service type fly in this world"),
    ],
)
def test_what_cannot_be_done_changes_nothing_and_is_told_why(
    world: SymbolicWorld, service: str, inputs: dict[str, str], provider: str, reason: str
) -> None:
    map_before = world.map
    assert world.perform(service, inputs, provider) == reason
    assert world.map == map_before
    assert not world.actions
    assert reason in world.rejected[0]


def test_what_is_done_holds(world: SymbolicWorld) -> None:
    assert world.perform("load", {"x": "letter", "p": "mill"}, "van1") is None
    assert world.map.has_fact("in", ("letter", "van1"))
    assert not world.map.has_fact("lies", ("letter", "mill"))
    assert [(action.service, action.provider) for action in world.actions] == [("load", "van1")]
    assert world.refusal("load", {"x": "letter", "p": "mill"}, "van1") == "letter lies mill does not hold"


def test_what_fails_on_the_way_leaves_a_part_and_says_which(world: SymbolicWorld) -> None:
    assert world.partly("load", {"x": "letter", "p": "mill"}, "van1") == "letter in van1 AND letter lies mill"
    assert world.map.has_fact("in", ("letter", "van1"))
    assert world.map.has_fact("lies", ("letter", "mill"))
    assert not world.actions[0].whole


def test_what_cannot_even_begin_leaves_nothing(world: SymbolicWorld) -> None:
    assert world.partly("load", {"x": "letter", "p": "harbour"}, "van1") == "NOT letter in van1 AND NOT letter lies harbour"
    assert not world.actions


def test_who_looks_sees_what_holds_and_what_does_no_more(world: SymbolicWorld) -> None:
    world.perform("load", {"x": "letter", "p": "mill"}, "van1")
    assert world.describe_object("letter") == "NOT letter lies mill AND letter in van1 AND letter.Unknown = FALSE"
    assert world.describe_object("market") == "market.Unknown = FALSE"


def test_a_service_costs_what_its_type_says(world: SymbolicWorld) -> None:
    assert world.cost("drive", {"from": "mill", "to": "market"}, "van1") == 4
    assert world.cost("load", {"x": "letter", "p": "mill"}, "van1") == 1


# Devices on virtual time


def system_of(imported: ImportedProblem, faults: Faults) -> tuple[VirtualSystem, SymbolicWorld, dict[str, SymbolicAgent]]:
    system = VirtualSystem(site=dump_site(imported.ontology, imported.map))
    world = SymbolicWorld(imported.ontology, imported.map)
    agents = {name: SymbolicAgent(name=name, world=world, services=services, faults=faults) for name, services in imported.agents.items()}
    for name, agent in agents.items():
        manager = ServiceManager(agent.profile(), repository="repository", registry="registry")
        system.world.add(f"devices/{name}", manager, agent.carry_out)
    system.world.run(5)
    return system, world, agents


def test_a_team_does_an_imported_task(parcels: ImportedProblem) -> None:
    system, world, _ = system_of(parcels, lambda order: None)
    (view,) = system.finish(system.submit(parcels.task))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert formula_holds(parcels.goal, world.map, parcels.ontology)
    assert len(world.actions) == 12
    assert not world.rejected


def test_a_team_recovers_from_works_that_fail_with_a_part_of_their_effect(parcels: ImportedProblem) -> None:
    mishaps = [Mishap(), Mishap(select_changes=lambda changes: changes[:1]), None, None, Mishap(select_changes=lambda changes: changes[:1])]

    def faults(order: Order) -> Mishap | None:
        return mishaps.pop(0) if mishaps else None

    system, world, _ = system_of(parcels, faults)
    (view,) = system.finish(system.submit(parcels.task))
    assert not mishaps
    assert not world.rejected
    assert view.outcome is Outcome.ACCOMPLISHED, view
    assert formula_holds(parcels.goal, world.map, parcels.ontology)


def order(method: str, **inputs: str) -> Order:
    return Order(participant="p", method=method, inputs=inputs, effect="?x in ?Provider")


def test_nothing_is_done_before_its_time_is_over(parcels: ImportedProblem, world: SymbolicWorld) -> None:
    agent = SymbolicAgent(name="van1", world=world, services=parcels.agents["van1"])
    assert [*agent.carry_out(Quote(order("drive", **{"from": "mill", "to": "market"})))] == [(0.0, Quoted(price=4, duration=4))]
    work = agent.carry_out(Perform(order("load", x="letter", p="mill")))
    seconds, _ = next(work)
    assert seconds == 1
    assert not world.actions
    assert [*agent.carry_out(Halt(order("load", x="letter", p="mill")))] == [(0.0, WorkDone(situation="NOT letter in van1"))]
    seconds, report = next(work)
    assert isinstance(report, WorkDone)
    assert len(world.actions) == 1


def test_a_device_says_why_it_cannot_and_what_holds(parcels: ImportedProblem, world: SymbolicWorld) -> None:
    agent = SymbolicAgent(name="van1", world=world, services=parcels.agents["van1"])
    ((_, failed),) = agent.carry_out(Perform(order("load", x="crate", p="mill")))
    assert isinstance(failed, ServiceFailed)
    assert failed.description == "van1 cannot: crate lies mill does not hold"
    assert failed.situation == "van1 at mill AND NOT crate lies mill AND NOT crate in van1"


def test_a_device_that_leaves_is_not_heard_of_again(parcels: ImportedProblem, world: SymbolicWorld) -> None:
    def half(changes: Sequence[Change]) -> Sequence[Change]:
        return [change for change in changes if isinstance(change, FactAdded)]

    mishap = Mishap(select_changes=half, goes_offline=True)
    agent = SymbolicAgent(name="van1", world=world, services=parcels.agents["van1"], faults=lambda order: mishap)
    reports = [*agent.carry_out(Perform(order("load", x="letter", p="mill")))]
    assert not any(isinstance(value, WorkDone | ServiceFailed) for _, value in reports)
    assert agent.is_offline
    assert [*agent.carry_out(Quote(order("load", x="letter", p="mill")))] == []
    assert Fact("in", ("letter", "van1")) in set(world.map.facts())


# Over the network


def test_all_devices_share_the_world_of_one_program(parcels: ImportedProblem, world: SymbolicWorld) -> None:
    async def run() -> None:
        server = WorldServer(world, speed=2)
        await server.start()
        address = f"127.0.0.1:{server.port}"
        welcome = await ask(address, Hello(device="van1"), Welcome)
        assert welcome == Welcome(type="van", services=("drive", "load", "unload"))
        drive = {"from": "mill", "to": "market"}
        assert await ask(address, Estimate(device="van1", service="drive", inputs=drive), Estimated) == Estimated(cost=4, seconds=2)
        assert (await ask(address, Begin(device="van1", service="drive", inputs=drive), Result)).refusal is None
        assert not world.actions
        result = await ask(address, Apply(device="van1", service="drive", inputs=drive), Result)
        assert result == Result(situation="van1 at market AND NOT van1 at mill")
        second_result = await ask(address, Apply(device="van1", service="drive", inputs=drive), Result)
        assert second_result.refusal == "van1 at mill does not hold"
        with pytest.raises(RemoteError, match="there is no van7 in this world"):
            await ask(address, Hello(device="van7"), Welcome)
        with pytest.raises(RemoteError, match="no service type fly"):
            await ask(address, Begin(device="van1", service="fly", inputs={}), Result)
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"what?\n")
        assert b"is not a line of the symbolic world's protocol" in await reader.readline()
        writer.close()
        await server.stop()

    asyncio.run(run())


def test_a_system_has_bodies_or_none() -> None:
    van = ("van1", "somrs.devices.symbolic.device:SymbolicDevice")
    robot = ("Robot1", "somrs.devices.simulator.drivers.manipulator:Manipulator")
    person = ("Anna", "somrs.devices.person.device:Person")
    assert is_symbolic([van, person])
    assert not is_symbolic([robot])
    selection = of_one_world([van, person, robot], symbolic=True)
    assert selection.devices == [van, person]
    (problem,) = selection.problems
    assert problem.startswith("Robot1 is left out: it is a device of the simulator")


@asynccontextmanager
async def running(folder: Path) -> AsyncIterator[tuple[System, Client]]:
    (folder / "run").mkdir()
    files = import_sources([PARCELS / "domain.pddl", PARCELS / "problem.pddl"], folder / "run")
    async with System(files, folder / "run", speed="20", launcher=warm.launcher()) as system, Client(system.addresses) as client:
        yield system, client


def test_a_whole_system_does_an_imported_task_though_its_map_is_wrong(tmp_path: Path, parcels: ImportedProblem) -> None:
    """The map says that a van is where it is not: the world rejects the first step, the map learns the truth, and all is done."""

    async def run() -> None:
        async with running(tmp_path) as (system, client):
            offered = {offer.service for offer in await client.services()}
            assert offered == {f"{van}.{service}" for van in ("van1", "van2") for service in ("drive", "load", "unload")}
            await client.update(UpdateMap(situation="van1 at market AND NOT van1 at mill", author="somebody who is wrong"))
            view = await accomplish(client, parcels.task)
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert "van1 at market does not hold" in (system.data / "logs" / "world.log").read_text()
            assert (await client.query(parcels.task, 1)).rows
            assert system.addresses.simulator is None

    asyncio.run(run())


def test_the_command_writes_a_site_and_says_what_to_do_next(tmp_path: Path) -> None:
    target = tmp_path / "parcels.yaml"
    result = somrs("import", PARCELS / "domain.pddl", PARCELS / "problem.pddl", "-o", target)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines() == [
        f"{target}: 8 objects, 2 devices, 3 service types, no problems. Next: somrs up {target}",
        "and in another terminal: somrs do 'letter lies harbour AND crate lies mill'",
    ]
    assert somrs("check", target).returncode == 0


def test_the_command_names_what_it_cannot_read(tmp_path: Path) -> None:
    domain, problem = written(tmp_path, problem="(define (problem p) (:domain harbour)\n(:init (storms))\n(:goal (storm)))")
    result = somrs("import", domain, problem)
    assert result.returncode == 2
    assert f"{problem}:2: init: there is no predicate storms" in result.stderr
    assert "Traceback" not in result.stderr
    domain_only = somrs("import", domain)
    assert domain_only.returncode == 2
    assert "first the domain, then the problem" in domain_only.stderr
