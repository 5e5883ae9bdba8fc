"""What would be done, and what it would cost, before anything is started; or why it cannot be."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence

from nicegui import background_tasks, ui

from somrs.api.formulas import CheckFormula
from somrs.errors import SomrsError
from somrs.gui.components.task.graph import PlanGraph
from somrs.gui.icons import lasted
from somrs.gui.pages.define.draft import Draft
from somrs.gui.pages.define.form import Form
from somrs.gui.panel import panel
from somrs.protocol.messages.clients import Obstacle, Previewed, Quotation, StepView
from somrs.protocol.messages.clients import Preview as Wanted

ADVICE = {
    Obstacle.NO_SERVICE_TYPE: "Nothing that this system knows of can do this. Wish for something that a service brings about:",
    Obstacle.NOT_OFFERED: "Start a device that offers it, or wait until one joins; the Fleet page shows who is there.",
    Obstacle.PROMISED: "Wait until the other tasks are done, or state this one with a higher priority.",
    Obstacle.PRECONDITION: "Change the situation that it begins from, or leave it out, under How, Beginning.",
    Obstacle.NO_OBJECT: "Write the name of a thing that is on the map; the Map page shows them all.",
    Obstacle.TWO_PLACES: "Wish for less at once: what cannot be so at one moment takes several tasks, one after the other.",
}
"""What can be done about what stands in the way of a plan."""
OTHERWISE = "Wish for less at once, or for another thing or place; the Map page shows how things are."


class Preview:
    def __init__(self, form: Form) -> None:
        self._form = form
        self._running: asyncio.Task[None] | None = None
        self._of: Wanted | None = None
        with panel("Preview", "preview", "define preview", "somrs-define-preview") as self._panel:
            self._none = ui.label("See what would be done, by whom and at what price, before anything is started.").classes("somrs-soft")
            with ui.element("div").classes("somrs-define-progress").props('role="status"') as self._progress:
                ui.spinner(size="20px")
                self._waiting = ui.label()
                ui.button("Stop", on_click=self.stop).props("flat dense no-caps")
            with ui.element("div").classes("somrs-define-stale").props('role="status"') as self._stale:
                ui.icon("update").props('aria-hidden="true"')
                ui.label("The task was changed since.")
                ui.button("Preview again", on_click=self.begin).props("flat dense no-caps")
            self._found = ui.element("div").classes("somrs-define-found")
        self._progress.visible = self._stale.visible = False
        self._tick = ui.timer(0.5, self._ticked, active=False)
        form.on_change(self._changed)

    def begin(self) -> None:
        """Ask; the page goes on meanwhile."""
        self.stop()
        self._panel.element.props("open")
        # On a narrow screen it is below what one sees.
        ui.run_javascript(f"getHtmlElement({self._panel.element.id}).scrollIntoView({{block: 'nearest'}})")
        self._running = background_tasks.create(self._run(), name="preview", context=self._found)

    def stop(self) -> None:
        if self._running is not None and not self._running.done():
            self._running.cancel()

    async def _run(self) -> None:
        self._none.visible = self._stale.visible = False
        self._progress.visible = True
        self._began = time.monotonic()
        self._ticked()
        self._tick.activate()
        try:
            wanted = self._form.draft.preview()
            checked = await self._form.desk.formulas.check(CheckFormula(text=wanted.effect))
            if not checked.ok:
                self._refused("This is no wish yet", [one.problem + (f"; {one.hint}" if one.hint else "") for one in checked.problems], [])
                return
            found = await self._form.desk.tasks.preview(wanted)
            self._of = wanted
            await self._show(found)
        except SomrsError as error:
            self._refused("There is no preview", str(error).splitlines(), [])
        finally:
            self._progress.visible = False
            self._tick.deactivate()
            self._none.visible = not self._found.default_slot.children

    def _ticked(self) -> None:
        seconds = time.monotonic() - self._began
        self._waiting.set_text("Planning, and asking for terms" + (f", {seconds:.0f} s" if seconds >= 1 else ""))

    def _changed(self) -> None:
        if self._of is not None:
            self._stale.visible = not _same(self._form.draft, self._of)

    # What was found

    async def _show(self, found: Previewed) -> None:
        if not found.steps and found.reasons:
            await self._impossible(found)
            return
        self._found.clear()
        with self._found:
            if not found.steps:
                _said("check_circle", "good", "It is so already: nothing is to be done.")
                self._panel.note.set_text("nothing to be done")
                return
            if found.waits:
                _said("hourglass_empty", "busy", found.waits)
            if found.quotations or found.unserved:
                self._totals(found)
            PlanGraph(steps=found.steps, label="What would be done").classes("somrs-define-graph")
            if found.quotations or found.unserved:
                _quotes(found)

    def _totals(self, found: Previewed) -> None:
        count = f"{len(found.steps)} step{'' if len(found.steps) == 1 else 's'}"
        price = f"{found.price:g} {found.currency}" if found.price is not None else "unknown"
        took = lasted(found.seconds) if found.seconds is not None else "unknown"
        about = "about " if found.estimate else ""
        with ui.element("dl").classes("somrs-define-totals"):
            for name, value in (("Steps", str(len(found.steps))), ("Price", about + price), ("Done in", about + took)):
                with ui.element("div"):
                    with ui.element("dt"):
                        ui.label(name)
                    with ui.element("dd"):
                        ui.label(value)
        known = [price] * (found.price is not None) + [f"done in {took}"] * (found.seconds is not None)
        self._panel.note.set_text(", ".join([count, *known]))

    async def _impossible(self, found: Previewed) -> None:
        advice = [ADVICE[obstacle] for obstacle in found.obstacles] or [OTHERWISE]
        if Obstacle.NO_SERVICE_TYPE in found.obstacles:
            advice[found.obstacles.index(Obstacle.NO_SERVICE_TYPE)] += f" {await self._brought_about()}"
        self._refused("There is no way to do this now", found.reasons, advice)

    async def _brought_about(self) -> str:
        """What the services that are on offer now bring about."""
        offers = (await self._form.desk.fleet.services()).offers
        effects = dict.fromkeys(offer.service_type.effect for offer in offers)
        return ", or ".join(effects) + "." if effects else "nobody offers anything now."

    def _refused(self, title: str, reasons: Sequence[str], advice: Sequence[str]) -> None:
        self._of = self._of_now()
        self._panel.note.set_text("not possible")
        self._found.clear()
        with self._found, ui.element("div").classes("somrs-define-refused").props('role="alert"'):
            _said("block", "bad", title)
            with ui.element("ul").classes("somrs-define-reasons"):
                for reason in reasons:
                    with ui.element("li"):
                        ui.label(reason)
            for text in advice:
                _said("lightbulb", "busy", text)

    def _of_now(self) -> Wanted | None:
        try:
            return self._form.draft.preview()
        except SomrsError:
            return None


def _same(draft: Draft, wanted: Wanted) -> bool:
    try:
        return draft.preview() == wanted
    except SomrsError:
        return False


def _said(icon: str, tone: str, text: str) -> None:
    with ui.element("div").classes(f"somrs-define-said somrs-tone-{tone}"):
        ui.icon(icon).props('aria-hidden="true"')
        ui.label(text)


def _quotes(found: Previewed) -> None:
    """Who offers each step, and who would get it."""
    by_step: dict[str, list[Quotation]] = {}
    for one in found.quotations:
        by_step.setdefault(one.step, []).append(one)
    with ui.element("div").classes("somrs-terms-view"), ui.element("table").classes("somrs-terms"):
        with ui.element("thead"), ui.element("tr"):
            for name in ("Service", "Price", "From – until", "Would become"):
                with ui.element("th").props('scope="col"'):
                    ui.label(name)
        for step in found.steps:
            quotes = sorted(by_step.get(step.step, []), key=lambda one: (not one.chosen, one.price is None, one.price or 0.0))
            _step(step, quotes, found.unserved.get(step.step, ""))


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
        times = [lasted(max(0.0, at)) for at in (quote.start, quote.finish) if at is not None]
        _cell(" – ".join(times) or "–")
        with ui.element("td").classes("somrs-define-became"):
            ui.icon(icon).props('aria-hidden="true"')
            with ui.element("div"):
                ui.label(word + (", by what it asked last" if quote.estimate else "")).classes("somrs-terms-word")
                if quote.reason:
                    ui.label(quote.reason).classes("somrs-soft")


def _cell(text: str) -> None:
    with ui.element("td"):
        ui.label(text)
