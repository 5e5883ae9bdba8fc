"""Doors over MQTT: messages may be lost, and the way to a door, or its controller, may be gone."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from somrs.adapters.things.conversion import Raw
from somrs.adapters.things.hub import Hub
from somrs.adapters.things.mapping_file import read_mapping
from somrs.adapters.things.model import Command, Source
from somrs.adapters.things.passages import passage_device
from somrs.adapters.things.session import REPEAT
from somrs.devices.passage import PassageDevice
from somrs.ontology.files.loading import upper
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.traffic.passage_call import PassageCall, PassageStatus
from tests.support.road_lab import in_virtual_time
from tests.support.simulated_tower import tower
from tests.support.virtual_devices import make_ask

MAPPING = """
connections: {house: {url: mqtt://broker}}
things:
  Door1:
    type: AutomaticDoor
    attributes: {Open: {topic: door/state}}
    door: {open: [{topic: door/set, payload: open}], close: [{topic: door/set, payload: close}]}
"""
WITH_SESSION = """
connections: {house: {url: mqtt://broker}}
things:
  Door1: {type: AutomaticDoor, available: {topic: door/status}, session: {topic: door}}
"""


class Wire:
    """The connection to the door (somrs.adapters.things.connector.Connector). `sent`: what came to its other end."""

    def __init__(self) -> None:
        self.sent: list[Raw] = []

    async def run(self) -> None:
        """Need nothing."""

    def follow(self, source: Source) -> None:
        """Pass all on."""

    def unfollow(self, source: Source) -> None:
        """Pass all on."""

    async def send(self, command: Command, raw: Raw) -> None:
        self.sent.append(raw)


def with_door(folder: Path, test: Callable[[PassageDevice, Hub, Wire], Awaitable[None]], mapping: str = MAPPING) -> None:
    """Run a test with a door, in virtual time."""
    (folder / "things.yaml").write_text(mapping)

    async def run() -> None:
        loaded, hub, wire = read_mapping(folder / "things.yaml"), Hub(), Wire()
        hub.connect(loaded.connections["house"])
        hub.connectors["house"] = wire
        (thing,) = loaded.things
        hub.add(thing, loaded.ontology)
        door = passage_device(thing, hub)
        repository = Repository("http://here/repository", Contents(ontology=upper(), map=tower()))
        door.map = MapReader(make_ask(repository, lambda: 0.0))
        await door.open()
        hub.reached("house", True)
        await test(door, hub, wire)
        await door.close()

    in_virtual_time(run())


def say(hub: Hub, payload: bytes) -> None:
    hub.received(("house", "door/state", None), payload)


def test_a_door_is_opened_again_until_it_says_that_it_is_open(tmp_path: Path) -> None:
    async def test(door: PassageDevice, hub: Hub, wire: Wire) -> None:
        say(hub, b"closed")
        opening = asyncio.create_task(door.follow(PassageCall()))
        await asyncio.sleep(2.5 * REPEAT)
        assert wire.sent == ["open", "open", "open"]
        assert not opening.done()
        say(hub, b"open")
        await opening
        await asyncio.sleep(5 * REPEAT)
        assert wire.sent == ["open", "open", "open"]

    with_door(tmp_path, test)


def test_a_door_that_closes_by_itself_is_opened_again_while_robots_need_it(tmp_path: Path) -> None:
    async def test(door: PassageDevice, hub: Hub, wire: Wire) -> None:
        opening = asyncio.create_task(door.follow(PassageCall()))
        await asyncio.sleep(0)
        say(hub, b"open")
        await opening
        say(hub, b"closed")
        await asyncio.sleep(1.5 * REPEAT)
        assert wire.sent == ["open", "open"]
        await door.follow(None)
        await asyncio.sleep(5 * REPEAT)
        assert wire.sent == ["open", "open", "close"]

    with_door(tmp_path, test)


def test_a_door_is_not_opened_any_more_when_the_call_was_given_up(tmp_path: Path) -> None:
    async def test(door: PassageDevice, hub: Hub, wire: Wire) -> None:
        opening = asyncio.create_task(door.follow(PassageCall()))
        await asyncio.sleep(0.5 * REPEAT)
        opening.cancel()
        await asyncio.sleep(5 * REPEAT)
        assert wire.sent == ["open"]

    with_door(tmp_path, test)


def test_a_door_does_not_work_while_its_broker_is_away(tmp_path: Path) -> None:
    async def test(door: PassageDevice, hub: Hub, wire: Wire) -> None:
        statuses: list[PassageStatus] = []
        problems: list[str | None] = []
        door.status_observer, door.problem_observer = statuses.append, problems.append
        say(hub, b"closed")
        for is_reached in (False, True):
            hub.reached("house", is_reached)
        assert [status.working for status in statuses] == [True, False, True]
        assert problems == [None, "cannot be reached: its connection house is not there", None]

    with_door(tmp_path, test)


def test_a_door_with_a_session_does_not_work_when_its_controller_is_gone(tmp_path: Path) -> None:
    async def test(door: PassageDevice, hub: Hub, wire: Wire) -> None:
        statuses: list[PassageStatus] = []
        problems: list[str | None] = []
        door.status_observer, door.problem_observer = statuses.append, problems.append
        free, last_will = b'{"doors": "closed"}', b'{"doors": "closed", "mode": "out-of-order"}'
        for topic, payload in (("status", b"online"), ("state", free), ("state", last_will), ("state", free), ("status", b"offline")):
            hub.received(("house", f"door/{topic}", None), payload)
        assert [status.working for status in statuses] == [True, False, True, False]
        assert list(dict.fromkeys(problems)) == [
            "has not said anything yet",
            None,
            "is in the mode out-of-order",
            "does not work: it says so at house: door/status",
        ]

    with_door(tmp_path, test, WITH_SESSION)
