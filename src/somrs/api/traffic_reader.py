"""Reads the traffic of a building that is not simulated, by messages, as the simulator tells that of its building."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from somrs.api.context import Context
from somrs.client.client import Client
from somrs.client.task_managers import READ_TIME
from somrs.devices.simulator.link.roads import Roadmap, RoadPoint, TrafficState, driving, road_point, undirected
from somrs.protocol.messages.traffic import ReadRoadmap, ReadTraffic, RoadmapPage, RoadmapPlace, TrafficView


class TrafficReader:
    """Asks the program at an address."""

    def __init__(self, client: Client, address: str) -> None:
        self._client, self._address = client, address
        self._edition: int | None = None
        self._points: Mapping[str, RoadPoint] = {}
        """Where the places of the roadmap of this edition are."""

    async def traffic(self) -> TrafficState:
        """Where robots may drive, and whom they wait for. Raises RemoteError."""
        while True:
            view = await self._view()
            if view.edition == self._edition:
                return self._state(view)
            edition, places = await self._places()
            self._edition, self._points = edition, {place.name: road_point(place.x, place.y, place.level) for place in places}

    def _state(self, view: TrafficView) -> TrafficState:
        berths = {berth.name: road_point(berth.x, berth.y, self._points[berth.places[0]][2]) for berth in view.berths}
        points = {**self._points, **berths}
        robots = {robot.robot: driving(robot, points.__getitem__) for robot in view.robots}
        return TrafficState(
            roadmap=view.roadmap,
            robots=robots,
            hold=view.hold,
            closed_lifts=tuple(passage.passage for passage in view.passages if not passage.usable),
            shared_lifts=tuple(passage.passage for passage in view.passages if passage.shared),
        )

    async def roadmap(self) -> Roadmap:
        """The roadmap, and what of it is closed, which may be newer than its number says. Raises RemoteError."""
        while True:
            view = await self._view()
            edition, places = await self._places()
            if view.edition == edition:
                return _roadmap(view.roadmap, places)

    async def _view(self) -> TrafficView:
        return await self._client.ask(self._address, ReadTraffic(), TrafficView, timeout=READ_TIME)

    async def _places(self) -> tuple[int, Sequence[RoadmapPlace]]:
        """The edition of the roadmap, and all its places."""
        places: list[RoadmapPlace] = []
        page = await self._page(0)
        edition = page.edition
        while True:
            places += page.places
            if not page.more:
                return edition, places
            page = await self._page(page.next)
            if page.edition != edition:
                places, edition, page = [], page.edition, await self._page(0)

    async def _page(self, offset: int) -> RoadmapPage:
        return await self._client.ask(self._address, ReadRoadmap(after=offset), RoadmapPage, timeout=READ_TIME)


def reader_of(context: Context) -> TrafficReader | None:
    """Reads the traffic of a building that is not simulated; None if it is, or if there is none."""
    addresses = context.addresses
    return TrafficReader(context.client, addresses.traffic) if addresses.traffic is not None and addresses.simulator is None else None


def last_place(robot: str, traffic: TrafficState) -> tuple[float, ...] | None:
    """The point, in metres, of the last place that a robot in traffic has come to: the map has where it was after its last work. None if
    it takes no part."""
    driving_robot = traffic.robots.get(robot)
    return driving_robot.granted[0] if driving_robot is not None and driving_robot.granted else None


def _roadmap(number: int, places: Sequence[RoadmapPlace]) -> Roadmap:
    positions = {place.name: position for position, place in enumerate(places)}
    directed = {(start, positions[lane.end]): lane for start, place in enumerate(places) for lane in place.lanes}
    closed = {(min(ends), max(ends)) for ends, lane in directed.items() if lane.closed}
    lanes, one_way = undirected(directed)
    return Roadmap(
        number=number,
        places=tuple(road_point(place.x, place.y, place.level) for place in places),
        lanes=lanes,
        one_way=one_way,
        closed_places=tuple(position for position, place in enumerate(places) if place.closed),
        closed_lanes=tuple(position for position, lane in enumerate(lanes) if lane in closed),
    )
