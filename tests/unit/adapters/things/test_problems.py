"""Why a thing cannot be used, as the map has it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

from msgspec import structs

from somrs.adapters.things.hub import ABSENCE, Hub
from somrs.adapters.things.mapping_file import read_mapping
from somrs.adapters.things.sampling import Key
from somrs.ontology.types import PROBLEM, Value
from tests.support.road_lab import in_virtual_time

HEATER = ("house", "heater/temperature", None)
STATUS = ("house", "heater/status", None)
MAPPING = """
connections: {house: {url: mqtt://broker}}
things:
  Heater1:
    type: Heater
    available: {topic: heater/status}
    attributes: {TargetTemperature: {topic: heater/temperature}}
    services: {SetTemperature: {write: [{topic: heater/set, payload: '?Temperature'}]}}
"""


def reported(folder: Path, play: Callable[[Hub], None], seconds: float = ABSENCE) -> list[Value | None]:
    """What the map is told of the heater's problem: while the test plays, and some seconds later."""
    (folder / "things.yaml").write_text(MAPPING)

    async def run() -> list[Value | None]:
        loaded, hub, loop = read_mapping(folder / "things.yaml"), Hub(), asyncio.get_running_loop()
        hub.connect(loaded.connections["house"])
        (thing,) = loaded.things
        hub.add(thing, loaded.ontology)
        play(hub)
        problems = [hub.sampler.take_due(loop.time())]
        await asyncio.sleep(seconds + 0.1)
        problems.append(hub.sampler.take_due(loop.time()))
        return [values["Heater1", PROBLEM] for values in problems if ("Heater1", PROBLEM) in values]

    return in_virtual_time(run())


def test_a_thing_that_has_never_spoken_is_said_to_be_silent_after_a_while(tmp_path: Path) -> None:
    assert reported(tmp_path, lambda hub: None, ABSENCE - 1.0) == []
    assert reported(tmp_path, lambda hub: None) == ["has not said anything yet"]


def test_who_speaks_in_time_has_no_problem(tmp_path: Path) -> None:
    assert (
        reported(
            tmp_path,
            lambda hub: hub.received(
                HEATER,
                b"21",
            ),
        )
        == []
    )


def test_a_thing_that_says_that_it_does_not_work_has_a_problem_until_it_works(tmp_path: Path) -> None:
    def break_it(hub: Hub) -> None:
        hub.received(HEATER, b"21")
        hub.received(STATUS, b"offline")

    def mend_it(hub: Hub) -> None:
        break_it(hub)
        hub.sampler.take_due(asyncio.get_running_loop().time())
        hub.received(STATUS, b"online")

    assert reported(tmp_path, break_it) == ["does not work: it says so at house: heater/status"]
    assert reported(tmp_path, mend_it) == [""]


def test_a_thing_whose_broker_is_away_for_a_while_cannot_be_reached(tmp_path: Path) -> None:
    def lose_it(hub: Hub) -> None:
        hub.received(HEATER, b"21")
        hub.reached("house", False)

    def lose_it_for_a_moment(hub: Hub) -> None:
        lose_it(hub)
        hub.reached("house", True)

    assert reported(tmp_path, lose_it) == ["cannot be reached: its connection house is not there"]
    assert reported(tmp_path, lose_it_for_a_moment) == []


def test_a_thing_that_cannot_be_read_has_a_problem_until_it_can(tmp_path: Path) -> None:
    def refuse_it(hub: Hub) -> None:
        hub.received(HEATER, b"21")
        hub.unreadable(HEATER, "http://heater/t answers 401")

    def allow_it(hub: Hub) -> None:
        refuse_it(hub)
        hub.received(HEATER, b"22")

    assert reported(tmp_path, refuse_it) == ["cannot be read: http://heater/t answers 401"]
    assert reported(tmp_path, allow_it) == []


def test_what_an_earlier_run_has_left_on_the_map_is_taken_back(tmp_path: Path) -> None:
    def begin_again(hub: Hub) -> None:
        hub.received(HEATER, b"21")
        hub.note_problem("Heater1", "has not said anything yet")

    assert reported(tmp_path, begin_again) == [""]


def sensor_of(folder: Path, play: Callable[[Hub], None], seconds: float) -> tuple[dict[Key, Value | None], str | None]:
    """What the map is told of a sensor whose values lapse, some seconds after the test has played, and why it is not known how it is."""
    (folder / "things.yaml").write_text("""
connections: {house: {url: mqtt://broker}}
things: {Sensor1: {type: Sensor, attributes: {Detected: {topic: motion, off_delay: 30 s, expire_after: 60 s}}}}
""")

    async def run() -> tuple[dict[Key, Value | None], str | None]:
        loaded, hub = read_mapping(folder / "things.yaml"), Hub()
        hub.connect(loaded.connections["house"])
        hub.add(loaded.things[0], loaded.ontology)
        play(hub)
        hub.sampler.take_due(asyncio.get_running_loop().time())
        await asyncio.sleep(seconds)
        return hub.sampler.take_due(asyncio.get_running_loop().time()), hub.silence("Sensor1")

    return in_virtual_time(run())


def test_values_lapse_when_nothing_more_is_heard(tmp_path: Path) -> None:
    def move(hub: Hub) -> None:
        hub.received(("house", "motion", None), b"on")

    assert sensor_of(tmp_path, move, 29.0) == ({}, None)
    assert sensor_of(tmp_path, move, 31.0) == ({("Sensor1", "Detected"): False}, None)
    problem = "has said nothing of Detected for too long"
    assert sensor_of(tmp_path, move, 66.0) == ({("Sensor1", "Detected"): None, ("Sensor1", PROBLEM): problem}, problem)


def test_what_a_thing_says_no_more_is_taken_from_the_map(tmp_path: Path) -> None:
    def exchange_it(hub: Hub) -> None:
        hub.received(("house", "motion", None), b"on")
        thing = hub.states["Sensor1"].thing
        (signal,) = thing.signals
        hub.sampler.take_due(asyncio.get_running_loop().time())
        hub.add(structs.replace(thing, signals=(structs.replace(signal, path="Open"),)), hub.ontologies["Sensor1"])
        assert hub.sampler.take_due(asyncio.get_running_loop().time()) == {("Sensor1", "Detected"): None}

    sensor_of(tmp_path, exchange_it, 0.0)
