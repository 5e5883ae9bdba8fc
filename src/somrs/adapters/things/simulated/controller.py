"""The controller of a lift or a door: who has it, and what its body does for this session."""

from __future__ import annotations

import msgspec

from somrs.adapters.things.session_messages import Mode, SessionRequest, SessionState
from somrs.adapters.things.simulated.body import PassageBody


class PassageController:
    """One session at a time. Others ask again until they get it. `mode`: other modes than normal grant no session."""

    def __init__(self, body: PassageBody) -> None:
        self.body = body
        self.mode: Mode = "normal"
        self.session: str | None = None
        self._served: tuple[str | None] | None = None
        """The level of the session, if its body is to serve it."""

    def request(self, payload: bytes) -> None:
        """Take in a request. What is not a request is ignored."""
        try:
            request = msgspec.json.decode(payload, type=SessionRequest)
        except msgspec.DecodeError:
            return
        if request.end:
            if request.session == self.session:
                self.session = self._served = None
                self.body.release()
            return
        if self.session is None and self.mode == "normal":
            self.session = request.session
        if request.session == self.session and self._served != (request.level,):
            self._served = (request.level,)
            self.body.serve(request.level)

    def state(self) -> SessionState:
        mode = self.mode if self.body.works else "out-of-order"
        return SessionState(doors=self.body.doors, level=self.body.level, session=self.session, mode=mode)
