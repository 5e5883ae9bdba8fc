"""A simulated robot in traffic: it drives where it is granted places, and says where it is.

`Participant` keeps the protocol's numbers; here names of places become points, and points beside the roadmap become berths.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.traffic import Berth, Granted, Mobility, TrafficEntered, TripEnded
from somrs.space.solids import Point
from somrs.traffic.berths import SPEED
from somrs.traffic.participant import Participant
from somrs.traffic.roadmap import Lane, NumberedRoadmap, Place, RobotKind
from somrs.traffic.surroundings import TOLERANCE

LEASE = 10.0
"""The lease of a robot's places, in simulated seconds."""
AT_PLACE = 0.02
"""A robot that is this near to a place is there, m."""
ASTRAY = 0.1
"""A robot that is farther from its place than this enters anew, m."""
REMEMBERED = 8
"""How many of the last berths are remembered at least: grants may come that were planned for an earlier destination."""

Points = NDArray[np.float64]
Sees = Callable[[Point, Point], bool]
"""Whether a robot can drive from one point to another in a straight line."""


class Office(Protocol):
    """Where traffic takes messages."""

    roadmap: NumberedRoadmap

    def tell(self, robot: str, body: Body) -> Body | None:
        """Send a message of a robot. Returns the answer."""

    def occupant(self, robot: str) -> str | None:
        """The robot that works where the trip of this one leads; None if there is none."""

    @property
    def is_held(self) -> bool:
        """Whether nobody is granted a way."""

    def is_awaited(self, robot: str) -> bool:
        """Whether others wait for places that this robot holds."""

    def driving_times(self, robot: str) -> NDArray[np.float64]:
        """By place: how long the way there takes a robot that takes part, in seconds; infinite where none leads now."""

    def is_blocked(self, points: Points, level: float, radius: float, spacing: float) -> NDArray[np.bool_]:
        """Whether robots that cannot move are too near to points (n, 2) on a floor for a robot of this radius, whose places have this
        spacing, in metres."""

    @property
    def levels(self) -> Collection[float]:
        """The heights of the floors."""

    def landing(self, robot: str, level: float, goal: Point) -> str | None:
        """A place on the floor of a height, clear of the lift, to which the robot comes on its way to a point there; None if no way leads
        there."""


