"""The rides of robots that are not simulated: the lifts are called for them, and they are told when the doors are open.

A simulated robot calls a lift itself. One of another make has the lift when it holds places of it, which is what the call follows from.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from somrs.devices.simulator.motion.robot import Lift
from somrs.protocol.messages.envelope import Message
from somrs.traffic.component import Traffic
from somrs.traffic.passages import Passage, is_inside, lifts_held, next_passage, opened


class ForeignRides:
    """The lifts that robots have which are not simulated. `deliver`: sends a message to its recipient."""

    def __init__(self, lifts: Mapping[str, Lift], deliver: Callable[[Message], None]) -> None:
        self._lifts, self._deliver = lifts, deliver
        self._notices: dict[str, tuple[int, Passage]] = {}
        """What the robots were told last to be open, with their fences."""
        self._called_lifts: dict[str, str] = {}
        """The lifts that were called, by the robots for which they were."""

    def advance(self, traffic: Traffic, foreign: list[str]) -> None:
        """Call the lifts that robots need now, and release those that they need no more."""
        for robot, lift in [*self._called_lifts.items()]:
            if lift not in lifts_held(traffic, robot):
                del self._called_lifts[robot]
                if lift in self._lifts:
                    self._lifts[lift].release(robot)
        for robot in foreign:
            passage = next_passage(traffic, robot)
            if passage is not None and passage.lift in self._lifts:
                self._call(traffic, robot, passage, self._lifts[passage.lift])

    def _call(self, traffic: Traffic, robot: str, passage: Passage, lift: Lift) -> None:
        notice = traffic.state.robots[robot].fence, passage
        if self._notices.get(robot) == notice or not (lift.is_usable or is_inside(traffic, robot)):
            return
        self._called_lifts[robot] = passage.lift
        if lift.call(robot, passage.level):
            self._notices[robot] = notice
            self._deliver(opened(traffic, robot, passage))
