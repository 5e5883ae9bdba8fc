"""The Task Manager's rules that the model runs, besides the tables, and wrong rules to put in their place.

A wrong rule has to violate a property, as an altered table does (`mutations.py`).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Any

from somrs.ontology.services import ServiceType
from somrs.protocol.frp import coordinator_session, participant_session
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.messages.frp import Refuse
from somrs.task_manager.arrangement import call_for_proposals
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.execution import invariants
from somrs.task_manager.execution.execution_log import ExecutionLog
from verification.model_check.step import StepKind


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A rule: an attribute of a module or class of the product, and the wrong rules by name. `kinds`: the steps that it concerns."""

    owner: Any
    attribute: str
    kinds: Collection[StepKind]
    changes: dict[str, Callable[..., Any]]

    @contextlib.contextmanager
    def altered(self, change: str) -> Iterator[None]:
        """A context in which the rule is wrong."""
        original = getattr(self.owner, self.attribute)
        wrong = self.changes[change]
        setattr(self.owner, self.attribute, property(wrong) if isinstance(original, property) else wrong)
        try:
            yield
        finally:
            setattr(self.owner, self.attribute, original)


_PRECONDITION = AvailableServices.precondition

RULES = {
    "condition of a service": Rule(
        owner=call_for_proposals,
        attribute="unmet_condition",
        kinds=(StepKind.CONDITIONAL,),
        changes={"always met": lambda stated, promised, replica: None},
    ),
    "precondition of a step": Rule(
        owner=AvailableServices,
        attribute="precondition",
        kinds=(StepKind.CONDITIONAL,),
        changes={"without the condition": lambda self, run, member=None: _PRECONDITION(self, run)},
    ),
    "condition in Execute, coordinator": Rule(
        owner=coordinator_session,
        attribute="unstated_condition",
        kinds=(StepKind.CONDITIONAL,),
        changes={"not required": lambda terms, execute: None},
    ),
    "condition in Execute, participant": Rule(
        owner=participant_session,
        attribute="unstated_condition",
        kinds=(StepKind.CONDITIONAL,),
        changes={"not required": lambda terms, execute: None},
    ),
    "objection to an order": Rule(
        owner=ParticipantSession,
        attribute="objection",
        kinds=tuple(StepKind),
        changes={"none": lambda self, message, now: ""},
    ),
    "invariant": Rule(
        owner=invariants,
        attribute="broken_invariant",
        kinds=(StepKind.WHILE,),
        changes={"never broken": lambda service_type, run, member, replica: None},
    ),
    "start condition": Rule(
        owner=ServiceType,
        attribute="start_condition",
        kinds=(StepKind.WHILE,),
        changes={"without the invariant": lambda self: self.precondition},
    ),
    "refusal": Rule(
        owner=Refuse,
        attribute="passes",
        kinds=(StepKind.CONDITIONAL, StepKind.NOT_NOW),
        changes={
            "for good": lambda self: False,
            "for now": lambda self: True,
            "a condition is for good": lambda self: self.not_now,
            "not now is for good": lambda self: self.condition is not None,
        },
    ),
    "work to undo": Rule(
        owner=ExecutionLog,
        attribute="to_undo",
        kinds=(StepKind.PLAIN, StepKind.WHILE, StepKind.RECOGNITION),
        changes={"none": lambda self: [], "all": lambda self: [*self.works]},
    ),
}
"""By name, as in a `Mutation`."""
