"""The two ends of the session interface, joined in memory, in virtual time: whatever is lost, robots ride and doors open."""

from __future__ import annotations

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.things.session import PassageSession
from somrs.adapters.things.session_messages import SessionRequest
from somrs.adapters.things.simulated.body import KinematicPassage
from somrs.adapters.things.simulated.controller import PassageController
from somrs.traffic.passage_call import PassageCall

LEVELS = {"G": 0.0, "1": 4.0}
STEP = 0.1


def lift() -> PassageController:
    return PassageController(KinematicPassage(LEVELS))


class Joined:
    """A session and a controller. Of the messages between them, some are lost, as `losses` says."""

    def __init__(self, session: PassageSession, controller: PassageController, losses: list[bool]) -> None:
        self.session, self.controller, self.losses = session, controller, losses
        self.now = 0.0

    def call(self, call: PassageCall | None) -> None:
        self._send(self.session.called(call, self.now))

    def _send(self, request: SessionRequest) -> None:
        if not self._is_lost():
            self.controller.request(msgspec.json.encode(request))

    def _is_lost(self) -> bool:
        return self.losses.pop() if self.losses else False

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            self.controller.body.step(STEP)
            if not self._is_lost():
                request = self.session.heard(msgspec.json.encode(self.controller.state()), self.now)
                if request is not None:
                    self._send(request)


@given(st.lists(st.booleans(), max_size=40), st.lists(st.booleans(), max_size=40))
def test_a_ride_whatever_messages_are_lost(losses: list[bool], further_losses: list[bool]) -> None:
    joined = Joined(PassageSession("somrs-Lift1", {0.0: "G", 4.0: "1"}), lift(), losses)
    joined.call(PassageCall(level=0.0, destination=4.0))
    joined.run(20)
    assert joined.session.is_ready
    assert joined.session.status().level == 0.0
    joined.losses = further_losses
    joined.call(PassageCall(level=4.0))
    assert not joined.session.is_ready
    joined.run(30)
    assert joined.session.is_ready
    joined.call(None)
    joined.run(20)
    assert joined.controller.session is None
    assert joined.controller.state().doors == "closed"


def test_a_door_stays_open_for_its_session() -> None:
    door = Joined(PassageSession("somrs-Door1", {}), PassageController(KinematicPassage({})), [])
    door.call(PassageCall())
    door.run(3)
    assert door.session.is_ready
    door.run(60)
    assert door.controller.state().doors == "open"
    door.call(None)
    door.run(3)
    assert door.controller.state().doors == "closed"


def test_the_cabin_moves_with_closed_doors_only() -> None:
    joined = Joined(PassageSession("somrs-Lift1", {0.0: "G", 4.0: "1"}), lift(), [])
    joined.call(PassageCall(level=0.0))
    joined.run(3)
    joined.call(PassageCall(level=4.0))
    for _ in range(100):
        joined.run(STEP)
        assert joined.controller.body.level is not None or joined.controller.body.doors == "closed"


def test_a_lift_that_somebody_else_has_is_shared_and_then_granted() -> None:
    controller = lift()
    controller.request(msgspec.json.encode(SessionRequest(session="bed-7", level="1")))
    joined = Joined(PassageSession("somrs-Lift1", {0.0: "G", 4.0: "1"}), controller, [])
    joined.call(PassageCall(level=0.0))
    joined.run(10)
    assert joined.session.status().shared
    assert not joined.session.is_ready
    controller.request(msgspec.json.encode(SessionRequest(session="bed-7", end=True)))
    joined.run(15)
    assert joined.session.is_ready


def test_no_session_begins_while_there_is_a_fire() -> None:
    controller = lift()
    controller.mode = "fire"
    joined = Joined(PassageSession("somrs-Lift1", {0.0: "G", 4.0: "1"}), controller, [])
    joined.call(PassageCall(level=0.0))
    joined.run(10)
    assert not joined.session.is_ready
    assert not joined.session.status().working
