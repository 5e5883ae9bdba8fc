"""Two owners, each with a Repository, a Registry and a Task Manager, whose Repositories and Registries are neighbours."""

from __future__ import annotations

import random
from collections.abc import Mapping
from types import MappingProxyType

import pytest

from somrs.gui.pages.task_story import story
from somrs.ontology.files.loading import load_text
from somrs.ontology.map import Map
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan
from somrs.protocol.messages.event_text import sentence
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.protocol.messages.neighbours import Neighbour
from somrs.protocol.messages.submission import Submit, Submitted, TaskRejected
from somrs.protocol.messages.task_views import TaskView
from somrs.protocol.messages.waits import RepositoryAnswered, WaitsForRepository
from somrs.registry.component import SCHEMA as REGISTRY
from somrs.registry.component import Registry
from somrs.registry.neighbours import Configured
from somrs.registry.neighbours import Neighbour as NeighbouringRegistry
from somrs.registry.selection import Selection
from somrs.repository.component import SCHEMA as REPOSITORY
from somrs.repository.component import Repository
from somrs.repository.neighbouring import NeighboursConfigured
from somrs.repository.state import Contents
from somrs.runtime.virtual_time import Work, World
from somrs.service_manager.participant.participant import SCHEMA as SERVICE_MANAGER
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.sdk.orders import Advance, Capability, Order, Profile, WorkDone
from somrs.task_manager.manager import SCHEMA as TASK_MANAGER
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.transaction.views import event_view, row, view
from tests.support.answer_client import AnswerClient
from tests.support.building import wide_building
from tests.support.neighbour_messages import denied_between
from tests.support.virtual_system import Robot, transfer_effect

OBJECTS = """
  {map}Cupboard: {{type: Cupboard, at: [1, 1, 0], Shape: {{Form: Box, Width: 0.5, Depth: 1, Height: 0.8}}}}
  {map}Platform: {{type: Platform, at: [8, 2, 0], Shape: {{Form: Box, Width: 1, Depth: 1, Height: 0.3}}}}
  Jar1: {{type: Jar, at: [1, 1, 0.8]}}
  {map}Robot: {{type: PioneerP3DX, at: [3, 3]}}
facts:
  - Jar1 isOn {map}Cupboard
"""


class Owner:
    """A system of one owner, at addresses of its own."""

    def __init__(self, world: World, map: str, site: str = "") -> None:
        self.world, self.name = world, map
        loaded = load_text(site or wide_building(map) + OBJECTS.format(map=map), "site.yaml")
        assert loaded.map is not None
        self.repository_address, self.registry_address, self.manager_address = f"{map}/repository", f"{map}/registry", f"{map}/tm"
        contents = Contents(ontology=loaded.ontology, map=loaded.map)
        world.add(self.repository_address, Repository(self.repository_address, contents), journaled=REPOSITORY)
        registry = Registry(self.registry_address, loaded.ontology, self.repository_address)
        world.add(self.registry_address, registry, journaled=REGISTRY)
        manager = TaskManager(self.manager_address, repository=self.repository_address, registry=self.registry_address)
        world.add(self.manager_address, manager, self._plan, journaled=TASK_MANAGER)

    @staticmethod
    def _plan(task: object) -> Work:
        assert isinstance(task, Problem), task
        yield 0.5, plan(task)

    def join(self, robot: Robot, registry_address: str = "") -> None:
        profile = Profile(
            name=robot.name,
            type="PioneerP3DX",
            capabilities=(Capability(type="TransferObject", method="work", stoppable=True),),
            lease=3600,
        )
        manager = ServiceManager(profile, repository=self.repository_address, registry=registry_address or self.registry_address)
        self.world.add(f"{self.name}/devices/{robot.name}", manager, robot.carry_out, journaled=SERVICE_MANAGER)

    @property
    def map(self) -> Map:
        repository = self.world.components[self.repository_address]
        assert isinstance(repository, Repository)
        return repository.contents.map

    @property
    def manager(self) -> TaskManager:
        manager = self.world.components[self.manager_address]
        assert isinstance(manager, TaskManager)
        return manager


