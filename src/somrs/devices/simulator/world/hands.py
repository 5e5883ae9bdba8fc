"""What robots' hands hold, and the constraints of the physics that join it to them.

A hand is welded to a thing. It is joined to the handle of a leaf so that it can still turn. `chassis.py` makes both constraints for each
hand. Who may hold what, and how a hand gets there, is in `motion/`.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from somrs.space.distances import Array


class Hands:
    """The hands of all robots. `held`: the thing that is welded to each hand, by robot; `pulled`: the leaf whose handle it holds.

    `disturb` is called when bodies at rest may begin to move.
    """

    def __init__(self, disturb: Callable[[], None]) -> None:
        self.held: dict[str, str] = {}
        self.pulled: dict[str, str] = {}
        self._disturb = disturb

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Use a newly compiled model."""
        self._model, self._data = model, data

    def holder(self, thing: str) -> str | None:
        return next((robot for robot, held in self.held.items() if held == thing), None)

    def hold(self, robot: str, thing: str) -> None:
        """Weld a thing to the robot's hand in its current relative pose. The caller has checked that both fingers touch it."""
        data, hand, body = self._data, self._hand(robot), self._model.body(thing).id
        inverse, place, turn = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(inverse, data.xquat[hand])
        mujoco.mju_rotVecQuat(place, data.xpos[body] - data.xpos[hand], inverse)
        mujoco.mju_mulQuat(turn, inverse, data.xquat[body])
        # Anchor of the welded body, its position and rotation in the hand's frame, and the weight of the rotation.
        self._join(_weld(robot), thing, np.array([0, 0, 0, *place, *turn, 1, *([0] * (self._model.eq_data.shape[1] - 11))]))
        self.held[robot] = thing

    def release(self, robot: str) -> None:
        """Release the thing that the robot holds, if it does."""
        self._part(_weld(robot))
        self._disturb()
        self.held.pop(robot, None)

    def hold_handle(self, robot: str, leaf: str) -> None:
        """Join the robot's hand to a leaf; it can still turn. The caller has checked that both fingers touch a handle."""
        data, hand, body = self._data, self._hand(robot), self._model.body(leaf).id
        anchor, inverse = np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(inverse, data.xquat[body])
        mujoco.mju_rotVecQuat(anchor, data.xpos[hand] - data.xpos[body], inverse)
        self._join(_pull(robot), leaf, np.array([0, 0, 0, *anchor, *([0] * (self._model.eq_data.shape[1] - 6))]))
        self.pulled[robot] = leaf
        self._disturb()

    def let_go(self, robot: str) -> None:
        """Release the handle that the robot holds, if it does."""
        if self.pulled.pop(robot, None) is not None:
            self._part(_pull(robot))
            self._disturb()

    def remove(self, name: str) -> None:
        """Part everything that joins an object, which is about to be removed, to a hand; or the hand of a robot to anything."""
        for robot in [robot for robot, thing in self.held.items() if name in (robot, thing)]:
            self.release(robot)
        for robot in [robot for robot, leaf in self.pulled.items() if name in (robot, leaf.split("/")[0])]:
            self.let_go(robot)

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
