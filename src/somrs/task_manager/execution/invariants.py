"""What has to hold while a service works, as seen on the map.

Its type says so (`ServiceType.invariant`), or its terms (`Terms.invariant`).
"""

from __future__ import annotations

from collections.abc import Iterator

from somrs.entish import Formula, Name
from somrs.entish.formula import substitute
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.kernel.replica import Replica
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.truth import formula_holds
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import StepRun


def broken_invariant(service_type: ServiceType, run: StepRun, member: Member, replica: Replica) -> str | None:
    """An invariant of the step, with its variables bound, that does not hold on the map; None if all hold, or there is none."""
    return next((str(invariant) for invariant in _invariants(service_type, run, member) if not _holds(invariant, replica)), None)


def _invariants(service_type: ServiceType, run: StepRun, member: Member) -> Iterator[Formula]:
    if service_type.invariant is not None:
        yield substitute(parse(service_type.invariant), {**run.step.bindings, PROVIDER: Name(member.offer.provider)})
    if (demanded := member.session.invariant) is not None:
        yield parse(demanded)


def _holds(invariant: Formula, replica: Replica) -> bool:
    try:
        return formula_holds(invariant, replica.map, replica.ontology)
    except FormulaError:  # the map has lost an object of it
        return False
