"""The wait of a task that is tried again later: its reasons, and the pauses between its attempts."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from somrs.protocol.messages import events
from somrs.protocol.messages.waits import Hindrance, WaitsToRetry

FIRST_PAUSE = 2.0
"""Seconds from a failed attempt to the next one. The pause doubles with each further attempt, up to `LONGEST_PAUSE`."""

LONGEST_PAUSE = 60.0

QUIET_EVENTS = (
    events.Planned | events.PlansCompared | events.Replanned | events.TriedOnceMore
    | events.ServicesAsked | events.TermsOffered | events.ServiceRefused | events.ServiceChosen | events.ServiceReplaced | events.NotBegun
)  # fmt: skip
"""The events of an attempt that may come to nothing."""


def next_wait(previous: WaitsToRetry | None, hindrances: Mapping[str, str], now: float, earliest: float = 0.0) -> WaitsToRetry:
    """The wait after an attempt that failed.

    `previous`: the wait before it; `hindrances`: the reasons, by subject; `earliest`: when the next attempt makes sense, s since 1970.
    """
    since = {(hindrance.subject, hindrance.reason): hindrance.since for hindrance in previous.hindrances} if previous is not None else {}
    pause = min(2 * previous.pause, LONGEST_PAUSE) if previous is not None else FIRST_PAUSE
    pause = max(pause, earliest - now)
    return WaitsToRetry(
        hindrances=tuple(
            Hindrance(subject=subject, reason=reason, since=since.get((subject, reason), now))
            for subject, reason in sorted(hindrances.items())
        ),
        since=previous.since if previous is not None else now,
        next_attempt=now + pause,
        pause=pause,
        attempts=previous.attempts + 1 if previous is not None else 1,
    )


def hastened(wait: WaitsToRetry, now: float) -> WaitsToRetry:
    """The wait with its next attempt at once, or `FIRST_PAUSE` after the last one; later pauses grow from `FIRST_PAUSE` again."""
    last_attempt = wait.next_attempt - wait.pause
    return structs.replace(wait, next_attempt=max(now, last_attempt + FIRST_PAUSE), pause=FIRST_PAUSE / 2)


def is_repeated(wait: WaitsToRetry, previous: WaitsToRetry | None) -> bool:
    """Whether an attempt brought nothing new."""
    return previous is not None and wait.hindrances == previous.hindrances
