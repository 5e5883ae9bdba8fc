"""What must hold of whole systems in which anything goes wrong; and that it is noticed when it does not hold."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace

import pytest
from msgspec import structs

from somrs.kernel.component import Answered, Effect, Effects, EffectsReturning, Input, Received, TimerFired
from somrs.kernel.durability import JournalCodec
from somrs.kernel.reservations import Reservations
from somrs.protocol.messages.directory import ServicesJoined, ServicesSubscribed
from somrs.protocol.messages.events import UndoingCheaper
from somrs.protocol.messages.frp import Accept, Outcome
from somrs.protocol.messages.observations import Observation
from somrs.protocol.messages.submission import CancelTask, Policy
from somrs.repository.association import Association, Sighting
from somrs.runtime.virtual_time import KillPoint, World
from somrs.service_manager.participant.timers import TermsDue
from somrs.service_manager.sdk.orders import WorkDone
from somrs.task_manager.execution.execution_log import ExecutionLog
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.participants import Participants
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.state import TaskManagerState
from somrs.task_manager.timers import RetryDue
from somrs.task_manager.transaction.participant_events import GoalAction, ParticipantEvents
from somrs.task_manager.transaction.step_executor import StepExecutor
from tests.support.paths import ROOT
from verification.fault_runs.component_factory import ComponentFactory
from verification.fault_runs.draw import draw
from verification.fault_runs.result import Result, play_scenario, run
from verification.fault_runs.scenario import (
    AT_WORK,
    Cut,
    DeviceTraits,
    Disturbance,
    Fault,
    Kill,
    Partition,
    Scenario,
    Setting,
    Sight,
    Slam,
    Survey,
    TakeOver,
    TaskRequest,
    Undo,
    WorkFault,
    WorkFaultKind,
)
from verification.fault_runs.shrink import minimize, shrink_scenario
from verification.fault_runs.simulated_device import DeviceManager
from verification.fault_runs.state_diff import difference
from verification.fault_runs.violation import Property

MANY = 60
"""Enough for each outcome and each recovery to occur several times; `make fault-runs` plays thousands of the same kind."""


@pytest.fixture(scope="module")
def many_runs() -> Result:
    total = Result()
    for seed in range(MANY):
        total.add(run(seed))
    return total


@pytest.mark.long
def test_whatever_goes_wrong_the_properties_hold(many_runs: Result) -> None:
    assert not many_runs.failed
    assert many_runs.runs == MANY


@pytest.mark.parametrize("seed", [8_003_943, 4_152])
def test_work_is_not_undone_over_what_another_task_has_changed_while_this_one_waited(seed: int) -> None:
    """A robot was interrupted with a jar, or had put it down, and its task waited. Meanwhile, another task brought the jar elsewhere, and
    there the first one takes it again, and fails: it belongs back there."""
    assert violated_property(replace(draw(seed), repositories=1)) is None


@pytest.mark.parametrize("seed", [2, 5, 11, 21, 23, 28])
def test_neighbours_agree_about_objects_and_release_what_tasks_have_had(seed: int) -> None:
    """Things get their homes at other maps while tasks of third ones have them, or wait for them."""
    assert draw(seed).repositories > 1
    assert not run(seed).failed


@pytest.mark.long
def test_enough_goes_wrong_and_every_rung_of_the_ladder_is_used(many_runs: Result) -> None:
    assert sum(many_runs.troubled.values()) > MANY
    for outcome in Outcome:
        assert many_runs.troubled[outcome]
    for recovery in (
        "replaced",
        "planned anew",
        "waited for another task",
        "observations",
        "not observed",
        "undone by others",
        "undone by the participant",
        "stranded",
    ):
        assert many_runs.recoveries[recovery], f"no recovery counted as: {recovery}"


PRINTED = """
from verification.fault_runs.draw import draw
from verification.fault_runs.result import play_scenario
for seed in range(40, 47):
    scenario = draw(seed)
    scenario_run, violation = play_scenario(scenario)
    print(scenario, violation, scenario_run.log, scenario_run.reality.actions, [m.header.message_id for m in scenario_run.world.messages])
