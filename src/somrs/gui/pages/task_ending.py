"""Ending a task before it is done: the question whether that is meant, which says what will be undone."""

from __future__ import annotations

from collections.abc import Iterator

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.shell import guarded, tell
from somrs.protocol.messages.clients import Phase, TaskView, WorkView
from somrs.protocol.messages.frp import State

DONE = (State.COMPLETED, State.FAILED, State.STOPPED, State.UNREACHABLE)


def consequences(view: TaskView) -> list[str]:
    """What cancelling the task now means, a sentence each."""
    if view.phase is Phase.ENDED:
        return ["The task is over: there is nothing left to cancel."]
    at_work = [work for work in view.work if work.state is State.EXECUTING]
    arranged = [step for step in view.steps if step.state is State.COMMITTED]
    said = [f"{work.service} is stopped ({work.step}{_object(work)})." for work in at_work]
    said += [f"What {work.service} did is undone: again {work.before}." for work in _undone(view)]
    if arranged:
        said.append(f"Services that are arranged for {', '.join(step.step for step in arranged)} are sent home.")
    return said or ["Nothing was done yet, so nothing has to be undone."]


def _undone(view: TaskView) -> Iterator[WorkView]:
    """What will be undone, last things first; of work that one took over from another, the whole in one go."""
    seen: set[str] = set()
    for work in reversed(view.work):
        if work.before is not None and work.state in (*DONE, State.EXECUTING) and "." not in work.step and work.before not in seen:
            seen.add(work.before)
            yield work


def _object(work: WorkView) -> str:
    return f", {next(iter(work.inputs.values()))}" if work.inputs else ""


class Ending:
    """A dialog. While it is open it follows the task: what cancelling means changes with each step."""

    def __init__(self, desk: LiveApi, view: TaskView) -> None:
        self._desk, self._view = desk, view
        self._shown: list[str] = []
        with ui.dialog() as self._dialog, ui.card().classes("somrs-dialog"):
            ui.label("Cancel this task?").classes("somrs-title").props('role="heading" aria-level="2"')
            self._wish = ui.label(view.effect).classes("somrs-formula")
            self._said = ui.element("ul").classes("somrs-consequences").props('aria-live="polite"')
            self._reason = ui.input("Reason, kept with the task", placeholder="not needed any more").props("outlined dense autofocus")
            self._reason.classes("somrs-wide").on("keydown.enter", guarded(self._cancel))
            with ui.element("div").classes("somrs-dialog-ways"):
                ui.button("Let it go on", on_click=self._dialog.close).props("flat no-caps")
                self._button = ui.button("Cancel the task", icon="stop_circle", on_click=guarded(self._cancel))
                self._button.props("unelevated no-caps color=negative")

    def ask(self) -> None:
        self._dialog.open()
        self.show(self._view)

    def show(self, view: TaskView) -> None:
        self._view = view
        if not self._dialog.value:
            return
        said = consequences(view)
        if said != self._shown:
            self._shown = said
            self._said.clear()
            with self._said:
                for sentence in said:
                    with ui.element("li"):
                        ui.label(sentence)
        self._button.set_enabled(view.phase is not Phase.ENDED)

    async def _cancel(self) -> None:
        if self._view.phase is Phase.ENDED:
            tell("The task is over already.")
        else:
            await self._desk.tasks.cancel(self._view.task, str(self._reason.value or "").strip() or "cancelled by the client")
            tell("Cancelling: what runs is stopped, and what was done is undone.")
        self._dialog.close()