class TwoOwners:
    """A barn and a yard that show and let each other change everything."""

    def __init__(
        self,
        *,
        barn_robot: Robot | None = None,
        yard_robot: Robot | None = None,
        sites: Mapping[str, str] = MappingProxyType({}),
        shows: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
    ) -> None:
        self.world = World()
        self.client = AnswerClient(self.world)
        self.barn, self.yard = (Owner(self.world, name, sites.get(name, "")) for name in ("Barn", "Yard"))
        for owner, other in ((self.barn, self.yard), (self.yard, self.barn)):
            shown = shows.get(owner.name)
            neighbour = Neighbour(map=other.name, address=other.repository_address, shows=shown or (), shows_all=shown is None)
            self.world.notify(owner.repository_address, NeighboursConfigured(map=owner.name, neighbours=(neighbour,)))
            registry = NeighbouringRegistry(name=other.name, address=other.registry_address, takes=Selection(), gives=Selection())
            self.world.notify(owner.registry_address, Configured((registry,)))
            self.world.revive(owner.registry_address)
        for owner, robot in ((self.barn, barn_robot), (self.yard, yard_robot)):
            if robot is not None:
                owner.join(robot)
        self.world.run(90.0)

    def submit(self, owner: Owner, effect: str) -> str:
        return self.client.ask(owner.manager_address, Submit(effect=effect), Submitted).task

    def finish(self, owner: Owner, task: str) -> TaskView:
        state = owner.manager.state.tasks[task]
        assert self.world.run(3600, lambda: state.outcome is not None), state.events
        self.world.run(30)
        assert denied_between(self.world.messages) == [], "with certificates, all that passes has to be among their rights"
        return view(state)


def test_a_goal_about_a_neighbour_s_map_is_reached_with_the_neighbour_s_robot() -> None:
    robot = Robot("BarnRobot", price=5, duration=20)
    two = TwoOwners(barn_robot=robot)
    task_view = two.finish(two.yard, two.submit(two.yard, "Barn:Jar1 isOn BarnPlatform"))
    assert task_view.outcome == "accomplished", task_view
    assert two.barn.map.has_fact("isOn", ("Jar1", "BarnPlatform"))
    assert two.yard.map.has_fact("isOn", ("Barn:Jar1", "Barn:BarnPlatform"))
    assert [order.inputs["Object"] for order in robot.orders] == ["Jar1"]


def test_a_neighbour_s_robot_may_publish_at_any_registry_of_its_owner() -> None:
    robot, second_address = Robot("BarnRobot", price=5, duration=20), "Barn/registry-2"
    two = TwoOwners()
    ontology = two.barn.manager.state.replica.ontology
    two.world.add(second_address, Registry(second_address, ontology, two.barn.repository_address), journaled=REGISTRY)
    everything = Selection()
    yard = NeighbouringRegistry(name="Yard", address=two.yard.registry_address, takes=everything, gives=everything)
    barn = NeighbouringRegistry(name="Barn", address=two.barn.registry_address, takes=everything, gives=everything)
    second = NeighbouringRegistry(name="Barn-2", address=second_address, takes=everything, gives=everything, map="Barn")
    two.world.notify(second_address, Configured((yard,)))
    two.world.notify(two.yard.registry_address, Configured((barn, second)))
    for address in (second_address, two.yard.registry_address):
        two.world.revive(address)
    two.barn.join(robot, second_address)
    two.world.run(90.0)
    task_view = two.finish(two.yard, two.submit(two.yard, "Barn:Jar1 isOn BarnPlatform"))
    assert task_view.outcome == "accomplished", task_view.explanation
    assert [order.inputs["Object"] for order in robot.orders] == ["Jar1"], "it is told of things in the names of its map"


def test_a_robot_brings_a_thing_to_the_neighbour_where_it_gets_its_home() -> None:
    robot = Robot("BarnRobot", price=5, duration=20)
    two = TwoOwners(barn_robot=robot)
    task_view = two.finish(two.barn, two.submit(two.barn, "Jar1 isOn YardPlatform"))
    assert task_view.outcome == "accomplished", task_view
    (thing,) = [name for name, place in two.yard.map.facts_with("isOn", 1, "YardPlatform")]
    assert ":" not in thing
    assert two.barn.map.has_fact("isOn", (f"Yard:{thing}", "Yard:YardPlatform"))


def test_opposite_wishes_of_two_owners_for_one_thing_do_not_cross() -> None:
    two = TwoOwners(barn_robot=Robot("BarnRobot", price=5, duration=20), yard_robot=Robot("YardRobot", price=5, duration=20))
    first = two.submit(two.barn, "Jar1 isOn BarnPlatform")
    second = two.submit(two.yard, "Barn:Jar1 isOn YardPlatform")
    outcomes = [two.finish(two.barn, first), two.finish(two.yard, second)]
    assert [outcome.outcome for outcome in outcomes] == ["accomplished", "accomplished"], [outcomes]
    assert sum(name.startswith("Jar") for name, place in two.yard.map.facts_with("isOn", 1, "YardPlatform")) == 1


