"""The lanes of a map: straight ways between waypoints on which robots drive, as building files have them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from msgspec import Struct

from somrs.ontology.map import Map
from somrs.ontology.objects import Change, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import Ontology, Value
from somrs.ontology.values import value_of

LANE_RELATIONS = ("startsAt", "endsAt")
FORWARD, BACKWARD = "Forward", "Backward"


class Waypoint(Struct, frozen=True, kw_only=True):
    """A waypoint, with its coordinates on the map in metres. `level`: its height. `lift`: in whose cabin it is. `mutex`: all that has this
    text is used by one robot at a time. `passthrough`: robots are not to stop there."""

    name: str
    x: float
    y: float
    level: float = 0.0
    lift: str | None = None
    mutex: str | None = None
    passthrough: bool = False


class MapLane(Struct, frozen=True, kw_only=True):
    """A lane of a map. `graph`: the navigation graph that it belongs to; one of none is for all robots. `speed_limit`: in metres per
    second. `travel`: Forward or Backward, if a robot may not choose."""

    name: str
    start: Waypoint
    end: Waypoint
    graph: str | None = None
    bidirectional: bool = False
    speed_limit: float | None = None
    travel: str | None = None
    mutex: str | None = None

    @property
    def length(self) -> float:
        """Seen from above, in metres."""
        return math.dist((self.start.x, self.start.y), (self.end.x, self.end.y))


def lanes_of(map: Map, ontology: Ontology) -> tuple[MapLane, ...]:
    """The lanes between two waypoints with positions, by name."""
    lifts = {fact.arguments[0]: fact.arguments[1] for fact in map.facts("isIn") if _is_lift(fact.arguments[1], map, ontology)}
    starts, ends = ({fact.arguments[0]: fact.arguments[1] for fact in map.facts(relation)} for relation in LANE_RELATIONS)
    waypoints = {name: _waypoint(name, lifts.get(name), map, ontology) for name in {*starts.values(), *ends.values()}}
    return (*_lanes(starts, ends, waypoints, map, ontology),)


def _lanes(
    starts: dict[str, str], ends: dict[str, str], waypoints: dict[str, Waypoint | None], map: Map, ontology: Ontology
) -> Iterator[MapLane]:
    for name in sorted(starts.keys() & ends.keys()):
        start, end = waypoints[starts[name]], waypoints[ends[name]]
        if start is None or end is None:
            continue
        speed_limit = value_of(name, "SpeedLimit", map, ontology)
        yield MapLane(
            name=name,
            start=start,
            end=end,
            graph=_text(value_of(name, "NavigationGraph", map, ontology)),
            bidirectional=value_of(name, "Bidirectional", map, ontology) is True,
            speed_limit=float(speed_limit) if isinstance(speed_limit, float | int) and speed_limit > 0 else None,
            travel=_text(value_of(name, "Travel", map, ontology)),
            mutex=_text(value_of(name, "Mutex", map, ontology)),
        )


def concerns_lanes(change: Change, map: Map, ontology: Ontology) -> bool:
    """Whether a change concerns the lanes. `map`: one that has the object that it concerns."""
    match change:
        case FactAdded(fact) | FactRemoved(fact):
            return fact.relation in LANE_RELATIONS
        case ObjectAdded(Object(name=name)) | ObjectRemoved(name) | ValueSet(name):
            object = map.objects.get(name)
            return object is not None and any(ontology.is_subtype(object.type, type) for type in ("Lane", "Waypoint"))
    return False


def graph_of(graph: str | None, lanes: Iterable[MapLane]) -> str | None:
    """The graph whose lanes a robot of this navigation graph uses; None if there are no lanes of it: it then uses only those of no graph,
    which are for all robots."""
    return graph if any(lane.graph == graph for lane in lanes) else None


def lanes_for(graph: str | None, lanes: Iterable[MapLane]) -> list[MapLane]:
    """The lanes for robots of a graph."""
    return [lane for lane in lanes if lane.graph in (graph, None)]


def _waypoint(name: str, lift: str | None, map: Map, ontology: Ontology) -> Waypoint | None:
    x, y, level = (_metres(value_of(name, path, map, ontology)) for path in ("PositionX", "PositionY", "PositionZ"))
    if x is None or y is None:
        return None
    passthrough = value_of(name, "PassthroughPoint", map, ontology) is True
    mutex = _text(value_of(name, "Mutex", map, ontology))
    return Waypoint(name=name, x=x, y=y, level=level or 0.0, lift=lift, mutex=mutex, passthrough=passthrough)


def _is_lift(name: str, map: Map, ontology: Ontology) -> bool:
    return name in map.objects and ontology.is_subtype(map.objects[name].type, "Lift")


def _metres(value: Value | None) -> float | None:
    return float(value) if isinstance(value, float | int) and not isinstance(value, bool) and math.isfinite(value) else None


def _text(value: Value | None) -> str | None:
    return None if value is None or value == "" else str(value)
