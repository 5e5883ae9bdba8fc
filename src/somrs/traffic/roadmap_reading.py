"""Reading the roadmap page by page while it may change: what is read is one edition, whole."""

from __future__ import annotations

from somrs.protocol.messages.traffic import ReadRoadmap, RoadmapPage, RoadmapPlace
from somrs.traffic.robot_tasks import RoadmapRead

LATEST = 30.0
"""Seconds after which a page is asked for again. Answers that are only slow still count."""


class RoadmapReading:
    """Readings of the roadmap, one after the other. The caller sends the requests, and passes the pages on with the requests that they
    answer."""

    def __init__(self) -> None:
        self.roadmap: RoadmapRead | None = None
        """What was read; None until a reading is complete."""
        self._places: list[RoadmapPlace] = []
        self._edition: int | None = None
        self._next: int | None = None
        """Where the page begins that is expected; None: nothing is being read."""
        self._due = 0.0

    @property
    def is_under_way(self) -> bool:
        return self._next is not None

    def begin(self, now: float) -> ReadRoadmap:
        """Read it from its beginning."""
        self.roadmap, self._places, self._edition = None, [], None
        return self._ask(0, now)

    def continued(self, now: float) -> ReadRoadmap | None:
        """The request for the expected page again, if it is time for that."""
        return self._ask(self._next, now) if self._next is not None and now >= self._due else None

    def failed(self) -> None:
        """A request was not delivered, or was refused."""
        self._due = 0.0

    def take(self, page: RoadmapPage, request: ReadRoadmap, now: float) -> ReadRoadmap | None:
        """Note a page. Returns the request for the next one; None if the reading is complete, or this page is not the expected one."""
        if request.after != self._next:
            return None
        if self._edition not in (None, page.edition):
            return self.begin(now)
        self._edition = page.edition
        self._places += page.places
        if page.more:
            return self._ask(page.next, now)
        self.roadmap, self._places, self._next = RoadmapRead(page.edition, tuple(self._places)), [], None
        return None

    def _ask(self, start: int, now: float) -> ReadRoadmap:
        self._next, self._due = start, now + LATEST
        return ReadRoadmap(after=start)
