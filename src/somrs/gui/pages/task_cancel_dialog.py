"""The dialog that confirms cancelling a task and lists what will be undone."""

from __future__ import annotations

from collections.abc import Iterator

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.author import author
from somrs.gui.shell import guarded, notify
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.task_views import Phase, TaskView, WorkView

_FINISHED_STATES = (State.COMPLETED, State.FAILED, State.STOPPED, State.UNREACHABLE)


def cancel_consequences(view: TaskView) -> list[str]:
    """The consequences of cancelling the task now, a sentence each."""
    if view.phase is Phase.ENDED:
        return ["The task has ended: there is nothing to cancel."]
    at_work = [work for work in view.work if work.state is State.EXECUTING]
    arranged = [step for step in view.steps if step.state is State.COMMITTED]
    sentences = [f"{work.service} is stopped ({work.step}{_object(work)})." for work in at_work]
    sentences += [f"What {work.service} did is undone: {work.before} holds again." for work in _undone(view)]
    if arranged:
        sentences.append(f"Services arranged for {', '.join(step.step for step in arranged)} are released.")
    return sentences or ["Nothing has been done yet, so nothing needs to be undone."]


def _undone(view: TaskView) -> Iterator[WorkView]:
    """Work that will be undone, latest first. Work that several services did one after another for one step is undone at once."""
    restored_situations: set[str] = set()
    for work in reversed(view.work):
        if (
            work.before is not None
            and work.state in (*_FINISHED_STATES, State.EXECUTING)
            and "." not in work.step
            and work.before not in restored_situations
        ):
            restored_situations.add(work.before)
            yield work


def _object(work: WorkView) -> str:
    return f", {next(iter(work.inputs.values()))}" if work.inputs else ""


class CancelDialog:
    """The dialog. While it is open, it shows the consequences for the current state of the task."""

    def __init__(self, api: LiveApi, view: TaskView) -> None:
        self._api, self._view = api, view
        self._shown_sentences: list[str] = []
        with ui.dialog().props('aria-label="Cancel this task?"') as self._dialog, ui.card().classes("somrs-dialog"):
            ui.label("Cancel this task?").classes("somrs-title").props('role="heading" aria-level="2"')
            self._goal = ui.label(view.effect).classes("somrs-formula")
            self._consequence_list = ui.element("ul").classes("somrs-consequences").props('aria-live="polite"')
            self._reason = ui.input("Reason, recorded with the task", placeholder="not needed any more").props("outlined dense autofocus")
            self._reason.classes("somrs-wide").on("keydown.enter", guarded(self._cancel))
            with ui.element("div").classes("somrs-dialog-ways"):
                ui.button("Keep running", on_click=self._dialog.close).props("flat no-caps")
                self._button = ui.button("Cancel the task", icon="stop_circle", on_click=guarded(self._cancel))
                self._button.props("unelevated no-caps color=negative")

    def ask(self) -> None:
        self._dialog.open()
        self.render(self._view)

    def render(self, view: TaskView) -> None:
        self._view = view
        if not self._dialog.value:
            return
        sentences = cancel_consequences(view)
        if sentences != self._shown_sentences:
            self._shown_sentences = sentences
            self._consequence_list.clear()
            with self._consequence_list:
                for sentence in sentences:
                    with ui.element("li"):
                        ui.label(sentence)
        self._button.set_enabled(view.phase is not Phase.ENDED)

    async def _cancel(self) -> None:
        if self._view.phase is Phase.ENDED:
            notify("The task has already ended.")
        else:
            await self._api.tasks.cancel(self._view.task, str(self._reason.value or "").strip(), by=author())
            notify("Cancelling: running steps are stopped, and completed work is undone.")
        self._dialog.close()
