"""Which robots are near: whoever claims something near a robot is found, as by asking all of them."""

from __future__ import annotations

import random

from somrs.devices.simulator.link.commands import DriveTo, Grip, Open
from somrs.devices.simulator.motion.robot import Robot
from somrs.devices.simulator.motion.traffic import Capsule
from somrs.ontology.map import Map
from tests.support.simulator_room import Run, box, robot, thing

DISTANCE = 0.6
TABLE = Capsule((3.0, 5.4), (3.0, 5.4), 0.7)


def test_whoever_claims_something_near_a_robot_is_found() -> None:
    chance = random.Random(3)
    robots = [robot(f"Robot{n}", (1.0 + 1.2 * (n % 5), 1.0 + 1.2 * (n // 5), chance.uniform(-3, 3))) for n in range(15)]
    upstairs = robot("Robot15", (3.0, 3.0, 0.0), PositionZ=3.0)
    things = [thing("Jar1", "Jar", 3.0, 5.2, 0.74), box("Table1", "Table", (3.0, 5.4, 0), (2.0, 0.8, 0.74))]
    cupboard = box("Cupboard1", "Cupboard", (5.5, 5.6, 0), (0.5, 1.2, 0.8), RotationZ=-1.57)
    floors = [box("Floor1", "Floor", (4, 4, -0.1), (9, 9, 0.1)), box("Floor2", "Floor", (4, 4, 2.9), (9, 9, 0.1))]
    run = Run(Map([*floors, *robots, upstairs, *things, cupboard]))
    fleet = run.simulation.robots
    run.start("Robot11", Grip(object="Jar1"))
    run.start("Robot13", Open(object="Cupboard1"))
    for n in (0, 3, 5, 9, 12, 15):
        run.start(f"Robot{n}", DriveTo(x=chance.uniform(1, 6), y=chance.uniform(1, 4)))
    pairs, table_count, swept = 0, 0, False
    for period in range(1500):
        run.step()
        if period % 10:
            continue
        fleet.locate()
        swept = swept or bool(fleet.sweeps)
        for asking_robot in fleet.values():
            claimants = [robot for robot in asking_robot.other_robots() if _claims_near(robot, asking_robot)]
            assert {robot.name for robot in claimants} <= {
                robot.name for robot in fleet.near(asking_robot, asking_robot.size.radius + DISTANCE)
            }
            pairs += len(claimants)
            at_table = [robot for robot in asking_robot.other_robots() if any(TABLE.gap(claim) < 0 for claim in robot.claims())]
            assert {robot.name for robot in at_table} <= {robot.name for robot in fleet.near(asking_robot, TABLE.radius, TABLE.start)}
            table_count += len(at_table)
    assert pairs > 100
    assert table_count > 100
    assert swept
    assert not run.collisions


def _claims_near(claimant: Robot, robot: Robot) -> bool:
    return any(robot.base_claim(speed=0.0).gap(claim) < DISTANCE for claim in claimant.claims())
