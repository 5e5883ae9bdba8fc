"""Follows the map for traffic: has the building surveyed, ways closed, and traffic held. Its program does the work.

It keeps nothing on disk: whatever traffic is to know follows from the map, and is told once at the start, because traffic may know what was
so in an earlier run.
"""

from __future__ import annotations

from msgspec import Struct

from somrs.kernel.component import Answered, Ask, Effect, Effects, Input, Received, SetTimer, Started, TimerFired
from somrs.kernel.not_understood import refuse_request
from somrs.kernel.replica import Replica
from somrs.ontology.modes import MOBILE_ROBOT, hold_reason, modes
from somrs.traffic.notices import CloseWays, HoldTraffic
from somrs.traffic.survey import Survey

LOOK = 0.5
"""The time after which it is looked at again where robots are, in seconds."""


class SurveyDue(Struct, frozen=True, tag=True):
    """It may be that other robots take part."""


class SurveyQuestion(Struct, frozen=True, tag=True):
    """What is closed now?"""


class NoticeQuestion(Struct, frozen=True, tag=True):
    """Has traffic been notified?"""

    number: int


class MapFollower:
    """Asks its program to survey the building, and to notify traffic of what follows from the map. While there are no robots on it, there
    is nothing to do."""

    def __init__(self, address: str, repository: str) -> None:
        self.replica = Replica(address, repository, own=True)
        self._closing: CloseWays | None = None
        self._hold: str | None = None
        """The reason that traffic was told last; None before the first."""
        self._notice_count = 0
        self._is_survey_open = self._is_outdated = self._was_surveyed = False

    def handle(self, event: Input, now: float) -> list[Effect]:
        return [*self._effects(event, now)]

    def _effects(self, event: Input, now: float) -> Effects:
        match event:
            case Started():
                yield from self.replica.start(now)
            case Answered(SurveyQuestion(), value):
                self._is_survey_open = False
                if isinstance(value, CloseWays) and value != self._closing:
                    self._closing = value
                    yield self._notify(value)
                yield SetTimer(SurveyDue(), now + LOOK if self._has_robots else None)
                if self._is_outdated:
                    yield from self._survey()
            case TimerFired(SurveyDue()):
                yield from self._survey()
            case _:
                yield from self._follow(event, now)

    def _follow(self, event: Input, now: float) -> Effects:
        news = self.replica.handle(event, now)
        if news is None:
            if isinstance(event, Received):
                yield from refuse_request(event.message, "traffic follows a map here")
            return
        yield from news.effects
        if not self.replica.ready:
            return
        reason = hold_reason(modes(self.replica.map))
        if reason != self._hold:
            self._hold = reason
            yield self._notify(HoldTraffic(reason=reason))
        if (news.changes or news.ontology_changed) and (self._has_robots or self._was_surveyed):
            self._is_outdated = True
            yield from self._survey()

    def _survey(self) -> Effects:
        if not self._is_survey_open:
            self._is_survey_open, self._is_outdated, self._was_surveyed = True, False, True
            yield Ask(SurveyQuestion(), Survey(map=self.replica.map, ontology=self.replica.ontology))

    @property
    def _has_robots(self) -> bool:
        ontology = self.replica.ontology
        return any(ontology.is_subtype(object.type, MOBILE_ROBOT) for object in self.replica.map.objects.values())

    def _notify(self, notice: CloseWays | HoldTraffic) -> Ask:
        self._notice_count += 1
        return Ask(NoticeQuestion(self._notice_count), notice)
