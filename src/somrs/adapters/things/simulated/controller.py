"""The controller of a lift or a door: who has it, and what its body does for this session."""

from __future__ import annotations

import msgspec

from somrs.adapters.things.session_messages import Mode, SessionRequest, SessionState
from somrs.adapters.things.simulated.body import PassageBody


class PassageController:
    """One session at a time. Others ask again until they get it. `mode`: other modes than normal grant no session."""

    def __init__(self, body: PassageBody, *, has_levels: bool) -> None:
        self.body, self._has_levels = body, has_levels
        self.mode: Mode = "normal"
        self.session: str | None = None
        self._level: str | None = None

    def request(self, payload: bytes) -> None:
        """Take in a request. Others than requests are ignored."""
        try:
            request = msgspec.json.decode(payload, type=SessionRequest)
        except msgspec.DecodeError:
            return
        if request.end:
            if request.session == self.session:
                self.session = self._level = None
            return
        if self.session is None and self.mode == "normal":
            self.session = request.session
        if request.session == self.session:
            self._level = request.level

    def step(self, seconds: float) -> None:
        """Let time pass: first the doors close, then the cabin moves, then the doors open."""
        is_there = not self._has_levels or (self._level is not None and self.body.level == self._level)
        self.body.move_doors(opening=self.session is not None and is_there)
        if self.session is not None and self._level is not None and not is_there and self.body.doors_open == 0.0:
            self.body.move_to(self._level)
        self.body.step(seconds)

    def state(self) -> SessionState:
        doors_open = self.body.doors_open
        return SessionState(
            doors="open" if doors_open == 1.0 else "closed" if doors_open == 0.0 else "moving",
            level=self.body.level,
            session=self.session,
            mode=self.mode,
        )
