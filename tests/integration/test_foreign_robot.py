"""A robot of another make takes part in traffic: it knows the documents, and nothing of SO-MRS."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

import pytest
import zeep.exceptions

from somrs.deployment.traffic import serve_simulated_traffic
from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, DriveTo
from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.objects import Map, Object
from somrs.runtime.host import Host
from tests.support.foreign_robot import ForeignRobot
from tests.support.hang import HANG_TIME
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import ONTOLOGY, box, robot

LONG_LEASE = 3600.0
"""A lease that does not end, however slow this machine is."""
SPEED = 20.0
"""Simulated seconds per second."""


class Building:
    """A running simulation, and the address of its traffic."""

    def __init__(self, simulation: Simulation, traffic: str, loop: asyncio.AbstractEventLoop) -> None:
        self.simulation, self.traffic, self._loop = simulation, traffic, loop

    def call(self, work: Callable[[Simulation], object]) -> None:
        """Do something with the simulation, in its thread."""

        async def run() -> None:
            work(self.simulation)

        asyncio.run_coroutine_threadsafe(run(), self._loop).result(HANG_TIME)

    def drive(self, name: str, x: float, y: float, z: float | None = None) -> list[CommandDone | CommandGivenUp]:
        """Send a simulated robot somewhere. The list gets the end of the command."""
        ends: list[CommandDone | CommandGivenUp] = []
        self.call(lambda simulation: simulation.command(name, DriveTo(x=x, y=y, z=z), ends.append))
        return ends


def play(map: Map, work: Callable[[Building], None]) -> None:
    """Do the work, in a thread, beside a running simulation of this map with its traffic."""

    async def run() -> None:
        runtime = Host()
        await runtime.start()
        simulation = Simulation(map, ONTOLOGY, WorldKind.KINEMATIC, traffic_address=f"{runtime.url}/traffic")
        server = Server(simulation, speed=SPEED)
        serve_simulated_traffic(simulation, runtime, server.wake)
        await server.start()
        try:
            async with asyncio.timeout(HANG_TIME):
                await asyncio.to_thread(work, Building(simulation, f"{runtime.url}/traffic", asyncio.get_running_loop()))
        finally:
            await server.stop()
            await runtime.stop()

    asyncio.run(run())


def corridor_with_bay() -> list[Object]:
    """A corridor of 1 m by 8 m with a bay in the middle: the only place where two robots pass each other."""
    return [
        box("Floor1", "Floor", (4, 0.5, -0.1), (8.2, 2.4, 0.1)),
        box("South", "Wall", (4, -0.55, 0), (8.2, 0.1, 2.5)),
        box("NorthWest", "Wall", (1.7, 0.55, 0), (3.4, 0.1, 2.5)),
        box("NorthEast", "Wall", (6.3, 0.55, 0), (3.4, 0.1, 2.5)),
        box("BayWest", "Wall", (3.35, 1.1, 0), (0.1, 1.2, 2.5)),
        box("BayEast", "Wall", (4.65, 1.1, 0), (0.1, 1.2, 2.5)),
        box("BayNorth", "Wall", (4, 1.65, 0), (1.4, 0.1, 2.5)),
        box("West", "Wall", (-0.05, 0, 0), (0.1, 1.2, 2.5)),
        box("East", "Wall", (8.05, 0, 0), (0.1, 1.2, 2.5)),
    ]


def test_a_foreign_robot_and_a_simulated_one_pass_each_other_in_a_corridor() -> None:
    def work(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        start, goal = foreigner.nearest(7.4, 0), foreigner.nearest(0.6, 0)
        assert foreigner.enter(start, LONG_LEASE, Edition=foreigner.edition).RenewWithin == LONG_LEASE / 3
        ends = building.drive("Robot1", 7.4, 0.0)
        assert foreigner.request("home", goal).Length > 0
        foreigner.drive_until(lambda: "home" in foreigner.ended and bool(ends))
        assert foreigner.ended["home"] == ("arrived", [])
        assert foreigner.place == goal or goal in foreigner.driven
        assert isinstance(ends[0], CommandDone), ends
        ways = [[start, *foreigner.driven], foreigner.places]
        assert all(end in foreigner.places[start].ends for start, end in zip(ways[0], foreigner.driven, strict=False))
        assert foreigner.service.LeaveTraffic(Robot="Foreigner") == "Foreigner"
        assert [seen.Robot for seen in foreigner.service.ReadTraffic().Robots] == ["Robot1"]
        foreigner.close()

    play(Map([*corridor_with_bay(), robot("Robot1", (0.6, 0, 0))]), work)


def test_a_silent_foreign_robot_keeps_its_place_until_it_is_taken_out() -> None:
    def work(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        foreigner.enter(foreigner.nearest(2.5, 0), 5.0)
        ends = building.drive("Robot1", 7.4, 0.0)
        while not ends:  # it has no trip, so that nobody asks it to make room once its lease has ended
            foreigner.take_message(0.05)
        assert isinstance(ends[0], CommandGivenUp), ends
        assert "Foreigner" in ends[0].description
        (seen,) = (seen for seen in foreigner.service.ReadTraffic().Robots if seen.Robot == "Foreigner")
        assert seen.Silent
        foreigner.service.LeaveTraffic(Robot="Foreigner")
        again = building.drive("Robot1", 7.4, 0.0)
        while not again:
            foreigner.take_message(0.05)
        assert isinstance(again[0], CommandDone), again
        foreigner.close()

    play(Map([*corridor_with_bay(), robot("Robot1", (0.6, 0, 0))]), work)


def test_what_is_wrong_is_refused_with_a_reason() -> None:
    def work(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        place = foreigner.nearest(7.4, 0)
        refused = zeep.exceptions.Fault
        with pytest.raises(refused, match="Foreigner does not take part in traffic: let it enter first"):
            foreigner.report()
        with pytest.raises(refused, match="there is no place Nowhere on the roadmap"):
            foreigner.enter("Nowhere", LONG_LEASE)
        with pytest.raises(refused, match="Robot1 is a robot of the simulator"):
            foreigner.service.LeaveTraffic(Robot="Robot1")
        with pytest.raises(refused, match=r"cannot be at .*: Robot1 holds it"):
            foreigner.enter(foreigner.nearest(0.6, 0), LONG_LEASE)
        with pytest.raises(refused, match="a robot needs an address"):
            foreigner.service.EnterTraffic(Robot="Foreigner", Place=place, Lease=LONG_LEASE)
        with pytest.raises(refused, match="read it again"):
            foreigner.enter(place, LONG_LEASE, Edition=foreigner.edition - 1)
        foreigner.enter(place, LONG_LEASE)
        stale = foreigner.fence
        foreigner.enter(place, LONG_LEASE)
        foreigner.fence, current = stale, foreigner.fence
        with pytest.raises(refused, match=f"Foreigner has entered traffic anew since: {stale} is an earlier fence than {current}"):
            foreigner.report()
        foreigner.fence = current
        foreigner.place = foreigner.nearest(4.0, 0)
        with pytest.raises(refused, match="was not granted its way to"):
            foreigner.report()
        with pytest.raises(refused, match="there is no place Nowhere"):
            foreigner.request("away", "Nowhere")
        foreigner.close()

    play(Map([*corridor_with_bay(), robot("Robot1", (0.6, 0, 0))]), work)


def test_a_foreign_robot_is_told_of_a_new_roadmap_and_others_keep_away_from_it_until_it_enters_anew() -> None:
    def work(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        foreigner.enter(foreigner.nearest(2.5, 0), LONG_LEASE, Edition=foreigner.edition)
        place = foreigner.places[foreigner.place]
        building.call(lambda simulation: simulation.add(box("Shelf9", "Cupboard", (7.7, -0.2, 0), (0.3, 0.5, 0.8))))
        ends = building.drive("Robot1", 6.6, 0.0)
        while not ends:
            foreigner.take_message(0.05)
        assert foreigner.is_replaced
        assert isinstance(ends[0], CommandGivenUp), ends
        with pytest.raises(zeep.exceptions.Fault, match="read it again"):
            foreigner.enter(foreigner.place, LONG_LEASE, Edition=foreigner.edition)
        fence = foreigner.fence
        foreigner.read_roadmap()
        here = foreigner.nearest(place.x, place.y)
        assert math.dist((foreigner.places[here].x, foreigner.places[here].y), (place.x, place.y)) < 0.01
        foreigner.enter(here, LONG_LEASE, Edition=foreigner.edition)
        assert foreigner.fence > fence
        again = building.drive("Robot1", 6.6, 0.0)
        foreigner.drive_until(lambda: bool(again))
        assert isinstance(again[0], CommandDone), again
        foreigner.close()

    play(Map([*corridor_with_bay(), robot("Robot1", (0.6, 0, 0))]), work)


def test_a_foreign_robot_rides_in_a_lift_by_turns_with_a_simulated_one() -> None:
    def work(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        foreigner.enter(foreigner.nearest(6, 3), LONG_LEASE)
        passed: list[tuple[float, bool]] = []

        def check(start: str, end: str) -> None:
            """Note on which floor the cabin is, and whether its doors are open there, when the robot passes them."""
            here, there = foreigner.places[start], foreigner.places[end]
            if (here.zone, here.level) != (there.zone, there.level):

                def look(simulation: Simulation) -> None:
                    (lift,) = simulation.lifts
                    gate = simulation.scene.leaves("Gate1" if there.level == 0.0 else "Gate2")[0]
                    assert abs(lift.solid.z - there.level) < 0.01
                    passed.append((there.level, gate.is_open(simulation.scene.leaf_position(gate))))

                building.call(look)

        foreigner.on_arrival = check
        ends = building.drive("Robot1", 3, 3, HEIGHT)
        foreigner.request("up", foreigner.nearest(5, 4, HEIGHT))
        foreigner.drive_until(lambda: "up" in foreigner.ended and bool(ends))
        assert foreigner.ended["up"] == ("arrived", [])
        assert isinstance(ends[0], CommandDone), ends
        assert passed == [(0.0, True), (HEIGHT, True), (HEIGHT, True)]  # into the lift, up in it, and out of it
        again = building.drive("Robot1", 3, 3, 0.0)
        foreigner.drive_until(lambda: bool(again))
        assert isinstance(again[0], CommandDone), "the lift is free again"
        foreigner.close()

    play(tower((2, 2, 0)), work)


def test_a_foreign_robot_is_not_let_into_a_lift_that_is_out_of_order_and_learns_its_name() -> None:
    def work(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        foreigner.enter(foreigner.nearest(6, 3), LONG_LEASE)
        goal = foreigner.nearest(5, 4, HEIGHT)
        foreigner.request("up", goal)
        building.call(lambda simulation: simulation.close_passages(("Lift1",)))
        foreigner.drive_until(lambda: "up" in foreigner.ended)
        assert foreigner.ended["up"][0] == "closed"
        assert foreigner.places[foreigner.place].level == 0.0
        with pytest.raises(zeep.exceptions.Fault, match="Lift1 is out of order"):
            foreigner.request("again", goal)
        foreigner.close()

    play(tower((2, 2, 0)), work)
