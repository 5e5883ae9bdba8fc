"""A device's Service Manager, with a real Repository and Registry, on virtual time, as a Task Manager meets it."""

from __future__ import annotations

import asyncio
import logging

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.entish.formula import Formula
from somrs.errors import DeviceError
from somrs.kernel.component import Effect, Input, Received, Send
from somrs.ontology.objects import Fact
from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.ontology.types import ObjectType
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.session import CoordinatorBody, participant_id
from somrs.protocol.messages import frp
from somrs.protocol.messages.directory import Discover, Discovered
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import State
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.runtime.virtual_time import KillPoint, World
from somrs.service_manager.participant.calendar import Commitment, first_free_time
from somrs.service_manager.participant.messaging import CUT_OFF
from somrs.service_manager.participant.participant import SCHEMA, ServiceManager
from somrs.service_manager.participant.timers import DepartureRequested, HeartbeatDue, Observed, ServicesChanged
from somrs.service_manager.sdk.device import Device, Result, Situation, Task, service
from somrs.service_manager.sdk.map_reader import predecessor_name
from somrs.service_manager.sdk.orders import Order, Refusal, Report, ServiceFailed
from somrs.service_manager.sdk.values import as_term, money, python_value, seconds
from tests.support.effects import timeless
from tests.support.lab import CLIENT, REPOSITORY, contents, request
from tests.support.virtual_devices import Pause, in_virtual_time, make_ask

REGISTRY, WASHER = "http://here/registry", "http://here/washer"
WASHING = ServiceType(
    name="WashObject",
    inputs=(Parameter(name="Object", type="Graspable"),),
    effect="?Object isOn ?Provider",
    doc="Take a thing and wash it",
)
WEIGHING = ServiceType(
    name="WeighObject",
    inputs=(Parameter(name="Object", type="Graspable"),),
    outputs=(Parameter(name="Mass", type="number"),),
    effect="?Object.Weight = ?Mass",
    kind=ServiceKind.COGNITIVE,
)


def price(washer: Washer, task: Task) -> str:
    if task.inputs["Object"] == "Jar2":
        raise Refusal("Jar2 does not fit in")
    return "3.5 EUR"


class Washer(Device):
    type = ObjectType(name="Washer", parent="StationaryDevice")
    values = {"PositionX": 5.0, "PositionY": 5.0, "PositionZ": 0.0}
    trouble: Exception | None = None

    def __init__(self, name: str, simulator: str | None = None) -> None:
        super().__init__(name, simulator)
        self.running: list[str] = []
        self.peak_count = 0

    @service(WASHING, price=price, duration="1 min")
    async def wash(self, task: Task) -> Situation:
        name = str(task.inputs["Object"])
        self.running.append(name)
        self.peak_count = max(self.peak_count, len(self.running))
        try:
            await task.progress(0.25, note="filling")
            await Pause(30)
            if self.trouble is not None:
                raise self.trouble
            await task.progress(0.75, situation=f"{name} isHeldBy {self.name}")
            await Pause(30)
        finally:
            if name in self.running:
                self.running.remove(name)
        return None

    @wash.stopping
    async def drain(self, task: Task) -> Situation:
        await Pause(3)
        return f"{task.inputs['Object']} isOn Table1"

    @wash.compensation
    async def restore_object(self, task: Task, situation: Formula) -> Situation:
        await Pause(10)
        return situation

    @service(WEIGHING, duration="2 s")
    async def weigh(self, task: Task) -> Result:
        return Result(outputs={"Mass": 0.3})


class Coordinator:
    """A coordinator that says what it is told to, and notes what it hears."""

    def __init__(self) -> None:
        self.sessions: dict[str, CoordinatorSession] = {}
        self.messages: list[Message] = []
        self.unreachable = False

    def handle(self, event: Input, now: float) -> list[Effect]:
        if not isinstance(event, Received):
            return []
        self.messages.append(event.message)
        session = self.sessions.get(event.message.header.participant or "")
        return [Send(answer) for answer in session.receive(event.message).answers] if session is not None else []


