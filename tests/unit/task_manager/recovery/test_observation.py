"""Who can look at an object of which nothing is known, and what the map says when nobody can."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.component import Send
from somrs.ontology.objects import Change, Fact, FactRemoved, ValueSet
from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.ontology.types import UNKNOWN
from somrs.planner.model.plan import Plan, Step
from somrs.protocol.messages import events
from somrs.protocol.messages.directory import Discover, Offer
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.task_manager.arrangement.available_services import AvailableServices, KnownServices
from somrs.task_manager.execution.execution_log import ExecutionLog, Work
from somrs.task_manager.execution.reports import Report, Reports, UnobservedSubject
from somrs.task_manager.recovery.observation import Look, LookPlan, LookQueue, Observation, Unseen, look_plans, unknown_changes
from somrs.task_manager.requests import ForLook
from tests.unit.planner.test_planning import MAP, TRANSFER, laboratory
from tests.unit.task_manager.arrangement.test_plan_request import context, offer
from tests.unit.task_manager.execution.test_participants import Table, carried_out

SEEN = f"?Thing.{UNKNOWN} = FALSE"


def looking(
    name: str = "FindObject", type: str = "Graspable", effect: str = SEEN, kind: ServiceKind = ServiceKind.COGNITIVE
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


class Looking:
    """A task whose first work was lost."""

    def __init__(self) -> None:
        self.table, self.context, self.reports = Table(), context(), Reports()
        self.member = self.table.invited()
        self.work = work(participant=self.member.id)
        self.looks, self.known = LookQueue(), KnownServices()
        self.told: list[tuple[Event, float, Work]] = []
        self.observation = Observation(
            self.looks,
            owner="task1",
            log=ExecutionLog(works=[self.work]),
            members=self.table.members,
            services=AvailableServices(self.known, self.context.replica),
            reports=self.reports,
            context=self.context,
            log_event=lambda event, now, work: self.told.append((event, now, work)),
        )

    def begun(self) -> Look:
        self.looks.unseen.append(Unseen("Jar001", 1))
        carried_out(self.observation.begin(5.0))
        assert self.looks.current_look is not None
        return self.looks.current_look

    def discovered(self, *offers: Offer) -> LookPlan | None:
        return carried_out(self.observation.discovered(ForLook("task1", self.looks.look_count), offers, 6.0))[1]


UNSEEN = UpdateMap(
    changes=(FactRemoved(Fact("isOn", ("Jar001", "Shelf1"))), ValueSet("Jar001", UNKNOWN, True)),
    author="nobody could look",
    expected_version=7,
)


def test_what_work_left_that_changes_things_is_looked_at_one_after_the_other() -> None:
    looks = LookQueue()
    looks.add_work(work(2, ServiceKind.COGNITIVE))
    looks.add_work(work(3, ServiceKind.SOFTWARE))
    assert looks.unseen == []
    looks.add_work(work(4))
    looks.requeue(Look(object="Jar003", work=1, since_version=0, serial=1))
    assert looks.unseen == [Unseen("Jar001", 4), Unseen("Jar002", 4), Unseen("Jar003", 1)]
    looks.drop()
    assert len(looks.unseen) == 3
    looks.current_look = Look(object="Jar004", work=5, since_version=0, serial=1)
    looks.drop()
    assert (looks.unseen[0], len(looks.unseen)) == (Unseen("Jar004", 5), 4)
    looks.drop()
    assert len(looks.unseen) == 4


@pytest.mark.parametrize(("lost_at", "since"), [(3, 3), (0, 0), (None, 7)])
def test_it_is_found_out_who_can_look_at_what_is_next(lost_at: int | None, since: int) -> None:
    looking = Looking()
    looking.member.lost_version = lost_at
    looking.looks.unseen += [Unseen("Jar001", 1), Unseen("Jar002", 1)]
    effects = [*looking.observation.begin(5.0)]
    assert looking.looks.current_look is not None
    asking = looking.looks.current_look
    assert (asking.object, asking.work, asking.since_version, asking.serial, asking.plans) == ("Jar001", 1, since, 1, [])
    assert looking.looks.unseen == [Unseen("Jar002", 1)]
    assert [effect.message.body for effect in effects if isinstance(effect, Send)] == [Discover()]
    (request,) = looking.context.requests.pending.values()
    assert request.purpose == ForLook("task1", 1)


def test_of_one_who_is_not_known_any_more_nothing_is_known_since_now() -> None:
    looking = Looking()
    looking.work.participant = "nobody"
    assert looking.begun().since_version == 7


def test_somebody_looks_if_anybody_can_and_then_the_next() -> None:
    one = Looking()
    look = one.begun()
    offers = offer("Robot1"), offer("Robot2", looking()), offer("Robot3", looking("Look"))
    assert one.discovered(*offers) == LookPlan(look_plan("Jar001"), look)
    assert (one.looks.current_look, look.plans, one.known.offers) == (None, [look_plan("Jar001", "Look")], offers)
    assert carried_out(one.observation.next_plan(look, 9.0)) == ([], LookPlan(look_plan("Jar001", "Look"), look))
    assert look.plans == []
    assert one.told == [
        (events.LookBegun(service_type="FindObject", object="Jar001"), 6.0, one.work),
        (events.LookBegun(service_type="Look", object="Jar001"), 9.0, one.work),
    ]
    assert one.reports.waiting == []


@pytest.mark.parametrize("offers", [(offer("Robot1"),), "the registry is out of order"])
def test_when_nobody_can_look_the_map_says_that_nothing_is_known(offers: tuple[Offer, ...] | str) -> None:
    one = Looking()
    one.begun()
    effects, found = carried_out(one.observation.discovered(ForLook("task1", 1), offers, 6.0))
    assert (found, one.looks.current_look) == (None, None)
    assert one.told == [(events.NobodyLooks(object="Jar001"), 6.0, one.work)]
    assert one.reports.waiting == [Report(update=UNSEEN, subject=UnobservedSubject("Jar001", 1))]
    assert [effect.message.body for effect in effects if isinstance(effect, Send)] == [UNSEEN]
    assert one.known.offers == (() if isinstance(offers, str) else offers)


def test_an_answer_to_what_is_not_asked_any_more_means_nothing() -> None:
    one = Looking()
    assert carried_out(one.observation.discovered(ForLook("task1", 0), (offer("Robot1", looking()),), 6.0)) == ([], None)
    look = one.begun()
    assert carried_out(one.observation.discovered(ForLook("task1", 2), (offer("Robot1", looking()),), 6.0)) == ([], None)
    assert (one.looks.current_look, one.told, one.known.offers) == (look, [], ())


@pytest.mark.parametrize(
    ("state", "reported", "known", "said"),
    [
        (State.UNREACHABLE, True, True, False),
        (State.UNREACHABLE, False, True, True),
        (State.FAILED, True, True, True),
        (State.UNREACHABLE, True, False, True),
    ],
)
def test_nothing_is_said_of_what_was_reported_meanwhile(state: State, reported: bool, known: bool, said: bool) -> None:
    one = Looking()
    look = one.begun()
    one.work.state, one.member.reported = state, reported
    if not known:
        one.work.participant = "nobody"
    effects, found = carried_out(one.observation.next_plan(look, 9.0))
    assert (found, bool(effects), bool(one.reports.waiting), bool(one.told)) == (None, said, said, said)


@pytest.mark.parametrize(
    ("state", "known", "problems", "lost_at"),
    [
        (State.UNREACHABLE, True, (), 7),
        (State.FAILED, True, (), 3),
        (State.UNREACHABLE, True, ("it was seen",), 3),
        (State.UNREACHABLE, False, (), 3),
    ],
)
def test_when_the_map_says_it_what_is_reported_later_is_news(state: State, known: bool, problems: tuple[str, ...], lost_at: int) -> None:
    one = Looking()
    one.member.lost_version, one.work.state = 3, state
    if not known:
        one.work.participant = "nobody"
    one.observation.assumed(UnobservedSubject("Jar001", 1), problems, 9.0)
    assert one.member.lost_version == lost_at
    assert one.told == ([(events.KnownOtherwise(object="Jar001", problems=problems), 9.0, one.work)] if problems else [])


@pytest.mark.parametrize(
    ("object", "types", "found"),
    [
        ("Jar001", [looking("Look"), TRANSFER, looking(), looking()], ["FindObject", "Look"]),
        ("Gone", [looking()], []),
        ("Shelf1", [looking()], []),
        ("Shelf1", [looking(type="Object")], ["FindObject"]),
        ("Jar001", [looking(kind=ServiceKind.PHYSICAL)], []),
        ("Jar001", [looking(effect=f"?Thing.{UNKNOWN} = TRUE")], []),
        ("Jar001", [looking(effect=f"?Other.{UNKNOWN} = FALSE")], []),
        ("Jar001", [ServiceType(name="Look", effect=f"Jar001.{UNKNOWN} = FALSE", kind=ServiceKind.COGNITIVE)], []),
        (
            "Jar001",
            [
                ServiceType(
                    name="Look",
                    effect=SEEN,
                    inputs=(Parameter(name="Thing", type="Object"), Parameter(name="Place", type="Object")),
                    kind=ServiceKind.COGNITIVE,
                )
            ],
            [],
        ),
    ],
)
def test_those_can_look_whose_service_makes_the_object_known(object: str, types: Iterable[ServiceType], found: list[str]) -> None:
    offers = [offer("Robot1", service_type) for service_type in types]
    assert look_plans(object, offers, MAP, laboratory()) == [look_plan(object, service_type) for service_type in found]


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
