"""Plays the paper's scenarios in the simulator with a whole system of separate processes (paper, "Experiments").

Scenario 1: the cheaper of two robots moves a jar from a cupboard to a platform. Scenario 1b: its drive breaks on the way; the robot
puts the jar down and reports its position, and the other robot continues from there. Scenarios 2 to 6 are not in the
paper; `recovery.py`, `cooperation.py`, `hotel.py`, `neighbours.py` and `worlds.py` play them.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import shutil
import time
from dataclasses import dataclass, field
from importlib import resources
from math import hypot, pi
from pathlib import Path

from rich.console import Console

from somrs.adapters.wires import recorded_wires
from somrs.client import terminal
from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.client.trace import Follower, Line, trace_file
from somrs.demo import cooperation as cooperation_demo
from somrs.demo import hotel as hotel_demo
from somrs.demo import neighbours as neighbours_demo
from somrs.demo import pioneers
from somrs.demo import recovery as recovery_demo
from somrs.demo import worlds as worlds_demo
from somrs.demo.results import Results
from somrs.deployment.launcher import Launcher
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.entish import Attribute, Comparison, Name
from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.errors import SimulationError, UsageError
from somrs.ontology.files.loading import load
from somrs.ontology.files.site import dump_site
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, ValueSet
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import Ontology
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView
from somrs.space.free_space import FreeSpace

_SCENARIOS = ("1", "1b", "2", "3", "4", "5", "6")
REQUEST = Submit(effect="Jar002 isOn Platform001", precondition="Jar002 isOn ?Shelf")
CHEAP_ROBOT, _EXPENSIVE_ROBOT, _JAR, _CUPBOARD, _DESTINATION = "Robot1", "Robot2", "Jar002", "Cupboard001", "Platform001"
STEPS = {
    "A": "robot 1 approaches and grips the jar",
    "B": "robot 1 transports the jar",
    "C": "a failure: the drive of robot 1 is out of order",
    "D": "robot 2 approaches the jar and grips it",
    "E": "robot 2 transports the jar",
    "F": "the jar is on the target platform",
}
"""The pictures of the paper's Figure "Moving a jar" scenario, by letter. Without a failure, only A, B and F occur."""

SPEED = "15"
"""Simulated seconds per second."""

UNDER_WAY = 1.2
"""Distance in metres for which a robot has carried the jar when the picture of its transport is taken."""


@dataclass(slots=True)
class _ScenarioResult:
    """The result of a scenario. Times are in seconds."""

    view: TaskView
    lines: list[Line]
    checks: dict[str, bool]
    pictures: list[Path] = field(default_factory=list)
    simulated: float = 0.0
    elapsed: float = 0.0

    @property
    def passed(self) -> bool:
        return all(self.checks.values())


async def play(
    scenario: str,
    folder: Path,
    seed: int | None,
    console: Console | None = None,
    *,
    launcher: Launcher | None = None,
    world: WorldKind = WorldKind.PHYSICS,
    arcos: bool = False,
) -> int:
    """Play a scenario, print its messages, and write its results to `folder`. Return the exit code: 0 if all checks pass.

    `seed`: vary the positions and the time of the failure; None: as in the paper. `world`: what moves robots and things; those of scenarios
    4 and 5 are kinematic. `arcos`: the robots are driven by ARCOS, in real time. Raises UsageError for an unknown scenario.
    """
    if scenario not in _SCENARIOS:
        raise UsageError(f"there is no scenario {scenario}; there are {' and '.join(_SCENARIOS)}")
    if arcos and scenario not in ("1", "1b"):
        raise UsageError(f"--arcos: the robots of scenario {scenario} are not driven by ARCOS alone; those of 1 and 1b can be")
    console = console or terminal.console()
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    if scenario == "5":
        return await neighbours_demo.play(folder, console, launcher)
    if scenario == "6":
        return await worlds_demo.play(folder, seed, console, launcher)
    site, distance = prepare(scenario, folder, seed)
    speed = pioneers.SPEED if arcos else {"2": recovery_demo.SPEED, "4": hotel_demo.SPEED}.get(scenario, SPEED)
    world = WorldKind.KINEMATIC if scenario == "4" else world
    system = System([site], folder / "run", speed=speed, world=world, launcher=launcher, devices_per_process=1, arcos=arcos)
    wires = recorded_wires(folder / "wires") if arcos else contextlib.nullcontext()
    try:
        with wires, console.status("starting the Repository, the Registry, the Task Manager, the simulator and the Service Managers ..."):
            await system.start()
        if scenario == "2":
            return await recovery_demo.perform(system, folder, console)
        if scenario == "3":
            return await cooperation_demo.perform(system, folder, console)
        if scenario == "4":
            return await hotel_demo.perform(system, folder, console)
        results = Results(folder, console, f"Scenario {scenario}: {REQUEST.effect}", STEPS)
        played = await _perform(scenario, system, folder, distance, console, results)
    finally:
        await system.stop()
    if arcos:
        played.checks |= pioneers.wire_checks(folder / "wires", scenario)
    _close(played, scenario, folder, console, results)
    return 0 if played.passed else 1