class DeviceHarness:
    """A Repository, a Registry, one washer and one coordinator."""

    def __init__(self, device: Washer | None = None) -> None:
        self.world = World()
        self.coordinator = Coordinator()
        self.reports: list[Report] = []
        self.device = device or Washer("Washer1")
        repository = Repository(REPOSITORY, contents())
        self.repository = repository
        self.world.add(REPOSITORY, repository)
        self.world.add(REGISTRY, Registry(REGISTRY, repository=REPOSITORY))
        self.world.add(CLIENT, self.coordinator)
        ask = make_ask(self.repository, lambda: self.world.now)
        manager = ServiceManager(self.device.profile(), repository=REPOSITORY, registry=REGISTRY)
        self.world.add(WASHER, manager, in_virtual_time(self.device, ask, self.reports), journaled=SCHEMA)
        self.world.run(1.0)

    @property
    def manager(self) -> ServiceManager:
        manager = self.world.components[WASHER]
        assert isinstance(manager, ServiceManager)
        return manager

    def restart(self, *, snapshot: bool = False) -> None:
        """The Service Manager is killed, with all that the device does, and comes up again with its journal."""
        if snapshot:
            self.world.snapshot(WASHER)
        self.device.running.clear()
        self.world.revive(WASHER)

    def ask(self, step: str, body: CoordinatorBody) -> None:
        session = self.session(step)
        self.world.send(session.accept() if isinstance(body, frp.Accept) else session.send(body))

    def session(self, step: str) -> CoordinatorSession:
        """The session of a step. A step `weigh` is of the other service."""
        identity = participant_id("Washer1.WeighObject" if step == "weigh" else "Washer1.WashObject", step)
        if identity not in self.coordinator.sessions:
            self.coordinator.sessions[identity] = CoordinatorSession(transaction="t1", participant=identity, me=CLIENT, peer=WASHER)
        return self.coordinator.sessions[identity]

    def run_until(self, step: str, state: State, time_limit: float = 600.0) -> None:
        session = self.session(step)
        assert self.world.run(time_limit, lambda: session.state is state), f"{session.state}, not {state}; heard {self.body_names()}"

    def arranged(self, step: str = "s1", **order: float) -> None:
        self.ask(step, msgspec.structs.replace(ARRANGE, **order))
        self.run_until(step, State.OFFERED)

    def executing(self, step: str = "s1") -> None:
        self.arranged(step)
        self.ask(step, ACCEPT)
        self.ask(step, EXECUTE)
        self.world.run(1.0)

    def body_names(self) -> list[str]:
        return [type(message.body).__name__ for message in self.coordinator.messages if message.header.transaction is not None]

    def last_word(self, step: str) -> object:
        """The last that was said of a step, but how far it is."""
        of_step = [m.body for m in self.coordinator.messages if m.header.participant == self.session(step).participant]
        return next(timeless(body) for body in reversed(of_step) if not isinstance(body, frp.Progress))

    def report(self) -> object:
        return next(timeless(m.body) for m in reversed(self.coordinator.messages) if not isinstance(m.body, frp.Progress))

    def offers(self) -> list[str]:
        self.world.send(request(Discover(), recipient=REGISTRY))
        self.world.run(1.0)
        answers = [m.body for m in self.coordinator.messages if isinstance(m.body, Discovered)]
        return [offer.service for offer in answers[-1].offers]


ARRANGE = frp.Arrange(service_type="WashObject", inputs={"Object": "Jar1"}, effect="Jar1 isOn ?Provider", precondition="Jar1 isOn Table1")
ACCEPT = frp.Accept(terms="")
EXECUTE = frp.Execute(inputs={"Object": "Jar1"}, precondition="Jar1 isOn Table1")


def test_a_device_brings_its_types_and_itself_and_its_offers() -> None:
    harness = DeviceHarness()
    assert "Washer" in harness.repository.contents.ontology.types
    assert harness.repository.contents.map.objects["Washer1"].type == "Washer"
    assert harness.offers() == ["Washer1.WashObject", "Washer1.WeighObject"]
    assert [(report.joined, report.text) for report in harness.reports] == [
        (True, "Washer1 offers Washer1.WashObject, Washer1.WeighObject")
    ]
    harness.world.run(300.0)
    assert harness.offers() == ["Washer1.WashObject", "Washer1.WeighObject"], "the lease is renewed"


