"""A room of 8 by 6 m for the simulator's tests: a cupboard with a jar, a table, a platform and two robots; and a class to run it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from somrs.devices.simulator.link.commands import Command, CommandDone, CommandGivenUp
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology, Value

ONTOLOGY: Ontology = upper()
Start = tuple[float, float, float]


def box(name: str, type: str, position: tuple[float, float, float], size: tuple[float, float, float], **values: Value) -> Object:
    """Return a box of the given width, depth and height."""
    place: dict[str, Value] = {"PositionX": position[0], "PositionY": position[1], "PositionZ": position[2], "Shape.Form": "Box"}
    extent: dict[str, Value] = {"Shape.Width": size[0], "Shape.Depth": size[1], "Shape.Height": size[2]}
    return Object(name=name, type=type, values={**place, **extent, **values})


def thing(name: str, type: str, x: float, y: float, z: float, **values: Value) -> Object:
    return Object(name=name, type=type, values={"PositionX": x, "PositionY": y, "PositionZ": z, **values})


def robot(name: str, start: Start, speed: float = 0.8, type: str = "PioneerP3DX", **values: Value) -> Object:
    pose: dict[str, Value] = {"PositionX": start[0], "PositionY": start[1], "RotationZ": start[2]}
    return Object(name=name, type=type, values={**pose, "Speed": speed, **values})


def shell() -> list[Object]:
    """Return the empty room's objects."""
    return [
        box("Floor1", "Floor", (4, 3, -0.1), (8.2, 6.2, 0.1)),
        box("WallS", "Wall", (4, -0.05, 0), (8.2, 0.1, 2.5)),
        box("WallN", "Wall", (4, 6.05, 0), (8.2, 0.1, 2.5)),
        box("WallW", "Wall", (-0.05, 3, 0), (0.1, 6, 2.5)),
        box("WallE", "Wall", (8.05, 3, 0), (0.1, 6, 2.5)),
    ]


def room(first_start: Start = (1.5, 1.5, 0.0), second_start: Start = (6.5, 4.5, math.pi), extra_objects: Iterable[Object] = ()) -> Map:
    furniture = [
        box("Cupboard001", "Cupboard", (0.3, 4, 0), (0.5, 1.2, 0.8)),
        box("Table001", "Table", (4, 5.2, 0), (1.4, 0.8, 0.74)),
        box("Platform001", "Platform", (6.5, 1.5, 0), (0.8, 0.8, 0.3)),
        thing("Jar002", "Jar", 0.43, 3.9, 0.8),
    ]
    return Map([*shell(), *furniture, robot("Robot1", first_start, 0.6), robot("Robot2", second_start, 0.9), *extra_objects])


class Run:
    """A simulation that records forbidden collisions."""

    def __init__(self, map: Map, world: WorldKind = WorldKind.PHYSICS, ontology: Ontology = ONTOLOGY) -> None:
        self.simulation = Simulation(map, ontology, world)
        self.collisions: set[tuple[str, str]] = set()

    @classmethod
    def of(cls, simulation: Simulation) -> Run:
        """Run a simulation that there is."""
        run = cls.__new__(cls)
        run.simulation, run.collisions = simulation, set()
        return run

    def step(self) -> None:
        self.simulation.step()
        things = set(self.simulation.scene.things())
        self.collisions |= {pair for pair in self.simulation.scene.robot_contacts() if not things & set(pair)}

    def run_for(self, seconds: float) -> None:
        """Run for so many seconds of simulated time."""
        end_time = self.simulation.time + seconds - 1e-6
        while self.simulation.time < end_time:
            self.step()

    def start(self, robot: str, command: Command) -> list[CommandDone | CommandGivenUp]:
        """Start a command. The returned list gets its result when the command ends."""
        ends: list[CommandDone | CommandGivenUp] = []
        self.simulation.command(robot, command, ends.append)
        return ends

    def run_until(self, condition: Callable[[], object], limit: float = 120.0) -> None:
        start_time = self.simulation.time
        while not condition():
            assert self.simulation.time - start_time < limit, f"the condition does not hold after {limit} s of simulated time"
            self.step()

    def execute(self, robot: str, command: Command) -> CommandDone | CommandGivenUp:
        ends = self.start(robot, command)
        self.run_until(lambda: ends)
        return ends[0]

    def execute_all(self, robot: str, *commands: Command) -> None:
        """Execute the commands one after the other; each has to succeed."""
        for command in commands:
            end = self.execute(robot, command)
            assert isinstance(end, CommandDone), f"{robot} {command}: {end}"
