"""What is so after work that ended early: chosen from sentences, from the places of the map, or written as a formula."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.devices.person.assignments import Outcome
from somrs.devices.person.outcomes import PLACING
from somrs.entish.formula import Name, Relation, conjuncts
from somrs.entish.parse import parse
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.places import PlacePicker

ELSEWHERE, FORMULA, UNKNOWN = "elsewhere", "formula", "unknown"


class OutcomeChoice:
    """Radio buttons for the outcomes; `situation` is the chosen one, as a formula."""

    def __init__(self, api: LiveApi, outcomes: Sequence[Outcome], effect: str) -> None:
        self._place = ""
        things = _moved_things(effect)
        options = {outcome.situation: outcome.text for outcome in outcomes}
        if len(things) == 1:
            options[ELSEWHERE] = "It is somewhere else"
        options |= {UNKNOWN: "I do not know", FORMULA: "Something else (a formula)"}
        ui.label("What is so now?").classes("somrs-person-ask")
        self._radio = shown_at_once(ui.radio(options, value=None, on_change=self._show_fields)).props('aria-label="What is so now?"')
        with ui.element("div").classes("somrs-person-place") as self._place_field:
            for thing in things[:1]:
                PlacePicker(thing, api.context.map, api.context.ontology, self._choose_place)
        self._formula = ui.input("Formula").props("outlined dense").classes("somrs-formula")
        self._show_fields()

    @property
    def is_chosen(self) -> bool:
        match self._radio.value:
            case None:
                return False
            case "elsewhere":
                return bool(self._place)
            case "formula":
                return bool(str(self._formula.value or "").strip())
        return True

    @property
    def situation(self) -> str | None:
        """None: not known."""
        match self._radio.value:
            case "elsewhere":
                return self._place
            case "formula":
                return str(self._formula.value).strip()
            case "unknown":
                return None
        return str(self._radio.value)

    def _choose_place(self, formula: str) -> None:
        self._place = formula

    def _show_fields(self) -> None:
        self._place_field.visible = self._radio.value == ELSEWHERE
        self._formula.visible = self._radio.value == FORMULA


def _moved_things(effect: str) -> list[str]:
    """The things that the work puts somewhere."""
    relations = [part for part in conjuncts(parse(effect)) if isinstance(part, Relation) and part.relation in PLACING]
    return [relation.arguments[0].name for relation in relations if isinstance(relation.arguments[0], Name)]
