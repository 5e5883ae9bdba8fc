"""Handlers for failures and compensations, which a task or a service type defines (paper, "Protocol for failure handling and recovery":
a concrete plan should contain them).
"""

from __future__ import annotations

from collections.abc import Iterable

from somrs.entish import Name
from somrs.entish.formula import substitute
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.kernel.replica import Replica
from somrs.ontology.services import PROVIDER, Handler, Occasion
from somrs.ontology.truth import bindings
from somrs.task_manager.execution.execution_log import Work


def fitting_handlers(of_task: Iterable[Handler], work: Work, occasion: Occasion, replica: Replica) -> list[Handler]:
    """The handlers for the work whose condition holds, the task's own first, with their variables bound to the step."""
    candidates = [handler for handler in of_task if handler.service_type in (None, work.step.service_type)] + [*work.service_type.handlers]
    bound = {**work.step.bindings, PROVIDER: Name(work.provider)}
    handlers: list[Handler] = []
    for handler in candidates:
        if handler.on is not occasion:
            continue
        try:
            condition = substitute(parse(handler.when), bound) if handler.when is not None else None
            if condition is None or next(iter(bindings(condition, replica.map, replica.ontology)), None) is not None:
                handlers.append(Handler(on=occasion, effect=str(substitute(parse(handler.effect), bound))))
        except FormulaError:  # the map may have lost an object of the handler
            continue
    return handlers
