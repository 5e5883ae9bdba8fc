"""The traffic of the robots: the roadmap, the ways that they were granted, and who waits for whom and why."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, nullcontext

import msgspec

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.api.simulator_gateway import answering
from somrs.api.traffic_reader import TrafficReader, reader_of
from somrs.api.waiting import waiting_text, waits_for
from somrs.client.addresses import Addresses
from somrs.client.operations import operation
from somrs.client.refusals import ErrorReport, NotFound, error_report
from somrs.client.simulator_link import operator_link
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.link.roads import Roadmap, RoadPoint, RobotInTraffic, TrafficState
from somrs.errors import SomrsError

TICK = 1.0
"""Seconds between two looks at traffic while a client follows it."""


class RobotTraffic(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A robot in traffic. Points are x, y and the height of the floor, in metres.

    `granted`: the way along which it may drive, from the last place that it has come to; `planned`: on from there, as far as it is planned;
    `destination`: the end of its trip, if it has one. `waits_for`: the robots that have to go first, or the lift; `waiting`: why it stands,
    for users, such as `waits for Robot3, which puts something on Table2`; empty if it does not wait. `lift`: the lift in which it is.
    """

    robot: str
    granted: tuple[RoadPoint, ...] = ()
    planned: tuple[RoadPoint, ...] = ()
    destination: RoadPoint | None = None
    waits_for: tuple[str, ...] = ()
    waiting: str = ""
    lift: str | None = None


class Traffic(msgspec.Struct, frozen=True, kw_only=True):
    """Traffic now, with all robots by name. `roadmap`: the `number` of the roadmap, None without one; read the roadmap again when it is
    another. `hold`: why no robot drives on, such as a fire; empty if they drive."""

    roadmap: int | None = None
    hold: str = ""
    robots: tuple[RobotTraffic, ...] = ()


class TrafficService:
    def __init__(self, context: Context) -> None:
        self._context = context
        self._reader = reader_of(context)
        context.hub.feed("traffic", self._feed)

    @operation("GET", "/traffic", Right.SEE)
    async def read(self) -> Traffic:
        """Where the robots may drive, and who waits for whom and why. In a symbolic world, there are none.

        The topic `traffic` publishes the same whenever it changes, at most once a second.
        """
        async with self._source(answering) as source:
            return view_of(await source.traffic()) if source is not None else Traffic()

    @operation("GET", "/traffic/roadmap", Right.SEE)
    async def roadmap(self) -> Roadmap:
        """The places and lanes on which the robots drive, and which of them are closed now."""
        async with self._source(answering) as source:
            if source is None:
                raise NotFound("this system has a symbolic world, and so no roadmap of robots")
            return await source.roadmap()

    def _source(
        self, connect: Callable[[Addresses], AbstractAsyncContextManager[OperatorLink]]
    ) -> AbstractAsyncContextManager[OperatorLink | TrafficReader | None]:
        """Who is asked about traffic: the simulator, to which `connect` makes a link, or the program of its own; None without both."""
        addresses = self._context.addresses
        return connect(addresses) if addresses.simulator is not None else nullcontext(self._reader)

    async def _feed(self, topic: str) -> None:
        """Publish traffic whenever it changes, or an error report while it cannot be read."""
        published: Traffic | ErrorReport | None = None
        while True:
            try:
                async with self._source(operator_link) as source:
                    while source is not None:
                        traffic = view_of(await source.traffic())
                        if traffic != published:
                            published = traffic
                            self._context.hub.publish(topic, traffic)
                        await asyncio.sleep(TICK)
                    return
            except SomrsError as error:
                if not isinstance(published, ErrorReport):
                    published = error_report(error)
                    self._context.hub.publish(topic, published)
            await asyncio.sleep(TICK)


def view_of(state: TrafficState) -> Traffic:
    """What is known of traffic, for users."""
    robots = tuple(_robot_view(name, robot, state) for name, robot in sorted(state.robots.items()))
    return Traffic(roadmap=state.roadmap, hold=state.hold, robots=robots)


def _robot_view(name: str, robot: RobotInTraffic, state: TrafficState) -> RobotTraffic:
    return RobotTraffic(
        robot=name,
        granted=robot.granted,
        planned=robot.planned,
        destination=robot.destination,
        waits_for=waits_for(robot),
        waiting=waiting_text(robot, state),
        lift=robot.lift if robot.riding else None,
    )
