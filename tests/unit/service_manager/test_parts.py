"""The parts of a Service Manager by themselves: its calendar, the jobs that it knows, and what it reports to the Repository."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from somrs.kernel.component import Effect, Send, SetTimer
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault, State
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.service_manager.participant import job as jobs_module
from somrs.service_manager.participant.calendar import Commitment, first_free_time, resolve_overlaps
from somrs.service_manager.participant.job import Job, Jobs, failure, interruption
from somrs.service_manager.participant.map_reports import PATIENCE, MapReport, MapReports
from somrs.service_manager.participant.messaging import CUT_OFF, REPORT_TIME, send_message
from somrs.service_manager.participant.timers import Activity, HeartbeatDue, ReportDue, StartDue, WorkWanted
from tests.support.effects import run_effects

ADDRESS, REPOSITORY = "http://here/washer", "http://here/repository"

# The calendar


@pytest.mark.parametrize(
    ("commitments", "capacity", "schedule"),
    [
        ([], 1, []),
        ([(5.0, 8.0)], 1, [(5.0, 8.0)]),
        ([(5.0, 8.0), (0.0, 2.0)], 1, [(0.0, 2.0), (5.0, 8.0)]),
        ([(1.0, 4.0), (2.0, 7.0), (3.0, 4.0)], 1, [(1.0, 4.0), (4.0, 9.0), (9.0, 10.0)]),
        ([(1.0, 4.0), (2.0, 7.0), (3.0, 4.0)], 2, [(1.0, 4.0), (2.0, 7.0), (4.0, 5.0)]),
        ([(1.0, 4.0), (1.0, 4.0), (9.0, 10.0)], 1, [(1.0, 4.0), (4.0, 7.0), (9.0, 10.0)]),
    ],
)
def test_what_was_promised_for_the_same_time_is_kept_one_after_the_other(
    commitments: list[Commitment], capacity: int, schedule: list[Commitment]
) -> None:
    assert resolve_overlaps(commitments, capacity) == schedule


@pytest.mark.parametrize(
    ("commitments", "earliest", "duration", "capacity", "start"),
    [
        ([], 3.0, 5.0, 1, 3.0),
        ([(5.0, 8.0)], 0.0, 5.0, 1, 0.0),
        ([(5.0, 8.0)], 0.0, 5.5, 1, 8.0),
        ([(5.0, 8.0)], 8.0, 1.0, 1, 8.0),
        ([(5.0, 8.0), (8.0, 9.0), (10.0, 11.0)], 4.5, 1.0, 1, 9.0),
        ([(5.0, 8.0), (8.0, 9.0), (10.0, 11.0)], 4.5, 2.0, 1, 11.0),
        ([(5.0, 8.0)], 6.0, 1.0, 2, 6.0),
        ([(5.0, 8.0), (6.0, 9.0)], 5.5, 1.0, 2, 8.0),
        ([(5.0, 8.0), (6.0, 9.0)], 5.0, 1.0, 2, 5.0),
        ([(0.0, 10.0), (5.0, 5.0)], 5.0, 0.0, 1, 10.0),
    ],
)
def test_the_first_time_with_room_for_it(
    commitments: list[Commitment], earliest: float, duration: float, capacity: int, start: float
) -> None:
    assert first_free_time(commitments, earliest, duration, capacity) == start


# Jobs


def job(participant: str = "Washer1.Wash#s1", state: State = State.EXECUTING) -> Job:
    session = ParticipantSession(transaction="t1", participant=participant, me=ADDRESS, peer="http://there", state=state)
    return Job(session=session)


def test_a_job_wakes_up_once_for_each_timer_that_it_set() -> None:
    running_job = job()
    timer = HeartbeatDue("t1", "Washer1.Wash#s1")
    assert run_effects(running_job.set_timer(HeartbeatDue, None))[0] == []
    assert (
        run_effects(running_job.set_timer(HeartbeatDue, 5.0))[0]
        == run_effects(running_job.set_timer(HeartbeatDue, 5.0))[0]
        == [SetTimer(timer, 5.0)]
    )
    assert running_job.timers == {timer}
    assert [run_effects(running_job.set_timer(HeartbeatDue, None))[0] for _ in range(2)] == [[SetTimer(timer, None)], []]
    assert (running_job.key, running_job.question_for(Activity.HALT)) == (
        ("t1", "Washer1.Wash#s1"),
        WorkWanted("t1", "Washer1.Wash#s1", Activity.HALT),
    )


def names(jobs: Iterable[Job]) -> list[str]:
    return [listed_job.session.participant for listed_job in jobs]


def test_jobs_that_are_over_are_known_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs_module, "REMEMBERED", 2)
    jobs = Jobs()
    for name in "abcd":
        jobs.store_job(job(name))
    assert (names(jobs), names(jobs.all_jobs())) == (["a", "b", "c", "d"], ["a", "b", "c", "d"])
    for name in "bac":
        jobs.store_job(job(name, State.ENDED))
    assert (names(jobs), names(jobs.all_jobs())) == (["d"], ["a", "c", "d"])
    assert [jobs.find_job("t1", name) is not None for name in ("a", "b", "d")] == [True, False, True]
    assert (jobs.find_job(None, "a"), jobs.find_job("t1", None)) == (None, None)
    halting = job("d", State.ENDED)
    halting.activity = Activity.HALT
    jobs.store_job(halting)
    assert (names(jobs), jobs.find_job("t1", "d")) == (["d"], halting), "the device still does something for it"


@pytest.mark.parametrize(
    ("activity", "expected_report"),
    [
        (Activity.PERFORM, frp.Failed(description="d", situation="s")),
        (Activity.HALT, frp.Failed(description="d", situation="s")),
        (Activity.UNDO, frp.Stranded(description="d", situation="s")),
    ],
)
def test_what_is_said_of_work_that_failed(activity: Activity, expected_report: frp.Failed | frp.Stranded) -> None:
    assert failure(activity, "d", "s") == expected_report


@pytest.mark.parametrize(
    ("state", "expected_report"),
    [
        (State.EXECUTING, frp.Failed(description="r")),
        (State.STOPPING, frp.Stopped()),
        (State.COMPENSATING, frp.Stranded(description="r")),
    ],
)
def test_what_is_said_of_work_that_was_interrupted(state: State, expected_report: object) -> None:
    assert interruption(state, "r") == expected_report


@pytest.mark.parametrize(
    ("state", "body", "delivery_time", "timers"),
    [
        (State.EXECUTING, frp.Progress(fraction=0.5), CUT_OFF, []),
        (State.EXECUTING, frp.Completed(situation=""), REPORT_TIME, [HeartbeatDue]),
        (State.EXECUTING, frp.Failed(description="d"), REPORT_TIME, [HeartbeatDue, StartDue]),
        (State.COMMITTED, frp.Failed(description="d"), REPORT_TIME, [HeartbeatDue, StartDue]),
        (State.OFFERED, frp.Refuse(reason="r"), REPORT_TIME, [HeartbeatDue]),
    ],
)
def test_who_says_that_work_is_over_waits_for_nothing_any_more(
    state: State,
    body: frp.Progress | frp.Completed | frp.Failed | frp.Refuse,
    delivery_time: float,
    timers: list[type[HeartbeatDue | StartDue]],
) -> None:
    running_job, jobs = job(state=state), Jobs()
    running_job.timers = {HeartbeatDue(*running_job.key), StartDue(*running_job.key)}
    *woken, send = run_effects(send_message(running_job, body, jobs, 7.0))[0]
    assert isinstance(send, Send)
    assert (woken, send.message.body, send.expires_at) == (
        [SetTimer(kind(*running_job.key), None) for kind in timers],
        body,
        7.0 + delivery_time,
    )
    assert names(jobs.all_jobs()) == ([] if isinstance(body, frp.Progress) else ["Washer1.Wash#s1"])


# Reports


def report(number: int, now: float, situation: str, expires_at: float, author: str = "Washer1") -> MapReport:
    return MapReport(id=message_id(ADDRESS, author, "report", number, now), author=author, situation=situation, expires_at=expires_at)


def report_effects(report: MapReport, expires_at: float) -> list[Effect]:
    header = Header(sender=ADDRESS, recipient=REPOSITORY, message_id=report.id, reply_to=ADDRESS)
    body = UpdateMap(situation=report.situation, author=report.author)
    return [Send(Message(header=header, body=body), expires_at), SetTimer(ReportDue(), expires_at + PATIENCE / 2)]


def answer(body: Body) -> Message:
    return Message(header=Header(sender=REPOSITORY, recipient=ADDRESS, message_id="urn:x"), body=body)


def test_reports_are_made_one_after_the_other_once_the_device_is_there() -> None:
    reports = MapReports(address=ADDRESS, repository=REPOSITORY)
    first, second, third = report(1, 0.0, "A", 60.0), report(2, 1.0, "B", 21.0), report(3, 5.0, "C", 65.0)
    assert run_effects(reports.add("Washer1", "A", 0.0, 60.0))[0] == run_effects(reports.add("Washer1", "B", 1.0, 20.0))[0] == []
    assert not reports.is_pending(first.id)
    assert run_effects(reports.start(2.0))[0] == report_effects(first, 2.0 + PATIENCE)
    assert run_effects(reports.start(3.0))[0] == [], "it is there already"
    assert run_effects(reports.add("Washer1", "C", 5.0, 60.0))[0] == [], "another is on its way"
    assert [reports.is_pending(report_id) for report_id in (first.id, second.id, None)] == [True, False, False]
    assert run_effects(reports.resend(12.0))[0] == report_effects(first, 12.0 + PATIENCE)
    assert run_effects(reports.answered(answer(Updated(version=1)), 13.0)) == (
        [SetTimer(ReportDue(), None), *report_effects(second, 21.0)],
        "",
    )
    assert run_effects(reports.resend(21.0))[0] == report_effects(third, 21.0 + PATIENCE), "the time of the one before is over"
    assert run_effects(reports.answered(answer(Updated(version=2)), 22.0)) == ([SetTimer(ReportDue(), None)], "")
    assert (reports.pending, reports.is_pending(third.id)) == ([], False)
    fourth = report(4, 30.0, "D", 90.0)
    assert run_effects(reports.add("Washer1", "D", 30.0, 60.0))[0] == report_effects(fourth, 30.0 + PATIENCE)


@pytest.mark.parametrize(
    ("body", "problem_text"),
    [
        (Rejected(problems=("no", "never")), "the Repository rejects A from Washer1.Wash: no; never"),
        (Fault(code="Sender", text="no"), "the Repository rejects A from Washer1.Wash: no"),
    ],
)
def test_what_is_wrong_with_a_report_is_said(body: Body, problem_text: str) -> None:
    reports = MapReports(address=ADDRESS, repository=REPOSITORY, ready=True)
    assert run_effects(reports.add("Washer1.Wash", "A", 0.0, 5.0))[0] == report_effects(report(1, 0.0, "A", 5.0, "Washer1.Wash"), 5.0)
    assert run_effects(reports.answered(answer(body), 1.0)) == ([SetTimer(ReportDue(), None)], problem_text)
