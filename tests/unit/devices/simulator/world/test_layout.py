"""What is near a place: found by squares, as by asking every solid."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from somrs.devices.simulator.world.kinds import WorldKind
from somrs.devices.simulator.world.layout import Layout
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.space.leaves import leaf_obstacles
from somrs.space.solids import Role, Solid
from tests.support.simulator_room import ONTOLOGY, Run, box, room, thing

KINDS = st.sampled_from(["Table", "Wall", "Cupboard", "Floor", "Door", "Chair"])


@st.composite
def objects(draw: st.DrawFn) -> list[Object]:
    coordinates, sizes = st.floats(-20, 20), st.one_of(st.floats(0.1, 3.0), st.floats(30, 200))
    return [
        box(
            f"It{number}",
            draw(KINDS),
            (draw(coordinates), draw(coordinates), 0.0),
            (draw(sizes), draw(sizes), 0.7),
            RotationZ=draw(st.floats(-3, 3)),
            Open=draw(st.booleans()),
        )
        for number in range(draw(st.integers(0, 12)))
    ]


@given(objects(), st.tuples(st.floats(-25, 25), st.floats(-25, 25)), st.floats(0, 6), st.integers(0, 30))
def test_whatever_reaches_into_a_rectangle_is_found(site: list[Object], corner: tuple[float, float], size: float, removed: int) -> None:
    layout = Layout(ONTOLOGY)
    for object in site:
        layout.add(object)
    rectangle = (corner[0], corner[1], corner[0] + size, corner[1] + size)
    layout.standing_near(rectangle)  # so that what is removed has been found before
    if removed < len(site):
        layout.remove(site[removed].name)
    standing, blocks = layout.standing_near(rectangle), layout.blocks_near(rectangle)
    reaching = [solid for solid in layout.solids.values() if _reaches(solid, rectangle)]
    assert [solid.name for solid in standing if solid in reaching] == [solid.name for solid in reaching]
    for solid in layout.solids.values():
        obstacles = leaf_obstacles(solid, {}) if solid.container else []
        if solid.role is not Role.FLOOR and not (solid.role is Role.DOOR and solid.open):
            obstacles = [solid, *obstacles]
        assert {obstacle.name for obstacle in obstacles if _reaches(obstacle, rectangle)} <= {block.name for block in blocks}


def _reaches(solid: Solid, rectangle: tuple[float, float, float, float]) -> bool:
    left, bottom, right, top = rectangle
    points = [(x, y) for x in np.linspace(left, right, 7) for y in np.linspace(bottom, top, 7)]
    return any(solid.distance(x, y) <= 0 for x, y in points)


def test_what_comes_and_goes_supports_things_as_long_as_it_is_there() -> None:
    run = Run(room(), WorldKind.KINEMATIC)
    scene = run.simulation.scene
    assert _support(run, 2.0, 2.0) == "Floor1"
    run.simulation.add(box("Table9", "Table", (2.0, 2.0, 0), (1.0, 1.0, 0.7)))
    assert _support(run, 2.0, 2.0) == "Table9"
    run.simulation.add(thing("Cup1", "Cup", 2.0, 2.0, 0.7))
    assert float(scene.clearances(np.array([[2.0, 3.0]]), 0.0, 1.0)[0]) == 0.5
    run.simulation.remove("Table9")
    assert _support(run, 2.0, 2.0) == "Floor1"
    assert float(scene.clearances(np.array([[2.0, 3.0]]), 0.0, 1.0)[0]) > 1.0


def _support(run: Run, x: float, y: float) -> str:
    support = run.simulation.scene.support_below(x, y, 1.0)
    assert support is not None
    return support.name


def test_a_place_outside_has_nothing_near() -> None:
    layout = Layout(ONTOLOGY)
    layout.fill(Map(room().objects.values()))
    assert layout.blocks_near((100.0, 100.0, 101.0, 101.0)) == []
    assert math.isinf(min((solid.distance(100.0, 100.0) for solid in layout.standing_near((100.0, 100.0, 100.0, 100.0))), default=math.inf))