def test_a_device_survives_a_registry_that_forgot_it_and_leaves_in_order() -> None:
    harness = DeviceHarness()
    harness.world.add(REGISTRY, Registry(REGISTRY, repository=REPOSITORY))
    assert harness.offers() == []
    harness.world.run(60.0)
    assert len(harness.offers()) == 2
    harness.world.notify(WASHER, DepartureRequested())
    harness.world.run(1.0)
    assert harness.offers() == []


def test_who_leaves_takes_back_what_it_promised_and_stops_what_it_does() -> None:
    harness = DeviceHarness()
    harness.executing("at work")
    harness.arranged("promised")
    harness.ask("promised", ACCEPT)
    harness.arranged("offered")
    harness.world.notify(WASHER, DepartureRequested())
    harness.run_until("at work", State.FAILED)
    harness.run_until("promised", State.FAILED)
    harness.run_until("offered", State.ENDED)
    assert harness.device.running == []
    last_reports = {step: harness.last_word(step) for step in ("at work", "promised", "offered")}
    assert last_reports == {
        "at work": frp.Failed(description="Washer1 is leaving", situation="Jar1 isOn Table1"),
        "promised": frp.Failed(description="Washer1 is leaving", tried=False),
        "offered": frp.Refuse(reason="Washer1 is leaving", not_now=True),
    }
    harness.world.run(60.0)
    assert harness.manager.open == []
    assert harness.offers() == []


def test_who_leaves_while_it_undoes_something_says_where_things_are() -> None:
    harness = DeviceHarness()
    harness.executing()
    harness.run_until("s1", State.COMPLETED)
    harness.ask("s1", frp.Compensate(situation="Jar1 isOn Table2"))
    harness.world.run(5.0)
    harness.world.notify(WASHER, DepartureRequested())
    harness.run_until("s1", State.STRANDED)
    stranded = harness.last_word("s1")
    assert isinstance(stranded, frp.Stranded)
    assert stranded.description == "Washer1 is leaving"


def test_who_left_takes_no_orders_until_it_is_back() -> None:
    harness = DeviceHarness()
    harness.world.notify(WASHER, DepartureRequested())
    harness.ask("s1", ARRANGE)
    harness.run_until("s1", State.ENDED)
    assert harness.session("s1").reason == "Washer1 is leaving"
    harness.restart()
    harness.arranged("s2")


class Mover(Device):
    type = "StationaryDevice"

    @service("TransferObjekt", duration=1)
    async def move(self, task: Task) -> Situation:
        return None


def test_a_service_type_that_nobody_defined_is_told_with_the_nearest_name() -> None:
    world, reports = World(), list[Report]()
    world.add(REPOSITORY, Repository(REPOSITORY, contents()))
    world.add(REGISTRY, Registry(REGISTRY, repository=REPOSITORY))
    mover = Mover("Robot1")
    world.add(WASHER, ServiceManager(mover.profile(), repository=REPOSITORY, registry=REGISTRY), in_virtual_time(mover, reports=reports))
    world.run(1.0)
    (report,) = reports
    assert not report.joined
    assert "no service type TransferObjekt. did you mean TransferObject?" in report.text


def test_terms_work_and_result() -> None:
    harness = DeviceHarness()
    harness.arranged()
    terms = harness.session("s1").terms
    assert terms is not None
    assert (terms.price, terms.currency, terms.duration, terms.effect) == (3.5, "EUR", 60.0, "Jar1 isOn Washer1")
    harness.ask("s1", ACCEPT)
    harness.ask("s1", EXECUTE)
    harness.run_until("s1", State.COMPLETED)
    assert harness.report() == frp.Completed(situation="Jar1 isOn Washer1")
    harness.ask("s1", frp.End(outcome=frp.Outcome.ACCOMPLISHED))
    harness.world.run(1.0)
    assert harness.manager.state_of("t1", harness.session("s1").participant) is State.ENDED
    progress = [m.body for m in harness.coordinator.messages if isinstance(m.body, frp.Progress)]
    assert {p.note for p in progress} == {"filling", ""}
    assert 11 <= len(progress) <= 14, "two by the author, and a heartbeat every five of sixty seconds"
    assert [name for name in harness.body_names() if name != "Progress"] == ["Terms", "Completed"]


