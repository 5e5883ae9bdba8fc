"""Wishes on the plan: a thing is dragged to where it is to be, or clicked, and then the place."""

from __future__ import annotations

from typing import Any

from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.pages.define.builder import Builder
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.define.lines import lines_of, moved, text_of
from somrs.gui.shell import guarded, tell


class Plan:
    """The plan, with arrows for what is wished."""

    def __init__(self, form: Form, builder: Builder) -> None:
        self._form, self._builder = form, builder
        self._pointed: list[tuple[str, str]] | None = None
        self._plan = FloorPlan(mode="pick").classes("somrs-define-plan")
        self._plan.on_dropped(self._dropped)
        self._plan.on_select(self._selected)
        self._plan.on_loaded(self._loaded)
        form.on_change(self._show)

    def _loaded(self, _: dict[str, Any]) -> None:
        """Arrows can be drawn to what is on the plan."""
        self._pointed = []
        self._show()

    async def _selected(self, said: dict[str, Any]) -> None:
        self._plan.choose(said.get("name"))
        if said.get("name"):
            await self._builder.point(said["name"])

    async def _dropped(self, said: dict[str, Any]) -> None:
        thing, target = said["thing"], said.get("target")
        if not target:
            tell(f"There is nothing there that {thing} could be on. Drop it on furniture, a place, a robot or a floor.", bad=True)
            return
        found = await guarded(self._form.desk.formulas.placings)(thing, target)
        if found is None:
            return
        if not found.formulas:
            tell(f"{thing} cannot be at {target}: no relation of the ontology joins the two.", bad=True)
            return
        self._wish(found.formulas[0])

    def _wish(self, formula: str) -> None:
        """Have this in the wish, too, instead of what cannot be so at the same time."""
        ontology = self._form.desk.context.ontology
        effect = self._form.draft.effect.strip()
        lines = lines_of(effect, ontology) if effect else []
        said = lines_of(formula, ontology)
        if lines is None or not said:
            self._form.draft.effect = f"({effect})\nAND {formula}"
        else:
            self._form.draft.effect = text_of(moved(lines, said[0], ontology))
        self._form.changed()

    def _show(self) -> None:
        effect = self._form.draft.effect
        lines = lines_of(effect, self._form.desk.context.ontology) if effect.strip() else []
        if lines is None or self._pointed is None:
            return
        pointed = [(line.thing, line.other) for line in lines if line.relation and not line.denied]
        if pointed != self._pointed:
            self._pointed = pointed
            self._plan.point(pointed)
