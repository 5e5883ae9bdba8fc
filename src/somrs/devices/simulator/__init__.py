"""A simulated world built from the Repository's map, with robots that are controlled over TCP.

The physics must start even if OpenGL is broken. MuJoCo imports the library that `MUJOCO_GL` names at once, and fails if that fails.
Therefore the choice is kept in `SOMRS_GRAPHICS`, for this process and its children, until a picture is requested (`camera.py`).
"""

import os

GRAPHICS = os.environ.setdefault("SOMRS_GRAPHICS", os.environ.get("MUJOCO_GL", ""))
"""The kind of OpenGL that the user chose for pictures: egl, osmesa or disable; empty for any that works."""

os.environ["MUJOCO_GL"] = "disable"
