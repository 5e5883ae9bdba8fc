"""The services available to one task: those that the Registry lists, without those that failed in the task."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from somrs.entish import Formula
from somrs.entish.formula import conjunction
from somrs.entish.parse import parse
from somrs.kernel.offers import Offers
from somrs.kernel.replica import Replica
from somrs.kernel.service_replica import ServiceReplica
from somrs.ontology.agreement import disagreements
from somrs.ontology.services import ServiceType
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import WORKING
from somrs.ontology.values import rest_reason, takes_work
from somrs.ontology.work_budget import ExcessiveWork
from somrs.planner.losses import resting_text
from somrs.planner.model.plan import NoPlan, Step
from somrs.planner.model.problem import LostService
from somrs.protocol.messages.directory import Offer
from somrs.task_manager.execution.bids import able_offers, precondition_now, relevant_situation
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import StepRun
from somrs.task_manager.known_services import Backoff, KnownServices

MOST_FAILURES = 5
"""After so many failures in a row, a task does not ask a service again, even if no other service can do the step."""


class AvailableServices:
    """Judges services by the latest offers and the latest map, which both change while a task runs.

    `directory`: the copy of what the Registry lists; None if each task discovers services itself.
    """

    def __init__(self, state: KnownServices, replica: Replica, directory: ServiceReplica | None) -> None:
        self._state, self._replica, self._directory = state, replica, directory

    @property
    def broken(self) -> dict[str, str]:
        return self._state.broken

    @property
    def on_offer(self) -> Offers:
        """All offers that the task knows."""
        if self._directory is None or self._state.offers is not None:
            return Offers(self._state.offers or ())
        return self._directory.offers

    def discovered(self, offers: tuple[Offer, ...] | None) -> None:
        """Use these offers from now on, or those of the copy."""
        self._state.offers = offers
        types = self.on_offer.types
        self._state.types.update(types)
        self._state.common_types = {name: common for name in types if (common := self._replica.ontology.services.get(name)) is not None}

    def redefined_types(self, runs: Iterable[StepRun]) -> list[str]:
        """The service types of steps that are defined anew since the services were discovered, in a way that matters to a plan."""
        current, known = self._replica.ontology.services, self._state.common_types
        redefined = {name for name, type in known.items() if name in current and disagreements(type, current[name])}
        return sorted(redefined & {run.step.service_type for run in runs}) if redefined else []

    def for_quotes(self) -> KnownServices:
        """What a preview of a plan of the task has to know about services."""
        return KnownServices(offers=self._state.offers, broken=dict(self.broken))

    def _of_idle_devices(self, offers: Iterable[Offer]) -> list[Offer]:
        """The offers of devices that may begin work."""
        map, ontology = self._replica.map, self._replica.ontology
        return [offer for offer in offers if takes_work(offer.provider, map, ontology)]

    @property
    def usable(self) -> list[Offer]:
        return [offer for offer in self._of_idle_devices(self.on_offer) if offer.service not in self.broken]

    @property
    def excluded_services(self) -> list[LostService]:
        """Services on offer that the task does not ask, and why."""
        return self._lost_services(self.broken)

    @property
    def resting_services(self) -> list[LostService]:
        """Services on offer whose devices an operator lets begin no work, and why."""
        map, ontology = self._replica.map, self._replica.ontology
        offers = [*self.on_offer]
        reasons = {provider: rest_reason(provider, map, ontology) for provider in {offer.provider for offer in offers}}
        return [LostService(offer.service_type, offer.service, reasons[offer.provider]) for offer in offers if reasons[offer.provider]]

    @property
    def rejected_services(self) -> list[LostService]:
        """Services on offer whose last impossible report the Repository rejected, and why."""
        return self._lost_services(self._state.impossible)

    def _lost_services(self, reasons: Mapping[str, str]) -> list[LostService]:
        offers = self.on_offer.of_services(reasons)
        return [LostService(offer.service_type, offer.service, reasons[offer.service]) for offer in offers]

    @property
    def excluded_providers(self) -> set[str]:
        """The devices of the services that the task does not ask."""
        return {offer.provider for offer in self.on_offer.of_services(self.broken)}

    def able_offers(self, run: StepRun) -> list[Offer]:
        """The offers of services that can be asked for the step."""
        fruitless, step = self._state.fruitless, run.step
        offers = able_offers(step, self.on_offer, self._service_types, {*run.excluded, *self.broken})
        return self._of_idle_devices(offer for offer in offers if (offer.provider, step.use) not in fruitless)

    @property
    def fruitless(self) -> frozenset[tuple[str, str]]:
        """Devices and uses of services that told nothing in this task."""
        return frozenset(self._state.fruitless)

    @property
    def told(self) -> frozenset[str]:
        """The uses of services that told something in this task."""
        return frozenset(self._state.told)

    def tells(self, step: Step) -> None:
        """Record that a cognitive or software service has told what it had to."""
        self._state.told.add(step.use)

    def tells_nothing(self, provider: str, step: Step) -> None:
        """Do not ask the device for this step again: a cognitive or software service had nothing to tell."""
        self._state.fruitless.add((provider, step.use))

    def tell_nothing(self, run: StepRun) -> None:
        """Do not ask the services for the step again that failed in it or refused it for good, nor the others before their reasons pass."""
        for offer in self.on_offer.of_services(run.excluded):
            if offer.service in self._state.unable:
                self.tells_nothing(offer.provider, run.step)
            elif (offer.provider, run.step.use) not in self._state.fruitless:
                self.exclude({offer.service: run.excluded[offer.service]})

    def refused(self, service: str, *, not_now: bool) -> None:
        """Record a refusal: for good, or `not_now` for a reason that passes, for which the task waits although the service had failed."""
        if not_now:
            self._state.failures.pop(service, None)
        else:
            self._state.unable.add(service)

    def offers_for(self, step: Step) -> list[Offer]:
        """The offers of services that can do the step, without those that are broken."""
        return self._of_idle_devices(able_offers(step, self.on_offer, self._service_types, self.broken))

    def failed(self, service: str, reason: str, now: float) -> None:
        """Exclude a service that reported a failure; `readmit_failed` may readmit it."""
        state, offer = self._state, self.on_offer.get(service)
        state.failures[service] = state.failures.get(service, 0) + 1
        device_broke = offer is not None and not self._works(offer)
        state.backoffs[service] = Backoff.following(state.backoffs.get(service), now, device_broke=device_broke)
        self.broken[service] = reason

    def reported_impossible(self, service: str, reason: str) -> None:
        """Note that the Repository rejected a report. A service that reports the same again would do so whenever it is asked."""
        if self._state.impossible.get(service) == reason:
            self._state.unable.add(service)
        self._state.impossible[service] = reason

    def exclude(self, excluded: dict[str, str]) -> None:
        """Exclude services, for these reasons."""
        self._state.broken = {**excluded, **self._state.broken}

    def lost(self, service: str, reason: str) -> None:
        """Exclude a service that fell silent, until it is heard of again."""
        self._state.failures.pop(service, None)
        self._state.silent.add(service)
        self.broken[service] = reason

    def returned(self, services: Iterable[str]) -> None:
        """Readmit services that had fallen silent, and were heard of again."""
        for service in self._state.silent.intersection(services):
            self._state.silent.discard(service)
            self.broken.pop(service, None)

    def completed(self, service: str) -> None:
        self._state.failures.pop(service, None)
        self._state.backoffs.pop(service, None)

    def expected_attempts(self, service: str) -> int:
        """How often a service has to be asked until it completes a step, as far as its failures in the task tell: once more for each."""
        backoff = self._state.backoffs.get(service)
        return 1 + backoff.failures if backoff is not None else 1

    def readmit_failed(self, run: StepRun | None = None, *, now: float | None = None) -> list[Offer]:
        """Readmit services that failed but may succeed next time, because no other service can do the step (None: any step).

        `now`: only those that may be asked again by then; None: all. Returns their offers.
        """
        offers = able_offers(run.step, self.on_offer, self._service_types, ()) if run is not None else self.on_offer
        readmitted = [offer for offer in offers if self._may_do_better(offer) and (now is None or self.back_at(offer.service) <= now)]
        for offer in readmitted:
            del self.broken[offer.service]
            if run is not None:
                run.excluded.pop(offer.service, None)
        return readmitted

    def _may_do_better(self, offer: Offer) -> bool:
        failures = self._state.failures.get(offer.service, 0)
        is_excluded_for_now = offer.service in self.broken and offer.service not in self._state.unable
        return is_excluded_for_now and self._works(offer) and 0 < failures < MOST_FAILURES

    def back_at(self, service: str) -> float:
        """When a service that failed may be asked again, in seconds since 1970; 0 for others."""
        backoff = self._state.backoffs.get(service)
        return backoff.end if backoff is not None else 0.0

    def backing_off(self, now: float) -> dict[str, str]:
        """Why services are not asked now that failed, and may be asked later: by their names."""
        backoffs = self._state.backoffs
        return {
            offer.service: f"{self.broken[offer.service]} ({backoffs[offer.service].failures} times in a row)"
            for offer in self.on_offer.of_services(backoffs)
            if self.back_at(offer.service) > now and self._may_do_better(offer)
        }

    def _works(self, offer: Offer) -> bool:
        device = self._replica.map.objects.get(offer.provider)
        return device is None or device.values.get(WORKING) is not False

    # What passes

    def lacks(self, service_types: tuple[str, ...]) -> None:
        """Record the service types that no device offers, and that a plan needs."""
        self._state.unoffered = service_types

    def why_no_plan(self, result: NoPlan) -> tuple[str, ...]:
        """What services said when they failed, which is more to the point than what others lack; and then that."""
        return (*(f"{service}: {reason}" for service, reason in self.broken.items() if service not in result.lost), *result.reasons)

    def passing_hindrances(self, now: float) -> dict[str, str]:
        """Why services and service types are not available, as far as the reason may pass: by their names."""
        offers = self.on_offer
        services = {service: reason for service, reason in self.broken.items() if self._may_return(service, offers.get(service))}
        absences = {service_type: self._absence(service_type) for service_type in self._state.unoffered}
        return services | self.backing_off(now) | absences

    def _absence(self, service_type: str) -> str:
        resting = [loss for loss in self.resting_services if loss.service_type.name == service_type]
        silent_registries = self._directory.away if self._directory is not None else ()
        silence = f"; the Registry of {' and that of '.join(silent_registries)} does not answer" if silent_registries else ""
        return f"no device offers it now{resting_text(resting)}{silence}"

    def _may_return(self, service: str, offer: Offer | None) -> bool:
        """Whether an excluded service may be available later. One that failed, and says that it works, gets no better by waiting."""
        if service in self._state.unable:
            return False
        return offer is None or not self._works(offer) or service not in self._state.failures

    def readmit_refused(self, now: float) -> None:
        """Readmit the services whose reason may have passed, to ask them again; not those that are silent, or that do not work, and those
        that failed only when they may be asked again."""
        state, offers = self._state, self.on_offer
        for service in [*self.broken]:
            offer, failures, backoff = offers.get(service), state.failures.get(service, 0), state.backoffs.get(service)
            works = offer is None or self._works(offer)
            if works and failures < MOST_FAILURES and service not in state.unable | state.silent and self.back_at(service) <= now:
                if backoff is None or backoff.device_broke:  # it has been mended
                    state.failures.pop(service, None)
                del self.broken[service]

    def precondition(self, run: StepRun, member: Member | None = None) -> Formula | None:
        """The step's precondition on the current map, what services demanded for it, and the reported situation of its inputs.

        `member` is committed to the step; its terms may have a condition. Raises LookupError if one of these does not hold.
        """
        map, ontology = self._replica.map, self._replica.ontology
        service_type = self._service_types[run.step.service_type]
        parts = [precondition_now(run.step, service_type, map, ontology), relevant_situation(run.step, run.reported, map, ontology)]
        terms = member.session.terms if member is not None else None
        for condition in (run.step.condition, parse(terms.condition) if terms is not None and terms.condition is not None else None):
            try:
                is_met = condition is None or formula_holds(condition, map, ontology)
            except ExcessiveWork as error:
                raise LookupError(f"{error}; the service demands it") from error
            if not is_met:
                raise LookupError(f"{condition} does not hold, which the service demands")
            parts.append(condition)
        conditions = [*dict.fromkeys(part for part in parts if part is not None)]
        return conjunction(*conditions) if conditions else None

    def type_of(self, step: Step) -> ServiceType:
        return self._service_types[step.service_type]

    @property
    def _service_types(self) -> dict[str, ServiceType]:
        return {**self._state.types, **self._replica.ontology.services, **self.on_offer.types}


def service_names(offers: Iterable[Offer]) -> tuple[str, ...]:
    return tuple(offer.service for offer in offers)
