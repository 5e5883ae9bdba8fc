"""Which tasks and previews wait for the services on offer. They are answered from the Task Manager's copy of what the Registry lists.

The answer comes in the step of the request, if the copy is complete, and agrees with the map about service types. After a change of a
service type, providers, Registry and Repository agree again within a few seconds.
"""

from __future__ import annotations

import math

from msgspec import Struct

from somrs.kernel.component import Effect, Effects, Input, SetTimer
from somrs.kernel.service_replica import ServiceReplica, ServiceUpdate
from somrs.ontology.types import Ontology
from somrs.task_manager.requests import DISCOVERY_TIME, SETTLING_TIME, ForLook, ForPlan, ServicesKnown, is_out_of_date
from somrs.task_manager.timers import DiscoveryDue


class WaitingDiscovery(Struct, frozen=True, kw_only=True):
    """A task or preview that wants to know the services on offer since `since`.

    `confirmed`: as they are at the Registry then. Otherwise, news may be on its way.
    """

    purpose: ForPlan | ForLook
    since: float
    confirmed: bool = False


class Discovery(Struct, kw_only=True):
    """`directory`: the copy of what the Registry lists. It is None for a Task Manager whose journal goes back to a program that asked the
    Registry for each task, until it starts. `waiting`: in the order of their requests."""

    directory: ServiceReplica | None = None
    waiting: list[WaitingDiscovery] = []
    timer_at: float | None = None

    def start(self, owner: str, registry: str, now: float) -> list[Effect]:
        """Follow the Registry."""
        if self.directory is None:
            self.directory = ServiceReplica(owner, registry)
        return self.directory.start(now)

    def handle(self, event: Input, now: float) -> ServiceUpdate | None:
        """Handle an input; None if it does not concern the copy."""
        return self.directory.handle(event, now) if self.directory is not None else None

    def request(self, purpose: ForPlan | ForLook, now: float, *, confirmed: bool = False) -> None:
        """Ask for the services on offer; `confirmed`: as they are at the Registry now."""
        self.waiting.append(WaitingDiscovery(purpose=purpose, since=now, confirmed=confirmed))

    def confirm(self, now: float) -> Effects:
        """Ask the Registry for its version, if a request depends on it. One question serves all requests before it."""
        directory = self.directory
        if directory is None or directory.subscription is not None:
            return
        if any(self._is_unconfirmed(request, directory) for request in self.waiting):
            yield from directory.ask_version(now)

    @staticmethod
    def _is_unconfirmed(request: WaitingDiscovery, directory: ServiceReplica) -> bool:
        return request.confirmed and directory.known_since < request.since

    def next_answer(self, ontology: Ontology, now: float) -> ServicesKnown | None:
        """Take the next request that can be answered, and return the answer."""
        directory = self.directory
        if directory is None or not self.waiting:
            return None
        is_settled = directory.settles_at(now) is None and not is_out_of_date(directory.offers, ontology)
        for number, request in enumerate(self.waiting):
            is_known = directory.is_current and not self._is_unconfirmed(request, directory)
            if is_known and (is_settled or now >= request.since + SETTLING_TIME):
                del self.waiting[number]
                return ServicesKnown(request.purpose, None)
            if now >= request.since + DISCOVERY_TIME:
                del self.waiting[number]
                # The offers as they were are better than none.
                return ServicesKnown(request.purpose, None if directory.ready else "the Service Registry does not answer")
        return None

    def set_timer(self, now: float) -> Effects:
        """Set the timer for the requests that still wait."""
        directory = self.directory
        fire_time: float | None = None
        if directory is not None and self.waiting:
            times = [request.since + seconds for request in self.waiting for seconds in (SETTLING_TIME, DISCOVERY_TIME)]
            fire_time = min(time for time in (*times, directory.settles_at(now) or math.inf) if time > now)
        if fire_time != self.timer_at:
            self.timer_at = fire_time
            yield SetTimer(DiscoveryDue(), fire_time)
