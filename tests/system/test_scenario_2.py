"""The site of scenario 2: it conforms to its types, and services can achieve its goal."""

from __future__ import annotations

from importlib import resources

from somrs.deployment.devices_of_map import devices
from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, Grip, LookAround, Place, Sense, Stop
from somrs.ontology.files.loaded import LoadedModel
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.objects import ValueSet
from tests.support.simulator_room import Run

THINGS = ("Jar002", "Jar003", "Carton001")


def site() -> tuple[LoadedModel, Map]:
    with resources.as_file(resources.files("somrs.demo") / "data" / "scenario-2.yaml") as file:
        loaded = load([file])
    assert loaded.map is not None
    return loaded, loaded.map


def test_every_device_of_it_has_a_program() -> None:
    loaded, map = site()
    named = dict(devices(map, loaded.ontology))
    assert sorted(named) == ["Camera001", "Patrol1", "Robot1", "Robot2"]
    assert named["Patrol1"].endswith("patrol:PatrolRobot")


def test_one_robot_puts_all_three_things_on_the_platform() -> None:
    run = Run(site()[1])
    for thing in THINGS:
        run.execute_all("Robot1", Grip(object=thing), Place(support="Platform001"))
    assert [run.simulation.observe(thing).support for thing in THINGS] == ["Platform001"] * 3
    assert not run.collisions


def test_two_robots_do_it_at_the_same_time() -> None:
    run = Run(site()[1])
    assignments = {"Robot1": ["Jar002"], "Robot2": ["Carton001", "Jar003"]}
    todo = {
        name: [c for thing in things for c in (Grip(object=thing), Place(support="Platform001"))] for name, things in assignments.items()
    }
    ends: dict[str, list[CommandDone | CommandGivenUp]] = {}
    while any(todo.values()) or not all(ends.values()):
        for name, commands in todo.items():
            if commands and (name not in ends or ends[name]):
                assert not any(isinstance(end, CommandGivenUp) for end in ends.get(name, []))
                ends[name] = run.start(name, commands.pop(0))
        assert run.simulation.time < 400
        run.step()
    assert [run.simulation.observe(thing).support for thing in THINGS] == ["Platform001"] * 3
    assert not run.collisions


def test_the_camera_sees_the_shelf_and_the_patrol_what_is_about_it() -> None:
    run = Run(site()[1])
    camera, patrol = run.execute("Camera001", Sense()), run.execute("Patrol1", LookAround())
    assert isinstance(camera, CommandDone)
    assert isinstance(patrol, CommandDone)
    assert [object_state.object for object_state in camera.object_states] == ["Shelf001"]
    assert "Platform001" in [object_state.object for object_state in patrol.object_states]


def test_a_robot_that_is_parked_where_another_has_to_stand_makes_way() -> None:
    map = site()[1]
    robot_pose = {"PositionX": 0.945, "PositionY": 5.537, "RotationZ": -2.993}
    run = Run(map.changed([ValueSet("Robot1", path, value) for path, value in robot_pose.items()]))
    run.execute_all("Robot2", Grip(object="Jar002"), Place(support="Platform001"))
    assert run.simulation.observe("Jar002").support == "Platform001"
    assert not run.collisions


def test_who_makes_way_for_a_robot_that_is_stopped_meanwhile_goes_on() -> None:
    map = site()[1]
    robot_pose = {"PositionX": 0.945, "PositionY": 5.537, "RotationZ": -2.993}
    run = Run(map.changed([ValueSet("Robot1", path, value) for path, value in robot_pose.items()]))
    parked = run.simulation.robots["Robot1"]
    gripping = run.start("Robot1", Grip(object="Jar002"))
    run.run_until(lambda: parked.arm_out)
    run.execute("Robot1", Stop())
    assert gripping, "it was told that it was stopped"
    run.run_until(lambda: not run.simulation.busy)
    height = parked.joints["lift"]
    run.start("Robot2", Grip(object="Jar002"))
    run.run_until(lambda: abs(parked.joints["lift"] - height) > 0.02)  # it draws its arm in, to make way
    run.execute("Robot2", Stop())
    run.run_until(lambda: not run.simulation.busy)
    run.execute_all("Robot2", Grip(object="Jar002"), Place(support="Platform001"))
    assert not run.collisions
