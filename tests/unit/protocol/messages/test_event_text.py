"""What happens to a task, said in sentences, and what it is in the task's life."""

from __future__ import annotations

import typing
from collections.abc import Iterator

import pytest

from somrs.protocol.messages import events, waits
from somrs.protocol.messages.event_kinds import EventKind, kind_of
from somrs.protocol.messages.event_text import failure_text, join_reasons, loss_text, sentence, waiting_text
from somrs.protocol.messages.events import Event, ServiceFailure
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.goal_kinds import GoalKind

S, TWO = "Robot1.Carry", ("no", "never")

HINDRANCES = tuple(
    waits.Hindrance(subject=f"Robot{number}.Carry", reason=reason, since=0.0)
    for number, reason in enumerate(("no oil", "it charges", "no oil"), 1)
)

FAILURES: list[tuple[ServiceFailure, str]] = [
    (events.NotBegun(service=S, description="no oil"), "did not begin: no oil"),
    (events.StepFailed(service=S, description="no oil", situation="A isOn B"), "failed: no oil"),
    (events.ServiceFaulted(service=S, text="no oil"), "no oil"),
    (events.ContractForgotten(service=S), "has forgotten its contract"),
    (events.ServiceSilent(service=S), "is silent; asking for its state"),
    (events.ServiceOverdue(service=S), "takes far longer than its terms say; stopping it"),
    (events.ServiceOverdue(service=S, undoing=True), "takes far too long to undo its work; releasing it"),
    (events.InvariantBroken(service=S, invariant="A isOn B"), "is being stopped: A isOn B does not hold any more"),
    (events.ServiceLost(service=S), "did not come to an end; nothing is known of what it left"),
    (events.ServiceLost(service=S, stopping=True), "did not report that it stopped; nothing is known of what it left"),
    (events.ServiceLost(service=S, silent=True), "fell silent while it worked; nothing is known of what it left"),
    (events.ServiceLost(service=S, silent=True, stopping=True), "fell silent while it worked; nothing is known of what it left"),
    (events.ReportRejected(service=S, problems=TWO), "the Repository rejects what it reports: no; never"),
    (events.CompensationFailed(service=S, description="no oil"), "could not undo it: no oil"),
]

