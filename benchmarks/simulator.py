"""Measures the speed of simulated time beside the bare physics of the same world.

Run it as `python benchmarks/simulator.py [office.building.yaml]`.
"""

from __future__ import annotations

import asyncio
import statistics
import sys
import time
from importlib import resources
from pathlib import Path

from somrs.devices.simulator.link.commands import Command, CommandDone, CommandGivenUp, DriveTo, Grip, Place
from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.physics import PhysicsScene
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.sites.openrmf import import_building

OFFICE = Path(__file__).parents[2] / "shared" / "sites" / "office.building.yaml"
ROUNDS = 3
Jobs = dict[str, tuple[Command, ...]]

CARRY: Jobs = {
    "Robot1": (Grip(object="Jar002"), Place(support="Platform001")),
    "Robot2": (DriveTo(x=2.0, y=6.9), DriveTo(x=10.6, y=4.0)),
}
DELIVER: Jobs = {
    "tinyRobot1": (DriveTo(x=19.0, y=-6.2), DriveTo(x=10.4, y=-5.5)),
    "tinyRobot2": (DriveTo(x=7.0, y=-5.2), DriveTo(x=20.4, y=-5.3)),
}


def work(simulation: Simulation, jobs: Jobs) -> None:
    """Step the simulation until the robots have done their jobs."""
    open_jobs = {robot: list(commands) for robot, commands in jobs.items()}

    def run_next(robot: str, end: CommandDone | CommandGivenUp | None = None) -> None:
        if isinstance(end, CommandGivenUp):
            raise SystemExit(f"{robot} gave up: {end.description}")
        if open_jobs[robot]:
            simulation.command(robot, open_jobs[robot].pop(0), lambda end: run_next(robot, end))

    for robot in jobs:
        run_next(robot)
    while simulation.busy:
        simulation.step()


def pace(title: str, map: Map, ontology: Ontology, jobs: Jobs) -> None:
    """Print the simulated seconds per second of wall-clock time."""
    setup_times, whole, bare = [], [], []
    simulated = 0.0
    for _ in range(ROUNDS):
        started = time.perf_counter()
        simulation = Simulation(map, ontology)
        setup_times.append(time.perf_counter() - started)
        work(simulation, jobs)
        whole.append(time.perf_counter() - started - setup_times[-1])
        simulated = simulation.time
        scene = PhysicsScene(map, ontology)
        started = time.perf_counter()
        scene.step(round(simulated / scene.period))
        bare.append(time.perf_counter() - started)
    rates = [simulated / statistics.median(times) for times in (bare, whole)]
    print(
        f"\n{title}: {len(map.objects)} objects, {simulated:.0f} s of simulated time; "
        f"the world is made in {statistics.median(setup_times):.2f} s"
    )
    print(f"  {'bare physics':46} {rates[0]:6.0f} times real time")
    print(f"  {'robots at work':46} {rates[1]:6.0f} times real time, {rates[0] / rates[1]:.2f} times the cost of the bare physics")


def scenario() -> tuple[Map, Ontology]:
    with resources.as_file(resources.files("somrs.demo") / "data" / "scenario-1.yaml") as file:
        loaded = load([file])
    assert loaded.map is not None, "the scenario's site has a map"
    return loaded.map, loaded.ontology


def rest(map: Map, ontology: Ontology) -> None:
    """Print the CPU share of a simulator in which nothing moves."""

    async def measure_cpu() -> float:
        server = Server(Simulation(map, ontology), speed=None)
        await server.start()
        await asyncio.sleep(0.2)
        cpu_before = time.process_time()
        await asyncio.sleep(2)
        spent = time.process_time() - cpu_before
        await server.stop()
        return spent / 2

    print(f"  {'nothing moves':46} {asyncio.run(measure_cpu()):6.1%} of a core")


def main() -> None:
    map, ontology = scenario()
    pace("Scenario 1", map, ontology, CARRY)
    rest(map, ontology)
    office = Path(sys.argv[1]) if len(sys.argv) > 1 else OFFICE
    if office.exists():
        site = import_building(office)
        pace("the office of Open-RMF's demos", site.map, site.ontology, DELIVER)
    else:
        print(f"\nno office: there is no {office}; give the path of Open-RMF's office.building.yaml")


if __name__ == "__main__":
    main()
