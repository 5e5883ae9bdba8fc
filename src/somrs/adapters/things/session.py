"""The session of a lift or a door, for the one who asks for it (messages: `session_messages.py`)."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from somrs.adapters.things.session_messages import SessionRequest, SessionState
from somrs.traffic.passage_call import PassageCall, PassageStatus

REPEAT = 2.0
"""Seconds after which a request is sent again that the state does not show: the controller may have been started again."""
STANDING = 0.1
"""Difference in height up to which a floor is that of a level, m."""


class PassageSession:
    """The session of one lift or door. It keeps its name when the program is started again, so that a robot inside keeps the lift.

    `levels`: the names of the levels by the heights of their floors, m; empty for a door.
    """

    def __init__(self, name: str, levels: Mapping[float, str]) -> None:
        self.name, self._levels = name, dict(levels)
        self.call: PassageCall | None = None
        self.state: SessionState | None = None
        self.is_reachable = True
        self._request_time = float("-inf")
        self._has_request = False

    def called(self, call: PassageCall | None, now: float) -> SessionRequest:
        """The request for a call of traffic, or for its end."""
        self.call, self._request_time, self._has_request = call, now, True
        return self.request

    @property
    def request(self) -> SessionRequest:
        """What the passage is asked for now."""
        if self.call is None:
            return SessionRequest(session=self.name, end=True)
        return SessionRequest(session=self.name, level=self._level(self.call.level), destination=self._level(self.call.destination))

    def heard(self, payload: bytes, now: float) -> SessionRequest | None:
        """Take in a state, and return the request if it is to be sent again. Raises ValueError for what is not a state."""
        try:
            self.state = msgspec.json.decode(payload, type=SessionState)
        except msgspec.DecodeError as error:
            raise ValueError(f"{payload[:80]!r} is no state of a session: {error}") from None
        return self.repeat(now)

    def repeat(self, now: float) -> SessionRequest | None:
        """The request, if the state does not show that the passage has it, and it is time to send it again."""
        is_shown = self.is_ready if self.call is not None else self.state is not None and self.state.session != self.name
        if not self._has_request or is_shown or now < self._request_time + REPEAT:
            return None
        self._request_time = now
        return self.request

    @property
    def is_ready(self) -> bool:
        """Whether robots can come, as the call wants it."""
        state, call = self.state, self.call
        if state is None or call is None or state.session != self.name or state.doors != "open":
            return False
        return not self._levels or state.level == self._level(call.level)

    @property
    def unknown_level(self) -> str | None:
        """The level at which the cabin stands, if it is none of those of the storeys."""
        level = self.state.level if self.state is not None and self._levels else None
        return level if level not in self._levels.values() else None

    def status(self) -> PassageStatus:
        """How the passage is, for traffic."""
        state = self.state
        if state is None or not self.is_reachable:
            return PassageStatus(working=False)
        heights = [height for height, level in self._levels.items() if level == state.level]
        is_shared = state.mode == "shared" or state.session not in (None, self.name)
        return PassageStatus(level=heights[0] if heights else None, working=state.mode in ("normal", "shared"), shared=is_shared)

    def _level(self, height: float | None) -> str | None:
        if height is None or not self._levels:
            return None
        return next((level for floor, level in self._levels.items() if abs(floor - height) < STANDING), None)