"""


def test_a_seed_is_one_run_whatever_the_hashes_of_strings_are() -> None:
    runs = {
        subprocess.run(
            [sys.executable, "-c", PRINTED], cwd=ROOT, env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, check=True
        ).stdout
        for seed in ("1", "2")
    }
    assert len(runs) == 1


@pytest.mark.parametrize(
    ("arguments", "last_line"), [(["--runs", "4", "--jobs", "2"], "4 passed, 0 failed"), (["--seed", "7"], "1 passed, 0 failed")]
)
def test_from_the_command_line(arguments: list[str], last_line: str) -> None:
    line = [sys.executable, "-m", "verification.fault_runs", *arguments]
    result = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == last_line


# Defects that are planted have to be noticed


def carrier(number: int, **options: object) -> DeviceTraits:
    return DeviceTraits(name=f"Robot{number}", services=("TransferObject",), price=number, **{"duration": 10.0, **options})  # type: ignore[arg-type]


LOOKER = DeviceTraits(name="Robot9", services=("RecognizeSituation",), price=1, duration=3.0)


def make_scenario(*faults: Fault, devices: tuple[DeviceTraits, ...] = (), wish: str = "Jar1 isOn Table2", **options: object) -> Scenario:
    return Scenario(
        seed=0,
        setting=Setting.FLAT,
        managers=1,
        tables=("Table1", "Table2", "Table3"),
        shelves=(),
        doors=(),
        things=(("Jar1", "Table1"), ("Jar2", "Table1"), ("Jar3", "Table1")),
        devices=devices or (carrier(1), carrier(2), LOOKER),
        requests=(TaskRequest(at=0.0, task_manager="tm1", effect=wish, **options),),  # type: ignore[arg-type]
        faults=faults,
    )


def violated_property(played_story: Scenario, parts: ComponentFactory | None = None) -> Property | None:
    _, violation = play_scenario(played_story, parts)
    return violation.property if violation is not None else None


class Devices(ComponentFactory):
    """Parts with other Service Managers."""

    def __init__(self, kind: type[DeviceManager]) -> None:
        self.device_manager = kind


class Managers(ComponentFactory):
    """Parts with other Task Managers."""

    def __init__(self, kind: type[TaskManager]) -> None:
        self.kind = kind

    def task_manager(self, address: str, repository: str, registry: str) -> TaskManager:
        return self.kind(address, repository=repository, registry=registry)


CUT_OFF = make_scenario(
    Cut(at=2.0, target=AT_WORK, seconds=100.0), devices=(carrier(1, duration=200.0), carrier(2, duration=200.0), LOOKER)
)


def test_a_device_that_goes_on_when_it_is_cut_off_is_noticed() -> None:
    class Careless(DeviceManager):
        def _delivery_failed(self, message: object, now: float) -> Effects:
            yield from ()

    assert violated_property(CUT_OFF) is None
    assert violated_property(CUT_OFF, Devices(Careless)) is Property.MUTUAL_EXCLUSION


def test_who_was_not_heard_to_begin_may_have_begun_late() -> None:
    """The device hears that it is to begin just before it is given up, and then is cut off again."""
    for reached in (20.0, 39.8):
        cuts = Cut(at=0.1105, target="devices/Robot1", seconds=reached), Cut(at=0.1120 + reached, target="devices/Robot1", seconds=30.0)
        assert violated_property(make_scenario(*cuts, devices=(carrier(1, duration=100.0), carrier(2), LOOKER))) is None


def test_a_device_that_works_on_terms_that_ran_out_is_noticed() -> None:
    class Generous(DeviceManager):
        def handle(self, event: Input, now: float) -> list[Effect]:
            if isinstance(event, TimerFired) and isinstance(event.timer, TermsDue):
                return []
            accepted = isinstance(event, Received) and isinstance(event.message.body, Accept)
            return super().handle(event, now - 60.0 if accepted else now)

    late = make_scenario(devices=(carrier(1, valid_for=2.0), carrier(2, mute=True)))
    assert violated_property(late) is None
    assert violated_property(late, Devices(Generous)) is Property.CONTRACT


def test_a_task_manager_that_waits_for_ever_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    dies = make_scenario(WorkFault(nth=0, kind=WorkFaultKind.DIE))
    assert violated_property(dies) is None
    monkeypatch.setattr(Participants, "silent", lambda *_: iter(()))
    monkeypatch.setattr(Participants, "overdue", lambda *_: iter(()))
    assert violated_property(dies) is Property.TERMINATION


DROPS = tuple(WorkFault(nth=number, kind=WorkFaultKind.DROP) for number in range(1, 9))
HALF_DONE = make_scenario(*DROPS, devices=(carrier(1),), wish="Jar1 isOn Table2 AND Jar2 isOn Table2")


def test_tasks_that_do_not_leave_each_other_what_they_were_promised_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    wishes = [TaskRequest(at=2.0 * number, task_manager="tm1", effect=f"Jar1 isOn Table{number}", policy=Policy.TIME) for number in (2, 3)]
    quarrel = replace(make_scenario(), requests=tuple(wishes))
    assert violated_property(quarrel) is None
    monkeypatch.setattr(Reservations, "_conflicts", lambda *_, **__: {})
    monkeypatch.setattr(TaskManagerState, "reserved_elsewhere", lambda *_: frozenset())
    assert violated_property(quarrel) is Property.MUTUAL_EXCLUSION


def test_a_task_that_changes_what_another_one_has_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first task has put its jar down, and goes on with another one, when the second task takes the jar away."""
    first, second = (
        TaskRequest(at=start_time, task_manager="tm1", effect=effect, policy=Policy.TIME)
        for start_time, effect in ((0.0, "Jar1 isOn Table2 AND Jar2 isOn Table2"), (15.0, "Jar1 isOn Table3"))
    )
    scenario = make_scenario(WorkFault(nth=1, kind=WorkFaultKind.SLOW), devices=(carrier(1), carrier(2), carrier(3), LOOKER))
    quarrel = replace(scenario, requests=(first, second))
    assert violated_property(quarrel) is None
    monkeypatch.setattr(Reservations, "_conflicts", lambda *_, **__: {})
    monkeypatch.setattr(Reservations, "_take", lambda *_: iter(()))
    monkeypatch.setattr(TaskManagerState, "reserved_elsewhere", lambda *_: frozenset())
    assert violated_property(quarrel) is Property.OWN_WORK


