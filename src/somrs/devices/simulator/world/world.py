"""The world for the physics, built from a map: each physical object becomes a body of the same name, according to its type and attributes.

`looks.py` draws the objects, `chassis.py` builds the robots.
"""

from __future__ import annotations

import math

import mujoco

from somrs.devices.simulator.world.chassis import HANDLE_BIT, ROBOT_BIT, STATIC_BIT, THING_BIT, add_robot
from somrs.devices.simulator.world.colours import METAL, colour_of
from somrs.devices.simulator.world.layout import Layout
from somrs.devices.simulator.world.looks import add_surroundings, draw, draw_handle, draw_leaf
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology
from somrs.space.leaves import EDGE, HANDLE, HANDLE_LENGTH, JAMB, STANDOFF, Leaf, leaves_of, panels
from somrs.space.solids import Point, Role, Solid, role_of, solid_of

STEP = 0.005
"""Time step of the physics, s."""
LIGHTEST = 0.01
"""Smallest mass of a thing in the physics, kg."""


class World(Layout):
    """A layout with its description for the physics, to be compiled. `composed`: objects whose parts are drawn in their place."""

    def __init__(self, ontology: Ontology, composed: frozenset[str]) -> None:
        super().__init__(ontology)
        self.spec = mujoco.MjSpec()
        self.composed = composed

    def add(self, object: Object) -> Solid | None:
        solid = super().add(object)
        if solid is None:
            return None
        if solid.role is Role.ROBOT:
            add_robot(self.spec, solid, colour_of(solid))
        else:
            self._add_body(solid)
        return solid

    def set_weight(self, thing: str, weight: float) -> None:
        super().set_weight(thing, weight)
        for geom in self.spec.body(thing).geoms:
            if geom.contype:  # the parts that are only drawn weigh nothing
                geom.mass = max(weight, LIGHTEST)

    def raise_object(self, name: str, z: float) -> Solid:
        solid = super().raise_object(name, z)
        body = self.spec.body(name)
        body.pos = [body.pos[0], body.pos[1], z]
        return solid

    def remove(self, name: str) -> Solid:
        solid = super().remove(name)
        if solid.role is Role.ROBOT or solid.powered:
            for element in (*self.spec.actuators, *self.spec.equalities, *self.spec.excludes):
                owner = element.bodyname1 if isinstance(element, mujoco.MjsExclude) else element.name
                if owner == name or owner.startswith(f"{name}/"):
                    self.spec.delete(element)
        self.spec.delete(self.spec.body(name))
        return solid

    def _add_body(self, solid: Solid) -> None:
        turn = [math.cos(solid.yaw / 2), 0, 0, math.sin(solid.yaw / 2)]
        body = self.spec.worldbody.add_body(name=solid.name, pos=[solid.x, solid.y, solid.z], quat=turn)
        if solid.form == "Polygon":
            self._add_prisms(body, solid)
        elif solid.name not in self.composed:
            draw(body, solid, list(self.ontology.ancestors(solid.type)))
        leaves = leaves_of(solid)
        for leaf in leaves:
            _add_leaf(body, leaf)
            if solid.powered:
                drive = self.spec.add_actuator(name=leaf.name, target=leaf.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
                drive.set_to_position(600, 150)
                drive.forcelimited, drive.forcerange = 1, [-150, 150]
        if solid.role is Role.THING:
            body.add_freejoint(name=solid.name)
            bits = {
                "contype": THING_BIT,
                "conaffinity": STATIC_BIT | ROBOT_BIT | THING_BIT,
                "mass": max(solid.weight, LIGHTEST),
                "condim": 4,
            }
        else:
            bits = {"contype": STATIC_BIT, "conaffinity": 0}
        if solid.container and leaves:
            for panel in panels(solid):
                half, centre = [panel.width / 2, panel.depth / 2, panel.height / 2], [panel.x, panel.y, panel.z + panel.height / 2]
                body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=centre, group=3, friction=[0.9, 0.01, 0.001], **bits)
            return
        if (
            solid.role in (Role.MARK, Role.PART, Role.LIFT)
            or (solid.role is Role.DOOR and (leaves or solid.open))
            or (solid.form == "Polygon" and solid.role is not Role.FLOOR)
        ):
            return
        kind, size, middle = _hull(solid)
        body.add_geom(type=kind, size=size, pos=[*middle, solid.height / 2], group=3, friction=[0.9, 0.01, 0.001], **bits)

    def _add_prisms(self, body: mujoco.MjsBody, solid: Solid) -> None:
        """Add a polygon as one prism per triangle. A floor collides as one box instead, on which things stand more stably."""
        bit = 0 if solid.role is Role.FLOOR else STATIC_BIT
        for i, triangle in enumerate(triangles(solid.outline)):
            name = f"{solid.name}/{i}"
            mesh = next((m for m in self.spec.meshes if m.name == name), None) or self.spec.add_mesh(name=name)
            mesh.uservert = [value for z in (0.0, solid.height) for x, y in triangle for value in (x, y, z)]
            colour, look = list(colour_of(solid)), "matt"
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=colour, material=look, contype=bit, conaffinity=0)


