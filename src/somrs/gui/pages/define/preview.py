"""The preview of a task: its plan, price and duration, or the reasons why there is no plan."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence

from nicegui import background_tasks, ui

from somrs.api.formulas import CheckFormula
from somrs.client.durations import format_duration
from somrs.client.outlook_text import outlook_note, outlook_price
from somrs.errors import SomrsError
from somrs.gui.components.table_head import table_head
from somrs.gui.components.task.graph import PlanGraph
from somrs.gui.pages.define.draft import Draft
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.task_waits import show_waits
from somrs.gui.panel import panel
from somrs.protocol.messages.previews import Obstacle, OtherPlan, Previewed, Quotation
from somrs.protocol.messages.previews import Preview as PreviewRequest
from somrs.protocol.messages.task_views import StepView

ADVICE = {
    Obstacle.NO_SERVICE_TYPE: "No service type has such an effect. Choose a goal that a service can achieve:",
    Obstacle.NOT_OFFERED: "Start a device that offers the service, or wait for one; the Fleet page shows the available devices.",
    Obstacle.PROMISED: "Wait until the other tasks are done, or give this one a higher priority.",
    Obstacle.UNKNOWN: "Find the object or device, and enter its place on the Map page, or let a service observe it.",
    Obstacle.PRECONDITION: "Change or remove the precondition under Execution options, Precondition.",
    Obstacle.NO_OBJECT: "Use the name of an object on the map; the Map page shows all objects.",
    Obstacle.TWO_PLACES: "Split the goal: parts that cannot hold at the same time need several tasks, one after the other.",
}
"""What the user can do about each obstacle to a plan."""
_OTHERWISE = "Choose a smaller goal, or another thing or place; the Map page shows the current state."


class Preview:
    def __init__(self, form: Form) -> None:
        self._form = form
        self._running: asyncio.Task[None] | None = None
        self._previewed_request: PreviewRequest | None = None
        with panel("Preview", "preview", "define preview", "somrs-define-preview") as self._panel:
            self._hint = ui.label("Shows the plan, the services and the price before the task is started.").classes("somrs-soft")
            with ui.element("div").classes("somrs-define-progress").props('role="status"') as self._progress:
                ui.spinner(size="20px")
                self._waiting = ui.label()
                ui.button("Stop", on_click=self.stop).props("flat dense no-caps")
            with ui.element("div").classes("somrs-define-stale").props('role="status"') as self._stale:
                ui.icon("update").props('aria-hidden="true"')
                ui.label("The task has changed since this preview.")
                ui.button("Preview again", on_click=self.begin).props("flat dense no-caps")
            self._result = ui.element("div").classes("somrs-define-found")
        self._progress.visible = self._stale.visible = False
        self._tick = ui.timer(0.5, self._ticked, active=False)
        form.on_change(self._changed)

    def begin(self) -> None:
        """Request a preview in the background."""
        self.stop()
        self._panel.element.props("open")
        # On a narrow screen, the preview is below the visible part.
        ui.run_javascript(f"getHtmlElement({self._panel.element.id}).scrollIntoView({{block: 'nearest'}})")
        self._running = background_tasks.create(self._run(), name="preview", context=self._result)

    def stop(self) -> None:
        if self._running is not None and not self._running.done():
            self._running.cancel()

    async def _run(self) -> None:
        self._hint.visible = self._stale.visible = False
        self._progress.visible = True
        self._start_time = time.monotonic()
        self._ticked()
        self._tick.activate()
        try:
            request = self._form.draft.preview()
            checked = await self._form.api.formulas.check(CheckFormula(text=request.effect))
            if not checked.ok:
                self._refused(
                    "The goal is not valid",
                    [problem.problem + (f"; {problem.hint}" if problem.hint else "") for problem in checked.problems],
                    [],
                )
                return
            preview = await self._form.api.tasks.preview(request)
            self._previewed_request = request
            await self._show_preview(preview)
        except SomrsError as error:
            self._refused("The preview failed", str(error).splitlines(), [])
        finally:
            self._progress.visible = False
            self._tick.deactivate()
            self._hint.visible = not self._result.default_slot.children

    def _ticked(self) -> None:
        seconds = time.monotonic() - self._start_time
        self._waiting.set_text("Planning and requesting terms" + (f", {seconds:.0f} s" if seconds >= 1 else ""))

    def _changed(self) -> None:
        if self._previewed_request is not None:
            self._stale.visible = not _is_same_request(self._form.draft, self._previewed_request)

    # Results

    async def _show_preview(self, preview: Previewed) -> None:
        if not preview.steps and preview.reasons:
            await self._show_impossible(preview)
            return
        self._result.clear()
        with self._result:
            if not preview.steps:
                _show_notice("check_circle", "good", "The goal already holds: nothing needs to be done.")
                self._panel.note.set_text("nothing to do")
                return
            if preview.waiting_for is not None:
                with ui.element("div").classes("somrs-define-said somrs-tone-busy"):
                    ui.icon("hourglass_empty").props('aria-hidden="true"')
                    with ui.element("div"):
                        show_waits(preview.waiting_for, "The task would wait for")
            if preview.quotations or preview.unserved:
                self._totals(preview)
            PlanGraph(steps=preview.steps, label="Plan preview").classes("somrs-define-graph")
            if preview.quotations or preview.unserved:
                _quotes(preview)
            if preview.alternatives:
                _plans(preview)

    def _totals(self, preview: Previewed) -> None:
        count = f"{len(preview.steps)} step{'' if len(preview.steps) == 1 else 's'}"
        price = f"{preview.price:g} {preview.currency}" if preview.price is not None else "unknown"
        duration = format_duration(preview.seconds) if preview.seconds is not None else "unknown"
        qualifier = "about " if preview.estimate else ""
        if (outlook := preview.outlook) is not None:
            price, duration = outlook_price(outlook, preview.currency), f"{format_duration(outlook.least_seconds)} at the earliest"
            qualifier = ""
        with ui.element("dl").classes("somrs-define-totals"):
            for name, value in (("Steps", str(len(preview.steps))), ("Price", qualifier + price), ("Done in", qualifier + duration)):
                with ui.element("div"):
                    with ui.element("dt"):
                        ui.label(name)
                    with ui.element("dd"):
                        ui.label(value)
        if outlook is not None:
            ui.label(f"As foreseen; {outlook_note(outlook)}.").classes("somrs-soft")
        has_terms = preview.price is not None or outlook is not None
        summary_parts = [price] * has_terms + [f"done in {duration}"] * (preview.seconds is not None or outlook is not None)
        self._panel.note.set_text(", ".join([count, *summary_parts]))

    async def _show_impossible(self, preview: Previewed) -> None:
        advice = [ADVICE[obstacle] for obstacle in preview.obstacles] or [_OTHERWISE]
        if Obstacle.NO_SERVICE_TYPE in preview.obstacles:
            advice[preview.obstacles.index(Obstacle.NO_SERVICE_TYPE)] += f" {await self._offered_effects()}"
        self._refused("No plan is possible now", preview.reasons, advice)

    async def _offered_effects(self) -> str:
        """The effects of the services that are currently on offer, as a text."""
        offers = (await self._form.api.fleet.services()).offers
        effects = dict.fromkeys(offer.service_type.effect for offer in offers)
        return ", or ".join(effects) + "." if effects else "no service is on offer now."

    def _refused(self, title: str, reasons: Sequence[str], advice: Sequence[str]) -> None:
        self._previewed_request = self._current_request()
        self._panel.note.set_text("not possible")
        self._result.clear()
        with self._result, ui.element("div").classes("somrs-define-refused").props('role="alert"'):
            _show_notice("block", "bad", title)
            with ui.element("ul").classes("somrs-define-reasons"):
                for reason in reasons:
                    with ui.element("li"):
                        ui.label(reason)
            for text in advice:
                _show_notice("lightbulb", "busy", text)

    def _current_request(self) -> PreviewRequest | None:
        try:
            return self._form.draft.preview()
        except SomrsError:
            return None


def _is_same_request(draft: Draft, request: PreviewRequest) -> bool:
    try:
        return draft.preview() == request
    except SomrsError:
        return False


def _show_notice(icon: str, tone: str, text: str) -> None:
    with ui.element("div").classes(f"somrs-define-said somrs-tone-{tone}"):
        ui.icon(icon).props('aria-hidden="true"')
        ui.label(text)


def _plans(preview: Previewed) -> None:
    """All plans side by side. The first is the one that is shown."""
    ui.label("Plans that were compared").classes("somrs-soft").props('role="heading" aria-level="3"')
    view = ui.element("div").classes("somrs-terms-view").props('tabindex="0" role="group" aria-label="Plans that were compared"')
    with view, ui.element("table").classes("somrs-terms"):
        table_head(("Steps", "Price", "Done in", "Result"))
        with ui.element("tbody"):
            _plan(preview, chosen=True)
            for plan in preview.alternatives:
                _plan(plan, chosen=False)


def _plan(plan: Previewed | OtherPlan, *, chosen: bool) -> None:
    is_served = plan.outlook is not None or (plan.price is not None and plan.seconds is not None)
    tone, icon, word = ("good", "check_circle", "Chosen") if chosen else ("plain", "remove_circle_outline", "Not chosen")
    if not is_served:
        tone, icon, word = "bad", "block", "Not every step has terms"
    with ui.element("tr").classes(f"somrs-tone-{tone}{' somrs-terms-chosen' if chosen else ''}"):
        with ui.element("th").props('scope="row"'):
            for step in plan.steps:
                ui.label(step.service or step.service_type)
        if plan.outlook is not None:
            _cell(outlook_price(plan.outlook, plan.currency))
            _cell(f"from {format_duration(plan.outlook.least_seconds)}")
        else:
            _cell(f"{plan.price:g} {plan.currency}" if plan.price is not None else "–")
            _cell(format_duration(plan.seconds) if plan.seconds is not None else "–")
        with ui.element("td").classes("somrs-define-became"):
            ui.icon(icon).props('aria-hidden="true"')
            ui.label(word).classes("somrs-terms-word")


def _quotes(preview: Previewed) -> None:
    """The terms of the services for each step, and which would be chosen."""
    by_step: dict[str, list[Quotation]] = {}
    for quotation in preview.quotations:
        by_step.setdefault(quotation.step, []).append(quotation)
    view = ui.element("div").classes("somrs-terms-view").props('tabindex="0" role="group" aria-label="Terms by step"')
    with view, ui.element("table").classes("somrs-terms"):
        table_head(("Service", "Price", "From – until", "Result"))
        for step in (step for step in preview.steps if not step.foreseen):
            quotes = sorted(by_step.get(step.step, []), key=lambda quote: (not quote.chosen, quote.price is None, quote.price or 0.0))
            _step(step, quotes, preview.unserved.get(step.step, ""))


def _step(step: StepView, quotes: Sequence[Quotation], unserved: str) -> None:
    with ui.element("tbody"):
        with ui.element("tr").classes("somrs-terms-step"), ui.element("th").props('colspan="4" scope="rowgroup"'):
            ui.label(f"{step.service_type}: {', '.join(step.inputs.values())}")
        for quote in quotes:
            _quote(quote)
        if unserved:
            with ui.element("tr").classes("somrs-tone-bad"), ui.element("td").props('colspan="4"').classes("somrs-define-became"):
                ui.icon("error").props('aria-hidden="true"')
                ui.label(unserved)


def _quote(quote: Quotation) -> None:
    tone, icon, word = ("good", "check_circle", "Chosen") if quote.chosen else ("plain", "remove_circle_outline", "Not chosen")
    if quote.price is None:
        tone, icon, word = "bad", "block", "No offer"
    with ui.element("tr").classes(f"somrs-tone-{tone}{' somrs-terms-chosen' if quote.chosen else ''}"):
        with ui.element("th").props('scope="row"'):
            ui.label(quote.service)
        _cell(f"{quote.price:g} {quote.currency}" if quote.price is not None else "–")
        times = [format_duration(max(0.0, moment)) for moment in (quote.start, quote.finish) if moment is not None]
        _cell(" – ".join(times) or "–")
        with ui.element("td").classes("somrs-define-became"):
            ui.icon(icon).props('aria-hidden="true"')
            with ui.element("div"):
                ui.label(word + (", estimated from earlier terms" if quote.estimate else "")).classes("somrs-terms-word")
                if quote.condition is not None:
                    ui.label(f"Only if {quote.condition}").classes("somrs-soft")
                if quote.reason:
                    ui.label(quote.reason).classes("somrs-soft")


def _cell(text: str) -> None:
    with ui.element("td"):
        ui.label(text)
