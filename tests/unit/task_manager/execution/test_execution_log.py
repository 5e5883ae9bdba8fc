"""What services did in a task, what has to be restored when a step is to be undone, and in which order."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec import structs

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, ObjectRemoved, ValueSet
from somrs.ontology.services import ServiceKind
from somrs.planner.model.plan import Step
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.task_views import WorkView
from somrs.task_manager.execution.execution_log import ExecutionLog, Work, concerned_objects, situation_to_restore
from somrs.task_manager.execution.workflow import StepRun
from tests.support.laboratory import MAP, TRANSFER, laboratory
from tests.unit.task_manager.execution.test_participants import TransactionHarness

NOW = MAP.changed([ValueSet("DoorAB", "Open", False), ValueSet("Jar001", "Weight", 0.3)])
ON_SHELF1 = FactRemoved(Fact("isOn", ("Jar001", "Shelf1")))
MOVED, CLEANED = "Jar001 isOn Shelf2", "Jar001.Clean = TRUE"


@pytest.mark.parametrize(
    ("effect", "restored"),
    [
        ("Jar001 isOn Shelf2", "Jar001 isOn Shelf1"),
        ("Jar001 isOn Shelf1", "Jar001 isOn Shelf1"),  # it is so already, and may be left otherwise
        ("DoorAB.Open = TRUE", "DoorAB.Open = FALSE"),
        ("Jar001.Weight = 500 g", "Jar001.Weight = 0.3 kg"),
        ("Jar001.Color = Red", None),  # it had none
        ("Jar001 isOn Shelf2 AND DoorAB.Open = TRUE", "Jar001 isOn Shelf1 AND DoorAB.Open = FALSE"),
        ("connects(DoorAB, RoomA, RoomA)", "NOT connects(DoorAB, RoomA, RoomA)"),
        ("Robot1 isInside RoomB", "Robot1 isInside RoomA"),
        ("Jar001 isHeldBy Robot1", "Jar001 isOn Shelf1"),
        ("Washer1 isOn RoomA", None),  # it was nowhere
        ("Nothing isOn Shelf1", None),  # it does not fit the map any more
    ],
)
def test_what_is_restored(effect: str, restored: str | None) -> None:
    step = Step(id="s1", service_type="Any", inputs={}, effect=parse(effect))
    formula = situation_to_restore(step, NOW, laboratory())
    assert (str(formula) if formula is not None else None) == restored


def test_that_nothing_is_known_of_an_object_is_not_restored() -> None:
    lost = NOW.changed([ValueSet("Jar001", "Unknown", True)])
    step = Step(id="s1", service_type="Any", inputs={}, effect=parse("Jar001.Unknown = FALSE"))
    assert situation_to_restore(step, lost, laboratory()) is None


@pytest.mark.parametrize(
    ("effect", "provider", "objects"),
    [
        ("Jar001 isOn Shelf2", None, ("Jar001",)),
        ("Jar001 isOn Shelf1", None, ("Jar001",)),  # it is so already
        ("Jar001 isOn Shelf2 AND Jar002 isOn Shelf1", None, ("Jar001",)),
        ("Jar002 isOn Shelf2 AND Jar001 isOn Shelf2", None, ("Jar002", "Jar001")),
        ("Jar001 isOn Shelf2 AND Robot1 isInside RoomB", "Robot1", ("Jar001",)),
        ("Jar001 isOn Shelf2 AND Robot1 isInside RoomB", "Robot2", ("Jar001", "Robot1")),
        ("Robot1 isInside RoomB", "Robot1", ("Robot1",)),
        ("Nothing isOn Shelf1", None, ()),
    ],
)
def test_what_a_step_concerns(effect: str, provider: str | None, objects: tuple[str, ...]) -> None:
    step = Step(id="s1", service_type="Any", inputs={}, effect=parse(effect), provider=provider)
    assert concerned_objects(step, NOW, laboratory()) == objects


# The log


def begin(log: ExecutionLog, effect: str = MOVED, goal: GoalKind = GoalKind.TASK, kind: ServiceKind = ServiceKind.PHYSICAL) -> Work:
    """The next work on the map, which stays as it is; as if by a participant of its own."""
    inputs = {"Object": Name("Jar001")}
    number = log.work_count + 1
    run = StepRun(step=Step(f"step{number}", "TransferObject", {**inputs}, parse(effect)), label=f"l{number}", key=f"k{number}", goal=goal)
    member = TransactionHarness().invited()
    member.id = f"p{number}"
    return log.begin(run, structs.replace(TRANSFER, kind=kind), member, NOW, laboratory(), 10.0 + number)


def ended(log: ExecutionLog, state: State, effect: str = MOVED, goal: GoalKind = GoalKind.TASK) -> Work:
    work = begin(log, effect, goal)
    work.state = state
    return work


def numbers(works: list[Work]) -> list[int]:
    return [work.number for work in works]


def test_what_is_begun_is_noted_with_what_it_takes_away() -> None:
    log = ExecutionLog()
    first, second = begin(log), begin(log, CLEANED, GoalKind.UNDO)
    assert [*log] == [first, second]
    assert (first.number, first.label, first.key, first.step.id) == (1, "l1", "k1", "step1")
    assert (first.participant, first.service, first.provider, first.started_at) == ("p1", "Robot1.Work", "Robot1", 11.0)
    assert first.service_type == TRANSFER
    assert (str(first.prior_situation), first.concerned, first.goal) == ("Jar001 isOn Shelf1", ("Jar001",), GoalKind.TASK)
    assert (first.state, first.result, first.ended, first.superseded, first.supersedes) == (State.EXECUTING, None, None, False, None)
    assert (second.number, second.prior_situation, second.goal, log.work_count) == (2, None, GoalKind.UNDO, 2)
    look_work = begin(log, kind=ServiceKind.COGNITIVE)
    assert (look_work.prior_situation, look_work.concerned) == (None, ())


@pytest.mark.parametrize(
    ("state", "goals", "effect", "superseded"),
    [
        (State.FAILED, (GoalKind.TASK, GoalKind.TASK), "Jar001 isOn Platform001", True),
        (State.STOPPED, (GoalKind.TASK, GoalKind.HANDLER), "Jar001 isOn Platform001", True),
        (State.UNREACHABLE, (GoalKind.TASK, GoalKind.TASK), "Jar001 isOn Platform001", True),
        (State.COMPLETED, (GoalKind.TASK, GoalKind.TASK), "Jar001 isOn Platform001", False),
        (State.FAILED, (GoalKind.UNDO, GoalKind.TASK), "Jar001 isOn Platform001", False),
        (State.FAILED, (GoalKind.TASK, GoalKind.UNDO), "Jar001 isOn Platform001", False),
        (State.FAILED, (GoalKind.TASK, GoalKind.TASK), "Jar002 isOn Platform001", False),
    ],
)
def test_what_was_interrupted_is_taken_over_by_what_goes_on_with_it(
    state: State, goals: tuple[GoalKind, GoalKind], effect: str, superseded: bool
) -> None:
    log = ExecutionLog()
    first = ended(log, state, goal=goals[0])
    first.prior_situation = parse("Jar001 isOn Washer1")
    second = begin(log, effect, goals[1])
    assert (first.superseded, second.supersedes) == (superseded, 1 if superseded else None)
    assert (str(second.prior_situation) == "Jar001 isOn Washer1") is superseded
    log.drop(second)
    assert ([*log], first.superseded, log.work_count) == ([first], False, 2)


@pytest.mark.parametrize(("effect", "superseded"), [("Jar002 isOn Platform001", True), (CLEANED, True), (MOVED, False)])
def test_only_what_was_done_last_to_the_same_objects_is_taken_over(effect: str, superseded: bool) -> None:
    log = ExecutionLog()
    first = ended(log, State.FAILED)
    ended(log, State.COMPLETED, effect, GoalKind.UNDO if effect == MOVED else GoalKind.TASK)
    begin(log)
    assert first.superseded is superseded


def test_work_is_found_by_its_number_and_by_who_did_it() -> None:
    log, transaction = ExecutionLog(), TransactionHarness()
    works = [begin(log) for _ in range(3)]
    member = transaction.invited()
    assert log.work_of(member) is None
    works[0].participant = works[1].participant = member.id
    assert log.work_of(member) is works[1]
    assert [log.work_by_number(number) for number in (1, 2, 3)] == works


@pytest.mark.parametrize(
    ("state", "to_undo", "interrupted"),
    [
        (State.EXECUTING, False, False),
        (State.COMPLETED, True, False),
        (State.FAILED, True, True),
        (State.STOPPED, True, True),
        (State.UNREACHABLE, True, True),
        (State.COMPENSATED, False, False),
        (State.STRANDED, False, False),
    ],
)
def test_what_is_to_be_undone(state: State, to_undo: bool, interrupted: bool) -> None:
    log = ExecutionLog()
    ended(log, state)
    assert (log.to_undo(), log.interrupted()) == ([*log] if to_undo else [], [*log] if interrupted else [])
    for change in ({"goal": GoalKind.UNDO}, {"superseded": True}, {"prior_situation": None}):
        changed: dict[str, Any] = {**change}
        other_log = ExecutionLog(works=[structs.replace(log.works[0], **changed)])
        assert (other_log.to_undo(), other_log.interrupted()) == ([], [])


def test_last_things_are_undone_first() -> None:
    log = ExecutionLog()
    for state, jar in ((State.FAILED, "Jar001"), (State.COMPLETED, "Jar002"), (State.STOPPED, "Jar001 isOn Shelf2 AND Jar002")):
        ended(log, state, f"{jar} isOn Shelf2")
    assert (numbers(log.to_undo()), numbers(log.interrupted())) == ([3, 2, 1], [3, 1])


@pytest.mark.parametrize(
    ("kind", "goal", "superseded", "matters"),
    [
        (ServiceKind.PHYSICAL, GoalKind.TASK, False, True),
        (ServiceKind.PHYSICAL, GoalKind.HANDLER, False, True),
        (ServiceKind.COGNITIVE, GoalKind.TASK, False, False),
        (ServiceKind.PHYSICAL, GoalKind.TASK, True, False),
        (ServiceKind.PHYSICAL, GoalKind.UNDO, False, False),
    ],
)
def test_the_client_has_to_know_of_what_changed_things(kind: ServiceKind, goal: GoalKind, superseded: bool, matters: bool) -> None:
    work = begin(ExecutionLog(), goal=goal, kind=kind)
    work.superseded = superseded
    assert work.matters is matters


def test_work_ends_once() -> None:
    work = begin(ExecutionLog())
    work.end(State.FAILED, 20.0)
    work.end(State.STRANDED, 30.0)
    assert (work.result, work.ended) == (State.FAILED, 20.0)


@pytest.mark.parametrize(
    ("situation", "is_described"), [("Jar001 isOn Shelf1 AND Robot1 isInside RoomA", True), ("Robot1 isInside RoomA", False)]
)
def test_a_situation_tells_of_work_when_it_speaks_of_what_that_changes(situation: str, is_described: bool) -> None:
    assert begin(ExecutionLog()).is_described_by(parse(situation)) is is_described


def test_work_as_clients_see_it() -> None:
    work = begin(ExecutionLog(), goal=GoalKind.HANDLER)
    work.end(State.FAILED, 20.0)
    work.state, work.situation, work.note = State.COMPENSATED, MOVED, "stuck"
    assert work.view() == WorkView(
        step="l1",
        service="Robot1.Work",
        service_type="TransferObject",
        inputs={"Object": "Jar001"},
        began=11.0,
        state=State.COMPENSATED,
        situation=MOVED,
        before="Jar001 isOn Shelf1",
        note="stuck",
        result=State.FAILED,
        ended=20.0,
        goal=GoalKind.HANDLER,
    )
    assert begin(ExecutionLog(), CLEANED).view().before is None


@pytest.mark.parametrize(
    ("state", "situation", "words"),
    [
        (State.COMPENSATED, MOVED, "was undone: Jar001 isOn Shelf1"),
        (State.STRANDED, MOVED, "could not be undone, and it left Jar001 isOn Shelf2"),
        (State.COMPLETED, MOVED, "was done: Jar001 isOn Shelf2"),
        (State.FAILED, MOVED, "was interrupted: Jar001 isOn Shelf2"),
        (State.FAILED, None, "was interrupted: stuck"),
    ],
)
def test_what_became_of_work_in_words(state: State, situation: str | None, words: str) -> None:
    work = begin(ExecutionLog())
    work.state, work.situation, work.note = state, situation, "stuck"
    assert work.in_words(NOW, laboratory()) == f"TransferObject by Robot1.Work {words}"


def test_of_work_that_changed_nothing_nothing_was_undone() -> None:
    work = begin(ExecutionLog())
    work.state, work.untouched = State.COMPENSATED, True
    assert work.in_words(NOW, laboratory()) == "TransferObject by Robot1.Work changed nothing: Jar001 isOn Shelf1"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ((ON_SHELF1, ValueSet("Jar001", "Unknown", True)), "nothing is known of Jar001"),
        ((ON_SHELF1, FactAdded(Fact("isHeldBy", ("Jar001", "Robot1")))), "now the map says Jar001 isHeldBy Robot1"),
        ((ObjectRemoved("Jar001"),), "nothing is known of Jar001"),
    ],
)
def test_of_what_a_service_left_without_a_word_the_client_hears_what_the_map_has(changes: tuple[Change, ...], words: str) -> None:
    work = begin(ExecutionLog())
    work.state = State.STRANDED
    assert work.in_words(NOW.changed(changes), laboratory()).endswith(f"could not be undone, and it did not say what it left: {words}")


def test_what_another_task_has_changed_since_is_not_undone_and_told() -> None:
    log = ExecutionLog()
    overtaken, of_another_thing, after = ended(log, State.COMPLETED), ended(log, State.COMPLETED, "Jar002 isOn Shelf2"), begin(log)
    overtaken.situation = MOVED
    log.overtake(["Jar001"])
    after.state = State.COMPLETED
    assert numbers(log.to_undo()) == numbers([after, of_another_thing])
    assert overtaken.in_words(NOW, laboratory()).endswith("was done: Jar001 isOn Shelf2, which another task has changed since")


def test_what_a_task_reports_is_its_own_work_only_if_it_has_worked_on_it() -> None:
    """A look of a task says what its own robot left, or what it found when it began."""
    log = ExecutionLog()
    begin(log, kind=ServiceKind.COGNITIVE)
    assert not log.has_work_on(MOVED)
    begin(log)
    assert log.has_work_on("Jar001 isHeldBy Robot1")
    assert not log.has_work_on("Jar002 isHeldBy Robot1")
    assert log.has_work_on("Jar002 is"), "what it says cannot be read"