def prepare(scenario: str, folder: Path, seed: int | None) -> tuple[Path, float]:
    """Write the scenario's site, varied if there is a seed. Return its file, and how many metres the jar is carried before the failure."""
    source = resources.files("somrs.demo") / "data" / f"scenario-{scenario[0]}.yaml"
    with resources.as_file(source) as file:
        loaded = load([file])
    assert loaded.map is not None, "the scenario's site has a map"
    map, distance = loaded.map, 2.5
    if seed is not None:
        map, distance = _vary_scenario(map, loaded.ontology, random.Random(seed))
    site = folder / "map-before.yaml"
    site.write_text(dump_site(loaded.ontology, map), encoding="utf-8")
    return site, distance


def _vary_scenario(map: Map, ontology: Ontology, rng: random.Random) -> tuple[Map, float]:
    """Return a map with random positions of robots and jar, and a random distance in metres before the failure."""
    free_space = FreeSpace(map, ontology)
    changes: list[Change] = []
    placed: list[tuple[float, float]] = []
    for robot in (CHEAP_ROBOT, _EXPENSIVE_ROBOT):
        while True:
            x, y = rng.uniform(0.8, 11.0), rng.uniform(0.8, 7.2)
            if free_space.free((x, y), 0.5) and all(hypot(x - px, y - py) > 1.5 for px, py in placed):
                break
        placed.append((x, y))
        changes += [ValueSet(robot, "PositionX", x), ValueSet(robot, "PositionY", y), ValueSet(robot, "RotationZ", rng.uniform(-pi, pi))]
    cupboard = map.objects[_CUPBOARD].values
    front, middle = float(cupboard["PositionX"]) + float(cupboard["Shape.Width"]) / 2, float(cupboard["PositionY"])
    changes += [
        ValueSet(_JAR, "PositionX", round(front - rng.uniform(0.07, 0.14), 3)),
        ValueSet(_JAR, "PositionY", round(middle + rng.uniform(-0.35, 0.1), 3)),
    ]
    return map.changed(changes), rng.uniform(0.3, 6.0)


async def _perform(scenario: str, system: System, folder: Path, distance: float, console: Console, results: Results) -> _ScenarioResult:
    """Submit the task, and record its messages and pictures until it ends."""
    assert system.addresses.simulator is not None
    trace = Follower(trace_file(system.data))
    lines: list[Line] = []
    async with Client(system.addresses) as client, operator_link(system.addresses) as operator:
        if scenario == "1b":
            await operator.schedule(CHEAP_ROBOT, Fault.DRIVE, carried=distance)
        started, start_time = time.monotonic(), (await operator.clock()).time
        camera = asyncio.create_task(_Photographer(operator, folder, console).watch())
        console.print(f"[bold]Scenario {scenario}[/]: {REQUEST.effect}, from {REQUEST.precondition}")
        task = await client.submit(REQUEST)
        view: TaskView | None = None
        async for news in client.news(task):
            view = news.view
            _print(trace, lines, console)
        elapsed = time.monotonic() - started
        await operator.idle()
        await asyncio.sleep(0.3)  # the last End messages are in transit
        _print(trace, lines, console)
        assert view is not None, "an accepted task has news"
        simulated = (await operator.clock()).time - start_time
        jar_state = await operator.observe(_JAR)
        ontology, map = await client.ontology(), await client.map()
        camera.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await camera
        pictures = results.write_sheet()
        results.write_map(ontology, map)
        results.write_messages(system.data, lines)
        checks = {
            "the task was accomplished": view.outcome is Outcome.ACCOMPLISHED,
            "the goal holds in the Repository": formula_holds(parse(REQUEST.effect), map, ontology),
            "the goal holds in the simulator": jar_state.support == _DESTINATION,
            "the messages are those of the paper": _differences_from_paper(scenario, lines) == [],
        }
    return _ScenarioResult(view, lines, checks, pictures, simulated, elapsed)


