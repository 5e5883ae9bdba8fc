"""The appearance of a simulated world: materials, light, and the visible parts of furniture. These parts do not collide."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco

from somrs.devices.simulator.world.colours import METAL, Colour, colour_of, shade
from somrs.space.leaves import HANDLE_LENGTH, Leaf, boards, panels
from somrs.space.solids import Role, Solid

PICTURE_SIZE = (1200, 900)
"""Width and height of the largest picture, pixels; OpenGL reserves memory for it."""


def add_surroundings(spec: mujoco.MjSpec, low: tuple[float, float, float], high: tuple[float, float, float]) -> None:
    """Add sky, ground, lights and materials, for a world between two corners."""
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.97], rgb2=[0.62, 0.68, 0.74], width=256, height=1536,
    )  # fmt: skip
    spec.add_texture(
        name="tiles", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT, mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=[0.98, 0.98, 0.98], markrgb=[0.86, 0.86, 0.86], width=256, height=256,
    )  # fmt: skip
    tiles = spec.add_material(name="tiles", texuniform=True, texrepeat=[1.0, 1.0], specular=0.15, shininess=0.3)
    tiles.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    spec.add_material(name="matt", specular=0.08, shininess=0.1)
    spec.add_material(name="satin", specular=0.35, shininess=0.5)
    headlight = spec.visual.headlight
    headlight.ambient, headlight.diffuse, headlight.specular = [0.46, 0.46, 0.47], [0.18, 0.18, 0.18], [0.04, 0.04, 0.04]
    middle = [(lower + upper) / 2 for lower, upper in zip(low, high, strict=True)]
    size = max(high[0] - low[0], high[1] - low[1], 4.0)
    directional = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light_position = [middle[0] + size / 2, middle[1] - size / 2, high[2] + size]
    sun = spec.worldbody.add_light(name="sun", type=directional, pos=light_position, dir=[-0.35, 0.3, -1], castshadow=True)
    sun.diffuse, sun.specular = [0.42, 0.41, 0.38], [0.2, 0.2, 0.2]
    sky = spec.worldbody.add_light(name="sky", type=directional, pos=light_position, dir=[0.5, 0.6, -0.6], castshadow=False)
    sky.diffuse, sky.specular = [0.16, 0.17, 0.2], [0, 0, 0]
    spec.worldbody.add_geom(
        name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, pos=[middle[0], middle[1], low[2] - 0.02], size=[4 * size, 4 * size, 1],
        rgba=[0.80, 0.83, 0.85, 1], contype=0, conaffinity=0, material="matt",
    )  # fmt: skip
    spec.stat.center, spec.stat.extent = middle, size * 0.7
    spec.visual.map.znear, spec.visual.map.zfar = 0.05 / (size * 0.7), 60.0
    spec.visual.map.shadowclip, spec.visual.map.shadowscale = 1.0, 0.9
    spec.visual.quality.shadowsize, spec.visual.quality.offsamples = 4096, 4
    spec.visual.global_.offwidth, spec.visual.global_.offheight = PICTURE_SIZE


Draw = Callable[[mujoco.MjsBody, Solid, Colour], None]


def _part(
    body: mujoco.MjsBody,
    size: tuple[float, float, float],
    pos: tuple[float, float, float],
    rgba: Colour,
    kind: str = "box",
    material: str = "satin",
) -> None:
    """Add a visible part. `size`: the full lengths of a box, radius and height of a cylinder, or the radii of an ellipsoid."""
    form = getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")
    sizes = [size[0] / 2, size[1] / 2, size[2] / 2] if kind == "box" else [size[0], size[2] / 2, 0] if kind == "cylinder" else list(size)
    body.add_geom(type=form, size=sizes, pos=list(pos), rgba=list(rgba), contype=0, conaffinity=0, mass=0, material=material)


def _table(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    board, leg = min(0.035, s.height / 4), 0.045
    _part(body, (s.width, s.depth, board), (0, 0, s.height - board / 2), c)
    for x in (-1, 1):
        for y in (-1, 1):
            position = (x * (s.width / 2 - leg), y * (s.depth / 2 - leg), (s.height - board) / 2)
            _part(body, (leg, leg, s.height - board), position, METAL)


def _cupboard(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    plinth, _ = boards(s)
    _part(body, (s.width - 0.04, s.depth - 0.04, plinth - 0.01), (0, 0, plinth / 2 - 0.005), shade(c, 0.4))
    for panel in panels(s):
        colour = shade(c, 1.25) if panel.z + panel.height >= s.height else c
        _part(body, (panel.width, panel.depth, panel.height), (panel.x, panel.y, panel.z + panel.height / 2), colour)


def _shelf(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    levels, board = max(1, round(s.height / 0.35)), 0.025
    for i in range(levels + 1):
        z = board / 2 + (s.height - board) * i / levels
        _part(body, (s.width, s.depth, board), (0, 0, z), c)
    for side in (-1, 1):
        _part(body, (s.width - 0.01, board, s.height - 0.01), (0, side * (s.depth - board) / 2, s.height / 2 - 0.005), shade(c, 0.8))
    _part(body, (0.01, s.depth - 0.02, s.height - 0.02), (-s.width / 2 + 0.01, 0, s.height / 2), shade(c, 0.7))


def _platform(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    top = min(0.05, s.height / 3)
    _part(body, (s.width - 0.06, s.depth - 0.06, s.height - top), (0, 0, (s.height - top) / 2), shade(c, 0.35))
    _part(body, (s.width, s.depth, top), (0, 0, s.height - top / 2), c)


def _chair(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    seat, leg = 0.52 * s.height, 0.03
    _part(body, (s.width, s.depth, 0.04), (0, 0, seat), c)
    _part(body, (0.03, s.depth * 0.95, 0.4 * s.height), (-s.width / 2 + 0.02, 0, s.height - 0.2 * s.height), c)
    for x in (-1, 1):
        for y in (-1, 1):
            tall = s.height * 0.95 if x < 0 else seat
            _part(body, (leg, leg, tall), (x * (s.width / 2 - leg), y * (s.depth / 2 - leg), tall / 2), METAL)


def _plant(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    radius = s.extent * (0.7 if s.form == "Box" else 1.0)
    pot = min(0.35 * s.height, 0.4)
    _part(body, (0.7 * radius, 0, pot), (0, 0, pot / 2), (0.55, 0.30, 0.22, 1), "cylinder", "matt")
    for i in range(7):
        angle, ring = i * 2.4, 0.0 if i == 6 else 0.45 * radius
        leaf = (0.55 * radius, 0.55 * radius, 0.28 * (s.height - pot))
        position = (ring * math.cos(angle), ring * math.sin(angle), pot + (s.height - pot) * (0.3 + 0.07 * i))
        _part(body, leaf, position, shade(c, 0.8 + 0.08 * (i % 4)), "ellipsoid", "matt")


def _door(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    """Draw a frame in the wall."""
    along_y = s.depth >= s.width
    length, thick = (s.depth, s.width) if along_y else (s.width, s.depth)

    def piece(offset_along: float, offset_across: float, z: float, size: tuple[float, float, float], colour: Colour) -> None:
        position = (offset_across, offset_along, z) if along_y else (offset_along, offset_across, z)
        _part(body, (size[1], size[0], size[2]) if along_y else size, position, colour)

    for side in (-1, 1):
        piece(side * (length / 2 - 0.02), 0, s.height / 2, (0.04, thick + 0.03, s.height), shade(c, 0.6))
    piece(0, 0, s.height - 0.02, (length, thick + 0.03, 0.04), shade(c, 0.6))


def draw_leaf(body: mujoco.MjsBody, leaf: Leaf) -> None:
    """Draw the leaf of a door or container in the leaf's frame: x along the leaf, from its `end`; y against its front."""
    colour, middle = shade(colour_of(leaf.owner), 1.1), (leaf.bottom + leaf.top) / 2
    if leaf.slides:
        _part(body, (leaf.width - 0.08, 0.03, leaf.top - 0.05), (leaf.width / 2, 0, leaf.top / 2 - 0.02), colour)
        return
    _part(body, (leaf.width - 0.006, leaf.thickness, leaf.top - leaf.bottom - 0.006), (leaf.width / 2, 0, middle), colour)