def test_outputs_fill_the_effect() -> None:
    harness = DeviceHarness()
    session = CoordinatorSession(transaction="t1", participant="Washer1.WeighObject#w", me=CLIENT, peer=WASHER)
    harness.coordinator.sessions[session.participant] = session
    order = frp.Arrange(service_type="WeighObject", inputs={"Object": "Jar1"}, effect="Jar1.Weight = ?Mass")
    harness.world.send(session.send(order))
    harness.world.run(1.0)
    harness.world.send(session.accept())
    harness.world.send(session.send(frp.Execute(inputs={})))
    harness.world.run(10.0)
    assert harness.report() == frp.Completed(situation="Jar1.Weight = 0.3", outputs={"Mass": 0.3})


def test_refusals() -> None:
    harness = DeviceHarness()
    harness.ask("s1", msgspec.structs.replace(ARRANGE, inputs={"Object": "Jar2"}))
    harness.ask("s2", msgspec.structs.replace(ARRANGE, latest_finish=harness.world.now + 30))
    harness.run_until("s1", State.ENDED)
    harness.run_until("s2", State.ENDED)
    assert harness.session("s1").reason == "Jar2 does not fit in"
    assert "after the latest finish" in harness.session("s2").reason
    other_session = CoordinatorSession(transaction="t1", participant="Washer1.Fly#x", me=CLIENT, peer=WASHER)
    harness.world.send(other_session.send(frp.Arrange(service_type="Fly", inputs={}, effect="Jar1 isOn Table1")))
    harness.world.run(1.0)
    assert harness.report() == frp.Refuse(reason="Washer1 offers WashObject, WeighObject, and not Fly")


def test_terms_expire() -> None:
    harness = DeviceHarness()
    harness.arranged()
    harness.run_until("s1", State.ENDED)
    assert harness.session("s1").reason == "the terms expired"


def test_who_is_never_told_to_start_is_free_again_when_it_is_too_late() -> None:
    harness = DeviceHarness()
    finish = harness.world.now + 200
    harness.arranged("s1", latest_finish=finish)
    harness.ask("s1", ACCEPT)
    harness.world.run(130.0)
    assert harness.session("s1").state is State.COMMITTED
    harness.run_until("s1", State.FAILED, time_limit=20.0)
    assert harness.last_word("s1") == frp.Failed(description="no order to start came in time", tried=False)
    assert harness.world.now == pytest.approx(finish - 60, abs=1), "from then on its minute is not enough"
    assert harness.manager.calendar(harness.world.now) == []


class Nowhere(Washer):
    values = {"PositionX": "left", "PositionY": 5.0, "PositionZ": 0.0}


def test_who_is_not_taken_onto_the_map_says_why_and_offers_nothing() -> None:
    harness = DeviceHarness(Nowhere("Washer1"))
    assert "Washer1" not in harness.repository.contents.map.objects
    assert [report.joined for report in harness.reports] == [False]
    assert harness.reports[0].text.startswith("Washer1 cannot join: ")
    assert "PositionX" in harness.reports[0].text
    assert harness.offers() == []
    harness.world.run(300.0)
    assert len(harness.reports) == 1, "it is said once"


def test_a_failure_says_what_holds() -> None:
    device = Washer("Washer1")
    device.trouble = ServiceFailed("the pump is broken", "Jar1 isOn Floor1")
    harness = DeviceHarness(device)
    harness.executing()
    harness.run_until("s1", State.FAILED)
    assert harness.report() == frp.Failed(description="the pump is broken", situation="Jar1 isOn Floor1")


