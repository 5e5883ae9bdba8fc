"""The step of a task for which a participant is asked, on a map with one door. The Task Manager's own code decides about it.

What it decides: whether a plan meets the condition of a service, whether a step may begin, whether it has to be stopped, and whether work
has to be undone. Each `StepKind` is explored by itself.
"""

from __future__ import annotations

from enum import Enum

from msgspec import structs

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.replica import Replica
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.ontology.types import UNKNOWN, AttributeType, Kind, ObjectType, Ontology
from somrs.planner.model import plan
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.messages import frp
from somrs.protocol.messages.directory import Offer
from somrs.task_manager.arrangement import call_for_proposals
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.execution import invariants
from somrs.task_manager.execution.execution_log import ExecutionLog
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Workflow
from somrs.task_manager.known_services import KnownServices

DOOR_OPEN = "Door1.Open = TRUE"
"""The formula on which steps depend."""


class StepKind(Enum):
    """What is special about a step and about the answers of its service."""

    PLAIN = "plain"
    """The step depends on nothing, and a refusal is for good."""
    CONDITIONAL = "conditional terms"
    """A service may offer or refuse the step on the condition that the door is open."""
    NOT_NOW = "not now"
    """A service may refuse for now or for good."""
    WHILE = "while"
    """The door has to be open as long as the step is executed."""
    RECOGNITION = "recognition"
    """The step changes nothing; its report tells what is so."""

    def __str__(self) -> str:
        return self.value


_ONTOLOGY = Ontology(
    [
        *(AttributeType(name=name, kind=Kind.TRUTH) for name in ("Open", "Clean", UNKNOWN)),
        ObjectType(name="Object", parent=None, attributes=("Open", "Clean", UNKNOWN)),
    ]
)


def _map(is_open: bool) -> Map:
    thing = Object(name="Thing1", type="Object", values={"Clean": False, UNKNOWN: True})
    return Map([thing, Object(name="Door1", type="Object", values={"Open": is_open}), Object(name="Robot1", type="Object")])


_REPLICAS = {is_open: Replica("tm", "repository", ontology=_ONTOLOGY, map=_map(is_open), version=0) for is_open in (False, True)}
_OPENING = plan.Step(id="step1", service_type="OpenDoor", inputs={}, effect=parse(DOOR_OPEN))


class Step:
    """The decisions about a step of one kind. `is_open`: what the map says of the door; None if the step does not depend on it."""

    def __init__(self, kind: StepKind) -> None:
        is_physical = kind is not StepKind.RECOGNITION
        self._type = ServiceType(
            name="Serve",
            inputs=(Parameter(name="Object", type="Object"),),
            effect="?Object.Clean = TRUE" if is_physical else f"?Object.{UNKNOWN} = FALSE",
            invariant=DOOR_OPEN if kind is StepKind.WHILE else None,
            kind=ServiceKind.PHYSICAL if is_physical else ServiceKind.COGNITIVE,
        )
        effect = "Thing1.Clean = TRUE" if is_physical else f"Thing1.{UNKNOWN} = FALSE"
        step = plan.Step(id="step2", service_type="Serve", inputs={"Object": Name("Thing1")}, effect=parse(effect), kind=self._type.kind)
        self._workflows = {
            False: Workflow.from_plan(plan.Plan(steps=(step,))),
            True: Workflow.from_plan(plan.Plan(steps=(_OPENING, step), links=(plan.Link(before="step1", after="step2", fact=DOOR_OPEN),))),
        }
        """The plan of this step only, and the plan that opens the door first."""
        self._run = self._workflows[False].runs["step2"]
        self._offer = Offer(service="Robot1.Serve", provider="Robot1", provider_type="Object", address="sm", service_type=self._type)

    def meets_condition(self, session: CoordinatorSession, is_open: bool | None) -> bool:
        """Whether the plan meets the condition of the service, if it has one."""
        workflow = self._workflows[is_promised(session)]
        promised = workflow.promised_effects(workflow.runs["step2"])
        return call_for_proposals.unmet_condition(session.condition, promised, _REPLICAS[bool(is_open)]) is None

    def order(self, session: CoordinatorSession, is_open: bool | None) -> frp.Execute | None:
        """The order to begin; None if the step may not begin now."""
        services = AvailableServices(KnownServices(types={"Serve": self._type}), _REPLICAS[bool(is_open)], None)
        try:
            situation = services.precondition(self._run, self._member(session))
        except LookupError:
            return None
        return frp.Execute(inputs={}, precondition=str(situation) if situation is not None else None)

    def must_stop(self, session: CoordinatorSession, is_open: bool) -> bool:
        """Whether a service that executes the step has to be stopped."""
        return invariants.broken_invariant(self._type, self._run, self._member(session), _REPLICAS[is_open]) is not None

    def needs_undoing(self, session: CoordinatorSession) -> bool:
        """Whether the work of the participant has to be undone if the task is not accomplished."""
        log, replica = ExecutionLog(), _REPLICAS[True]
        work = log.begin(self._run, self._type, self._member(session), replica.map, replica.ontology, 0.0)
        work.state = session.state
        return bool(log.to_undo())

    def _member(self, session: CoordinatorSession) -> Member:
        return Member(id=session.participant, session=session, offer=self._offer, label="step2", step=self._run.key)


def is_promised(session: CoordinatorSession) -> bool:
    """Whether the service was asked for a situation in which the door is open."""
    return session.order is not None and session.order.situation is not None


def is_conditional(body: object) -> bool:
    """Whether the message depends on the door, or says that it is open."""
    return isinstance(body, frp.Terms | frp.Refuse) and body.condition is not None


def arranges(kind: StepKind) -> tuple[frp.Arrange, ...]:
    """The requests for terms: the plan may or may not open the door before the step."""
    arrange = frp.Arrange(service_type="Serve", inputs={}, effect="E")
    return (arrange, structs.replace(arrange, situation=DOOR_OPEN)) if kind is StepKind.CONDITIONAL else (arrange,)


TERMS = frp.Terms(effect="E", price=1.0, duration=1.0)
REFUSE = frp.Refuse(reason="r")
NOT_NOW = structs.replace(REFUSE, not_now=True)
"""Also when its terms expire, or an order must not be carried out."""


def answers(kind: StepKind) -> tuple[frp.Terms | frp.Refuse, ...]:
    """What the service may answer to a request for terms."""
    match kind:
        case StepKind.CONDITIONAL:
            return TERMS, structs.replace(TERMS, condition=DOOR_OPEN), REFUSE, structs.replace(REFUSE, condition=DOOR_OPEN)
        case StepKind.NOT_NOW:
            return TERMS, REFUSE, NOT_NOW
        case _:
            return TERMS, REFUSE


def expiry(kind: StepKind) -> frp.Refuse:
    """The refusal of a service whose terms were not accepted in time."""
    return NOT_NOW if kind in (StepKind.CONDITIONAL, StepKind.NOT_NOW) else REFUSE
