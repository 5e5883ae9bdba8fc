"""Pictures of the simulated world as PNG: of the whole world, of a region, or of an object.

OpenGL comes from EGL, which needs no screen, or else from OSMesa. Without either, `SimulationError` is raised, and the simulation runs
without pictures. Each kind is first tried in a separate process, because a broken driver ends the whole process. The contexts are
MuJoCo's own.
"""

from __future__ import annotations

import importlib
import io
import math
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from PIL import Image

from somrs.devices.simulator import GRAPHICS
from somrs.devices.simulator.world.looks import PICTURE_SIZE
from somrs.devices.simulator.world.scene import Scene
from somrs.errors import SimulationError
from somrs.space.distances import distances_from
from somrs.space.solids import Role, Solid

_BACKENDS = ("egl", "osmesa")
NO_GRAPHICS = ("disable", "disabled", "off", "false", "0")
"""Values of MUJOCO_GL by which MuJoCo uses no OpenGL."""
DETAILED = 800
"""Width in pixels from which pictures have shadows, which take two thirds of the time, and are compressed as far as possible."""
NORTHWARD = 90.0
"""The azimuth of a camera that looks to the north, degrees."""
FIELD_OF_VIEW = 45.0
"""Vertical field of view of MuJoCo's free camera, degrees."""
TRIAL = """
import mujoco, {module} as platform
context = platform.GLContext(64, 64)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string('<mujoco/>'), 150)
"""
"""Program that tests whether drawing works: it makes the same contexts."""

Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class View:
    """A camera view: the target point and its distance from the camera (m), azimuth and elevation (degrees).

    `span`: the heights between which the undersides of the objects are that are shown, m; None: all are shown.
    """

    x: float
    y: float
    z: float
    distance: float
    azimuth: float = 135.0
    elevation: float = -45.0
    span: Span | None = None

    def shows(self, z: float) -> bool:
        """Whether an object whose underside is at this height is shown."""
        return self.span is None or self.span[0] <= z < self.span[1]


def opengl() -> str:
    """The kind of OpenGL that works on this machine. Raises SimulationError if none does."""
    if GRAPHICS in NO_GRAPHICS:
        raise SimulationError(f"pictures are switched off by MUJOCO_GL={GRAPHICS}")
    for kind in (GRAPHICS,) if GRAPHICS in _BACKENDS else _BACKENDS:
        environment = {**os.environ, "MUJOCO_GL": "disable", "PYOPENGL_PLATFORM": kind}
        trial = [sys.executable, "-c", TRIAL.format(module=f"mujoco.{kind}")]
        if subprocess.run(trial, env=environment, capture_output=True, timeout=60, check=False).returncode == 0:
            return kind
    raise SimulationError("no OpenGL is available for pictures; install libegl1 or libosmesa6 (on Debian), or continue without pictures")


def overview(scene: Scene) -> View:
    """A view of the whole building, from the south and above."""
    floors = scene.world.by_role(Role.FLOOR) or list(scene.world.solids.values())
    return _framing(floors)


def storey_view(scene: Scene, span: Span) -> View:
    """A view of a storey, with its lifts, from the south and above. `span`: the heights between which the undersides of its objects are, m.

    What stands higher is not shown, so that it hides nothing.
    """
    shown = [floor for floor in scene.world.by_role(Role.FLOOR) if span[0] <= floor.z < span[1]]
    top = max((floor.top for floor in shown), default=span[0])
    lifts = [replace(lift, z=top, height=0.0) for lift in scene.world.by_role(Role.LIFT)]
    return replace(_framing([*shown, *lifts], elevation=-64.0), span=span)


def region(scene: Scene, x: float, y: float, radius: float) -> View:
    """A view of everything within a radius of a point."""
    level = min((solid.top for solid in scene.world.by_role(Role.FLOOR)), key=abs, default=0.0)
    return View(x, y, level + 0.3, radius / math.tan(math.radians(FIELD_OF_VIEW / 2)) * 1.15, _open_side(scene, x, y), -38)


