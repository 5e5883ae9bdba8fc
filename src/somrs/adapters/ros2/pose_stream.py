"""Whether the poses of a robot that drives still come, without I/O and clock: by how much else comes between two of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection

LEARNT = 10
"""After so many poses in drives, the rhythm of a stream is known."""
REMEMBERED = 20
"""Of the last so many poses, the longest gap is the usual one."""
LEAST = 3.0
"""The usual gap is at least this: messages on several wires do not come in the order in which they are sent."""
MISSING = 5.0
"""In so many usual gaps without a pose, poses do not come any more."""


class PoseStream:
    """The poses of one robot."""

    def __init__(self) -> None:
        self._gaps: deque[float] = deque(maxlen=REMEMBERED)
        self._gap = 0.0
        self._renewed: set[str] = set()
        self.is_missing = False
        """Whether poses came in drives, and do not come any more."""

    def add(self, *, is_driving: bool) -> None:
        """A pose has come."""
        if is_driving and not self.is_missing:
            self._gaps.append(self._gap)
        self._gap, self.is_missing = 0.0, False

    def add_part(self, frames: Collection[str], needed: Collection[str], *, is_driving: bool) -> None:
        """Transforms of these frames have come; a pose has, when those of all the `needed` ones have."""
        self._renewed.update(frames)
        if self._renewed.issuperset(needed):
            self._renewed.clear()
            self.add(is_driving=is_driving)
        elif is_driving:
            self.wait(1.0)

    def wait(self, amount: float) -> None:
        """Something else has come from the robot, which drives: a message, or the speed at which it was in the last tenth of a second."""
        self._gap += amount
        if len(self._gaps) >= LEARNT and self._gap > MISSING * max(LEAST, *self._gaps):
            self.is_missing = True
