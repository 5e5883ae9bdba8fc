"""The findings of a task that asks what is so: the answers, who saw them, and when; and the observations without a result."""

from __future__ import annotations

from nicegui import ui

from somrs.gui.components.table_head import table_head
from somrs.gui.icons import format_time
from somrs.gui.panel import Panel
from somrs.protocol.messages.findings import Finding, Findings, Unseen
from somrs.protocol.messages.task_views import Phase, TaskView


class FindingsPanel:
    """Shows the findings when the task has ended."""

    def __init__(self, panel: Panel) -> None:
        self._panel = panel
        self._shown: Findings | None = None
        self._content = ui.element("div").props('role="status"')
        with self._content:
            ui.label("Services are observing it.").classes("somrs-soft")

    def render(self, view: TaskView) -> None:
        findings = view.findings
        if findings is None or findings == self._shown:
            self._panel.note.set_text("" if view.phase is Phase.ENDED else "in progress")
            return
        self._shown = findings
        count = len(findings.answers)
        answers = f"{count}{' or more' if findings.more else ''} answer{'s' if count != 1 else ''}"
        self._panel.note.set_text(answers if count else "not so")
        self._content.clear()
        with self._content:
            if findings.answers:
                _table(findings)
            else:
                _notice("remove_circle_outline", "plain", f"Not so: {findings.formula}")
            for entry in findings.unseen:
                _notice("visibility_off", "bad", _unseen_text(entry))


def _table(findings: Findings) -> None:
    names = [*findings.answers[0].bindings]
    view = ui.element("div").classes("somrs-terms-view").props('tabindex="0" role="group" aria-label="Answers"')
    with view, ui.element("table").classes("somrs-terms"):
        table_head((*(f"?{name}" for name in names), "What is so", "Seen by", "At"))
        with ui.element("tbody"):
            for finding in findings.answers:
                _answer(finding, names)


def _answer(finding: Finding, names: list[str]) -> None:
    sighting = finding.sightings[0] if finding.sightings else None
    cells = (
        *(finding.bindings.get(name, "") for name in names),
        finding.situation,
        sighting.service.partition(".")[0] if sighting is not None else "nobody now; the map says so",
        format_time(sighting.at) if sighting is not None else "–",
    )
    with ui.element("tr"):
        for text in cells:
            with ui.element("td"):
                ui.label(text)


def _unseen_text(entry: Unseen) -> str:
    objects = ", ".join(entry.inputs.values())
    return f"{entry.service.partition('.')[0]} did not find out {objects}: {entry.reason}"


def _notice(icon: str, tone: str, text: str) -> None:
    with ui.element("div").classes(f"somrs-define-said somrs-tone-{tone}"):
        ui.icon(icon).props('aria-hidden="true"')
        ui.label(text)
