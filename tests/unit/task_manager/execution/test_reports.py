"""Reports are put on the map one after the other, and settled by what the Repository answers."""

from __future__ import annotations

import pytest

from somrs.kernel.codec import Codec, encode
from somrs.protocol.messages import events
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.protocol.messages.observations import Reception
from somrs.task_manager.execution.reports import (
    ProgressSubject,
    Report,
    ReportResult,
    Reports,
    ReportSubject,
    UnobservedSubject,
    WorkSubject,
    settlement,
)
from somrs.task_manager.requests import ForReport
from tests.support.effects import bodies
from tests.unit.task_manager.arrangement.test_plan_request import context


def test_reports_go_one_after_the_other() -> None:
    reports, world = Reports(), context()
    first = Report(update=UpdateMap(situation="Jar001 isOn Shelf1"), subject=ProgressSubject("p"))
    second = Report(update=UpdateMap(situation="Jar001 isOn Shelf2"), subject=WorkSubject("p", "Jar001 isOn Shelf2"))
    assert reports.pending is False
    assert bodies([*reports.add_report("task1", first, world, 5.0)]) == [first.update]
    assert [*reports.add_report("task1", second, world, 6.0)] == []
    assert (reports.waiting, reports.pending) == ([first, second], True)
    assert reports.settle_first() is False
    assert bodies([*reports.send_next("task1", world, 7.0)]) == [second.update]
    assert [request.purpose for request in world.requests.pending.values()] == [ForReport("task1")] * 2
    assert (reports.settle_first(), reports.pending) == (True, False)


@pytest.mark.parametrize(
    ("body", "version", "problems"),
    [
        (Updated(version=3), 3, ()),
        (Rejected(problems=("there is no such place",), version=4), 4, ("there is no such place",)),
        (Rejected(problems=("there is no such place",)), None, ("there is no such place",)),
        (Fault(code="", text="out of order"), None, ("out of order",)),
    ],
)
def test_a_report_is_settled_when_the_map_shows_what_came_of_it(body: Body, version: int | None, problems: tuple[str, ...]) -> None:
    answer = Message(header=Header(sender="repository", recipient="tm", message_id="1", reply_to="repository"), body=body)
    assert settlement(answer) == (version, ReportResult(problems=problems))


def test_a_report_is_told_with_the_names_of_what_it_sighted() -> None:
    reception = Reception(names={"A": "Jar007", "B": "Table1"}, added=("Jar007",), superseded=("Jar1 isOn Table1",))
    answer = Message(header=Header(sender="repository", recipient="tm", message_id="1"), body=Updated(version=3, reception=reception))
    version, result = settlement(answer)
    assert version == 3
    assert result.named("?A: Jar isOn ?B: Table AND ?A.Color = Red AND ?C: Cup isOn ?B") == "Jar007 isOn Table1 AND Jar007.Color = Red"
    assert result.named("Jar1 isOn Table1") == "Jar1 isOn Table1"
    assert [*result.events("Robot1.Look")] == [
        events.ObjectsDiscovered(service="Robot1.Look", objects=("Jar007",)),
        events.ReportSuperseded(service="Robot1.Look", parts=("Jar1 isOn Table1",)),
    ]


@pytest.mark.parametrize(
    "subject", [ProgressSubject("p"), WorkSubject("p", "Jar001 isOn Shelf1", "it contradicts"), UnobservedSubject("Jar001", 3)]
)
def test_what_a_report_is_about_is_known_when_it_is_read_back(subject: ReportSubject) -> None:
    report = Report(update=UpdateMap(situation="Jar001 isOn Shelf1"), subject=subject)
    assert Codec[Report](Report).decode(encode(report)) == report
