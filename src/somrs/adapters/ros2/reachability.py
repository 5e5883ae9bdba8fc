"""Whether a robot with ROS 2 can be told something, and why not."""

from __future__ import annotations

import logging

from somrs.adapters.ros2.observer import Robot
from somrs.adapters.ros2.session import Session

log = logging.getLogger(__name__)


class Reachability:
    """That of one robot. `action`: that of its navigation; `poses`: the topic that says where it is, and on which frame."""

    def __init__(self, name: str, action: str, poses: str, session: Session, robot: Robot) -> None:
        self._name, self._action, self._poses, self._session, self._robot = name, action, poses, session, robot
        self._is_present = self._is_located = self._was_missed = False
        self._told_absence: tuple[str | None] | None = None
        """What was told last."""
        session.bridge_observers.append(self._tell)

    def note_presence(self, *, is_present: bool) -> None:
        """Whether a node serves the action of its navigation."""
        self._is_present = is_present
        if is_present and not self._is_located and not self._was_missed:
            self._was_missed = True
            log.warning("%s: %s", self._name, self._absence)
        self._tell()

    def note_pose(self) -> None:
        """The robot has said where it is."""
        if not self._is_located:
            self._is_located = True
            self._tell()

    def _tell(self) -> None:
        absence = self._absence
        if (absence,) != self._told_absence:
            self._told_absence = (absence,)
            self._robot.heard(absence is None, absence)

    @property
    def _absence(self) -> str | None:
        """Why the robot cannot be told anything; None: it can."""
        if not self._session.is_connected:
            return self._session.problem
        if not self._is_present:
            return f"no node serves its action {self._action}"
        return f"its navigation is there, but nothing on {self._poses} has said yet where it is" if not self._is_located else None
