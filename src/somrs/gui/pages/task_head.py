"""The head of a task's page: what was wished for by whom, how far it is or how it ended and why, and what can be done about it."""

from __future__ import annotations

import time

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.client.task_report import reasons
from somrs.gui.icons import Badge, clock, lasted
from somrs.gui.pages.task_ending import Ending
from somrs.gui.pages.task_words import PHASES, counted, due, gist, key, sign
from somrs.protocol.messages.clients import Phase, Policy, TaskView
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.people import person_name

POLICIES = {Policy.PRICE: "the cheapest", Policy.TIME: "the soonest", Policy.WEIGHTED: "price and time"}


class Head:
    """Changed in place as the task goes on."""

    def __init__(self, desk: LiveApi, view: TaskView) -> None:
        self._view = view
        self._ending = Ending(desk, view)
        with ui.element("header").classes("somrs-sheet somrs-task-head"):
            with ui.element("div").classes("somrs-task-line"):
                ui.link("Tasks", "/tasks").classes("somrs-task-back").props('aria-label="Back to all tasks"')
                self._badge = Badge(PHASES[Phase.PLANNING])
                self._effect = ui.label(view.effect).classes("somrs-formula somrs-task-effect").props('role="heading" aria-level="1"')
                self._ways(view)
            with ui.element("div").classes("somrs-task-track").props('role="progressbar" aria-label="Steps done"') as self._track:
                self._fill = ui.element("div")
            with ui.element("dl").classes("somrs-task-facts"):
                self._steps = _fact("Steps")
                self._took = _fact("Time")
                _fact("Stated").set_text(f"{clock(view.submitted_at)} by {person_name(view.client)}")
                self._due = _fact("Deadline")
                _fact("Priority").set_text(str(view.priority))
                _fact("Chosen by").set_text(POLICIES[view.policy])
                if view.precondition:
                    _fact("From").set_text(view.precondition)
                _fact("Id").set_text(key(view.task)[:8])
            self._why = ui.element("ul").classes("somrs-task-why").props('role="status"')
        self._told: tuple[str, ...] | None = None
        self._clock = ui.timer(1.0, self._tick)
        self.show(view)

    def _ways(self, view: TaskView) -> None:
        name = f"task-{key(view.task)[:8]}"
        with ui.element("div").classes("somrs-task-ways"):
            with ui.button("Export", icon="download").props("flat dense no-caps"), ui.menu():
                _file(f"/api/tasks/{view.task}/chart", f"{name}.svg", "schema", "Messages as a picture (SVG)")
                self._record = _file("", f"{name}.json", "data_object", "Record, for programs (JSON)")
            self._cancel = ui.button("Cancel", icon="stop_circle", on_click=self._ending.ask).props("outline dense no-caps color=negative")
            self._cancel.props('aria-label="Cancel this task"')

    def show(self, view: TaskView) -> None:
        self._view = view
        over = view.phase is Phase.ENDED
        self._badge.show(sign(view.phase, view.outcome))
        done, share = progress(view)
        count = len(view.steps)
        self._steps.set_text(f"{done} of {counted(count, 'step')} done" if count else "no plan yet" if not over else "none")
        self._track.props(f'aria-valuenow="{100 * share:.0f}" aria-valuemin="0" aria-valuemax="100"')
        self._fill.style(f"width: {100 * share:.1f}%")
        tone = "good" if view.outcome == "accomplished" else "soft" if over else "accent"
        self._fill.style(f"background: var(--{tone})")
        self._cancel.visible = not over
        self._ending.show(view)
        self._record.props(f'href="/api/{"records" if over else "tasks"}/{view.task}"')
        why = reasons(view)
        if why != self._told:
            self._told = why
            self._why.clear()
            with self._why:
                for reason in why:
                    with ui.element("li"):
                        ui.label(item(reason)).tooltip(reason)
        self._why.visible = bool(why)
        if over:
            self._clock.deactivate()
        self._tick()

    def _tick(self) -> None:
        view, now = self._view, time.time()
        until = view.ended_at if view.ended_at is not None else now
        took = lasted(max(0.0, until - view.submitted_at))
        self._took.set_text(f"{took}, until {clock(view.ended_at)}" if view.ended_at is not None else f"{took} so far")
        self._due.set_text(due(view.submitted_at, view.deadline, view.outcome is not None, now))


def item(reason: str) -> str:
    """A reason as it stands in the list."""
    return gist(reason[:1].upper() + reason[1:])


def progress(view: TaskView) -> tuple[int, float]:
    """How many steps are done, and how much of all of them together."""
    done = sum(step.state is State.COMPLETED for step in view.steps)
    share = done + sum(step.fraction for step in view.steps if step.state is State.EXECUTING)
    return done, share / len(view.steps) if view.steps else float(view.outcome == "accomplished")


def _fact(name: str) -> ui.label:
    with ui.element("div"):
        with ui.element("dt"):
            ui.label(name)
        with ui.element("dd"):
            return ui.label()


def _file(target: str, name: str, icon: str, text: str) -> ui.element:
    """A way in a menu to a file that is kept under this name."""
    with ui.element("a").props(f'href="{target}" download="{name}"').classes("somrs-file") as link:
        ui.icon(icon).props('aria-hidden="true"')
        ui.label(text)
    return link