def test_a_task_manager_that_leaves_what_it_did_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    assert violated_property(HALF_DONE) is None
    monkeypatch.setattr(ExecutionLog, "to_undo", lambda *_: [])
    assert violated_property(HALF_DONE) is Property.PARTIAL_RESULT


def test_a_task_manager_that_does_not_wait_for_the_map_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    slips = make_scenario(WorkFault(nth=0, kind=WorkFaultKind.DROP), Cut(at=5.0, target="repository", seconds=20.0))
    assert violated_property(slips) is None

    reported = ParticipantEvents._reported

    def forgetful(
        self: ParticipantEvents, member: Member, situation: str | None, observation: Observation | None, trouble: str | None, now: float
    ) -> EffectsReturning[GoalAction]:
        return (yield from reported(self, member, None, None, trouble, now))

    monkeypatch.setattr(ParticipantEvents, "_reported", forgetful)
    assert violated_property(slips) is Property.MAP


def test_a_waiting_task_does_not_plan_while_a_late_report_is_on_its_way_to_the_map() -> None:
    picker = DeviceTraits(name="Robot5", services=("PickUp", "PutDown"), price=9, duration=12.0, drops=True)
    cuts = Cut(at=9.0, target=AT_WORK, seconds=70.0), Cut(at=78.0, target="repository", seconds=18.0)
    kill = Kill(at=31.0, target="tm1", moment=KillPoint.JOURNALED, seconds=25.0)
    scenario = make_scenario(*cuts, kill, devices=(picker,), waits=True)
    assert violated_property(replace(scenario, setting=Setting.GRIP)) is None