class RoadUser:
    """A robot's part in traffic."""

    def __init__(self, robot: str, kind: RobotKind, level: float, office: Office) -> None:
        self.robot, self.office = robot, office
        self.level = level
        """The height of its floor, as the roadmap has it, m."""
        self.kind = kind
        self._participant: Participant | None = None
        self._berths: dict[str, Berth] = {}
        self._count = 0
        self._trip: str | None = None
        self.mobility = Mobility.FREE
        self.ended: TripEnded | None = None
        """How the last trip ended; None while there is one, and after one that was refused or given up."""
        self.refusal = ""
        """Why it does not take part."""

    # Entering

    @property
    def takes_part(self) -> bool:
        return self._participant is not None

    def enter(self, position: Point, sees: Sees) -> bool:
        """Take part from where the robot is, unless it is where it is known to be. Returns whether it does."""
        participant = self._participant
        if participant is not None and (participant.towards is not None or math.dist(self.point(participant.place), position) <= ASTRAY):
            return True
        self._participant = None
        return self._enter_at(self.stop_at(position, sees))

    def _enter_at(self, stop: Berth | str | None) -> bool:
        """Enter at a place or a berth. Returns whether traffic lets it; None is refused."""
        if stop is None:
            self.refusal = f"{self.robot} stands where it sees no place of the roadmap"
            return False
        return self._enter(Participant(self.robot, stop.name if isinstance(stop, Berth) else stop))

    def _enter(self, participant: Participant) -> bool:
        """Enter, which ends the trip. Returns whether traffic lets it."""
        self._trip = None
        berths = tuple(self._berths[name] for name in (participant.place, participant.towards) if name in self._berths)
        answer = self.office.tell(self.robot, participant.enter(LEASE, berths, self.mobility))
        if isinstance(answer, Fault):
            self.refusal = answer.text
        if not isinstance(answer, TrafficEntered):
            return False
        participant.entered(answer)
        self._participant = participant
        return True

    def stay(self, position: Point, sees: Sees) -> None:
        """The robot cannot move any more: say where exactly it is, so that others come as near as they can.

        While another one is too near for that, it keeps the places between which it is, and gives back the others.
        """
        self.mobility, participant, self._participant = Mobility.IMMOBILE, self._participant, None
        if not self.enter(position, sees) and participant is not None:
            self._participant, participant.way = participant, ()
            self.report()

    def give_back(self, position: Point, sees: Sees) -> None:
        """A passage on the way to the next place is shut: give back what was granted. From a berth, there may be other ways."""
        assert self._participant is not None, "only who takes part is granted places"
        if self._participant.place in self._berths:
            self.look_again(position, sees)
        else:
            self._return_way()

    def _return_way(self) -> None:
        self.set_mobility(Mobility.BUSY)
        self.set_mobility(Mobility.FREE)

    def look_again(self, position: Point, sees: Sees) -> bool:
        """Something stands in the way to the next place: give back what was granted, and drive only to places that are in sight from here.

        Between two places, the robot turns round. Returns False if it can drive nowhere.
        """
        participant = self._participant
        assert participant is not None, "only who takes part is granted places"
        if participant.towards is not None and sees(position, self.point(participant.place)):
            return self._enter(Participant(self.robot, participant.towards, participant.place))
        if self.zone is not None or self.next_zone is not None:  # a berth might be outside of the lift in which the robot is
            self._return_way()
            return participant.towards is None
        berth = self.stop_at(position, sees) if participant.towards is not None else self._berth_instead(participant.place, position, sees)
        self._participant = None
        return self._enter_at(berth)

    def enter_again(self) -> None:
        """Take part again after a silence, from the same place."""
        participant, self._participant = self._participant, None
        if participant is not None:
            self._enter(Participant(self.robot, participant.place, participant.towards))

    def stop_at(self, position: Point, sees: Sees) -> Berth | str | None:
        """The place at a position, or a berth there; None if no place is in sight."""
        near_places = self._near_places(position)
        distance, nearest = next(iter(near_places), (math.inf, ""))
        return nearest if distance <= AT_PLACE else self._berth(position, near_places, partial(sees, position))

    def _berth_instead(self, place: str, position: Point, sees: Sees) -> Berth | None:
        """A berth where a place is, which leads to the other places that are in sight from the robot's position there."""
        point = self.point(place)
        return self._berth(point, [entry for entry in self._near_places(point) if entry[1] != place], partial(sees, position))

    def _berth(self, point: Point, near_places: Iterable[tuple[float, str]], is_in_sight: Callable[[Point], bool]) -> Berth | None:
        """A berth that leads to those of the places that are in sight; None if there are none."""
        places = tuple(name for _, name in near_places if is_in_sight(self._points_of(name)))
        if not places:
            return None
        self._count += 1
        berth = Berth(name=f"{self.robot}/{self._count}", x=point[0], y=point[1], radius=self.kind.radius, places=places)
        self._remember(berth)
        return berth

    def _near_places(self, point: Point) -> list[tuple[float, str]]:
        """The places for robots of this kind to which a lane from a point may lead: their distances from it, and names; nearest first."""
        roadmap, kind = self.office.roadmap, self.office.roadmap.kind_for(self.kind)
        return sorted(
            (distance, place.name)
            for number in roadmap.near(point, self.level)
            if (place := roadmap.roadmap.places[number]).kind == kind
            and (distance := math.dist((place.x, place.y), point)) <= roadmap.spacing(number) + TOLERANCE
        )

    def driving_times(self, points: Points, are_in_sight: Callable[[Points, Points], NDArray[np.bool_]]) -> NDArray[np.float64]:
        """How long the ways to points (n, 2) on this floor take the robot, in seconds; infinite where none leads now.

        `are_in_sight`: whether it can drive in straight lines from places (n, 2) to points (n, 2).
        """
        roadmap, times = self.office.roadmap, np.full(len(points), math.inf)
        numbers, places = roadmap.layer(self.level, self.kind).near(points)
        if not len(places):
            return times
        blocked = self.office.is_blocked(points, self.level, self.kind.radius, roadmap.spacing(int(places[0])))
        place_times = self.office.driving_times(self.robot)[places]
        is_reached = np.isfinite(place_times)
        numbers, places, place_times = numbers[is_reached], places[is_reached], place_times[is_reached]
        place_points = roadmap.points[places]
        clear = are_in_sight(place_points, points[numbers])
        last_metres = np.hypot(*(place_points - points[numbers]).T)
        np.minimum.at(times, numbers[clear], (place_times + last_metres / SPEED)[clear])
        times[blocked] = math.inf
        return times

    def _remember(self, berth: Berth) -> None:
        """Keep a berth, and of the earlier ones those that may still occur in grants: where the robot is, and the last destinations."""
        participant = self._participant
        used_names = (participant.place, participant.towards, *participant.way) if participant is not None else ()
        recent_names = [*self._berths][-REMEMBERED:]
        self._berths = {name: known_berth for name, known_berth in self._berths.items() if name in used_names or name in recent_names}
        self._berths[berth.name] = berth

    # Trips

    def begin(self, stop: Berth | str) -> str | None:
        """Ask for a trip. Returns why it is refused; None if it is not."""
        assert self._participant is not None, "a robot enters first"
        self._count += 1
        self._trip, self.ended = f"{self.robot}/trip{self._count}", None
        answer = self.office.tell(self.robot, self._participant.request(self._trip, stop))
        if not isinstance(answer, Fault):
            return None
        self._trip = None
        return answer.text

    def cancel(self) -> None:
        """Give the trip up, if there is one."""
        if self._participant is not None and self._trip is not None and self.ended is None:
            self.office.tell(self.robot, self._participant.cancel(self._trip))
        self._trip = None

    @property
    def is_travelling(self) -> bool:
        """Whether it has a trip that has not ended."""
        return self._trip is not None and self.ended is None

    def receive(self, body: Body) -> None:
        """A message from traffic."""
        match body:
            case Granted() if self._participant is not None:
                self._participant.granted(body)
            case TripEnded() if body.trip == self._trip:
                self.ended = body

    # Driving

    def depart(self) -> Point | None:
        """The point to which the robot may drive next; None if it has to wait."""
        if self._participant is None:
            return None
        place = self._participant.towards or self._participant.depart()
        return self.point(place) if place is not None else None

    @property
    def next_place(self) -> Point | None:
        """The point of the next place that was granted, before the robot departs to it."""
        return self.point(self._next) if self._next is not None else None

    @property
    def _next(self) -> str | None:
        if self._participant is None:
            return None
        return self._participant.towards or next(iter(self._participant.way), None)

    @property
    def zone(self) -> str | None:
        """The zone in which the robot is, such as a lift."""
        return self._zone_of(self._participant.place) if self._participant is not None else None

    @property
    def next_zone(self) -> str | None:
        """The zone of the next place."""
        return self._zone_of(self._next) if self._next is not None else None

    @property
    def next_level(self) -> float:
        """The height of the floor of the next place, m."""
        return self._level_of(self._next) if self._next is not None else self.level

    @property
    def rules(self) -> tuple[Lane | None, Lane | None]:
        """The lanes on which it is and on which it may drive next, as far as there are rules for driving on them."""
        participant = self._participant
        if participant is None or participant.towards is None:
            return None, None
        following = next(iter(participant.way), None)
        return self._rules(participant.place, participant.towards), self._rules(participant.towards, following)

    def _rules(self, start: str, end: str | None) -> Lane | None:
        numbers = self.office.roadmap.numbers
        return self.office.roadmap.rules.get((numbers[start], numbers[end])) if start in numbers and end in numbers else None

    @property
    def is_on_its_way(self) -> bool:
        """Whether it is between two places."""
        return self._participant is not None and self._participant.towards is not None

    @property
    def has_to_make_room(self) -> bool:
        """Whether it was granted a way, or stands between two places while others wait for it."""
        participant = self._participant
        return participant is not None and (
            bool(participant.way) or (participant.towards is not None and self.office.is_awaited(self.robot))
        )

    @property
    def ahead(self) -> list[Point]:
        """The points after the next one, up to which the robot may drive."""
        return [self.point(place) for place in self._participant.way] if self._participant is not None else []

    def arrive(self) -> None:
        """The robot has come to the next place."""
        assert self._participant is not None, "only who takes part is granted places"
        self._participant.arrive()
        self.level = self._level_of(self._participant.place)
        self.report()

    def report(self) -> None:
        """Say where the robot is, and keep its places."""
        if self._participant is not None:
            answer = self.office.tell(self.robot, self._participant.report(self.mobility))
            if isinstance(answer, Fault):
                self.enter_again()

    def set_mobility(self, mobility: Mobility) -> None:
        """Say whether the robot can make room, if that has changed."""
        if mobility is not self.mobility:
            self.mobility = mobility
            if self._participant is not None and mobility is not Mobility.FREE:
                self._participant.way = ()
            self.report()

    def point(self, place: str) -> Point:
        """Where a place or a berth is, m."""
        if place in self._berths:
            return self._berths[place].x, self._berths[place].y
        return self._points_of(place)

    def _points_of(self, place: str) -> Point:
        road_place = self._place(place)
        return road_place.x, road_place.y

    def _place(self, place: str) -> Place:
        return self.office.roadmap.roadmap.places[self.office.roadmap.numbers[place]]

    def _zone_of(self, place: str) -> str | None:
        return None if place in self._berths else self._place(place).zone

    def _level_of(self, place: str) -> float:
        return self.level if place in self._berths else self._place(place).level