def _add_leaf(body: mujoco.MjsBody, leaf: Leaf) -> None:
    """Add a leaf, its joint and its handles to the body of its owner. Its frame has its origin at `end`, and x along the leaf."""
    turn = [math.cos(leaf.along / 2), 0, 0, math.sin(leaf.along / 2)]
    part = body.add_body(name=leaf.name, pos=[*leaf.end, 0], quat=turn, gravcomp=1)
    joint = part.add_joint(name=leaf.name, axis=[-1, 0, 0] if leaf.slides else [0, 0, leaf.turn])
    joint.type = mujoco.mjtJoint.mjJNT_SLIDE if leaf.slides else mujoco.mjtJoint.mjJNT_HINGE
    joint.limited, joint.range = 1, [0, leaf.travel if leaf.slides else math.degrees(leaf.travel)]
    joint.damping = [8.0 if leaf.slides else 1.0, 0, 0]
    joint.frictionloss = 2.0 if leaf.slides else 0.4
    box, middle, tall = mujoco.mjtGeom.mjGEOM_BOX, (leaf.bottom + leaf.top) / 2, (leaf.top - leaf.bottom) / 2
    width = leaf.width - JAMB if leaf.slides else leaf.width
    thick = min(leaf.thickness, 0.045) / 2
    part.add_geom(type=box, size=[width / 2, thick, tall], pos=[width / 2, 0, middle], group=3, mass=10, contype=STATIC_BIT, conaffinity=0)
    if leaf.slides:  # nothing collides with the strip that stays in the doorway, but nobody sees through it
        strip = [width + JAMB / 2, 0, middle]
        part.add_geom(type=box, size=[JAMB / 2, thick, tall], pos=strip, group=3, mass=0, contype=0, conaffinity=0)
    draw_leaf(part, leaf)
    z, surface = leaf.handle_height - leaf.owner.z, 0.015 if leaf.slides else leaf.thickness / 2
    for side in (-1, 1) if leaf.slides else (1,):
        x, y = leaf.width - (JAMB * 0.6 if leaf.slides else EDGE), side * leaf.turn * (leaf.thickness / 2 + STANDOFF)
        part.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[HANDLE, HANDLE_LENGTH / 2, 0], pos=[x, y, z], rgba=list(METAL), mass=0,
            contype=HANDLE_BIT, conaffinity=0, friction=[1.2, 0.02, 0.001], condim=4, material="satin",
        )  # fmt: skip
        draw_handle(part, x, y, z, math.copysign(surface, y))


def _hull(solid: Solid) -> tuple[mujoco.mjtGeom, list[float], Point]:
    """The collision primitive of an object: its kind, half sizes, and middle in the object's frame."""
    if solid.form == "Cylinder":
        return mujoco.mjtGeom.mjGEOM_CYLINDER, [solid.radius, solid.height / 2, 0], (0.0, 0.0)
    if solid.form == "Box":
        return mujoco.mjtGeom.mjGEOM_BOX, [solid.width / 2, solid.depth / 2, solid.height / 2], (0.0, 0.0)
    xs, ys = [x for x, _ in solid.outline], [y for _, y in solid.outline]
    half = [(max(xs) - min(xs)) / 2, (max(ys) - min(ys)) / 2, solid.height / 2]
    return mujoco.mjtGeom.mjGEOM_BOX, half, ((max(xs) + min(xs)) / 2, (max(ys) + min(ys)) / 2)


def triangles(outline: tuple[Point, ...]) -> list[tuple[Point, Point, Point]]:
    """Triangulate a simple polygon by ear clipping; corners on a straight line are omitted."""

    def cross(origin: Point, first: Point, second: Point) -> float:
        return (first[0] - origin[0]) * (second[1] - origin[1]) - (first[1] - origin[1]) * (second[0] - origin[0])

    area = sum(start[0] * end[1] - end[0] * start[1] for start, end in zip(outline, (*outline[1:], outline[0]), strict=True))
    rest = list(outline) if area > 0 else list(reversed(outline))
    ears: list[tuple[Point, Point, Point]] = []
    while len(rest) > 2:
        for i in range(len(rest)):
            previous, corner, next_corner = rest[i - 1], rest[i], rest[(i + 1) % len(rest)]
            turn = cross(previous, corner, next_corner)
            inner_points = (
                p
                for p in rest
                if p not in (previous, corner, next_corner)
                and min(cross(previous, corner, p), cross(corner, next_corner, p), cross(next_corner, previous, p)) >= 0
            )
            if abs(turn) < 1e-9 or (turn > 0 and next(inner_points, None) is None):
                if turn > 1e-9:
                    ears.append((previous, corner, next_corner))
                del rest[i]
                break
        else:
            break  # the outline crosses itself: only the triangles so far can be drawn
    return ears


def build(map: Map, ontology: Ontology) -> World:
    """Build the world that the map describes. Raises SimulationError."""
    parts = (name for name, object in map.objects.items() if role_of(object, ontology) is Role.PART and solid_of(object, ontology))
    world = World(ontology, composed=frozenset(whole for name in parts if (whole := map.whole(name)) is not None))
    spec = world.spec
    spec.modelname = "somrs"
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 5
    spec.option.iterations, spec.option.ls_iterations = 30, 20
    # A divergence must be detected; MuJoCo must not reset the state.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    world.fill(map)
    solids = list(world.solids.values())
    low = (min(s.x - s.extent for s in solids), min(s.y - s.extent for s in solids), min(s.z for s in solids))
    high = (max(s.x + s.extent for s in solids), max(s.y + s.extent for s in solids), max(s.top for s in solids))
    add_surroundings(spec, low, high)
    return world
