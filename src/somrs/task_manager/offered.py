"""What is on offer to one task: the services that the Registry knew of last, without those that turned out to be broken."""

from __future__ import annotations

from dataclasses import dataclass, field

from somrs.entish import Formula
from somrs.entish.formula import conjunction
from somrs.ontology.services import ServiceType
from somrs.planner.plan import Step
from somrs.protocol.directory import Offer
from somrs.protocol.replica import Replica
from somrs.task_manager.arrange import able, about, precondition_now, service_types
from somrs.task_manager.workflow import StepRun


@dataclass(slots=True, kw_only=True)
class Offered:
    """`offers` and the map are as they were heard of last; both go on while a task runs."""

    replica: Replica
    offers: tuple[Offer, ...] = ()
    broken: dict[str, str] = field(default_factory=dict)
    """Services that failed or would not serve in this task, and why: new plans leave them out."""
    _types: dict[str, ServiceType] = field(default_factory=dict)

    def discovered(self, offers: tuple[Offer, ...]) -> None:
        """A type that came with an offer stays known: a step of it may be committed when nobody offers it any more."""
        self.offers = offers
        self._types.update({offer.service_type.name: offer.service_type for offer in offers})

    @property
    def usable(self) -> list[Offer]:
        return [offer for offer in self.offers if offer.service not in self.broken]

    def able(self, run: StepRun) -> list[Offer]:
        """Who can be asked for the step."""
        return able(run.step, self.offers, self._known, {*run.excluded, *self.broken})

    def precondition(self, run: StepRun) -> Formula | None:
        """The step's precondition as it is now, with what a failed service reported about its objects. Raises LookupError."""
        map, ontology = self.replica.map, self.replica.ontology
        service_type = self._known[run.step.service_type]
        parts = [precondition_now(run.step, service_type, map, ontology), about(run.step, run.reported, map, ontology)]
        told = [part for part in parts if part is not None]
        return conjunction(*told) if told else None

    def type_of(self, step: Step) -> ServiceType:
        return self._known[step.service_type]

    @property
    def _known(self) -> dict[str, ServiceType]:
        return {**self._types, **service_types(self.replica.ontology, self.offers)}
