"""The session interface of lifts and doors: when robots can come, and what is asked for again."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.things.session import REPEAT, PassageSession
from somrs.adapters.things.session_messages import SessionRequest
from somrs.adapters.things.simulated.servers import last_will
from somrs.traffic.passage_call import PassageCall, PassageStatus

LEVELS = {0.0: "G", 4.0: "1"}


def state(session: str | None = "somrs-Lift1", level: str = '"G"', doors: str = "open", mode: str = "normal") -> bytes:
    owner = f'"{session}"' if session else "null"
    return f'{{"session": {owner}, "level": {level}, "doors": "{doors}", "mode": "{mode}"}}'.encode()


def lift() -> PassageSession:
    return PassageSession("somrs-Lift1", LEVELS)


def test_a_request_names_the_level_and_the_destination() -> None:
    request = lift().called(PassageCall(level=0.0, destination=4.0), 0)
    assert request == SessionRequest(session="somrs-Lift1", level="G", destination="1")


def test_robots_can_come_when_the_cabin_is_there_with_open_doors_in_this_session() -> None:
    session = lift()
    session.called(PassageCall(level=0.0), 0)
    for wrong_state in (state(session=None), state(session="other"), state(level='"1"'), state(level="null"), state(doors="moving")):
        session.heard(wrong_state, 0)
        assert not session.is_ready
    session.heard(state(), 1)
    assert session.is_ready
    session.called(PassageCall(level=4.0), 2)
    assert not session.is_ready


@pytest.mark.parametrize(("level", "unknown_level"), [('"G"', None), ("null", None), ('"EG"', "EG")])
def test_a_level_that_no_storey_has_is_noticed(level: str, unknown_level: str | None) -> None:
    session = lift()
    session.heard(state(level=level), 0)
    assert session.unknown_level == unknown_level


def test_a_door_has_no_levels() -> None:
    door = PassageSession("somrs-Door1", {})
    assert door.called(PassageCall(), 0) == SessionRequest(session="somrs-Door1")
    door.heard(b'{"doors": "open", "session": "somrs-Door1"}', 0)
    assert door.unknown_level is None
    assert door.is_ready


def test_a_request_is_sent_again_until_the_state_shows_it() -> None:
    session = lift()
    request = session.called(PassageCall(level=0.0), 0)
    assert session.heard(state(session=None), REPEAT - 0.1) is None
    assert session.heard(state(session=None), REPEAT) == request
    assert session.heard(state(session=None), REPEAT + 0.1) is None
    assert session.heard(state(), 2 * REPEAT) is None


def test_the_end_of_a_session_is_said_again_until_the_state_shows_it() -> None:
    session = lift()
    ended = session.called(None, 0)
    assert ended == SessionRequest(session="somrs-Lift1", end=True)
    assert session.heard(state(), REPEAT) == ended
    assert session.heard(state(session=None), 2 * REPEAT) is None


def test_nothing_is_asked_for_before_traffic_has_said_what_it_needs() -> None:
    assert lift().heard(state(), 100) is None


@pytest.mark.parametrize(
    ("payload", "status"),
    [
        (state(session=None), PassageStatus(level=0.0)),
        (state(level="null"), PassageStatus(level=None)),
        (state(session="ward-bed-7"), PassageStatus(level=0.0, shared=True)),
        (state(session=None, mode="shared"), PassageStatus(level=0.0, shared=True)),
        (state(session=None, mode="fire"), PassageStatus(level=0.0, working=False)),
        (state(session=None, mode="out-of-order"), PassageStatus(level=0.0, working=False)),
    ],
)
def test_traffic_learns_how_the_lift_is(payload: bytes, status: PassageStatus) -> None:
    session = lift()
    assert not session.status().working
    session.heard(payload, 0)
    assert session.status() == status


def test_a_lift_that_cannot_be_reached_does_not_work() -> None:
    session = lift()
    session.heard(state(), 0)
    session.is_reachable = False
    assert not session.status().working


def test_a_lift_does_not_work_when_its_controller_is_cut_off() -> None:
    session = lift()
    session.heard(state(), 0)
    will = last_will("lifts/1")
    assert (will.topic, will.retain) == ("lifts/1/state", True)
    assert isinstance(will.payload, bytes)
    session.heard(will.payload, 1)
    assert not session.status().working
    session.heard(state(), 2)
    assert session.status().working


@given(st.binary(max_size=40) | st.text(max_size=40).map(str.encode))
def test_what_is_no_state_changes_nothing(payload: bytes) -> None:
    session = lift()
    session.called(PassageCall(level=0.0), 0)
    session.heard(state(), 0)
    with pytest.raises(ValueError, match="is no state of a session"):
        session.heard(payload, 1)
    assert session.is_ready
