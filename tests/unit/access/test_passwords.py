"""Passwords, and how long one waits after wrong ones."""

from __future__ import annotations

import pytest

from somrs.access.passwords import MIN_LENGTH, SignInDelays, hashed_password, is_right
from somrs.errors import UsageError


def test_a_password_is_known_by_its_hash_only() -> None:
    hashed = hashed_password("a few easy words")
    assert hashed.startswith("$argon2id$")
    assert is_right("a few easy words", hashed)
    assert not is_right("a few easy word", hashed)
    assert not is_right("a few easy words", None), "nobody without a password signs in with one"
    assert not is_right("a few easy words", "not a hash")


@pytest.mark.parametrize("password", ["", "x" * (MIN_LENGTH - 1), "x" * 1025])
def test_short_and_endless_passwords_are_refused(password: str) -> None:
    with pytest.raises(UsageError, match="characters"):
        hashed_password(password)


def test_wrong_tries_double_the_time_until_the_next() -> None:
    delays = SignInDelays(free_tries=3, most_seconds=60.0)
    waits = []
    for _ in range(10):
        delays.note_failure("Ada", "10.0.0.1", now=100.0)
        waits.append(delays.seconds_left("ada", "10.0.0.1", now=100.0))
    assert waits == [0, 0, 1, 2, 4, 8, 16, 32, 60, 60]
    assert delays.seconds_left("Ada", "10.0.0.1", now=130.0) == 30.0
    assert delays.seconds_left("Ada", "10.0.0.2", now=100.0) == 0, "the person elsewhere does not wait"
    assert delays.seconds_left("Grace", "10.0.0.1", now=100.0) == 0, "others there do not wait yet"
    delays.note_success("Ada", "10.0.0.1")
    assert delays.seconds_left("Ada", "10.0.0.1", now=100.0) == 0


def test_an_address_that_tries_many_names_waits() -> None:
    delays = SignInDelays(free_tries=3, most_seconds=60.0)
    for number in range(31):
        delays.note_failure(f"person {number}", "10.0.0.1", now=0.0)
    assert delays.seconds_left("somebody", "10.0.0.1", now=0.0) == 2.0
    assert delays.seconds_left("somebody", "10.0.0.2", now=0.0) == 0
