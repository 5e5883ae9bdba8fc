"""Mistakes in the geometry of a map are found, named, and told with what to do; good maps have none."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from somrs.ontology.files.loading import load, load_text
from somrs.ontology.objects import ValueSet
from somrs.space.findings import Finding, find_mistakes
from somrs.space.reachability import Ground
from somrs.space.solids import Point, Role, Solid
from tests.support.paths import ROOT

HALL = """\
upper: 2
map: Hall
objects:
  Hall:
    type: Building
    parts:
      Ground:
        type: Storey
        parts:
          Floor1: {type: Floor, at: [5, 3, -0.1], Shape: {Form: Box, Width: 10, Depth: 6, Height: 0.1}}
          South: {type: Wall, at: [5, 0, 0], Shape: {Form: Box, Width: 10.1, Depth: 0.1, Height: 2.5}}
          North: {type: Wall, at: [5, 6, 0], Shape: {Form: Box, Width: 10.1, Depth: 0.1, Height: 2.5}}
          Middle1: {type: Wall, at: [6, 1.2, 0], turned: 1.5708, Shape: {Form: Box, Width: 2.4, Depth: 0.1, Height: 2.5}}
          Middle2: {type: Wall, at: [6, 4.8, 0], turned: 1.5708, Shape: {Form: Box, Width: 2.4, Depth: 0.1, Height: 2.5}}
          Gate: {type: Door, at: [6, 3, 0], turned: 1.5708, Open: false, Shape: {Form: Box, Width: 1.2, Depth: 0.1, Height: 2.1}}
          Bay: {type: Place, at: [2, 3, 0]}
          Far: {type: Place, at: [8, 3, 0]}
          Turn: {type: Waypoint, at: [4, 3, 0]}
          Lane1: {type: Lane, Bidirectional: true}
          Lane2: {type: Lane, Bidirectional: true}
  Robot1: {type: DeliveryRobot, at: [3, 2, 0]}
  Shelf1: {type: Shelf, at: [1, 5, 0], Shape: {Form: Box, Width: 1.2, Depth: 0.4, Height: 1}}
facts:
  - Lane1 startsAt Bay
  - Lane1 endsAt Turn
  - Lane2 startsAt Turn
  - Lane2 endsAt Far
"""
SHUT = "Gate: {type: Door, at: [6, 3, 0], turned: 1.5708, Open: false,"


def mistakes(text: str) -> list[Finding]:
    loaded = load_text(text)
    assert loaded.map is not None
    return find_mistakes(loaded.map, loaded.ontology)


def test_good_map_has_none() -> None:
    assert mistakes(HALL) == []


@pytest.mark.parametrize(
    ("old", "new", "subject", "rule", "words"),
    [
        ("DeliveryRobot, at: [3, 2, 0]", "DeliveryRobot, at: [6, 1.2, 0]", "Robot1", "in-wall", "0.27 m deep in Middle1; move it away"),
        ("DeliveryRobot, at: [3, 2, 0]", "DeliveryRobot, at: [1.3, 4.9, 0]", "Robot1", "in-wall", "deep in Shelf1"),
        ("Shelf, at: [1, 5, 0]", "Shelf, at: [1, 5.9, 0]", "Shelf1", "in-wall", "deep in North"),
        ("Place, at: [8, 3, 0]", "Place, at: [8, 0.2, 0]", "Far", "unreachable", "South is nearer than"),
        ("Place, at: [8, 3, 0]", "Place, at: [8, 9, 0]", "Far", "no-floor", "no floor under it"),
        ("Place, at: [8, 3, 0]", "Place, at: [8, 3, 3]", "Far", "no-floor", "no floor under it"),
        (SHUT, "Gate: {type: Wall, at: [6, 3, 0], turned: 1.5708,", "Far", "unreachable", "no way to it from where robots stand"),
        (SHUT, "Gate: {type: Wall, at: [6, 3, 0], turned: 1.5708,", "Lane2", "lane-blocked", "from Turn to Far, it leads through Gate"),
        (SHUT, "Gate: {type: Window, at: [6, 3, 0], turned: 1.5708,", "Lane2", "lane-blocked", "it leads through Gate"),
        ("Width: 1.2, Depth: 0.1, Height: 2.1", "Width: 0.1, Depth: 0.1, Height: 2.1", "Gate", "not-metres", "which no door is"),
        ("Width: 1.2, Depth: 0.4", "Width: 0, Depth: 0", "Shelf1", "shape", "without extent"),
    ],
)
def test_mistake_is_found_and_named(old: str, new: str, subject: str, rule: str, words: str) -> None:
    assert old in HALL
    found = {(finding.subject, finding.rule): finding.message for finding in mistakes(HALL.replace(old, new))}
    assert words in found.get((subject, rule), ""), found


def test_lane_for_larger_robots_is_too_narrow() -> None:
    wiper = "Wiper: {type: CleaningRobot, at: [3.5, 4.6, 0], NavigationGraph: wipers, Shape: {Form: Cylinder, Radius: 0.7, Height: 1}}"
    text = HALL.replace("  Robot1:", f"  {wiper}\n  Robot1:").replace("Lane2: {type: Lane,", "Lane2: {type: Lane, NavigationGraph: wipers,")
    (finding,) = mistakes(text)
    assert (finding.subject, finding.rule) == ("Lane2", "lane-narrow")
    assert "is 0.60 m from it, and the robots of its graph need 0.70 m" in finding.message
    assert mistakes(text.replace("Lane2: {type: Lane, NavigationGraph: wipers", "Lane2: {type: Lane, NavigationGraph: others")) == []


def test_only_the_mistake_is_found() -> None:
    assert [f.subject for f in mistakes(HALL.replace("at: [1, 5, 0]", "at: [1, 5.9, 0]"))] == ["Shelf1"]
    assert {f.subject for f in mistakes(HALL.replace(SHUT, "Gate: {type: Wall, at: [6, 3, 0], turned: 1.5708,"))} == {"Far", "Lane2"}


TWO_STOREYS = """\
map: H
objects:
  H:
    type: Building
    parts:
      G: {type: Storey, parts: {F: {type: Floor, at: [4, 3, -0.1], Shape: {Form: Box, Width: 8, Depth: 6, Height: 0.1}}}}
      U:
        type: Storey
        Elevation: 4
        parts: {F2: {type: Floor, at: [4, 3, 3.9], Shape: {Form: Polygon, Outline: "-4,-3 4,-3 4,3", Height: 0.1}}}
      Lift1: {type: Lift, at: [9.1, 3, 0], Shape: {Form: Box, Width: 1.8, Depth: 1.8, Height: 2.3}}