def test_broken_code_fails_the_service_and_not_the_manager(caplog: pytest.LogCaptureFixture) -> None:
    device = Washer("Washer1")
    device.trouble = ZeroDivisionError("division by zero")
    harness = DeviceHarness(device)
    harness.executing()
    with caplog.at_level(logging.CRITICAL):
        harness.run_until("s1", State.FAILED)
    assert harness.report() == frp.Failed(description="ZeroDivisionError: division by zero", situation="Jar1 isOn Table1")
    device.trouble = None
    harness.executing("s2")
    harness.run_until("s2", State.COMPLETED)


def test_stop_runs_the_authors_way_to_a_safe_state() -> None:
    harness = DeviceHarness()
    harness.executing()
    harness.world.run(10.0)
    harness.ask("s1", frp.Stop(reason="the client cancelled"))
    harness.run_until("s1", State.STOPPED)
    assert harness.report() == frp.Stopped(situation="Jar1 isOn Table1")
    assert harness.device.running == []
    assert not [timer for timer in harness.world.timers(WASHER) if isinstance(timer, HeartbeatDue)], "there is nothing more to tell"


def test_compensation() -> None:
    harness = DeviceHarness()
    harness.executing()
    harness.run_until("s1", State.COMPLETED)
    harness.ask("s1", frp.Compensate(situation="Jar1 isOn Table2"))
    harness.run_until("s1", State.COMPENSATED)
    assert harness.report() == frp.Compensated(situation="Jar1 isOn Table2")


def test_an_execute_that_comes_too_late_moves_nothing() -> None:
    harness = DeviceHarness()
    late = msgspec.structs.replace(EXECUTE, begin_by=harness.world.now - 1)
    harness.arranged("s1")
    harness.session("s1").accept()  # that is lost
    harness.ask("s1", late)
    harness.run_until("s1", State.ENDED)
    assert "too late to begin" in harness.session("s1").reason
    harness.arranged("s2")
    harness.ask("s2", ACCEPT)
    harness.ask("s2", late)
    harness.run_until("s2", State.FAILED)
    failed = harness.report()
    assert isinstance(failed, frp.Failed)
    assert not failed.tried
    assert "do not agree" in failed.description, "that clocks differ may be the cause"
    assert harness.body_names().count("Failed") == 1
    harness.world.run(120)
    assert harness.device.peak_count == 0


def test_a_compensate_that_comes_too_late_moves_nothing() -> None:
    harness = DeviceHarness()
    harness.executing()
    harness.run_until("s1", State.COMPLETED)
    harness.ask("s1", frp.Compensate(situation="Jar1 isOn Table2", begin_by=harness.world.now - 1))
    harness.run_until("s1", State.STRANDED)
    stranded = harness.report()
    assert isinstance(stranded, frp.Stranded)
    assert not stranded.tried
    assert harness.manager.idle


def test_what_came_in_time_may_wait_for_its_turn() -> None:
    harness = DeviceHarness()
    harness.executing("s1")
    harness.arranged("s2")
    harness.ask("s2", ACCEPT)
    harness.ask("s2", msgspec.structs.replace(EXECUTE, begin_by=harness.world.now + 10))
    harness.run_until("s1", State.COMPLETED)
    harness.run_until("s2", State.COMPLETED)


def test_an_execute_that_comes_again_too_late_changes_nothing() -> None:
    harness = DeviceHarness()
    harness.arranged()
    harness.ask("s1", ACCEPT)
    harness.ask("s1", msgspec.structs.replace(EXECUTE, begin_by=harness.world.now + 10))
    harness.world.run(20)
    harness.world.send(harness.session("s1")._repeat("Execute")[0])
    harness.run_until("s1", State.COMPLETED)


def test_one_at_a_time_in_the_order_of_the_orders() -> None:
    harness = DeviceHarness()
    harness.executing("s1")
    harness.arranged("s2")
    first, second = harness.session("s1").terms, harness.session("s2").terms
    assert first is not None
    assert first.start_from is not None
    assert second is not None
    assert second.start_from == pytest.approx(first.start_from + 60, abs=1), "its window begins when the earlier one ends"
    harness.ask("s2", ACCEPT)
    harness.ask("s2", EXECUTE)
    harness.run_until("s1", State.COMPLETED, 61)
    assert "waits for its turn" in {m.body.note for m in harness.coordinator.messages if isinstance(m.body, frp.Progress)}
    harness.run_until("s2", State.COMPLETED, 61)
    assert harness.device.peak_count == 1


