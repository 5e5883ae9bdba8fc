"""Goals on the floor plan: the user drags a thing to its destination, or clicks the thing and then the destination."""

from __future__ import annotations

from typing import Any

from somrs.gui.components.confirm_dialog import choose
from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.pages.define.builder import Builder
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.define.goal_lines import add_placement, lines_of, text_of
from somrs.gui.shell import guarded, notify

REPLACE, ADD = "Replace the goal", "Add to the goal"


class GoalFloorPlan:
    """The plan, with arrows for the goal."""

    def __init__(self, form: Form, builder: Builder) -> None:
        self._form, self._builder = form, builder
        self._arrows: list[tuple[str, str]] | None = None
        self._plan = FloorPlan(mode="pick").classes("somrs-define-plan")
        self._plan.on_dropped(self._dropped)
        self._plan.on_select(self._selected)
        self._plan.on_loaded(self._loaded)
        form.on_change(self._refresh)

    def _loaded(self, _: dict[str, Any]) -> None:
        """Draw the arrows once the plan has its objects."""
        self._arrows = []
        self._refresh()

    async def _selected(self, event: dict[str, Any]) -> None:
        self._plan.choose(event.get("name"))
        if event.get("name"):
            await self._builder.point(event["name"])

    async def _dropped(self, event: dict[str, Any]) -> None:
        thing, target = event["thing"], event.get("target")
        if not target:
            notify(f"{thing} cannot be put there. Drop it on furniture, a place, a robot or a floor.", bad=True)
            return
        placements = await guarded(self._form.api.formulas.placings)(thing, target)
        if placements is None:
            return
        if not placements.formulas:
            notify(f"{thing} cannot be at {target}: the ontology has no relation between the two.", bad=True)
            return
        formula = placements.formulas[0]
        if self._form.has_earlier_goal:
            text = f"The goal of your earlier draft is: {self._form.draft.effect}. Replace it by {formula}, or add {formula} to it?"
            match await choose(text, REPLACE, ADD):
                case None:
                    return
                case choice if choice == REPLACE:
                    self._form.draft.effect = ""
        self._add_to_goal(formula)

    def _add_to_goal(self, formula: str) -> None:
        """Add a formula to the goal; it replaces the parts that contradict it."""
        ontology = self._form.api.context.ontology
        effect = self._form.draft.effect.strip()
        lines = lines_of(effect, ontology) if effect else []
        new_lines = lines_of(formula, ontology)
        if lines is None or not new_lines:
            self._form.draft.effect = f"({effect})\nAND {formula}"
        else:
            self._form.draft.effect = text_of(add_placement(lines, new_lines[0], ontology))
        self._form.changed()

    def _refresh(self) -> None:
        effect = self._form.draft.effect
        lines = lines_of(effect, self._form.api.context.ontology) if effect.strip() else []
        if lines is None or self._arrows is None:
            return
        arrows = [(line.thing, line.related_thing) for line in lines if line.relation and not line.denied]
        if arrows != self._arrows:
            self._arrows = arrows
            self._plan.point(arrows)