def test_a_neighbour_s_robot_that_is_not_shown_brings_a_thing() -> None:
    """It also reports where it is, and what it holds, which is not for the map of the task."""

    def carries(order: Order) -> Work:
        thing = order.inputs["Object"]
        yield 5.0, Advance(situation=f"{thing} isHeldBy BarnRobot AND BarnRobot.PositionX = 2", fraction=0.5)
        yield 5.0, Advance(fraction=0.6)
        assert not two.yard.map.facts_with("isOn", 0, "Jar1"), "it is on its way"
        yield 20.0, WorkDone(situation=f"{transfer_effect(order)} AND BarnRobot.PositionX = 7")

    robot = Robot("BarnRobot", price=5, duration=20, works=carries)
    two = TwoOwners(barn_robot=robot, shows={"Barn": ("BarnCupboard",)})
    assert "Barn:BarnRobot" not in two.yard.map.objects
    task_view = two.finish(two.yard, two.submit(two.yard, "Jar1 isOn YardPlatform"))
    assert task_view.outcome == "accomplished", task_view.explanation
    assert [work.service for work in task_view.work] == ["Barn:BarnRobot.TransferObject"]
    assert two.yard.map.has_fact("isOn", ("Jar1", "YardPlatform"))


def test_what_an_own_robot_takes_from_where_the_neighbour_shows_it_stays_on_the_map() -> None:
    two = TwoOwners(shows={"Barn": ("BarnCupboard",)})
    assert "Barn:Jar1" in two.yard.map.objects
    two.client.ask(two.yard.repository_address, UpdateMap(situation="Barn:Jar1 isHeldBy YardRobot"), Updated)
    two.world.run(30)
    assert two.yard.map.has_fact("isHeldBy", ("Barn:Jar1", "YardRobot"))
    two.client.ask(two.yard.repository_address, UpdateMap(situation="Barn:Jar1 isOn YardPlatform"), Updated)
    two.world.run(30)
    (jar,) = [name for name, _ in two.yard.map.facts_with("isOn", 1, "YardPlatform")]
    assert ":" not in jar, "the yard is its home"


def test_who_takes_a_neighbour_s_thing_where_that_does_not_see_it_is_told_what_to_show() -> None:
    two = TwoOwners(shows={"Yard": ("YardCupboard",)})
    answer = two.client.ask(two.yard.repository_address, UpdateMap(situation="Barn:Jar1 isOn YardPlatform"), Rejected)
    (problem,) = answer.problems
    assert "YardPlatform: is not shown to Barn" in problem
    assert "add it to `shows` of Barn" in problem
    assert two.yard.map.has_fact("isOn", ("Barn:Jar1", "Barn:BarnCupboard"))


def test_a_goal_at_a_place_that_the_owner_of_the_thing_does_not_see_is_refused_before_anything_moves() -> None:
    robot = Robot("YardRobot", price=5, duration=20)
    two = TwoOwners(yard_robot=robot, shows={"Yard": ("YardCupboard",)})
    task_view = two.finish(two.yard, two.submit(two.yard, "Barn:Jar1 isOn YardPlatform"))
    assert task_view.outcome == "failed"
    assert "YardPlatform: is not shown to Barn, which has to know that Barn:Jar1 isOn YardPlatform" in task_view.explanation
    assert "add it to `shows` of Barn in the file with the neighbours" in task_view.explanation
    assert not robot.orders
    task_view = two.finish(two.yard, two.submit(two.yard, "Barn:Jar1 isOn YardCupboard"))
    assert task_view.outcome == "accomplished", task_view.explanation


def test_what_a_neighbour_does_not_let_change_is_refused_before_anything_moves() -> None:
    robot = Robot("BarnRobot", price=5, duration=20)
    two = TwoOwners(barn_robot=robot)
    neighbour = Neighbour(map="Yard", address=two.yard.repository_address, shows_all=True, may_change=False)
    two.world.notify(two.barn.repository_address, NeighboursConfigured(map="Barn", neighbours=(neighbour,)))
    two.world.run(90.0)
    task_view = two.finish(two.yard, two.submit(two.yard, "Barn:Jar1 isOn BarnPlatform"))
    assert task_view.outcome == "failed"
    assert "Jar1: is not for Yard to change, as the map Barn has it" in task_view.explanation
    assert not robot.orders


@pytest.mark.parametrize("seed", range(6))
def test_a_task_over_two_maps_outlives_the_death_of_either_repository(seed: int) -> None:
    chance = random.Random(seed)
    two = TwoOwners(barn_robot=Robot("BarnRobot", price=5, duration=20), yard_robot=Robot("YardRobot", price=7, duration=20))
    task = two.submit(two.yard, "Barn:Jar1 isOn YardPlatform AND Jar1 isOn BarnPlatform")
    for _ in range(6):
        address = chance.choice((two.barn, two.yard)).repository_address
        two.world.run(chance.choice((0.5, 3.0, 15.0)))
        two.world.kill(address)
        two.world.run(chance.choice((0.5, 3.0, 40.0)))
        two.world.revive(address)
    task_view = two.finish(two.yard, task)
    assert task_view.outcome == "accomplished", task_view
    assert sum(name.startswith("Jar") for name, place in two.yard.map.facts_with("isOn", 1, "YardPlatform")) == 1
    assert sum(name.startswith("Jar") for name, place in two.barn.map.facts_with("isOn", 1, "BarnPlatform")) == 1
    for owner in (two.barn, two.yard):
        repository = two.world.components[owner.repository_address]
        assert isinstance(repository, Repository)
        assert not repository.contents.reservations.claimants
        assert not repository.contents.shared_reservations