def test_a_waiting_one_that_is_stopped_never_begins() -> None:
    harness = DeviceHarness()
    harness.executing("s1")
    harness.executing("s2")
    harness.ask("s2", frp.Stop(reason="not needed any more"))
    harness.run_until("s2", State.STOPPED, 1)
    stopped = [message.body for message in harness.coordinator.messages if isinstance(message.body, frp.Stopped)]
    assert stopped == [frp.Stopped(tried=False)]
    harness.run_until("s1", State.COMPLETED)
    assert harness.device.peak_count == 1


def test_capacity() -> None:
    device = Washer("Washer1")
    device.capacity = 2
    harness = DeviceHarness(device)
    harness.executing("s1")
    harness.executing("s2")
    harness.run_until("s2", State.COMPLETED, 61)
    assert device.peak_count == 2


class Attendant(Washer):
    """A washer that weighs beside its other work."""

    @service(WEIGHING, duration="2 s", occupies=False)
    async def weigh(self, task: Task) -> Result:
        await Pause(2)
        return Result(outputs={"Mass": 0.3})


def test_a_service_that_does_not_occupy_its_device_waits_for_no_other() -> None:
    harness = DeviceHarness(Attendant("Washer1"))
    harness.executing("s1")
    weighing = msgspec.structs.replace(ARRANGE, service_type="WeighObject", effect="Jar1.Weight = ?Mass", precondition=None)
    harness.ask("weigh", weighing)
    harness.run_until("weigh", State.OFFERED)
    terms = harness.session("weigh").terms
    assert terms is not None
    assert terms.start_from == pytest.approx(harness.world.now, abs=1)
    harness.ask("weigh", ACCEPT)
    harness.ask("weigh", EXECUTE)
    harness.run_until("weigh", State.COMPLETED, 3)
    assert harness.session("s1").state is State.EXECUTING


def test_a_device_whose_services_change_offers_those_that_it_has_then() -> None:
    harness = DeviceHarness(Attendant("Washer1"))
    assert len(harness.offers()) == 2
    profile = harness.device.profile()
    fewer = msgspec.structs.replace(profile, capabilities=profile.capabilities[:1])
    harness.world.notify(WASHER, ServicesChanged(fewer))
    harness.world.run(1.0)
    assert harness.offers() == [fewer.service(fewer.capabilities[0])]


@pytest.mark.parametrize("body", [frp.End(outcome=frp.Outcome.CANCELLED), frp.Cancel(reason="r")])
def test_end_in_the_middle_stops_the_device(body: CoordinatorBody) -> None:
    harness = DeviceHarness()
    harness.executing()
    session = harness.session("s1")
    header = msgspec.structs.replace(session._repeat("Execute")[0].header, message_id="urn:uuid:end")
    harness.world.send(Message(header=header, body=body))
    harness.world.run(10.0)
    assert harness.manager.state_of("t1", session.participant) is State.ENDED
    assert harness.manager.idle
    assert harness.device.running == []


def test_a_device_that_nobody_can_reach_stops_by_itself() -> None:
    harness = DeviceHarness()
    harness.executing()
    harness.world.remove(CLIENT)
    harness.world.run(CUT_OFF + 15)
    assert harness.device.running == []
    assert harness.manager.state_of("t1", harness.session("s1").participant) is State.FAILED
    harness.world.add(CLIENT, harness.coordinator)
    harness.run_until("s1", State.FAILED)
    assert harness.report() == frp.Failed(
        description="no heartbeat reached the coordinator, so the work was stopped", situation="Jar1 isOn Table1"
    )