def test_a_task_manager_that_does_not_say_that_it_is_over_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    assert violated_property(make_scenario()) is None
    monkeypatch.setattr(Participants, "end", lambda *_: iter(()))
    assert violated_property(make_scenario()) is Property.TERMINATION
    lost_device = make_scenario(Kill(at=15.0, target="devices/Robot1", seconds=None), devices=(carrier(1), LOOKER))
    assert violated_property(lost_device) is Property.ORPHAN


@pytest.mark.parametrize("moment", [*KillPoint])
@pytest.mark.parametrize("lingers", [0.0, 30.0])
def test_a_standby_goes_on_with_the_tasks(moment: KillPoint, lingers: float) -> None:
    for target in ("tm1", "repository", "registry"):
        taken_over = make_scenario(TakeOver(at=4.0, target=target, moment=moment, lingers=lingers))
        scenario_run, violation = play_scenario(taken_over)
        assert violation is None
        assert [view.outcome for view in scenario_run.witness.outcomes.values()] == [Outcome.ACCOMPLISHED]


def test_a_standby_that_has_missed_something_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    taken_over = make_scenario(TakeOver(at=4.0, target="tm1"))
    assert violated_property(taken_over) is None
    encode = JournalCodec.encode_batch
    monkeypatch.setattr(JournalCodec, "encode_batch", staticmethod(lambda entries: encode([]) if len([*entries]) == 1 else encode(entries)))
    assert violated_property(taken_over) is Property.RESTART


def test_components_that_do_not_reach_each_other_for_a_while_go_on_afterwards() -> None:
    for sender, recipient in (("tm1", "repository"), ("tm1", "registry"), ("tm1", "devices/Robot1"), ("devices/Robot1", "registry")):
        scenario = make_scenario(Partition(at=2.0, one=sender, other=recipient, seconds=150.0))
        scenario_run, violation = play_scenario(scenario)
        assert violation is None
        assert any("cannot reach each other" in text for _, text in scenario_run.log)


@pytest.mark.parametrize("snapshot", [False, True])
def test_a_journal_that_loses_what_came_last_is_noticed(snapshot: bool) -> None:
    class Forgetful(ComponentFactory):
        def revive(self, world: World, address: str) -> None:
            if address == "tm1":
                del world._journal(address).entries[-1:]
            super().revive(world, address)

    killed = make_scenario(Kill(at=4.0, target="tm1", moment=KillPoint.JOURNALED, snapshot=snapshot))
    assert violated_property(killed) is None
    assert violated_property(killed, Forgetful()) is Property.RESTART


def test_a_service_manager_whose_journal_is_lost_is_noticed() -> None:
    class Blank(ComponentFactory):
        def revive(self, world: World, address: str) -> None:
            if address.startswith("devices/"):
                world._journal(address).entries.clear()
            super().revive(world, address)

    killed = make_scenario(Kill(at=4.0, target=AT_WORK))
    assert violated_property(killed) is None
    assert violated_property(killed, Blank()) is Property.RESTART


def test_a_task_manager_that_cannot_handle_an_input_is_noticed() -> None:
    class Brittle(TaskManager):
        def handle(self, event: Input, now: float) -> list[Effect]:
            if isinstance(event, Received) and isinstance(event.message.body, CancelTask):
                raise KeyError("task")
            return super().handle(event, now)

    assert violated_property(make_scenario(cancelled=3.0)) is None
    assert violated_property(make_scenario(cancelled=3.0), Managers(Brittle)) is Property.UNHANDLED_INPUT


