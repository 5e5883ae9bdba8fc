"""The bodies of the Scheduler's protocol: templates of tasks, standing orders, and their runs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import StrEnum

from msgspec import Struct

from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit, with_formulas

BLANK = re.compile(r"{([^{}]*)}")
"""A blank in a formula of a template: its name in braces."""

# Schedules


class Once(Struct, frozen=True, kw_only=True, tag=True):
    """At this time, in seconds since 1970."""

    at: float


class Every(Struct, frozen=True, kw_only=True, tag=True):
    """Every `minutes` minutes from `since` (seconds since 1970), or from the time at which the order was saved."""

    minutes: float
    since: float | None = None


class Daily(Struct, frozen=True, kw_only=True, tag=True):
    """At `hh:mm` in local time, on these days of the week (0 is Monday, 6 is Sunday); without `days`, on all."""

    at: str
    days: tuple[int, ...] = ()


Schedule = Once | Every | Daily

# Templates


class Blank(Struct, frozen=True, kw_only=True):
    """A blank to fill in: `{Thing}` in the formulas of the task.

    `type` is a type of the ontology, or `number`, `text` or `truth`; `default` is used when no value is given.
    """

    name: str
    type: str = "Object"
    default: str = ""
    label: str = ""


class Template(Struct, frozen=True, kw_only=True):
    """A task to be submitted repeatedly. `version` counts its changes."""

    name: str
    task: Submit
    blanks: tuple[Blank, ...] = ()
    note: str = ""
    version: int = 0
    changed_at: float = 0.0
    changed_by: str = ""


class TemplatesPage(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of templates, by name. `more`: another page follows."""

    templates: tuple[Template, ...]
    more: bool = False


class TemplateSaved(Struct, frozen=True, kw_only=True):
    """A template to save under a name.

    `expected_version` is the version that the client read (0: there was none of this name). If the template has another version, another
    client changed it, and it is not saved. None: save it in any case.
    """

    task: Submit
    blanks: tuple[Blank, ...] = ()
    note: str = ""
    by: str = ""
    expected_version: int | None = None


class Filled(Struct, frozen=True, kw_only=True):
    """The values of the blanks, by their names. `by`: the client that submits the task."""

    values: dict[str, str] = {}
    by: str | None = None


def fill_blanks(task: Submit, values: Mapping[str, str]) -> Submit:
    """Return the task with these texts in place of its blanks."""
    return with_formulas(task, lambda formula: fill_formula(formula, values))


def blanks_to_variables(template: Template) -> Submit:
    """Return the task with a variable in place of each blank: its formulas as far as they are known before it is filled in."""
    return fill_blanks(template.task, {blank.name: f"?{blank.name}" for blank in template.blanks})


def fill_formula(formula: str, values: Mapping[str, str]) -> str:
    return BLANK.sub(lambda match: values.get(match[1].strip(), match[0]), formula)


# Standing orders


class RunState(StrEnum):
    """What became of one time at which an order was due."""

    SUBMITTING = "submitting"
    """The Scheduler is submitting the task; the Task Manager may not be available."""
    SUBMITTED = "submitted"
    """The task runs, or it is over and has an outcome."""
    SKIPPED = "skipped"
    """The task of the run before was still running."""
    MISSED = "missed"
    """The Scheduler was not running; the run is not made up for."""
    REFUSED = "refused"
    """The task could not be submitted; `note` says why."""


class Run(Struct, frozen=True, kw_only=True):
    """One time at which an order was due. `times`: the number of missed runs that this entry stands for; `due` is of the last.
    `task_manager`: the address of the Task Manager that has the task, in a system with several."""

    due: float
    state: RunState
    at: float
    task: str | None = None
    outcome: Outcome | None = None
    ended_at: float | None = None
    note: str = ""
    times: int = 1
    task_manager: str = ""

    @property
    def open(self) -> bool:
        """Whether its task may be running."""
        return self.state in (RunState.SUBMITTING, RunState.SUBMITTED) and self.ended_at is None


class StandingOrder(Struct, frozen=True, kw_only=True):
    """A task that is submitted whenever it is due: its own task, or a template with its blanks filled in.

    `next`: when it is due next; None: never again, or it is paused. `version` counts its changes, not its runs.
    """

    id: str
    name: str
    when: Schedule
    task: Submit | None = None
    template: str | None = None
    values: dict[str, str] = {}
    enabled: bool = True
    skip: bool = True
    """If the task of the run before is still running, skip this run; otherwise both run."""
    next: float | None = None
    last: Run | None = None
    version: int = 0
    changed_at: float = 0.0
    """Due times before this do not count."""
    changed_by: str = ""


class OrdersPage(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of standing orders, by id. `more`: another page follows."""

    orders: tuple[StandingOrder, ...]
    more: bool = False


class OrderSaved(Struct, frozen=True, kw_only=True):
    """A standing order to save: with a `task`, or with a `template` and its `values`. `expected_version`: as in `TemplateSaved`."""

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
    """A page of the runs of an order, the latest first. `more`: there are earlier ones."""

    runs: tuple[Run, ...]
    more: bool = False


# Requests


class ReadTemplates(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read the templates after the name `after`, or the template with this name."""

    after: str = ""
    name: str | None = None


class SaveTemplate(MessageBody, frozen=True, kw_only=True, tag=True):
    name: str
    saved: TemplateSaved


class RenameTemplate(MessageBody, frozen=True, kw_only=True, tag=True):
    """Rename a template. The orders that use it follow."""

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
    """Return the task of a template with its blanks filled in. Nothing is submitted."""

    name: str
    values: dict[str, str] = {}


class TemplateFilled(MessageBody, frozen=True, kw_only=True, tag=True):
    task: Submit


class ReadOrders(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read the standing orders after the id `after`, or the order with this id."""

    after: str = ""
    id: str | None = None


class SaveOrder(MessageBody, frozen=True, kw_only=True, tag=True):
    """Save a new standing order, or change the one with this id."""

    saved: OrderSaved
    id: str | None = None


class TurnOrder(MessageBody, frozen=True, kw_only=True, tag=True):
    """Pause an order, or resume it."""

    id: str
    enabled: bool
    by: str = ""


class RemoveOrder(MessageBody, frozen=True, kw_only=True, tag=True):
    """Remove an order. Its task, if one is running, continues."""

    id: str
    expected_version: int | None = None


class OrderKept(MessageBody, frozen=True, kw_only=True, tag=True):
    order: StandingOrder


class NoLongerKept(MessageBody, frozen=True, kw_only=True, tag=True):
    """The template or the order is removed."""


class ReadRuns(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read the runs of an order that were due before `before`."""

    id: str
    limit: int = 50
    before: float | None = None


class OrdersRejected(MessageBody, frozen=True, kw_only=True, tag=True):
    """The request was rejected, with the problem as a sentence for people; `error` is its kind, for programs.

    `position` is the place in the formula `text`.
    """

    problem: str
    error: str = ""
    text: str = ""
    position: int | None = None
    hint: str = ""


# News


class SubscribeOrders(MessageBody, frozen=True, kw_only=True, tag=True):
    """Report to the sender, for `lease` seconds, that templates or orders change."""

    lease: float


class OrdersSubscribed(MessageBody, frozen=True, kw_only=True, tag=True):
    """The subscription. `begun` is when this Scheduler started; the subscriber may have missed earlier changes."""

    until: float
    begun: float


class OrdersChanged(MessageBody, frozen=True, kw_only=True, tag=True):
    """To subscribers: templates, or orders and their runs, changed. Read them again."""

    templates: bool = False
    orders: bool = False