def test_anybody_may_ask_for_the_state() -> None:
    harness = DeviceHarness()
    harness.executing()
    harness.ask("s1", frp.Query())
    harness.world.run(1.0)
    (status,) = (m.body for m in harness.coordinator.messages if isinstance(m.body, frp.Status))
    assert (status.state, status.last_message) == (State.EXECUTING, harness.session("s1").terms_id)


def test_a_message_outside_any_transaction_gets_a_fault() -> None:
    harness = DeviceHarness()
    harness.world.send(request(EXECUTE, recipient=WASHER))
    harness.world.run(1.0)
    fault = harness.report()
    assert isinstance(fault, frp.Fault)
    assert "needs a transaction and a participant" in fault.text


@pytest.mark.parametrize(
    ("seconds_before", "outcome", "report"),
    [
        (0.0, State.COMPLETED, frp.Completed(situation="Jar1 isOn Washer1")),
        (10.0, State.FAILED, None),
        (100.0, State.COMPLETED, frp.Completed(situation="Jar1 isOn Washer1")),
    ],
    ids=["while offered", "while it worked", "when it was done"],
)
@pytest.mark.parametrize("snapshot", [False, True])
def test_restart(seconds_before: float, outcome: State, report: object, snapshot: bool) -> None:
    harness = DeviceHarness()
    if seconds_before == 0.0:
        harness.arranged()
    else:
        harness.executing()
        harness.world.run(seconds_before)
    harness.restart(snapshot=snapshot)
    if seconds_before == 0.0:
        harness.ask("s1", ACCEPT)
        harness.ask("s1", EXECUTE)
    harness.run_until("s1", outcome)
    assert report is None or harness.report() == report
    if report is None:
        failed = harness.report()
        assert isinstance(failed, frp.Failed)
        assert "restarted while it worked" in failed.description
        assert failed.situation == "Jar1 isOn Table1"
    harness.ask("s1", frp.End(outcome=frp.Outcome.ACCOMPLISHED))
    harness.run_until("s1", State.ENDED)


def test_what_waits_when_the_process_is_killed_never_begins() -> None:
    harness = DeviceHarness()
    harness.executing("s1")
    harness.executing("s2")
    harness.restart()
    harness.run_until("s1", State.FAILED)
    harness.run_until("s2", State.FAILED)
    assert harness.device.peak_count == 1
    assert harness.manager.idle


def test_who_is_told_to_stop_is_halted_once_more_after_a_restart() -> None:
    harness = DeviceHarness()
    harness.executing()
    harness.ask("s1", frp.Stop(reason="enough"))
    harness.world.run(1.0)
    harness.restart()
    harness.run_until("s1", State.STOPPED)
    assert harness.report() == frp.Stopped(situation="Jar1 isOn Table1")


def test_terms_are_worked_out_anew_after_a_restart() -> None:
    harness = DeviceHarness()
    harness.world.kill(WASHER, KillPoint.JOURNALED)
    harness.ask("s1", ARRANGE)
    harness.world.run(1.0)
    harness.restart()
    harness.run_until("s1", State.OFFERED)


def test_what_is_noticed_comes_to_the_map_in_order_whatever_is_down() -> None:
    harness = DeviceHarness()
    harness.world.cut_off(REPOSITORY)
    for number in (1, 2, 1, 2):
        harness.world.notify(WASHER, Observed(f"Jar1 isOn Table{number}"))
    harness.world.run(30.0)
    harness.restart()
    harness.world.run(30.0)
    assert len(harness.manager.state.reports.pending) == 4
    harness.world.reconnect(REPOSITORY)
    harness.world.run(30.0)
    assert harness.manager.state.reports.pending == []
    assert [fact for fact in harness.repository.contents.map.facts() if fact.arguments[0] == "Jar1"] == [Fact("isOn", ("Jar1", "Table2"))]


def test_what_is_noticed_of_a_device_that_is_not_on_the_map_yet_waits_until_it_is() -> None:
    harness = DeviceHarness()
    harness.world.remove(REPOSITORY)
    harness.restart()
    harness.world.notify(WASHER, Observed("Jar1 isOn Washer1"))
    anew = Repository(REPOSITORY, contents())
    harness.world.add(REPOSITORY, anew)
    harness.world.run(60.0)
    assert anew.contents.map.has_fact("isOn", ("Jar1", "Washer1"))
    assert [report.text for report in harness.reports if not report.joined] == []


