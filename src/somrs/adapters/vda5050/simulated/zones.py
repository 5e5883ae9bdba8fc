"""How a simulated vehicle heeds zones (3.0, 6.4): it asks before it enters some, and does not enter others."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import msgspec
from msgspec import Struct

from somrs.adapters.vda5050.messages.header import seconds_of
from somrs.adapters.vda5050.messages.orders import (
    ControlPoint,
    Edge,
    GrantType,
    Node,
    Responses,
    Trajectory,
    Zone,
    ZoneSetContent,
    ZoneType,
)
from somrs.adapters.vda5050.messages.states import RequestStatus, ZoneRequest
from somrs.adapters.vda5050.shapes import Point, comes_near, distance
from somrs.adapters.vda5050.simulated.problems import Problem
from somrs.adapters.vda5050.simulated.zone_actions import ZoneActionLog

SUPPORTED = tuple(
    zone_type.value
    for zone_type in (
        ZoneType.BLOCKED, ZoneType.LINE_GUIDED, ZoneType.RELEASE, ZoneType.COORDINATED_REPLANNING, ZoneType.SPEED_LIMIT, ZoneType.DIRECTED,
        ZoneType.ACTION,
    )
)  # fmt: skip


class Stretch(Struct, frozen=True, kw_only=True):
    """The line to a node of the base, and the zones that the vehicle touches on it."""

    start: Point
    end: Point
    node: Node
    edge: Edge
    zones: tuple[Zone, ...]


@dataclass(kw_only=True)
class PendingRequest:
    """A request, and how it was answered. `covers`: the sequence ids of the nodes to which the path of a request leads."""

    request: ZoneRequest
    covers: frozenset[int] = frozenset()
    expiry: float = math.inf


@dataclass(kw_only=True)
class ZoneGuard:
    """`contour`: how far the vehicle extends around its middle, in metres."""

    contour: float
    pending: list[PendingRequest] = field(default_factory=list)
    actions: ZoneActionLog = field(default_factory=ZoneActionLog)
    _zones: ZoneSetContent | None = None
    _position: Point = (0.0, 0.0)
    _laid_out: tuple[Stretch, ...] = ()
    _stretches: tuple[Stretch, ...] = ()
    """Those to come: of the first, the rest of it."""
    _key: object = None
    _refused: set[str] = field(default_factory=set)
    _numbers: itertools.count[int] = field(default_factory=lambda: itertools.count(1))

    @property
    def requests(self) -> tuple[ZoneRequest, ...]:
        return tuple(pending.request for pending in self.pending)

    def look(
        self, zones: ZoneSetContent | None, map_id: str, position: Point, nodes: Sequence[Node], edges: Sequence[Edge], now: float
    ) -> None:
        """Take in where the vehicle is, and what is to come of its base. Makes requests, and drops those that are over."""
        self._position = position
        base = tuple(node.sequence_id for node in nodes if node.released)
        key = zones.zone_set_id if zones is not None else None, map_id, base, nodes[0].node_id if nodes else None
        if key != self._key:
            self._key, self._zones, self._refused = key, zones, set()
            self._laid_out = tuple(self._lay_out(map_id, nodes, edges))
        on_map = zones.zones if zones is not None and zones.map_id == map_id else ()
        self.actions.move({zone.zone_id: zone for zone in on_map if zone.zone_type == ZoneType.ACTION and self._covers(zone)})
        self._stretches = tuple(self._rest(stretch) if index == 0 else stretch for index, stretch in enumerate(self._laid_out))
        for pending in self.pending:
            if pending.request.request_status is RequestStatus.GRANTED and now > pending.expiry:
                pending.request = msgspec.structs.replace(pending.request, request_status=RequestStatus.EXPIRED)
        self.pending = [pending for pending in self.pending if self._is_of_use(pending)]
        self._ask_for_access()
        self._ask_for_path()

    def respond(self, responses: Responses) -> None:
        """Take in what fleet control answers."""
        for response in responses.responses:
            pending = next((pending for pending in self.pending if pending.request.request_id == response.request_id), None)
            if pending is None:
                continue
            match response.grant_type:
                case GrantType.GRANTED if pending.request.request_status in (RequestStatus.REQUESTED, RequestStatus.GRANTED):
                    pending.request = msgspec.structs.replace(pending.request, request_status=RequestStatus.GRANTED)
                    pending.expiry = (seconds_of(response.lease_expiry) if response.lease_expiry else None) or math.inf
                case GrantType.REVOKED if self._is_inside(pending.request.zone_id):
                    pending.request = msgspec.structs.replace(pending.request, request_status=RequestStatus.REVOKED)
                case GrantType.REJECTED | GrantType.REVOKED:
                    self.pending.remove(pending)
                    self._refused.add(pending.request.zone_id)

    def clear(self) -> None:
        """Drop all requests: the order was cleared, or somebody drives by hand (3.0, 6.6.7)."""
        self.pending = []

    def errors(self) -> list[tuple[Problem, str]]:
        """What is wrong about where the vehicle is."""
        problems = []
        for zone in self._zones.zones if self._zones is not None else ():
            if zone.zone_type == ZoneType.BLOCKED and self._is_inside(zone.zone_id):
                problems.append((Problem.BLOCKED_ZONE, zone.zone_id))
            if zone.zone_type == ZoneType.RELEASE and zone.release_loss_behavior != "CONTINUE" and self._has_lost(zone):
                problems.append((Problem.RELEASE_LOST, zone.zone_id))
        return problems

    def obstacle(self) -> str | None:
        """Why the vehicle cannot drive to the next node at all; None if it can."""
        return self._obstacle(self._stretches[0]) if self._stretches else None

    def _obstacle(self, stretch: Stretch) -> str | None:
        for zone in stretch.zones:
            if zone.zone_type == ZoneType.BLOCKED:
                return f"the zone {zone.zone_id} is blocked"
            if zone.zone_type == ZoneType.LINE_GUIDED and stretch.edge.trajectory is None:
                return f"the zone {zone.zone_id} is for vehicles on trajectories, and {stretch.edge.edge_id} has none"
            if zone.zone_type == ZoneType.DIRECTED and self._is_against(stretch, zone):
                return f"the zone {zone.zone_id} is driven in the other direction"
        return None

    def open_nodes(self) -> int:
        """To how many of the nodes to come the vehicle may drive now. One that it cannot reach at all is the next one when that is said."""
        for index, stretch in enumerate(self._stretches):
            if (index and self._obstacle(stretch)) or not all(self._is_open(zone, stretch) for zone in stretch.zones):
                return index
        return len(self._stretches)

    @property
    def is_closed(self) -> bool:
        """Whether the vehicle may not drive to the next node now."""
        return bool(self._stretches) and self.open_nodes() == 0

    def speed_limit(self, count: int) -> float:
        """The highest speed on the way to so many nodes, m/s."""
        zones = [zone for stretch in self._stretches[:count] for zone in stretch.zones if zone.zone_type == ZoneType.SPEED_LIMIT]
        return min((zone.maximum_speed for zone in zones if zone.maximum_speed is not None), default=math.inf)

    def _lay_out(self, map_id: str, nodes: Sequence[Node], edges: Sequence[Edge]) -> list[Stretch]:
        stretches, start = [], self._position
        for node, edge in zip(nodes, edges, strict=False):
            position = node.node_position
            if not node.released or position is None or position.map_id != map_id:
                break
            end = position.x, position.y
            zones = tuple(zone for zone in (self._zones.zones if self._zones is not None else ()) if self._touches(zone, start, end))
            stretches.append(Stretch(start=start, end=end, node=node, edge=edge, zones=zones))
            start = end
        return stretches

    def _rest(self, stretch: Stretch) -> Stretch:
        """What of a stretch is ahead of the vehicle."""
        zones = tuple(zone for zone in stretch.zones if self._touches(zone, self._position, stretch.end))
        return msgspec.structs.replace(stretch, start=self._position, zones=zones)

    def _touches(self, zone: Zone, start: Point, end: Point) -> bool:
        is_for_centre = zone.zone_type in (ZoneType.DIRECTED, ZoneType.BIDIRECTED, ZoneType.PRIORITY, ZoneType.PENALTY)
        return comes_near([start, end], _outline(zone), 0.0 if is_for_centre else self.contour)

    def _is_inside(self, zone_id: str) -> bool:
        zones = self._zones.zones if self._zones is not None else ()
        return any(zone.zone_id == zone_id and self._covers(zone) for zone in zones)

    def _covers(self, zone: Zone) -> bool:
        return distance(_outline(zone), self._position) <= self.contour

    def _has_lost(self, zone: Zone) -> bool:
        lost = (RequestStatus.EXPIRED, RequestStatus.REVOKED)
        is_lost = any(pending.request.zone_id == zone.zone_id and pending.request.request_status in lost for pending in self.pending)
        return is_lost and self._is_inside(zone.zone_id)

    def _is_against(self, stretch: Stretch, zone: Zone) -> bool:
        travel = math.atan2(stretch.end[1] - stretch.start[1], stretch.end[0] - stretch.start[0])
        return math.cos(travel - (zone.direction or 0.0)) < 0.0

    def _is_open(self, zone: Zone, stretch: Stretch) -> bool:
        if zone.zone_type not in (ZoneType.RELEASE, ZoneType.COORDINATED_REPLANNING):
            return True
        granted = [pending for pending in self.pending if pending.request.zone_id == zone.zone_id and _is_granted(pending)]
        if zone.zone_type == ZoneType.RELEASE:
            may_go_on = zone.release_loss_behavior == "CONTINUE" and self._is_inside(zone.zone_id)
            return bool(granted) or may_go_on
        return any(stretch.node.sequence_id in pending.covers for pending in granted)

    def _is_of_use(self, pending: PendingRequest) -> bool:
        zone_id = pending.request.zone_id
        if self._zones is None or pending.request.zone_set_id != self._zones.zone_set_id:
            return False
        ahead = [stretch for stretch in self._stretches if any(zone.zone_id == zone_id for zone in stretch.zones)]
        if pending.covers:
            has_newer = any(item is not pending and item.covers > pending.covers and _is_granted(item) for item in self.pending)
            return not has_newer and any(stretch.node.sequence_id in pending.covers for stretch in ahead)
        is_lost = pending.request.request_status in (RequestStatus.EXPIRED, RequestStatus.REVOKED)
        return self._is_inside(zone_id) or (bool(ahead) and not is_lost)

    def _ask_for_access(self) -> None:
        for zone_id in dict.fromkeys(
            zone.zone_id for stretch in self._stretches for zone in stretch.zones if zone.zone_type == ZoneType.RELEASE
        ):
            if zone_id not in self._refused and all(pending.request.zone_id != zone_id for pending in self.pending):
                self.pending.append(PendingRequest(request=self._request(zone_id, "ACCESS")))

    def _ask_for_path(self) -> None:
        """Ask for the whole base, whenever it has grown."""
        zones = {zone.zone_id for stretch in self._stretches for zone in stretch.zones if zone.zone_type == ZoneType.COORDINATED_REPLANNING}
        covers = frozenset(stretch.node.sequence_id for stretch in self._stretches)
        for zone_id in sorted(zones - self._refused):
            if any(pending.request.zone_id == zone_id and pending.covers >= covers for pending in self.pending):
                continue
            points = [self._stretches[0].start, *(stretch.end for stretch in self._stretches)]
            path = Trajectory(
                degree=1,
                knot_vector=(0.0, *(index / (len(points) - 1) for index in range(len(points))), 1.0),
                control_points=tuple(ControlPoint(x=x, y=y) for x, y in points),
            )
            self.pending.append(PendingRequest(request=self._request(zone_id, "REPLANNING", path), covers=covers))

    def _request(self, zone_id: str, request_type: str, trajectory: Trajectory | None = None) -> ZoneRequest:
        assert self._zones is not None, "requests are for zones of the enabled zone set"
        return ZoneRequest(
            request_id=f"request-{next(self._numbers)}",
            request_type=request_type,
            zone_id=zone_id,
            zone_set_id=self._zones.zone_set_id,
            request_status=RequestStatus.REQUESTED,
            trajectory=trajectory,
        )


def _is_granted(pending: PendingRequest) -> bool:
    return pending.request.request_status is RequestStatus.GRANTED


def _outline(zone: Zone) -> list[Point]:
    return [(vertex.x, vertex.y) for vertex in zone.vertices]