@pytest.mark.parametrize(
    ("shows", "problem"),
    [({}, "there is no object Nothing7 on the map Barn"), ({"Barn": ("BarnCupboard",)}, "there is no object Barn:Nothing7 on the map")],
)
@pytest.mark.parametrize("goal", ["Jar1 isOn Barn:Nothing7", "Barn:Nothing7 isOn YardPlatform"])
def test_a_goal_about_what_a_neighbour_does_not_have_is_refused_at_once(goal: str, shows: dict[str, tuple[str, ...]], problem: str) -> None:
    two = TwoOwners(yard_robot=Robot("YardRobot", price=5, duration=20), shows=shows)
    rejected = two.client.ask(two.yard.manager_address, Submit(effect=goal), TaskRejected)
    assert rejected.problem.splitlines()[0] == problem


def events_of(owner: Owner, task: str, *kinds: type) -> list[str]:
    return [sentence(logged.event) for logged in owner.manager.state.tasks[task].events if isinstance(logged.event, kinds)]


@pytest.mark.parametrize(
    ("absent", "repository", "about"), [("Barn", "the Repository of Barn", " about Barn:Jar1"), ("Yard", "the Repository", "")]
)
def test_a_task_says_that_it_waits_for_a_repository_and_when_that_is_over(absent: str, repository: str, about: str) -> None:
    robot = Robot("YardRobot", price=5, duration=20)
    two = TwoOwners(yard_robot=robot)
    task = two.submit(two.yard, "Barn:Jar1 isOn YardPlatform")
    state = two.yard.manager.state.tasks[task]
    assert two.world.run(600, lambda: bool(robot.orders))
    two.world.cut_off(f"{absent}/repository")
    two.world.run(90.0)
    waiting = f"waiting for an answer{about}: {repository} does not answer"
    assert row(state).reasons == view(state).reasons == (waiting,)
    assert events_of(two.yard, task, WaitsForRepository) == [waiting], "it is said once"
    two.world.reconnect(f"{absent}/repository")
    task_view = two.finish(two.yard, task)
    assert (task_view.outcome, task_view.waiting_for_answer) == ("accomplished", None)
    (answered,) = events_of(two.yard, task, RepositoryAnswered)
    assert answered.startswith(f"continuing: {repository} has answered after ")
    logged_events = tuple(event_view(number, logged) for number, logged in enumerate(state.events, 1))
    texts = [(chapter.title, chapter.text) for chapter in story(task_view, logged_events)]
    assert [text for text in texts if text[0] in ("Waiting", "Continuing")] == [("Waiting", waiting), ("Continuing", answered)]


def test_a_task_says_that_it_waits_for_a_neighbour_before_anything_moves() -> None:
    robot = Robot("YardRobot", price=5, duration=20)
    two = TwoOwners(yard_robot=robot)
    two.world.cut_off("Barn/repository")
    task = two.submit(two.yard, "Barn:Jar1 isOn YardPlatform")
    two.world.run(40.0)
    state = two.yard.manager.state.tasks[task]
    assert view(state).reasons == ("waiting for an answer about Barn:Jar1: the Repository of Barn does not answer",)
    assert not robot.orders
    two.world.reconnect("Barn/repository")
    assert two.finish(two.yard, task).outcome == "accomplished"
    assert len(events_of(two.yard, task, WaitsForRepository, RepositoryAnswered)) == 2


def test_a_task_without_a_device_says_which_neighbour_s_registry_does_not_answer() -> None:
    two = TwoOwners(barn_robot=Robot("BarnRobot", price=5, duration=20))
    two.world.cut_off(two.barn.registry_address)
    two.world.run(100.0)
    task = two.submit(two.yard, "Barn:Jar1 isOn BarnPlatform")
    two.world.run(30.0)
    (reason,) = view(two.yard.manager.state.tasks[task]).reasons
    assert reason.endswith("TransferObject: no device offers it now; the Registry of Barn does not answer")
    two.world.reconnect(two.barn.registry_address)
    assert two.finish(two.yard, task).outcome == "accomplished"
    assert two.yard.manager.state.discovery.directory is not None
    assert two.yard.manager.state.discovery.directory.away == ()