# Defects in what tasks and services promise


def shut_meanwhile(service: str) -> Scenario:
    """A person shuts the door while a robot is on its way through it; another device can open it."""
    storer = DeviceTraits(name="Robot1", services=(service,), price=1, duration=20.0, undo=Undo.RESTORE)
    dearer = replace(storer, name="Robot2", price=2)
    opener = DeviceTraits(name="Robot3", services=("UnlockDoor",), price=1, duration=3.0)
    scenario = make_scenario(Slam(at=5.0, door="Door1", is_open=False), devices=(storer, dearer, opener), wish="Jar1 isOn Shelf1")
    return replace(scenario, setting=Setting.DOORS, shelves=(("Shelf1", "Door1"),), doors=(("Door1", True),))


def test_work_that_goes_on_when_its_door_is_shut_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    assert violated_property(shut_meanwhile("StoreThrough")) is None
    monkeypatch.setattr(StepExecutor, "stop_where_broken", lambda *_: iter(()))
    assert violated_property(shut_meanwhile("StoreThrough")) is Property.INVARIANT


def test_a_task_manager_that_does_not_hear_who_joins_is_noticed() -> None:
    class Deaf(TaskManager):
        def handle(self, event: Input, now: float) -> list[Effect]:
            directory = self.state.discovery.directory
            is_ready = directory is not None and directory.ready
            if is_ready and isinstance(event, Received) and isinstance(event.message.body, ServicesJoined | ServicesSubscribed):
                return []
            return super().handle(event, now)

    latecomer = make_scenario(devices=(carrier(1), carrier(2, joins=5.0), LOOKER))
    assert violated_property(latecomer) is None
    assert violated_property(latecomer, Managers(Deaf)) is Property.COPIES


def test_a_wait_that_does_not_go_on_is_noticed() -> None:
    class Sleepy(TaskManager):
        def handle(self, event: Input, now: float) -> list[Effect]:
            return [] if isinstance(event, TimerFired) and isinstance(event.timer, RetryDue) else super().handle(event, now)

    broken_robot = make_scenario(devices=(carrier(1, mended_at=100.0),), waits=True, deadline=900.0)
    scenario_run, violation = play_scenario(broken_robot)
    assert violation is None
    assert [view.outcome for view in scenario_run.witness.outcomes.values()] == [Outcome.ACCOMPLISHED]
    assert violated_property(broken_robot, Managers(Sleepy)) is Property.WAITING


def weighing(effect: str, *, weight: float = 3.0, payload: float = 5.0) -> Scenario:
    devices = (
        DeviceTraits(name="Robot1", services=("CarryParcel",), price=1, duration=10.0, payload=payload),
        DeviceTraits(name="Teller1", services=("WeighObject",), price=1, duration=1.0),
        DeviceTraits(name="Teller2", services=("ReserveTable",), price=1, duration=1.0),
    )
    return replace(make_scenario(devices=devices, wish=effect), weights=(("Jar1", weight), ("Jar2", 0.5), ("Jar3", 0.5)))


class Confused(DeviceManager):
    """Its services report other results than the device."""

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Answered) and isinstance(event.value, WorkDone) and event.value.outputs:
            situation = (event.value.situation or "").replace("Weight = 3", "Weight = 0.5").replace("Table1", "Table3")
            event = Answered(event.question, structs.replace(event.value, situation=situation))
        return super().handle(event, now)


@pytest.mark.parametrize(
    "scenario",
    [weighing("Jar1 isOn Table2", payload=1.0), weighing("Jar1 isOn ?Table AND ?Table isReservedFor Jar1")],
    ids=["a weight", "a reserved table"],
)
def test_results_that_are_confused_are_noticed(scenario: Scenario) -> None:
    assert violated_property(scenario) is None
    assert violated_property(scenario, Devices(Confused)) is Property.OUTPUTS


