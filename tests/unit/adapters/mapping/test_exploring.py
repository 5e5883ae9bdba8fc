"""Exploring with a robot in a simulated room: what stands in its way, and what ends it."""

from __future__ import annotations

import asyncio

import pytest
from msgspec import structs

from somrs.adapters.mapping import exploring
from somrs.adapters.mapping.exploring import explore
from somrs.adapters.mapping.survey import Survey
from somrs.devices.simulator.link.commands import Command, CommandDone, DriveAlong, Fault, RobotState, Stop
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.map import Map
from somrs.sites.occupancy.building import building_of
from somrs.sites.plan import Box
from tests.support.explored_floor import SimulatedDoors
from tests.support.rooms_with_door import DOOR, two_rooms
from tests.support.simulated_link import SimulatedLink
from tests.support.simulator_room import ONTOLOGY, box, robot, shell

CABINET = box("Cabinet", "Cupboard", (4.0, 3.0, 0), (1.0, 3.0, 1.5))


def simulation() -> Simulation:
    """A room with a cabinet in its middle, behind which the robot does not see at first."""
    return Simulation(Map([*shell(), CABINET, robot("Robot1", (1.5, 3.0, 0.0))]), ONTOLOGY, WorldKind.KINEMATIC)


async def ignore(view: CommandDone) -> None:
    """Note nothing."""


def test_it_goes_on_until_all_is_seen() -> None:
    world, survey = simulation(), Survey(0.22)
    asyncio.run(explore(SimulatedLink(world, "Robot1"), survey, ignore))
    assert len(building_of(survey.grid(), survey.furniture()).walls) == 4
    assert [piece.type for piece in survey.pieces] == ["Cupboard"]


def test_it_looks_through_a_gap_in_which_it_does_not_fit() -> None:
    screen = [box("Cupboard1", "Cupboard", (5.0, 1.4, 0), (0.4, 2.8, 1.5)), box("Cupboard2", "Cupboard", (5.0, 4.6, 0), (0.4, 2.8, 1.5))]
    world = Simulation(Map([*shell(), *screen, robot("Robot1", (1.5, 3.0, 0.0))]), ONTOLOGY, WorldKind.KINEMATIC)
    survey = Survey(0.22)
    asyncio.run(explore(SimulatedLink(world, "Robot1"), survey, ignore))
    (east_wall,) = (wall for wall in building_of(survey.grid(), survey.furniture()).walls if wall.x > 8)
    assert east_wall.width > 1.5, "through a gap of 0.4 m, it sees 0.7 m of the wall from where it starts"


class ObstructedLink(SimulatedLink):
    """A link to a robot in whose way something stands on its first drive. The world's clock goes on by a second with each look at it."""

    def __init__(self, simulation: Simulation) -> None:
        super().__init__(simulation, "Robot1")
        self.stops = 0
        self._seconds = 0.0
        self._end: asyncio.Event | None = None

    @property
    def state(self) -> RobotState:
        self._seconds += 1.0
        state = self.simulation.state(self.robot)
        return structs.replace(state, time=state.time + self._seconds, obstructed=self.stops == 0)

    async def command(self, command: Command) -> CommandDone:
        if isinstance(command, Stop) and self._end is not None:
            self.stops += 1
            self._end.set()
        if isinstance(command, DriveAlong) and self.stops == 0:
            self._end = asyncio.Event()
            await self._end.wait()
            raise RobotGaveUp("stopped", "another command", self.state)
        return await super().command(command)


def test_it_looks_somewhere_else_when_something_stays_in_its_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exploring, "POLL", 0.0)
    link, survey = ObstructedLink(simulation()), Survey(0.22)
    asyncio.run(explore(link, survey, ignore))
    assert link.stops == 1
    assert len(building_of(survey.grid(), survey.furniture()).walls) == 4


def test_it_ends_when_the_robot_breaks() -> None:
    world = simulation()

    async def note(view: CommandDone) -> None:
        if abs(view.state.x - 1.5) > 0.5:
            world.fault("Robot1", Fault.DRIVE)

    with pytest.raises(RobotGaveUp) as failure:
        asyncio.run(explore(SimulatedLink(world, "Robot1"), Survey(0.22), note))
    assert failure.value.reason == "drive-dead"


DOORS = {DOOR: Box(4.0, 2.9, 0.1, 1.4)}


def test_a_shut_door_with_a_drive_is_opened_and_closed_again() -> None:
    world, survey = Simulation(two_rooms((1.5, 3.0, 0.0), Open=False), ONTOLOGY, WorldKind.KINEMATIC), Survey(0.22)
    doors = SimulatedDoors(world, DOORS)
    state = asyncio.run(explore(SimulatedLink(world, "Robot1"), survey, ignore, doors=doors))
    assert doors.moves == [f"open {DOOR}", f"close {DOOR}"]
    assert not world.observe(DOOR).open
    building = building_of(survey.grid(), survey.furniture())
    assert len(building.rooms) == 2
    assert [door.rooms for door in building.doors] in ([(0, 1)], [(1, 0)])
    assert state.x > 4, "it has been in the room behind"


def test_it_goes_on_when_a_door_cannot_be_opened() -> None:
    world, survey = Simulation(two_rooms((1.5, 3.0, 0.0), Open=False), ONTOLOGY, WorldKind.KINEMATIC), Survey(0.22)
    doors = SimulatedDoors(world, DOORS, works=False)
    state = asyncio.run(explore(SimulatedLink(world, "Robot1"), survey, ignore, doors=doors))
    assert doors.moves == [f"open {DOOR}"]
    assert state.x < 4
    assert len(building_of(survey.grid(), survey.furniture()).walls) == 4
