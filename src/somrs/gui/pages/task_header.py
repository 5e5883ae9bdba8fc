"""The head of a task's page: goal, client, progress or outcome with its reasons, and actions."""

from __future__ import annotations

import time

from nicegui import ui

from somrs.access.rights import Right
from somrs.api.remote import LiveApi
from somrs.client.durations import format_duration
from somrs.client.state_labels import priority_text
from somrs.client.task_forecast import cost_text, remaining_text
from somrs.client.task_report import reasons
from somrs.gui.account_menu import only_with
from somrs.gui.author import author
from somrs.gui.icons import Badge, format_time
from somrs.gui.pages.task_cancel_dialog import CancelDialog
from somrs.gui.pages.task_retry import RetryButton
from somrs.gui.pages.task_text import PHASES, count_text, due_text, gist, task_path, task_sign
from somrs.gui.pages.task_waits import show_hindrances, show_waits
from somrs.gui.shell import guarded, notify
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.people import person_name
from somrs.protocol.messages.submission import Policy
from somrs.protocol.messages.task_views import Phase, TaskView

_POLICIES = {Policy.PRICE: "the cheapest", Policy.TIME: "the soonest", Policy.WEIGHTED: "price and time"}


class TaskHeader:
    """Updated in place as the task changes."""

    def __init__(self, api: LiveApi, view: TaskView) -> None:
        self._api, self._view = api, view
        self._cancel_dialog = CancelDialog(api, view)
        with ui.element("header").classes("somrs-sheet somrs-task-head"):
            with ui.element("div").classes("somrs-task-line"):
                ui.link("Tasks", "/tasks").classes("somrs-task-back").props('aria-label="Back to all tasks"')
                self._badge = Badge(PHASES[Phase.PLANNING])
                self._effect = ui.label(view.effect).classes("somrs-formula somrs-task-effect").props('role="heading" aria-level="1"')
                self._build_menu(view)
            with ui.element("div").classes("somrs-task-track").props('role="progressbar" aria-label="Steps done"') as self._track:
                self._fill = ui.element("div")
            with ui.element("dl").classes("somrs-task-facts"):
                self._steps = _fact("Steps")
                self._elapsed = _fact("Time")
                self._remaining = _fact("Remaining time")
                self._cost = _fact("Cost")
                if view.recognise:
                    _fact("Purpose").set_text("find out")
                _fact("Submitted").set_text(f"{format_time(view.submitted_at)} by {person_name(view.client)}")
                self._due = _fact("Deadline")
                _fact("Priority").set_text(priority_text(view.priority))
                _fact("Policy").set_text(_POLICIES[view.policy])
                if view.retry_of is not None:
                    _link_fact("Retry of", f"task {short_id(view.retry_of)}", task_path(view.retry_of))
                if view.precondition:
                    _fact("Precondition").set_text(view.precondition)
                if view.task_manager:
                    _fact("Task Manager").set_text(view.task_manager)
                _fact("Id").set_text(short_id(view.task))
            self._reason_status = ui.element("div").props('role="status"')
        self._shown_reasons: tuple[str, ...] | None = None
        self._clock = ui.timer(1.0, self._tick)
        self.render(view)

    def _build_menu(self, view: TaskView) -> None:
        name = f"task-{short_id(view.task)}"
        with ui.element("div").classes("somrs-task-ways"):
            with ui.button("Export", icon="download").props("flat dense no-caps"), ui.menu():
                _file(f"/api/tasks/{view.task}/chart", f"{name}.svg", "schema", "Messages as a picture (SVG)")
                self._record = _file("", f"{name}.json", "data_object", "Record, for programs (JSON)")
            # Two buttons, of which one is hidden: a click on what the browser still shows never does the opposite.
            self._pause = ui.button("Pause", icon="pause", on_click=guarded(self._pause_task)).props("outline dense no-caps")
            self._resume = ui.button("Go on", icon="play_arrow", on_click=guarded(self._resume_task)).props("outline dense no-caps")
            self._cancel = ui.button("Cancel", icon="stop_circle", on_click=self._cancel_dialog.ask).props(
                "outline dense no-caps color=negative"
            )
            self._cancel.props('aria-label="Cancel this task"')
            only_with(Right.OPERATE, self._pause, self._resume, self._cancel)
            self._retry = RetryButton(self._api, view)

    def render(self, view: TaskView) -> None:
        self._view = view
        is_ended = view.phase is Phase.ENDED
        self._badge.show_sign(task_sign(view))
        completed_count, share = _progress(view)
        count = len(view.steps)
        self._steps.set_text(
            f"{completed_count} of {count_text(count, 'step')} done" if count else "no plan yet" if not is_ended else "none"
        )
        self._track.props(f'aria-valuenow="{100 * share:.0f}" aria-valuemin="0" aria-valuemax="100"')
        self._fill.style(f"width: {100 * share:.1f}%")
        tone = "good" if view.outcome == "accomplished" else "soft" if is_ended else "accent"
        self._fill.style(f"background: var(--{tone})")
        self._cancel.visible, self._retry.visible = not is_ended, is_ended
        self._pause.visible = not is_ended and view.pause is None
        self._resume.visible = not is_ended and view.pause is not None
        self._cancel_dialog.render(view)
        self._record.props(f'href="/api/{"records" if is_ended else "tasks"}/{view.task}"')
        current_reasons = reasons(view)
        if current_reasons != self._shown_reasons:
            self._shown_reasons = current_reasons
            self._reason_status.clear()
            with self._reason_status, ui.element("ul").classes("somrs-task-why"):
                if view.waiting_for is not None:
                    with ui.element("li"):
                        show_waits(view.waiting_for, "Waits for")
                if view.waiting_to_retry is not None:
                    show_hindrances(view.waiting_to_retry)
                waits = view.waiting_for is not None or view.waiting_to_retry is not None
                stated_count = (view.pause is not None) + (view.waiting_for_answer is not None)
                for reason in current_reasons[:stated_count] if waits else current_reasons:
                    with ui.element("li"):
                        ui.label(reason_text(reason)).tooltip(reason)
        self._reason_status.visible = bool(current_reasons)
        if is_ended:
            self._clock.deactivate()
        self._tick()

    async def _pause_task(self) -> None:
        await self._api.tasks.pause(self._view.task, by=author())
        notify("The task is paused")

    async def _resume_task(self) -> None:
        await self._api.tasks.resume(self._view.task, by=author())
        notify("The task goes on")

    def _tick(self) -> None:
        view, now = self._view, time.time()
        self._remaining.set_text(remaining_text(view, now) or "none")
        self._cost.set_text(cost_text(view) or "not recorded")
        end_time = view.ended_at if view.ended_at is not None else now
        elapsed = format_duration(max(0.0, end_time - view.submitted_at))
        self._elapsed.set_text(f"{elapsed}, until {format_time(view.ended_at)}" if view.ended_at is not None else f"{elapsed} so far")
        self._due.set_text(due_text(view.deadline, view.due_at, view.outcome is not None, now))


def reason_text(reason: str) -> str:
    """The reason as a list item."""
    return gist(reason[:1].upper() + reason[1:])


def _progress(view: TaskView) -> tuple[int, float]:
    """The number of completed steps, and the share of all steps that is done (0 to 1)."""
    completed_count = sum(step.state is State.COMPLETED for step in view.steps)
    share = completed_count + sum(step.fraction for step in view.steps if step.state is State.EXECUTING)
    return completed_count, share / len(view.steps) if view.steps else float(view.outcome == "accomplished")


def _fact(name: str) -> ui.label:
    with ui.element("div"):
        with ui.element("dt"):
            ui.label(name)
        with ui.element("dd"):
            return ui.label()


def _link_fact(name: str, text: str, target: str) -> None:
    with ui.element("div"):
        with ui.element("dt"):
            ui.label(name)
        with ui.element("dd"):
            ui.link(text, target)


def _file(target: str, name: str, icon: str, text: str) -> ui.element:
    """A menu item that downloads a file under this name."""
    with ui.element("a").props(f'role="menuitem" href="{target}" download="{name}"').classes("somrs-file") as link:
        ui.icon(icon).props('aria-hidden="true"')
        ui.label(text)
    return link
