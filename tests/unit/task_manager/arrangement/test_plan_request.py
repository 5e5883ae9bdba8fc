"""How a plan is come by: what the planner is asked, when it is asked once more, and what others have."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.component import Ask, Effect, ErrorAnswer, Send, Withdraw
from somrs.kernel.offers import Offers
from somrs.kernel.replica import Replica
from somrs.kernel.reservations import Reservation
from somrs.kernel.service_replica import ServiceReplica
from somrs.planner.model.plan import NoPlan, Plan, Step
from somrs.planner.model.problem import LostService, Problem
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.reservations import ReservationMode, Reserve
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.waits import Holder
from somrs.repository.reserving import Reserving
from somrs.repository.state import Contents
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.arrangement.plan_request import PlanRequest, PlanRequester, ServicesUnknown
from somrs.task_manager.context import Quotes, TaskManagerContext
from somrs.task_manager.device_queue import DeviceQueues
from somrs.task_manager.discovery import Discovery
from somrs.task_manager.execution.workflow import Progress, Workflow
from somrs.task_manager.known_services import KnownServices
from somrs.task_manager.pace import Pace
from somrs.task_manager.requests import ForPlan, ForReservation, Requests, ServicesKnown
from somrs.task_manager.reservations import BlockedPlan, ReservationRequester, TaskReservation
from somrs.task_manager.timers import Answer, PlanWanted
from somrs.task_manager.world_clock import WorldClock
from tests.support.effects import run_effects
from tests.support.laboratory import MAP, TRANSFER, laboratory, offer

GOAL = "Jar001 isOn Shelf2"
NO_PLAN = NoPlan("there is none")


def step(id: str = "step1", jar: str = "Jar001") -> Step:
    inputs = {"Object": Name(jar), "Destination": Name("Shelf2")}
    return Step(id, "TransferObject", {**inputs}, parse(f"{jar} isOn Shelf2"), parse(f"{jar} isOn Shelf1"))


PLAN = Plan((step(),))
RESERVATION = Reservation(changes=frozenset({"Jar001"}))
HOLDERS = (Holder(task="other", goal="", objects=("Jar001",)),)


def context(reserved_elsewhere: Callable[[str], frozenset[str]] = lambda task: frozenset()) -> TaskManagerContext:
    """Nothing was asked of anybody yet, and nobody has anything."""
    return TaskManagerContext(
        replica=Replica("tm", "repository", laboratory(), MAP, version=7),
        requests=Requests(address="tm", repository="repository", registry="registry"),
        local_reservations=None,
        discovery=Discovery(directory=ServiceReplica("tm", "registry", version=3)),
        queues=DeviceQueues(),
        quotes=Quotes(),
        pace=Pace(),
        clock=WorldClock(),
        touched={},
        commitments=dict,
        still_at_work=lambda work: True,
        reserved_elsewhere=reserved_elsewhere,
        may_ask=lambda task: True,
    )


class PlanRequestHarness:
    """The second plan of the third goal of a task; another task of its Task Manager may have something. The Repository answers at once."""

    def __init__(
        self,
        *held: str,
        old_workflow: Workflow | None = None,
        modes: tuple[ReservationMode, ReservationMode] = (ReservationMode.TRY, ReservationMode.WAIT),
        effect: str = GOAL,
    ) -> None:
        self.context, self.serial = context(lambda task: frozenset(held)), 0
        self.registry_requests = 0
        """How often the Registry was asked for its version."""
        self.repository = Reserving(Contents(ontology=laboratory(), map=MAP))
        self.reservation, self.requested_modes = TaskReservation(), list[ReservationMode]()
        reserving = ReservationRequester(self.reservation, "task1", GOAL, 0, self.context)
        if held:
            self.reserve_elsewhere(*held)
        self.services = AvailableServices(KnownServices(), self.context.replica, self.context.directory)
        self.request = PlanRequest(owner="task1", goal=3, serial=2, task=Submit(effect=effect))
        self.requester = PlanRequester(self.request, self.services, self.context, reserving, modes, old_workflow)

    def reserve_elsewhere(self, *held: str) -> None:
        self.serial += 1
        self.repository.reserve(Reserve(task="other", serial=self.serial, mode=ReservationMode.TRY, changes=held), "tm", 0.0)

    def discovered(self, *offers: Offer) -> Problem:
        assert self.context.directory is not None
        self.context.directory.offers = Offers(offers)
        effects, result = run_effects(self.requester.discovered(None))
        assert result is None
        return self.asked_problem(effects)

    def asked_problem(self, effects: list[Effect]) -> Problem:
        (ask,) = effects
        assert isinstance(ask, Ask)
        assert ask.question == self.request.question == PlanWanted("task1", 3, 2, self.request.attempt)
        assert isinstance(ask.task, Problem)
        return ask.task

    def answered(self, value: Answer) -> tuple[list[Effect], object]:
        return self._reserved(*run_effects(self.requester.answered(value, 1.0)))

    def _reserved(self, effects: list[Effect], result: object) -> tuple[list[Effect], object]:
        """What comes of it when the Repository and the Registry have answered."""
        for effect in effects:
            if isinstance(effect, Send) and isinstance(effect.message.body, Reserve):
                self.requested_modes.append(effect.message.body.mode)
                answer, _ = self.repository.reserve(effect.message.body, "tm", 1.0)
                if effect.message.body.mode is not ReservationMode.ASK:
                    self.reservation.answered(answer)
                return self._reserved(*run_effects(self.requester.reserved(answer, 1.0)))
        discovery = self.context.discovery
        if discovery.waiting:
            assert [request.confirmed for request in discovery.waiting] == [True]
            discovery.waiting.clear()
            self.registry_requests += 1
            return self._reserved(*run_effects(self.requester.discovered(None)))
        return effects, result


def test_first_the_services_on_offer_are_asked_for() -> None:
    harness = PlanRequestHarness()
    assert [*harness.requester.begin(5.0)] == []
    assert harness.context.discovery.next_answer(laboratory(), 5.0) == ServicesKnown(ForPlan("task1", 3, 2), None)
    assert run_effects(harness.requester.discovered("the registry is out of order")) == (
        [],
        ServicesUnknown("the registry is out of order"),
    )
    assert [*harness.requester.withdraw()] == [], "the planner was not asked"


def test_the_planner_is_asked_for_a_plan_with_what_may_be_used() -> None:
    harness = PlanRequestHarness("Jar002")
    harness.services.exclude({"Robot2.TransferObject": "it broke"})
    harness.context.quotes.record_quote("Robot1.TransferObject", 4.0, 60.0)
    problem = harness.discovered(offer("Robot1"), offer("Robot2"))
    assert (str(problem.goal), problem.excluded, problem.map) == (GOAL, frozenset({"Jar002"}), MAP)
    assert [(service.providers, service.prices) for service in problem.services] == [(("Robot1",), (("Robot1", 4.0),))]
    assert problem.lost == (LostService(TRANSFER, "Robot2.TransferObject", "it broke"),)
    assert (problem.rest, problem.promised) == ((), frozenset())
    assert (harness.request.attempt, harness.request.avoided, harness.request.ignores_reservations) == (1, frozenset({"Jar002"}), False)
    assert [*harness.requester.withdraw()] == [Withdraw(PlanWanted("task1", 3, 2, 1))]


def test_what_still_stands_of_the_plan_before_is_kept() -> None:
    old_workflow = Workflow.from_plan(Plan((step("a"), step("b", "Jar002"), step("c", "Robot1"))))
    for id, progress in (("a", Progress.COMPLETED), ("b", Progress.ARRANGED), ("c", Progress.ARRANGING)):
        old_workflow.move(old_workflow.runs[id], progress)
    problem = PlanRequestHarness(old_workflow=old_workflow).discovered(offer("Robot1"))
    assert ([remaining_step.id for remaining_step in problem.rest], problem.promised) == (["b", "c"], frozenset({"b"}))


def test_a_task_that_does_not_fit_the_map_any_more_has_no_plan() -> None:
    harness = PlanRequestHarness(effect="Gone isOn Shelf2")
    effects, result = run_effects(harness.requester.discovered(None))
    assert isinstance(result, str)
    assert (effects, result.partition(":")[0], harness.request.attempt) == ([], "the task does not fit the map any more", 0)


@pytest.mark.parametrize("mode", [ReservationMode.TRY, ReservationMode.ASK])
def test_what_the_plan_needs_is_the_tasks_from_then_on(mode: ReservationMode) -> None:
    harness = PlanRequestHarness("Jar002", modes=(mode, mode))
    harness.discovered(offer("Robot1"))
    assert harness.answered(PLAN) == ([], PLAN)
    assert harness.reservation.held == (RESERVATION if mode is ReservationMode.TRY else Reservation())


def test_what_the_task_has_already_is_not_asked_for_again() -> None:
    harness = PlanRequestHarness()
    for _ in range(2):
        harness.discovered(offer("Robot1"))
        assert harness.answered(PLAN) == ([], PLAN)
    assert harness.requested_modes == [ReservationMode.TRY]


def test_without_the_repository_there_is_no_plan() -> None:
    harness = PlanRequestHarness()
    harness.discovered(offer("Robot1"))
    effects, _ = run_effects(harness.requester.answered(PLAN, 1.0))
    (request,) = harness.context.requests.pending.values()
    assert (request.purpose, len(effects)) == (ForReservation("task1", 3, harness.reservation.serial), 2)
    assert run_effects(harness.requester.reserved("it is out of order", 2.0)) == ([], "it is out of order")


@pytest.mark.parametrize("value", [NO_PLAN, ErrorAnswer("out of memory")])
def test_without_others_in_the_way_it_is_not_asked_once_more(value: Answer) -> None:
    harness = PlanRequestHarness()
    harness.discovered(offer("Robot1"))
    assert harness.answered(value) == ([], value)


def test_without_a_plan_the_registry_is_asked_whether_news_of_services_is_on_its_way() -> None:
    harness = PlanRequestHarness()
    harness.discovered(offer("Robot1"))
    assert harness.answered(NO_PLAN) == ([], NO_PLAN)
    assert (harness.registry_requests, harness.request.attempt) == (1, 1), "there is none"
    harness = PlanRequestHarness()
    harness.discovered(offer("Robot1"))
    assert harness.context.directory is not None
    harness.context.directory.version += 1
    harness.context.directory.offers = Offers([offer("Robot1"), offer("Robot2")])
    effects, result = harness.answered(NO_PLAN)
    problem = harness.asked_problem(effects)
    assert (result, problem.services[0].providers, harness.request.attempt) == (None, ("Robot1", "Robot2"), 2)
    assert harness.answered(NO_PLAN) == ([], NO_PLAN)
    assert harness.registry_requests == 1


def test_whether_there_would_be_a_plan_without_others_is_found_out() -> None:
    harness = PlanRequestHarness("Jar001")
    harness.discovered(offer("Robot1"))
    effects, result = harness.answered(NO_PLAN)
    problem = harness.asked_problem(effects)
    assert (result, problem.excluded, harness.request.attempt, harness.request.ignores_reservations) == (None, frozenset(), 2, True)
    assert harness.answered(PLAN) == ([], BlockedPlan(holders=HOLDERS, plan=PLAN))
    assert (harness.reservation.waiting, harness.reservation.held) == (RESERVATION, Reservation())
    assert harness.answered(NO_PLAN) == ([], NO_PLAN), "it is not asked a third time"


def test_trouble_is_no_sign_that_others_are_in_the_way() -> None:
    harness = PlanRequestHarness("Jar001")
    harness.discovered(offer("Robot1"))
    assert harness.answered(ErrorAnswer("out of memory")) == ([], ErrorAnswer("out of memory"))


def test_when_others_have_taken_it_meanwhile_another_plan_is_looked_for_first() -> None:
    harness = PlanRequestHarness("Jar002")
    harness.discovered(offer("Robot1"))
    harness.reserve_elsewhere("Jar001")
    effects, result = harness.answered(PLAN)
    assert (result, harness.asked_problem(effects).excluded) == (None, frozenset({"Jar001", "Jar002"}))
    assert (harness.request.attempt, harness.request.ignores_reservations) == (2, False)
    assert harness.answered(PLAN) == ([], BlockedPlan(holders=HOLDERS, plan=PLAN))
    assert harness.requested_modes == [ReservationMode.TRY, ReservationMode.TRY, ReservationMode.WAIT]


def test_what_is_had_regardless_of_others_is_waited_for_though_they_were_not_avoided() -> None:
    harness = PlanRequestHarness("Jar002")
    harness.discovered(offer("Robot1"))
    harness.answered(NO_PLAN)
    harness.reserve_elsewhere("Jar001")
    effects, result = harness.answered(PLAN)
    assert (effects, type(result)) == ([], BlockedPlan)