def close_up(scene: Scene, name: str) -> View:
    """A view of an object and its surroundings."""
    x, y, z, _ = scene.pose(name)
    solid = scene.world.solids[name]
    tall = max(1.1 if solid.role is Role.ROBOT else solid.height, 0.3)
    container = solid if solid.container else scene.container_at(x, y, z) if solid.role is Role.THING else None
    if container is not None:  # from in front of its doors
        return View(x, y, z + 0.45 * tall, 2.4 * max(container.height, container.extent) + 1.0, math.degrees(container.yaw) + 205.0, -20)
    return View(x, y, z + 0.45 * tall, 2.4 * max(tall, solid.extent) + 1.0, _open_side(scene, x, y), -30)


def _framing(solids: list[Solid], elevation: float = -58.0) -> View:
    """The nearest view from the south in which all solids, with walls 2.5 m high, fit into a picture of 4:3."""
    outline = [(*s.world(u, v), s.top + z) for s in solids for u, v in _corners(s) for z in (0.0, 2.5)]
    points = np.array(outline)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    turn, tilt = math.radians(NORTHWARD), math.radians(elevation)
    forward = np.array([math.cos(tilt) * math.cos(turn), math.cos(tilt) * math.sin(turn), math.sin(tilt)])
    right_axis = np.array([math.sin(turn), -math.cos(turn), 0.0])
    up_axis = np.cross(right_axis, forward)
    high = math.tan(math.radians(FIELD_OF_VIEW / 2)) * 0.92
    distance = 1.0
    for _ in range(8):  # the best target depends on the distance, because of perspective
        offsets = points - middle
        depth, horizontal, vertical = offsets @ forward, offsets @ right_axis, offsets @ up_axis
        distance = max(1.0, float(np.max(np.maximum(np.abs(horizontal) / (high * 4 / 3), np.abs(vertical) / high) - depth)))
        projected = vertical / (distance + depth)
        middle = middle + up_axis * (projected.max() + projected.min()) / 2 * distance * 0.8
    return View(float(middle[0]), float(middle[1]), float(middle[2]), distance, NORTHWARD, elevation)


def _corners(solid: Solid) -> list[tuple[float, float]]:
    if solid.form == "Polygon":
        return list(solid.outline)
    w, d = (solid.width / 2, solid.depth / 2) if solid.form == "Box" else (solid.radius, solid.radius)
    return [(-w, -d), (w, -d), (w, d), (-w, d)]


def _open_side(scene: Scene, x: float, y: float) -> float:
    """The azimuth, of eight, from which the fewest walls and pieces of furniture hide the point."""

    def hidden(azimuth: float) -> float:
        angle = math.radians(azimuth)
        points = np.array([(x - r * math.cos(angle), y - r * math.sin(angle)) for r in np.linspace(0.5, 2.5, 9)])
        return float(np.sum(scene.clearances(points, 0.3, 3.0) < 0.1))

    return min((60.0, 120.0, 30.0, 150.0, -60.0, -120.0, -30.0, -150.0), key=hidden)


def _screens(wall: Solid, floors: list[Solid], direction: np.ndarray[Any, Any], view: View, flat: float) -> bool:
    """Whether a wall faces the camera, is not far behind the target, and hides a floor."""
    if wall.form != "Box" or float((np.array([wall.x, wall.y]) - (view.x, view.y)) @ direction) < -0.4 * flat:
        return False
    angle = wall.yaw + (0.0 if wall.width < wall.depth else math.pi / 2)
    faces_camera = abs(math.cos(angle) * direction[0] + math.sin(angle) * direction[1]) > 0.7
    point_behind = (wall.x - 0.8 * direction[0], wall.y - 0.8 * direction[1])
    return faces_camera and any(floor.distance(*point_behind) < 0 for floor in floors)


