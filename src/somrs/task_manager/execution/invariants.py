"""What has to hold while a service works (`ServiceType.invariant`), as seen on the map."""

from __future__ import annotations

from somrs.entish import Name
from somrs.entish.formula import substitute
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.kernel.replica import Replica
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.truth import formula_holds
from somrs.task_manager.execution.workflow import StepRun


def broken_invariant(service_type: ServiceType, run: StepRun, provider: str, replica: Replica) -> str | None:
    """The invariant of the step, with its variables bound, if it does not hold on the map; None if it holds, or there is none."""
    if service_type.invariant is None:
        return None
    invariant = substitute(parse(service_type.invariant), {**run.step.bindings, PROVIDER: Name(provider)})
    try:
        return None if formula_holds(invariant, replica.map, replica.ontology) else str(invariant)
    except FormulaError:  # the map has lost an object of it
        return str(invariant)
