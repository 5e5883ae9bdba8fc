"""Passwords, and how long one waits after wrong ones. A check is slow on purpose: a tenth of a second (Argon2id, RFC 9106)."""

from __future__ import annotations

from somrs.errors import UsageError

MIN_LENGTH = 10
"""Characters of a password. NIST SP 800-63B: length counts, rules about characters do not."""

MAX_LENGTH = 1024


def hashed_password(password: str) -> str:
    """The Argon2id hash of a new password, in its standard form. Raises UsageError if it is too short or too long."""
    from argon2 import PasswordHasher

    if not MIN_LENGTH <= len(password) <= MAX_LENGTH:
        raise UsageError(f"a password has {MIN_LENGTH} to {MAX_LENGTH} characters; a few words are easy to remember")
    return PasswordHasher().hash(password)


def is_right(password: str, hashed: str | None) -> bool:
    """Whether a password is that of the hash. Without one, the answer is no and takes as long, so that it tells nothing about accounts."""
    from argon2 import PasswordHasher
    from argon2.exceptions import Argon2Error, InvalidHashError

    if len(password) > MAX_LENGTH:
        return False
    try:
        return PasswordHasher().verify(hashed or _OTHER_HASH, password) and hashed is not None
    except (Argon2Error, InvalidHashError):
        return False


_OTHER_HASH = "$argon2id$v=19$m=65536,t=3,p=4$c29tcnMtbm8tYWNjb3VudA$bm9ib2R5J3MgcGFzc3dvcmQsIG9mIG5vIGFjY291bnQ"


class SignInDelays:
    """How long one has to wait between two tries to sign in. Nobody else waits: neither the person elsewhere, nor others.

    Tries are counted by name and address, and by address. After `free_tries` wrong ones, each further wrong one doubles the time.
    """

    def __init__(self, free_tries: int, most_seconds: float) -> None:
        self._free_tries, self._most_seconds = free_tries, most_seconds
        self._failures: dict[tuple[str, ...], tuple[int, float]] = {}

    def seconds_left(self, name: str, address: str, now: float) -> float:
        """Seconds until this try is looked at."""
        return max(0.0, *(until - now for key in _keys(name, address) for _, until in [self._failures.get(key, (0, 0.0))]))

    def note_failure(self, name: str, address: str, now: float) -> None:
        for key, allowance in zip(_keys(name, address), (self._free_tries, 10 * self._free_tries), strict=True):
            count = self._failures.get(key, (0, 0.0))[0] + 1
            delay = min(2.0 ** min(count - allowance, 60), self._most_seconds) if count >= allowance else 0.0
            self._failures[key] = count, now + delay
        if len(self._failures) > _MAX_COUNTED:
            forgotten = sorted(self._failures, key=lambda key: self._failures[key][1])[: _MAX_COUNTED // 2]
            for key in forgotten:
                del self._failures[key]

    def note_success(self, name: str, address: str) -> None:
        self._failures.pop(_keys(name, address)[0], None)


_MAX_COUNTED = 10_000
"""Names and addresses whose wrong tries are remembered."""


def _keys(name: str, address: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    return (name.casefold(), address), (address,)