def _hide_storeys(model: mujoco.MjModel, data: mujoco.MjData, view: View) -> None:
    """Make what the view does not show invisible. The ground is always there."""
    if view.span is None:
        return
    heights = data.xpos[model.body_rootid[model.geom_bodyid], 2]
    is_hidden = ((heights < view.span[0]) | (heights >= view.span[1])) & (model.geom_bodyid != 0)
    model.geom_rgba[is_hidden, 3] = 0.0


class Camera:
    """Takes pictures of a scene. It keeps an OpenGL context; make one per process and scene."""

    def __init__(self, scene: Scene, width: int = PICTURE_SIZE[0], height: int = PICTURE_SIZE[1]) -> None:
        kind = opengl()
        os.environ["PYOPENGL_PLATFORM"] = kind  # the import below reads it
        self._context: Any = importlib.import_module(f"mujoco.{kind}").GLContext(width, height)
        self._scene, self._width, self._height = scene, width, height
        self._model: mujoco.MjModel | None = None
        self._drawing: mujoco.MjvScene | None = None
        self._target: mujoco.MjrContext | None = None

    def picture(self, view: View | None = None, width: int | None = None) -> bytes:
        """A PNG of the current world; by default an overview of the building, and as wide as the camera allows."""
        view = view or overview(self._scene)
        self._context.make_current()
        model, data = self._scene.drawing()
        if self._model is not model:
            self._model = model
            self._drawing = mujoco.MjvScene(self._model, maxgeom=20000)
            self._target = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._target)
        camera = mujoco.MjvCamera()
        camera.lookat[:] = (view.x, view.y, view.z)
        camera.distance, camera.azimuth, camera.elevation = view.distance, view.azimuth, view.elevation
        colours = model.geom_rgba.copy()
        self._fade_walls(model, view)
        _hide_storeys(model, data, view)
        category_mask = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, data, mujoco.MjvOption(), None, camera, category_mask, self._drawing)
        model.geom_rgba[:] = colours
        width = min(width or self._width, self._width)
        height = width * self._height // self._width
        pixels, frame = np.zeros((height, width, 3), dtype=np.uint8), mujoco.MjrRect(0, 0, width, height)
        assert self._drawing is not None, "it was made with the model"
        self._drawing.flags[mujoco.mjtRndFlag.mjRND_SHADOW.value] = width >= DETAILED
        mujoco.mjr_render(frame, self._drawing, self._target)
        mujoco.mjr_readPixels(pixels, None, frame, self._target)
        buffer = io.BytesIO()
        Image.fromarray(np.flipud(pixels)).save(buffer, format="PNG", optimize=width >= DETAILED)
        return buffer.getvalue()

    def _fade_walls(self, model: mujoco.MjModel, view: View) -> None:
        """Make walls between the camera and its target transparent."""
        angle = math.radians(view.azimuth)
        direction = np.array([-math.cos(angle), -math.sin(angle)])  # from the target to the camera
        flat = view.distance * math.cos(math.radians(view.elevation))
        floors = [floor for floor in self._scene.world.by_role(Role.FLOOR) if view.shows(floor.z)]
        for wall in self._scene.world.by_role(Role.WALL, Role.DOOR):
            points = np.array([(view.x, view.y)]) + np.linspace(0.0, 1.0, 41)[:, None] * flat * direction
            side_direction = np.array([-direction[1], direction[0]])
            fan = np.concatenate([points + side * 0.12 * flat * side_direction for side in (-2, -1, 0, 1, 2)])
            if distances_from(wall, fan).min() < 0.15 or _screens(wall, floors, direction, view, flat):
                body = model.body(wall.name)
                first = int(body.geomadr[0])
                model.geom_rgba[first : first + int(body.geomnum[0]), 3] *= 0.18

    def close(self) -> None:
        """Free the OpenGL context."""
        if self._target is not None:
            self._target.free()
        self._context.free()
