"""The reports of devices on their way to the map, and the check that a transaction waits until the Repository has recorded them.

It is a part of property 5. That the map is right in the end is checked in `properties.py`.
"""

from __future__ import annotations

from functools import cache

from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.qualified_names import plain_name
from somrs.planner.model.problem import Problem
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Message, normalised_id
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.runtime.virtual_time import World
from somrs.task_manager.manager import TaskManager
from verification.fault_runs.names import plain_text
from verification.fault_runs.violation import Property, Violation

ServiceReport = tuple[str, str]
"""A service, and the situation that it reports."""


class RecordedReports:
    """Follows each report from its device to the Repository."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._unrecorded: dict[str, dict[str, ServiceReport]] = {}
        """Reports of each transaction that the Repository has not recorded yet, by message id."""
        self._updates: dict[str, ServiceReport] = {}
        """What each request to change the map reports."""
        self._answered: set[str] = set()
        """The requests to change the map that the Repository has answered."""
        self._known_reports: set[str] = set()
        self._first_sent: dict[str, float] = {}
        """The time at which each report was first sent, by message id."""
        self._recorded_at: dict[ServiceReport, float] = {}
        """The time at which the Repository last recorded each situation of a service."""

    def read(self, message: Message) -> None:
        """Note a message that was sent."""
        header = message.header
        match message.body:
            case UpdateMap(author=author, situation=str(situation)):
                self._updates[normalised_id(header.message_id)] = plain_text(author), _normalised(situation)
            case Updated() | Rejected():
                self._note_update(normalised_id(header.relates_to or ""))
            case frp.Completed() | frp.Failed() | frp.Stopped() | frp.Compensated() | frp.Stranded():
                self._first_sent.setdefault(header.message_id, self._world.now)
            case frp.Arrange():
                self._check(header.transaction or "", f"{header.participant or ''} was asked for terms")

    def _note_update(self, request: str) -> None:
        """Note the Repository's answer to a request to change the map: only then is the change known to be on its disk."""
        update = self._updates.get(request)
        if update is None or request in self._answered:
            return
        self._answered.add(request)
        self._recorded_at[update] = self._world.now
        for reports in self._unrecorded.values():
            for id in [id for id, report in reports.items() if report == update]:
                del reports[id]

    def _check(self, task: str, trigger: str) -> None:
        if unrecorded := self._unrecorded.get(task):
            service, situation = next(iter(unrecorded.values()))
            raise Violation(Property.MAP, f"{trigger} before the Repository had recorded the report of {service}: {situation}")

    def received(self, manager: TaskManager, message: Message) -> None:
        """Note a message that a Task Manager has handled."""
        body = message.body
        if isinstance(body, frp.Completed | frp.Failed | frp.Stopped | frp.Compensated | frp.Stranded) and body.situation is not None:
            self._reported(manager, message, body.situation)

    def _reported(self, manager: TaskManager, message: Message, situation: str) -> None:
        """Note a new report to a transaction that has not ended. The Repository has to record it before the transaction continues."""
        header, kind = message.header, type(message.body).__name__
        transaction = manager.state.tasks.get(header.transaction or "")
        if transaction is None or transaction.outcome is not None or header.message_id in self._known_reports:
            return
        self._known_reports.add(header.message_id)
        member = next((member for member in transaction.members if member.id == header.participant), None)
        if (
            member is not None
            and kind in member.session.received_messages
            and member.session.received_messages[kind].id == header.message_id
        ):
            reports = self._unrecorded.setdefault(transaction.id, {})
            report = plain_name(member.offer.service), _normalised(situation)
            # The report may be recorded already: it arrived before, the Task Manager was killed, and the report was repeated.
            if self._recorded_at.get(report, -1.0) < self._first_sent[header.message_id]:
                reports[header.message_id] = report

    def planned(self, manager: TaskManager, problem: Problem) -> None:
        """Check a request to the planner. It may come from any transaction with this goal."""
        wanting = [t for t in manager.state.tasks.values() if t.outcome is None and any(p.goal == str(problem.goal) for p in t.executions)]
        if wanting and all(self._unrecorded.get(task.id) for task in wanting):
            self._check(wanting[0].id, "it was planned")


@cache
def _normalised(situation: str) -> str:
    """The situation with plain names, as formulas are written."""
    try:
        return str(parse(plain_text(situation)))
    except FormulaError:
        return situation
