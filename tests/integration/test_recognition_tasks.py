"""Tasks that ask what is so: cognitive services observe it, the map is updated, and the client learns who saw what, and when."""

from __future__ import annotations

from typing import Any

from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.protocol.messages.findings import Findings
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Order, ServiceFailed, WorkDone
from tests.integration.test_knowing_before_acting import WEIGH, KnowingSystem, finds_nothing, work_of
from tests.support.virtual_system import Robot

SCAN = ServiceType(
    name="ScanPlace",
    kind=ServiceKind.COGNITIVE,
    inputs=(Parameter(name="Place", type="Support"),),
    outputs=(Parameter(name="Thing", type="Graspable"),),
    effect="?Thing isOn ?Place",
)


def sees(order: Order) -> Work:
    """Where things really are: Jar002 was moved, and nobody said so."""
    places = {"Jar001": "Cupboard002", "Jar002": "Cupboard002"}
    thing = order.inputs["Object"]
    if thing in places:
        yield 3.0, WorkDone(situation=f"{thing} isOn {places[thing]} AND {thing}.Unknown = FALSE")
    else:
        yield 3.0, ServiceFailed(f"{thing} is nowhere to be seen")


def findings_of(system: KnowingSystem, question: str, **options: Any) -> Findings:
    (view,) = system.finish(system.submit(question, recognise=True, **options))
    assert view.outcome is Outcome.ACCOMPLISHED, view.reasons
    assert view.recognise
    assert view.findings is not None
    return view.findings


def test_the_answer_says_what_is_there_who_saw_it_and_when() -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20))
    system.observe("Camera9", sees)
    answer = findings_of(system, "?It: Jar isOn Cupboard002")
    (finding,) = answer.answers
    assert (finding.bindings, finding.situation) == ({"It": "Jar001"}, "Jar001 isOn Cupboard002")
    (sighting,) = finding.sightings
    assert sighting.service == "Camera9.RecognizeSituation"
    assert sighting.at == system.world.now or 0 < system.world.now - sighting.at < 10
    assert (answer.observations, answer.unseen, answer.more) == (1, (), False)


def test_the_map_is_updated_by_what_is_seen() -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20))
    system.observe("Camera9", sees)
    answer = findings_of(system, "Jar002 isOn ?Where")
    assert [finding.bindings for finding in answer.answers] == [{"Where": "Cupboard002"}]
    assert system.map.has_fact("isOn", ("Jar002", "Cupboard002"))
    denied = findings_of(system, "Jar002 isOn Cupboard001")
    assert (denied.answers, denied.observations) == ((), 1)


def test_one_service_may_find_all_that_is_there() -> None:
    def scans(order: Order) -> Work:
        yield 3.0, WorkDone(situation="Jar001 isOn Cupboard002 AND Jar002 isOn Cupboard002")

    system = KnowingSystem(Robot("Robot1", 4, 20))
    system.observe("Camera9", sees)
    system.observe("Camera10", scans, SCAN)
    answer = findings_of(system, "?It: Jar isOn Cupboard002")
    assert {finding.bindings["It"] for finding in answer.answers} == {"Jar001", "Jar002"}
    assert {finding.sightings[0].service for finding in answer.answers} == {"Camera10.ScanPlace"}
    assert answer.observations == 1


def test_values_are_found_out_too() -> None:
    def weighs(order: Order) -> Work:
        yield 2.0, WorkDone(situation=f"{order.inputs['Object']}.Weight = 0.4 kg", outputs={"Weight": 0.4})

    system = KnowingSystem()
    system.observe("Scale1", weighs, WEIGH)
    answer = findings_of(system, "Jar001.Weight = ?Weight")
    assert [finding.bindings for finding in answer.answers] == [{"Weight": "0.4 kg"}]


def test_who_does_not_find_it_is_named_and_others_are_asked() -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20))
    system.observe("Camera9", finds_nothing, price=0.5)
    system.observe("Camera10", sees, price=9)
    answer = findings_of(system, "Jar001 isOn ?Where")
    assert [(entry.service, entry.inputs) for entry in answer.unseen] == [("Camera9.RecognizeSituation", {"Object": "Jar001"})]
    assert "nowhere to be seen" in answer.unseen[0].reason
    assert answer.answers[0].sightings[0].service == "Camera10.RecognizeSituation"


def test_objects_that_nobody_finds_do_not_spoil_the_answer_about_the_others() -> None:
    system = KnowingSystem()
    camera = system.observe("Camera9", sees)
    system.forget("Tin001")
    system.forget("LostJar")
    answer = findings_of(system, "?It: Jar isOn Cupboard002")
    assert [finding.bindings for finding in answer.answers if finding.sightings] == [{"It": "Jar001"}]
    assert {entry.inputs["Object"] for entry in answer.unseen} == {"Tin001", "LostJar"}
    assert len(camera.orders) == 3, "each is looked for once"


def test_a_question_that_nobody_can_answer_fails_and_says_why() -> None:
    system = KnowingSystem()
    (view,) = system.finish(system.submit("Jar001 isOn ?Where", recognise=True, waits=False))
    assert view.outcome is Outcome.FAILED
    assert "nobody can look: no device offers RecognizeSituation" in view.explanation
    assert view.findings is not None
    assert view.findings.answers[0].sightings == (), "the map says so, and nobody has looked"
    system.observe("Camera9", finds_nothing)
    (view,) = system.finish(system.submit("Jar001 isOn ?Where", recognise=True))
    assert view.outcome is Outcome.FAILED
    assert "Camera9 looked, and found nothing" in view.explanation


def test_who_could_look_on_a_condition_is_asked_once_because_nothing_is_moved_for_a_question() -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20))
    scale = system.observe("Camera9", sees)
    scale.refuses, scale.needs = "it is not before the camera", "Jar001 isOn Platform001"
    (view,) = system.finish(system.submit("Jar001 isOn ?Where", recognise=True, waits=False))
    assert view.outcome is Outcome.FAILED
    assert "it is not before the camera" in view.explanation


def test_who_looks_hinders_nobody() -> None:
    system = KnowingSystem(Robot("Robot1", 4, 200))
    system.observe("Camera9", sees)
    carrying = system.submit("Jar001 isOn Platform001")
    system.world.run(5)
    assert findings_of(system, "Jar002 isOn ?Where").observations == 1
    (view,) = system.finish(carrying)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert work_of(view) == ["Robot1.TransferObject: Completed"]


def test_a_question_is_previewed_like_a_goal_and_kept_in_the_record() -> None:
    system = KnowingSystem()
    system.observe("Camera9", sees)
    preview = system.ask(Preview(effect="Jar001 isOn ?Where", quotes=True, recognise=True))
    assert isinstance(preview, Previewed)
    assert [(step.service_type, step.learns) for step in preview.steps] == [("RecognizeSituation", ("Jar001",))]
    assert preview.price == 1.0
    answer = findings_of(system, "Jar001 isOn ?Where")
    record = system.task_record()
    assert (record.recognise, record.findings) == (True, answer)


def test_a_question_survives_a_restart_of_the_task_manager() -> None:
    system = KnowingSystem()
    system.observe("Camera9", sees)
    task = system.submit("Jar001 isOn ?Where", recognise=True)
    system.world.run(1.5)
    system.restart_manager(snapshot=True)
    (view,) = system.finish(task)
    assert view.findings is not None
    assert view.findings.answers[0].sightings
