"""Keeps on the map why a device does not work, or cannot be reached: its attribute `Problem`.

It does not go the way of other reports, which wait until the device has joined: a device may not join because of its problem. And the
newest problem counts, not what was the case meanwhile.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable

from somrs.entish.formula import Attribute, Comparison, Name, Text
from somrs.errors import RemoteError
from somrs.ontology.types import PROBLEM
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.service_manager.sdk.map_reader import MapReader

log = logging.getLogger(__name__)

LONGEST = 300
"""Characters of a problem on the map: it may be in the words of the device, which may have many."""
LAST_REPORT = 2.0
"""Seconds for which a program that ends goes on to report."""


class ProblemReporter:
    """That of one device. `ask`: sends a request to the Repository, and repeats it until it is answered."""

    def __init__(self, device: str, ask: Callable[[Body], Awaitable[Body]]) -> None:
        self._device, self._map = device, MapReader(ask)
        self._problem = ""
        self._reported: str | None = None
        """What the map has; None: nobody has looked yet."""
        self._reporting: asyncio.Task[None] | None = None
        self._is_closed = False

    def take(self, problem: str | None) -> None:
        """The device has this problem; None: it has none, whatever the map says."""
        if (text := _brief(problem or "")) == self._problem and self._reported is not None:
            return
        self._problem = text
        if not self._is_closed and (self._reporting is None or self._reporting.done()):
            self._reporting = asyncio.create_task(self._report())

    def confirm(self) -> None:
        """The device has joined: what an earlier run of its program has left on the map does not count any more."""
        self.take(self._problem)

    async def close(self) -> None:
        """Report what is to be reported, within a short time."""
        self._is_closed = True
        if self._reporting is not None:
            await asyncio.wait({self._reporting}, timeout=LAST_REPORT)
            self._reporting.cancel()
            await asyncio.wait({self._reporting})

    async def _report(self) -> None:
        try:
            if self._reported is None:
                object = await self._map.object(self._device)
                if object is None:
                    return  # it is reported when the device has put itself there
                self._reported = str(object.values.get(PROBLEM, ""))
            while (problem := self._problem) != self._reported:
                self._reported = problem
                situation = Comparison(Attribute(Name(self._device), PROBLEM), "=", Text(problem))
                await self._map.report(UpdateMap(situation=str(situation), author=self._device))
        except RemoteError as error:  # a map of an earlier version has no such attribute
            log.debug("%s: its problem is not on the map: %s", self._device, error)


def _brief(problem: str) -> str:
    """A problem as a line of no more than so many characters, all of which can be printed."""
    line = "".join(character if character.isprintable() else "?" for character in " ".join(problem.split()))
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 3]}..."
