"""Requests of a vehicle for zones and corridors (3.0, 6.4.3 and 6.9): what traffic has granted is what it gets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from somrs.adapters.vda5050.control.exchange import Refused, Send
from somrs.adapters.vda5050.control.listener import Listener
from somrs.adapters.vda5050.control.novelty import Novelty
from somrs.adapters.vda5050.control.outbox import RESEND, Outbox
from somrs.adapters.vda5050.messages.header import Topic, timestamp_of
from somrs.adapters.vda5050.messages.orders import GrantType, Response, Responses, Trajectory, Zone, ZoneSetContent, ZoneType
from somrs.adapters.vda5050.messages.states import EdgeRequest, RequestStatus, State, ZoneRequest
from somrs.adapters.vda5050.shapes import Point, comes_near, curve_points, distance_to_line, points_along
from somrs.devices.road_robot import Way

LEASE = 30.0
"""Seconds for which something is granted; it is renewed when half of them are over."""

REMINDER = 30.0
"""Seconds after which a vehicle that still asks is told again that it has to wait, or that it gets nothing."""

MOST_CONTROL_POINTS, HIGHEST_DEGREE, LONGEST_PATH = 1000, 10, 2000.0
"""Of a path that a vehicle may ask for; the length in metres."""
STRAY = 0.15
"""How far from its granted way a path may lead that the vehicle plans, m."""


@dataclass(kw_only=True)
class Answer:
    """What was answered, and until when it holds; `sending_time`: when it was said last."""

    grant_type: GrantType
    sending_time: float
    expiry: float = 0.0


class Requests:
    """`zone_sets`: those that the vehicle was given, by id."""

    def __init__(self, vehicle: Listener, outbox: Outbox) -> None:
        self._vehicle, self._outbox = vehicle, outbox
        self.zone_sets: dict[str, ZoneSetContent] = {}
        self._answers: dict[str, Answer] = {}
        self._decisions: dict[str, tuple[ZoneRequest | EdgeRequest, Way, tuple[GrantType, str]]] = {}
        """By request id: what was decided, about which request and way. It is so until one of them changes."""
        self._told = Novelty()

    def answer(self, state: State, way: Way, now: float) -> None:
        """Say what has not been said. `way`: what traffic has granted and planned."""
        requests: list[ZoneRequest | EdgeRequest] = [*(state.zone_requests or ()), *(state.edge_requests or ())]
        ids = {request.request_id for request in requests}
        self._answers = {key: answer for key, answer in self._answers.items() if key in ids}
        self._decisions = {key: decision for key, decision in self._decisions.items() if key in ids}
        responses = []
        for request in requests:
            if request.request_status in (RequestStatus.REVOKED, RequestStatus.EXPIRED):
                self._answers.pop(request.request_id, None)  # it makes another request to go on
                continue
            grant_type, reason = self._current_decision(request, way)
            previous = self._answers.get(request.request_id)
            if self._is_to_be_revoked(request, previous, grant_type):
                grant_type = GrantType.REVOKED
            elif grant_type is GrantType.REJECTED and self._told.is_new(reason):
                self._outbox.add(Refused(description=reason))
            if self._is_due(previous, grant_type, request, now):
                responses.append(self._response(request.request_id, grant_type, now))
        if responses:
            self._outbox.add(Send(topic=Topic.RESPONSES, message=Responses(responses=tuple(responses))))

    def _is_to_be_revoked(self, request: ZoneRequest | EdgeRequest, previous: Answer | None, grant_type: GrantType) -> bool:
        """Whether the vehicle has what it gets no longer. What was revoked once is not granted again."""
        if previous is not None and previous.grant_type is GrantType.REVOKED:
            return True
        is_granted = request.request_status is RequestStatus.GRANTED or (previous is not None and previous.grant_type is GrantType.GRANTED)
        return is_granted and grant_type is not GrantType.GRANTED

    def _is_due(self, previous: Answer | None, grant_type: GrantType, request: ZoneRequest | EdgeRequest, now: float) -> bool:
        if previous is None or previous.grant_type is not grant_type:
            return True
        silence = now - previous.sending_time
        match grant_type:
            case GrantType.GRANTED:
                is_unseen = request.request_status is RequestStatus.REQUESTED and silence >= RESEND
                return is_unseen or now >= previous.expiry - LEASE / 2
            case GrantType.REVOKED:
                return silence >= RESEND
            case _:
                return silence >= REMINDER

    def _response(self, request_id: str, grant_type: GrantType, now: float) -> Response:
        """The lease is over at a time of the vehicle's clock, which may be another one than that of this program."""
        is_granted = grant_type is GrantType.GRANTED
        self._answers[request_id] = Answer(grant_type=grant_type, sending_time=now, expiry=now + LEASE)
        expiry = timestamp_of(now + LEASE + self._vehicle.clock_lead) if is_granted else None
        return Response(request_id=request_id, grant_type=grant_type, lease_expiry=expiry)

    def _current_decision(self, request: ZoneRequest | EdgeRequest, way: Way) -> tuple[GrantType, str]:
        decided = self._decisions.get(request.request_id)
        if decided is None or decided[0] != request or decided[1] is not way:
            decided = self._decisions[request.request_id] = request, way, self._decision(request, way)
        return decided[2]

    def _decision(self, request: ZoneRequest | EdgeRequest, way: Way) -> tuple[GrantType, str]:
        """What a request gets, and why if it gets nothing."""
        if isinstance(request, EdgeRequest):
            return GrantType.REJECTED, f"asks to leave the line of {request.edge_id}: fleet control gives no corridors"
        name = f"{request.zone_id} of {request.zone_set_id}"
        zone_set = self.zone_sets.get(request.zone_set_id)
        zone = next((zone for zone in zone_set.zones if zone.zone_id == request.zone_id), None) if zone_set is not None else None
        if zone_set is None or zone is None:
            return GrantType.REJECTED, f"asks for the zone {name}, which fleet control has not made"
        granted, planned = self._lines(zone_set.map_id, way)
        if request.request_type == "REPLANNING":
            return self._path_decision(request, zone, granted, planned)
        if zone.zone_type != ZoneType.RELEASE:
            return GrantType.REJECTED, f"asks for access to the zone {name}, which is {zone.zone_type}"
        outline, reach = [(vertex.x, vertex.y) for vertex in zone.vertices], self._vehicle.reach
        if comes_near(granted, outline, reach):
            return GrantType.GRANTED, ""
        if comes_near(planned, outline, reach):
            return GrantType.QUEUED, ""
        return GrantType.REJECTED, f"asks for the zone {name}, which is not on its way"

    def _path_decision(self, request: ZoneRequest, zone: Zone, granted: list[Point], planned: list[Point]) -> tuple[GrantType, str]:
        name = f"{request.zone_id} of {request.zone_set_id}"
        if zone.zone_type != ZoneType.COORDINATED_REPLANNING:
            return GrantType.REJECTED, f"asks for a path through the zone {name}, which is {zone.zone_type}"
        if request.trajectory is None:
            return GrantType.REJECTED, f"asks for a path through the zone {name}, and does not say which"
        try:
            path = self._ahead([*points_along(_path(request.trajectory))], request)
        except ValueError as error:
            return GrantType.REJECTED, f"asks for a path through the zone {name}: {error}"
        if all(distance_to_line(point, granted) <= STRAY for point in path):
            return GrantType.GRANTED, ""
        if all(distance_to_line(point, [*granted, *planned]) <= STRAY for point in path):
            return GrantType.QUEUED, ""
        return GrantType.REJECTED, f"asks for a path through the zone {name} that leaves its way"

    def _ahead(self, path: list[Point], request: ZoneRequest) -> list[Point]:
        """What of a path is before the vehicle, which is on it when the path is granted."""
        vehicle, zone_set = self._vehicle, self.zone_sets[request.zone_set_id]
        if request.request_status is not RequestStatus.GRANTED or vehicle.pose is None or vehicle.map_id != zone_set.map_id:
            return path
        place = vehicle.frames.frame(vehicle.map_id).from_site(vehicle.pose.x, vehicle.pose.y)
        return path[min(range(len(path)), key=lambda index: math.dist(path[index], place)) :]

    def _lines(self, map_id: str, way: Way) -> tuple[list[Point], list[Point]]:
        """The lines on a map of the vehicle that traffic has granted, from where the vehicle is, and those that are planned after them."""
        vehicle, granted, planned = self._vehicle, list[Point](), list[Point]()
        if vehicle.pose is not None and vehicle.map_id == map_id:
            granted.append(vehicle.frames.frame(map_id).from_site(vehicle.pose.x, vehicle.pose.y))
        for waypoint in way:
            frame = vehicle.frames.frame_at(waypoint.level, vehicle.map_id)
            if frame.map_id != map_id:
                continue
            point = frame.from_site(waypoint.x, waypoint.y)
            if waypoint.released:
                granted.append(point)
            else:
                planned = planned or granted[-1:]
                planned.append(point)
        return granted, planned


def _path(trajectory: Trajectory) -> list[Point]:
    """The points of a path for which a vehicle asks. Raises ValueError when it is none, or when it would take long to look at."""
    if len(trajectory.control_points) > MOST_CONTROL_POINTS or (trajectory.degree or 1) > HIGHEST_DEGREE:
        raise ValueError(f"it has more than {MOST_CONTROL_POINTS} control points, or a higher degree than {HIGHEST_DEGREE}")
    path = curve_points(trajectory)
    if sum(math.dist(start, end) for start, end in pairwise(path)) > LONGEST_PATH:
        raise ValueError(f"it is longer than {LONGEST_PATH:g} m")
    return path
