"""A building of two storeys with a lift, for the simulator's tests: a hall of 8 by 6 m on each storey, and the lift beside it."""

from __future__ import annotations

from collections.abc import Iterable

from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from tests.support.simulator_room import Start, box, robot

HEIGHT = 4.0
"""The height of the upper floor, m."""
CABIN = (9.1, 3.0)
"""The middle of the cabin, seen from above, m."""


def storey(number: int, level: float, *, has_western_lift: bool = False) -> list[Object]:
    west = [box(f"West{number}", "Wall", (-0.05, 3, level), (0.1, 6, 2.5))]
    if has_western_lift:
        west = [
            box(f"LowWest{number}", "Wall", (-0.05, 1.2, level), (0.1, 2.4, 2.5)),
            box(f"HighWest{number}", "Wall", (-0.05, 4.8, level), (0.1, 2.4, 2.5)),
            box(f"WestGate{number}", "LiftDoor", (-0.05, 3, level), (0.1, 1.2, 2.1), Open=False),
        ]
    return [
        Object(name=f"Storey{number}", type="Storey", values={"Elevation": level}),
        *west,
        box(f"Floor{number}", "Floor", (4, 3, level - 0.1), (8.2, 6.2, 0.1)),
        box(f"South{number}", "Wall", (4, -0.05, level), (8.2, 0.1, 2.5)),
        box(f"North{number}", "Wall", (4, 6.05, level), (8.2, 0.1, 2.5)),
        box(f"LowEast{number}", "Wall", (8.05, 1.2, level), (0.1, 2.4, 2.5)),
        box(f"HighEast{number}", "Wall", (8.05, 4.8, level), (0.1, 2.4, 2.5)),
        box(f"Gate{number}", "LiftDoor", (8.05, 3, level), (0.1, 1.2, 2.1), Open=False),
        box(f"Table{number}", "Table", (2, 5.2, level), (1.4, 0.8, 0.74)),
    ]


def tower(*starts: Start, extra_objects: Iterable[Object] = (), extra_facts: Iterable[Fact] = (), has_western_lift: bool = False) -> Map:
    """The building, with a robot on the lower storey at each start. `has_western_lift`: another lift is on the other side of the hall."""
    robots = [robot(f"Robot{number}", start) for number, start in enumerate(starts, start=1)]
    lifts = [box("Lift1", "Lift", (*CABIN, 0), (1.8, 1.8, 2.3))]
    gates = {"Gate": "Lift1"}
    if has_western_lift:
        lifts.append(box("Lift2", "Lift", (-1.1, 3, 0), (1.8, 1.8, 2.3)))
        gates["WestGate"] = "Lift2"
    facts = [
        *(Fact("stopsAt", (lift.name, f"Storey{number}")) for lift in lifts for number in (1, 2)),
        *(Fact("leadsInto", (f"{gate}{number}", lift)) for gate, lift in gates.items() for number in (1, 2)),
        *extra_facts,
    ]
    house = Object(name="House", type="Building")
    parts: list[tuple[str, str]] = [(lift.name, house.name) for lift in lifts]
    objects = [house, *lifts]
    for number, level in ((1, 0.0), (2, HEIGHT)):
        whole, *elements = storey(number, level, has_western_lift=has_western_lift)
        objects += [whole, *elements]
        parts += [(whole.name, house.name), *((element.name, whole.name) for element in elements)]
    return Map([*objects, *robots, *extra_objects], [*facts, *(Fact("isPartOf", pair) for pair in parts)])
