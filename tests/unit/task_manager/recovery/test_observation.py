"""Who can look at an object of which nothing is known, and what the map says when nobody can."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from msgspec import structs

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.component import Send
from somrs.kernel.following import LEASE
from somrs.kernel.offers import Offers
from somrs.ontology.objects import Change, Fact, FactRemoved, ValueSet
from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.ontology.types import UNKNOWN
from somrs.planner.model.plan import Plan, Step
from somrs.protocol.messages import events
from somrs.protocol.messages.directory import Offer, SubscribeServices
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.observations import Observation as Observed
from somrs.protocol.messages.observations import Reception
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.execution.execution_log import ExecutionLog, Work
from somrs.task_manager.execution.reports import Report, ReportResult, Reports, UnobservedSubject
from somrs.task_manager.known_services import KnownServices
from somrs.task_manager.recovery.observation import Look, LookPlan, LookQueue, Observation, Unseen, look_plans, unknown_changes
from somrs.task_manager.requests import ForLook, ServicesKnown
from somrs.task_manager.reservations import TaskReservation
from tests.support.effects import run_effects
from tests.support.laboratory import MAP, TRANSFER, laboratory, offer
from tests.unit.task_manager.arrangement.test_plan_request import context
from tests.unit.task_manager.execution.test_participants import TransactionHarness

KNOWN_EFFECT = f"?Thing.{UNKNOWN} = FALSE"


def look_service_type(
    name: str = "FindObject", type: str = "Graspable", effect: str = KNOWN_EFFECT, kind: ServiceKind = ServiceKind.COGNITIVE
) -> ServiceType:
    return ServiceType(name=name, effect=effect, inputs=(Parameter(name="Thing", type=type),), kind=kind)


def look_plan(object: str, service_type: str = "FindObject") -> Plan:
    return Plan((Step("step1", service_type, {"Thing": Name(object)}, parse(f"{object}.{UNKNOWN} = FALSE")),))


def work(number: int = 1, kind: ServiceKind = ServiceKind.PHYSICAL, participant: str = "nobody") -> Work:
    return Work(
        number=number,
        label="step1",
        key="1.1/step1",
        step=Step("step1", "Work", {}, parse("Jar001 isOn Shelf2")),
        service_type=ServiceType(name="Work", effect="", kind=kind),
        participant=participant,
        service="Robot1.Work",
        provider="Robot1",
        started_at=1.0,
        concerned=("Jar001", "Jar002"),
        state=State.UNREACHABLE,
    )


class ObservationHarness:
    """A task whose first work was lost."""

    def __init__(self) -> None:
        self.transaction, self.context, self.reports = TransactionHarness(), context(), Reports()
        self.member = self.transaction.invited()
        self.work = work(participant=self.member.id)
        self.look_queue, self.known_services = LookQueue(), KnownServices()
        self.logged_events: list[tuple[Event, float, Work]] = []
        self.observation = Observation(
            self.look_queue,
            owner="task1",
            reservation=TaskReservation(),
            log=ExecutionLog(works=[self.work]),
            members=self.transaction.members,
            services=AvailableServices(self.known_services, self.context.replica, self.context.directory),
            reports=self.reports,
            context=self.context,
            log_event=lambda event, now, work: self.logged_events.append((event, now, work)),
        )

    def begin_look(self) -> Look:
        self.look_queue.unseen.append(Unseen("Jar001", 1))
        run_effects(self.observation.begin(5.0))
        assert self.look_queue.current_look is not None
        return self.look_queue.current_look

    def discovered(self, *offers: Offer) -> LookPlan | None:
        self.list_offers(*offers)
        return run_effects(self.observation.discovered(ForLook("task1", self.look_queue.look_count), None, 6.0))[1]

    def list_offers(self, *offers: Offer) -> None:
        """The Registry lists these offers."""
        assert self.context.directory is not None
        self.context.directory.offers = Offers(offers)


UNSEEN = UpdateMap(
    changes=(FactRemoved(Fact("isOn", ("Jar001", "Shelf1"))), ValueSet("Jar001", UNKNOWN, True)),
    author="nobody could look",
    expected_version=7,
    observation=Observed(as_of=1.0),
)


def test_what_work_left_that_changes_things_is_looked_at_one_after_the_other() -> None:
    look_queue = LookQueue()
    look_queue.add_work(work(2, ServiceKind.COGNITIVE))
    look_queue.add_work(work(3, ServiceKind.SOFTWARE))
    assert look_queue.unseen == []
    look_queue.add_work(work(4))
    look_queue.requeue(Look(object="Jar003", work=1, since_version=0, serial=1))
    assert look_queue.unseen == [Unseen("Jar001", 4), Unseen("Jar002", 4), Unseen("Jar003", 1)]
    look_queue.drop()
    assert len(look_queue.unseen) == 3
    look_queue.current_look = Look(object="Jar004", work=5, since_version=0, serial=1)
    look_queue.drop()
    assert (look_queue.unseen[0], len(look_queue.unseen)) == (Unseen("Jar004", 5), 4)
    look_queue.drop()
    assert len(look_queue.unseen) == 4


@pytest.mark.parametrize(("lost_at", "since_version"), [(3, 3), (0, 0), (None, 7)])
def test_it_is_found_out_who_can_look_at_what_is_next(lost_at: int | None, since_version: int) -> None:
    harness = ObservationHarness()
    harness.member.lost_version = lost_at
    harness.look_queue.unseen += [Unseen("Jar001", 1), Unseen("Jar002", 1)]
    assert [*harness.observation.begin(5.0)] == []
    effects = [*harness.context.discovery.confirm(5.0)]
    assert [*harness.context.discovery.confirm(5.0)] == [], "it is asked already"
    assert harness.look_queue.current_look is not None
    look = harness.look_queue.current_look
    assert (look.object, look.work, look.since_version, look.serial, look.plans) == ("Jar001", 1, since_version, 1, [])
    assert harness.look_queue.unseen == [Unseen("Jar002", 1)]
    assert [effect.message.body for effect in effects if isinstance(effect, Send)] == [SubscribeServices(lease=LEASE)]
    assert harness.context.directory is not None
    for known_since, answer in ((4.0, None), (5.0, ServicesKnown(ForLook("task1", 1), None))):
        harness.context.directory.known_since = known_since
        assert harness.context.discovery.next_answer(laboratory(), 5.0) == answer


def test_of_one_who_is_not_known_any_more_nothing_is_known_since_now() -> None:
    harness = ObservationHarness()
    harness.work.participant = "nobody"
    assert harness.begin_look().since_version == 7


def test_somebody_looks_if_anybody_can_and_then_the_next() -> None:
    harness = ObservationHarness()
    look = harness.begin_look()
    offers = offer("Robot1"), offer("Robot2", look_service_type()), offer("Robot3", look_service_type("Look"))
    assert harness.discovered(*offers) == LookPlan(look_plan("Jar001"), look)
    assert (harness.look_queue.current_look, look.plans) == (None, [look_plan("Jar001", "Look")])
    assert run_effects(harness.observation.next_plan(look, 9.0)) == ([], LookPlan(look_plan("Jar001", "Look"), look))
    assert look.plans == []
    assert harness.logged_events == [
        (events.LookBegun(service_type="FindObject", object="Jar001"), 6.0, harness.work),
        (events.LookBegun(service_type="Look", object="Jar001"), 9.0, harness.work),
    ]
    assert harness.reports.waiting == []


@pytest.mark.parametrize("offers", [None, "the registry is out of order"])
def test_when_nobody_can_look_the_map_says_that_nothing_is_known(offers: str | None) -> None:
    harness = ObservationHarness()
    harness.list_offers(offer("Robot1"))
    harness.begin_look()
    effects, result = run_effects(harness.observation.discovered(ForLook("task1", 1), offers, 6.0))
    assert (result, harness.look_queue.current_look) == (None, None)
    assert harness.logged_events == [(events.NobodyLooks(object="Jar001"), 6.0, harness.work)]
    assert harness.reports.waiting == [Report(update=UNSEEN, subject=UnobservedSubject("Jar001", 1))]
    assert [effect.message.body for effect in effects if isinstance(effect, Send)] == [UNSEEN]


@pytest.mark.parametrize(("order", "news", "known_until"), [(0.0, 0.0, 1.0), (1.0, 3.0, 3.0), (4.0, 3.0, 4.0)])
def test_nothing_is_known_since_the_last_order_or_the_last_report(order: float, news: float, known_until: float) -> None:
    harness = ObservationHarness()
    harness.member.last_order_time, harness.member.last_news_time = order, news
    harness.begin_look()
    harness.discovered()
    (report,) = harness.reports.waiting
    assert report.update.observation == Observed(as_of=known_until)


def test_an_answer_to_what_is_not_asked_any_more_means_nothing() -> None:
    harness = ObservationHarness()
    harness.list_offers(offer("Robot1", look_service_type()))
    assert run_effects(harness.observation.discovered(ForLook("task1", 0), None, 6.0)) == ([], None)
    look = harness.begin_look()
    assert run_effects(harness.observation.discovered(ForLook("task1", 2), None, 6.0)) == ([], None)
    assert (harness.look_queue.current_look, harness.logged_events) == (look, [])


@pytest.mark.parametrize(
    ("state", "reported", "member_known", "announced"),
    [
        (State.UNREACHABLE, True, True, False),
        (State.UNREACHABLE, False, True, True),
        (State.FAILED, True, True, True),
        (State.UNREACHABLE, True, False, True),
    ],
)
def test_nothing_is_said_of_what_was_reported_meanwhile(state: State, reported: bool, member_known: bool, announced: bool) -> None:
    harness = ObservationHarness()
    look = harness.begin_look()
    harness.work.state, harness.member.reported = state, reported
    if not member_known:
        harness.work.participant = "nobody"
    effects, result = run_effects(harness.observation.next_plan(look, 9.0))
    assert (result, bool(effects), bool(harness.reports.waiting), bool(harness.logged_events)) == (None, announced, announced, announced)


@pytest.mark.parametrize(
    ("state", "member_known", "problems", "lost_at"),
    [
        (State.UNREACHABLE, True, (), 7),
        (State.FAILED, True, (), 3),
        (State.UNREACHABLE, True, ("it was seen",), 3),
        (State.UNREACHABLE, False, (), 3),
    ],
)
def test_when_the_map_says_it_what_is_reported_later_is_news(
    state: State, member_known: bool, problems: tuple[str, ...], lost_at: int
) -> None:
    harness = ObservationHarness()
    harness.member.lost_version, harness.work.state = 3, state
    if not member_known:
        harness.work.participant = "nobody"
    harness.observation.assumed(UnobservedSubject("Jar001", 1), ReportResult(problems=problems), 9.0)
    assert harness.member.lost_version == lost_at
    assert harness.logged_events == ([(events.KnownOtherwise(object="Jar001", problems=problems), 9.0, harness.work)] if problems else [])


@pytest.mark.parametrize(("before", "repeated", "again"), [("Shelf1", False, True), ("Shelf1", True, False), ("Shelf2", False, False)])
def test_what_was_seen_while_the_lost_participant_may_have_been_at_work_proves_nothing(before: str, repeated: bool, again: bool) -> None:
    """A camera saw the jar in its place, and the robot took it after that. Elsewhere, somebody else has it."""
    harness = ObservationHarness()
    harness.work.prior_situation, harness.work.ended = parse(f"Jar001 isOn {before} AND Jar002 isOn Shelf2"), 5.0
    harness.begin_look()
    harness.discovered()
    seen = ReportResult(reception=Reception(superseded=("Jar001.Unknown = TRUE",)))
    harness.observation.assumed(UnobservedSubject("Jar001", 1, repeated=repeated), seen, 9.0)
    subject = UnobservedSubject("Jar001", 1, repeated=True)
    expected = [Report(update=structs.replace(UNSEEN, observation=Observed(as_of=5.0)), subject=subject)] if again else []
    assert harness.reports.waiting[1:] == expected


@pytest.mark.parametrize(
    ("object", "types", "service_types"),
    [
        ("Jar001", [look_service_type("Look"), TRANSFER, look_service_type(), look_service_type()], ["FindObject", "Look"]),
        ("Gone", [look_service_type()], []),
        ("Shelf1", [look_service_type()], []),
        ("Shelf1", [look_service_type(type="Object")], ["FindObject"]),
        ("Jar001", [look_service_type(kind=ServiceKind.PHYSICAL)], []),
        ("Jar001", [look_service_type(effect=f"?Thing.{UNKNOWN} = TRUE")], []),
        ("Jar001", [look_service_type(effect=f"?Other.{UNKNOWN} = FALSE")], []),
        ("Jar001", [ServiceType(name="Look", effect=f"Jar001.{UNKNOWN} = FALSE", kind=ServiceKind.COGNITIVE)], []),
        (
            "Jar001",
            [
                ServiceType(
                    name="Look",
                    effect=KNOWN_EFFECT,
                    inputs=(Parameter(name="Thing", type="Object"), Parameter(name="Place", type="Object")),
                    kind=ServiceKind.COGNITIVE,
                )
            ],
            [],
        ),
    ],
)
def test_those_can_look_whose_service_makes_the_object_known(object: str, types: Iterable[ServiceType], service_types: list[str]) -> None:
    offers = [offer("Robot1", service_type) for service_type in types]
    assert look_plans(object, offers, MAP, laboratory()) == [look_plan(object, service_type) for service_type in service_types]


@pytest.mark.parametrize(
    ("object", "changes"),
    [
        ("Jar001", [*UNSEEN.changes]),
        ("Robot1", [ValueSet("Robot1", UNKNOWN, True)]),
        ("Gone", []),
    ],
)
def test_of_what_nobody_knows_the_map_says_no_place(object: str, changes: list[Change]) -> None:
    assert unknown_changes(object, MAP, laboratory()) == changes