SENTENCES: list[tuple[Event, str]] = [
    (events.TaskStated(effect="A isOn B"), "task: A isOn B"),
    (events.Planned(steps=0), "nothing to do: it is so already"),
    (
        events.Planned(steps=0, doubts=("Lamp1 cannot be reached: no answer",)),
        "nothing to do: it is so already; but Lamp1 cannot be reached: no answer, so this may be old",
    ),
    (events.Planned(steps=1), "planned: 1 step"),
    (events.Planned(steps=2), "planned: 2 steps"),
    (waits.WaitsForTasks(tasks={"t1": "A isOn B"}, objects=("A", "B")), "waiting for task t1 (A isOn B), which has reserved A, B"),
    (
        waits.WaitsForTasks.on(
            (
                waits.Holder(task="urn:uuid:1a2b3c4d-1111-5222-8333-444455556666", goal="A isOn B", objects=("A",)),
                waits.Holder(task="t2", goal="C isOn D", objects=("C", "D"), waiting=True),
            )
        ),
        "waiting for task 1a2b3c4d (A isOn B), which has reserved A, and for task t2 (C isOn D), which waits for C, D too and comes first",
    ),
    (
        waits.WaitsToRetry(hindrances=HINDRANCES, since=0.0, next_attempt=2.0, pause=2.0),
        "waiting to try again: Robot1.Carry, Robot3.Carry: no oil; Robot2.Carry: it charges",
    ),
    (
        waits.WaitsToRetry(hindrances=HINDRANCES[:1], since=0.0, next_attempt=6.0, pause=4.0, attempts=2),
        "waiting to try again (2 attempts): Robot1.Carry: no oil",
    ),
    (waits.WaitOver(attempts=1, seconds=2.4), "continuing after 2 s and 1 attempt"),
    (waits.WaitOver(attempts=3, seconds=14.0), "continuing after 14 s and 3 attempts"),
    (waits.GoesOn(), "continuing: the objects it waited for are free"),
    (waits.WaitsForRepository(since=1.0), "waiting for an answer: the Repository does not answer"),
    (
        waits.WaitsForRepository(since=1.0, map="Barn", objects=("Barn:A", "B")),
        "waiting for an answer about Barn:A, B: the Repository of Barn does not answer",
    ),
    (waits.RepositoryAnswered(seconds=7.6, map="Barn"), "continuing: the Repository of Barn has answered after 8 s"),
    (events.Replanned(reasons=TWO), "replanning: no; never"),
    (events.TriedOnceMore(services=("R.A", "R.B")), "there is no plan without R.A, R.B; they may try again"),
    (events.Paused(author="Ada"), "paused by Ada"),
    (events.Resumed(author="Ben"), "going on, says Ben"),
    (events.Stopping(reason="enough"), "stopping: enough"),
    (events.TaskEnded(outcome=Outcome.ACCOMPLISHED), "accomplished"),
    (events.TaskEnded(outcome=Outcome.FAILED, reasons=TWO), "failed: no; never"),
    (events.ServicesAsked(services=("R.A", "R.B")), "asking R.A, R.B"),
    (
        events.UndoingCheaper(undoing=15.0, going_on=100.0),
        "undoing what the failure left is estimated at 15.00, going on from there at 100.00: undoing it first",
    ),
    (
        events.PlansCompared(
            plans=(
                events.ComparedPlan(service_types=("Open", "Carry"), price=4.0, currency="EUR", seconds=29.6),
                events.ComparedPlan(service_types=("Throw",), currency="EUR"),
            ),
            chosen=0,
        ),
        "compared 2 plans: Open, Carry for 4 EUR, in 30 s (chosen); Throw: not every step has terms",
    ),
    (events.TermsOffered(service=S, price=4.0, currency="EUR", duration=29.6), "Robot1.Carry offers 4 EUR, 30 s"),
    (events.ServiceRefused(service=S, reason="too heavy"), "Robot1.Carry refuses: too heavy"),
    (
        events.TermsOffered(service=S, price=4.0, currency="EUR", duration=30.0, condition="Door1.Open = TRUE"),
        "Robot1.Carry offers 4 EUR, 30 s, if Door1.Open = TRUE",
    ),
    (
        events.ServiceRefused(service=S, reason="no way", condition="Door1.Open = TRUE"),
        "Robot1.Carry refuses: no way; it would do it if Door1.Open = TRUE",
    ),
    (
        events.ConditionsAdopted(conditions={S: "Door1.Open = TRUE", "R.A": "B.C = 1"}),
        "replanning with what services need: Door1.Open = TRUE (Robot1.Carry), B.C = 1 (R.A)",
    ),
    (events.ServiceRefused(service=S, reason="it charges", not_now=True), "Robot1.Carry refuses for now: it charges"),
    (events.ServiceChosen(service=S, price=4.5, currency="PLN", duration=29.4), "Robot1.Carry does it for 4.5 PLN, in 29 s"),
    (waits.WaitsForDevice(device="Robot1"), "waiting for its turn at Robot1"),
    (events.StepStarted(service=S), "Robot1.Carry starts"),
    (events.ProgressNoted(service=S, note="half way"), "Robot1.Carry: half way"),
    (events.StepCompleted(service=S, situation="A isOn B"), "Robot1.Carry completed: A isOn B"),
    (events.StepStopped(service=S), "Robot1.Carry stopped"),
    (
        events.ReportSuperseded(service=S, parts=("A isOn B", "C isOn D")),
        "Robot1.Carry reports old news, and the map keeps what is newer: A isOn B; C isOn D",
    ),
    (events.ObjectsDiscovered(service=S, objects=("Jar007", "Jar008")), "Robot1.Carry discovered Jar007, Jar008, new on the map"),
    (events.FoundSo(), "the effect of the step holds after all"),
    (events.FoundOut(service="a", situation="Jar1 isOn Shelf1"), "a found out: Jar1 isOn Shelf1"),
    (events.FoundOut(service="a", outputs={"Weight": "2.5"}), "a found out: Weight = 2.5"),
    (
        events.Planned(steps=3, foreseen=2),
        "planned: 3 steps, of which 2 depend on what the others find out",
    ),
    (events.ServiceFaulted(service=S, text="no oil"), "Robot1.Carry: no oil"),
    (events.ReportRejected(service=S, problems=TWO), "the Repository rejects what Robot1.Carry reports: no; never"),
    (events.NotBegun(service=S, description="no oil"), "Robot1.Carry did not begin: no oil"),
    (events.CompensationFailed(service=S, description="no oil"), "Robot1.Carry could not undo it: no oil"),
    (events.ServiceReplaced(), "replacing the service"),
    (events.MayTryAgain(services=("R.A", "R.B")), "no other service can do it: R.A, R.B may try again"),
    (events.HandlerBegun(effect="A isOn B"), "the step failed; its handler is to achieve: A isOn B"),
    (events.GoalFailed(goal=GoalKind.LOOK, step="s1", reasons=TWO), "look for s1: no; never"),
    (events.LookBegun(service_type="Look", object="A"), "Look: a service is to observe A"),
    (events.LookFound(situation="A isOn B"), "observed: A isOn B"),
    (events.LookFound(), "observed: nothing"),
    (events.NobodyLooks(object="A"), "no service can observe A: nothing is assumed about it"),
    (events.KnownOtherwise(object="A", problems=TWO), "the map has newer facts about A: no; never"),
    (events.FailuresUndone(reasons=TWO), "no; never; undoing what failed"),
    (events.UndoneByHandler(effect="A isOn B"), "undoing it by its handler: A isOn B"),
    (events.UndoneByService(service=S, situation="A isOn B"), "Robot1.Carry is to restore A isOn B"),
    (events.UndoneByOthers(situation="A isOn B"), "other services are to restore A isOn B"),
    (events.Compensated(service=S, situation="A isOn B"), "Robot1.Carry compensated: A isOn B"),
    (events.WorkUndone(), "is undone"),
    (events.WorkStranded(taken=True, reason="no"), "is not undone: another task has reserved the objects"),
    (
        events.WorkStranded(taken=True, holders=(waits.Holder(task="t1", goal="A isOn B", objects=("A",)),)),
        "is not undone: task t1 (A isOn B) has reserved A",
    ),
    (events.WorkStranded(reason="no"), "could not be undone: no"),
    (events.WorkStranded(), "could not be undone: no service restores it"),
]


