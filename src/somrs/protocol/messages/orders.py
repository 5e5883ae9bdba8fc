"""What the Scheduler is asked and answers: templates of tasks, standing orders, and what came of each time at which one was due."""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import StrEnum

from msgspec import Struct, structs

from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.clients import Submit
from somrs.protocol.messages.frp import Outcome

BLANK = re.compile(r"{([^{}]*)}")
"""A blank in a formula of a template: its name in braces."""

# When something is due


class Once(Struct, frozen=True, kw_only=True, tag=True):
    """At this moment: seconds since 1970."""

    at: float


class Every(Struct, frozen=True, kw_only=True, tag=True):
    """Every so many minutes, counted from `since` (seconds since 1970), or from when the order was given."""

    minutes: float
    since: float | None = None


class Daily(Struct, frozen=True, kw_only=True, tag=True):
    """At `hh:mm` by local time, on these days of the week: 0 is Monday, 6 is Sunday; all, if none is said."""

    at: str
    days: tuple[int, ...] = ()


Schedule = Once | Every | Daily

# Templates


class Blank(Struct, frozen=True, kw_only=True):
    """What is filled in: `{Thing}` in the formulas of the task. `type` is a type of the ontology, or `number`, `text` or `truth`;
    `default` is taken when nothing is said."""

    name: str
    type: str = "Object"
    default: str = ""
    label: str = ""


class Template(Struct, frozen=True, kw_only=True):
    """A task to be stated again and again. `version` counts its changes."""

    name: str
    task: Submit
    blanks: tuple[Blank, ...] = ()
    note: str = ""
    version: int = 0
    changed_at: float = 0.0
    changed_by: str = ""


class TemplatesPage(MessageBody, frozen=True, kw_only=True, tag=True):
    """By name. `more`: there are others behind the last."""

    templates: tuple[Template, ...]
    more: bool = False


class TemplateSaved(Struct, frozen=True, kw_only=True):
    """What is to be kept under a name. `expected_version`: the version that one saw (0: there was none of this name); if it is another by
    now, somebody else changed it, and nothing is saved. None: whatever there is."""

    task: Submit
    blanks: tuple[Blank, ...] = ()
    note: str = ""
    by: str = ""
    expected_version: int | None = None


class Filled(Struct, frozen=True, kw_only=True):
    """What is written in the blanks, by their names. `by`: who states the task."""

    values: dict[str, str] = {}
    by: str | None = None


def fill_blanks(task: Submit, values: Mapping[str, str]) -> Submit:
    """The task with these texts in place of its blanks."""

    def write(formula: str | None) -> str | None:
        return fill_formula(formula, values) if formula is not None else None

    return structs.replace(
        task,
        effect=fill_formula(task.effect, values),
        precondition=write(task.precondition),
        handlers=tuple(
            structs.replace(handler, effect=fill_formula(handler.effect, values), when=write(handler.when)) for handler in task.handlers
        ),
    )


def blanks_to_variables(template: Template) -> Submit:
    """The task with a variable in the place of each blank: as far as its formulas are known before it is filled in."""
    return fill_blanks(template.task, {blank.name: f"?{blank.name}" for blank in template.blanks})


def fill_formula(formula: str, values: Mapping[str, str]) -> str:
    return BLANK.sub(lambda match: values.get(match[1].strip(), match[0]), formula)


# Standing orders


class RunState(StrEnum):
    """What became of one time at which an order was due."""

    SUBMITTING = "submitting"
    """Its task is being stated; the Task Manager may not be there."""
    SUBMITTED = "submitted"
    """Its task runs, or is over: then there is an outcome."""
    SKIPPED = "skipped"
    """The task before still ran."""
    MISSED = "missed"
    """Nobody was there to state it; it is not made up for."""
    REFUSED = "refused"
    """It could not be stated; `note` says why."""


class Run(Struct, frozen=True, kw_only=True):
    """One time at which an order was due. `times`: of those that were missed, so many are told of here together, and this was the last."""

    due: float
    state: RunState
    at: float
    task: str | None = None
    outcome: Outcome | None = None
    ended_at: float | None = None
    note: str = ""
    times: int = 1

    @property
    def open(self) -> bool:
        """Whether its task may be under way."""
        return self.state in (RunState.SUBMITTING, RunState.SUBMITTED) and self.ended_at is None


