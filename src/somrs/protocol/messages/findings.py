"""The answer to a client that asks what is so (`Submit.recognise`): for which objects and values a formula holds, and who saw it when."""

from __future__ import annotations

from msgspec import Struct


class Sighting(Struct, frozen=True, kw_only=True):
    """What a service reported. `at`: seconds since 1970; `situation`: in Entish."""

    service: str
    at: float
    situation: str


class Finding(Struct, frozen=True, kw_only=True):
    """One answer: an object or value, as Entish, for each variable of the question, and the question with these.

    `sightings` are what services reported in this task about the objects of the answer, the latest first. Without any, nobody has looked at
    them now: the answer is that of the map.
    """

    situation: str
    bindings: dict[str, str] = {}
    sightings: tuple[Sighting, ...] = ()


class Unseen(Struct, frozen=True, kw_only=True):
    """A service that was to observe something and did not. `inputs` are Entish terms, `reason` says why."""

    service: str
    inputs: dict[str, str]
    reason: str


class Findings(Struct, frozen=True, kw_only=True):
    """The answers to a question, on the map after the observations; none: the question's formula does not hold.

    `observations` is the number of observations that were made, `unseen` those without a result. `more`: there are further answers.
    """

    formula: str
    answers: tuple[Finding, ...] = ()
    observations: int = 0
    unseen: tuple[Unseen, ...] = ()
    more: bool = False