def draw_handle(body: mujoco.MjsBody, x: float, y: float, z: float, surface: float) -> None:
    """Draw the two brackets between an upright handle and the surface of its leaf, at `surface` on the y axis."""
    for end in (-1, 1):
        _part(body, (0.012, abs(y - surface), 0.012), (x, (y + surface) / 2, z + end * (HANDLE_LENGTH / 2 - 0.008)), METAL)


def _jar(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    if s.form != "Cylinder":
        _plain(body, s, c)
        return
    lid = 0.16 * s.height
    _part(body, (s.radius, 0, s.height - lid), (0, 0, (s.height - lid) / 2), c, "cylinder")
    _part(body, (0.94 * s.radius, 0, lid), (0, 0, s.height - lid / 2), shade(c, 0.45), "cylinder")


def _bottle(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    if s.form != "Cylinder":
        _plain(body, s, c)
        return
    _part(body, (s.radius, 0, 0.7 * s.height), (0, 0, 0.35 * s.height), c, "cylinder")
    _part(body, (s.radius, s.radius, 0.12 * s.height), (0, 0, 0.7 * s.height), c, "ellipsoid")
    _part(body, (0.38 * s.radius, 0, 0.3 * s.height), (0, 0, 0.85 * s.height), shade(c, 0.8), "cylinder")


def _camera(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    """Draw a housing with a lens in front, without its pitch."""
    _part(body, (0.8 * s.width, s.depth, s.height), (-0.1 * s.width, 0, s.height / 2), c)
    _part(body, (0.2 * s.width, 0.6 * s.depth, 0.6 * s.height), (0.4 * s.width, 0, s.height / 2), shade(c, 0.3))


def _mark(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    """Draw a ring on the floor."""
    radius = max(s.extent, 0.1)
    form, pieces = mujoco.mjtGeom.mjGEOM_BOX, 24
    for i in range(pieces):
        angle = i * math.tau / pieces
        size, pos = [0.018, radius * math.tan(math.pi / pieces) + 0.002, 0.001], [radius * math.cos(angle), radius * math.sin(angle), 0.001]
        turn = [math.cos(angle / 2), 0, 0, math.sin(angle / 2)]
        body.add_geom(type=form, size=size, pos=pos, quat=turn, rgba=[*c[:3], 1], contype=0, conaffinity=0, mass=0, material="matt")
    _part(body, (radius, 0, 0.001), (0, 0, 0.0005), (*c[:3], 0.18), "cylinder", "matt")


def _plain(body: mujoco.MjsBody, s: Solid, c: Colour) -> None:
    match s.form:
        case "Box":
            _part(body, (s.width, s.depth, s.height), (0, 0, s.height / 2), c, material="tiles" if s.role is Role.FLOOR else "matt")
        case "Cylinder":
            _part(body, (s.radius, 0, s.height), (0, 0, s.height / 2), c, "cylinder", "matt")


_DRAWINGS: dict[str, Draw] = {
    "Table": _table,
    "Cupboard": _cupboard,
    "Shelf": _shelf,
    "Platform": _platform,
    "Scale": _platform,
    "Chair": _chair,
    "Plant": _plant,
    "Door": _door,
    "Jar": _jar,
    "Bottle": _bottle,
    "Camera": _camera,
    "Place": _mark,
}
_ROUND_TOO = ("Plant", "Jar", "Bottle", "Place")


def draw(body: mujoco.MjsBody, solid: Solid, ancestors: list[str]) -> None:
    """Add the visible parts of an object to its body: those of the nearest ancestor type with a drawing, or its plain form."""
    known_type = next((name for name in ancestors if name in _DRAWINGS), None)
    drawing = _DRAWINGS[known_type] if known_type is not None and (solid.form == "Box" or known_type in _ROUND_TOO) else _plain
    drawing(body, solid, colour_of(solid))
