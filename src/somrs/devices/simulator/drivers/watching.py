"""What a simulated camera notices by itself: things that came, were moved, or are not where the map has them, in full view.

A camera looks every `WATCHING` seconds, and reports what it sees twice in a row and what the map does not have. It leaves out what is
within reach of a robot: the robot reports what it does.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from somrs.devices.simulator.drivers.outage import Outage
from somrs.devices.simulator.drivers.recognition import sighting_parts
from somrs.devices.simulator.drivers.simulated import SimulatedDevice, format_number
from somrs.devices.simulator.link.command_link import CommandLink
from somrs.devices.simulator.link.commands import CommandDone, Point, RobotState, Sighting
from somrs.protocol.messages.observations import Observation
from somrs.service_manager.sdk.device import Device
from somrs.service_manager.sdk.values import number_of

WATCHING = 3.0
"""Seconds between two looks."""
SAME_PLACE = 0.05
"""Distance in m, in addition to the noise of the camera, within which a thing counts as being where it was."""
NOISE = 4.0
"""The largest error of a position, in standard deviations."""
REACH = 1.5
"""Distance in m within which a robot may be handling a thing."""
RIVALRY = 1.0
"""Distance in m within which another thing may be taken for a new one, so that it is reported, too."""
MIDDLE = 0.05
"""Height in m above its support at which a thing is expected to be seen."""
MOST_THINGS = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class Thing:
    """A thing of the map, and where its underside is, in m."""

    name: str
    x: float
    y: float
    z: float


@dataclass(frozen=True, slots=True, kw_only=True)
class News:
    """What differs from the map: the numbers of sightings that it does not explain, and the things that are missing."""

    sightings: Sequence[Sighting]
    unexplained: tuple[int, ...]
    missed: frozenset[str]

    def __bool__(self) -> bool:
        return bool(self.unexplained or self.missed)

    def is_same(self, earlier_news: News, tolerance: float) -> bool:
        """Whether both looks show the same."""
        if self.missed != earlier_news.missed or len(self.unexplained) != len(earlier_news.unexplained):
            return False
        earlier_sightings = [earlier_news.sightings[number] for number in earlier_news.unexplained]
        return all(
            any(twin.type == sighting.type and _distance(twin, sighting) <= tolerance for twin in earlier_sightings)
            for sighting in (self.sightings[number] for number in self.unexplained)
        )


NOTHING = News(sightings=(), unexplained=(), missed=frozenset())


class WatchingDevice(SimulatedDevice):
    """A simulated device with a camera, which watches while it does no work."""

    async def open(self) -> None:
        await super().open()
        accuracies = await self._feature("Accuracy")
        self._watch = Watch(self, sum(accuracy for accuracy in accuracies if isinstance(accuracy, float)))
        self._outage = Outage(self.name, "compare what it sees with the map")
        self.keep_doing(self._keep_watching())

    async def _keep_watching(self) -> None:
        while True:
            await asyncio.sleep(WATCHING)
            await self.watch()

    async def watch(self) -> None:
        """Look once, if the device has nothing else to do, and report what was seen for the second time."""
        state = self.idle_state
        if state is not None and not state.faults:
            with self._outage:
                await self._watch.look(state, self._link)


class Watch:
    """What a device saw when it looked last, and what it has reported."""

    def __init__(self, device: Device, accuracy: float) -> None:
        self._device = device
        self._tolerance = SAME_PLACE + NOISE * accuracy
        self._last_news = self._reported = NOTHING

    async def look(self, state: RobotState, link: CommandLink) -> None:
        """Look once, and report what was seen for the second time."""
        things = await self._things("Graspable", state)
        seen_at = time.time()
        view = await link.sense(expected=[Point(x=thing.x, y=thing.y, z=thing.z + MIDDLE) for thing in things])
        types = {sighting.type for sighting in view.sightings if not sighting.robot}
        known = {type_name: await self._things(type_name, state) for type_name in types}
        news = self._compare(view, things, known)
        is_settled, self._last_news = news.is_same(self._last_news, self._tolerance), news
        if news and is_settled and not news.is_same(self._reported, self._tolerance):
            self._reported = news
            await self._report(news, seen_at)
        elif not news:
            self._reported = NOTHING

    async def _things(self, type_name: str, state: RobotState) -> list[Thing]:
        """The things of a type that the map has within sight, and that stand somewhere."""
        conditions = ["?It.PositionX = ?X AND ?It.PositionY = ?Y AND ?It.PositionZ = ?Z AND NOT ?It.Unknown = TRUE"]
        if isinstance(reach := self._device.attributes.get("OperationRange"), float | int):
            conditions += [
                f"?It.Position{axis} > {format_number(middle - reach)} AND ?It.Position{axis} < {format_number(middle + reach)}"
                for axis, middle in (("X", state.x), ("Y", state.y))
            ]
        things: list[Thing] = []
        for relation in ("isOn", "isIn"):
            formula = " AND ".join([f"?It: {type_name} {relation} ?Place", *conditions])
            rows = await self._device.map.query(formula, limit=MOST_THINGS)
            things += [Thing(name=str(row["It"]), x=number_of(row["X"]), y=number_of(row["Y"]), z=number_of(row["Z"])) for row in rows]
        return things

    def _compare(self, view: CommandDone, things: Sequence[Thing], known: dict[str, list[Thing]]) -> News:
        sightings = view.sightings
        robots = [sighting for sighting in sightings if sighting.robot]
        standing = [number for number, sighting in enumerate(sightings) if _stands(sighting)]
        unexplained = tuple(
            number
            for number in standing
            if not self._is_at(sightings[number], known[sightings[number].type]) and not _is_near(sightings[number], robots, REACH)
        )
        seen = [sightings[number] for number in standing]
        missed = frozenset(
            thing.name
            for thing in (things[number] for number in view.clear)
            if not self._is_at(thing, seen) and not _is_near(thing, robots, REACH)
        )
        return News(sightings=sightings, unexplained=unexplained, missed=missed)

    def _is_at(self, place: Thing | Sighting, places: Iterable[Thing | Sighting]) -> bool:
        return any(_distance(place, known_place) <= self._tolerance for known_place in places)

    async def _report(self, news: News, seen_at: float) -> None:
        unexplained = [news.sightings[number] for number in news.unexplained]
        numbers = [
            number for number, sighting in enumerate(news.sightings) if _stands(sighting) and _is_near(sighting, unexplained, RIVALRY)
        ]
        situation = " AND ".join(part for number in numbers for part in sighting_parts(news.sightings, number))
        observation = Observation(as_of=seen_at, missed=tuple(sorted(news.missed)))
        await self._device.report(situation or None, observation)


def _stands(sighting: Sighting) -> bool:
    return not sighting.robot and (sighting.support is not None or sighting.container is not None)


def _is_near(place: Thing | Sighting, sightings: Iterable[Sighting], distance: float) -> bool:
    return any(math.dist((place.x, place.y), (sighting.x, sighting.y)) <= distance for sighting in sightings)


def _distance(place: Thing | Sighting, other_place: Thing | Sighting) -> float:
    return math.dist((place.x, place.y, place.z), (other_place.x, other_place.y, other_place.z))
