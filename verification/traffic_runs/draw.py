"""Draws a scenario from a seed."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from itertools import pairwise, product
from random import Random

from msgspec import structs

from somrs.protocol.messages.traffic import Berth
from somrs.space.solids import Role, Solid
from somrs.traffic.roadmap import Lane, Place, Roadmap
from verification.traffic_runs.scenario import GateIncident, GateTrouble, Hold, Incident, Scenario, Trouble

RADIUS = 0.3
"""The radius of robots that go to berths, in metres: robots on lanes of 1 m whose ends are 0.9 m apart do not touch each other."""
ISLAND = Place(name="Island", x=100.0, y=100.0)
"""A place to which no lane leads."""
LEVEL = 4.0
"""The height of the second storey, m."""
SPAN = 60.0
"""The time within which things go wrong, in seconds."""


def draw(seed: int) -> Scenario:
    dice = Random(seed)
    roadmap = _roadmap(dice)
    aisle_dice = Random(f"narrow aisle {seed}")
    if aisle_dice.random() < 0.15:
        roadmap = _aisle(aisle_dice)
    rule_dice = Random(f"rules {seed}")
    if rule_dice.random() < 0.3:
        roadmap = _one_way(rule_dice, roadmap)
    names = [place.name for place in roadmap.places]
    count = dice.randint(2, max(2, min(10, len(names) // 3)))
    starts = dice.sample(names, count)
    homes = dice.sample(names, count)
    trips = tuple((*dice.choices(names, k=dice.randint(0, 4)), home) for home in homes)
    berths: tuple[dict[str, Berth], ...] = tuple({} for _ in starts)
    berth_dice = Random(seed)
    if roadmap.spacing > 0 and berth_dice.random() < 0.7:
        berths = tuple(_berths(berth_dice, f"Robot{number}", roadmap) for number in range(count))
        trips = tuple(_mixed(berth_dice, way, own) for way, own in zip(trips, berths, strict=True))
    storey_dice = Random(-1_000_000 - seed)
    if storey_dice.random() < 0.3:
        roadmap, trips = _with_storey(storey_dice, roadmap, trips)
    if rule_dice.random() < 0.3:
        roadmap = _with_rules(rule_dice, roadmap, {*starts, *homes})
    worker = ISLAND.name if Random(-1 - seed).random() < 0.4 else None
    if worker is not None:
        roadmap = structs.replace(roadmap, places=(*roadmap.places, ISLAND))
    gate_dice = Random(f"gates {seed}")
    roadmap = _with_gates(gate_dice, roadmap)
    incidents = tuple(_incident(dice, count) for _ in range(dice.choice((0, 0, 1, 2, 3))))
    return Scenario(
        seed=seed,
        roadmap=roadmap,
        starts=tuple(starts),
        trips=trips,
        berths=berths,
        slowness=tuple(dice.choice((1.0, 1.0, 1.5, 4.0)) for _ in starts),
        work=tuple(dice.choice((0.0, 0.0, 3.0, 15.0)) for _ in starts),
        incidents=incidents,
        worker=worker,
        holds=_holds(Random(f"holds {seed}")),
        gate_incidents=_gate_incidents(gate_dice, roadmap),
    )


def _one_way(dice: Random, roadmap: Roadmap) -> Roadmap:
    """The roadmap with lanes in one direction only, on which robots still get from everywhere to everywhere."""
    lanes = {(lane.start, lane.end): lane for lane in roadmap.lanes}
    for start, end in dice.sample([*lanes], k=len(lanes) // dice.choice((2, 4, 8))):
        if (end, start) in lanes and end in _reached(start, lanes.keys() - {(start, end)}):
            del lanes[start, end]
    return structs.replace(roadmap, lanes=tuple(lanes.values()))


def _reached(start: str, lanes: Collection[tuple[str, str]]) -> set[str]:
    """The places to which lanes lead from a place."""
    reached, waiting = {start}, [start]
    while waiting:
        current = waiting.pop()
        for place, end in lanes:
            if place == current and end not in reached:
                reached.add(end)
                waiting.append(end)
    return reached


def _with_rules(dice: Random, roadmap: Roadmap, ends: Collection[str]) -> Roadmap:
    """The roadmap with places that one robot at a time uses, and where robots do not stop; but not where robots start or end."""
    names = [place.name for place in roadmap.places if place.name not in ends and place.zone is None]
    mutex = {*dice.sample(names, k=min(len(names), dice.randint(2, 4)))}
    passed = {*dice.sample(names, k=min(len(names), dice.randint(1, 4)))}
    return structs.replace(
        roadmap,
        places=tuple(
            structs.replace(place, mutexes=("M",) if place.name in mutex else (), passthrough=place.name in passed)
            for place in roadmap.places
        ),
    )


def _with_gates(dice: Random, roadmap: Roadmap) -> Roadmap:
    """In two of three runs with lifts, these have programs; in one of three of all runs, there is an automatic door in a lane."""
    zones = sorted({place.zone for place in roadmap.places if place.zone is not None})
    places = {place.name: place for place in roadmap.places}
    lifts = tuple(zones) if dice.random() < 0.67 else ()
    doors: tuple[Solid, ...] = ()
    level_lanes = [lane for lane in roadmap.lanes if places[lane.start].level == places[lane.end].level]
    if dice.random() < 0.33:
        lane = dice.choice(level_lanes)
        start, end = places[lane.start], places[lane.end]
        x, y = (start.x + end.x) / 2, (start.y + end.y) / 2
        doors = (
            Solid(name="Door0", type="AutomaticDoor", role=Role.DOOR, x=x, y=y, z=start.level, yaw=0.0, form="Box", width=0.2, depth=0.2),
        )
    return structs.replace(roadmap, lifts=lifts, doors=doors)


def _gate_incidents(dice: Random, roadmap: Roadmap) -> tuple[GateIncident, ...]:
    gates = [*roadmap.lifts, *(door.name for door in roadmap.doors)]
    return tuple(
        GateIncident(
            trouble=dice.choice(tuple(GateTrouble)),
            gate=gate,
            at=dice.uniform(0, SPAN),
            seconds=dice.choice((2.0, 20.0, 60.0, 400.0)),
        )
        for gate in gates
        for _ in range(dice.choice((0, 1, 2)))
    )


def _holds(dice: Random) -> tuple[Hold, ...]:
    """In two of five runs, traffic is held once or several times."""
    if dice.random() < 0.6:
        return ()
    moments = sorted(dice.uniform(0, SPAN) for _ in range(2 * dice.randint(1, 3)))
    return tuple(Hold(at=start, seconds=end - start) for start, end in zip(moments[::2], moments[1::2], strict=True))


def _with_storey(dice: Random, roadmap: Roadmap, trips: tuple[tuple[str, ...], ...]) -> tuple[Roadmap, tuple[tuple[str, ...], ...]]:
    """The roadmap with a copy of it as a second storey, one or two lifts between them, and some of the trips leading there.

    Each lift has one or two places on each storey, at one of which robots ride.
    """
    places, lanes = [*roadmap.places], [*roadmap.lanes]
    places += (structs.replace(place, name=_above(place.name), level=LEVEL) for place in roadmap.places)
    lanes += (structs.replace(lane, start=_above(lane.start), end=_above(lane.end)) for lane in roadmap.lanes)
    number, wanted = 0, dice.choice((1, 1, 2))
    for beside, (along_x, along_y) in dice.sample([*product(roadmap.places, ((0, 1), (1, 0), (0, -1), (-1, 0)))], 4 * len(roadmap.places)):
        lift, depth = f"Lift{number}", dice.choice((1, 2))
        points = [(beside.x + (place + 1) * along_x, beside.y + (place + 1) * along_y) for place in range(depth)]
        if number == wanted or any(math.dist((place.x, place.y), point) < 1 for place in places for point in points):
            continue
        number += 1
        for level, landing in ((0.0, beside.name), (LEVEL, _above(beside.name))):
            cabin = [f"{lift}-{place}" if not level else _above(f"{lift}-{place}") for place in range(depth)]
            places += (Place(name=name, x=x, y=y, level=level, zone=lift) for name, (x, y) in zip(cabin, points, strict=True))
            for start, end in pairwise((landing, *cabin)):
                lanes += (Lane(start=a, end=b, seconds=1.0) for a, b in ((start, end), (end, start)))
        last = f"{lift}-{depth - 1}"
        lanes += (Lane(start=a, end=b, seconds=10.0) for a, b in ((last, _above(last)), (_above(last), last)))
    ways = tuple(tuple(_above(stop) if "/" not in stop and dice.random() < 0.4 else stop for stop in way) for way in trips)
    return structs.replace(roadmap, places=tuple(places), lanes=tuple(lanes)), ways


def _above(place: str) -> str:
    return f"{place}^"


def _mixed(dice: Random, way: tuple[str, ...], berths: Collection[str]) -> tuple[str, ...]:
    """The destinations in another order, with berths among them; the last one stays, because there each robot is out of the others' way."""
    stops = [*way[:-1], *berths]
    return (*dice.sample(stops, k=len(stops)), way[-1])


