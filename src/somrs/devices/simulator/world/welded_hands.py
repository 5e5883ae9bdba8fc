"""The constraints of the physics that join hands to what they hold.

A hand is welded to a thing. It is joined to the handle of a leaf so that it can still turn. `chassis.py` makes both constraints for each
hand.
"""

from __future__ import annotations

import mujoco
import numpy as np

from somrs.devices.simulator.world.hands import Hands
from somrs.space.distances import Array


class WeldedHands(Hands):
    """The hands of all robots in a compiled model."""

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Use a newly compiled model."""
        self._model, self._data = model, data

    def _take(self, robot: str, thing: str) -> None:
        data, hand, body = self._data, self._hand(robot), self._model.body(thing).id
        inverse, place, turn = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(inverse, data.xquat[hand])
        mujoco.mju_rotVecQuat(place, data.xpos[body] - data.xpos[hand], inverse)
        mujoco.mju_mulQuat(turn, inverse, data.xquat[body])
        # Anchor of the welded body, its position and rotation in the hand's frame, and the weight of the rotation.
        self._join(_weld(robot), thing, np.array([0, 0, 0, *place, *turn, 1, *([0] * (self._model.eq_data.shape[1] - 11))]))

    def _drop(self, robot: str) -> None:
        self._part(_weld(robot))

    def _take_handle(self, robot: str, leaf: str) -> None:
        data, hand, body = self._data, self._hand(robot), self._model.body(leaf).id
        anchor, inverse = np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(inverse, data.xquat[body])
        mujoco.mju_rotVecQuat(anchor, data.xpos[hand] - data.xpos[body], inverse)
        self._join(_pull(robot), leaf, np.array([0, 0, 0, *anchor, *([0] * (self._model.eq_data.shape[1] - 6))]))

    def _drop_handle(self, robot: str) -> None:
        self._part(_pull(robot))

    # Constraints

    def constraints(self) -> dict[str, tuple[str, Array]]:
        """The active constraints by name: the body that is joined to the hand, and how."""
        welds = {_weld(robot): thing for robot, thing in self.held.items()}
        pulls = {_pull(robot): leaf for robot, leaf in self.pulled.items()}
        return {name: (body, self._model.eq_data[self._constraint(name)].copy()) for name, body in (welds | pulls).items()}

    def restore(self, constraints: dict[str, tuple[str, Array]]) -> None:
        """Activate the constraints in a newly compiled model."""
        for name, (body, frame) in constraints.items():
            self._join(name, body, frame)

    def _join(self, name: str, body: str, frame: Array) -> None:
        constraint = self._constraint(name)
        self._model.eq_obj2id[constraint] = self._model.body(body).id
        self._model.eq_data[constraint] = frame
        self._data.eq_active[constraint] = 1

    def _part(self, name: str) -> None:
        self._data.eq_active[self._constraint(name)] = 0

    def _constraint(self, name: str) -> int:
        return int(mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_EQUALITY, name))

    def _hand(self, robot: str) -> int:
        return int(self._model.body(f"{robot}/wrist").id)


def _weld(robot: str) -> str:
    return f"{robot}/grasp"


def _pull(robot: str) -> str:
    return f"{robot}/pull"
