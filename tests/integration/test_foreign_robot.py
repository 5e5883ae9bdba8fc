"""A robot of another make takes part in traffic: it knows the documents, and nothing of SO-MRS."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import time
import urllib.error
import urllib.request
from collections.abc import AsyncIterator, Callable, Coroutine
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import zeep.exceptions

from somrs.api.traffic import view_of
from somrs.api.traffic_reader import TrafficReader
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.deployment.traffic import add_traffic
from somrs.deployment.traffic_entrance import FOREIGN_FILE, serve_simulated_traffic
from somrs.deployment.traffic_worker import TrafficWorker
from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, DriveTo
from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object, ObjectAdded, ValueSet
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.soap.soap import ENV, MEDIA_TYPE, TRAFFIC, WSA
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.host import Host
from somrs.storage.journal import Journal
from somrs.traffic.component import SCHEMA
from tests.support.foreign_robot import ForeignRobot
from tests.support.hang import HANG_TIME
from tests.support.rooms_with_door import two_rooms
from tests.support.simulated_tower import CABIN, HEIGHT, storey, tower
from tests.support.simulator_room import ONTOLOGY, box, robot, thing

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


def play(map: Map, data: Path, work: Callable[[Building], None]) -> None:
    """Do the work, in a thread, beside a running simulation of this map with its traffic."""

    async def run() -> None:
        runtime = Host()
        await runtime.start()
        simulation = Simulation(map, ONTOLOGY, WorldKind.KINEMATIC, traffic_address=f"{runtime.url}/traffic")
        server = Server(simulation, speed=SPEED)
        serve_simulated_traffic(simulation, runtime, server.wake, data / FOREIGN_FILE)
        await server.start()
        try:
            async with asyncio.timeout(HANG_TIME):
                await asyncio.to_thread(work, Building(simulation, f"{runtime.url}/traffic", asyncio.get_running_loop()))
        finally:
            await server.stop()
            await runtime.stop()

    asyncio.run(run())


@contextlib.asynccontextmanager
async def program(repository: str, data: Path, port: int = 0) -> AsyncIterator[str]:
    """The program of traffic in a building that is not simulated, and its address."""
    journal = Journal(data / "traffic.sqlite", SCHEMA)
    runtime = Host(port=port)
    await runtime.start()
    try:
        with TrafficWorker() as worker:
            yield add_traffic(runtime, journal, worker, repository).address
            await runtime.stop()
    finally:
        journal.close()


def in_building(map: Map, data: Path, work: Callable[[Client, str], Coroutine[object, object, None]]) -> None:
    """Do the work beside a Repository with this map, and the program of traffic."""

    async def run() -> None:
        runtime = Host()
        await runtime.start()
        repository = runtime.add("/repository", lambda address: Repository(address, Contents(ontology=ONTOLOGY, map=map)))
        try:
            addresses = Addresses(repository=repository.address, registry="", task_manager="")
            async with asyncio.timeout(HANG_TIME), program(repository.address, data) as traffic, Client(addresses) as client:
                await work(client, traffic)
        finally:
            await runtime.stop()

    asyncio.run(run())


def read_roadmap(foreigner: ForeignRobot) -> None:
    """Wait until the roadmap is laid out."""
    edition = foreigner.edition
    while foreigner.edition == edition or not foreigner.places:
        foreigner.read_roadmap()
        foreigner.take_message(0.02)


def real(name: str, x: float, y: float) -> Object:
    """A robot without a driver of the simulator."""
    return robot(name, (x, y, 0.0), type="MobileRobot")


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


def test_a_foreign_robot_and_a_simulated_one_pass_each_other_in_a_corridor(tmp_path: Path) -> None:
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

    play(Map([*corridor_with_bay(), robot("Robot1", (0.6, 0, 0))]), tmp_path, work)


def test_an_automatic_door_is_open_while_a_foreign_robot_is_to_drive_through_it_or_is_in_it(tmp_path: Path) -> None:
    def work(building: Building) -> None:
        def is_open() -> bool:
            seen: list[bool] = []
            building.call(lambda simulation: seen.append(simulation.observe("Door1").open is True))
            return seen[0]

        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        foreigner.enter(foreigner.nearest(2.9, 2.9), LONG_LEASE)
        assert not is_open()
        foreigner.request("through", foreigner.nearest(6.5, 2.9))
        foreigner.wait_until(is_open)
        foreigner.drive_until(lambda: "through" in foreigner.ended)
        assert foreigner.ended["through"] == ("arrived", [])
        foreigner.wait_until(lambda: not is_open())
        foreigner.enter(foreigner.nearest(4.0, 2.9), LONG_LEASE)
        foreigner.wait_until(is_open)
        foreigner.service.LeaveTraffic(Robot="Foreigner")
        foreigner.wait_until(lambda: not is_open())
        foreigner.close()

    play(two_rooms((1.0, 5.0, 0.0)), tmp_path, work)


def test_a_silent_foreign_robot_keeps_its_place_until_it_is_taken_out(tmp_path: Path) -> None:
    def work(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        foreigner.enter(foreigner.nearest(2.5, 0), 5.0)
        ends = building.drive("Robot1", 7.4, 0.0)
        foreigner.wait_until(lambda: bool(ends))
        assert isinstance(ends[0], CommandGivenUp), ends
        assert "Foreigner" in ends[0].description
        (seen,) = (seen for seen in foreigner.service.ReadTraffic().Robots if seen.Robot == "Foreigner")
        assert seen.Silent
        foreigner.service.LeaveTraffic(Robot="Foreigner")
        again = building.drive("Robot1", 7.4, 0.0)
        foreigner.wait_until(lambda: bool(again))
        assert isinstance(again[0], CommandDone), again
        foreigner.close()

    play(Map([*corridor_with_bay(), robot("Robot1", (0.6, 0, 0))]), tmp_path, work)


def test_what_is_wrong_is_refused_with_a_reason(tmp_path: Path) -> None:
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

    play(Map([*corridor_with_bay(), robot("Robot1", (0.6, 0, 0))]), tmp_path, work)


HOLD = f"""<env:Envelope xmlns:env="{ENV}" xmlns:wsa="{WSA}"><env:Header>
<wsa:From><wsa:Address>map</wsa:Address></wsa:From><wsa:Action>{TRAFFIC}:HoldTraffic</wsa:Action><wsa:MessageID>urn:hold</wsa:MessageID>
</env:Header><env:Body><HoldTraffic xmlns="{TRAFFIC}"><Reason>a joke</Reason><Number>1</Number></HoldTraffic></env:Body></env:Envelope>"""


def test_who_claims_to_be_another_one_cannot_do_more(tmp_path: Path) -> None:
    def work(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        foreigner.inbox.address = "Robot1"
        with pytest.raises(zeep.exceptions.Fault, match="Robot1 is in the simulator: state the address of your own program in wsa:From"):
            foreigner.enter(foreigner.nearest(7.4, 0), LONG_LEASE)
        request = urllib.request.Request(building.traffic, HOLD.encode(), {"Content-Type": MEDIA_TYPE})
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(request)
        assert "HoldTraffic is not a known message" in refused.value.read().decode()
        ends = building.drive("Robot1", 2.5, 0.0)
        foreigner.wait_until(lambda: bool(ends))
        assert isinstance(ends[0], CommandDone), ends
        foreigner.close()

    play(Map([*corridor_with_bay(), robot("Robot1", (0.6, 0, 0))]), tmp_path, work)


def test_a_foreign_robot_is_told_of_a_new_roadmap_and_others_keep_away_from_it_until_it_enters_anew(tmp_path: Path) -> None:
    def work(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        foreigner.enter(foreigner.nearest(2.5, 0), LONG_LEASE, Edition=foreigner.edition)
        place = foreigner.places[foreigner.place]
        building.call(lambda simulation: simulation.add(box("Shelf9", "Cupboard", (7.7, -0.2, 0), (0.3, 0.5, 0.8))))
        ends = building.drive("Robot1", 6.6, 0.0)
        foreigner.wait_until(lambda: foreigner.is_replaced and bool(ends))
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

    play(Map([*corridor_with_bay(), robot("Robot1", (0.6, 0, 0))]), tmp_path, work)


def test_a_foreign_robot_rides_in_a_lift_by_turns_with_a_simulated_one(tmp_path: Path) -> None:
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
                    (lift,) = simulation.linked.lifts
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

    play(tower((2, 2, 0)), tmp_path, work)


def test_a_foreign_robot_is_not_let_into_a_lift_that_is_out_of_order_and_learns_its_name(tmp_path: Path) -> None:
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

    play(tower((2, 2, 0)), tmp_path, work)


def test_a_simulator_that_was_started_again_knows_where_foreign_robots_may_be(tmp_path: Path) -> None:
    start: list[tuple[float, float]] = []

    def enter(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        foreigner.enter(foreigner.nearest(2.5, 0), LONG_LEASE)
        place = foreigner.places[foreigner.place]
        start.append((place.x, place.y))
        foreigner.close()

    def go_on(building: Building) -> None:
        ends = building.drive("Robot1", 7.4, 0.0)
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.wait_until(lambda: bool(ends))
        assert isinstance(ends[0], CommandGivenUp), "it is still in the way"
        foreigner.read_roadmap()
        foreigner.enter(foreigner.nearest(*start[0]), LONG_LEASE)
        again = building.drive("Robot1", 7.4, 0.0)
        foreigner.drive_until(lambda: bool(again))
        assert isinstance(again[0], CommandDone), again
        foreigner.service.LeaveTraffic(Robot="Foreigner")
        foreigner.close()

    def be_gone(building: Building) -> None:
        ends = building.drive("Robot1", 7.4, 0.0)
        while not ends:
            time.sleep(0.05)
        assert isinstance(ends[0], CommandDone), ends

    map = Map([*corridor_with_bay(), robot("Robot1", (0.6, 0, 0))])
    play(map, tmp_path, enter)
    play(map, tmp_path, go_on)
    play(map, tmp_path, be_gone)
    (tmp_path / FOREIGN_FILE).write_text("[")
    with pytest.raises(UsageError, match="make sure that no robot stands in a way, and move the file away"):
        play(map, tmp_path, be_gone)


def test_nobody_else_is_let_into_a_lift_in_which_a_robot_may_be_that_has_not_entered_anew(tmp_path: Path) -> None:
    def refused(building: Building, foreigner: ForeignRobot) -> None:
        """The simulated robot is not taken from the second storey to the third, and the cabin does not move."""
        ends = building.drive("Robot1", 3, 3, 2 * HEIGHT)
        foreigner.wait_until(lambda: bool(ends))
        assert isinstance(ends[0], CommandGivenUp), ends
        building.call(lambda simulation: heights.append(simulation.linked.lifts[0].solid.z))
        assert heights[-1] == 0.0

    def stay(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        foreigner.read_roadmap()
        foreigner.enter(foreigner.nearest(*CABIN), LONG_LEASE)
        building.call(lambda simulation: simulation.add(box("Shelf9", "Cupboard", (0.3, 0.3, 0), (0.3, 0.3, 0.8))))
        foreigner.wait_until(lambda: foreigner.is_replaced)
        refused(building, foreigner)
        foreigner.close()

    def leave(building: Building) -> None:
        foreigner = ForeignRobot("Foreigner", building.traffic, HANG_TIME)
        refused(building, foreigner)
        foreigner.service.LeaveTraffic(Robot="Foreigner")
        ends = building.drive("Robot1", 3, 3, 2 * HEIGHT)
        foreigner.wait_until(lambda: bool(ends))
        assert isinstance(ends[0], CommandDone), ends
        foreigner.close()

    heights: list[float] = []
    facts = [Fact("stopsAt", ("Lift1", "Storey3")), Fact("leadsInto", ("Gate3", "Lift1"))]
    upstairs = robot("Robot1", (2, 2, 0), PositionZ=HEIGHT)
    map = tower(extra_objects=[*storey(3, 2 * HEIGHT), upstairs], extra_facts=facts)
    play(map, tmp_path, stay)
    play(map, tmp_path, leave)


# A building that is not simulated


def test_real_robots_pass_each_other_in_a_corridor_without_a_simulator(tmp_path: Path) -> None:
    def travel(foreigner: ForeignRobot, start: float, goal: float, others: list[ForeignRobot]) -> None:
        read_roadmap(foreigner)
        foreigner.enter(foreigner.nearest(start, 0), LONG_LEASE, Edition=foreigner.edition)
        others.append(foreigner)
        while len(others) < 2:
            foreigner.take_message(0.02)
        while True:
            with contextlib.suppress(zeep.exceptions.Fault):  # the other one counts as standing there until it is seen to have entered
                foreigner.request("there", foreigner.nearest(goal, 0))
                break
        foreigner.drive_until(lambda: all("there" in robot.ended for robot in others))
        assert foreigner.ended["there"] == ("arrived", [])

    async def work(client: Client, traffic: str) -> None:
        first, second = await asyncio.gather(*(asyncio.to_thread(ForeignRobot, name, traffic, HANG_TIME) for name in ("Cart1", "Cart2")))
        others: list[ForeignRobot] = []
        await asyncio.gather(
            asyncio.to_thread(travel, first, 0.6, 7.4, others),
            asyncio.to_thread(travel, second, 7.4, 0.6, others),
        )
        assert not {*first.driven}.isdisjoint(second.driven), "they have met"
        first.close()
        second.close()

    in_building(Map([*corridor_with_bay(), real("Cart1", 0.6, 0), real("Cart2", 7.4, 0)]), tmp_path, work)


def test_without_a_simulator_traffic_follows_the_map(tmp_path: Path) -> None:
    def blocked(foreigner: ForeignRobot, trip: str, goal: str) -> bool:
        """Whether a way to the goal is closed."""
        try:
            foreigner.request(trip, goal)
        except zeep.exceptions.Fault as refusal:
            assert "no lanes lead" in str(refusal)  # noqa: PT017  # there may be a way by now
            return True
        foreigner.drive_until(lambda: trip in foreigner.ended)
        return foreigner.ended[trip][0] == "closed"

    async def work(client: Client, traffic: str) -> None:
        cart = await asyncio.to_thread(ForeignRobot, "Cart1", traffic, HANG_TIME)
        await asyncio.to_thread(read_roadmap, cart)
        home, goal = cart.nearest(0.6, 0), cart.nearest(7.4, 0)
        await asyncio.to_thread(cart.enter, home, LONG_LEASE)
        numbers = itertools.count()
        while not await asyncio.to_thread(blocked, cart, f"shut{next(numbers)}", goal):  # the door is shut on the map
            await asyncio.to_thread(blocked, cart, f"home{next(numbers)}", home)
        await client.update(UpdateMap(changes=(ValueSet("Door1", "Open", True),)))
        while await asyncio.to_thread(blocked, cart, f"open{next(numbers)}", goal):
            await asyncio.sleep(0.05)
        assert cart.place == goal
        await client.update(UpdateMap(changes=(ObjectAdded(box("Shelf9", "Cupboard", (0.2, -0.3, 0), (0.3, 0.3, 0.8))),)))
        await asyncio.to_thread(cart.wait_until, lambda: cart.is_replaced)
        edition = cart.edition
        await asyncio.to_thread(read_roadmap, cart)
        assert cart.edition > edition
        cart.close()

    door = box("Door1", "Door", (6, 0, 0), (0.1, 1.0, 2.1), Open=False)
    in_building(Map([*corridor_with_bay(), door, real("Cart1", 0.6, 0)]), tmp_path, work)


def test_traffic_that_was_started_again_knows_who_holds_what(tmp_path: Path) -> None:
    async def run() -> None:
        runtime = Host()
        await runtime.start()
        map = Map([*corridor_with_bay(), real("Cart1", 0.6, 0), real("Cart2", 7.4, 0)])
        repository = runtime.add("/repository", lambda address: Repository(address, Contents(ontology=ONTOLOGY, map=map)))
        async with program(repository.address, tmp_path) as traffic:
            cart = await asyncio.to_thread(ForeignRobot, "Cart1", traffic, HANG_TIME)
            await asyncio.to_thread(read_roadmap, cart)
            await asyncio.to_thread(cart.enter, cart.nearest(0.6, 0), LONG_LEASE)
        async with program(repository.address, tmp_path, urlsplit(traffic).port or 0) as again:
            assert again == traffic
            await asyncio.to_thread(cart.request, "there", cart.nearest(6.0, 0))
            rival = await asyncio.to_thread(ForeignRobot, "Cart2", traffic, HANG_TIME)
            with pytest.raises(zeep.exceptions.Fault, match="Cart1 holds it"):
                await asyncio.to_thread(rival.enter, cart.place, LONG_LEASE)
            await asyncio.to_thread(cart.drive_until, lambda: "there" in cart.ended)
            assert cart.ended["there"] == ("arrived", [])
            cart.close()
            rival.close()
        await runtime.stop()

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_a_building_without_robots_has_an_empty_roadmap(tmp_path: Path) -> None:
    async def work(client: Client, traffic: str) -> None:
        cart = await asyncio.to_thread(ForeignRobot, "Cart1", traffic, HANG_TIME)
        await asyncio.to_thread(cart.read_roadmap)
        assert cart.places == {}
        with pytest.raises(zeep.exceptions.Fault, match="there is no place P0/0 on the roadmap"):
            await asyncio.to_thread(cart.enter, "P0/0", LONG_LEASE)
        cart.close()

    in_building(Map(corridor_with_bay()), tmp_path, work)


def test_without_a_simulator_traffic_is_held_in_a_fire(tmp_path: Path) -> None:
    async def work(client: Client, traffic: str) -> None:
        cart = await asyncio.to_thread(ForeignRobot, "Cart1", traffic, HANG_TIME)
        await asyncio.to_thread(read_roadmap, cart)
        await asyncio.to_thread(cart.enter, cart.nearest(1, 1), LONG_LEASE)
        await client.update(UpdateMap(changes=(ValueSet("House", "Mode", "Fire"),)))
        while await asyncio.to_thread(lambda: cart.service.ReadTraffic().Hold) != "fire alarm in House":
            await asyncio.sleep(0.02)
        await asyncio.to_thread(cart.request, "there", cart.nearest(6, 5))
        for _ in range(10):
            await asyncio.to_thread(cart.take_message, 0.05)
        assert cart.way == []
        await client.update(UpdateMap(changes=(ValueSet("House", "Mode", "Normal"),)))
        await asyncio.to_thread(cart.drive_until, lambda: "there" in cart.ended)
        assert cart.ended["there"] == ("arrived", [])
        cart.close()

    in_building(tower(extra_objects=[real("Cart1", 1, 1)]), tmp_path, work)


def test_without_a_simulator_others_keep_away_from_a_robot_that_has_not_entered_the_new_roadmap(tmp_path: Path) -> None:
    def go_on(first: ForeignRobot) -> None:
        first.wait_until(lambda: first.is_replaced)
        first.read_roadmap()
        first.enter(first.nearest(0.6, 0), LONG_LEASE, Edition=first.edition)
        with pytest.raises(zeep.exceptions.Fault, match="or of what stands there"):
            first.request("past", first.nearest(6.0, 0))

    async def work(client: Client, traffic: str) -> None:
        first, second = await asyncio.gather(*(asyncio.to_thread(ForeignRobot, name, traffic, HANG_TIME) for name in ("Cart1", "Cart2")))
        for cart, x in ((first, 0.6), (second, 2.5)):
            await asyncio.to_thread(read_roadmap, cart)
            await asyncio.to_thread(cart.enter, cart.nearest(x, 0), LONG_LEASE)
        await client.update(UpdateMap(changes=(ObjectAdded(box("Shelf9", "Cupboard", (7.7, -0.2, 0), (0.3, 0.5, 0.8))),)))
        await asyncio.to_thread(go_on, first)
        first.close()
        second.close()

    in_building(Map([*corridor_with_bay(), real("Cart1", 0.6, 0), real("Cart2", 7.4, 0)]), tmp_path, work)


def test_without_a_simulator_operators_see_the_ways_of_robots_and_what_is_closed(tmp_path: Path) -> None:
    async def work(client: Client, traffic: str) -> None:
        reader = TrafficReader(client, traffic)
        cart, rival = await asyncio.gather(*(asyncio.to_thread(ForeignRobot, name, traffic, HANG_TIME) for name in ("Cart1", "Cart2")))
        await asyncio.to_thread(read_roadmap, cart)
        start, goal = cart.nearest(0.6, 0), cart.nearest(7.4, 0)
        await asyncio.to_thread(cart.enter, start, LONG_LEASE)
        await asyncio.to_thread(rival.enter, cart.nearest(2.5, 0), LONG_LEASE, Mobility="busy")
        while True:  # until the survey knows that both take part
            with contextlib.suppress(zeep.exceptions.Fault):
                await asyncio.to_thread(cart.request, "there", goal)
                break
        ended: list[bool] = []
        driving = asyncio.create_task(asyncio.to_thread(cart.drive_until, lambda: bool(ended)))
        while not (seen := view_of(await reader.traffic())).robots[0].waiting:
            await asyncio.sleep(0.02)
        ended.append(True)
        await driving
        assert [robot.robot for robot in seen.robots] == ["Cart1", "Cart2"]
        assert seen.robots[0].granted[0] in {point(cart, name) for name in (start, *cart.driven)}
        assert seen.robots[0].destination == point(cart, goal)
        assert seen.robots[0].waiting == "waits for Cart2, which works there"
        roadmap = await reader.roadmap()
        assert roadmap.number == (await reader.traffic()).roadmap
        assert {*roadmap.places} == {point(cart, name) for name in cart.places}
        await client.update(UpdateMap(changes=(ObjectAdded(thing("Jar1", "Jar", 5.5, 0.0, 0.0)),)))
        while (await reader.traffic()).roadmap == roadmap.number:
            await asyncio.sleep(0.02)
        blocked = await reader.roadmap()
        assert (blocked.places, blocked.lanes) == (roadmap.places, roadmap.lanes)
        new_places = {blocked.places[place] for place in {*blocked.closed_places} - {*roadmap.closed_places}}
        new_lanes = {*blocked.closed_lanes} - {*roadmap.closed_lanes}
        assert new_places or new_lanes
        assert all(math.dist(place[:2], (5.5, 0)) < 1 for place in new_places)
        cart.close()
        rival.close()

    in_building(Map([*corridor_with_bay(), real("Cart1", 0.6, 0), real("Cart2", 2.5, 0)]), tmp_path, work)


def point(robot: ForeignRobot, name: str) -> tuple[float, float, float]:
    """Where a place is, as operators see it."""
    place = robot.places[name]
    return round(place.x, 2), round(place.y, 2), round(place.level, 2)