def _berths(dice: Random, robot: str, roadmap: Roadmap) -> dict[str, Berth]:
    """Points beside the roadmap at which a robot is to work."""
    berths: dict[str, Berth] = {}
    for number in range(dice.randint(0, 2)):
        beside = dice.choice(roadmap.places)
        x, y = beside.x + dice.uniform(-0.5, 0.5), beside.y + dice.uniform(-0.5, 0.5)
        near = tuple(place.name for place in roadmap.places if math.dist((place.x, place.y), (x, y)) < roadmap.spacing)
        if near:
            name = f"{robot}/{number}"
            berths[name] = Berth(name=name, x=x, y=y, radius=RADIUS, places=near[: dice.randint(1, 3)])
    return berths


def _incident(dice: Random, robots: int) -> Incident:
    trouble = dice.choice(tuple(Trouble))
    return Incident(trouble=trouble, at=dice.uniform(0, SPAN), seconds=dice.choice((2.0, 20.0, 60.0, 400.0)), robot=dice.randrange(robots))


def _roadmap(dice: Random) -> Roadmap:
    """A grid with holes; a corridor with bays; or a ring with dead ends."""
    kind = dice.choice(("grid", "corridor", "ring"))
    points: dict[tuple[int, int], str] = {}
    if kind == "grid":
        columns, rows = dice.randint(2, 7), dice.randint(2, 6)
        cells = [(column, row) for column in range(columns) for row in range(rows)]
        points = {cell: f"P{cell[0]}-{cell[1]}" for cell in cells if dice.random() > 0.15}
    elif kind == "corridor":
        length = dice.randint(4, 14)
        points = {(column, 0): f"P{column}" for column in range(length)}
        points |= {(column, 1): f"Bay{column}" for column in range(length) if dice.random() < 0.35}
    else:
        length = dice.randint(3, 8)
        around = [(column, row) for column in range(length) for row in range(3) if row != 1 or column in (0, length - 1)]
        points = {cell: f"P{cell[0]}-{cell[1]}" for cell in around}
        points |= {(column, 3): f"End{column}" for column in range(length) if dice.random() < 0.3}
    roadmap = _joined(dice, points)
    return roadmap if len(roadmap.places) >= 6 else _roadmap(dice)


