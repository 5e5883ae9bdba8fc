"""How the window tells the story of a task: each failure, which rung of the ladder answered it, and what came of that."""

from __future__ import annotations

from msgspec import structs

from somrs.client.task_report import view
from somrs.gui.pages.task import observed_objects
from somrs.gui.pages.task_bids import bid_status
from somrs.gui.pages.task_cancel_dialog import cancel_consequences
from somrs.gui.pages.task_chapters import Chapter, failures, summary
from somrs.gui.pages.task_story import story
from somrs.gui.pages.task_text import gist
from somrs.ontology.services import Handler, Occasion
from somrs.protocol.messages.submission import CancelTask
from tests.integration.test_recovery import BOTH_JARS, GOAL, goes_silent, holding, patrolled_system, restore_object, run_until_step_done
from tests.support.virtual_system import Robot, VirtualSystem, drop_object


def finished_story(system: VirtualSystem) -> list[Chapter]:
    """The story of the only task, which is over."""
    record = system.task_record()
    return story(view(record), record.events)


def rungs(chapter: Chapter) -> list[str]:
    return [line.recovery for line in chapter.lines if line.recovery]


def test_a_task_without_failures_is_stated_planned_done_and_over() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    system.finish(system.submit(GOAL))
    chapters = finished_story(system)
    assert [chapter.title for chapter in chapters] == ["client submitted the task", "Planned: 1 step", "step1 is done", "Accomplished"]
    assert summary(chapters) == "no failures"


def test_another_takes_over_and_does_it() -> None:
    system = VirtualSystem(Robot("Robot1", 1, 10, works=drop_object), Robot("Robot2", 25, 60))
    system.finish(system.submit(GOAL))
    (failure,) = failures(finished_story(system))
    assert (failure.title, failure.text, failure.situation) == (
        "Failure 1: Robot1.TransferObject",
        "failed: it slipped",
        "Jar002 isOn Floor001",
    )
    assert rungs(failure) == ["Replacement"]
    assert (failure.result, failure.result_tone) == ("Robot2.TransferObject completed the step: Jar002 isOn Platform001", "good")
    assert failure.ended is not None
    assert 59 < failure.ended - failure.at < 62


def test_what_was_laid_down_goes_before_the_ladder_and_its_plan_is_not_the_tasks() -> None:
    tidy = Handler(on=Occasion.FAILURE, service_type="TransferObject", when="?Object isOn Floor001", effect="?Object isOn Cupboard001")
    system = VirtualSystem(Robot("Robot1", 1, 10, works=drop_object), Robot("Robot2", 25, 60))
    system.finish(system.submit(GOAL, handlers=(tidy,)))
    chapters = finished_story(system)
    (failure,) = failures(chapters)
    assert rungs(failure) == ["Handler", "Replacement"]
    assert "Robot2.TransferObject: Jar002 isOn Cupboard001" in [line.text for line in failure.lines]
    assert [chapter.title for chapter in chapters].count("Planned: 1 step") == 1
    assert summary(chapters) == "1 failure; recovery: handler, replacement"


def test_silence_is_one_failure_from_the_first_sign_to_what_was_seen() -> None:
    system = patrolled_system("Platform001", Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    task = system.submit(GOAL)
    goes_silent(system, task)
    system.finish(task)
    (failure,) = failures(finished_story(system))
    assert failure.text == "is silent; asking for its state"
    assert failure.step == "step1"
    assert rungs(failure) == ["Observation"]
    assert failure.result == "The step was completed after all."


def test_questions_about_what_is_looked_at_are_the_tasks() -> None:
    system = patrolled_system("Floor001", Robot("Robot1", 10, 600), Robot("Robot2", 25, 60))
    task = system.submit(GOAL)
    goes_silent(system, task)
    assert observed_objects(system.view(task)) == frozenset()
    assert system.world.run(600, lambda: any(work.step.startswith("look") for work in system.view(task).work))
    assert observed_objects(system.view(task)) == {"Jar002"}
    system.finish(task)
    assert observed_objects(system.view(task)) == frozenset()


def test_a_new_plan_ends_the_failure_that_it_is_for() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, works=holding("Robot1"), undoes=restore_object), Robot("Robot2", 25, 60))
    system.finish(system.submit(GOAL))
    (failure,) = failures(finished_story(system))
    assert rungs(failure) == ["New plan", "Compensation"]
    assert failure.result == "The task continues with a plan of 1 step."


def test_undoing_because_the_task_ends_is_no_rung_of_a_failure() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, works=holding("Robot1")))
    system.finish(system.submit(GOAL))
    chapters = finished_story(system)
    (failure,) = failures(chapters)
    assert failure.result == "Recovery failed: the task was given up."
    (undoing,) = [chapter for chapter in chapters if chapter.title == "Compensation"]
    assert undoing.lines[0].text == "step1: other services are to restore Jar002 isOn Cupboard001"
    assert undoing.tone == "bad"
    assert chapters[-1].title == "Failed"
    assert any("could not be undone, and it left Jar002 isHeldBy Robot1" in line.text for line in chapters[-1].lines)


def test_before_a_task_is_cancelled_it_is_said_what_will_be_undone() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, undoes=restore_object))
    task = system.submit(BOTH_JARS)
    assert cancel_consequences(system.view(task)) == ["Nothing has been done yet, so nothing needs to be undone."]
    run_until_step_done(system, task)
    sentences = cancel_consequences(system.view(task))
    assert sentences[0].startswith("Robot1.TransferObject is stopped (step2, ")
    assert sentences[-1].startswith("What Robot1.TransferObject did is undone: Jar001 isOn Cupboard002")
    system.ask(CancelTask(task=task))
    system.finish(task)
    assert system.map.has_fact("isOn", ("Jar001", "Cupboard002"))
    assert [chapter.title for chapter in finished_story(system)][-2:] == ["Compensation", "Cancelled"]


def test_figures_are_left_out_where_more_is_said_than_they_say() -> None:
    figures = "Jar002.PositionX = 7.9 AND Jar002.PositionY = 2.56 AND Jar002.PositionZ = 0.3"
    robot = "Robot2.PositionX = 7.3 AND Robot2.PositionY = 2.9 AND Robot2.RotationZ = -0.4"
    assert gist(f"Jar002 isOn Platform001 AND {figures} AND {robot}") == "Jar002 isOn Platform001"
    assert gist(f"it left {figures} AND {robot}") == "it left Jar002 at 7.9, 2.56 m"


def test_what_became_of_each_bid_is_known_without_reading_why() -> None:
    broken = Robot("Robot4", 5, 60, refuses="the gripper is stuck", not_now=True)
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 25, 60), Robot("Robot3", 5, 60, refuses="it rains"), broken)
    system.finish(system.submit(GOAL))
    record = system.task_record()
    steps = [contract.step for contract in record.contracts if contract.accepted]
    bids = {contract.service: bid_status(contract, steps).text for contract in record.contracts}
    assert bids == {
        "Robot1.TransferObject": "Chosen, done",
        "Robot2.TransferObject": "Not chosen",
        "Robot3.TransferObject": "Refused",
        "Robot4.TransferObject": "Refused for now",
    }
    old_contracts = [structs.replace(contract, refused=None) for contract in record.contracts if contract.refused]
    assert [bid_status(contract, steps).text for contract in old_contracts] == ["Released", "Released"]
