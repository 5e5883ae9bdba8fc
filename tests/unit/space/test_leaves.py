"""The leaves of doors and containers: what their geometry says is what the physics does."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from somrs.devices.simulator.world.physics import PhysicsScene
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.space.distances import distances_from
from somrs.space.leaves import HANDLE_LENGTH, STANDOFF, Leaf, inside, leaves_of
from somrs.space.solids import Solid, solid_of
from tests.support.simulator_room import ONTOLOGY, box, shell

YAWS = (0.0, 0.7, math.pi / 2, -2.0)
OWNERS = [
    *(box("Door", "Door", (4, 3, 0), (0.1, 1.4, 2.1), RotationZ=yaw, Open=False) for yaw in YAWS),
    box("Door", "Door", (4, 3, 0), (0.9, 0.12, 2.0), Open=False),
    *(box("Cupboard", "Cupboard", (4, 3, 0), (0.5, 1.2, 0.8), RotationZ=yaw) for yaw in YAWS),
    box("Cupboard", "Cupboard", (4, 3, 0), (0.5, 0.5, 1.8)),
]


def _solid(object: Object) -> Solid:
    solid = solid_of(object, ONTOLOGY)
    assert solid is not None
    return solid


@pytest.mark.parametrize("owner", OWNERS, ids=lambda owner: f"{owner.type} {owner.values.get('RotationZ', 0):.1f}")
def test_leaves_and_handles_are_where_the_joints_put_them(owner: Object) -> None:
    scene = PhysicsScene(Map([*shell(), owner]), ONTOLOGY)
    for leaf in leaves_of(_solid(owner)):
        for part in (0.0, 0.3, 1.0):
            position = part * leaf.travel
            scene.set_leaf(leaf, position)
            mujoco.mj_kinematics(scene.model, scene.data)
            for side in (-1, 1) if leaf.slides else (1,):
                x, y = leaf.handle(position, side)
                handles = [
                    _place(scene, geom) for geom in _geoms(scene, leaf) if scene.model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER
                ]
                assert any(math.dist((x, y, leaf.handle_height), handle) < 1e-6 for handle in handles)
                ahead = x + STANDOFF * math.cos(leaf.front(position, side)), y + STANDOFF * math.sin(leaf.front(position, side))
                assert _distance(leaf, position, ahead) > _distance(leaf, position, (x, y)) >= STANDOFF - 1e-6
            middle = next(_place(scene, geom) for geom in _geoms(scene, leaf) if scene.model.geom_contype[geom] == 1)
            solid = leaf.solid(position)
            assert math.dist(middle[:2], (solid.x, solid.y)) < 1e-6


def _distance(leaf: Leaf, position: float, point: tuple[float, float]) -> float:
    """Distance of a point from a leaf, or from the wall in which it slides."""
    solid = leaf.owner if leaf.slides else leaf.solid(position)
    return float(distances_from(solid, np.array([point]))[0])


def _geoms(scene: PhysicsScene, leaf: Leaf) -> list[int]:
    body = scene.model.body(leaf.name).id
    return [geom for geom in range(scene.model.ngeom) if scene.model.geom_bodyid[geom] == body]


def _place(scene: PhysicsScene, geom: int) -> tuple[float, float, float]:
    x, y, z = scene.data.geom_xpos[geom].tolist()
    return x, y, z


@pytest.mark.parametrize("yaw", YAWS)
def test_an_open_door_leaves_its_whole_width_free(yaw: float) -> None:
    door = _solid(box("Door", "Door", (4, 3, 0), (0.1, 1.4, 2.1), RotationZ=yaw))
    (leaf,) = leaves_of(door)
    passage = [door.world(0.0, y) for y in np.linspace(-0.69, 0.69, 20)]
    assert distances_from(leaf.solid(0.0), np.array(passage[:18])).max() <= 0
    assert distances_from(leaf.solid(leaf.travel), np.array(passage)).min() > 0


def test_the_leaves_of_a_container_open_in_front_of_it() -> None:
    container = _solid(box("Cupboard", "Cupboard", (4, 3, 0), (0.5, 1.2, 0.8)))
    left, right = leaves_of(container)
    assert all(leaf.is_shut(0.0) and leaf.is_open(leaf.travel) for leaf in (left, right))
    for leaf in (left, right):
        solid = leaf.solid(leaf.travel)
        assert solid.x > 4.25 + 0.2, "it stands in front"
        assert abs(solid.y - 3) == pytest.approx(0.6, abs=0.02), "it leaves the front free"
        assert leaf.bottom < leaf.handle_height - HANDLE_LENGTH / 2 < leaf.handle_height + HANDLE_LENGTH / 2 < leaf.top


def test_things_in_a_container_are_seen_only_when_it_is_open() -> None:
    jar = Object(name="Jar", type="Jar", values={"PositionX": 4.0, "PositionY": 3.2, "PositionZ": 0.06})
    for is_open in (False, True):
        cupboard = box("Cupboard", "Cupboard", (4, 3, 0), (0.5, 1.2, 0.8), Open=is_open)
        scene = PhysicsScene(Map([*shell(), cupboard, jar]), ONTOLOGY)
        assert scene.is_unobstructed((6.0, 3.2, 0.4), (4.0, 3.2, 0.13), ["Jar"]) is is_open
        state = scene.observe("Jar")
        assert (state.container, state.support) == ("Cupboard", None)
        assert scene.observe("Cupboard").open is is_open


def test_what_stands_on_a_container_is_not_in_it() -> None:
    cupboard = box("Cupboard", "Cupboard", (4, 3, 0), (0.5, 1.2, 0.8))
    jar = Object(name="Jar", type="Jar", values={"PositionX": 4.0, "PositionY": 3.0, "PositionZ": 0.8})
    state = PhysicsScene(Map([*shell(), cupboard, jar]), ONTOLOGY).observe("Jar")
    assert (state.container, state.support) == (None, "Cupboard")
    assert inside(_solid(cupboard)).top < 0.8