def _aisle(dice: Random) -> Roadmap:
    """A narrow aisle with bays of one or two places on both sides, between two rooms."""
    length = dice.randint(4, 10)
    points = {(column, row): f"A{column}/{row}" for column in range(-3, 0) for row in range(-1, 2)}
    points |= {(column, 0): f"Aisle{column}" for column in range(length)}
    points |= {(length + column, row): f"B{column}/{row}" for column in range(3) for row in range(-1, 2)}
    for column, side in product(range(1, length - 1), (-1, 1)):
        if dice.random() < 0.2:
            points |= {(column, side * depth): f"Bay{column}/{side * depth}" for depth in range(1, dice.randint(1, 2) + 1)}
    return _joined(dice, points)


def _joined(dice: Random, points: Mapping[tuple[int, int], str]) -> Roadmap:
    """The roadmap of the largest part of these points in which each has lanes to those beside it."""
    pairs: list[tuple[str, str]] = []
    for (column, row), name in points.items():
        pairs += [(name, points[near]) for near in ((column + 1, row), (column, row + 1)) if near in points]
    reached = _component(list(points.values()), pairs)
    places = tuple(Place(name=name, x=float(x), y=float(y)) for (x, y), name in points.items() if name in reached)
    lanes = [
        Lane(start=start, end=end, seconds=dice.choice((1.0, 1.0, 2.0, 5.0)))
        for a, b in pairs
        if a in reached
        for start, end in ((a, b), (b, a))
    ]
    return Roadmap(places=places, lanes=tuple(lanes), spacing=dice.choice((0.0, 0.0, 0.0, 0.9)))


def _component(names: list[str], pairs: list[tuple[str, str]]) -> set[str]:
    """The places of the largest part that hangs together."""
    largest: set[str] = set()
    for name in names:
        if name in largest:
            continue
        reached, waiting = {name}, [name]
        while waiting:
            here = waiting.pop()
            for a, b in pairs:
                for start, end in ((a, b), (b, a)):
                    if start == here and end not in reached:
                        reached.add(end)
                        waiting.append(end)
        largest = max(largest, reached, key=len)
    return largest
