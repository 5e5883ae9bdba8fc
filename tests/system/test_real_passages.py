"""A building without a simulator, whose lift and door have programs of their own, as the examples have: whole processes, and real
sockets."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from subprocess import PIPE, Popen

import pytest
import zeep.exceptions

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.ontology.files.dump import dump_map
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from tests.support import warm
from tests.support.foreign_robot import ForeignRobot
from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import box, robot

pytestmark = pytest.mark.long

LEASE = 600.0


def building() -> Map:
    """Two storeys with a lift, and an automatic door in a wall across the lower one."""
    walls = [box("Screen1", "Wall", (4, 1.2, 0), (0.1, 2.4, 2.5)), box("Screen2", "Wall", (4, 4.8, 0), (0.1, 2.4, 2.5))]
    door = box("Door1", "AutomaticDoor", (4, 3, 0), (0.1, 1.2, 2.1))
    return tower(extra_objects=[*walls, door, robot("Foreigner", (1, 1, 0), type="MobileRobot")])


@contextmanager
def program(example: str, name: str, data: Path) -> Iterator[Popen[str]]:
    """An example as a program, from when it has joined the system."""
    with Popen([sys.executable, ROOT / "examples" / example, "--name", name, "--data", data], stdout=PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline(), "it says that it is ready"
            yield process
        finally:
            process.terminate()


def refusal(foreigner: ForeignRobot, trip: str, goal: str) -> str:
    """Why a trip is refused; empty if it is not."""
    try:
        foreigner.request(trip, goal)
    except zeep.exceptions.Fault as fault:
        return str(fault)
    return ""


def go(foreigner: ForeignRobot, goal: str, is_there: Callable[[], bool] = lambda: False) -> None:
    """Drive to a place, or until the condition holds. On a slow machine, a program may be silent for a while, which ends a trip."""
    for number in count():
        trip = f"{goal} {number}"
        if not refusal(foreigner, trip, goal):
            foreigner.drive_until(lambda trip=trip: is_there() or trip in foreigner.ended)  # type: ignore[misc]
            if is_there() or foreigner.ended[trip] == ("arrived", []):
                return
        foreigner.take_message(0.05)


def travel(traffic: str, data: Path, holds: Callable[[str], bool]) -> None:
    """A robot of another make drives through the door and up with the lift, whose program is killed in the middle of the ride."""
    foreigner = ForeignRobot("Foreigner", traffic, HANG_TIME)
    while not foreigner.places:
        foreigner.read_roadmap()
        foreigner.take_message(0.02)
    start, beside, goal = foreigner.nearest(1, 1), foreigner.nearest(6.5, 1), foreigner.nearest(5, 4, HEIGHT)
    foreigner.enter(start, LEASE, Edition=foreigner.edition)
    while "Door1 is out of order" not in refusal(foreigner, "too early", beside):
        foreigner.take_message(0.05)
    with program("automatic_door.py", "Door1", data):
        go(foreigner, beside)
        assert "Lift1 is out of order" in refusal(foreigner, "without a lift", goal)
        with program("lift.py", "Lift1", data) as lift:
            go(foreigner, goal, lambda: foreigner.places[foreigner.place].zone == "Lift1")
            lift.kill()
        with program("lift.py", "Lift1", data):
            go(foreigner, goal)
            assert foreigner.places[foreigner.place].level == HEIGHT
            while not holds("Lift1 standsAt Storey2 AND Lift1.Working = TRUE"):
                foreigner.take_message(0.05)
    foreigner.close()


def test_a_robot_of_another_make_passes_a_real_door_and_a_real_lift(tmp_path: Path) -> None:
    site, data = tmp_path / "site.yaml", tmp_path / "data"
    site.write_text(dump_map(building(), upper()))

    async def run() -> None:
        async with asyncio.timeout(HANG_TIME), System([site], data, simulates=False, launcher=warm.launcher(), certificates=False):
            loop, addresses = asyncio.get_running_loop(), Addresses.read(data)
            async with Client(addresses) as client:

                def holds(formula: str) -> bool:
                    return bool(asyncio.run_coroutine_threadsafe(client.query(formula), loop).result().rows)

                await asyncio.to_thread(travel, addresses.traffic or "", data, holds)

    asyncio.run(run())
