"""What is on offer to one task, and who is left out of it."""

from __future__ import annotations

import pytest

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.offers import Offers
from somrs.kernel.replica import Replica
from somrs.kernel.service_replica import ServiceReplica
from somrs.ontology.objects import ValueSet
from somrs.ontology.services import ServiceType
from somrs.ontology.types import WORKING
from somrs.planner.model.plan import Step
from somrs.planner.model.problem import LostService
from somrs.protocol.messages.directory import Offer
from somrs.task_manager.arrangement.available_services import MOST_FAILURES, AvailableServices, service_names
from somrs.task_manager.execution.workflow import StepRun
from somrs.task_manager.known_services import KnownServices
from tests.support.laboratory import MAP, TRANSFER, laboratory, offer

WORK = ServiceType(name="Work", effect="Jar001.Clean = TRUE")


def step_run(service_type: str = "TransferObject", effect: str = "Jar001 isOn Shelf2") -> StepRun:
    inputs = {"Object": Name("Jar001"), "Destination": Name("Shelf2")}
    return StepRun(step=Step("step1", service_type, {**inputs}, parse(effect)), label="step1", key="1.1/step1")


def available(*offers: Offer) -> tuple[AvailableServices, KnownServices, Replica]:
    state, replica = KnownServices(), Replica("tm", "repository", laboratory(), MAP)
    services = AvailableServices(state, replica, ServiceReplica("tm", "registry", Offers(offers)))
    services.discovered(None)
    return services, state, replica


def test_what_is_on_offer_no_more_is_forgotten_but_not_its_type() -> None:
    state, replica = KnownServices(), Replica("tm", "repository", laboratory(), MAP)
    directory = ServiceReplica("tm", "registry", Offers([offer("Robot1", WORK), offer("Robot2", WORK)]))
    services = AvailableServices(state, replica, directory)
    services.discovered(None)
    assert service_names(services.usable) == ("Robot1.Work", "Robot2.Work")
    directory.offers = Offers([offer("Robot3")])
    services.discovered(None)
    assert service_names(services.usable) == ("Robot3.TransferObject",)
    assert state.types == {"TransferObject": TRANSFER, "Work": WORK}
    assert services.type_of(step_run("Work").step) == WORK
    defined = ServiceType(name="Work", effect="Jar001.Clean = FALSE")
    replica.ontology = replica.ontology.extended([defined])
    assert services.type_of(step_run("Work").step) == defined, "what is known now goes before what was known once"
    directory.offers = Offers([offer("Robot1", WORK)])
    assert services.type_of(step_run("Work").step) == WORK, "and what is offered before that"


def test_who_failed_or_would_not_serve_is_not_asked_and_the_planner_hears_why() -> None:
    services, state, _ = available(*map(offer, ("Robot1", "Robot2", "Robot3", "Robot4")))
    services.failed("Robot1.TransferObject", "it broke", 0.0)
    services.exclude({"Robot1.TransferObject": "too heavy", "Robot2.TransferObject": "too far"})
    assert service_names(services.usable) == ("Robot3.TransferObject", "Robot4.TransferObject")
    assert services.excluded_services == [
        LostService(TRANSFER, "Robot1.TransferObject", "it broke"),
        LostService(TRANSFER, "Robot2.TransferObject", "too far"),
    ]
    run = step_run()
    run.excluded = {"Robot4.TransferObject": "too late"}
    assert service_names(services.able_offers(run)) == ("Robot3.TransferObject",)
    assert services.broken is state.broken


@pytest.mark.parametrize(("failures", "allowed"), [(0, False), (1, True), (MOST_FAILURES - 1, True), (MOST_FAILURES, False)])
def test_who_failed_a_few_times_in_a_row_may_be_asked_again(failures: int, allowed: bool) -> None:
    services, state, _ = available(offer("Robot1"), offer("Robot2"))
    services.exclude({"Robot1.TransferObject": "too heavy"})
    for _ in range(failures):
        services.failed("Robot1.TransferObject", "it broke", 0.0)
    assert state.failures.get("Robot1.TransferObject", 0) == failures
    assert service_names(services.readmit_failed()) == (("Robot1.TransferObject",) if allowed else ())
    assert (services.broken == {}) is allowed
    assert service_names(services.readmit_failed()) == (), "what is not broken is asked anyway"


def test_who_fails_again_is_asked_after_a_pause_that_grows_until_it_completes_a_step() -> None:
    services, state, _ = available(offer("Robot1"))
    service, pauses, now = "Robot1.TransferObject", list[float](), 100.0
    for _ in range(8):
        services.failed(service, "it broke", now)
        pauses.append(services.back_at(service) - now)
        services.refused(service, not_now=True)
    assert pauses == [0.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0]
    assert services.expected_attempts(service) == 9
    services.completed(service)
    assert (state.backoffs, services.expected_attempts(service), services.back_at(service)) == ({}, 1, 0.0)


def test_during_the_pause_it_is_said_why_and_afterwards_the_service_is_asked() -> None:
    services, state, _ = available(offer("Robot1"))
    service = "Robot1.TransferObject"
    for _ in range(2):
        services.failed(service, "it broke", 100.0)
    assert services.readmit_failed(now=101.9) == []
    services.readmit_refused(101.9)
    assert services.passing_hindrances(101.9) == services.backing_off(101.9) == {service: "it broke (2 times in a row)"}
    services.readmit_refused(102.0)
    assert (services.broken, services.passing_hindrances(102.0)) == ({}, {})
    assert state.failures == {service: 2}, "it is given up at some time"