facts: [Lift1 stopsAt G, Lift1 stopsAt U]
"""


def test_storeys_are_not_in_one_another() -> None:
    assert mistakes(TWO_STOREYS) == []
    (finding,) = mistakes(TWO_STOREYS.replace("[4, 3, 3.9]", "[4, 3, 0]"))
    assert (finding.subject, finding.rule) == ("U", "same-height")
    assert mistakes(TWO_STOREYS.replace("[4, 3, 3.9]", "[12, 3, -0.1]")) == []


def test_a_robot_is_in_the_cabin_of_a_lift_and_not_in_its_shaft() -> None:
    in_cabin = TWO_STOREYS.replace("      Lift1:", "      Robot1: {type: DeliveryRobot, at: [9.1, 3, 0]}\n      Lift1:")
    in_cabin = in_cabin.replace("facts: [", "facts: [Robot1 isIn Lift1, ")
    assert mistakes(in_cabin) == []
    (finding,) = mistakes(in_cabin.replace("at: [9.1, 3, 0]}", "at: [9.1, 3, 4]}"))
    assert (finding.subject, finding.rule) == ("Robot1", "in-shaft")


def test_a_robot_fits_into_a_lift() -> None:
    (finding,) = mistakes(TWO_STOREYS.replace("Width: 1.8", "Width: 0.2"))
    assert (finding.subject, finding.rule) == ("Lift1", "lift-small")


def test_degrees_are_no_metres() -> None:
    """A campus in longitude and latitude: all of it lies within 0.02 m."""
    waypoints = "\n".join(f"          W{i}: {{type: Place, at: [{103.77 + 0.002 * i}, {1.3 + 0.001 * i}, 0]}}" for i in range(6))
    text = "map: M\nobjects:\n  M:\n    type: Building\n    parts:\n      S:\n        type: Storey\n        parts:\n"
    text += "          F: {type: Floor, at: [103, 1, -0.1], Shape: {Form: Box, Width: 9, Depth: 9, Height: 0.1}}\n" + waypoints
    (finding,) = mistakes(text)
    assert (finding.subject, finding.rule) == ("M", "not-metres")
    assert "all that is there lies within 0.01 m: the coordinates cannot be metres" in finding.message
    (large,) = mistakes(text.replace("W5: {type: Place, at: [103.78", "W5: {type: Place, at: [99103.78"))
    assert "within 99 km" in large.message


def test_robot_would_be_caught_behind_a_one_way_lane() -> None:
    (finding,) = mistakes(HALL.replace("Lane2: {type: Lane, Bidirectional: true}", "Lane2: {type: Lane}"))
    assert (finding.subject, finding.rule) == ("Lane2", "no-way-back")
    assert "from Turn, it leads one way to Far, and no lane leads back from there" in finding.message


def test_lift_is_no_obstacle_to_the_lane_into_it() -> None:
    text = HALL.replace(
        "  Robot1:", "  Lift1: {type: Lift, at: [8.5, 3, 0], Shape: {Form: Box, Width: 2, Depth: 2, Height: 2.5}}\n  Robot1:"
    )
    text = text.replace("Far: {type: Place, at: [8, 3, 0]}", "Far: {type: Waypoint, at: [8.5, 3, 0]}") + "  - Far isIn Lift1\n"
    assert mistakes(text) == []


def test_robot_in_a_lift_needs_no_floor() -> None:
    lift = "Lift1: {type: Lift, at: [20, 3, 0], Shape: {Form: Box, Width: 2, Depth: 2, Height: 2.4}}"
    ridden = HALL.replace("Robot1: {type: DeliveryRobot, at: [3, 2, 0]}", f"Robot1: {{type: DeliveryRobot, at: [20, 3, 0]}}\n  {lift}")
    assert [finding.subject for finding in mistakes(ridden)] == ["Robot1"]
    assert mistakes(ridden.replace("facts:\n", "facts:\n  - Robot1 isIn Lift1\n")) == []


def test_people_walk_on() -> None:
    assert mistakes(HALL.replace("  Robot1:", "  Pedestrian1: {type: Pedestrian, at: [7, 3, 0]}\n  Robot1:")) == []


@pytest.mark.parametrize("site", sorted((ROOT / "src/somrs/demo/data").glob("*.yaml")), ids=lambda path: path.stem)
def test_sites_of_the_demonstration_have_none(site: object) -> None:
    loaded = load([str(site)])
    assert loaded.map is not None
    assert find_mistakes(loaded.map, loaded.ontology) == []


@settings(max_examples=60)
@given(st.data())
def test_any_numbers_have_findings_or_none(data: st.DataObject) -> None:
    """A map of a floor, a wall, a robot, a place and a lane, with any positions and sizes."""
    numbers = st.sampled_from([0.0, -1.0, 0.001, 1e3, 1e7, -1e12, 1e300]) | st.floats(-20, 20)
    outlines = st.sampled_from(["0,0 4,0 4,3", "0,0 0,0 0,0", "nan,0 1,1 2,2", "inf,0 1,1 2,2", "0,0 1e200,0 0,1e200", "0,0 4,4 0,4 4,0"])
    loaded = load_text(HALL)
    assert loaded.map is not None
    site_map = loaded.map
    for name in data.draw(st.lists(st.sampled_from(["Floor1", "South", "Robot1", "Far", "Turn", "Shelf1", "Gate"]), max_size=4)):
        path = data.draw(st.sampled_from(["PositionX", "PositionY", "PositionZ", "Shape.Width", "Shape.Depth", "Shape.Height"]))
        site_map = site_map.changed([ValueSet(name, path, data.draw(numbers))])
    if data.draw(st.booleans()):
        site_map = site_map.changed([ValueSet("Floor1", "Shape.Form", "Polygon"), ValueSet("Floor1", "Shape.Outline", data.draw(outlines))])
    for finding in find_mistakes(site_map, loaded.ontology):
        assert finding.subject in site_map.objects
        assert finding.message


# What is reachable, against the definition


def box(name: str, role: Role, x: float, y: float, width: float, depth: float) -> Solid:
    return Solid(name=name, type="Wall", role=role, x=x, y=y, z=0, yaw=0, form="Box", width=width, depth=depth, height=1)


tenths = st.integers(0, 60).map(lambda n: n / 10)
blocks = st.lists(st.tuples(tenths, tenths, st.integers(2, 40).map(lambda n: n / 10), st.integers(2, 40).map(lambda n: n / 10)), max_size=6)


@given(blocks)
def test_regions_are_those_of_a_plain_flood(drawn: list[tuple[float, float, float, float]]) -> None:
    """Two cells are in one region if a chain of neighbouring cells with enough room joins them."""
    radius, floor = 0.3, box("Floor", Role.FLOOR, 3, 3, 6, 6)
    walls = [box(f"Wall{i}", Role.WALL, *sizes) for i, sizes in enumerate(drawn)]
    ground = Ground(walls, [floor], [], radius)
    grid = ground.grid
    free = {(row, column) for row in range(1, grid.rows - 1) for column in range(1, grid.columns - 1) if ground.labels[row, column]}
    for row, column in free:
        centre = grid.centre((row, column))
        assert all(wall.distance(*centre) > radius - grid.size for wall in walls)
        assert floor.distance(*centre) < 2 * grid.size - radius, "floors are drawn with the tolerance of a cell"
    reached: dict[tuple[int, int], int] = {}
    for start in sorted(free):
        if start in reached:
            continue
        queue = [start]
        reached[start] = int(ground.labels[start])
        while queue:
            row, column = queue.pop()
            for neighbour in ((row + i, column + j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
                if neighbour in free and neighbour not in reached:
                    reached[neighbour] = reached[start]
                    queue.append(neighbour)
    assert reached == {cell: int(ground.labels[cell]) for cell in free}
    assert ground.count == len(set(reached.values()))
    assert ground.region((100.0, 100.0)) is None
    assert math.isclose(grid.size, 0.1)


corners = st.lists(st.tuples(tenths, tenths), min_size=3, max_size=7, unique=True)


@given(corners)
def test_floor_of_any_outline_is_ground_where_its_distance_says_so(drawn: list[Point]) -> None:
    """Also floors that cross themselves: what is inside is defined by the even-odd rule."""
    floor = Solid(name="F", type="Floor", role=Role.FLOOR, x=0, y=0, z=0, yaw=0, form="Polygon", outline=tuple(drawn), height=0.1)
    assume(max(x for x, _ in drawn) > min(x for x, _ in drawn) and max(y for _, y in drawn) > min(y for _, y in drawn))
    ground = Ground([], [floor], [], 0.1)
    grid = ground.grid
    for row in range(0, grid.rows, 3):
        for column in range(0, grid.columns, 3):
            distance = floor.distance(*grid.centre((row, column)))
            if abs(distance) > 4 * grid.size:
                assert bool(ground.labels[row, column]) == (distance < 0), grid.centre((row, column))


def test_floors_a_little_apart_are_one_ground() -> None:
    floors = [box("A", Role.FLOOR, 2, 2, 4, 4), box("B", Role.FLOOR, 6.08, 2, 4, 4)]
    ground = Ground([], floors, [], 0.3)
    assert ground.region((1, 2)) == ground.region((7, 2)) is not None


def test_door_is_a_way_between_floors_that_end_at_its_wall() -> None:
    floors = [box("A", Role.FLOOR, 2, 2, 4, 4), box("B", Role.FLOOR, 6.3, 2, 4, 4)]
    door = box("D", Role.DOOR, 4.15, 2, 0.3, 1.2)
    assert Ground([], floors, [], 0.3).region((1, 2)) != Ground([], floors, [], 0.3).region((7, 2))
    ground = Ground([], floors, [door], 0.3)
    assert ground.region((1, 2)) == ground.region((7, 2)) is not None


@pytest.mark.parametrize(
    ("place", "distance"), [("[1.3, 5.1, 1]", None), ("[1.62, 5, 1]", None), ("[2.1, 5, 1]", "0.50"), ("[1, 3, 0]", "1.80")]
)
def test_a_thing_beside_what_it_is_on_is_found(place: str, distance: str | None) -> None:
    text = HALL.replace("facts:\n", f"  Jar1: {{type: Jar, at: {place}}}\nfacts:\n  - Jar1 isOn Shelf1\n")
    reported = [mistake for mistake in mistakes(text) if mistake.subject == "Jar1"]
    message = f"it is on Shelf1, and its position is {distance} m beside that; correct PositionX and PositionY, or what it is on"
    assert reported == ([Finding(subject="Jar1", rule="beside", message=message)] if distance is not None else [])


@pytest.mark.parametrize(("height", "distance"), [(1.05, None), (3.0, "2.00")])
def test_a_thing_that_floats_above_what_it_is_on_is_found(height: float, distance: str | None) -> None:
    text = HALL.replace("facts:\n", f"  Jar1: {{type: Jar, at: [1.3, 5.1, {height}]}}\nfacts:\n  - Jar1 isOn Shelf1\n")
    reported = [mistake for mistake in mistakes(text) if mistake.subject == "Jar1"]
    message = f"it is on Shelf1, and its position is {distance} m above that; correct PositionZ, or what it is on"
    assert reported == ([Finding(subject="Jar1", rule="floating", message=message)] if distance is not None else [])


def test_a_robot_that_would_never_arrive_is_found() -> None:
    text = HALL.replace("facts:\n", "  Robot9: {type: Vehicle, at: [3, 3, 0], Speed: 0}\nfacts:\n")
    assert [mistake.rule for mistake in mistakes(text) if mistake.subject == "Robot9"] == ["speed"]
