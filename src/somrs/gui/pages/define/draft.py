"""The form's content: a task that is not submitted yet. The browser keeps it, so that it survives reloads and server restarts."""

from __future__ import annotations

import msgspec

from somrs.entish.parse import parse
from somrs.errors import FormulaError, UsageError
from somrs.ontology.services import Handler, Occasion
from somrs.protocol.messages.previews import Preview
from somrs.protocol.messages.submission import Policy, Submit

UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}
"""Seconds of each unit for deadlines."""

NOW, ONE_TIME, INTERVAL, DAILY = "now", "once", "every", "daily"


class Procedure(msgspec.Struct, kw_only=True):
    """A handler for failures or for compensation. Without a `service_type`, it applies to all steps."""

    on: Occasion = Occasion.FAILURE
    service_type: str = ""
    effect: str = ""
    when: str = ""


class Repeat(msgspec.Struct, kw_only=True):
    """When the task is submitted: `now`, or by a standing order with this name `once` (`date`, `time`), `every` so many minutes, or `daily`
    at `time` on `days` (0 is Monday). `order`: the id of the order that is being edited; `version`: its version when it was read."""

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
    """Numbers are kept as typed. `link`: the initial goal from the page's address; `template`: the template that was used."""

    effect: str = ""
    recognise: bool = False
    """Find out whether the goal holds, instead of making it so."""
    precondition: str = ""
    policy: Policy = Policy.PRICE
    time_value: str = "0.01"
    deadline: str = ""
    deadline_unit: str = "min"
    priority: int = 0
    waits: bool = True
    procedures: list[Procedure] = []
    repeat: Repeat = msgspec.field(default_factory=Repeat)
    link: str = ""
    template: str = ""

    def task(self) -> Submit:
        """The task. Raises UsageError if an input is invalid."""
        return Submit(
            effect=self.effect.strip(),
            precondition=self.precondition.strip() or None,
            policy=self.policy,
            time_value=self._parse_time_value(),
            deadline=self.deadline_seconds(),
            handlers=tuple(_handler(procedure) for procedure in self.procedures if procedure.effect.strip()),
            priority=self.priority,
            recognise=self.recognise,
            waits=self.waits,
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
            recognise=self.recognise,
        )

    def deadline_seconds(self) -> float | None:
        """The deadline in seconds, None if there is none. Raises UsageError."""
        if not self.deadline.strip():
            return None
        amount = number(self.deadline)
        if amount is None or amount <= 0:
            raise UsageError(f"the deadline must be a number above 0, not {self.deadline.strip()}; leave it empty for no deadline")
        return amount * UNITS[self.deadline_unit]

    def _parse_time_value(self) -> float:
        amount = number(self.time_value)
        if amount is None or amount < 0:
            if self.policy is not Policy.WEIGHTED:
                return 0.01
            raise UsageError(f"the cost per second must be a number of EUR, not {self.time_value.strip() or 'empty'}")
        return amount

    def load_task(self, task: Submit) -> None:
        """Fill the draft from a task."""
        self.effect, self.precondition, self.recognise = task.effect, task.precondition or "", task.recognise
        self.policy, self.time_value, self.priority = task.policy, f"{task.time_value:g}", task.priority
        self.waits = task.waits
        self.deadline, self.deadline_unit = "", "min"
        if task.deadline is not None:
            unit = next(unit for unit in ("h", "min", "s") if task.deadline % UNITS[unit] == 0 or unit == "s")
            self.deadline, self.deadline_unit = f"{task.deadline / UNITS[unit]:g}", unit
        self.procedures = [
            Procedure(on=handler.on, service_type=handler.service_type or "", effect=handler.effect, when=handler.when or "")
            for handler in task.handlers
        ]


def number(text: str) -> float | None:
    """Parse a number with a decimal point or comma; None if it is invalid."""
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
                raise UsageError(f"the handler for {procedure.on.value}: {error}") from None
    return Handler(
        on=procedure.on, service_type=procedure.service_type or None, effect=procedure.effect.strip(), when=procedure.when.strip() or None
    )
