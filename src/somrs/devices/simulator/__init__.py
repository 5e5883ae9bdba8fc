"""A world made from the Repository's map, with robots in it that are driven over TCP.

The physics starts whatever OpenGL there is: MuJoCo would import what `MUJOCO_GL` names at once, and fall with it. So that choice
is kept in `SOMRS_GRAPHICS`, for this process and those that it starts, until a picture is wanted (`camera.py`).
"""

import os

GRAPHICS = os.environ.setdefault("SOMRS_GRAPHICS", os.environ.get("MUJOCO_GL", ""))
"""The kind of OpenGL that the user chose for pictures: egl, osmesa, disable, or empty for whatever works."""

os.environ["MUJOCO_GL"] = "disable"