def test_what_the_repository_does_not_take_is_told_to_a_person() -> None:
    harness = DeviceHarness()
    harness.world.notify(WASHER, Observed("Jar1 isOn Nowhere"))
    harness.world.notify(WASHER, Observed("Jar1 isOn Table2"))
    harness.world.run(30.0)
    assert harness.manager.state.reports.pending == []
    assert harness.reports[-1].joined is None
    assert "rejects Jar1 isOn Nowhere from Washer1" in harness.reports[-1].text
    assert Fact("isOn", ("Jar1", "Table2")) in harness.repository.contents.map.facts()


def test_reading_the_map() -> None:
    harness = DeviceHarness()
    task = Task("Washer1", order(harness), make_ask(harness.repository, lambda: 0.0), lambda value: None)

    async def read() -> tuple[object, ...]:
        jar = await task.map.object("Jar1")
        assert jar is not None
        return (
            jar.type,
            await task.map.object("Jar3"),
            await task.map.query("?Jar: Jar isOn Table1"),
            await task.map.holds("Jar1 isOn Table2"),
        )

    assert asyncio.run(read()) == ("Jar", None, [{"Jar": "Jar1"}, {"Jar": "Jar2"}], False)
    assert task.inputs == {"Object": "Jar1"}
    assert str(task.effect) == "Jar1 isOn Washer1"


def order(harness: DeviceHarness) -> Order:
    harness.executing("read")
    return next(job.order for job in harness.manager.state.jobs if job.order is not None)


def test_a_class_that_cannot_be_run_says_why() -> None:
    class Idle(Device):
        type = "StationaryDevice"

    with pytest.raises(DeviceError, match="has no services"):
        Idle("Idle1").profile()
    with pytest.raises(DeviceError, match="'two minutes' is not a duration"):
        service(WASHING, duration="two minutes")(Washer.wash.performs)
    with pytest.raises(DeviceError, match="async def"):
        service(WASHING, duration=1)(lambda device, task: None)  # type: ignore[arg-type, return-value]  # that is the mistake


def test_amounts_and_values() -> None:
    assert money("4 EUR") == (4.0, "EUR")
    assert money(2) == (2.0, "EUR")
    assert [seconds(text) for text in ("30 s", "2 min", "1.5 h", "250ms", "7")] == [30, 120, 5400, 0.25, 7]
    assert [python_value(text) for text in ("Jar1", "12.5", '"a b"', "TRUE")] == ["Jar1", 12.5, "a b", True]


@given(st.one_of(st.booleans(), st.floats(-1e9, 1e9), st.text(max_size=20), st.sampled_from(["TRUE", "AND", "Jar-1", "NOT-1", ""])))
def test_values_survive_becoming_terms(value: bool | float | str) -> None:
    assert python_value(str(as_term(value))) == value


@given(st.text("abcXYZ019_", min_size=1), st.lists(st.text("abcXYZ019_", min_size=1), max_size=20))
def test_the_page_behind_what_is_before_a_name_begins_with_it(name: str, other_names: list[str]) -> None:
    names = sorted({name, *other_names})
    assert next(candidate for candidate in names if candidate > predecessor_name(name)) == name


@given(
    st.lists(st.tuples(st.integers(0, 30), st.integers(1, 10)).map(lambda c: (float(c[0]), float(c[0] + c[1]))), max_size=8),
    st.integers(0, 30),
    st.integers(1, 10),
    st.integers(1, 3),
)
def test_the_calendar_against_trying_every_second(busy: list[Commitment], earliest: int, duration: int, capacity: int) -> None:
    def room(start: int) -> bool:
        return all(sum(begins <= s < ends for begins, ends in busy) < capacity for s in range(start, start + duration))

    plain = next(start for start in range(earliest, 100) if room(start))
    assert first_free_time(busy, float(earliest), float(duration), capacity) == plain
