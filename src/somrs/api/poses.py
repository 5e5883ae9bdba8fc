"""The poses of all movable objects, for any number of viewers: from the simulator, or from the map in a system without a simulator.

All viewers share one connection to the simulator; it is open while there is a viewer. A viewer receives:

- Text, JSON: `movers`, the movable objects, each with its name and the count of numbers in its pose (as on the robot link), and the number
  of this `table`; `robots`, the changes in what the robots hold, do, and cannot do; `source` (`simulator` or `map`), and whether it is
  `alive`.
- Binary, little-endian: the source's wall clock and the simulated time (two float64, seconds); the table's number and the count of the
  movers in this message (two uint32); their indices in the table, counted from 0 (uint32); and their poses, one after the other (float32).

The first messages contain everything, later ones the changes. A slow viewer skips ticks, and then receives everything again.
"""

from __future__ import annotations

import asyncio
import struct
import time
from array import array
from collections.abc import Iterable, Iterator
from contextlib import aclosing, contextmanager
from itertools import chain

import msgspec

from somrs.api.bodies import movers, scene_of
from somrs.api.context import Context
from somrs.client.simulator_link import operator_link
from somrs.devices.simulator.link.lines import Mover, Poses, RobotStatus
from somrs.errors import RemoteError

RATE = 20.0
"""Ticks per second."""
RETRY_DELAY = 0.5
"""Seconds between two attempts to connect to the simulator."""
_HEADER = struct.Struct("<ddII")

Row = tuple[float, ...]
Message = str | bytes


class PosesNews(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The content of a text message."""

    table: int | None = None
    movers: tuple[Mover, ...] | None = None
    robots: dict[str, RobotStatus] = {}
    source: str | None = None
    alive: bool | None = None


class PoseFeed:
    """Follows the source of the poses while there is a viewer (`viewing`). Each tick is a set of changes; ticks are counted from 1."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._source = "map" if context.addresses.simulator is None else "simulator"
        self._viewers = 0
        self._running: asyncio.Task[None] | None = None
        self._tick = 0
        self._wake = asyncio.Event()
        self._table = 0
        self._movers: tuple[Mover, ...] = ()
        self._rows: list[Row] = []
        self._works: dict[str, RobotStatus] = {}
        self._clock, self._time, self._alive = 0.0, 0.0, True
        self._news: list[Message] = []
        """The messages for viewers that received the previous tick."""
        self._whole: list[Message] | None = None
        """The messages for all other viewers; made when the first of them needs it."""

    @contextmanager
    def viewing(self) -> Iterator[None]:
        self._viewers += 1
        if self._running is None:
            self._tick, self._movers, self._rows, self._works = 0, (), [], {}
            self._running = asyncio.create_task(self._follow_map() if self._source == "map" else self._follow_simulator())
        try:
            yield
        finally:
            self._viewers -= 1
            if not self._viewers:
                self._running.cancel()
                self._running = None

    async def wait_for_tick(self, last_tick: int | None) -> tuple[int, list[Message]]:
        """Wait for a tick after `last_tick`, and return its number and the messages that update a viewer from `last_tick` to it."""
        while self._tick == (last_tick or 0):
            await self._wake.wait()
        if last_tick == self._tick - 1:
            return self._tick, self._news
        if self._whole is None:
            news = PosesNews(table=self._table, movers=self._movers, robots=self._works, source=self._source, alive=self._alive)
            self._whole = [_text(news), self._frame(range(len(self._rows)), chain.from_iterable(self._rows))]
        return self._tick, self._whole

    # Sources

    async def _follow_simulator(self) -> None:
        while True:
            try:
                async with operator_link(self._context.addresses) as operator, aclosing(operator.poses(RATE)) as lines:
                    async for line in lines:
                        self._take_poses(line)
            except RemoteError:
                self._publish_tick([_text(PosesNews(alive=False))], alive=False)
            await asyncio.sleep(RETRY_DELAY)

    async def _follow_map(self) -> None:
        with self._context.hub.subscribe("map") as news:
            while True:
                self._take_poses(self._read_map_poses())
                await news.next_news()
                await asyncio.sleep(1 / RATE)

    def _read_map_poses(self) -> Poses:
        """The poses that have changed on the map since the last tick."""
        map, ontology = self._context.map, self._context.ontology
        scene = scene_of(map, self._context.version, ontology, movers(map, ontology))
        bodies = sorted(scene.bodies, key=lambda body: body.name)
        table = tuple(Mover(name=body.name, numbers=4 if body.kind in ("robot", "lift") else 6) for body in bodies)
        rows = [(body.x, body.y, body.z, body.yaw, 0.0, 0.0)[: mover.numbers] for body, mover in zip(bodies, table, strict=True)]
        works = {body.name: RobotStatus() for body in bodies if body.kind == "robot"}
        held = {body.placement.object: body.name for body in bodies if body.placement is not None and body.placement.relation == "isHeldBy"}
        works.update({robot: RobotStatus(holding=thing) for robot, thing in held.items() if robot in works})
        anew = table != self._movers or not self._tick
        moved = tuple(i for i, row in enumerate(rows) if anew or row != self._rows[i])
        return Poses(
            time=0.0,
            clock=time.monotonic(),
            movers=table if anew else None,
            moved=moved,
            values=tuple(chain.from_iterable(rows[i] for i in moved)),
            robots={robot: work for robot, work in works.items() if anew or work != self._works.get(robot)},
        )

    # Messages to viewers

    def _take_poses(self, line: Poses) -> None:
        self._clock, self._time = line.clock, line.time
        news = PosesNews(robots=line.robots, alive=None if self._alive else True)
        if line.movers is not None:
            self._table += 1
            self._movers, self._rows, self._works = line.movers, [()] * len(line.movers), {}
            news = PosesNews(table=self._table, movers=line.movers, robots=line.robots, source=self._source, alive=True)
        self._works.update(line.robots)
        start = 0
        for i in line.moved:
            end = start + self._movers[i].numbers
            self._rows[i] = line.values[start:end]
            start = end
        frame = self._frame(line.moved, line.values)
        self._publish_tick([_text(news), frame] if news != _NO_NEWS else [frame], alive=True)

    def _frame(self, moved: Iterable[int], values: Iterable[float]) -> bytes:
        indices = array("I", moved)
        return _HEADER.pack(self._clock, self._time, self._table, len(indices)) + indices.tobytes() + array("f", values).tobytes()

    def _publish_tick(self, news: list[Message], *, alive: bool) -> None:
        self._alive, self._news, self._whole = alive, news, None
        self._tick += 1
        self._wake.set()
        self._wake = asyncio.Event()


def _text(news: PosesNews) -> str:
    return msgspec.json.encode(news).decode()


_NO_NEWS = PosesNews()
