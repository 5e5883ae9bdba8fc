"""Real lifts and doors: what they do for traffic, and their services beside that."""

from __future__ import annotations

import asyncio
import itertools

import pytest

from somrs.devices.passage import DoorDevice, LiftDevice, PassageDevice
from somrs.kernel.component import Received
from somrs.ontology.files.loading import upper
from somrs.ontology.objects import Fact
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.observations import Observation
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.orders import Order, Perform, Quote, Refusal, ServiceFailed, WorkDone
from somrs.traffic.passage_call import PassageCall
from tests.support.robot_lab import run, run_work
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import box
from tests.support.virtual_devices import make_ask

REPOSITORY = Repository(
    "http://here/repository",
    Contents(ontology=upper(), map=tower(extra_objects=[box("Door1", "AutomaticDoor", (4, 3, 0), (0.1, 1.2, 2.1))])),
)


class Recorded(PassageDevice, replaces=("map",)):
    """Records what its controller is told, which takes a moment. `is_stuck`: it does not do it."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.done: list[float | str | None] = []
        self.is_stuck = False
        self.map = MapReader(make_ask(REPOSITORY, lambda: 0.0))

    async def serve(self, call: PassageCall) -> None:
        await self._move_for("open" if call.level is None else call.level)

    async def release(self) -> None:
        await self._move_for("shut")

    async def _move_for(self, done: float | str) -> None:
        await asyncio.sleep(0.01)
        if self.is_stuck:
            raise ServiceFailed("it is stuck")
        self.done.append(done)


class Door(Recorded, DoorDevice):
    """A door that records."""


class ALift(Recorded, LiftDevice):
    """A lift that records."""


def _order(device: PassageDevice, service: str, **inputs: str) -> Order:
    method = next(name for name, offered in device.services().items() if offered.type == service)
    return Order(participant="p", method=method, inputs=inputs, effect=upper().services[service].effect)


async def _perform(device: PassageDevice, service: str, **inputs: str) -> str | None:
    done = await run_work(device, Perform(_order(device, service, **inputs)), REPOSITORY, [])
    assert isinstance(done, WorkDone)
    return done.situation


def test_a_door_that_is_to_stay_open_does_until_it_is_closed() -> None:
    async def test() -> None:
        door = Door("Door1")
        await door.follow(PassageCall())
        await door.follow(None)
        assert await _perform(door, "OpenDoor", Door="Door1") == "Door1.Open = TRUE"
        await door.follow(PassageCall())
        await door.follow(None)
        assert door.done == ["open", "shut", "open", "open"], "it is not shut behind a robot"
        assert await _perform(door, "CloseDoor", Door="Door1") == "Door1.Open = FALSE"
        await door.follow(PassageCall())
        await door.follow(None)
        assert door.done[4:] == ["shut", "open", "shut"]

    run(test())


def test_a_door_that_could_not_be_opened_shuts_behind_robots() -> None:
    async def test() -> None:
        door = Door("Door1")
        door.is_stuck = True
        with pytest.raises(ServiceFailed, match="it is stuck"):
            await _perform(door, "OpenDoor", Door="Door1")
        door.is_stuck = False
        await door.follow(PassageCall())
        await door.follow(None)
        assert door.done == ["open", "shut"]

    run(test())


def test_a_door_is_not_closed_while_a_robot_needs_it() -> None:
    async def test() -> None:
        door = Door("Door1")
        await door.follow(PassageCall())
        closing = asyncio.create_task(_perform(door, "CloseDoor", Door="Door1"))
        await asyncio.sleep(0.05)
        assert door.done == ["open"]
        await door.follow(None)
        await closing
        assert door.done[-1] == "shut"

    run(test())


def test_a_lift_is_called_when_no_robot_has_it_and_robots_come_after_it() -> None:
    async def test() -> None:
        lift = ALift("Lift1")
        await lift.follow(PassageCall(level=0.0, destination=HEIGHT, robots=("Robot1",)))
        calling = asyncio.create_task(_perform(lift, "CallLift", Storey="Storey1"))
        await lift.follow(PassageCall(level=HEIGHT, destination=HEIGHT, robots=("Robot1",)))
        assert lift.done == [0.0, HEIGHT]
        await lift.follow(None)
        boarding = asyncio.create_task(lift.follow(PassageCall(level=HEIGHT, robots=("Robot2",))))
        assert await calling == "Lift1.PositionZ = 0 AND Lift1 standsAt Storey1"
        await boarding
        assert lift.done[2:] == ["shut", 0.0, "shut", HEIGHT]

    run(test())


def test_the_map_has_where_a_lift_says_that_it_stands_and_that_a_dead_one_stands_nowhere() -> None:

    async def test() -> None:
        repository = Repository(
            "http://here/repository", Contents(ontology=upper(), map=tower(extra_facts=[Fact("standsAt", ("Lift1", "Storey1"))]))
        )
        ask, lift = make_ask(repository, lambda: 0.0), ALift("Lift1")
        lift.map, known_storeys, numbers = MapReader(ask), list[list[str]](), itertools.count()

        def report(situation: str | None, observation: Observation) -> None:
            header = Header(sender="http://here/lift", recipient="http://here/repository", message_id=message_id("report", next(numbers)))
            repository.handle(Received(Message(header=header, body=UpdateMap(situation=situation, observation=observation))), 0.0)

        async def storeys() -> list[str]:
            await asyncio.sleep(0.02)
            return [str(row["Storey"]) for row in await lift.map.query("Lift1 standsAt ?Storey")]

        lift.observer = report
        # Its last will; it works; it says itself that it is out of order, and where it is; its last will; it works, and knows where it is;
        # a person rides down.
        levels = ((None, False), (HEIGHT, True), (HEIGHT, False), (None, False), (None, True), (HEIGHT, True), (None, True), (0.0, True))
        for level, is_working in levels:
            lift.status(level=level, working=is_working)
            known_storeys.append(await storeys())
        assert known_storeys == [[], ["Storey2"], ["Storey2"], [], [], ["Storey2"], ["Storey2"], ["Storey1"]]

    run(test())


def test_what_a_passage_cannot_do_is_refused() -> None:
    async def test() -> None:
        lift, door = ALift("Lift1"), Door("Door1")
        with pytest.raises(Refusal, match="Lift1 does not stop at Storey3; it stops at Storey1, Storey2"):
            await run_work(lift, Quote(_order(lift, "CallLift", Storey="Storey3")), REPOSITORY, [])
        with pytest.raises(Refusal, match="Door1 opens and closes only itself"):
            await run_work(door, Quote(_order(door, "OpenDoor", Door="Gate1")), REPOSITORY, [])
        with pytest.raises(Refusal, match="Door1 does not work") as refused:
            await run_work(door, Quote(_order(door, "OpenDoor", Door="Door1")), REPOSITORY, [])
        assert refused.value.not_now
        door.status()
        await run_work(door, Quote(_order(door, "OpenDoor", Door="Door1")), REPOSITORY, [])

    run(test())
