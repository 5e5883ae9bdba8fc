"""The procedures that were laid down for failures and compensations (paper, "Protocol for failure handling and recovery": a concrete
plan should contain them), with a task or with a service type.
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
    """Those for the work that fit the situation, the task's own first, bound to its step."""
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
        except FormulaError:  # the map may have lost what the procedure speaks of
            continue
    return handlers
