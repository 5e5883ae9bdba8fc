"""A building of three storeys with lifts, chargers, parcels and any number of mobile robots: the problems of `planning.py` by size of the
fleet."""

from __future__ import annotations

import random

from somrs.entish.parse import parse
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.problem import AvailableService, Problem

STOREYS = 3
PLACES = 300
LIFTS = 4
CHARGERS = 10
"""The number of charging places on each storey."""
PARCELS = 60
LOW_CHARGE = 0.1
"""The share of robots that have to charge before they can do anything else."""

ONTOLOGY: Ontology = upper().extended(
    [
        AttributeType(name="Level", kind=Kind.NUMBER, unit="percent", minimum=0, maximum=100),
        ObjectType(name="Spot", parent="Place"),
        ObjectType(name="ChargingSpot", parent="Spot"),
        ObjectType(name="Storey1", parent="Place"),
        ObjectType(name="Elevator", parent="StationaryDevice"),
        ObjectType(name="Parcel", parent="Graspable"),
        ObjectType(name="Carrier", parent="MobileRobot", attributes=("Level",)),
        RelationType(name="standsAt", joins=("Device", "Spot"), functional=True),
        RelationType(name="liesAt", joins=("Parcel", "Spot"), functional=True, excludes="lying"),
        RelationType(name="heldBy", joins=("Parcel", "Carrier"), functional=True, excludes="lying"),
        RelationType(name="onStorey", joins=("Spot", "Storey1")),
        RelationType(name="servedBy", joins=("Spot", "Elevator")),
    ]
)

PLACE = Parameter(name="To", type="Spot")
MOVE = ServiceType(
    name="MoveTo",
    inputs=(PLACE,),
    precondition="?Provider standsAt ?From AND ?From onStorey ?Storey AND ?To onStorey ?Storey AND ?Provider.Level >= 5 %",
    effect="?Provider standsAt ?To",
)
TAKE = ServiceType(
    name="Take",
    inputs=(Parameter(name="Parcel", type="Parcel"),),
    precondition="?Parcel liesAt ?Spot AND ?Provider standsAt ?Spot AND ?Provider.Level >= 20 %",
    effect="?Parcel heldBy ?Provider",
)
CARRY = ServiceType(
    name="Carry",
    inputs=(Parameter(name="Parcel", type="Parcel"), PLACE),
    precondition="?Parcel heldBy ?Provider AND ?Provider standsAt ?To",
    effect="?Parcel liesAt ?To",
)
RIDE = ServiceType(
    name="Ride",
    inputs=(PLACE,),
    precondition="?Provider standsAt ?From AND ?From servedBy ?Lift AND ?To servedBy ?Lift",
    effect="?Provider standsAt ?To",
)
CHARGE = ServiceType(name="ChargeUp", inputs=(), precondition="?Provider standsAt ?Spot: ChargingSpot", effect="?Provider.Level = 100 %")
SERVICES = (MOVE, TAKE, CARRY, RIDE, CHARGE)


def building(robots: int, seed: int = 1) -> Map:
    """Return the map with parcels and robots at random places. All robots are alike, except for their places and charges."""
    rng = random.Random(seed)
    storeys = [Object(name=f"Storey{n}", type="Storey1") for n in range(STOREYS)]
    lifts = [Object(name=f"Lift{n}", type="Elevator") for n in range(LIFTS)]
    spots, facts = list[Object](), list[Fact]()
    for n in range(PLACES):
        storey, number = n % STOREYS, n // STOREYS
        spot = Object(name=f"Spot{n}", type="ChargingSpot" if number < CHARGERS else "Spot")
        spots.append(spot)
        facts.append(Fact("onStorey", (spot.name, f"Storey{storey}")))
        if number < LIFTS:
            facts.append(Fact("servedBy", (spot.name, f"Lift{number}")))
    parcels = [Object(name=f"Parcel{n}", type="Parcel") for n in range(PARCELS)]
    facts += [Fact("liesAt", (parcel.name, rng.choice(spots).name)) for parcel in parcels]
    carriers = [
        Object(name=f"Carrier{n}", type="Carrier", values={"Level": 10.0 if rng.random() < LOW_CHARGE else float(rng.randrange(30, 100))})
        for n in range(robots)
    ]
    facts += [Fact("standsAt", (carrier.name, rng.choice(spots).name)) for carrier in carriers]
    return Map([*storeys, *lifts, *spots, *parcels, *carriers], facts)


def delivery_problem(robots: int, deliveries: int, seed: int = 1) -> Problem:
    """Return the problem of bringing parcels to another storey."""
    map = building(robots, seed)
    goals = []
    for n in range(deliveries):
        (_, place), *_ = map.facts_with("liesAt", 0, f"Parcel{n}")
        goals.append(f"Parcel{n} liesAt Spot{(int(place.removeprefix('Spot')) + 1 + 3 * n) % PLACES}")
    carriers = tuple(name for name in map.of_type("Carrier"))
    services = tuple(AvailableService(service, carriers) for service in SERVICES)
    return Problem(ontology=ONTOLOGY, map=map, goal=parse(" AND ".join(goals)), services=services)