class StandingOrder(Struct, frozen=True, kw_only=True):
    """A task that is stated whenever it is due: its own, or a template's, with the blanks filled in. `next`: when it is due next (None:
    never again, or it is paused). `version` counts its changes, not its runs."""

    id: str
    name: str
    when: Schedule
    task: Submit | None = None
    template: str | None = None
    values: dict[str, str] = {}
    enabled: bool = True
    skip: bool = True
    """If the task before still runs, this time is skipped; otherwise both run."""
    next: float | None = None
    last: Run | None = None
    version: int = 0
    changed_at: float = 0.0
    """Times that were before this do not count."""
    changed_by: str = ""


class OrdersPage(MessageBody, frozen=True, kw_only=True, tag=True):
    """By id. `more`: there are others behind the last."""

    orders: tuple[StandingOrder, ...]
    more: bool = False


class OrderSaved(Struct, frozen=True, kw_only=True):
    """A standing order as it is to be: with a `task`, or a `template` and its `values`. `expected_version`: see templates."""

    name: str
    when: Schedule
    task: Submit | None = None
    template: str | None = None
    values: dict[str, str] = {}
    enabled: bool = True
    skip: bool = True
    by: str = ""
    expected_version: int | None = None


class RunsPage(MessageBody, frozen=True, kw_only=True, tag=True):
    """The times at which an order was due, the latest first. `more`: there are others before the last."""

    runs: tuple[Run, ...]
    more: bool = False


# What is asked


class ReadTemplates(MessageBody, frozen=True, kw_only=True, tag=True):
    """All templates behind the name `after`, or the one of this name."""

    after: str = ""
    name: str | None = None


class SaveTemplate(MessageBody, frozen=True, kw_only=True, tag=True):
    name: str
    saved: TemplateSaved


class RenameTemplate(MessageBody, frozen=True, kw_only=True, tag=True):
    """Give a template another name; the orders that use it know it by the new one."""

    name: str
    to: str
    expected_version: int | None = None
    by: str = ""


class RemoveTemplate(MessageBody, frozen=True, kw_only=True, tag=True):
    """Remove a template that no order uses."""

    name: str
    expected_version: int | None = None


class TemplateKept(MessageBody, frozen=True, kw_only=True, tag=True):
    template: Template


class FillTemplate(MessageBody, frozen=True, kw_only=True, tag=True):
    """Which task is a template, with its blanks filled in? Nothing is stated."""

    name: str
    values: dict[str, str] = {}


class TemplateFilled(MessageBody, frozen=True, kw_only=True, tag=True):
    task: Submit


class ReadOrders(MessageBody, frozen=True, kw_only=True, tag=True):
    """All standing orders behind the id `after`, or the one of this id."""

    after: str = ""
    id: str | None = None


class SaveOrder(MessageBody, frozen=True, kw_only=True, tag=True):
    """Give a standing order, or change the one of this id."""

    saved: OrderSaved
    id: str | None = None


class TurnOrder(MessageBody, frozen=True, kw_only=True, tag=True):
    """Let an order rest, or go on."""

    id: str
    enabled: bool
    by: str = ""


class RemoveOrder(MessageBody, frozen=True, kw_only=True, tag=True):
    """Take an order back. Its task, if one runs, goes on."""

    id: str
    expected_version: int | None = None


class OrderKept(MessageBody, frozen=True, kw_only=True, tag=True):
    order: StandingOrder


class NoLongerKept(MessageBody, frozen=True, kw_only=True, tag=True):
    """The template or the order is removed."""


class ReadRuns(MessageBody, frozen=True, kw_only=True, tag=True):
    """When an order was due, earlier than `before`."""

    id: str
    limit: int = 50
    before: float | None = None


class OrdersRejected(MessageBody, frozen=True, kw_only=True, tag=True):
    """It was not done, and why, for people; `error` names the sort for programs. `position`: where in the formula, which is `text`."""

    problem: str
    error: str = ""
    text: str = ""
    position: int | None = None
    hint: str = ""


# News


class SubscribeOrders(MessageBody, frozen=True, kw_only=True, tag=True):
    """Tell me when templates or orders change, for so many seconds."""

    lease: float


class OrdersSubscribed(MessageBody, frozen=True, kw_only=True, tag=True):
    """`begun`: when this Scheduler was started; what was before, a subscriber may have missed."""

    until: float
    begun: float


class OrdersChanged(MessageBody, frozen=True, kw_only=True, tag=True):
    """Templates, or orders and their runs, are others than before: read them again."""

    templates: bool = False
    orders: bool = False