def test_every_event_has_its_sentence() -> None:
    assert [sentence(event) for event, _ in SENTENCES] == [text for _, text in SENTENCES]
    failed = [(event, text) for event, text in FAILURES if not isinstance(event, events.ServiceFaulted | events.ReportRejected)]
    assert [sentence(event) for event, _ in failed] == [f"{S} {text}" for _, text in failed]
    assert {type(event) for event, _ in (*SENTENCES, *FAILURES)} == {*typing.get_args(Event)}


def test_what_went_wrong_is_said_where_the_service_is_named_already() -> None:
    assert [failure_text(event) for event, _ in FAILURES] == [text for _, text in FAILURES]
    assert {type(event) for event, _ in FAILURES} == {*typing.get_args(ServiceFailure)}
    assert [loss_text(events.ServiceLost(service=S, silent=silent)) for silent in (True, False)] == [
        "fell silent while it worked",
        "did not come to an end",
    ]


def test_reasons_are_on_one_line_and_who_is_waited_for_is_named() -> None:
    assert (join_reasons(()), join_reasons(("a",)), join_reasons(iter(("a", "b")))) == ("", "a", "a; b")
    assert waiting_text(waits.WaitsForTasks(tasks={"t": "g"}, objects=("A",))) == "waiting for task t (g), which has reserved A"


def test_what_is_no_event_has_no_sentence() -> None:
    with pytest.raises(AssertionError, match=r"^there is no sentence for str$"):
        sentence("nothing")  # type: ignore[arg-type]  # that is what is tested


def of_kind(kind: EventKind) -> Iterator[str]:
    examples = {type(event): event for event, _ in (*SENTENCES, *FAILURES)}
    return (event_type.__name__ for event_type, event in examples.items() if kind_of(event) is kind)


def test_what_an_event_is_in_the_life_of_its_task() -> None:
    assert {kind: {*of_kind(kind)} for kind in EventKind} == {
        EventKind.NEWS: {
            "TaskStated", "Planned", "PlansCompared", "ServicesAsked", "TermsOffered", "ServiceRefused", "ServiceChosen", "StepStarted",
            "ProgressNoted", "StepCompleted", "StepStopped", "FoundSo", "MayTryAgain", "Stopping", "ReportSuperseded",
        },
        EventKind.SETBACK: {event_type.__name__ for event_type in typing.get_args(ServiceFailure)} | {"GoalFailed", "WorkStranded"},
        EventKind.HANDLER: {"HandlerBegun"},
        EventKind.REPLACE: {"ServiceReplaced"},
        EventKind.REPLAN: {"ConditionsAdopted", "Replanned", "TriedOnceMore"},
        EventKind.WAIT: {
            "WaitsForTasks", "WaitsToRetry", "WaitOver", "GoesOn", "WaitsForDevice", "WaitsForRepository", "RepositoryAnswered", "Paused",
            "Resumed",
        },
        EventKind.LOOK: {"FoundOut", "LookBegun", "LookFound", "NobodyLooks", "KnownOtherwise", "ObjectsDiscovered"},
        EventKind.UNDO: {
            "UndoingCheaper", "FailuresUndone", "UndoneByHandler", "UndoneByService", "UndoneByOthers", "Compensated", "WorkUndone",
        },
        EventKind.END: {"TaskEnded"},
    }  # fmt: skip
