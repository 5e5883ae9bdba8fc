"""What is written on the page: a task that is not stated yet. It is kept in the browser, so that it outlives the page and the server."""

from __future__ import annotations

import msgspec

from somrs.entish.parse import parse
from somrs.errors import FormulaError, UsageError
from somrs.ontology.services import Handler, Occasion
from somrs.protocol.messages.clients import Policy, Preview, Submit

UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}
"""Seconds of the units in which deadlines are written."""

NOW, ONE_TIME, INTERVAL, DAILY = "now", "once", "every", "daily"


class Procedure(msgspec.Struct, kw_only=True):
    """What is laid down for a failure, or for undoing. Without a `service_type`, for all steps."""

    on: Occasion = Occasion.FAILURE
    service_type: str = ""
    effect: str = ""
    when: str = ""


class Repeat(msgspec.Struct, kw_only=True):
    """When the task is stated: `now`, or as a standing order of this name `once` (`date`, `time`), `every` so many minutes, or `daily` at
    `time` on `days` (0 is Monday). `order`: the id of the order that is being changed, of which the `version` was seen."""

    recurrence: str = msgspec.field(default=NOW, name="how")
    name: str = ""
    date: str = ""
    time: str = "08:00"
    minutes: str = "30"
    days: list[int] = []
    skip: bool = True
    order: str = ""
    version: int = 0


class Draft(msgspec.Struct, kw_only=True):
    """Numbers are as they were typed. `link`: the wish that the page was opened with; `template`: the one that it was made from."""

    effect: str = ""
    precondition: str = ""
    policy: Policy = Policy.PRICE
    time_value: str = "0.01"
    deadline: str = ""
    deadline_unit: str = "min"
    priority: int = 0
    procedures: list[Procedure] = []
    repeat: Repeat = msgspec.field(default_factory=Repeat)
    link: str = ""
    template: str = ""

    def task(self) -> Submit:
        """The task. Raises UsageError where something that was written is none."""
        return Submit(
            effect=self.effect.strip(),
            precondition=self.precondition.strip() or None,
            policy=self.policy,
            time_value=self._parse_time_value(),
            deadline=self.deadline_seconds(),
            handlers=tuple(_handler(procedure) for procedure in self.procedures if procedure.effect.strip()),
            priority=self.priority,
        )

    def preview(self) -> Preview:
        return Preview(
            effect=self.effect.strip(),
            precondition=self.precondition.strip() or None,
            quotes=True,
            policy=self.policy,
            time_value=self._parse_time_value(),
            deadline=self.deadline_seconds(),
            priority=self.priority,
        )

    def deadline_seconds(self) -> float | None:
        """Of the deadline. Raises UsageError."""
        if not self.deadline.strip():
            return None
        amount = number(self.deadline)
        if amount is None or amount <= 0:
            raise UsageError(f"the deadline is a number above 0, and {self.deadline.strip()} is none; leave it empty if there is none")
        return amount * UNITS[self.deadline_unit]

    def _parse_time_value(self) -> float:
        amount = number(self.time_value)
        if amount is None or amount < 0:
            if self.policy is not Policy.WEIGHTED:
                return 0.01
            raise UsageError(f"what a second is worth is a number of EUR, and {self.time_value.strip() or 'nothing'} is none")
        return amount

    def load_task(self, task: Submit) -> None:
        """Write what a task says."""
        self.effect, self.precondition = task.effect, task.precondition or ""
        self.policy, self.time_value, self.priority = task.policy, f"{task.time_value:g}", task.priority
        self.deadline, self.deadline_unit = "", "min"
        if task.deadline is not None:
            unit = next(unit for unit in ("h", "min", "s") if task.deadline % UNITS[unit] == 0 or unit == "s")
            self.deadline, self.deadline_unit = f"{task.deadline / UNITS[unit]:g}", unit
        self.procedures = [
            Procedure(on=handler.on, service_type=handler.service_type or "", effect=handler.effect, when=handler.when or "")
            for handler in task.handlers
        ]


def number(text: str) -> float | None:
    """With a point or a comma."""
    try:
        value = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return value if abs(value) < 1e12 else None


def _handler(procedure: Procedure) -> Handler:
    for text in (procedure.effect, procedure.when):
        if text.strip():
            try:
                parse(text)
            except FormulaError as error:
                raise UsageError(f"the procedure for {procedure.on.value}: {error}") from None
    return Handler(
        on=procedure.on, service_type=procedure.service_type or None, effect=procedure.effect.strip(), when=procedure.when.strip() or None
    )