def _differences_from_paper(scenario: str, lines: list[Line]) -> list[str]:
    """List the differences between the messages and those of the paper. Progress, which the paper omits, may come at any time."""
    messages = [(line.sender, line.type, line.recipient) for line in lines if line.type != "Progress"]
    manager, first, second = "TaskManager", f"{CHEAP_ROBOT}.TransferObject", f"{_EXPENSIVE_ROBOT}.TransferObject"
    expected: list[set[tuple[str, str, str]]] = [
        {(manager, "Arrange", first), (manager, "Arrange", second)},
        {(first, "Terms", manager), (second, "Terms", manager)},
        {(manager, "Accept", first), (manager, "Cancel", second)},
        {(manager, "Execute", first)},
    ]
    if scenario == "1":
        expected += [{(first, "Completed", manager)}, {(manager, "End", first)}]
    else:
        expected += [
            {(first, "Failed", manager)},
            {(manager, "Arrange", second)},
            {(second, "Terms", manager)},
            {(manager, "Accept", second)},
            {(manager, "Execute", second)},
            {(second, "Completed", manager)},
            {(manager, "End", first), (manager, "End", second)},
        ]
    wrong: list[str] = []
    for expected_messages in expected:
        actual_messages, messages = set(messages[: len(expected_messages)]), messages[len(expected_messages) :]
        if actual_messages != expected_messages:
            wrong.append(f"expected {sorted(expected_messages)}, received {sorted(actual_messages)}")
    if messages:
        wrong.append(f"unexpected at the end: {messages}")
    if scenario == "1b":
        reported_position = next((_position(line.body.get("situation")) for line in lines if line.type == "Failed"), {})
        arranged_position = [_position(line.body.get("precondition")) for line in lines if line.type == "Arrange"][-1]
        if len(reported_position) != 3 or arranged_position != reported_position:
            wrong.append(f"the position of the jar in Failed is {reported_position}, and in the second Arrange {arranged_position}")
    return wrong


def _position(situation: object) -> dict[str, str]:
    """The jar's coordinates in a situation, by attribute."""
    parts = conjuncts(parse(str(situation))) if situation else ()
    return {
        part.left.path: str(part.right)
        for part in parts
        if isinstance(part, Comparison)
        and isinstance(part.left, Attribute)
        and part.left.owner == Name(_JAR)
        and "Position" in part.left.path
    }


def _print(trace: Follower, lines: list[Line], console: Console) -> None:
    for line in trace.new():
        lines.append(line)
        console.print(terminal.passing(line, lines[0].at))


class _Photographer:
    """Takes a picture of each step of the paper's figure when the step occurs.

    The simulator decides when to take those of a robot that carries the jar, so that they do not depend on the load of the machine. The
    others show situations that last.
    """

    def __init__(self, operator: OperatorLink, folder: Path, console: Console) -> None:
        self._operator, self._folder, self._console = operator, folder, console

    async def watch(self) -> None:
        """Take pictures until cancelled. Without OpenGL, print a notice and return."""
        try:
            async with asyncio.TaskGroup() as pictures:
                for robot, gripped, carried in ((CHEAP_ROBOT, "A", "B"), (_EXPENSIVE_ROBOT, "D", "E")):
                    pictures.create_task(self._take_picture(gripped, robot, robot=robot, carried=0.0))
                    pictures.create_task(self._take_picture(carried, robot, robot=robot, carried=UNDER_WAY))
                pictures.create_task(self._watch_lasting())
        except* SimulationError as errors:
            self._console.print(f"[yellow]no pictures: {errors.exceptions[0]}[/]")

    async def _watch_lasting(self) -> None:
        """Take the pictures of the broken robot without the jar, and of the jar at its destination."""
        while not await self._arrived():
            state = (await self._operator.robots())[CHEAP_ROBOT]
            if Fault.DRIVE in state.faults and state.holding is None:
                await self._take_picture("C", CHEAP_ROBOT)
                break
            await asyncio.sleep(0.01)
        while not await self._arrived():
            await asyncio.sleep(0.01)
        await self._take_picture("F", _JAR)

    async def _arrived(self) -> bool:
        return (await self._operator.observe(_JAR)).support == _DESTINATION

    async def _take_picture(self, letter: str, subject: str, *, robot: str | None = None, carried: float | None = None) -> None:
        (self._folder / f"{letter}.png").write_bytes(await self._operator.picture(subject, robot=robot, carried=carried))


def _close(played: _ScenarioResult, scenario: str, folder: Path, console: Console, results: Results) -> None:
    console.print()
    console.print(terminal.steps("Steps", played.view.steps))
    console.print(terminal.outcome(played.view))
    results.show_checks(played.checks)
    results.show_pictures(played.pictures)
    if wrong := _differences_from_paper(scenario, played.lines):
        console.print("\n".join(f"[yellow]differs from the paper: {text}[/]" for text in wrong))
    console.print(f"{played.simulated:.0f} s of simulated time took {played.elapsed:.1f} s. All files are in {folder}/")