def test_who_was_mended_is_given_up_later_and_pauses_nevertheless() -> None:
    services, state, replica = available(offer("Robot1"))
    service = "Robot1.TransferObject"
    for working in (False, True):
        replica.map = replica.map.changed([ValueSet("Robot1", WORKING, working)])
        if not working:
            services.failed(service, "it broke", 100.0)
    services.readmit_refused(100.0)
    assert (services.broken, state.failures) == ({}, {})
    services.failed(service, "it broke", 110.0)
    assert services.back_at(service) == 112.0


@pytest.mark.parametrize(
    ("provider", "working", "allowed"), [("Robot1", None, True), ("Robot1", True, True), ("Robot1", False, False), ("Robot2", None, True)]
)
def test_a_device_that_is_known_to_be_broken_is_not_asked_again(provider: str, working: bool | None, allowed: bool) -> None:
    services, _, replica = available(offer(provider))
    if working is not None:
        replica.map = replica.map.changed([ValueSet(provider, WORKING, working)])
    services.failed(f"{provider}.TransferObject", "it broke", 0.0)
    assert service_names(services.readmit_failed()) == ((f"{provider}.TransferObject",) if allowed else ())


@pytest.mark.parametrize(
    ("path", "value", "reason"),
    [
        ("InService", False, "no device offers it now (Robot1 is out of service)"),
        ("Paused", True, "no device offers it now (Robot1 is stopped)"),
        ("PausedFor", "task7", "no device offers it now (Robot1 is paused with its task)"),
        ("Color", "Red", "no device offers it now"),
    ],
)
def test_why_nobody_offers_a_service_names_devices_that_an_operator_lets_begin_no_work(path: str, value: bool | str, reason: str) -> None:
    services, _, replica = available(offer("Robot1"))
    services.lacks(("TransferObject",))
    replica.map = replica.map.changed([ValueSet("Robot1", path, value)])
    assert services.passing_hindrances(0.0) == {"TransferObject": reason}


def test_for_a_step_those_are_asked_again_that_can_do_it() -> None:
    services, _, _ = available(offer("Robot1"), offer("Robot1", WORK), offer("Robot2"))
    run, other_run = step_run(), step_run()
    for affected_run in (run, other_run):
        affected_run.excluded = {"Robot1.TransferObject": "it broke", "Robot2.TransferObject": "too heavy"}
    services.failed("Robot1.TransferObject", "it broke", 0.0)
    services.failed("Robot1.Work", "it broke", 0.0)
    assert service_names(services.readmit_failed(run)) == ("Robot1.TransferObject",)
    assert services.broken == {"Robot1.Work": "it broke"}
    assert (run.excluded, other_run.excluded) == (
        {"Robot2.TransferObject": "too heavy"},
        {"Robot1.TransferObject": "it broke", "Robot2.TransferObject": "too heavy"},
    )
    services.failed("Robot1.TransferObject", "it broke", 0.0)
    assert service_names(services.readmit_failed(run)) == ("Robot1.TransferObject",), "the step has not excluded it any more"


def test_what_a_service_completed_or_that_it_fell_silent_ends_the_count_of_its_failures() -> None:
    services, state, _ = available(offer("Robot1"), offer("Robot2"))
    for name in ("Robot1", "Robot2", "Robot1", "Robot2"):
        services.failed(f"{name}.TransferObject", "it broke", 0.0)
    services.completed("Robot1.TransferObject")
    services.completed("Robot3.TransferObject")
    assert state.failures == {"Robot2.TransferObject": 2}
    services.lost("Robot2.TransferObject", "fell silent")
    services.lost("Robot3.TransferObject", "fell silent")
    assert state.failures == {}
    assert services.broken == {
        "Robot1.TransferObject": "it broke",
        "Robot2.TransferObject": "fell silent",
        "Robot3.TransferObject": "fell silent",
    }
    assert services.readmit_failed() == []


@pytest.mark.parametrize(
    ("service_type", "reported", "precondition"),
    [
        ("TransferObject", None, "Jar001 isOn Shelf1"),
        ("TransferObject", "Jar001.Clean = TRUE", "Jar001 isOn Shelf1 AND Jar001.Clean = TRUE"),
        ("Work", "Jar001 isOn Shelf1 AND Jar002 isOn Shelf1", "Jar001 isOn Shelf1"),
        ("Work", None, None),
    ],
)
def test_a_step_needs_what_its_type_says_and_what_was_reported(service_type: str, reported: str | None, precondition: str | None) -> None:
    services, _, replica = available(offer("Robot1"), offer("Robot1", WORK))
    replica.map = replica.map.changed([ValueSet("Jar001", "Clean", True)])
    run = step_run(service_type)
    run.reported = parse(reported) if reported is not None else None
    current_precondition = services.precondition(run)
    assert (str(current_precondition) if current_precondition is not None else None) == precondition


def test_without_what_it_needs_a_step_has_no_precondition_now() -> None:
    services, _, _ = available(offer("Robot1"))
    with pytest.raises(LookupError, match="Unknown"):
        services.precondition(step_run("Unknown"))
    run = step_run()
    run.step = Step("step1", "TransferObject", {"Object": Name("Shelf1"), "Destination": Name("Shelf2")}, parse("Shelf1 isOn Shelf2"))
    with pytest.raises(LookupError, match="Shelf1 isOn"):
        services.precondition(run)