def test_a_program_that_failed_is_asked_again_if_no_other_can_do_its_step() -> None:
    fails = replace(weighing("Jar1 isOn ?Table AND ?Table isReservedFor Jar1"), faults=(WorkFault(nth=0, kind=WorkFaultKind.FAIL),))
    scenario_run, violation = play_scenario(fails)
    assert violation is None
    assert [view.outcome for view in scenario_run.witness.outcomes.values()] == [Outcome.ACCOMPLISHED]


def test_undoing_for_a_penalty_that_nobody_stated_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    fails = shut_meanwhile("StoreObject")
    assert violated_property(fails) is None
    cheaper = UndoingCheaper(undoing=0.0, going_on=9.0)
    monkeypatch.setattr("somrs.task_manager.transaction.goal_executor.undoing_is_cheaper", lambda *_: cheaper)
    assert violated_property(fails) is Property.OUTPUTS


SURVEYED = replace(
    make_scenario(*(Survey(at=at, place=place) for at, place in ((1.0, "Table3"), (20.0, "Table3"), (30.0, "Table2"), (40.0, "Table1")))),
    hidden=(("Hidden1", "Table3"),),
)


def test_things_that_cameras_see_come_to_the_map_once(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario_run, violation = play_scenario(SURVEYED)
    assert violation is None
    assert (contents := scenario_run.organisations.contents("")) is not None
    assert [name for name in contents.map.objects if name.startswith("Jar")] == ["Jar1", "Jar2", "Jar3", "Jar004"]
    assert scenario_run.reality.places["Jar004"] == ("isOn", "Table3")

    def recognise_nothing(sightings: Sequence[Sighting], *_: object) -> Association:
        return Association(new=[sighting.variable for sighting in sightings])

    monkeypatch.setattr("somrs.repository.reports.associate", recognise_nothing)
    assert violated_property(SURVEYED) is Property.IDENTITY


def test_older_sightings_that_replace_newer_reports_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    late = make_scenario(Disturbance(at=8.0, seconds=8.0, lost=0.0, twice=0.0, late=60.0), Sight(at=9.0, object="Jar1"))
    seeds = [replace(late, seed=seed) for seed in range(40)]
    assert {violated_property(scenario) for scenario in seeds} == {None}
    monkeypatch.setattr(Observation, "holds_from", lambda observation, now: now)
    assert Property.MAP in {violated_property(scenario) for scenario in seeds}


# How failures are told


def test_a_failing_story_is_made_as_short_as_it_can_be(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ExecutionLog, "to_undo", lambda *_: [])
    seed = next(seed for seed in range(300) if len(draw(seed).faults) >= 4 and violated_property(draw(seed)) is Property.PARTIAL_RESULT)
    short = shrink_scenario(draw(seed), lambda candidate: violated_property(candidate) is Property.PARTIAL_RESULT)
    assert violated_property(short) is Property.PARTIAL_RESULT
    assert len(short.faults) <= 1
    assert len(short.requests) == 1
    assert len(short.devices) <= 3
    assert "Robot" in short.describe()


def test_nothing_can_be_left_out_of_the_fewest() -> None:
    assert minimize(range(100), lambda items: {7, 61} <= set(items)) == [7, 61]
    assert minimize(range(100), lambda items: True) == []
    assert minimize([5], lambda items: items == [5]) == [5]


def test_what_differs_is_found_wherever_it_is() -> None:
    robot = carrier(1)
    assert difference([{"a": robot, "b": 1}], [{"a": carrier(1), "b": 1.0}]) is None
    assert (difference([{"a": robot}], [{"a": carrier(2)}]) or "").startswith(".0.'a'.")
    shared = [1]
    assert "something else" in (difference([shared, shared], [[1], [1]]) or "")
    assert difference({1, 2}, {1, 3}) is not None
    assert difference(carrier(1, undo=Undo.IMPOSSIBLE), carrier(1, undo=Undo.FAIL)) is not None
